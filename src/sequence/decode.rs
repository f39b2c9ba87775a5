//! Decodes one image file to 8-bit grey.
//!
//! Grey is defined the same way for every format: the value itself of a grey picture, the luma channel of a JPEG file, and (9798 R + 19235
//! G + 3735 B + 16384) / 32768, rounded down, of colours (BT.601's 0.299, 0.587, 0.114 in 15 bits). Transparency is ignored. 16-bit values
//! are scaled as described at [`GrayDecoder`].

use std::path::Path;

use image::{DynamicImage, GrayImage, RgbImage};

use super::{
    ImageSize,
    still::{Wanted, decode},
};
use crate::simd::widest;

/// Why bytes cannot be decoded as an image.
///
/// ```
/// use grimace::sequence::{DecodeError, SequenceError, read_frame};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("frame_1.png");
/// std::fs::write(&path, "")?;
/// let error = read_frame(&path).unwrap_err();
/// assert!(matches!(error, SequenceError::Decode { source: DecodeError::Empty, .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// The file is empty.
    #[error("the file is empty")]
    Empty,
    /// The file ends before the image does.
    #[error("the {format} image is cut off: {reason}")]
    Truncated {
        /// Format of the file.
        format: &'static str,
        /// What is missing, or the share that is present.
        reason: String,
    },
    /// The bytes are not a known image format.
    #[error("not an image in a known format (PNG, JPEG, TIFF, BMP, PGM, PPM, WebP), or damaged; it starts with {start}")]
    NotAnImage {
        /// The first bytes in readable form.
        start: String,
    },
    /// A damaged file of a known format.
    #[error("the {format} image is damaged: {reason}")]
    Damaged {
        /// Format of the file.
        format: &'static str,
        /// Message of the decoder.
        reason: String,
    },
    /// A known format in an unsupported form.
    #[error("the {format} image has {found}; {supported} are supported")]
    Unsupported {
        /// Format of the file.
        format: &'static str,
        /// Property that is not supported.
        found: String,
        /// Supported kinds.
        supported: &'static str,
    },
    /// A picture of more pixels than the limit.
    #[error(
        "the picture is {size}, {} megapixels, above the limit of {}; raise the limit with --max-pixels",
        megapixels(u64::from(size.width) * u64::from(size.height)), megapixels(*most)
    )]
    TooLarge {
        /// Size stated in the header.
        size: ImageSize,
        /// The limit, pixels.
        most: u64,
    },
    /// A width or height of 0.
    #[error("the picture is {size}: it has no pixels")]
    NoPixels {
        /// Size stated in the header.
        size: ImageSize,
    },
}

/// Text for a number of pixels in millions, with enough decimals for small pictures.
fn megapixels(pixels: u64) -> String {
    let steps = if pixels < 1_000_000 { 1000.0 } else { 10.0 };
    format!("{}", (pixels as f64 / 1e6 * steps).round() / steps)
}

/// Decodes images of one sequence to 8-bit grey.
///
/// 16-bit images are scaled by the number of bits (10, 12, 14 or 16) that the largest value of the first such image uses. A 12-bit camera
/// therefore gives no black frames, and brightness does not vary from frame to frame.
#[derive(Debug, Default)]
pub struct GrayDecoder {
    bits: Option<u32>,
    /// Number of pictures with values beyond these bits.
    cut: usize,
}

impl GrayDecoder {
    /// Returns a decoder for pictures of a sequence. It uses the bits of the sequence's first picture, if that can be read.
    pub(super) fn of_sequence(first: &Path) -> Self {
        let mut decoder = Self::default();
        let _ = crate::input::read(first).map_err(DecodeError::from).and_then(|bytes| decoder.decode(&bytes));
        decoder
    }

