//! Reads frames in order as 8-bit grey, from image files or a video.
//!
//! A picture is rejected if its header states too large a size ([`max_pixels`]), or if its data are incomplete: missing data are never
//! filled in. Image files are decoded in this process, videos by the program `grimace-opencv`.

mod backward;
mod clock;
mod colour;
mod content;
mod decode;
mod film;
mod jpeg;
mod limit;
mod packets;
mod still;
mod stream;
mod video;

use std::path::{Path, PathBuf};

use image::GrayImage;

use self::{backward::BackwardVideo, content::ContentHasher};
use crate::{
    companion::CompanionError,
    dataset::{FrameFile, FrameSource},
};

pub use clock::Clock;
pub use colour::{ColourReader, MAX_SIDE, Portrait, colour_of, read_colour, read_colour_frames, read_first_in_colour};
pub use content::content_blake3;
pub use decode::{DecodeError, GrayDecoder, grey_of};
pub use film::{FilmError, LONGEST_FRAME_S, check_video, write_video};
pub use limit::{DEFAULT_MAX_PIXELS, set_max_pixels};

/// Width and height in pixels.
///
/// ```
/// use grimace::sequence::ImageSize;
/// use nalgebra::Point2;
///
/// let size = ImageSize { width: 320, height: 240 };
/// // Pixels reach half a pixel around their centres.
/// assert!(size.contains(&Point2::new(-0.5, 239.4)) && !size.contains(&Point2::new(0.0, 240.0)));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct ImageSize {
    /// Columns.
    pub width: u32,
    /// Rows.
    pub height: u32,
}

impl ImageSize {
    /// Whether a position lies on a pixel: at most half a pixel beyond the centres of the border pixels.
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
///
/// ```
/// use grimace::sequence::Frame;
/// use image::{GrayImage, Luma};
///
/// let frame = Frame::new(1, GrayImage::from_pixel(320, 240, Luma([128])));
/// assert_eq!((frame.number(), frame.size().to_string()), (1, "320x240".to_owned()));
/// assert_eq!(frame.image().get_pixel(0, 0).0, [128]);
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Frame {
    number: u32,
    image: GrayImage,
}

impl Frame {
    /// Number in the file name, or position in the video from 1; 0 for a picture read alone ([`read_frame`]).
    pub fn number(&self) -> u32 {
        self.number
    }

    /// Width and height.
    pub fn size(&self) -> ImageSize {
        ImageSize { width: self.image.width(), height: self.image.height() }
    }

    /// Returns a frame with the given pixels.
    pub fn new(number: u32, image: GrayImage) -> Self {
        Self { number, image }
    }

    /// The pixels.
    pub fn image(&self) -> &GrayImage {
        &self.image
    }

    /// Returns the pixels without copying.
    pub fn into_image(self) -> GrayImage {
        self.image
    }
}

/// Why a sequence cannot be read.
///
/// ```
/// use grimace::{dataset::FrameSource, sequence::{SequenceError, SequenceReader}};
///
/// let error = SequenceReader::open(&FrameSource::Images(vec![])).err().expect("no frames");
/// assert!(matches!(error, SequenceError::TooFewFrames { found: 0 }));
/// ```
#[derive(Debug, thiserror::Error)]
pub enum SequenceError {
    /// A frame cannot be decoded.
    #[error("{}: {source}", path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// Why.
        source: DecodeError,
    },
    /// Frames of different sizes.
    #[error(
        "{}: frame {number} is {found} where the first frame is {expected}; all frames of a sequence must have one size; crop or scale them to it",
        path.display()
    )]
    Size {
        /// File of the differing frame, or the video.
        path: PathBuf,
        /// Number of the differing frame.
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
    /// A video that cannot be opened or ends before its last frame.
    #[error("{}: {reason}", path.display())]
    Video {
        /// The file.
        path: PathBuf,
        /// What happened.
        reason: String,
    },
    /// A damaged video with missing frames; the frames after these would get wrong numbers.
    #[error(
        "{}: damaged after frame {last}: the frames there cannot be decoded, and later frames would get wrong numbers; use frames 1 to \
         {last}, or an undamaged copy",
        path.display()
    )]
    Damaged {
        /// The file.
        path: PathBuf,
        /// The last frame before the damage.
        last: u32,
    },
    /// The program that decodes videos is missing or ended early.
    #[error("{}: {source}", path.display())]
    Decoder {
        /// The file.
        path: PathBuf,
        /// What happened.
        #[doc(hidden)]
        source: CompanionError,
    },
    /// A file that changed while it was being decoded.
    #[error("{}: the file changed while it was read; run again when it is complete", path.display())]
    Changed {
        /// The file.
        path: PathBuf,
    },
}

