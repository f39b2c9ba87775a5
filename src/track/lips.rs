//! Corrects lips that the locator sees elsewhere. This is not part of KP.
//!
//! When a mouth opens wide, the skin of the inner lips turns out of sight, and teeth and tongue appear where it was. KLT then follows the
//! tongue, and the alignment with the neutral frame, whose mouth is closed, cannot tell. The locator has learned open mouths: it reads the
//! lips in the neutral and in the current frame, each time from the neutral face, moved as a whole with eyes and nose. The difference of the two readings is a
//! second measurement of the motion; errors that both readings share cancel. The tracker is the more precise of the two as long as it
//! follows the lip itself, so a node is only moved if the two differ by more than readings usually err.

use std::{cell::OnceCell, collections::BTreeSet};

use nalgebra::{Point2, Vector2};

use super::{TrackedNode, leap::Leap};
use crate::{
    geometry::Similarity,
    locate::{FacePart, LIP_LINES, LocatedFace, Locator, ReadNodes, points},
    robust::median,
    sequence::Frame,
    units::NodeId,
    wireframe::Tables,
};

/// Growth of the tracked distance between the lips since the neutral frame, over the eye distance, from which the lips are read: as long as
/// they are closed, the tracker follows their skin.
const OPENED: f64 = 0.04;
/// Distance between the lips as read, over the eye distance, from which the mouth is open.
const OPEN: f64 = 0.06;
/// Difference of the measured motions, over the eye distance, up to which a node stays as tracked, and from which it moves by [`MOST`].
const DIFFERS: (f64, f64) = (0.06, 0.12);
/// Largest share of the way to where the lip is read that a node moves.
const MOST: f64 = 0.8;
/// Nodes of the base of the nose and of the chin.
const NOSE: NodeId = NodeId(6);
const CHIN: NodeId = NodeId(10);
/// Parts of the face that no expression moves far.
const STILL: [&str; 3] = ["eye corner", "nose", "nose tip"];

/// The lips of the neutral frame.
#[derive(Debug)]
pub struct Lips {
    /// Lips as read in the neutral frame; `None` if they cannot be read there.
    rest: OnceCell<Option<ReadNodes>>,
    /// Nodes that were set by hand.
    released: BTreeSet<NodeId>,
}

impl Lips {
    /// `None` for a wireframe without Candide-3's lips, which the locator reads.
    pub fn new(tables: &Tables) -> Option<Self> {
        let is_at = |(fp, node): (&str, NodeId)| fp.parse().ok().and_then(|fp| tables.feature_point_nodes(fp)) == Some(&[node]);
        let [_, upper, lower, _] = LIP_LINES[1];
        let is_candide = [("2.2", upper), ("2.3", lower), ("9.15", NOSE), ("2.1", CHIN)].into_iter().all(is_at);
        is_candide.then(|| Self { rest: OnceCell::new(), released: BTreeSet::new() })
    }

    /// Stops correcting a node that was set by hand.
    pub fn release(&mut self, node: NodeId) {
        self.released.insert(node);
    }

    /// Moves lips of a tracked frame towards where they are read. `neutral`: the neutral frame with its nodes; `unit`: its eye distance, px.
    pub fn place(&self, neutral: &Leap, frame: &Frame, unit: f64, nodes: &mut [TrackedNode]) {
        let motion = |node: NodeId| Some(nodes.get(node.index())?.position - neutral.nodes().get(node.index())?);
        let [_, upper, lower, _] = LIP_LINES[1];
        let below_nose = nodes.get(CHIN.index()).zip(nodes.get(NOSE.index())).map(|(chin, nose)| chin.position - nose.position);
        let Some(down) = below_nose.and_then(|way| way.try_normalize(0.0)) else { return };
        let opened = motion(lower).zip(motion(upper)).is_some_and(|(lower, upper)| (lower - upper).dot(&down) > OPENED * unit);
        if !opened {
            return;
        }
        let Some((locator, face)) = Locator::shipped().ok().zip(neutral.face()) else { return };
        if face.covered.contains(&FacePart::Mouth) {
            return;
        }
        let rest = self.rest.get_or_init(|| locator.read_mouth(neutral.image(), &face.shape));
        let Some(start) = carried(face, motion) else { return };
        let Some((rest, read)) = rest.as_ref().zip(locator.read_mouth(frame.image(), &start)) else { return };
        let of = |read: &[(NodeId, Point2<f64>)], node: NodeId| read.iter().find(|(known, _)| *known == node).map(|(_, at)| *at);
        let is_open =
            of(&read, upper).zip(of(&read, lower)).is_some_and(|(upper, lower)| (lower - upper).dot(&down) > OPEN * unit);
        if !is_open {
            return;
        }
        // By how much the motion as read exceeds the motion as tracked.
        let excess = |node: NodeId| Some(of(&read, node)? - of(rest, node)? - motion(node)?);
        let shift = middle(nose().filter_map(excess));
        let steps: Vec<(NodeId, Vector2<f64>)> = LIP_LINES
            .into_iter()
            .flatten()
            .filter(|node| !self.released.contains(node))
            .filter_map(|node| {
                let way = excess(node)? - shift;
                let share = (way.norm() / unit - DIFFERS.0) / (DIFFERS.1 - DIFFERS.0);
                (share > 0.0).then(|| (node, way * (MOST * share.min(1.0))))
            })
            .collect();
        for (node, step) in steps {
            nodes[node.index()].position += step;
        }
    }
}

