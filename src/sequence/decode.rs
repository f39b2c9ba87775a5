//! One image file to 8-bit grey.

use opencv::{
    core::{CV_8U, CV_8UC1, CV_16U, Mat, min_max_loc},
    imgcodecs::{IMREAD_ANYDEPTH, IMREAD_GRAYSCALE, imdecode},
    prelude::*,
};

/// Why bytes are not an image.
#[derive(Debug, thiserror::Error)]
pub enum DecodeError {
    /// The file cannot be read.
    #[error("cannot be read: {0}")]
    Io(#[from] std::io::Error),
    /// No bytes.
    #[error("the file is empty")]
    Empty,
    /// The file ends before the image does.
    #[error("the {format} image is cut off: {reason}")]
    Truncated {
        /// Format of the file.
        format: &'static str,
        /// What is missing.
        reason: String,
    },
    /// No decoder understands the bytes.
    #[error("not an image in a known format (PNG, JPEG, TIFF, BMP, PGM, WebP), or damaged; it starts with {start}")]
    NotAnImage {
        /// The first bytes, readable.
        start: String,
    },
    /// Pixels that are neither 8- nor 16-bit integers.
    #[error("pixels are stored as OpenCV depth {depth}; 8-bit and 16-bit integers are supported")]
    Depth {
        /// OpenCV's depth code.
        depth: i32,
    },
    /// OpenCV failed.
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
}

/// Decodes images of one sequence to 8-bit grey.
///
/// 16-bit images are scaled by the number of bits that the first one of them uses (10, 12, 14 or 16, by its largest value), so that
/// a 12-bit camera does not give black frames and brightness does not flicker from frame to frame.
#[derive(Debug, Default)]
pub struct GrayDecoder {
    bits: Option<u32>,
}

impl GrayDecoder {
    /// Decodes the bytes of a file to a single 8-bit channel.
    ///
    /// # Errors
    /// [`DecodeError`] for anything but a whole image.
    pub fn decode(&mut self, bytes: &[u8]) -> Result<Mat, DecodeError> {
        check_whole(bytes)?;
        let buffer = Mat::from_slice(bytes)?;
        let not_an_image = || DecodeError::NotAnImage { start: readable_start(bytes) };
        let mat = imdecode(&buffer, IMREAD_GRAYSCALE | IMREAD_ANYDEPTH).map_err(|_| not_an_image())?;
        if mat.empty() {
            return Err(not_an_image());
        }
        match mat.depth() {
            CV_8U => Ok(mat),
            CV_16U => self.scale_to_8_bit(&mat),
            depth => Err(DecodeError::Depth { depth }),
        }
    }

