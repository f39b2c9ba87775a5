//! Converts the FAPs of a file to offsets of all nodes.
//!
//! A FAP moves its driving node along one axis. Candide-3's own vector for the same FAP lists companion nodes (the lid's outer parts
//! for its middle, the underside of the brow for its top), which follow in the vector's proportions. The springs place all other nodes.
//! Eye corners, the nose bone and the skull do not move. A weak pull draws every other node towards rest, so that a motion stays in its region.

use std::collections::BTreeMap;

use nalgebra::{Matrix2, Point2, Vector2};

use super::{CloneError, source::normalizer};
use crate::{
    fap::{FapCatalog, FapFrame, FapMotion, FapNumber, FapSequence, offsets_from_frame},
    fit::{DrivenNode, Pull, Springs},
    normalize::stable_nodes,
    units::NodeId,
    wireframe::{Axis, Face, Region, UnitKind},
};

/// Gain of a node driven by a FAP, relative to the stiffness of a spring: practically exact.
const DRIVEN: f64 = 1e6;
/// Gain of a companion node.
const COMPANION: f64 = 40.0;
/// Gain along an axis that nothing drives.
const FREE: f64 = 1e-6;
/// Gain that pulls other nodes to rest.
const REST: f64 = 0.4;
/// The same for brows that nothing drives, and for lids if brows are driven: a closing lid does not pull the brow down, and a raised
/// brow does not open the eye.
const REST_BROW: f64 = 6.0;
/// The same, across the face, for lips if cheeks are driven and neither lips nor jaw are: a puffed cheek stands off from the teeth, and the
/// muscle around the mouth holds the lips shut and in place.
const REST_LIPS: f64 = 20.0;

/// Offsets of all nodes for each frame.
type NodeOffsets = Vec<Vec<Vector2<f64>>>;

/// Computes the offsets of all nodes from neutral for each frame, in face units, and the FAPs with values that do not show from the front.
/// A FAP that a frame leaves out is interpolated ([`FapSequence::fill_gaps`]).
pub fn offsets(name: &str, sequence: &FapSequence, face: &Face) -> Result<(NodeOffsets, Vec<FapNumber>), CloneError> {
    let catalog = FapCatalog::mpeg4();
    let sequence = &{
        let mut sequence = sequence.clone();
        sequence.fill_gaps();
        sequence
    };
    let normalizer = normalizer(face)?;
    let canonical = normalizer.canonical();
    let rest = canonical.neutral.nodes();
    if sequence.frames.is_empty() {
        return Err(CloneError::NoFrames { path: name.to_owned() });
    }
    let (shown, not_shown): (Vec<_>, Vec<_>) =
        sequence.moving_faps().into_iter().partition(|&fap| catalog.row(fap).shows_from_front());
    if shown.is_empty() && !not_shown.is_empty() {
        let faps = not_shown.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
        return Err(CloneError::NothingToShow { path: name.to_owned(), faps });
    }
    let companions = companions(face, catalog);
    let springs = Springs::new(&face.wireframe);
    let still: Vec<NodeId> = still_nodes(face);
    let mut frames = Vec::with_capacity(sequence.frames.len());
    for frame in &sequence.frames {
        let driven = offsets_from_frame(&with_lids_that_meet(frame), &canonical.fapus, catalog)?;
        // Offset and gain along x and y of every driven or companion node.
        let mut wanted: BTreeMap<NodeId, [Option<(f64, f64)>; 2]> = BTreeMap::new();
        for (&node, offset) in &driven {
            let slot = wanted.entry(node).or_default();
            slot[0] = offset.x.map(|v| (v, DRIVEN));
            slot[1] = offset.y.map(|v| (v, DRIVEN));
        }
        for &(driver, node, axis, share) in &companions {
            let Some(offset) = driven.get(&driver) else { continue };
            let (place, value) = if axis == Axis::X { (0, offset.x) } else { (1, offset.y) };
            if let Some(value) = value {
                let slot = &mut wanted.entry(node).or_default()[place];
                if slot.is_none() {
                    *slot = Some((value * share, COMPANION));
                }
            }
        }
        let drives = |region: Region| driven.keys().any(|&node| face.tables.region(node) == region);
        let holds_lips = drives(Region::Cheek) && !drives(Region::Mouth) && !drives(Region::Jaw);
        let mut targets: Vec<DrivenNode> = Vec::new();
        for &node in face.wireframe.live_nodes() {
            let at = rest[node.index()];
            if let Some(&[x, y]) = wanted.get(&node) {
                let (x, gain_x) = x.unwrap_or((0.0, FREE));
                let (y, gain_y) = y.unwrap_or((0.0, FREE));
                let gain = Matrix2::new(gain_x, 0.0, 0.0, gain_y);
                targets.push(DrivenNode { node, position: at + Vector2::new(x, y), pull: Pull::Matrix(gain) });
            } else if holds_lips && face.tables.region(node) == Region::Mouth {
                let pull = Pull::Matrix(Matrix2::new(REST_LIPS, 0.0, 0.0, REST));
                targets.push(DrivenNode { node, position: at, pull });
            } else {
                let gain = match face.tables.region(node) {
                    _ if still.contains(&node) => DRIVEN,
                    Region::Brow => REST_BROW,
                    Region::Eye if drives(Region::Brow) => REST_BROW,
                    _ => REST,
                };
                targets.push(DrivenNode { node, position: at, pull: Pull::Force(gain) });
            }
        }
        let moved: Vec<Point2<f64>> = springs.deform(&face.wireframe, rest, &targets)?;
        frames.push(moved.iter().zip(rest).map(|(p, r)| p - r).collect());
    }
    Ok((frames, not_shown))
}

