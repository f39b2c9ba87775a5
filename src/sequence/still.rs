//! Decodes the bytes of one image file. The format is detected from the content; too large and incomplete files are rejected.

use std::io::Cursor;

use image::{
    DynamicImage, ExtendedColorType, GrayImage, ImageDecoder, ImageError, Limits,
    codecs::{bmp::BmpDecoder, png::PngDecoder, pnm::PnmDecoder, tiff::TiffDecoder, webp::WebPDecoder},
    error::{UnsupportedError, UnsupportedErrorKind},
    metadata::Orientation,
};

use super::{
    decode::{DecodeError, add_greys},
    jpeg,
    limit::{check_size, max_pixels},
};

/// Purpose of the pixels. A JPEG file stores its grey picture separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    Grey,
    Colour,
}

/// Decodes a complete image with its stored channels and bits, rotated upright by its EXIF data.
pub fn decode(bytes: &[u8], wanted: Wanted) -> Result<DynamicImage, DecodeError> {
    match bytes {
        [] => Err(DecodeError::Empty),
        _ if is_jpeg(bytes) => jpeg::decode(bytes, wanted),
        [0x89, b'P', b'N', b'G', ..] => {
            if wanted == Wanted::Grey
                && let Some(grey) = grey_of_png(bytes)
            {
                return cut_png_tail(bytes).map_or(Ok(grey.into()), Err);
            }
            let decoded = open(PngDecoder::new(Cursor::new(bytes)), "PNG").and_then(|decoder| read(decoder, "PNG"));
            let image = decoded.map_err(|error| match error {
                DecodeError::Damaged { .. } | DecodeError::Truncated { .. } => cut_png(bytes).unwrap_or(error),
                other => other,
            })?;
            cut_png_tail(bytes).map_or(Ok(image), Err)
        }
        [b'B', b'M', ..] => {
            whole(bytes, "BMP", bmp_length(bytes))?;
            read(open(BmpDecoder::new(Cursor::new(bytes)), "BMP")?, "BMP")
        }
        [b'P', b'1'..=b'7', ..] => {
            let name = if matches!(bytes[1], b'3' | b'6') { "PPM" } else { "PGM" };
            if matches!(bytes[1], b'5' | b'6')
                && let Some((header, pixels)) = pnm_sizes(bytes)
                && bytes.len() < header.saturating_add(pixels)
            {
                let there = bytes.len().saturating_sub(header);
                return truncated(name, format!("{there} of {pixels} bytes of pixels, {}", share_text(there, pixels)));
            }
            read(open(PnmDecoder::new(Cursor::new(bytes)), name)?, name)
        }
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] => {
            let decoded = open(TiffDecoder::new(Cursor::new(bytes)), "TIFF").and_then(|decoder| read(decoder, "TIFF"));
            decoded.map_err(|error| match tiff_length(bytes) {
                Some(length) if length > bytes.len() as u64 => cut_off("TIFF", bytes.len(), length),
                _ => error,
            })
        }
        [b'R', b'I', b'F', b'F', a, b, c, d, b'W', b'E', b'B', b'P', ..] => {
            whole(bytes, "WebP", Some(u64::from(u32::from_le_bytes([*a, *b, *c, *d])) + 8))?;
            read(open(WebPDecoder::new(Cursor::new(bytes)), "WebP")?, "WebP")
        }
        _ => Err(DecodeError::NotAnImage { start: readable_start(bytes) }),
    }
}

/// Whether the bytes begin like a JPEG file.
pub fn is_jpeg(bytes: &[u8]) -> bool {
    bytes.starts_with(&[0xFF, 0xD8, 0xFF])
}