/// Reads the frames of one sequence one by one. At most one decoded frame is in memory. All frames have one size, except for two pictures
/// alone.
///
/// ```
/// use grimace::{dataset::list_frames, sequence::SequenceReader};
///
/// let source = list_frames("fixtures/simulated/S001/005".as_ref(), None, Some(3))?;
/// let mut numbers = Vec::new();
/// for frame in SequenceReader::open(&source)? {
///     numbers.push(frame?.number());
/// }
/// assert_eq!(numbers, [1, 2, 3]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct SequenceReader {
    source: Source,
    /// Size of the first frame.
    size: Option<ImageSize>,
    /// Whether all frames must have it. Two photographs of a person may be cropped differently.
    of_one_size: bool,
    content: ContentHasher,
}

/// Whether a sequence is two pictures alone.
fn is_pair(source: &FrameSource) -> bool {
    matches!(source, FrameSource::Images(files) if files.len() == 2)
}

enum Source {
    Images { files: std::vec::IntoIter<FrameFile>, decoder: GrayDecoder },
    Video(Box<video::VideoReader>),
    Backward(Box<BackwardVideo>),
}

impl SequenceReader {
    /// Opens a sequence.
    ///
    /// # Errors
    /// [`SequenceError`] for fewer than two image files or a video that cannot be opened.
    pub fn open(source: &FrameSource) -> Result<Self, SequenceError> {
        let is_pair = is_pair(source);
        let source = match source {
            FrameSource::Images(files) => {
                if files.len() < 2 {
                    return Err(SequenceError::TooFewFrames { found: files.len() });
                }
                Source::Images { files: files.clone().into_iter(), decoder: GrayDecoder::default() }
            }
            FrameSource::Video { path, first: Some(first), last: Some(last) } if first > last => {
                Source::Backward(Box::new(BackwardVideo::open(path, *first, *last)?))
            }
            FrameSource::Video { path, first, last } => Source::Video(Box::new(video::VideoReader::open(path, *first, *last)?)),
        };
        Ok(Self { source, size: None, of_one_size: !is_pair, content: ContentHasher::default() })
    }

    /// Opens a part of an image sequence with the 16-bit scaling and the sizes of the whole; for other sources, opens the whole sequence.
    ///
    /// # Errors
    /// As [`SequenceReader::open`].
    pub(crate) fn open_part(part: &FrameSource, whole: &FrameSource) -> Result<Self, SequenceError> {
        let mut reader = Self::open(part)?;
        reader.of_one_size = !is_pair(whole);
        if let (Source::Images { decoder, .. }, FrameSource::Images(files)) = (&mut reader.source, whole)
            && let Some(first) = files.first()
        {
            *decoder = GrayDecoder::of_sequence(&first.path);
        }
        Ok(reader)
    }

    /// Clock of the frames read so far, from their own times; unknown for images.
    pub(crate) fn clock(&self) -> Clock {
        match &self.source {
            Source::Images { .. } => Clock::default(),
            Source::Video(video) => video.clock(),
            Source::Backward(video) => video.clock(),
        }
    }

    /// Time of the video frame that was read last, s from the start of the video, if known.
    pub(crate) fn time(&self) -> Option<f64> {
        match &self.source {
            Source::Video(video) => video.times().last(),
            Source::Images { .. } | Source::Backward(_) => None,
        }
    }

    /// Note about frames that were read to the end, for example that some are missing there.
    pub(crate) fn remark(&self) -> Option<String> {
        match &self.source {
            Source::Images { decoder, .. } => decoder.remark(),
            Source::Video(video) => video.remark().map(str::to_owned),
            Source::Backward(_) => None,
        }
    }

    /// Frames per second stated in the file, which may be a time base instead; `None` for images.
    pub fn fps(&self) -> Option<f64> {
        match &self.source {
            Source::Images { .. } => None,
            Source::Video(video) => video.fps(),
            Source::Backward(video) => video.fps(),
        }
    }

