//! Reads pictures in colour: targets of cloning, and source frames whose wrinkles and teeth are transferred.

use std::{collections::BTreeMap, path::Path};

use image::{DynamicImage, GrayImage, ImageBuffer, Rgb, RgbImage, RgbaImage};

use super::{
    DecodeError, Frame, GrayDecoder, SequenceError,
    decode::{bits_of, grey_of, other_pixels},
    read_first_frame,
    still::{Wanted, decode, is_jpeg},
    stream::{self, Next, Stream},
};
use crate::{
    companion::wire::Pixels,
    dataset::{FrameFile, FrameSource},
};

/// Largest side of a picture, px: above that of an 8k camera.
pub const MAX_SIDE: u32 = 16_384;

/// Reads an image file in colour: upright by its EXIF data, 16-bit channels scaled by the bits they use, transparent pixels on white.
///
/// # Errors
/// [`SequenceError::Decode`] when it is not a complete image.
pub fn read_colour(path: &Path) -> Result<RgbImage, SequenceError> {
    read_with(path, &mut None)
}

/// A photograph for animation, in colour and in the grey in which its face is read.
#[derive(Clone, Debug)]
pub struct Portrait {
    /// The picture as returned by [`read_colour`].
    pub picture: RgbImage,
    /// The grey picture as returned by [`super::read_frame`]; of a partly transparent picture, its appearance on white.
    pub grey: GrayImage,
    /// Share of its pixels that are transparent, completely or in part; 0 to 1.
    pub transparent: f64,
}

impl Portrait {
    /// Reads an image file.
    ///
    /// # Errors
    /// [`SequenceError::Decode`] when it is not a complete image.
    pub fn read(path: &Path) -> Result<Self, SequenceError> {
        let fail = |source| SequenceError::Decode { path: path.to_owned(), source };
        let bytes = crate::input::read(path).map_err(DecodeError::from).map_err(fail)?;
        let image = decode(&bytes, Wanted::Colour).map_err(fail)?;
        let transparent = transparent_share(&image);
        // Their grey follows from the pixels. JPEG stores its own.
        let is_plain = matches!(image, DynamicImage::ImageRgb8(_) | DynamicImage::ImageLuma8(_)) && !is_jpeg(&bytes);
        let picture = on_white_of(image, &mut None).map_err(fail)?;
        // Colours under transparency are invisible and arbitrary.
        let by_colours = is_plain || transparent > 0.0;
        let grey = if by_colours { grey_of(&picture) } else { GrayDecoder::default().decode(&bytes).map_err(fail)? };
        Ok(Self { picture, grey, transparent })
    }

    /// Note to the user about transparency.
    pub fn remark(&self) -> Option<String> {
        // A share that rounds to 0 means a few pixels, not a background.
        let percent = 100.0 * self.transparent;
        (percent >= 0.5).then(|| {
            let what = match percent {
                all if all >= 100.0 => "all pixels".to_owned(),
                most if most >= 99.5 => "nearly all pixels".to_owned(),
                some => format!("{some:.0} % of the pixels"),
            };
            format!(
                "{what} are transparent or partly transparent: the background becomes white, also in the results; for another \
                 background, save the picture without transparency"
            )
        })
    }
}

/// Share of the pixels of a picture that are not opaque.
fn transparent_share(image: &DynamicImage) -> f64 {
    let pixels = u64::from(image.width()) * u64::from(image.height());
    let clear = match image {
        DynamicImage::ImageLumaA8(image) => image.pixels().filter(|p| p.0[1] < u8::MAX).count(),
        DynamicImage::ImageRgba8(image) => image.pixels().filter(|p| p.0[3] < u8::MAX).count(),
        DynamicImage::ImageLumaA16(image) => image.pixels().filter(|p| p.0[1] < u16::MAX).count(),
        DynamicImage::ImageRgba16(image) => image.pixels().filter(|p| p.0[3] < u16::MAX).count(),
        _ => 0,
    };
    clear as f64 / pixels.max(1) as f64
}