    /// Decodes the bytes of a file to a single 8-bit channel.
    ///
    /// # Errors
    /// [`DecodeError`] for anything but a complete image.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<GrayImage, DecodeError> {
        let image = decode(bytes, Wanted::Grey)?;
        let (width, height) = (image.width(), image.height());
        let narrow = match image {
            DynamicImage::ImageLuma8(image) => return Ok(image),
            DynamicImage::ImageLumaA8(image) => image.pixels().map(|p| p.0[0]).collect(),
            DynamicImage::ImageRgb8(image) => return Ok(grey_of(&image)),
            DynamicImage::ImageRgba8(image) => image.pixels().map(|p| grey8([p.0[0], p.0[1], p.0[2]])).collect(),
            DynamicImage::ImageLuma16(image) => self.scale_to_8_bit(image.as_raw()),
            DynamicImage::ImageLumaA16(image) => self.scale_to_8_bit(&image.pixels().map(|p| p.0[0]).collect::<Vec<_>>()),
            DynamicImage::ImageRgb16(image) => self.scale_to_8_bit(&image.pixels().map(|p| grey16(p.0)).collect::<Vec<_>>()),
            DynamicImage::ImageRgba16(image) => {
                self.scale_to_8_bit(&image.pixels().map(|p| grey16([p.0[0], p.0[1], p.0[2]])).collect::<Vec<_>>())
            }
            other => return Err(other_pixels(&other)),
        };
        Ok(GrayImage::from_raw(width, height, narrow).unwrap_or_default())
    }

    /// Note about 16-bit images with larger values than the first one's bits allow.
    pub(super) fn remark(&self) -> Option<String> {
        let (bits, cut) = (self.bits?, self.cut);
        let pictures = if cut == 1 { "1 picture has".to_owned() } else { format!("{cut} pictures have") };
        (cut > 0).then(|| {
            format!(
                "{pictures} values of more than {bits} bits, the bit depth of the first picture; such values are read as white. Save all \
                 pictures with the same bit depth, or as 8-bit pictures"
            )
        })
    }

    fn scale_to_8_bit(&mut self, values: &[u16]) -> Vec<u8> {
        let used = bits_of(values.iter().copied().max().unwrap_or(0));
        let bits = *self.bits.get_or_insert(used);
        self.cut += usize::from(used > bits);
        let scale = 255.0 / ((1_u32 << bits) - 1) as f32;
        values.iter().map(|&v| (f32::from(v) * scale).round_ties_even() as u8).collect()
    }
}

/// Number of bits that the largest 16-bit value uses: 10, 12, 14 or 16.
pub(super) fn bits_of(largest: u16) -> u32 {
    [10, 12, 14].into_iter().find(|&b| u32::from(largest) < 1 << b).unwrap_or(16)
}

pub(super) fn other_pixels(image: &DynamicImage) -> DecodeError {
    DecodeError::Unsupported {
        format: "decoded",
        found: format!("pixels of the kind {:?}", image.color()),
        supported: "8-bit and 16-bit integers",
    }
}

/// Converts colours to grey, as defined for every format but JPEG, whose luma channel is used directly.
pub fn grey_of(image: &RgbImage) -> GrayImage {
    let mut values = Vec::with_capacity(image.as_raw().len() / 3);
    add_greys(image.as_raw(), &mut values);
    GrayImage::from_raw(image.width(), image.height(), values).unwrap_or_default()
}

/// Appends the grey values of some pixels, as defined by [`grey_of`], to a list.
pub(super) fn add_greys(colours: &[u8], values: &mut Vec<u8>) {
    widest(
        #[inline(always)]
        || greys(colours, values),
    );
}

/// Number of pixels converted at once.
const LANES: usize = 16;

#[inline(always)]
fn greys(colours: &[u8], values: &mut Vec<u8>) {
    let (blocks, rest) = colours.as_chunks::<{ 3 * LANES }>();
    for block in blocks {
        let mut greys = [0; LANES];
        for k in 0..LANES {
            greys[k] = grey8([block[3 * k], block[3 * k + 1], block[3 * k + 2]]);
        }
        values.extend_from_slice(&greys);
    }
    values.extend(rest.as_chunks().0.iter().map(|colour| grey8(*colour)));
}

