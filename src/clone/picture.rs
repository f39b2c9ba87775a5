//! Films in one file, and sheets of pictures side by side.

use image::{
    Delay, Frame, Rgb, RgbImage,
    codecs::gif::{GifEncoder, Repeat},
};

use super::CloneError;
use crate::render::{LABEL_HEIGHT, Labelled, write_label};

/// Width of the gap between pictures of a sheet, px.
const GAP: u32 = 6;
/// Colour around the pictures.
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);

/// Pictures in rows and columns, like the paper's figures 6 and 7.
#[derive(Clone, Debug)]
pub struct Sheet {
    rows: Vec<Vec<Labelled>>,
    max_height: u32,
}

impl Sheet {
    /// An empty sheet, whose pictures are at most `max_height` px high.
    pub fn new(max_height: u32) -> Self {
        Self { rows: Vec::new(), max_height }
    }

    /// Adds a row of pictures without labels.
    pub fn push_row(&mut self, pictures: Vec<RgbImage>) {
        self.push_labelled_row(pictures.into_iter().map(|picture| Labelled { picture, label: String::new() }).collect());
    }

    /// Adds a row of pictures with their labels below; all get the height of the highest, in proportion.
    pub fn push_labelled_row(&mut self, pictures: Vec<Labelled>) {
        self.rows.push(even(pictures, self.max_height));
    }

    /// Draws the sheet.
    pub fn draw(&self) -> RgbImage {
        let width_of = |row: &Vec<Labelled>| row.iter().map(|p| p.picture.width() + GAP).sum::<u32>() + GAP;
        let picture_height = |row: &Vec<Labelled>| row.first().map_or(0, |p| p.picture.height());
        let height_of =
            |row: &Vec<Labelled>| picture_height(row) + if row.iter().any(|p| !p.label.is_empty()) { LABEL_HEIGHT } else { 0 };
        let width = self.rows.iter().map(width_of).max().unwrap_or(GAP);
        let height = self.rows.iter().map(|row| height_of(row) + GAP).sum::<u32>() + GAP;
        let mut sheet = RgbImage::from_pixel(width, height, PAPER);
        let mut y = GAP;
        for row in &self.rows {
            let mut x = GAP;
            for Labelled { picture, label } in row {
                image::imageops::replace(&mut sheet, picture, i64::from(x), i64::from(y));
                write_label(&mut sheet, label, x + 2, y + picture_height(row) + 5, picture.width().saturating_sub(4));
                x += picture.width() + GAP;
            }
            y += height_of(row) + GAP;
        }
        sheet
    }
}

/// The pictures of a row at one height.
fn even(row: Vec<Labelled>, max_height: u32) -> Vec<Labelled> {
    let height = row.iter().map(|p| p.picture.height()).max().unwrap_or(0).min(max_height).max(1);
    row.into_iter().map(|p| Labelled { picture: at_height(&p.picture, height), label: p.label }).collect()
}

/// A picture scaled to a height, in proportion.
pub fn at_height(picture: &RgbImage, height: u32) -> RgbImage {
    if picture.height() == height || picture.height() == 0 {
        return picture.clone();
    }
    let width = (f64::from(picture.width()) * f64::from(height) / f64::from(picture.height())).round().max(1.0) as u32;
    let filter =
        if height < picture.height() { image::imageops::FilterType::Triangle } else { image::imageops::FilterType::CatmullRom };
    image::imageops::resize(picture, width, height, filter)
}

/// An animated GIF that repeats for ever: 256 colours, and times in hundredths of a second. Frames are taken one after the other.
///
/// # Errors
/// [`CloneError::Encode`] when a side is over 65535 px; what `frames` gives as error.
pub fn animated_gif(frames: impl IntoIterator<Item = Result<RgbImage, CloneError>>, fps: f64) -> Result<Vec<u8>, CloneError> {
    let error = |e: image::ImageError| CloneError::Encode { what: "the GIF", reason: e.to_string() };
    let mut bytes = Vec::new();
    {
        // Speed 10 of 1 to 30: colours as good as the slower ones at a fifth of the time.
        let mut encoder = GifEncoder::new_with_speed(&mut bytes, 10);
        encoder.set_repeat(Repeat::Infinite).map_err(error)?;
        for frame in frames {
            let delay = Delay::from_numer_denom_ms((1000.0 / fps.max(0.1)).round().max(20.0) as u32, 1);
            let rgba = image::DynamicImage::ImageRgb8(frame?).to_rgba8();
            encoder.encode_frame(Frame::from_parts(rgba, 0, 0, delay)).map_err(error)?;
        }
    }
    Ok(bytes)
}

