//! Compares pictures of every format with OpenCV's decoders, and reads files that OpenCV wrote.

use std::{fs, io::Cursor};

use grimace::internal::sequence::{DecodeError, GrayDecoder, read_colour};
use image::{DynamicImage, GrayImage, ImageFormat, RgbImage};
use opencv::{
    core::{Mat, Vector},
    imgcodecs::{
        IMREAD_ANYDEPTH, IMREAD_GRAYSCALE, IMWRITE_JPEG_PROGRESSIVE, IMWRITE_JPEG_QUALITY, IMWRITE_JPEG_RST_INTERVAL,
        IMWRITE_TIFF_COMPRESSION, imdecode, imencode,
    },
    prelude::*,
};

fn grey(bytes: &[u8]) -> Result<GrayImage, DecodeError> {
    GrayDecoder::default().decode(bytes)
}

/// Returns a picture with smooth colours and odd sides, so that every block and every conversion is exercised.
fn colours(width: u32, height: u32) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let wave = |a: f64, b: f64| (127.0 + 120.0 * (a * f64::from(x) + b * f64::from(y)).sin()) as u8;
        image::Rgb([wave(0.11, 0.05), wave(-0.07, 0.13), wave(0.03, -0.17)])
    })
}

fn encoded(image: &DynamicImage, format: ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

/// Encodes a picture with OpenCV.
fn by_opencv(image: &RgbImage, extension: &str, flags: &[i32]) -> Vec<u8> {
    let png = encoded(&image.clone().into(), ImageFormat::Png);
    let mat = imdecode(&Mat::from_slice(&png).unwrap(), opencv::imgcodecs::IMREAD_COLOR).unwrap();
    let mut bytes = Vector::new();
    imencode(extension, &mat, &mut bytes, &Vector::from_slice(flags)).unwrap();
    bytes.to_vec()
}

/// Returns the largest difference to OpenCV's decoder in grey levels, and the share of pixels that differ.
fn against_opencv(bytes: &[u8]) -> (u8, f64) {
    let ours = grey(bytes).unwrap();
    let mat = imdecode(&Mat::from_slice(bytes).unwrap(), IMREAD_GRAYSCALE | IMREAD_ANYDEPTH).unwrap();
    assert_eq!((mat.cols() as u32, mat.rows() as u32), ours.dimensions());
    let theirs = mat.data_typed::<u8>().unwrap();
    let differences = ours.as_raw().iter().zip(theirs).map(|(a, b)| a.abs_diff(*b));
    let differ = differences.clone().filter(|d| *d > 0).count();
    (differences.max().unwrap(), differ as f64 / theirs.len() as f64)
}

#[test]
fn lossless_formats_are_grey_as_opencv_makes_them() {
    let picture = DynamicImage::from(colours(123, 77));
    for format in [ImageFormat::Png, ImageFormat::Bmp, ImageFormat::Tiff, ImageFormat::Pnm, ImageFormat::WebP] {
        let bytes = encoded(&picture, format);
        let (largest, share) = against_opencv(&bytes);
        // OpenCV rounds the coefficients differently in each format, and libpng rounds grey values down.
        let most = if format == ImageFormat::Png { 0.6 } else { 0.02 };
        assert!(largest <= 1 && share < most, "{format:?}: {largest}, {share}");
        let grey = encoded(&picture.to_luma8().into(), format);
        assert_eq!(against_opencv(&grey).0, 0, "{format:?}, grey");
    }
    for compression in [1, 5, 8, 32773] {
        let (largest, _) = against_opencv(&by_opencv(&colours(123, 77), ".tiff", &[IMWRITE_TIFF_COMPRESSION, compression]));
        assert!(largest <= 1, "TIFF compression {compression}");
    }
}

#[test]
fn jpeg_is_decoded_as_opencv_does_within_rounding() {
    for (width, height) in [(123, 77), (64, 64), (17, 33), (640, 480)] {
        for flags in
            [vec![], vec![IMWRITE_JPEG_PROGRESSIVE, 1], vec![IMWRITE_JPEG_RST_INTERVAL, 3], vec![IMWRITE_JPEG_QUALITY, 40]]
        {
            let (largest, share) = against_opencv(&by_opencv(&colours(width, height), ".jpg", &flags));
            assert!(largest <= 1 && share < 0.05, "{width}x{height} {flags:?}: {largest}, {share}");
        }
    }
}

#[test]
fn a_picture_whose_data_end_early_is_refused_in_every_format() {
    let picture = colours(160, 120);
    let files = [
        encoded(&picture.clone().into(), ImageFormat::Png),
        encoded(&picture.clone().into(), ImageFormat::Bmp),
        encoded(&picture.clone().into(), ImageFormat::Tiff),
        encoded(&picture.clone().into(), ImageFormat::Pnm),
        encoded(&picture.clone().into(), ImageFormat::WebP),
        by_opencv(&picture, ".tif", &[]),
        by_opencv(&picture, ".webp", &[]),
        by_opencv(&picture, ".jpg", &[]),
        by_opencv(&picture, ".jpg", &[IMWRITE_JPEG_PROGRESSIVE, 1]),
        by_opencv(&picture, ".jpg", &[IMWRITE_JPEG_RST_INTERVAL, 3]),
    ];
    for (k, bytes) in files.iter().enumerate() {
        assert!(grey(bytes).is_ok(), "file {k}");
        for share in [0.3, 0.5, 0.9, 0.99] {
            let cut = &bytes[..(bytes.len() as f64 * share) as usize];
            let error = grey(cut).unwrap_err();
            assert!(matches!(error, DecodeError::Truncated { .. }), "file {k}, {share}: {error}");
        }
    }
}

#[test]
fn an_end_marker_does_not_make_a_jpeg_whole() {
    let folder = tempfile::tempdir().unwrap();
    let picture = colours(160, 120);
    for flags in [vec![], vec![IMWRITE_JPEG_PROGRESSIVE, 1]] {
        let bytes = by_opencv(&picture, ".jpg", &flags);
        for share in [0.4, 0.7, 0.95] {
            let mut cut = bytes[..(bytes.len() as f64 * share) as usize].to_vec();
            cut.extend([0xFF, 0xD9]);
            assert!(grey(&cut).is_err(), "{flags:?}, {share}");
            let path = folder.path().join("cut.jpg");
            fs::write(&path, &cut).unwrap();
            assert!(read_colour(&path).is_err(), "{flags:?}, {share}");
        }
    }
    // 4:2:0 data with 16 rows of pixels per row of blocks: the message says what was decoded.
    let bytes = by_opencv(&picture, ".jpg", &[]);
    let message = grey(&bytes[..bytes.len() / 2]).unwrap_err().to_string();
    assert!(message.starts_with("the JPEG image is cut off: "), "{message}");
    // A uniform picture has rows of few bits; the last of them must not count as missing.
    let flat = RgbImage::from_pixel(200, 150, image::Rgb([90, 90, 90]));
    assert!(grey(&by_opencv(&flat, ".jpg", &[])).is_ok());
}