/// Decodes a PNG file in plain colours to grey, row by row, so that the colours are never in memory. Returns `None` for other files and for
/// failures; the general decoder reports the error.
fn grey_of_png(bytes: &[u8]) -> Option<GrayImage> {
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().ok()?;
    let info = reader.info();
    let is_colour = (info.color_type, info.bit_depth) == (png::ColorType::Rgb, png::BitDepth::Eight) && info.trns.is_none();
    let is_plain = !info.interlaced && info.exif_metadata.is_none() && info.animation_control.is_none();
    let (width, height) = info.size();
    if !is_colour || !is_plain || check_size(width, height).is_err() {
        return None;
    }
    let mut values = Vec::with_capacity(width as usize * height as usize);
    while let Some(row) = reader.next_row().ok()? {
        add_greys(row.data(), &mut values);
    }
    GrayImage::from_raw(width, height, values)
}

fn open<D>(decoder: Result<D, ImageError>, format: &'static str) -> Result<D, DecodeError> {
    decoder.map_err(|error| failure(error, format))
}

fn failure(error: ImageError, format: &'static str) -> DecodeError {
    match error {
        ImageError::Unsupported(what) => {
            DecodeError::Unsupported { format, found: unsupported(&what), supported: "grey and colour of 8 and 16 bits" }
        }
        ImageError::IoError(cut) if cut.kind() == std::io::ErrorKind::UnexpectedEof => {
            DecodeError::Truncated { format, reason: "its data end early".to_owned() }
        }
        other => DecodeError::Damaged { format, reason: other.to_string() },
    }
}

/// Description of an unsupported property of a picture, as a continuation of `has`.
fn unsupported(what: &UnsupportedError) -> String {
    let text = match what.kind() {
        UnsupportedErrorKind::Color(ExtendedColorType::Unknown(bits)) => {
            return format!("pixels of {bits} bits that are no integers of 8 or 16 bits");
        }
        UnsupportedErrorKind::Color(colour) => return format!("pixels of the kind {colour:?}"),
        UnsupportedErrorKind::GenericFeature(text) => text,
        other => return format!("a form that is not read ({other:?})"),
    };
    if text.contains("RGBPalette") {
        return "a palette".to_owned();
    }
    format!("a feature that is not read ({text})")
}

/// Decodes the picture after its header was read.
fn read(mut decoder: impl ImageDecoder, format: &'static str) -> Result<DynamicImage, DecodeError> {
    let (width, height) = decoder.dimensions();
    check_size(width, height)?;
    let mut limits = Limits::no_limits();
    // Twice the largest pixel, 16 bits of each of four channels: decoders hold the picture and parts of it.
    limits.max_alloc = Some(max_pixels().saturating_mul(16).max(1 << 26));
    decoder.set_limits(limits).map_err(|error| failure(error, format))?;
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|error| failure(error, format))?;
    image.apply_orientation(orientation);
    Ok(image)
}

fn truncated<T>(format: &'static str, reason: String) -> Result<T, DecodeError> {
    Err(DecodeError::Truncated { format, reason })
}

fn cut_off(format: &'static str, there: usize, stated: u64) -> DecodeError {
    let share = share_text(there, usize::try_from(stated).unwrap_or(usize::MAX));
    DecodeError::Truncated { format, reason: format!("{there} of {stated} bytes, {share}") }
}

fn whole(bytes: &[u8], format: &'static str, stated: Option<u64>) -> Result<(), DecodeError> {
    match stated {
        Some(stated) if stated > bytes.len() as u64 => Err(cut_off(format, bytes.len(), stated)),
        _ => Ok(()),
    }
}

/// A share as text, rounded down: `41 %`.
pub(super) fn share_text(part: usize, all: usize) -> String {
    format!("{} %", (part as f64 / all.max(1) as f64 * 100.0).floor())
}