/// Nodes of the nose, which no expression moves far.
fn nose() -> impl Iterator<Item = NodeId> {
    points().iter().filter(|point| point.group == "nose").filter_map(|point| point.node)
}

/// Returns the median of vectors, for each axis; zero for none.
fn middle(ways: impl Iterator<Item = Vector2<f64>>) -> Vector2<f64> {
    let (mut x, mut y): (Vec<f64>, Vec<f64>) = ways.map(|way| (way.x, way.y)).unzip();
    Vector2::new(median(&mut x).unwrap_or(0.0), median(&mut y).unwrap_or(0.0))
}

/// Returns the points of the neutral face moved as a whole with nodes that no expression moves.
fn carried(face: &LocatedFace, motion: impl Fn(NodeId) -> Option<Vector2<f64>>) -> Option<Vec<Point2<f64>>> {
    let still = points().iter().zip(&face.shape).filter(|(point, _)| STILL.contains(&point.group.as_str()));
    let (from, to): (Vec<_>, Vec<_>) = still.filter_map(|(point, at)| Some((*at, at + motion(point.node?)?))).unzip();
    let whole = Similarity::fit(&from, &to, None).ok()?;
    Some(face.shape.iter().map(|p| whole.apply(p)).collect())
}

#[cfg(test)]
mod tests {
    use image::DynamicImage;

    use super::*;
    use crate::{
        clone::{CloneOptions, SourceMotion, clone_expression, test_target::portrait_target},
        fap::{FapFrame, FapNumber, FapSequence},
        track::NodeState,
        wireframe::Face,
    };

    /// The portrait with its mouth open, and its nodes there.
    fn open_mouth() -> (Frame, Vec<Point2<f64>>) {
        let face = Face::candide3();
        let mut frame = FapFrame::default();
        for (fap, value) in [(3, 900.0), (5, -1000.0), (10, -700.0), (11, -700.0), (52, -950.0), (57, -700.0), (58, -700.0)] {
            frame.set_value(FapNumber::try_from(fap).unwrap(), Some(value));
        }
        let faps = FapSequence { version: "2.1".to_owned(), name: "open".to_owned(), fps: 25.0, frames: vec![frame] };
        let source = SourceMotion::from_fap("open", &faps, &face).unwrap();
        let clone = clone_expression(&source, portrait_target(), None, &CloneOptions::default(), &face).unwrap();
        let last = clone.frames.len() - 1;
        (frame_of(2, clone.picture(last).unwrap()), clone.frames[last].deformation.nodes().to_vec())
    }

    fn frame_of(number: u32, picture: image::RgbImage) -> Frame {
        Frame::new(number, DynamicImage::ImageRgb8(picture).into_luma8())
    }

    fn tracked(nodes: &[Point2<f64>]) -> Vec<TrackedNode> {
        nodes.iter().map(|p| TrackedNode::new(*p, NodeState::Tracked, None)).collect()
    }

    #[test]
    fn a_lower_lip_on_the_tongue_moves_to_the_lip_and_hand_set_nodes_stay() {
        let target = portrait_target();
        let (rest, unit) = (target.warp().nodes().to_vec(), target.fapus.es);
        let neutral = Leap::new(&frame_of(1, target.picture.clone()), &rest);
        let (frame, truth) = open_mouth();
        let mut lips = Lips::new(&Face::candide3().tables).unwrap();
        let lower = [83, 40, 84];
        assert!(truth[40].y - rest[40].y > 0.25 * unit, "the mouth is wide open");
        let mut nodes = tracked(&truth);
        lower.iter().for_each(|&k| nodes[k].position.y -= 0.17 * unit);
        let (before, mut by_hand) = (nodes.clone(), nodes.clone());
        lips.place(&neutral, &frame, unit, &mut nodes);
        let off = |nodes: &[TrackedNode]| lower.iter().map(|&k| (nodes[k].position - truth[k]).norm()).sum::<f64>();
        assert!(off(&nodes) < 0.6 * off(&before), "{} {}", off(&nodes) / unit, off(&before) / unit);
        // Only lips move.
        let of_lips: Vec<usize> = LIP_LINES.into_iter().flatten().map(NodeId::index).collect();
        assert!((0..nodes.len()).filter(|k| !of_lips.contains(k)).all(|k| nodes[k] == before[k]));
        // A closed mouth stays as tracked, wherever that is, and so do nodes set by hand.
        let mut closed = tracked(&rest);
        lips.place(&neutral, &frame_of(2, target.picture.clone()), unit, &mut closed);
        assert_eq!(closed, tracked(&rest));
        lips.release(NodeId(40));
        lips.place(&neutral, &frame, unit, &mut by_hand);
        assert!(by_hand[40] == before[40] && by_hand[83] == nodes[83]);
    }
}
