//! Pictures in colour: the target of cloning, and source frames whose wrinkles and teeth are carried over.

use std::path::Path;

use image::RgbImage;
use opencv::{
    core::{CV_8U, CV_16U, Mat, Vec3b, Vec3w, Vec4b, Vec4w},
    imgcodecs::{IMREAD_ANYDEPTH, IMREAD_COLOR, IMREAD_UNCHANGED, imdecode},
    prelude::*,
    videoio::{CAP_ANY, VideoCapture},
};

use super::{
    DecodeError, SequenceError,
    decode::{check_whole, readable_start},
};
use crate::dataset::FrameSource;

/// Largest side of a picture, px: what an 8k camera gives, with room.
pub const MAX_SIDE: u32 = 16_384;

/// Reads an image file in colour, upright as its EXIF data says, 16-bit channels scaled by the bits they use, transparent pixels laid
/// on white.
///
/// # Errors
/// [`SequenceError::Decode`] when it is not a whole image.
pub fn read_colour(path: &Path) -> Result<RgbImage, SequenceError> {
    let decoded = std::fs::read(path).map_err(DecodeError::from).and_then(|bytes| decode_colour(&bytes));
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
            let mut capture = VideoCapture::from_file(path, CAP_ANY)?;
            let mut frames = Vec::new();
            for number in 1..=wanted.iter().copied().max().unwrap_or(0) {
                let mut mat = Mat::default();
                if !capture.read(&mut mat)? || mat.empty() {
                    return Err(error("ends before the last frame of the track"));
                }
                if wanted.contains(&number) {
                    let image = rgb(&mat).map_err(|source| SequenceError::Decode { path: path.clone(), source })?;
                    frames.push((number, image));
                }
            }
            Ok(frames)
        }
    }
}

fn decode_colour(bytes: &[u8]) -> Result<RgbImage, DecodeError> {
    check_whole(bytes)?;
    let buffer = Mat::from_slice(bytes)?;
    let not_an_image = || DecodeError::NotAnImage { start: readable_start(bytes) };
    let mat = imdecode(&buffer, IMREAD_COLOR | IMREAD_ANYDEPTH).map_err(|_| not_an_image())?;
    if mat.empty() {
        return Err(not_an_image());
    }
    let mut image = rgb(&mat)?;
    // OpenCV drops transparency with the colours that were under it; that leaves black fringes.
    if let Ok(full) = imdecode(&buffer, IMREAD_UNCHANGED)
        && full.channels() == 4
        && (full.cols(), full.rows()) == (mat.cols(), mat.rows())
    {
        lay_on_white(&full, &mut image)?;
    }
    Ok(image)
}

/// Bits that the largest of some 16-bit values uses: 10, 12, 14 or 16.
fn scale_of(largest: u16) -> f64 {
    let bits = [10, 12, 14].into_iter().find(|&b| u32::from(largest) < 1 << b).unwrap_or(16);
    255.0 / f64::from((1_u32 << bits) - 1)
}

fn rgb(mat: &Mat) -> Result<RgbImage, DecodeError> {
    let (width, height) = (mat.cols().max(0) as u32, mat.rows().max(0) as u32);
    let mut image = RgbImage::new(width, height);
    match (mat.depth(), mat.channels()) {
        (CV_8U, 3) => {
            for (pixel, from) in image.pixels_mut().zip(mat.data_typed::<Vec3b>()?) {
                pixel.0 = [from[2], from[1], from[0]];
            }
        }
        (CV_8U, 1) => {
            for (pixel, &from) in image.pixels_mut().zip(mat.data_typed::<u8>()?) {
                pixel.0 = [from; 3];
            }
        }
        (CV_16U, 3) => {
            let data = mat.data_typed::<Vec3w>()?;
            let scale = scale_of(data.iter().flat_map(|p| p.0).max().unwrap_or(0));
            for (pixel, from) in image.pixels_mut().zip(data) {
                pixel.0 = [2, 1, 0].map(|c| (f64::from(from[c]) * scale).round().min(255.0) as u8);
            }
        }
        (depth, _) => return Err(DecodeError::Depth { depth }),
    }
    Ok(image)
}

fn lay_on_white(full: &Mat, image: &mut RgbImage) -> Result<(), DecodeError> {
    let shares: Vec<f64> = match full.depth() {
        CV_8U => full.data_typed::<Vec4b>()?.iter().map(|p| f64::from(p[3]) / 255.0).collect(),
        CV_16U => full.data_typed::<Vec4w>()?.iter().map(|p| f64::from(p[3]) / 65_535.0).collect(),
        _ => return Ok(()),
    };
    for (pixel, share) in image.pixels_mut().zip(shares) {
        if share < 1.0 {
            pixel.0 = pixel.0.map(|c| (255.0 + (f64::from(c) - 255.0) * share).round() as u8);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use image::{DynamicImage, ImageFormat, RgbaImage};

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