/// Number of rows in an incomplete PNG file.
fn cut_png(bytes: &[u8]) -> Option<DecodeError> {
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.ignore_checksums(true);
    let mut reader = match decoder.read_info() {
        Ok(reader) => reader,
        Err(png::DecodingError::IoError(_)) => {
            return Some(DecodeError::Truncated { format: "PNG", reason: "its data end before the pixels".to_owned() });
        }
        Err(_) => return None,
    };
    let (mut rows, interlaced, height) = (0, reader.info().interlaced, reader.info().height);
    loop {
        match reader.next_row() {
            Ok(Some(_)) => rows += 1,
            // Rows of an interlaced picture are not rows of the final picture.
            Err(_) if interlaced => {
                return Some(DecodeError::Truncated { format: "PNG", reason: "its data end before the last row".to_owned() });
            }
            Err(png::DecodingError::IoError(_)) => {
                let reason = format!("{} of its rows", share_text(rows, height as usize));
                return Some(DecodeError::Truncated { format: "PNG", reason });
            }
            Ok(None) | Err(_) => return None,
        }
    }
}

/// Error for a PNG file with all pixels but without its end chunk.
fn cut_png_tail(bytes: &[u8]) -> Option<DecodeError> {
    /// Largest number of bytes appended by other programs.
    const TAIL: usize = 4096;
    let found = bytes.windows(4).rev().take(TAIL).any(|w| w == b"IEND");
    (!found).then(|| DecodeError::Truncated { format: "PNG", reason: "it has no end chunk".to_owned() })
}

/// File length stated in the header of a BMP file.
fn bmp_length(bytes: &[u8]) -> Option<u64> {
    bytes.get(2..6).map(|b| u64::from(u32::from_le_bytes([b[0], b[1], b[2], b[3]])))
}

/// Bytes of header and of pixels stated in a binary PGM or PPM file.
fn pnm_sizes(bytes: &[u8]) -> Option<(usize, usize)> {
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
    let samples = if bytes[1] == b'6' { 3 } else { 1 };
    let sample = if numbers[2] > 255 { 2 } else { 1 };
    Some((at + 1, numbers[0].checked_mul(numbers[1])?.checked_mul(sample * samples)?))
}

/// End of the last strip or tile of the first picture in a TIFF file, or the offset of its directory if that lies beyond the file.
fn tiff_length(bytes: &[u8]) -> Option<u64> {
    let little = bytes.first() == Some(&b'I');
    let number = |at: usize, size: usize| -> Option<u64> {
        let field = bytes.get(at..at.checked_add(size)?)?;
        let value = |sum: u64, byte: &u8| sum << 8 | u64::from(*byte);
        Some(if little { field.iter().rev().fold(0, value) } else { field.iter().fold(0, value) })
    };
    let directory = number(4, 4)?;
    let at = usize::try_from(directory).ok()?;
    let Some(count) = number(at, 2) else { return Some(directory + 2) };
    let entries = (0..count as usize).map(|k| at + 2 + 12 * k);
    // A field: tag, type (3: 16 bits, 4: 32), count, and the values themselves or their offset.
    let values = |tags: [u64; 2]| -> Option<Vec<u64>> {
        let entry = entries.clone().find(|&e| number(e, 2).is_some_and(|tag| tags.contains(&tag)))?;
        let size = if number(entry + 2, 2)? == 3 { 2 } else { 4 };
        let count = usize::try_from(number(entry + 4, 4)?).ok()?.min(bytes.len());
        let start = if count * size <= 4 { entry + 8 } else { usize::try_from(number(entry + 8, 4)?).ok()? };
        (0..count).map(|k| number(start + size * k, size)).collect()
    };
    // Strips, or tiles.
    let ends = values([273, 324])?.into_iter().zip(values([279, 325])?).map(|(offset, length)| offset + length);
    ends.max()
}

/// Names of formats that are not read, by the brand of their header.
const OTHER_FORMATS: [(&[u8], &str); 5] = [
    (b"heic", "HEIC picture"),
    (b"heix", "HEIC picture"),
    (b"mif1", "HEIC picture"),
    (b"hevc", "HEIC picture"),
    (b"avif", "AVIF picture"),
];

