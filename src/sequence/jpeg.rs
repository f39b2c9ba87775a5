//! Decodes JPEG files and rejects incomplete ones.
//!
//! Decoders fill missing data of a JPEG file with grey and report success. An end marker alone proves nothing: it may belong to a
//! thumbnail, or follow incomplete data. The segments are therefore checked first: before the end marker, every component must have had all
//! its scans. Then 64 one bits are inserted before the end marker. No Huffman code consists of ones only, so a decoder that needs more data
//! fails, and one that has all blocks never reads them.

use image::{DynamicImage, GrayImage, RgbImage, metadata::Orientation};
use zune_jpeg::{
    JpegDecoder,
    zune_core::{bytestream::ZCursor, colorspace::ColorSpace, options::DecoderOptions},
};

use super::{
    decode::DecodeError,
    limit::check_size,
    still::{Wanted, share_text},
};

const FORMAT: &str = "JPEG";

/// Ones that no Huffman code begins with: 64 bits, each byte followed by a stuffed zero as JPEG requires.
const SENTINEL: [u8; 16] = [0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0, 0xFF, 0];

fn truncated<T>(reason: impl Into<String>) -> Result<T, DecodeError> {
    Err(DecodeError::Truncated { format: FORMAT, reason: reason.into() })
}

fn damaged(reason: impl std::fmt::Display) -> DecodeError {
    DecodeError::Damaged { format: FORMAT, reason: reason.to_string() }
}