    /// Number of frames stated in a video's header, possibly an estimate; `None` without one.
    pub fn stated_frames(&self) -> Option<usize> {
        match &self.source {
            Source::Images { files, .. } => Some(files.len()),
            Source::Video(video) => video.stated_frames(),
            Source::Backward(_) => None,
        }
    }

    /// BLAKE3 of names and content of all files of the sequence, as `content_blake3`. For decoded files it uses the decoded bytes, and it
    /// also covers the files not reached.
    ///
    /// # Errors
    /// [`SequenceError`] when a file cannot be read, or a video was changed since it was opened.
    pub fn into_content_blake3(mut self) -> Result<blake3::Hash, SequenceError> {
        match self.source {
            Source::Images { files, .. } => {
                for FrameFile { path, .. } in files {
                    self.content.read(&path).map_err(|e| SequenceError::Decode { path, source: e.into() })?;
                }
                Ok(self.content.finish())
            }
            Source::Video(video) => video.content_blake3(),
            Source::Backward(video) => video.content_blake3(),
        }
    }

    /// The next frame of any size, and its file.
    fn next_frame(&mut self) -> Option<Result<(Frame, PathBuf), SequenceError>> {
        match &mut self.source {
            Source::Images { files, decoder } => {
                let FrameFile { number, path } = files.next()?;
                let decoded = self.content.read(&path).map_err(DecodeError::from).and_then(|bytes| decoder.decode(&bytes));
                Some(match decoded {
                    Ok(image) => Ok((Frame { number, image }, path)),
                    Err(source) => Err(SequenceError::Decode { path, source }),
                })
            }
            Source::Video(video) => {
                let frame = video.next_frame()?;
                Some(frame.map(|(number, image)| (Frame { number, image }, video.path().to_owned())))
            }
            Source::Backward(video) => {
                let frame = video.next_frame()?;
                Some(frame.map(|(number, image)| (Frame { number, image }, video.path().to_owned())))
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
        if self.of_one_size && found != expected {
            return Some(Err(SequenceError::Size { path, number: frame.number, found, expected }));
        }
        Some(Ok(frame))
    }
}

/// Reads one image file as grey pixels.
///
/// ```
/// use grimace::sequence::read_frame;
///
/// let frame = read_frame("fixtures/simulated/S001/005/S001_005_00000001.jpg".as_ref())?;
/// assert_eq!(frame.size().to_string(), "320x320");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SequenceError::Decode`] when it is not a complete image.
pub fn read_frame(path: &Path) -> Result<Frame, SequenceError> {
    read_with(path, GrayDecoder::default())
}

/// As [`read_frame`] for a frame of a sequence whose first picture is `first`, with the same 16-bit scaling as the sequence.
///
/// # Errors
/// As [`read_frame`].
pub(crate) fn read_frame_of(path: &Path, first: &Path) -> Result<Frame, SequenceError> {
    read_with(path, if path == first { GrayDecoder::default() } else { GrayDecoder::of_sequence(first) })
}

fn read_with(path: &Path, mut decoder: GrayDecoder) -> Result<Frame, SequenceError> {
    let decoded = crate::input::read(path).map_err(DecodeError::from).and_then(|bytes| decoder.decode(&bytes));
    let image = decoded.map_err(|source| SequenceError::Decode { path: path.to_owned(), source })?;
    Ok(Frame { number: 0, image })
}

/// Reads the first frame of a sequence, its neutral frame.
///
/// ```
/// use grimace::{dataset::list_frames, internal::sequence::read_first_frame};
///
/// let source = list_frames("fixtures/simulated/S001/005".as_ref(), Some(4), None)?;
/// assert_eq!(read_first_frame(&source)?.number(), 4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`SequenceError`] when it cannot be read.
pub fn read_first_frame(source: &FrameSource) -> Result<Frame, SequenceError> {
    // Later frames need not exist; in a video neither need earlier ones.
    match source {
        FrameSource::Images(files) => {
            let file = files.first().ok_or(SequenceError::TooFewFrames { found: 0 })?;
            Ok(Frame { number: file.number, ..read_frame(&file.path)? })
        }
        FrameSource::Video { path, first, .. } => {
            let source = FrameSource::Video { path: path.clone(), first: *first, last: None };
            SequenceReader::open(&source)?.next().unwrap_or(Err(SequenceError::TooFewFrames { found: 0 }))
        }
    }
}