/// The first bytes of a file: the format that they name, or as text, or in hexadecimal if they are not text.
pub(super) fn readable_start(bytes: &[u8]) -> String {
    if bytes.get(4..8) == Some(b"ftyp")
        && let Some((_, name)) = OTHER_FORMATS.iter().find(|(brand, _)| bytes.get(8..12) == Some(brand))
    {
        return format!("the header of a {name}; convert it to JPEG or PNG");
    }
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
    use image::{ExtendedColorType, ImageBuffer, ImageFormat, Luma};

    use super::*;

    #[test]
    fn the_start_of_a_foreign_file_is_named() {
        assert_eq!(readable_start(b"\0\0\0\x18ftypheic\0\0"), "the header of a HEIC picture; convert it to JPEG or PNG");
        assert_eq!(readable_start(b"GIF89a"), "the text \"GIF89a\"");
        assert_eq!(readable_start(b"\0\x01"), "the bytes 00 01");
    }

    fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
        let mut bytes = Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn the_decoded_part_is_reported() {
        let reason = |bytes: &[u8]| decode(bytes, Wanted::Grey).unwrap_err().to_string();
        // Uncompressed rows would be exact; random ones compress to about their share.
        let noise: Vec<u8> = (0..64 * 64_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
        let mut png = Vec::new();
        let encoder = image::codecs::png::PngEncoder::new(&mut png);
        image::ImageEncoder::write_image(encoder, &noise, 64, 64, ExtendedColorType::L8).unwrap();
        let message = reason(&png[..png.len() / 2]);
        assert!(message == "the PNG image is cut off: 48 % of its rows" || message.ends_with("49 % of its rows"), "{message}");
        assert!(reason(b"P5\n4 4\n255\n123").ends_with("3 of 16 bytes of pixels, 18 %"));
        assert!(reason(b"P6 4 4 255\n123").ends_with("3 of 48 bytes of pixels, 6 %"));
    }

    /// A TIFF file of 2 x 2 pixels of `bits` bits, with further tags.
    fn tiff(bits: u16, tags: &[(u16, u16)], color_map: bool) -> Vec<u8> {
        let mut entries: Vec<(u16, u16, u32, u32)> =
            vec![(256, 3, 1, 2), (257, 3, 1, 2), (258, 3, 1, bits.into()), (259, 3, 1, 1), (277, 3, 1, 1), (278, 3, 1, 2)];
        entries.extend(tags.iter().map(|&(tag, value)| (tag, 3, 1, value.into())));
        let strip = 8 + 2 + 12 * (entries.len() as u32 + 2 + u32::from(color_map)) + 4;
        let length = 4 * u32::from(bits) / 8;
        entries.extend([(273, 4, 1, strip), (279, 4, 1, length)]);
        entries.extend(color_map.then_some((320, 3, 768, strip + length)));
        entries.sort_unstable();
        let mut file = b"II*\0\x08\0\0\0".to_vec();
        file.extend((entries.len() as u16).to_le_bytes());
        for (tag, kind, count, value) in entries {
            file.extend([tag.to_le_bytes(), kind.to_le_bytes()].concat());
            file.extend([count.to_le_bytes(), value.to_le_bytes()].concat());
        }
        file.resize(strip as usize + length as usize + if color_map { 2 * 768 } else { 0 }, 0);
        file
    }

    #[test]
    fn tiff_files_that_are_not_read_say_plainly_why() {
        let error = |bytes: &[u8]| decode(bytes, Wanted::Grey).unwrap_err().to_string();
        assert!(decode(&tiff(8, &[(262, 1)], false), Wanted::Grey).is_ok());
        let palette = error(&tiff(8, &[(262, 3)], true));
        assert_eq!(palette, "the TIFF image has a palette; grey and colour of 8 and 16 bits are supported");
        let float = error(&tiff(32, &[(262, 1), (339, 3)], false));
        assert!(float.starts_with("the TIFF image has pixels of"), "{float}");
    }

    #[test]
    fn a_size_beyond_the_limit_is_refused_by_the_header() {
        // The header of a PNG file of 32000 x 32000 pixels and nothing else.
        let mut header = b"IHDR".to_vec();
        header.extend(32_000_u32.to_be_bytes().repeat(2));
        header.extend([8, 0, 0, 0, 0]);
        let mut png = b"\x89PNG\r\n\x1a\n\0\0\0\r".to_vec();
        png.extend(&header);
        png.extend(crc(&header).to_be_bytes());
        png.extend(b"\0\0\0\x00IDAT");
        png.extend(crc(b"IDAT").to_be_bytes());
        let message = decode(&png, Wanted::Grey).unwrap_err().to_string();
        assert_eq!(
            message,
            "the picture is 32000x32000, 1024 megapixels, above the limit of 128; raise the limit with --max-pixels"
        );
        let pgm = b"P5 65535 65535 255\n".to_vec();
        assert!(matches!(decode(&[pgm, vec![0; 10]].concat(), Wanted::Grey), Err(DecodeError::Truncated { .. })));
    }

    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |crc, byte| {
            (0..8).fold(crc ^ u32::from(*byte), |c, _| if c & 1 == 1 { c >> 1 ^ 0xEDB8_8320 } else { c >> 1 })
        })
    }

    #[test]
    fn pictures_stand_upright_as_their_exif_data_say() {
        // Orientation 6: the first row is the right side. 3 x 2 pixels become 2 x 3; the top-left pixel comes from the bottom left.
        let exif = [b"II*\0\x08\0\0\0\x01\0\x12\x01\x03\0\x01\0\0\0\x06\0\0\0".as_slice(), &[0; 4]].concat();
        let pixels = [10_u8, 20, 30, 40, 50, 60];
        let mut bytes = Vec::new();
        let mut info = png::Info::with_size(3, 2);
        info.color_type = png::ColorType::Grayscale;
        info.exif_metadata = Some(exif.into());
        let mut writer = png::Encoder::with_info(&mut bytes, info).unwrap().write_header().unwrap();
        writer.write_image_data(&pixels).unwrap();
        writer.finish().unwrap();
        let image = decode(&bytes, Wanted::Grey).unwrap().into_luma8();
        assert_eq!((image.dimensions(), image.get_pixel(0, 0).0[0], image.get_pixel(1, 0).0[0]), ((2, 3), 40, 10));
    }

    #[test]
    fn colours_become_grey_row_by_row_as_they_do_as_a_whole() {
        let colours = image::RgbImage::from_fn(37, 11, |x, y| image::Rgb([(x * 7) as u8, (y * 23) as u8, (x * y) as u8]));
        let png = encoded(&colours.clone().into(), ImageFormat::Png);
        let expected = super::super::decode::grey_of(&colours);
        assert_eq!(grey_of_png(&png).unwrap(), expected);
        assert_eq!(decode(&png, Wanted::Grey).unwrap(), DynamicImage::ImageLuma8(expected));
        assert_eq!(decode(&png, Wanted::Colour).unwrap(), DynamicImage::ImageRgb8(colours));
        // Truncated anywhere, it is rejected.
        assert!((0..png.len() - 12).step_by(7).all(|end| decode(&png[..end], Wanted::Grey).is_err()));
    }

    #[test]
    fn deep_pictures_keep_their_bits() {
        let deep = ImageBuffer::from_fn(5, 4, |x, y| Luma([(x * 700 + y * 200) as u16]));
        for format in [ImageFormat::Png, ImageFormat::Tiff] {
            let image = decode(&encoded(&DynamicImage::ImageLuma16(deep.clone()), format), Wanted::Grey).unwrap();
            assert_eq!(image.into_luma16(), deep, "{format:?}");
        }
    }
}
