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

/// Returns a track's model without the head's turns; `None` when the head does not turn or no head fits.
pub(crate) fn without_turns(
    face: &Face,
    frames: &[TrackedFrame],
    marks: &[(NodeId, Point2<f64>)],
) -> Option<DynamicExpressionModel<Px>> {
    let fitter = HeadFitter::new(&face.wireframe, &face.tables);
    let fit = fitter.fit(&face.tables, frames, marks).ok()?;
    let angles: Vec<[f64; 3]> = fit.poses.iter().map(HeadPose::degrees).collect();
    let [yaw, pitch, _] = *angles.first()?;
    let turn = angles.iter().map(|[y, p, _]| (y - yaw).abs().max((p - pitch).abs())).fold(0.0, f64::max);
    if turn < TURNED {
        return None;
    }
    fitter.frontal((&face.wireframe, &face.tables), &fit, frames).ok()
}
