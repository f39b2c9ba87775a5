//! Film files (GIF, APNG) and sheets of pictures side by side.

use image::{
    Delay, Frame, Rgb, RgbImage,
    codecs::gif::{GifEncoder, Repeat},
};

use nalgebra::Point2;

use super::CloneError;
use crate::render::{LABEL_HEIGHT, Labelled, in_few_colours, write_label};
use crate::sequence::LONGEST_FRAME_S;

/// Width of the gap between pictures of a sheet, px.
const GAP: u32 = 6;
/// Colour around the pictures.
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);

/// Pictures in rows and columns, like figures 6 and 7 of the paper.
#[derive(Clone, Debug)]
pub struct Sheet {
    rows: Vec<Vec<Labelled>>,
    max_height: u32,
}

impl Sheet {
    /// Creates an empty sheet whose pictures are at most `max_height` px high.
    pub fn new(max_height: u32) -> Self {
        Self { rows: Vec::new(), max_height }
    }

    /// Adds a row of pictures without labels.
    pub fn push_row(&mut self, pictures: Vec<RgbImage>) {
        self.push_labelled_row(pictures.into_iter().map(|picture| Labelled { picture, label: String::new() }).collect());
    }

    /// Adds a row of pictures with labels below, scaled to the height of the highest one. An empty picture leaves its cell empty.
    pub fn push_labelled_row(&mut self, pictures: Vec<Labelled>) {
        self.rows.push(even(pictures, self.max_height));
    }

    /// Width of each column; a column holds one moment or one expression.
    fn columns(&self) -> Vec<u32> {
        let count = self.rows.iter().map(Vec::len).max().unwrap_or(0);
        let width = |k: usize| self.rows.iter().filter_map(|row| row.get(k)).map(|p| p.picture.width()).max().unwrap_or(0);
        (0..count).map(width).collect()
    }

    /// Draws the sheet with pictures centred in their columns.
    pub fn draw(&self) -> RgbImage {
        let columns = self.columns();
        let picture_height = |row: &Vec<Labelled>| row.first().map_or(0, |p| p.picture.height());
        let height_of =
            |row: &Vec<Labelled>| picture_height(row) + if row.iter().any(|p| !p.label.is_empty()) { LABEL_HEIGHT } else { 0 };
        let width = columns.iter().map(|width| width + GAP).sum::<u32>() + GAP;
        let height = self.rows.iter().map(|row| height_of(row) + GAP).sum::<u32>() + GAP;
        let mut sheet = RgbImage::from_pixel(width, height, PAPER);
        let mut y = GAP;
        for row in &self.rows {
            let mut x = GAP;
            for (Labelled { picture, label }, column) in row.iter().zip(&columns) {
                let left = x + (column - picture.width()) / 2;
                image::imageops::replace(&mut sheet, picture, i64::from(left), i64::from(y));
                write_label(&mut sheet, label, left + 2, y + picture_height(row) + 5, picture.width().saturating_sub(4));
                x += column + GAP;
            }
            y += height_of(row) + GAP;
        }
        sheet
    }
}

/// The part of same-sized pictures that a cell of a sheet shows: all of them, or the face with a margin if the face is small.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FaceCell {
    /// Left, top, width and height, px; `None` for whole pictures.
    part: Option<[u32; 4]>,
}

impl FaceCell {
    /// Margin on each side of the face, relative to its height: hair, ears and neck.
    const ROOM: f64 = 0.45;
    /// Fraction of the picture's area from which it is shown as a whole.
    const WHOLE: f64 = 0.7;

    /// Creates the cell for pictures of a size, from the face's nodes in all of them, px.
    pub fn around<'a>((width, height): (u32, u32), nodes: impl IntoIterator<Item = &'a Point2<f64>>) -> Self {
        let ends = nodes.into_iter().filter(|p| p.coords.iter().all(|c| c.is_finite())).fold(None, |ends, p| {
            let (low, high) = ends.unwrap_or((*p, *p));
            Some((low.inf(p), high.sup(p)))
        });
        let Some((low, high)) = ends else { return Self { part: None } };
        let room = Self::ROOM * (high.y - low.y);
        let side = |low: f64, high: f64, size: u32| {
            let end = |value: f64| value.round().clamp(0.0, f64::from(size)) as u32;
            (end(low - room), end(high + room + 1.0))
        };
        let ((left, right), (top, bottom)) = (side(low.x, high.x, width), side(low.y, high.y, height));
        let share = f64::from(right - left) * f64::from(bottom - top) / (f64::from(width) * f64::from(height)).max(1.0);
        let is_part = share > 0.0 && share < Self::WHOLE;
        Self { part: is_part.then_some([left, top, right - left, bottom - top]) }
    }

    /// Crops a picture to the cell.
    pub fn of(self, picture: &RgbImage) -> RgbImage {
        match self.part {
            Some([left, top, width, height]) => image::imageops::crop_imm(picture, left, top, width, height).to_image(),
            None => picture.clone(),
        }
    }
}