/// The FAPs of the upper and the lower lid, of either eye.
const LIDS: [(u8, u8); 2] = [(19, 21), (20, 22)];
/// Sum of the closing of both lids of an eye at which they meet.
const SHUT: f64 = 1024.0;

/// Limits the closing of lids to where they meet; each gives way in proportion.
fn with_lids_that_meet(frame: &FapFrame) -> FapFrame {
    let mut frame = frame.clone();
    for lids in LIDS {
        let Some([upper, lower]) = FapNumber::try_from(lids.0).ok().zip(FapNumber::try_from(lids.1).ok()).map(<[_; 2]>::from)
        else {
            continue;
        };
        let closing = [upper, lower].map(|fap| frame.value(fap).unwrap_or(0.0).max(0.0));
        // A lid that opens gives the other one room.
        let room = [upper, lower].map(|fap| frame.value(fap).unwrap_or(0.0).min(0.0)).iter().sum::<f64>();
        let share = (SHUT - room) / (closing[0] + closing[1]).max(1e-9);
        if share < 1.0 {
            for (fap, value) in [upper, lower].into_iter().zip(closing).filter(|(_, value)| *value > 0.0) {
                frame.set_value(fap, Some(value * share));
            }
        }
    }
    frame
}

/// Nodes that no expression moves: eye corners and nose bone, the skull's outline, the irises (driven by the gaze or at rest).
fn still_nodes(face: &Face) -> Vec<NodeId> {
    let mut still: Vec<NodeId> =
        stable_nodes(&face.tables, face.wireframe.node_count()).into_iter().map(|k| NodeId(k as u16)).collect();
    let catalog = FapCatalog::mpeg4();
    let gaze = catalog.rows().iter().filter(|r| !r.relative_to.is_empty()).flat_map(|r| r.nodes.iter().copied());
    still.extend(gaze);
    // Everything well above the brow line is fixed.
    let top = (0..face.wireframe.node_count() as u16).map(NodeId).filter(|&n| {
        let high = face.wireframe.vertices()[n.index()].y > 0.75;
        high && matches!(face.tables.region(n), Region::Forehead | Region::Contour)
    });
    still.extend(top);
    still.sort_unstable();
    still.dedup();
    still
}

