//! Pyramidal KLT of OpenCV, the field's reference, in the program `grimace-opencv`.

use nalgebra::{Matrix2, Point2};

use super::Klt;
use crate::{
    companion::{
        Answer, Companion,
        wire::{Reply, Request},
    },
    sequence::Frame,
    track::{Found, Patch, PointTracker, Probe, Slot, TrackError},
};

/// The tracker of OpenCV. OpenCV does the search; gradients and grey values, which agree to the last digit or two, come from [`Klt`].
#[derive(Debug)]
pub struct OpenCvKlt {
    companion: Companion,
    ours: Klt,
}

impl OpenCvKlt {
    /// Creates a tracker with `levels` pyramid levels (1: the image itself only), for windows up to `max_window_px`.
    ///
    /// # Errors
    /// [`TrackError::Program`] when `grimace-opencv` does not start.
    pub fn new(levels: u32, max_window_px: u32) -> Result<Self, TrackError> {
        let companion = Companion::start(["klt", &levels.to_string(), &max_window_px.to_string()])?;
        Ok(Self { companion, ours: Klt::new(levels, max_window_px) })
    }

    fn answer(&mut self) -> Result<Reply, TrackError> {
        match self.companion.receive(0)? {
            Answer::Said(Reply::Failed { reason }) => Err(TrackError::PointTracker { reason }),
            Answer::Said(reply) => Ok(reply),
            picture @ Answer::Pixels(_) => Err(picture.unexpected().into()),
        }
    }
}

/// Returns the number of a slot in the messages.
fn number(slot: Slot) -> u8 {
    match slot {
        Slot::Neutral => 0,
        Slot::Previous => 1,
        Slot::Current => 2,
    }
}

impl PointTracker for OpenCvKlt {
    fn advance(&mut self, frame: &Frame) -> Result<(), TrackError> {
        self.ours.advance(frame)?;
        self.companion.send_pixels(frame.image().dimensions(), 1, frame.image().as_raw())?;
        match self.answer()? {
            Reply::Ready => Ok(()),
            other => Err(Answer::Said(other).unexpected().into()),
        }
    }

    fn gradients(&self, slot: Slot, window_px: u32, points: &[Point2<f64>]) -> Result<Vec<Matrix2<f64>>, TrackError> {
        self.ours.gradients(slot, window_px, points)
    }

    fn patch(&self, slot: Slot, points: &[Point2<f64>], margin: f64, smoothing: f64) -> Result<Option<Patch>, TrackError> {
        self.ours.patch(slot, points, margin, smoothing)
    }

    fn find(&mut self, from: Slot, to: Slot, window_px: u32, levels: u32, probes: &[Probe]) -> Result<Vec<Found>, TrackError> {
        // JSON cannot represent NaN or infinity.
        let single = |p: &Point2<f64>| [p.x as f32, p.y as f32].map(|v| if v.is_finite() { v } else { f32::MIN });
        self.companion.send(&Request::Find {
            from: number(from),
            to: number(to),
            window: window_px,
            levels,
            points: probes.iter().map(|p| single(&p.position)).collect(),
            guesses: probes.iter().map(|p| single(&p.guess)).collect(),
        })?;
        match self.answer()? {
            Reply::Found(found) if found.len() == probes.len() => Ok(found
                .into_iter()
                .map(|answer| match answer {
                    Some([x, y, difference]) => {
                        Found::At { position: Point2::new(f64::from(x), f64::from(y)), difference: f64::from(difference) }
                    }
                    None => Found::Lost,
                })
                .collect()),
            other => Err(Answer::Said(other).unexpected().into()),
        }
    }
}