/// As [`read_colour`], for 16-bit channels that use `bits`. If `bits` is `None`, it is set from this picture.
fn read_with(path: &Path, bits: &mut Option<u32>) -> Result<RgbImage, SequenceError> {
    let decoded = crate::input::read(path).map_err(DecodeError::from).and_then(|bytes| decode_colour(&bytes, bits));
    decoded.map_err(|source| SequenceError::Decode { path: path.to_owned(), source })
}

/// Reads the first frame of a sequence, also in colour if possible. A video gives no colour, since it would have to be decoded again, nor
/// does a frame that cannot be read in colour.
///
/// # Errors
/// As [`read_first_frame`].
pub fn read_first_in_colour(source: &FrameSource) -> Result<(Frame, Option<RgbImage>), SequenceError> {
    let colour = match source {
        FrameSource::Images(files) => files.first().and_then(|file| read_colour(&file.path).ok()),
        FrameSource::Video { .. } => None,
    };
    Ok((read_first_frame(source)?, colour))
}

/// Returns the requested colour frames with their numbers, in the order of `wanted`. 16-bit channels are scaled by the bits that the first
/// requested frame uses; in a reversed sequence that frame is read first, too. All returned frames are in memory.
///
/// # Errors
/// [`SequenceError`] when a frame cannot be read, or the video ends before the last number.
pub fn read_colour_frames(source: &FrameSource, wanted: &[u32]) -> Result<Vec<(u32, RgbImage)>, SequenceError> {
    let mut frames: Vec<(u32, RgbImage)> = match source {
        FrameSource::Images(files) => {
            let mut bits = None;
            let is_first = |file: &&FrameFile| Some(&file.number) == wanted.first();
            let mut first = files.iter().find(is_first).map(|file| read_with(&file.path, &mut bits)).transpose()?;
            let read = |file: &FrameFile| match first.take_if(|_| is_first(&file)) {
                Some(picture) => Ok((file.number, picture)),
                None => Ok((file.number, read_with(&file.path, &mut bits)?)),
            };
            files.iter().filter(|file| wanted.contains(&file.number)).map(read).collect::<Result<_, _>>()?
        }
        FrameSource::Video { path, .. } => {
            let error = |reason: &str| SequenceError::Video { path: path.clone(), reason: reason.to_owned() };
            let first = wanted.iter().copied().min().unwrap_or(1).max(1);
            let mut stream = Stream::open(path, stream::Wanted::Colour { first })?;
            let mut frames = Vec::new();
            for number in first..=wanted.iter().copied().max().unwrap_or(0) {
                let Next::Frame(Pixels { width, height, data, .. }) = stream.next()? else {
                    return Err(error("ends before the last frame of the track"));
                };
                if wanted.contains(&number) {
                    frames.push((number, RgbImage::from_raw(width, height, data).unwrap_or_default()));
                }
            }
            frames
        }
    };
    let places: BTreeMap<u32, usize> = wanted.iter().enumerate().map(|(place, &number)| (number, place)).collect();
    frames.sort_by_key(|(number, _)| places.get(number));
    Ok(frames)
}

/// Returns all frames of a sequence in colour, one by one, with their numbers.
pub struct ColourReader(Colours);

enum Colours {
    Images { files: std::vec::IntoIter<FrameFile>, bits: Option<u32> },
    Video { stream: Box<Stream>, next: u32, ended: bool },
}

impl ColourReader {
    /// Opens a sequence.
    ///
    /// # Errors
    /// [`SequenceError`] for a video that cannot be opened.
    pub fn open(source: &FrameSource) -> Result<Self, SequenceError> {
        Ok(Self(match source {
            FrameSource::Images(files) => Colours::Images { files: files.clone().into_iter(), bits: None },
            FrameSource::Video { path, first, .. } => {
                let first = first.unwrap_or(1).max(1);
                Colours::Video {
                    stream: Box::new(Stream::open(path, stream::Wanted::Colour { first })?),
                    next: first,
                    ended: false,
                }
            }
        }))
    }
}

impl Iterator for ColourReader {
    type Item = Result<(u32, RgbImage), SequenceError>;