#[inline(always)]
fn weighted([r, g, b]: [u32; 3]) -> u32 {
    (9798 * r + 19235 * g + 3735 * b + 16384) >> 15
}

#[inline(always)]
fn grey8(rgb: [u8; 3]) -> u8 {
    weighted(rgb.map(u32::from)) as u8
}

fn grey16(rgb: [u16; 3]) -> u16 {
    weighted(rgb.map(u32::from)) as u16
}

#[cfg(test)]
mod tests {
    use image::{ExtendedColorType, ImageEncoder};

    use super::*;

    fn png_8(width: u32, height: u32) -> Vec<u8> {
        let pixels: Vec<u8> = (0..width * height).map(|i| (i * 7 % 256) as u8).collect();
        let mut bytes = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut bytes);
        encoder.write_image(&pixels, width, height, ExtendedColorType::L8).unwrap();
        bytes
    }

    fn png_16(value: u16) -> Vec<u8> {
        let pixels: Vec<u8> = [value, value / 2, 0, value].iter().flat_map(|v| v.to_ne_bytes()).collect();
        let mut bytes = Vec::new();
        image::codecs::png::PngEncoder::new(&mut bytes).write_image(&pixels, 2, 2, ExtendedColorType::L16).unwrap();
        bytes
    }

    #[test]
    fn grey_png_comes_back_unchanged() {
        let image = GrayDecoder::default().decode(&png_8(5, 3)).unwrap();
        assert_eq!(image.dimensions(), (5, 3));
        assert_eq!(image.as_raw()[..4], [0, 7, 14, 21]);
    }

    #[test]
    fn sixteen_bit_images_use_the_range_of_the_first() {
        let mut decoder = GrayDecoder::default();
        // 4095 uses 12 bits: it becomes 255; half of it, 2047, becomes 127.47, rounded 127.
        assert_eq!(decoder.decode(&png_16(4095)).unwrap().as_raw(), &[255, 127, 0, 255]);
        // The second image keeps the 12-bit scale: 1000 * 255 / 4095 = 62.27.
        assert_eq!(decoder.decode(&png_16(1000)).unwrap().as_raw(), &[62, 31, 0, 62]);
        assert_eq!(decoder.remark(), None);
        // 5000 exceeds 12 bits: it becomes white, with a note.
        assert_eq!(decoder.decode(&png_16(5000)).unwrap().as_raw(), &[255, 156, 0, 255]);
        assert!(decoder.remark().unwrap().starts_with(
            "1 picture has values of more than 12 bits, the bit depth of the first picture; such values are read as white"
        ));
    }

    #[test]
    fn small_limits_are_no_zeros() {
        let said = [4096, 102_400, 1_260_000, 128_000_000].map(megapixels);
        assert_eq!(said, ["0.004", "0.102", "1.3", "128"]);
    }

    #[test]
    fn damaged_files_are_reported_with_their_format() {
        let message = |bytes: &[u8]| GrayDecoder::default().decode(bytes).unwrap_err().to_string();
        assert_eq!(message(b""), "the file is empty");
        let png = png_8(64, 64);
        assert!(message(&png[..png.len() / 2]).contains("PNG image is cut off"));
        assert!(message(b"hello, I am text").contains("the text \"hello, I am \""));
        assert!(message(&[0xFF, 0xD8, 0xFF, 0xE0, 1, 2]).contains("JPEG image is cut off"));
        assert!(message(b"P5\n# made by hand\n4 4\n255\n123").contains("3 of 16 bytes of pixels"));
        assert!(message(b"P5 2 2 255").contains("0 of 4 bytes of pixels"));
        assert!(message(b"BM\xff\x00\x00\x00rest").contains("BMP image is cut off"));
        assert!(message(b"P5 99999999999999999999 4 255 ").contains("PGM image is damaged"));
    }
}