/// Scales the pictures of a row to one height.
fn even(row: Vec<Labelled>, max_height: u32) -> Vec<Labelled> {
    let height = row.iter().map(|p| p.picture.height()).max().unwrap_or(0).min(max_height).max(1);
    row.into_iter().map(|p| Labelled { picture: at_height(&p.picture, height), label: p.label }).collect()
}

/// Scales a picture to a height, in proportion.
pub fn at_height(picture: &RgbImage, height: u32) -> RgbImage {
    if picture.height() == height || picture.height() == 0 {
        return picture.clone();
    }
    let width = (f64::from(picture.width()) * f64::from(height) / f64::from(picture.height())).round().max(1.0) as u32;
    let filter =
        if height < picture.height() { image::imageops::FilterType::Triangle } else { image::imageops::FilterType::CatmullRom };
    image::imageops::resize(picture, width, height, filter)
}

/// Shortest time of a GIF frame, in hundredths of a second: viewers show shorter ones for a tenth of a second.
const LEAST_DELAY: u64 = 2;
/// Longest time of a GIF frame, in hundredths of a second.
const MOST_DELAY: u64 = u16::MAX as u64;

/// Checks that a frame is not shown for longer than every film format supports.
///
/// # Errors
/// [`CloneError::TooSlow`] if it is.
pub fn check_rate(fps: f64) -> Result<(), CloneError> {
    let (seconds, most) = (1.0 / fps, LONGEST_FRAME_S);
    if seconds <= most { Ok(()) } else { Err(CloneError::TooSlow { seconds, most }) }
}

/// Encodes an endless GIF with 256 colours and times in hundredths of a second. Frames are taken one at a time.
///
/// Each frame ends at the hundredth nearest to its time, so that the total duration is right. Frames that follow too fast for the
/// format are left out.
///
/// # Errors
/// [`CloneError::TooSlow`] for a frame that is too long for the format; [`CloneError::Encode`] if a side is over 65535 px; any error from
/// `frames`.
pub fn animated_gif(frames: impl IntoIterator<Item = Result<RgbImage, CloneError>>, fps: f64) -> Result<Vec<u8>, CloneError> {
    check_rate(fps)?;
    let error = |e: image::ImageError| CloneError::Encode { what: "the GIF", reason: e.to_string() };
    let end_of = |k: usize| ((k + 1) as f64 * 100.0 / fps).round() as u64;
    let mut bytes = Vec::new();
    {
        let mut encoder = GifEncoder::new(&mut bytes);
        encoder.set_repeat(Repeat::Infinite).map_err(error)?;
        let mut show = |picture: RgbImage, hundredths: u64| {
            let delay = Delay::from_numer_denom_ms((10 * hundredths.clamp(LEAST_DELAY, MOST_DELAY)) as u32, 1);
            encoder.encode_frame(Frame::from_parts(in_few_colours(&picture), 0, 0, delay)).map_err(error)
        };
        let (mut start, mut shown) = (0, None);
        for (k, frame) in frames.into_iter().enumerate() {
            let picture = shown.take().unwrap_or(frame?);
            let end = end_of(k);
            if end - start >= LEAST_DELAY {
                show(picture, end - start)?;
                start = end;
            } else {
                shown = Some(picture);
            }
        }
        if let Some(picture) = shown {
            show(picture, LEAST_DELAY)?;
        }
    }
    Ok(bytes)
}

/// Duration of a frame in seconds as a fraction of 16-bit numbers: exact for whole rates and for 24, 30 and 60 times 1000/1001.
fn frame_time(fps: f64) -> (u16, u16) {
    const MOST: f64 = u16::MAX as f64;
    let fps = fps.clamp(1.0 / MOST, MOST);
    // The continued fraction of the rate, as far as 16 bits go.
    let (mut before, mut last, mut rest) = ((1.0, 0.0), (fps.floor(), 1.0), fps.fract());
    while rest > 1e-9 && (last.0 / last.1 - fps).abs() > 1e-9 * fps {
        let whole = (1.0_f64 / rest).floor();
        let next: (f64, f64) = (whole * last.0 + before.0, whole * last.1 + before.1);
        if next.0 > MOST || next.1 > MOST {
            break;
        }
        rest = 1.0 / rest - whole;
        (before, last) = (last, next);
    }
    (last.1 as u16, last.0.max(1.0) as u16)
}