    fn scale_to_8_bit(&mut self, mat: &Mat) -> Result<Mat, DecodeError> {
        let bits = if let Some(bits) = self.bits {
            bits
        } else {
            let mut largest = 0.0;
            min_max_loc(mat, None, Some(&mut largest), None, None, &opencv::core::no_array())?;
            *self.bits.insert([10, 12, 14].into_iter().find(|&b| largest < f64::from(1u32 << b)).unwrap_or(16))
        };
        let mut out = Mat::default();
        mat.convert_to(&mut out, CV_8UC1, 255.0 / f64::from((1u32 << bits) - 1), 0.0)?;
        Ok(out)
    }
}

/// Finds files that end before their image does, where the format tells.
pub(super) fn check_whole(bytes: &[u8]) -> Result<(), DecodeError> {
    /// A JPEG may carry some padding behind its end marker.
    const JPEG_TAIL: usize = 4096;
    let truncated = |format, reason: String| Err(DecodeError::Truncated { format, reason });
    if bytes.is_empty() {
        return Err(DecodeError::Empty);
    }
    if bytes.starts_with(&[0xFF, 0xD8, 0xFF]) {
        let tail = &bytes[bytes.len().saturating_sub(JPEG_TAIL)..];
        if !tail.windows(2).any(|w| w == [0xFF, 0xD9]) {
            return truncated("JPEG", "it has no end marker".to_owned());
        }
    } else if bytes.starts_with(b"\x89PNG") {
        if !bytes.windows(4).rev().take(JPEG_TAIL).any(|w| w == b"IEND") {
            return truncated("PNG", "it has no end chunk".to_owned());
        }
    } else if bytes.starts_with(b"BM") && bytes.len() >= 6 {
        let stated = u32::from_le_bytes([bytes[2], bytes[3], bytes[4], bytes[5]]) as usize;
        if bytes.len() < stated {
            return truncated("BMP", format!("{} of {stated} bytes", bytes.len()));
        }
    } else if bytes.starts_with(b"P5")
        && let Some((header, pixels)) = pgm_sizes(bytes)
        && bytes.len() < header.saturating_add(pixels)
    {
        return truncated("PGM", format!("{} of {pixels} bytes of pixels", bytes.len().saturating_sub(header)));
    }
    Ok(())
}

/// Bytes of header and of pixels that a binary PGM states.
fn pgm_sizes(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut numbers = Vec::with_capacity(3);
    let mut at = 2;
    while numbers.len() < 3 {
        match *bytes.get(at)? {
            b'#' => at += bytes[at..].iter().position(|&b| b == b'\n')?,
            b if b.is_ascii_whitespace() => at += 1,
            b if b.is_ascii_digit() => {
                let digits = bytes[at..].iter().take_while(|b| b.is_ascii_digit()).count();
                numbers.push(std::str::from_utf8(&bytes[at..at + digits]).ok()?.parse::<usize>().ok()?);
                at += digits;
            }
            _ => return None,
        }
    }
    let sample = if numbers[2] > 255 { 2 } else { 1 };
    Some((at + 1, numbers[0].checked_mul(numbers[1])?.checked_mul(sample)?))
}

/// The first bytes of a file as text where they are text, in hexadecimal where not.
pub(super) fn readable_start(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(12)];
    if start.iter().all(|b| b.is_ascii_graphic() || b.is_ascii_whitespace()) {
        format!("the text {:?}", String::from_utf8_lossy(start))
    } else {
        let hex: Vec<String> = start.iter().map(|b| format!("{b:02x}")).collect();
        format!("the bytes {}", hex.join(" "))
    }
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
        let mat = GrayDecoder::default().decode(&png_8(5, 3)).unwrap();
        assert_eq!((mat.cols(), mat.rows()), (5, 3));
        assert_eq!(mat.data_typed::<u8>().unwrap()[..4], [0, 7, 14, 21]);
    }

    #[test]
    fn sixteen_bit_images_use_the_range_of_the_first() {
        let mut decoder = GrayDecoder::default();
        // 4095 uses 12 bits: it becomes 255; half of it, 2047, becomes 127.47, rounded 127.
        let mat = decoder.decode(&png_16(4095)).unwrap();
        assert_eq!(mat.data_typed::<u8>().unwrap(), [255, 127, 0, 255]);
        // The second image keeps the 12-bit scale: 1000 * 255 / 4095 = 62.27.
        let mat = decoder.decode(&png_16(1000)).unwrap();
        assert_eq!(mat.data_typed::<u8>().unwrap(), [62, 31, 0, 62]);
    }

    #[test]
    fn damaged_files_are_named_for_what_they_are() {
        let message = |bytes: &[u8]| GrayDecoder::default().decode(bytes).unwrap_err().to_string();
        assert_eq!(message(b""), "the file is empty");
        let png = png_8(64, 64);
        assert!(message(&png[..png.len() / 2]).contains("PNG image is cut off"));
        assert!(message(b"hello, I am text").contains("the text \"hello, I am \""));
        assert!(message(&[0xFF, 0xD8, 0xFF, 0xE0, 1, 2]).contains("JPEG image is cut off"));
        assert!(message(b"P5\n# made by hand\n4 4\n255\n123").contains("3 of 16 bytes of pixels"));
        assert!(message(b"P5 2 2 255").contains("0 of 4 bytes of pixels"));
        assert!(message(b"BM\xff\x00\x00\x00rest").contains("BMP image is cut off"));
        assert!(message(b"P5 99999999999999999999 4 255 ").contains("not an image"));
    }
}
