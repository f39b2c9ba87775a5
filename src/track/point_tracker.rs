//! The interface between the tracking method and the code that reads pixels.

use nalgebra::{Matrix2, Point2};

use super::{Patch, TrackError};
use crate::sequence::Frame;

/// Which prepared frame a [`PointTracker`] works on.
///
/// The example is a tracker that keeps three frames.
/// ```
/// use grimace::track::Slot;
///
/// let numbers = [1, 8, 9];
/// let number = |slot| match slot {
///     Slot::Neutral => numbers[0],
///     Slot::Previous => numbers[1],
///     Slot::Current => numbers[2],
/// };
/// assert_eq!(number(Slot::Previous) + 1, number(Slot::Current));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slot {
    /// The first frame given.
    Neutral,
    /// The frame before the current one.
    Previous,
    /// The frame given last.
    Current,
}

/// A point to search for in another frame.
///
/// ```
/// use grimace::track::Probe;
/// use nalgebra::{Point2, Vector2};
///
/// // The search starts where the head's motion leads.
/// let position = Point2::new(150.0, 240.0);
/// let probe = Probe { position, guess: position + Vector2::new(3.0, 0.0) };
/// assert_eq!(probe.guess.x, 153.0);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Position in the frame it comes from, px.
    pub position: Point2<f64>,
    /// Start of the search, px.
    pub guess: Point2<f64>,
}

/// Result of a search.
///
/// ```
/// use grimace::track::Found;
/// use nalgebra::Point2;
///
/// let found = Found::At { position: Point2::new(150.25, 240.0), difference: 1.5 };
/// assert!(matches!(found, Found::At { difference, .. } if difference < 2.0));
/// assert_ne!(found, Found::Lost);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Found {
    /// A match.
    At {
        /// Position, px.
        position: Point2<f64>,
        /// Mean absolute grey difference of the two windows, 0 to 255.
        difference: f64,
    },
    /// No match.
    Lost,
}

/// Finds points of one frame in another: the interface between the tracking method and the code that reads pixels.
///
/// ```
/// use grimace::{sequence::Frame, track::{Found, PointTracker, Probe, Slot, TrackError}};
///
/// /// Finds every point where the search starts.
/// struct Still;
///
/// impl PointTracker for Still {
///     fn advance(&mut self, _: &Frame) -> Result<(), TrackError> {
///         Ok(())
///     }
///
///     fn find(&mut self, _: Slot, _: Slot, _: u32, _: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
///         Ok(probes.iter().map(|probe| Found::At { position: probe.guess, difference: 0.0 }).collect())
///     }
/// }
///
/// assert_eq!(Still.find(Slot::Previous, Slot::Current, 15, 4, &[])?, []);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait PointTracker {
    /// Takes the next frame. It becomes the current frame, the current one becomes the previous one, and the first one stays the neutral
    /// one.
    ///
    /// # Errors
    /// [`TrackError`] when the frame cannot be prepared.
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError>;

    /// Returns the mean gradient matrices of the windows around points of a frame, squared grey levels per px: one for each point, finite.
    /// They tell how well, and in which direction, a match is determined. The default treats all points and directions alike.
    ///
    /// # Errors
    /// [`TrackError`] when the gradients cannot be read.
    fn gradients(&self, _slot: Slot, _window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        Ok(vec![Matrix2::identity(); points.len()])
    }

    /// Returns the grey values of a frame around points, all finite, smoothed by a Gaussian of standard deviation `smoothing` px, reaching at least
    /// `margin` px beyond the points within the image. The default returns `None`, for a tracker without images; nodes are then not
    /// aligned.
    ///
    /// # Errors
    /// [`TrackError`] when the image cannot be read.
    fn patch(&self, _slot: Slot, _points: &[Point2<f64>], _margin: f64, _smoothing: f64) -> Result<Option<Patch>, TrackError> {
        Ok(None)
    }

    /// Finds the probes of frame `from` in frame `to`, with a square window of `window_px` and `levels` pyramid levels. Returns one result
    /// per probe, with finite numbers.
    ///
    /// # Errors
    /// [`TrackError`] when the search cannot run at all.
    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError>;
}

/// Forwards to the tracker behind a `&mut T` or `Box<T>`.
impl<P: std::ops::DerefMut<Target: PointTracker>> PointTracker for P {
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError> {
        (**self).advance(frame)
    }

    fn gradients(&self, slot: Slot, window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        (**self).gradients(slot, window_px, points)
    }

    fn patch(&self, slot: Slot, points: &[Point2<f64>], margin: f64, smoothing: f64) -> Result<Option<Patch>, TrackError> {
        (**self).patch(slot, points, margin, smoothing)
    }

    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        (**self).find(from, to, window_px, levels, probes)
    }
}
