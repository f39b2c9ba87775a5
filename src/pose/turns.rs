//! Removes the turns of a track's head before its motion is shown on another face.

use nalgebra::Point2;

use super::{HeadFitter, HeadPose};
use crate::{
    model::DynamicExpressionModel,
    track::TrackedFrame,
    units::{NodeId, Px},
    wireframe::Face,
};

/// Turn of the head relative to the neutral frame, degrees, from which it is removed. Smaller turns are not known accurately enough.
const TURNED: f64 = 4.0;

/// How the head turns in a track.
#[derive(Clone, Debug)]
pub(crate) struct Turns {
    /// Yaw, pitch and roll of every frame relative to the first one, degrees.
    pub angles: Vec<[f64; 3]>,
    /// The track's model without yaw and pitch; `None` when they are small.
    pub removed: Option<DynamicExpressionModel<Px>>,
}

/// Finds the head's turns in a track; `None` when no head fits.
pub(crate) fn turns(face: &Face, frames: &[TrackedFrame], marks: &[(NodeId, Point2<f64>)]) -> Option<Turns> {
    let fitter = HeadFitter::new(&face.wireframe, &face.tables);
    let fit = fitter.fit(&face.tables, frames, marks).ok()?;
    let angles: Vec<[f64; 3]> = fit.poses.iter().map(HeadPose::degrees).collect();
    let first = *angles.first()?;
    let angles: Vec<[f64; 3]> = angles.iter().map(|angles| std::array::from_fn(|k| angles[k] - first[k])).collect();
    let turn = angles.iter().map(|[yaw, pitch, _]| yaw.abs().max(pitch.abs())).fold(0.0, f64::max);
    let frontal = || fitter.frontal((&face.wireframe, &face.tables), &fit, frames).ok();
    let removed = if turn < TURNED { None } else { frontal() };
    Some(Turns { angles, removed })
}

/// Returns a track's model without the head's turns; `None` when the head does not turn or no head fits.
pub(crate) fn without_turns(
    face: &Face,
    frames: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Option<DynamicExpressionModel<Px>> {
    turns(face, frames, marks)?.removed
}
