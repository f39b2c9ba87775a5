//! Frames in order, decoded to 8-bit grey, from image files or a video.
//!
//! OpenCV decodes; its types stop here and in [`crate::track`]. A frame is decoded from bytes that were first checked to be whole,
//! because OpenCV fills what a truncated file lacks with grey and reports success.

mod colour;
mod decode;
mod film;
mod video;
mod webm;

use std::path::{Path, PathBuf};

use opencv::{core::Mat, prelude::*};

use crate::dataset::{FrameFile, FrameSource};

pub use colour::{MAX_SIDE, read_colour, read_colour_frames};
pub use decode::{DecodeError, GrayDecoder};
pub use film::{FilmError, write_video};

/// Width and height in pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// Whether a position lies on a pixel: half a pixel beyond the centres of the border pixels at most.
    pub fn contains(self, point: &nalgebra::Point2<f64>) -> bool {
        let inside = |value: f64, size: u32| value >= -0.5 && value < f64::from(size) - 0.5;
        inside(point.x, self.width) && inside(point.y, self.height)
    }
}

impl std::fmt::Display for ImageSize {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// One decoded frame: 8-bit grey pixels and the frame's number.
#[derive(Debug)]
pub struct Frame {
    number: u32,
    mat: Mat,
}

impl Frame {
    /// The number in the file name, or the place in the video from 1.
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Width and height.
    pub fn size(&self) -> ImageSize {
        ImageSize { width: self.mat.cols().max(0) as u32, height: self.mat.rows().max(0) as u32 }
    }

    /// The pixels, for OpenCV.
    pub(crate) fn mat(&self) -> &Mat {
        &self.mat
    }

    /// A frame of the given pixels.
    ///
    /// # Errors
    /// [`SequenceError::OpenCv`] when OpenCV cannot hold the image.
    pub fn from_image(number: u32, image: &image::GrayImage) -> Result<Self, SequenceError> {
        let mat = Mat::new_rows_cols_with_data(image.height() as i32, image.width() as i32, image.as_raw())?;
        Ok(Self { number, mat: mat.try_clone()? })
    }

    /// A copy of the pixels.
    ///
    /// # Errors
    /// [`SequenceError::OpenCv`] when the pixels cannot be read.
    pub fn to_image(&self) -> Result<image::GrayImage, SequenceError> {
        let size = self.size();
        let continuous = if self.mat.is_continuous() { self.mat.try_clone()? } else { self.mat.clone() };
        let data = continuous.data_typed::<u8>()?.to_vec();
        let found = data.len();
        image::GrayImage::from_raw(size.width, size.height, data).ok_or(SequenceError::PixelCount { size, found })
    }
}

/// Why a sequence cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// A frame does not decode.
    #[error("{}: {source}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        source: DecodeError,
    },
    /// Frames of different sizes.
    #[error(
        "{}: frame {number} is {found} where the first frame is {expected}; all frames of a sequence must have one size",
        path.display()
    )]
    Size {
        /// The odd frame's file, or the video.
        path: PathBuf,
        /// Number of the odd frame.
        number: u32,
        /// Its size.
        found: ImageSize,
        /// Size of the first frame.
        expected: ImageSize,
    },
    /// Too few frames.
    #[error("a sequence needs at least 2 frames, from neutral to apex; found {found}")]
    TooFewFrames {
        /// Frames found.
        found: usize,
    },
    /// A video that does not open or breaks off before its last frame.
    #[error("{}: {reason}", path.display())]
    Video {
        /// The file.
        path: PathBuf,
        /// What happened.
        reason: String,
    },
    /// Pixels that do not fill the image.
    #[error("{found} pixels for an image of {size}")]
    PixelCount {
        /// The image's size.
        size: ImageSize,
        /// Pixels found.
        found: usize,
    },
    /// OpenCV failed.
    #[error("OpenCV: {0}")]
    OpenCv(#[from] opencv::Error),
}

/// Reads the frames of one sequence one after the other; at most one decoded frame is held.
pub struct SequenceReader {
    source: Source,
    size: Option<ImageSize>,
}

enum Source {
    Images { files: std::vec::IntoIter<FrameFile>, decoder: GrayDecoder },
    Video(Box<video::VideoReader>),
}

impl SequenceReader {
    /// Opens a sequence.
    ///
    /// # Errors
    /// [`SequenceError`] for fewer than two image files or a video that does not open.
    pub fn open(source: &FrameSource) -> Result<Self, SequenceError> {
        let source = match source {
            FrameSource::Images(files) => {
                if files.len() < 2 {
                    return Err(SequenceError::TooFewFrames { found: files.len() });
                }
                Source::Images { files: files.clone().into_iter(), decoder: GrayDecoder::default() }
            }
            FrameSource::Video { path, first, last } => Source::Video(Box::new(video::VideoReader::open(path, *first, *last)?)),
        };
        Ok(Self { source, size: None })
    }

    /// Frames per second that the file states; images state none.
    pub fn fps(&self) -> Option<f64> {
        match &self.source {
            Source::Images { .. } => None,
            Source::Video(video) => video.fps(),
        }
    }

    /// The next frame, whatever its size, and the file it comes from.
    fn next_frame(&mut self) -> Option<Result<(Frame, PathBuf), SequenceError>> {
        match &mut self.source {
            Source::Images { files, decoder } => {
                let FrameFile { number, path } = files.next()?;
                let decoded = std::fs::read(&path).map_err(DecodeError::from).and_then(|bytes| decoder.decode(&bytes));
                Some(match decoded {
                    Ok(mat) => Ok((Frame { number, mat }, path)),
                    Err(source) => Err(SequenceError::Decode { path, source }),
                })
            }
            Source::Video(video) => {
                let frame = video.next_frame()?;
                Some(frame.map(|(number, mat)| (Frame { number, mat }, video.path().to_owned())))
            }
        }
    }
}

impl Iterator for SequenceReader {
    type Item = Result<Frame, SequenceError>;

    fn next(&mut self) -> Option<Self::Item> {
        let (frame, path) = match self.next_frame()? {
            Ok(frame) => frame,
            Err(error) => return Some(Err(error)),
        };
        let found = frame.size();
        let expected = *self.size.get_or_insert(found);
        if found != expected {
            return Some(Err(SequenceError::Size { path, number: frame.number, found, expected }));
        }
        Some(Ok(frame))
    }
}

/// Reads one image file as grey pixels.
///
/// # Errors
/// [`SequenceError::Decode`] when it is not a whole image.
pub fn read_frame(path: &Path) -> Result<Frame, SequenceError> {
    let decoded = std::fs::read(path).map_err(DecodeError::from).and_then(|bytes| GrayDecoder::default().decode(&bytes));
    let mat = decoded.map_err(|source| SequenceError::Decode { path: path.to_owned(), source })?;
    Ok(Frame { number: 0, mat })
}

/// The first frame of a sequence.
///
/// # Errors
/// [`SequenceError`] when it does not read.
pub fn read_first_frame(source: &FrameSource) -> Result<Frame, SequenceError> {
    SequenceReader::open(source)?.next().unwrap_or(Err(SequenceError::TooFewFrames { found: 0 }))
}

/// Makes OpenCV quiet and single-threaded: rayon spreads the work over sequences, and results must not depend on threads.
///
/// # Errors
/// [`SequenceError::OpenCv`] when OpenCV refuses.
pub fn configure_opencv() -> Result<(), SequenceError> {
    opencv::core::set_use_opencl(false)?;
    opencv::core::set_num_threads(1)?;
    opencv::core::set_log_level(opencv::core::LogLevel::LOG_LEVEL_SILENT)?;
    Ok(())
}
