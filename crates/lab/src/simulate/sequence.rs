//! A simulated sequence in memory: the picture and the position of every node for each frame.

use std::borrow::Borrow;

use image::RgbImage;
use nalgebra::{Point2, Point3, Vector3};

use super::{
    Emotion, SimulateError, SimulateOptions,
    blink::{Blink, close_lids},
    camera::develop,
    expression::apex_offsets,
    motion::{Course, HeadPose},
    render::{Film, render},
    subject::{Subject, place_followers},
};
use grimace::internal::wireframe::Wireframe;

/// A frame with its ground truth.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedFrame {
    /// The picture.
    pub image: RgbImage,
    /// Exact image positions (pixels) of all N nodes, in node order.
    pub nodes: Vec<Point2<f64>>,
}

/// A subject's performance of one emotion.
#[derive(Clone, Debug)]
pub struct SimulatedSequence<S: Borrow<Subject>> {
    subject: S,
    options: SimulateOptions,
    emotion: Emotion,
    course: Course,
    blink: Option<Blink>,
    wireframe: Wireframe,
    apex: Vec<Vector3<f64>>,
}

impl<S: Borrow<Subject>> SimulatedSequence<S> {
    /// Makes the sequence of a subject that was made with the same options.
    ///
    /// # Errors
    /// [`SimulateError`] when the options are out of range.
    pub fn new(subject: S, emotion: Emotion, options: &SimulateOptions) -> Result<Self, SimulateError> {
        options.check()?;
        let wireframe = Wireframe::candide3();
        let who: &Subject = subject.borrow();
        let apex = apex_offsets(&wireframe, who.fapus(), emotion, who.strength(), options.seed, who.index());
        let course = Course::new(options, who.index(), emotion);
        let blink = Blink::new(options, who.index(), emotion.code());
        Ok(Self { subject, options: options.clone(), emotion, course, blink, wireframe, apex })
    }

    /// Returns the number of frames.
    pub fn frame_count(&self) -> usize {
        self.options.frames
    }

    /// Returns the head pose in a frame, `frame` in `0..frame_count()`.
    pub fn pose(&self, frame: usize) -> HeadPose {
        self.course.pose(frame as f64)
    }

    /// Returns the exact image positions of all N nodes in a frame, pixels, at the middle of its exposure.
    pub fn nodes(&self, frame: usize) -> Vec<Point2<f64>> {
        self.nodes_at(frame as f64)
    }

    /// Returns the picture of a frame.
    pub fn image(&self, frame: usize) -> RgbImage {
        let subject = self.subject.borrow();
        let size = (self.options.width, self.options.height);
        let mut film = Film::new(size);
        for time in self.options.camera.exposure_times(frame, self.extent(frame)) {
            let offsets = self.offsets(time);
            film.expose(&render(subject, &subject.texture.folded(&offsets), &offsets, &self.course.pose(time), size));
        }
        develop(film.exposure(subject.appearance().background), &self.options, subject.index(), self.emotion.code(), frame)
    }

    /// Returns the offsets from neutral at a time in frames, in model units of face space.
    pub(super) fn offsets(&self, time: f64) -> Vec<Vector3<f64>> {
        let intensity = self.course.intensity(time);
        let mut offsets: Vec<Vector3<f64>> = self.apex.iter().map(|d| d * intensity).collect();
        if let Some(blink) = &self.blink {
            close_lids(self.subject.borrow().neutral(), &mut offsets, blink.closure(time));
        }
        offsets
    }

    fn nodes_at(&self, time: f64) -> Vec<Point2<f64>> {
        let pose = self.course.pose(time);
        let offsets = self.offsets(time);
        let mut nodes: Vec<Point3<f64>> = self.subject.borrow().neutral().iter().zip(&offsets).map(|(n, d)| n + d).collect();
        place_followers(&self.wireframe, &mut nodes);
        nodes.iter().map(|n| pose.project(n)).collect()
    }

    /// Returns the motion of the fastest node while the shutter is open, pixels.
    fn extent(&self, frame: usize) -> f64 {
        let half = self.options.camera.shutter / 2.0;
        if half == 0.0 {
            return 0.0;
        }
        let [open, close] = [-half, half].map(|dt| self.nodes_at(frame as f64 + dt));
        open.iter().zip(&close).map(|(a, b)| (b - a).norm()).fold(0.0, f64::max)
    }

    /// Returns the picture and nodes of a frame.
    pub fn frame(&self, frame: usize) -> SimulatedFrame {
        SimulatedFrame { image: self.image(frame), nodes: self.nodes(frame) }
    }
}

/// Returns the picture and nodes of one frame of a subject's sequence, `frame` in `0..options.frames`.
///
/// # Errors
/// [`SimulateError`] when the options or the frame are out of range.
pub fn render_frame(
    subject: &Subject,
    emotion: Emotion,
    options: &SimulateOptions,
    frame: usize,
) -> Result<SimulatedFrame, SimulateError> {
    if frame >= options.frames {
        return Err(SimulateError::OutOfRange {
            option: "frames",
            value: frame.to_string(),
            range: "more than the index of the frame that is asked for",
        });
    }
    Ok(SimulatedSequence::new(subject, emotion, options)?.frame(frame))
}

/// The frames of one sequence, neutral to apex.
#[derive(Debug)]
pub struct SimulatedFrames {
    sequence: SimulatedSequence<Subject>,
    next: usize,
}

impl Iterator for SimulatedFrames {
    type Item = SimulatedFrame;

    fn next(&mut self) -> Option<SimulatedFrame> {
        let frame = (self.next < self.sequence.frame_count()).then(|| self.sequence.frame(self.next))?;
        self.next += 1;
        Some(frame)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.sequence.frame_count() - self.next;
        (left, Some(left))
    }
}

impl ExactSizeIterator for SimulatedFrames {}

/// Returns the frames of the sequence of subject `subject` (from 0) with the given emotion, rendered one at a time.
///
/// # Errors
/// [`SimulateError`] when the options are out of range.
pub fn simulate_sequence(options: &SimulateOptions, subject: u32, emotion: Emotion) -> Result<SimulatedFrames, SimulateError> {
    let subject = Subject::new(options, subject)?;
    Ok(SimulatedFrames { sequence: SimulatedSequence::new(subject, emotion, options)?, next: 0 })
}