/// An animated PNG of `count` frames that repeats for ever: every colour as rendered. Frames are taken one after the other.
///
/// # Errors
/// [`CloneError::Encode`] without frames or with another number of them; what `frames` gives as error.
pub fn animated_png(
    frames: impl IntoIterator<Item = Result<RgbImage, CloneError>>,
    count: usize,
    fps: f64,
) -> Result<Vec<u8>, CloneError> {
    let error = |e: png::EncodingError| CloneError::Encode { what: "the APNG", reason: e.to_string() };
    let mut frames = frames.into_iter();
    let first =
        frames.next().ok_or_else(|| CloneError::Encode { what: "the APNG", reason: "there is no frame".to_owned() })??;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, first.width(), first.height());
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(count as u32, 0).map_err(error)?;
    let milliseconds = (1000.0 / fps.max(0.1)).round().clamp(1.0, 65_535.0) as u16;
    encoder.set_frame_delay(milliseconds, 1000).map_err(error)?;
    let mut writer = encoder.write_header().map_err(error)?;
    let mut written = 0;
    for frame in std::iter::once(Ok(first)).chain(frames) {
        writer.write_image_data(frame?.as_raw()).map_err(error)?;
        written += 1;
    }
    if written != count {
        return Err(CloneError::Encode { what: "the APNG", reason: format!("{written} frames instead of {count}") });
    }
    writer.finish().map_err(error)?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use image::AnimationDecoder;

    use super::*;

    fn frames() -> Vec<RgbImage> {
        (0..3).map(|k| RgbImage::from_pixel(20, 10, Rgb([80 * k, 10, 200]))).collect()
    }

    #[test]
    fn an_animated_gif_has_every_frame_and_its_time() {
        let bytes = animated_gif(frames().into_iter().map(Ok), 25.0).unwrap();
        let decoder = image::codecs::gif::GifDecoder::new(std::io::Cursor::new(bytes)).unwrap();
        let read: Vec<_> = decoder.into_frames().collect::<Result<_, _>>().unwrap();
        assert_eq!(read.len(), 3);
        assert_eq!(read[0].delay().numer_denom_ms(), (40, 1));
    }

    #[test]
    fn an_animated_png_keeps_every_colour() {
        let bytes = animated_png(frames().into_iter().map(Ok), 3, 25.0).unwrap();
        let decoder = image::codecs::png::PngDecoder::new(std::io::Cursor::new(bytes)).unwrap();
        let read: Vec<_> = decoder.apng().unwrap().into_frames().collect::<Result<_, _>>().unwrap();
        assert_eq!(read.len(), 3);
        assert_eq!(read[2].buffer().get_pixel(5, 5).0, [160, 10, 200, 255]);
        assert!(animated_png([], 0, 25.0).is_err());
        assert!(animated_png(frames().into_iter().map(Ok), 2, 25.0).is_err());
    }

    #[test]
    fn a_sheet_has_a_gap_around_every_picture() {
        let mut sheet = Sheet::new(100);
        sheet.push_row(frames());
        sheet.push_row(frames()[..1].to_vec());
        // 3 * 20 + 4 gaps of 6 = 84 across, 2 * 10 + 3 gaps = 38 down.
        assert_eq!(sheet.draw().dimensions(), (84, 38));
        // A row with a label is higher by the line it is written on.
        sheet.push_labelled_row(vec![Labelled { picture: frames()[0].clone(), label: "ab".to_owned() }]);
        assert_eq!(sheet.draw().dimensions(), (84, 38 + 10 + LABEL_HEIGHT + 6));
    }
}