/// Companions from the FAP vectors of the wireframe: driving node, companion node, axis, and fraction of the motion.
fn companions(face: &Face, catalog: &FapCatalog) -> Vec<(NodeId, NodeId, Axis, f64)> {
    let mut found = Vec::new();
    for unit in face.wireframe.action_units() {
        let UnitKind::Fap { number, .. } = unit.kind else { continue };
        let Some(row) = u8::try_from(number).ok().and_then(|n| FapNumber::try_from(n).ok()).map(|f| catalog.row(f)) else {
            continue;
        };
        let Some(axis) = row.motion.and_then(FapMotion::frontal_axis) else { continue };
        let ([driver], true) = (row.nodes.as_slice(), row.relative_to.is_empty()) else { continue };
        let along = |v: &nalgebra::Vector3<f64>| if axis == Axis::X { v.x } else { v.y };
        let Some(own) = unit.offsets.iter().find(|o| o.0 == *driver).map(|o| along(&o.1)).filter(|v| *v != 0.0) else { continue };
        for (node, offset) in unit.offsets.iter().filter(|o| o.0 != *driver && along(&o.1) != 0.0) {
            found.push((*driver, *node, axis, along(offset) / own));
        }
    }
    // The lips are joined at their ends: if a file moves the inner corners alone, the outer ones follow.
    for (inner, outer) in [(88, 31), (89, 64)] {
        found.extend([Axis::X, Axis::Y].map(|axis| (NodeId(inner), NodeId(outer), axis, 1.0)));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lids_close_until_they_meet() {
        let frame = |values: &[(u8, f64)]| {
            let mut frame = FapFrame::default();
            values.iter().for_each(|&(fap, value)| frame.set_value(FapNumber::try_from(fap).unwrap(), Some(value)));
            with_lids_that_meet(&frame)
        };
        let value = |frame: &FapFrame, fap: u8| frame.value(FapNumber::try_from(fap).unwrap());
        let far = frame(&[(19, 5000.0), (20, 900.0), (22, 300.0), (3, 2000.0)]);
        assert_eq!((value(&far, 19), value(&far, 21), value(&far, 3)), (Some(1024.0), None, Some(2000.0)));
        // Together 1200: each gives way by 176 / 1200 of its own value.
        assert_eq!((value(&far, 20), value(&far, 22)), (Some(900.0 * (1024.0 / 1200.0)), Some(300.0 * (1024.0 / 1200.0))));
        // A lower lid that opens by 500 lets the upper one follow; lids that do not meet are unchanged.
        let open = frame(&[(19, 1500.0), (21, -500.0), (20, 700.0), (22, 300.0)]);
        assert_eq!((value(&open, 19), value(&open, 20), value(&open, 22)), (Some(1500.0), Some(700.0), Some(300.0)));
    }

    #[test]
    fn inner_corners_of_the_mouth_take_the_outer_ones_along() {
        let mut frame = FapFrame::default();
        [6, 7, 12, 13].into_iter().for_each(|fap| frame.set_value(FapNumber::try_from(fap).unwrap(), Some(300.0)));
        let sequence = FapSequence { version: "2.1".to_owned(), name: "lips".to_owned(), fps: 25.0, frames: vec![frame] };
        let (frames, _) = offsets("lips", &sequence, &Face::candide3()).unwrap();
        for (inner, outer) in [(88, 31), (89, 64)] {
            let (inner, outer) = (frames[0][inner], frames[0][outer]);
            assert!(inner.norm() > 20.0 && (outer - inner).norm() < 0.2 * inner.norm(), "{inner} {outer}");
        }
    }

    #[test]
    fn brows_that_rise_leave_the_lids_where_they_are() {
        let mut frame = FapFrame::default();
        (31..=36).for_each(|fap| frame.set_value(FapNumber::try_from(fap).unwrap(), Some(400.0)));
        let sequence = FapSequence { version: "2.1".to_owned(), name: "brows".to_owned(), fps: 25.0, frames: vec![frame] };
        let (frames, _) = offsets("brows", &sequence, &Face::candide3()).unwrap();
        let up = |node: usize| frames[0][node].y;
        // The middle of the upper lid and of the brow, on either side.
        for (lid, brow) in [(21, 16), (54, 49)] {
            assert!(up(brow) > 0.0 && up(lid).abs() < 0.15 * up(brow), "{} of {}", up(lid), up(brow));
        }
    }
}
