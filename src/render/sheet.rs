//! Contact sheets, labels and GIF animations.

use image::{
    Frame, Rgb, RgbImage, RgbaImage,
    codecs::gif::{GifEncoder, Repeat},
    imageops,
};
use rayon::prelude::*;

use super::palette::in_few_colours;

/// A picture with its label.
#[derive(Clone, Debug)]
pub struct Labelled {
    /// The picture.
    pub picture: RgbImage,
    /// Short description of what it shows.
    pub label: String,
}

const MARGIN: u32 = 8;
/// Height of the line for a label, px.
pub const LABEL_HEIGHT: u32 = 22;
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
const INK: [u8; 3] = [40, 40, 40];

/// Draws pictures of one size in rows of `columns`, each with its label below.
pub fn contact_sheet(pictures: &[Labelled], columns: usize) -> RgbImage {
    let (width, height) = pictures.iter().map(|p| p.picture.dimensions()).fold((1, 1), |(w, h), (x, y)| (w.max(x), h.max(y)));
    let columns = columns.clamp(1, pictures.len().max(1)) as u32;
    let rows = (pictures.len() as u32).div_ceil(columns);
    let (cell_width, cell_height) = (width + MARGIN, height + LABEL_HEIGHT + MARGIN);
    let mut sheet = RgbImage::from_pixel(columns * cell_width + MARGIN, rows * cell_height + MARGIN, PAPER);
    for (k, Labelled { picture, label }) in pictures.iter().enumerate() {
        let (column, row) = (k as u32 % columns, k as u32 / columns);
        let (x, y) = (MARGIN + column * cell_width, MARGIN + row * cell_height);
        imageops::replace(&mut sheet, picture, i64::from(x), i64::from(y));
        write_label(&mut sheet, label, x + 2, y + height + 5, width.saturating_sub(4));
    }
    sheet
}

/// Rows in the bitmap of a glyph, and the distance between glyphs, px.
const GLYPH: (usize, u32) = (8, 8);

/// Writes a text in a fixed-width 8 x 8 font, cut off at a width; characters that the font lacks become `?`.
pub fn write_label(picture: &mut RgbImage, text: &str, x: u32, y: u32, width: u32) {
    let fitting = (width / GLYPH.1) as usize;
    for (k, letter) in text.chars().take(fitting).enumerate() {
        let glyph =
            font8x8::legacy::BASIC_LEGACY.get(letter as usize).unwrap_or(&font8x8::legacy::BASIC_LEGACY[usize::from(b'?')]);
        for (row, bits) in glyph.iter().enumerate().take(GLYPH.0) {
            for column in (0..8).filter(|c| bits >> c & 1 == 1) {
                let (px, py) = (x + GLYPH.1 * k as u32 + column, y + row as u32);
                if px < picture.width() && py < picture.height() {
                    picture.put_pixel(px, py, Rgb(INK));
                }
            }
        }
    }
}

/// Encodes an endless GIF animation; each picture is shown for `centiseconds`.
///
/// # Errors
/// If the encoder fails, which it does for pictures with a side over 65535 px.
pub fn gif_bytes(pictures: &[RgbImage], centiseconds: u32) -> Result<Vec<u8>, image::ImageError> {
    let delay = image::Delay::from_numer_denom_ms(10 * centiseconds, 1);
    // Reducing the colours is most of the work, and each picture has its own palette.
    let pictures: Vec<RgbaImage> = pictures.par_iter().map(in_few_colours).collect();
    let mut bytes = Vec::new();
    {
        let mut encoder = GifEncoder::new(&mut bytes);
        encoder.set_repeat(Repeat::Infinite)?;
        for picture in pictures {
            encoder.encode_frame(Frame::from_parts(picture, 0, 0, delay))?;
        }
    }
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(colour: [u8; 3]) -> Labelled {
        Labelled { picture: RgbImage::from_pixel(40, 30, Rgb(colour)), label: "ab".to_owned() }
    }

    #[test]
    fn cells_stand_in_rows() {
        let sheet = contact_sheet(&[picture([255, 0, 0]), picture([0, 255, 0]), picture([0, 0, 255])], 2);
        // Two columns of 40 + 8 and a margin; two rows of 30 + 22 + 8 and a margin.
        assert_eq!(sheet.dimensions(), (104, 128));
        assert_eq!(sheet.get_pixel(10, 10).0, [255, 0, 0]);
        assert_eq!(sheet.get_pixel(60, 10).0, [0, 255, 0]);
        assert_eq!(sheet.get_pixel(10, 70).0, [0, 0, 255]);
        assert!((8..48).any(|x| (40..60).any(|y| sheet.get_pixel(x, y).0 == INK)));
        assert_eq!(contact_sheet(&[], 3).dimensions().0, 17);
    }

    #[test]
    fn a_gif_has_its_frames() {
        use image::AnimationDecoder;
        let bytes = gif_bytes(&[picture([255, 0, 0]).picture, picture([0, 0, 255]).picture], 4).unwrap();
        let decoder = image::codecs::gif::GifDecoder::new(std::io::Cursor::new(bytes)).unwrap();
        assert_eq!(decoder.into_frames().count(), 2);
    }
}
