//! Tracks frame after frame.

use nalgebra::Point2;

use super::{
    NodeState, PointTracker, TrackError, TrackOptions, TrackPlan, TrackedFrame, TrackedNode, align, check_nodes, eye_distance_px,
    leap, lids, light, lips, step, window_px,
};
use crate::{
    fit::{FittedWireframe, MarkKind},
    sequence::{Frame, ImageSize},
    wireframe::Wireframe,
};

/// Tracks frame after frame and keeps only the last one; the caller stores the tracked frames. Expected errors are not filled in, because
/// they depend on the whole track ([`expect_errors`]).
pub struct FrameTracker<'a, T> {
    tracker: T,
    wireframe: &'a Wireframe,
    plan: &'a TrackPlan,
    options: &'a TrackOptions,
    template: Option<align::Template>,
    light: Option<light::Light>,
    lids: Option<lids::Lids>,
    lips: Option<lips::Lips>,
    pub(super) leap: Option<leap::Leap>,
    window: u32,
    eye_distance: f64,
    pub(super) size: ImageSize,
    sizes: Sizes,
    pub(super) last: TrackedFrame,
}

impl<'a, T: PointTracker> FrameTracker<'a, T> {
    /// Starts with the frame that the wireframe was fitted to.
    ///
    /// # Errors
    /// [`TrackError`] when the tracker cannot take the frame, for a plan or a fitted wireframe with other nodes, a frame without
    /// pixels, and options out of range.
    pub fn start(
        mut tracker: T,
        wireframe: &'a Wireframe,
        plan: &'a TrackPlan,
        fitted: &FittedWireframe,
        frame: &Frame,
        options: &'a TrackOptions,
    ) -> Result<Self, TrackError> {
        options.check()?;
        plan.check_wireframe(wireframe)?;
        let nodes = fitted.model.nodes();
        check_nodes("fitted wireframe", nodes.len(), wireframe.node_count())?;
        let mut sizes = Sizes::default();
        sizes.add(frame)?;
        let eye_distance = eye_distance_px(&plan.tables, nodes).unwrap_or(100.0);
        let window = window_px(&plan.tables, nodes, options);
        tracker.advance(frame)?;
        let template = plan.template(wireframe, &tracker, nodes, (window, eye_distance), &options.align)?;
        let light = options.even_light.then(|| light::Light::new(frame, wireframe.live_nodes(), nodes, window));
        let lids = options.read_lids.then(|| lids::Lids::new(frame, nodes));
        let leap = options.locates().then(|| leap::Leap::new(frame, nodes));
        let lips = options.read_lips.then(|| lips::Lips::new(&plan.tables)).flatten();
        let last = TrackedFrame { number: frame.number(), nodes: neutral_nodes(wireframe, fitted) };
        let size = frame.size();
        Ok(Self { tracker, wireframe, plan, options, template, light, lids, lips, leap, window, eye_distance, size, sizes, last })
    }

    /// The frame tracked last.
    pub fn last(&self) -> &TrackedFrame {
        &self.last
    }

    /// Tracks the next frame, forward or backward in time.
    ///
    /// # Errors
    /// [`TrackError`] for a lost face, a frame without pixels, more than two frames that are not of one size, and a tracker whose answers
    /// are not finite or not one for each point.
    pub fn step(&mut self, frame: &Frame) -> Result<&TrackedFrame, TrackError> {
        self.sizes.add(frame)?;
        let even = self.light.as_ref().and_then(|light| light.undone_at(frame, self.wireframe, &self.last));
        self.tracker.advance(even.as_ref().unwrap_or(frame))?;
        let Self { wireframe, plan, options, window, eye_distance, .. } = *self;
        let (template, lids, lips, leap) = (self.template.as_mut(), self.lids.as_ref(), self.lips.as_ref(), self.leap.as_ref());
        let mut step = step::Step { wireframe, plan, options, template, window, eye_distance, lids, lips, leap, frame };
        let nodes = step.run(&mut self.tracker, &self.last).map_err(|error| self.sizes.named_in(error))?;
        self.last = TrackedFrame { number: frame.number(), nodes };
        Ok(&self.last)
    }
}

/// Sizes of the frames so far. Two photographs alone may be cropped differently; of more frames, all have the size of the first.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sizes {
    first: Option<ImageSize>,
    /// Number and size of a second frame of another size.
    odd: Option<(u32, ImageSize)>,
    /// Number of frames.
    count: usize,
}

impl Sizes {
    /// Checks the next frame.
    ///
    /// # Errors
    /// [`TrackError::NoPixels`], [`TrackError::FrameSize`].
    pub fn add(&mut self, frame: &Frame) -> Result<(), TrackError> {
        let (number, size) = (frame.number(), frame.size());
        if size.width == 0 || size.height == 0 {
            return Err(TrackError::NoPixels { frame: number, size });
        }
        let expected = *self.first.get_or_insert(size);
        self.count += 1;
        self.odd = self.odd.or((size != expected).then_some((number, size)));
        match self.odd.filter(|_| self.count > 2) {
            Some((frame, found)) => Err(TrackError::FrameSize { frame, found, expected }),
            None => Ok(()),
        }
    }

    /// Returns the error of a step with the sizes of its frames, if they differ and the face is lost.
    pub fn named_in(&self, error: TrackError) -> TrackError {
        match (error, self.first, self.odd) {
            (TrackError::FaceLost { frame, found, live }, Some(expected), Some((_, size))) => {
                TrackError::FaceLostInOtherSize { frame, size, expected, found, live }
            }
            (error, ..) => error,
        }
    }
}

/// Returns the nodes of the neutral frame with their states: marked, corrected (set by hand), fitted, or following. Their expected error is
/// the error of their position on the face.
pub fn neutral_nodes(wireframe: &Wireframe, fitted: &FittedWireframe) -> Vec<TrackedNode> {
    let fit = |position: &Point2<f64>| TrackedNode::new(*position, NodeState::Fitted, None);
    let mut nodes: Vec<_> = fitted.model.nodes().iter().map(fit).collect();
    for (node, expected) in nodes.iter_mut().zip(fitted.expected_errors().unwrap_or_default()) {
        node.expected_error = Some(expected);
    }
    for follower in wireframe.followers() {
        if let Some(node) = nodes.get_mut(follower.node.index()) {
            node.state = NodeState::Follows;
        }
    }
    for (mark, residual) in fitted.correspondences.iter().zip(&fitted.residuals) {
        let Some(node) = nodes.get_mut(mark.node.index()) else { continue };
        node.residual = Some(*residual);
        node.state = match mark.kind {
            MarkKind::Mark => NodeState::Marked,
            MarkKind::Hard => NodeState::Corrected,
        };
    }
    nodes
}