/// Encodes an endless APNG of `count` frames, without loss of colour. Frames are taken one at a time.
///
/// # Errors
/// [`CloneError::Encode`] without frames or with another number of them; any error from `frames`.
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
    let (numerator, denominator) = frame_time(fps);
    encoder.set_frame_delay(numerator, denominator).map_err(error)?;
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
    fn cells_show_the_face_where_it_is_a_small_part() {
        let face = [Point2::new(400.0, 100.0), Point2::new(480.0, 200.0)];
        // 45 px of room on each side, and the last pixel itself: 355 to 526, 55 to 246.
        let cell = FaceCell::around((1000, 600), &face);
        assert_eq!(cell, FaceCell { part: Some([355, 55, 171, 191]) });
        assert_eq!(cell.of(&RgbImage::new(1000, 600)).dimensions(), (171, 191));
        // Not beyond the picture; a face that fills it, and none at all, leave it whole.
        assert_eq!(FaceCell::around((500, 600), &face).part, Some([355, 55, 145, 191]));
        let nowhere = [Point2::new(f64::NAN, 1.0)];
        for (size, nodes) in [((90, 110), [Point2::new(5.0, 5.0), Point2::new(85.0, 105.0)].as_slice()), ((1000, 600), &nowhere)]
        {
            assert_eq!(FaceCell::around(size, nodes).of(&RgbImage::new(size.0, size.1)).dimensions(), size);
        }
        // A face outside the picture.
        assert_eq!(FaceCell::around((100, 90), &face).part, None);
    }

    #[test]
    fn an_empty_picture_leaves_its_place_in_the_columns_free() {
        let of = |k: u8| RgbImage::from_pixel(20, 10, Rgb([k, 10, 200]));
        let mut sheet = Sheet::new(10);
        sheet.push_row(vec![of(1), of(2), of(3)]);
        sheet.push_row(vec![of(4), RgbImage::new(0, 0), of(6)]);
        let drawn = sheet.draw();
        let at = |column: u32, row: u32| drawn.get_pixel(GAP + column * (20 + GAP) + 5, GAP + row * (10 + GAP) + 5).0[0];
        assert_eq!([[at(0, 0), at(1, 0), at(2, 0)], [at(0, 1), at(1, 1), at(2, 1)]], [[1, 2, 3], [4, PAPER.0[0], 6]]);
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
    fn the_times_of_a_gif_do_not_drift() {
        let times = |count: usize, fps: f64| -> Vec<u32> {
            let frames = (0..count).map(|k| Ok(RgbImage::from_pixel(2, 2, Rgb([k as u8, 0, 0]))));
            let decoder = image::codecs::gif::GifDecoder::new(std::io::Cursor::new(animated_gif(frames, fps).unwrap())).unwrap();
            decoder.into_frames().map(|f| f.unwrap().delay().numer_denom_ms().0 / 10).collect()
        };
        // 30 frames a second: ends at 3.33, 6.67, 10 hundredths, rounded 3, 7, 10.
        assert_eq!(times(6, 30.0), [3, 4, 3, 3, 4, 3]);
        assert_eq!(times(90, 30.0).iter().sum::<u32>(), 300);
        assert_eq!(times(60, 24.0).iter().sum::<u32>(), 250);
        // 100 frames a second: every other one.
        assert_eq!(times(6, 100.0), [2, 2, 2]);
        assert_eq!(times(1, 25.0), [4]);
        // Slow ones are as slow as in the other formats; a frame of more than 655 s is in none.
        assert_eq!(times(3, 0.05), [2000, 2000, 2000]);
        assert_eq!(times(2, 1.0 / 655.0), [65_500, 65_500]);
        assert!(matches!(animated_gif(vec![], 0.001), Err(CloneError::TooSlow { most: 655.0, .. })));
    }

    #[test]
    fn the_times_of_an_animated_png_are_exact() {
        let found = [25.0, 30.0, 30_000.0 / 1001.0, 24_000.0 / 1001.0, 12.5, 0.5, 1000.0].map(frame_time);
        assert_eq!(found, [(1, 25), (1, 30), (1001, 30_000), (1001, 24_000), (2, 25), (2, 1), (1, 1000)]);
        let (numerator, denominator) = frame_time(23.456_789);
        assert!((f64::from(denominator) / f64::from(numerator) - 23.456_789).abs() < 1e-5);
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

    #[test]
    fn pictures_of_other_widths_stand_in_columns() {
        let red = image::Rgb([200, 0, 0]);
        let row = |width: u32| vec![RgbImage::from_pixel(width, 10, red); 2];
        let mut sheet = Sheet::new(100);
        sheet.push_row(row(20));
        sheet.push_row(row(8));
        let drawn = sheet.draw();
        assert_eq!(drawn.dimensions(), (2 * 20 + 3 * GAP, 2 * 10 + 3 * GAP));
        // The second of the narrow ones is in the middle of the second column: 32 to 51.
        let is_red = |x: u32| *drawn.get_pixel(x, 10 + 2 * GAP + 5) == red;
        assert!(!is_red(37) && (38..46).all(is_red) && !is_red(46));
    }
}