    fn next(&mut self) -> Option<Self::Item> {
        match &mut self.0 {
            Colours::Images { files, bits } => {
                let FrameFile { number, path } = files.next()?;
                Some(read_with(&path, bits).map(|image| (number, image)))
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

/// Converts a grey picture to three equal channels. The conversion of `image` would use floats.
pub fn colour_of(image: &GrayImage) -> RgbImage {
    let values = image.as_raw().iter().flat_map(|&v| [v; 3]).collect();
    RgbImage::from_raw(image.width(), image.height(), values).unwrap_or_default()
}

fn decode_colour(bytes: &[u8], bits: &mut Option<u32>) -> Result<RgbImage, DecodeError> {
    on_white_of(decode(bytes, Wanted::Colour)?, bits)
}

fn on_white_of(image: DynamicImage, bits: &mut Option<u32>) -> Result<RgbImage, DecodeError> {
    match image {
        DynamicImage::ImageRgb8(image) => Ok(image),
        DynamicImage::ImageLuma8(image) => Ok(colour_of(&image)),
        DynamicImage::ImageLumaA8(_) | DynamicImage::ImageRgba8(_) => Ok(on_white(&image.into_rgba8())),
        DynamicImage::ImageLuma16(_) | DynamicImage::ImageRgb16(_) => Ok(narrow(&image.into_rgb16(), bits)),
        DynamicImage::ImageLumaA16(_) | DynamicImage::ImageRgba16(_) => {
            let deep = image.into_rgba16();
            let mut narrow = narrow(&DynamicImage::from(deep.clone()).into_rgb16(), bits);
            for (pixel, from) in narrow.pixels_mut().zip(deep.pixels()) {
                pixel.0 = over_white(pixel.0, f64::from(from.0[3]) / 65_535.0);
            }
            Ok(narrow)
        }
        other => Err(other_pixels(&other)),
    }
}

/// Converts 16-bit channels to 8 bits by the known number of bits, or else by the number that the picture uses.
fn narrow(image: &ImageBuffer<Rgb<u16>, Vec<u16>>, bits: &mut Option<u32>) -> RgbImage {
    let bits = *bits.get_or_insert_with(|| bits_of(image.as_raw().iter().copied().max().unwrap_or(0)));
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
        assert_eq!(decode_colour(&png(image.clone()), &mut None).unwrap(), image);
    }

    #[test]
    fn sixteen_bits_are_scaled_by_the_bits_in_use() {
        // 1023 uses 10 bits: 1023 -> 255, 512 -> 127.6 -> 128.
        let image = image::ImageBuffer::from_pixel(2, 2, image::Rgb([1023_u16, 512, 0]));
        assert_eq!(decode_colour(&png(DynamicImage::ImageRgb16(image)), &mut None).unwrap().get_pixel(1, 1).0, [255, 128, 0]);
    }

    #[test]
    fn all_frames_of_a_sequence_are_scaled_by_the_bits_of_the_first() {
        let folder = tempfile::tempdir().unwrap();
        // A camera of 12 bits; the second frame is dark, the third brighter than the first.
        let file = |(number, value): (u32, u16)| {
            let path = folder.path().join(format!("f_{number}.png"));
            std::fs::write(&path, png(DynamicImage::ImageLuma16(ImageBuffer::from_pixel(2, 2, image::Luma([value]))))).unwrap();
            FrameFile { number, path }
        };
        let files: Vec<FrameFile> = [(1, 4095), (2, 819), (3, 65_535)].map(file).into();
        let source = FrameSource::Images(files.clone());
        let level = |image: &RgbImage| image.get_pixel(0, 0).0[0];
        let all: Vec<u8> = ColourReader::open(&source).unwrap().map(|frame| level(&frame.unwrap().1)).collect();
        assert_eq!(all, [255, 51, 255]);
        // 819 of 4095 is a fifth: 51; of the picture's own 10 bits it would be 204.
        let read = |wanted: &[u32]| -> Vec<(u32, u8)> {
            read_colour_frames(&source, wanted).unwrap().iter().map(|(number, image)| (*number, level(image))).collect()
        };
        assert_eq!(read(&[1, 2, 3]), [(1, 255), (2, 51), (3, 255)]);
        // In reverse order the third is the neutral one: 16 bits.
        assert_eq!(read(&[3, 2, 1]), [(3, 255), (2, 3), (1, 16)]);
        // In grey, a part of the sequence and a single frame have the same scaling as the whole.
        let part = FrameSource::Images(files[1..].to_vec());
        let grey = |frame: &super::super::Frame| frame.image().get_pixel(0, 0).0[0];
        let reader = super::super::SequenceReader::open_part(&part, &source).unwrap();
        assert_eq!(reader.map(|frame| grey(&frame.unwrap())).collect::<Vec<_>>(), [51, 255]);
        assert_eq!(grey(&super::super::read_frame_of(&files[1].path, &files[0].path).unwrap()), 51);
        assert_eq!(grey(&super::super::read_frame(&files[1].path).unwrap()), 204);
    }

    #[test]
    fn transparent_pixels_are_white() {
        let mut image = RgbaImage::from_pixel(2, 1, image::Rgba([100, 0, 0, 255]));
        // 51 is a fifth: 255 + (100 - 255) / 5 = 224, 255 - 51 = 204.
        image.put_pixel(1, 0, image::Rgba([100, 0, 0, 51]));
        let read = decode_colour(&png(image), &mut None).unwrap();
        assert_eq!((read.get_pixel(0, 0).0, read.get_pixel(1, 0).0), ([100, 0, 0], [224, 204, 204]));
    }

    #[test]
    fn the_grey_of_a_portrait_is_that_of_a_frame() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("portrait");
        let levels = GrayImage::from_fn(16, 16, |x, y| image::Luma([(16 * y + x) as u8]));
        let colours = RgbImage::from_fn(16, 16, |x, y| image::Rgb([(16 * x) as u8, (16 * y) as u8, (x * y) as u8]));
        let deep = ImageBuffer::from_fn(16, 16, |x, y| image::Luma([(257 * x * y) as u16]));
        let mut jpeg = std::io::Cursor::new(Vec::new());
        DynamicImage::from(colours.clone()).write_to(&mut jpeg, ImageFormat::Jpeg).unwrap();
        for bytes in [png(levels), png(colours), png(DynamicImage::ImageLuma16(deep)), jpeg.into_inner()] {
            std::fs::write(&path, bytes).unwrap();
            assert_eq!(Portrait::read(&path).unwrap().grey, *super::super::read_frame(&path).unwrap().image());
        }
    }

    #[test]
    fn a_transparent_portrait_is_the_same_in_grey_as_it_is_seen() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cut out.png");
        // A removed background: black, and nothing of it is visible.
        let mut image = RgbaImage::from_pixel(4, 1, image::Rgba([0, 0, 0, 0]));
        image.put_pixel(0, 0, image::Rgba([100, 100, 100, 255]));
        std::fs::write(&path, png(image)).unwrap();
        let Portrait { picture, grey, transparent } = Portrait::read(&path).unwrap();
        assert_eq!((picture.get_pixel(0, 0).0, picture.get_pixel(1, 0).0), ([100; 3], [255; 3]));
        assert_eq!((grey.as_raw().as_slice(), transparent), ([100, 255, 255, 255].as_slice(), 0.75));
        let said = Portrait::read(&path).unwrap().remark().unwrap();
        assert!(
            said.starts_with("75 % of the pixels are transparent or partly transparent: the background becomes white"),
            "{said}"
        );
        // An alpha channel of opaque pixels has no effect.
        std::fs::write(&path, png(RgbaImage::from_pixel(2, 1, image::Rgba([10, 20, 30, 255])))).unwrap();
        let opaque = Portrait::read(&path).unwrap();
        assert!(opaque.remark().is_none() && opaque.grey == *super::super::read_frame(&path).unwrap().image());
    }

    #[test]
    fn files_that_are_not_images_are_reported() {
        assert!(decode_colour(b"hello", &mut None).unwrap_err().to_string().contains("the text \"hello\""));
    }
}
