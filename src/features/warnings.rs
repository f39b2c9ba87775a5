//! Reasons to look at a track that its head pose and its motion give.

use super::TRUSTED_TURN;
use crate::{
    model::DynamicExpressionModel,
    pose::{HeadFit, HeadPose},
    robust::median,
    track::{TrackedFrame, backwards_said, eye_distance_px},
    units::{NodeId, Px},
    wireframe::{Region, Tables},
};

/// Returns a warning if the head turns too far for reliable values; `None` otherwise.
pub fn turn_warning(fit: &HeadFit, track: &[TrackedFrame]) -> Option<String> {
    let turn = |(pose, frame): (&HeadPose, &TrackedFrame)| {
        let [yaw, pitch, _] = pose.degrees();
        (yaw.abs().max(pitch.abs()), frame.number)
    };
    let (largest, frame) = fit.poses.iter().zip(track).map(turn).max_by(|a, b| a.0.total_cmp(&b.0))?;
    (largest > TRUSTED_TURN).then(|| {
        format!("the head is turned by {largest:.0} degrees in frame {frame}; models are reliable up to about {TRUSTED_TURN:.0} degrees")
    })
}

/// Returns a warning if frames have no pose; `None` if all have one.
pub fn pose_warning(fit: &HeadFit, track: &[TrackedFrame]) -> Option<String> {
    let failed: Vec<u32> = fit.failures.iter().zip(track).filter(|(f, _)| f.is_some()).map(|(_, frame)| frame.number).collect();
    let first = failed.iter().min()?;
    Some(format!("found no head pose in {} of {} frames, first in frame {first}", failed.len(), track.len()))
}

/// Order ([`FeatureMeter::order`]) below which a sequence is reported as possibly played backwards. Chosen so that there is no false report
/// among 50 sequences of photographs, morphs and videos and 90 smiles by landmarks in two pictures alone. For its detections, and for those
/// of 90 smiles tracked in two photographs, see docs/evaluation.md.
const BACKWARDS: f64 = -0.07;

/// Returns a warning for a sequence whose apex seems to come first; `None` otherwise.
pub fn order_warning(order: f64, track: &[TrackedFrame]) -> Option<String> {
    let [first, .., last] = track else { return None };
    let why =
        format!("action units explain the motion from frame {} to frame {} better than its reverse", last.number, first.number);
    (order < BACKWARDS).then(|| backwards_said(&why, first.number, last.number))
}

/// Share of the largest motion that the last frame of a sequence has at least. Of 50 sequences of photographs, morphs and videos, which end at
/// the apex, none has less than 0.9.
const LEAST_AT_APEX: f64 = 0.75;
/// Smallest motion that counts, over the eye separation: the mean over the nodes. Weak expressions have twice as much.
const LEAST_MOTION: f64 = 0.008;

/// Returns a warning for a sequence that goes on after its apex; `None` otherwise. `model`: the track without head motion.
///
/// The eyes do not count, because they blink. The largest motion is that of three frames (their median).
pub fn apex_warning(model: &DynamicExpressionModel<Px>, track: &[TrackedFrame], tables: &Tables) -> Option<String> {
    let unit = eye_distance_px(tables, model.neutral().nodes())?;
    let counts = |k: usize| !matches!(tables.region(NodeId(k as u16)), Region::Eye | Region::Forehead | Region::Contour);
    let motion = |m: usize| {
        let lengths = model.neutral_offsets(m).into_iter().enumerate().filter(|(k, _)| counts(*k)).map(|(_, v)| v.norm());
        let (sum, count) = lengths.fold((0.0, 0_usize), |(sum, count), length| (sum + length, count + 1));
        sum / count.max(1) as f64 / unit
    };
    let motions: Vec<f64> = (0..model.frame_count()).map(motion).collect();
    let [.., before, at_end] = motions[..] else { return None };
    // The median of three frames is the motion of one of them.
    let medians = motions.windows(3).enumerate().filter_map(|(begin, three)| {
        let middle = median(&mut three.to_vec())?;
        Some((begin + three.iter().position(|motion| *motion == middle)?, middle))
    });
    let (place, largest) = medians.max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)))?;
    let (apex, last) = (track.get(place)?.number, track.last()?.number);
    (largest > LEAST_MOTION && before.max(at_end) < LEAST_AT_APEX * largest).then(|| {
        format!(
            "the face moves most in frame {apex} and has gone back by {:.0} % in frame {last}, where the apex should be: set frame {apex} as \
             last_frame, or `segment` to `auto` to have the expressions of a recording found",
            100.0 * (1.0 - at_end / largest)
        )
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::{
        model::FrameExpressionModel,
        track::{NodeState, TrackedNode},
        wireframe::Wireframe,
    };

    /// The warning for a face whose lips go down by so many eye separations in each frame.
    fn said(motion: &[f64]) -> Option<String> {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let neutral: Vec<Point2<f64>> =
            wireframe.frontal().iter().map(|p| Point2::new(300.0 + 100.0 * p.x, 300.0 - 100.0 * p.y)).collect();
        let unit = eye_distance_px(&tables, &neutral).unwrap();
        let moved = |by: f64| -> Vec<Point2<f64>> {
            let is_mouth = |k: usize| tables.region(NodeId(k as u16)) == Region::Mouth;
            neutral.iter().enumerate().map(|(k, p)| Point2::new(p.x, p.y + if is_mouth(k) { by * unit } else { 0.0 })).collect()
        };
        let frames = motion.iter().map(|&by| FrameExpressionModel::new(moved(by))).collect();
        let node = |position: Point2<f64>| TrackedNode::new(position, NodeState::Tracked, None);
        let track: Vec<TrackedFrame> = motion
            .iter()
            .zip(7..)
            .map(|(&by, number)| TrackedFrame { number, nodes: moved(by).into_iter().map(node).collect() })
            .collect();
        apex_warning(&DynamicExpressionModel::new(frames).unwrap(), &track, &tables)
    }

    #[test]
    fn a_sequence_that_goes_on_after_its_apex_is_told_where_it_is() {
        let text = said(&[0.0, 0.1, 0.2, 0.2, 0.2, 0.1, 0.1]).unwrap();
        assert!(text.starts_with("the face moves most in frame 9 and has gone back by 50 % in frame 13"), "{text}");
        for good in [&[0.0, 0.1, 0.2][..], &[0.0, 0.2], &[0.0, 0.1, 0.2, 0.2, 0.17, 0.17], &[0.0, 0.01, 0.01, 0.01, 0.0, 0.0]] {
            assert_eq!(said(good), None, "{good:?}");
        }
        // The frame that is named moves.
        assert!(
            said(&[0.0, 0.2, 0.02, 0.2, 0.05, 0.05, 0.0])
                .unwrap()
                .starts_with("the face moves most in frame 8 and has gone back by 100 %")
        );
        // One frame that is off.
        assert_eq!(said(&[0.0, 0.1, 0.4, 0.1, 0.1, 0.1]), None);
    }
}