/// Decodes a complete file: as its luma channel if grey is wanted, otherwise as stored.
pub fn decode(bytes: &[u8], wanted: Wanted) -> Result<DynamicImage, DecodeError> {
    let walk = Walk::over(bytes)?;
    let (width, height) = walk.size;
    check_size(width.into(), height.into())?;
    let end = walk.whole()?;
    let data = [&bytes[..end], SENTINEL.as_slice(), &[0xFF, 0xD9]].concat();
    let decoder = || -> Result<_, DecodeError> {
        let options = DecoderOptions::default()
            .set_strict_mode(true)
            .set_max_width(usize::from(width).max(1))
            .set_max_height(usize::from(height).max(1));
        let mut decoder = JpegDecoder::new_with_options(ZCursor::new(data.as_slice()), options);
        decoder.decode_headers().map_err(damaged)?;
        let out = match (decoder.input_colorspace(), wanted) {
            (Some(ColorSpace::Luma), _) | (Some(ColorSpace::YCbCr), Wanted::Grey) => ColorSpace::Luma,
            _ => ColorSpace::RGB,
        };
        decoder.set_options(options.jpeg_set_out_colorspace(out));
        Ok((decoder, out))
    };
    let (mut first, space) = decoder()?;
    let length = usize::from(width) * usize::from(height) * space.num_components();
    if first.output_buffer_size() != Some(length) {
        return Err(damaged("the header contradicts itself"));
    }
    let mut pixels = vec![0; length];
    if let Err(error) = first.decode_into(&mut pixels) {
        // Rows that are equal in two attempts with different initial memory were decoded.
        let mut again = vec![255; length];
        let _ = decoder()?.0.decode_into(&mut again);
        let row = usize::from(width) * space.num_components();
        let filler = |row: &[u8]| row.iter().all(|b| *b == 128);
        let same = pixels.chunks_exact(row).zip(again.chunks_exact(row)).take_while(|(a, b)| a == b && !filler(a)).count();
        return truncated(format!("{} of its rows ({error})", share_text(same, height.into())));
    }
    let orientation = first.exif().and_then(|chunk| Orientation::from_exif_chunk(chunk)).unwrap_or(Orientation::NoTransforms);
    let (width, height) = (width.into(), height.into());
    let image = match space {
        ColorSpace::Luma => GrayImage::from_raw(width, height, pixels).map(DynamicImage::from),
        _ => RgbImage::from_raw(width, height, pixels).map(DynamicImage::from),
    };
    let mut image = image.ok_or_else(|| damaged("the header contradicts itself"))?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// Content of a file's segments.
struct Walk {
    size: (u16, u16),
    progressive: bool,
    /// Component numbers, each with the missing bits of its 64 coefficients; 255 for coefficients that were not sent.
    components: Vec<(u8, [u8; 64])>,
    /// Offset of the end marker.
    end: Option<usize>,
}

impl Walk {
    fn over(bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut walk = Self { size: (0, 0), progressive: false, components: Vec::new(), end: None };
        let mut at = 2;
        while let Some(marker) = next_marker(bytes, &mut at) {
            match marker {
                0xD9 => {
                    walk.end = Some(at - 2);
                    break;
                }
                // Start of image, restart and temporary markers have no length.
                0xD8 | 0xD0..=0xD7 | 0x01 => continue,
                _ => {}
            }
            let Some(length) = bytes.get(at..at + 2).map(|b| usize::from(u16::from_be_bytes([b[0], b[1]]))) else { break };
            let Some(segment) = bytes.get(at + 2..at + length.max(2)) else { break };
            at += length.max(2);
            match marker {
                0xC0..=0xC2 => walk.frame(segment, marker == 0xC2),
                0xC4 | 0xC8 | 0xCC => {}
                0xC3 | 0xC5..=0xCF => {
                    let found = "lossless, arithmetic or hierarchical coding".to_owned();
                    return Err(DecodeError::Unsupported { format: FORMAT, found, supported: "baseline and progressive coding" });
                }
                0xDA => walk.scan(segment),
                _ => {}
            }
        }
        if walk.size.0 == 0 || walk.size.1 == 0 || walk.components.is_empty() {
            return match walk.end {
                Some(_) => Err(damaged("it does not state its size")),
                None => truncated("its data end before the size of the picture"),
            };
        }
        Ok(walk)
    }

    /// A frame header: precision, height, width, and components of three bytes each.
    fn frame(&mut self, segment: &[u8], progressive: bool) {
        let [_, h1, h2, w1, w2, count, components @ ..] = segment else { return };
        self.size = (u16::from_be_bytes([*w1, *w2]), u16::from_be_bytes([*h1, *h2]));
        self.progressive = progressive;
        self.components = components.chunks_exact(3).take(usize::from(*count)).map(|c| (c[0], [255; 64])).collect();
    }

    /// A scan header: components of two bytes each, first and last coefficient, and the number of missing bits before and after the scan.
    fn scan(&mut self, segment: &[u8]) {
        let Some((&count, rest)) = segment.split_first() else { return };
        let (components, rest) = rest.split_at(rest.len().min(2 * usize::from(count)));
        let (first, last, low) = match (rest, self.progressive) {
            ([first, last, bits, ..], true) => (usize::from(*first), usize::from(*last).min(63), bits & 15),
            _ => (0, 63, 0),
        };
        for component in components.chunks_exact(2) {
            let found = self.components.iter_mut().find(|(number, _)| *number == component[0]);
            if let Some(missing) = found.and_then(|(_, bits)| bits.get_mut(first..=last)) {
                missing.fill(low);
            }
        }
    }

    /// Offset of the end marker, if every component was sent completely before it.
    fn whole(&self) -> Result<usize, DecodeError> {
        let there = self.components.iter().flat_map(|(_, bits)| bits).filter(|bits| **bits == 0).count();
        let all = self.components.len() * 64;
        if there < all {
            return truncated(format!("{} of its coefficients had a scan", share_text(there, all)));
        }
        self.end.map_or_else(|| truncated("it has no end marker"), Ok)
    }
}

/// The next marker at or after an offset, which moves beyond it. Entropy-coded data in between are skipped.
fn next_marker(bytes: &[u8], at: &mut usize) -> Option<u8> {
    loop {
        *at += memchr::memchr(0xFF, bytes.get(*at..)?)?;
        let mut code = *at + 1;
        // Any number of fill bytes may precede a marker.
        while *bytes.get(code)? == 0xFF {
            code += 1;
        }
        *at = code + 1;
        // A byte followed by a stuffed zero is data; restart markers belong to the data.
        if bytes[code] != 0 && !(0xD0..=0xD7).contains(&bytes[code]) {
            return Some(bytes[code]);
        }
    }
}
