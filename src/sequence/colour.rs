//! Pictures in colour: the target of cloning, and source frames whose wrinkles and teeth are carried over.

use std::path::Path;

use image::{DynamicImage, GrayImage, ImageBuffer, Rgb, RgbImage, RgbaImage};

use super::{
    DecodeError, SequenceError,
    decode::{bits_of, other_pixels},
    still::{Wanted, decode},
    video::{Next, Stream},
};
use crate::{
    companion::wire::Pixels,
    dataset::{FrameFile, FrameSource},
};

/// Largest side of a picture, px: what an 8k camera gives, with room.
pub const MAX_SIDE: u32 = 16_384;

/// Reads an image file in colour, upright as its EXIF data says, 16-bit channels scaled by the bits they use, transparent pixels laid
/// on white.
///
/// # Errors
/// [`SequenceError::Decode`] when it is not a whole image.
pub fn read_colour(path: &Path) -> Result<RgbImage, SequenceError> {
    let decoded = crate::input::read(path).map_err(DecodeError::from).and_then(|bytes| decode_colour(&bytes));
    decoded.map_err(|source| SequenceError::Decode { path: path.to_owned(), source })
}

/// The colour frames of a sequence with their numbers, at most `wanted` of them held by the caller's choice of numbers.
///
/// # Errors
/// [`SequenceError`] when a frame does not read, or the video ends before the last number.
pub fn read_colour_frames(source: &FrameSource, wanted: &[u32]) -> Result<Vec<(u32, RgbImage)>, SequenceError> {
    match source {
        FrameSource::Images(files) => files
            .iter()
            .filter(|file| wanted.contains(&file.number))
            .map(|file| Ok((file.number, read_colour(&file.path)?)))
            .collect(),
        FrameSource::Video { path, .. } => {
            let error = |reason: &str| SequenceError::Video { path: path.clone(), reason: reason.to_owned() };
            let first = wanted.iter().copied().min().unwrap_or(1).max(1);
            let mut stream = Stream::open(path, true, first)?;
            let mut frames = Vec::new();
            for number in first..=wanted.iter().copied().max().unwrap_or(0) {
                let Next::Frame(Pixels { width, height, data, .. }) = stream.next()? else {
                    return Err(error("ends before the last frame of the track"));
                };
                if wanted.contains(&number) {
                    frames.push((number, RgbImage::from_raw(width, height, data).unwrap_or_default()));
                }
            }
            Ok(frames)
        }
    }
}

/// Gives all frames of a sequence in colour, one after the other, with their numbers.
pub struct ColourReader(Colours);

enum Colours {
    Images(std::vec::IntoIter<FrameFile>),
    Video { stream: Box<Stream>, next: u32, ended: bool },
}

impl ColourReader {
    /// Opens a sequence.
    ///
    /// # Errors
    /// [`SequenceError`] for a video that does not open.
    pub fn open(source: &FrameSource) -> Result<Self, SequenceError> {
        Ok(Self(match source {
            FrameSource::Images(files) => Colours::Images(files.clone().into_iter()),
            FrameSource::Video { path, first, .. } => {
                let first = first.unwrap_or(1).max(1);
                Colours::Video { stream: Box::new(Stream::open(path, true, first)?), next: first, ended: false }
            }
        }))
    }
}

impl Iterator for ColourReader {
    type Item = Result<(u32, RgbImage), SequenceError>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.0 {
            Colours::Images(files) => {
                let FrameFile { number, path } = files.next()?;
                Some(read_colour(&path).map(|image| (number, image)))
            }
            Colours::Video { ended: true, .. } => None,
            Colours::Video { stream, next, ended } => match stream.next() {
                Ok(Next::Frame(Pixels { width, height, data, .. })) => {
                    let number = *next;
                    *next += 1;
                    Some(Ok((number, RgbImage::from_raw(width, height, data).unwrap_or_default())))
                }
                Ok(Next::End(_)) => {
                    *ended = true;
                    None
                }
                Err(error) => {
                    *ended = true;
                    Some(Err(error))
                }
            },
        }
    }
}

/// A grey picture in colour: three equal channels. The conversion of `image` goes through floats for that.
pub fn colour_of(image: &GrayImage) -> RgbImage {
    let values = image.as_raw().iter().flat_map(|&v| [v; 3]).collect();
    RgbImage::from_raw(image.width(), image.height(), values).unwrap_or_default()
}

fn decode_colour(bytes: &[u8]) -> Result<RgbImage, DecodeError> {
    let image = decode(bytes, Wanted::Colour)?;
    match image {
        DynamicImage::ImageRgb8(image) => Ok(image),
        DynamicImage::ImageLuma8(image) => Ok(colour_of(&image)),
        DynamicImage::ImageLumaA8(_) | DynamicImage::ImageRgba8(_) => Ok(on_white(&image.into_rgba8())),
        DynamicImage::ImageLuma16(_) | DynamicImage::ImageRgb16(_) => Ok(narrow(&image.into_rgb16())),
        DynamicImage::ImageLumaA16(_) | DynamicImage::ImageRgba16(_) => {
            let deep = image.into_rgba16();
            let mut narrow = narrow(&DynamicImage::from(deep.clone()).into_rgb16());
            for (pixel, from) in narrow.pixels_mut().zip(deep.pixels()) {
                pixel.0 = over_white(pixel.0, f64::from(from.0[3]) / 65_535.0);
            }
            Ok(narrow)
        }
        other => Err(other_pixels(&other)),
    }
}

/// 16-bit channels to 8 by the bits that the picture uses.
fn narrow(image: &ImageBuffer<Rgb<u16>, Vec<u16>>) -> RgbImage {
    let bits = bits_of(image.as_raw().iter().copied().max().unwrap_or(0));
    let scale = 255.0 / f64::from((1_u32 << bits) - 1);
    let values = image.as_raw().iter().map(|&v| (f64::from(v) * scale).round().min(255.0) as u8).collect();
    RgbImage::from_raw(image.width(), image.height(), values).unwrap_or_default()
}

fn on_white(image: &RgbaImage) -> RgbImage {
    RgbImage::from_fn(image.width(), image.height(), |x, y| {
        let [r, g, b, alpha] = image.get_pixel(x, y).0;
        Rgb(over_white([r, g, b], f64::from(alpha) / 255.0))
    })
}

fn over_white(colour: [u8; 3], share: f64) -> [u8; 3] {
    if share < 1.0 { colour.map(|c| (255.0 + (f64::from(c) - 255.0) * share).round() as u8) } else { colour }
}

#[cfg(test)]
mod tests {
    use image::ImageFormat;

    use super::*;

    fn png(image: impl Into<DynamicImage>) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.into().write_to(&mut bytes, ImageFormat::Png).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn colours_keep_their_order() {
        let image = RgbImage::from_pixel(3, 2, image::Rgb([10, 20, 30]));
        assert_eq!(decode_colour(&png(image.clone())).unwrap(), image);
    }

    #[test]
    fn sixteen_bits_are_scaled_by_the_bits_in_use() {
        // 1023 uses 10 bits: 1023 -> 255, 512 -> 127.6 -> 128.
        let image = image::ImageBuffer::from_pixel(2, 2, image::Rgb([1023_u16, 512, 0]));
        assert_eq!(decode_colour(&png(DynamicImage::ImageRgb16(image))).unwrap().get_pixel(1, 1).0, [255, 128, 0]);
    }

    #[test]
    fn transparent_pixels_are_white() {
        let mut image = RgbaImage::from_pixel(2, 1, image::Rgba([100, 0, 0, 255]));
        // 51 is a fifth: 255 + (100 - 255) / 5 = 224, 255 - 51 = 204.
        image.put_pixel(1, 0, image::Rgba([100, 0, 0, 51]));
        let read = decode_colour(&png(image)).unwrap();
        assert_eq!((read.get_pixel(0, 0).0, read.get_pixel(1, 0).0), ([100, 0, 0], [224, 204, 204]));
    }

    #[test]
    fn what_is_no_image_is_named() {
        assert!(decode_colour(b"hello").unwrap_err().to_string().contains("the text \"hello\""));
    }
}
