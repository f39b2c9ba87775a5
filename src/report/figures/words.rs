//! Describes differences between two expressions in words.

use std::collections::BTreeMap;

use nalgebra::Vector2;

use super::{Model, apex, offset};
use crate::{
    units::NodeId,
    wireframe::{Region, Tables},
};

/// Most parts of the face in a description, in order of decreasing difference.
const MOST_PARTS: usize = 6;
/// Smallest difference that is described, and smallest share of it at which a direction is named; face units.
const LEAST: f64 = 1.0;
const LEAST_SHARE: f64 = 0.35;
/// Distance from the middle of the face below which a node has no side, face units.
const MIDDLE: f64 = 70.0;

/// Describes how the apex of `a` differs from that of `b` at some nodes, by part of the face: `left brow 12 face units lower and 5 further
/// in`.
pub fn directions(a: &Model, b: &Model, nodes: &[NodeId], tables: &Tables) -> Vec<String> {
    let mut parts: BTreeMap<String, (Side, Vec<Vector2<f64>>)> = BTreeMap::new();
    for &node in nodes {
        let side = side(a, node);
        let difference = offset(a, apex(a), node) - offset(b, apex(b), node);
        parts.entry(part(a, node, side, tables)).or_insert_with(|| (side, Vec::new())).1.push(difference);
    }
    let mean = |all: &[Vector2<f64>]| all.iter().sum::<Vector2<f64>>() / all.len().max(1) as f64;
    let mut means: Vec<(String, Side, Vector2<f64>)> =
        parts.into_iter().map(|(name, (side, all))| (name, side, mean(&all))).filter(|(_, _, v)| v.norm() >= LEAST).collect();
    means.sort_by(|a, b| b.2.norm().total_cmp(&a.2.norm()).then_with(|| a.0.cmp(&b.0)));
    means.truncate(MOST_PARTS);
    means.iter().map(|(name, side, v)| format!("{name} {}", direction(*v, *side))).collect()
}

/// The subject's own side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    Left,
    Right,
    Middle,
}

fn neutral(model: &Model, node: NodeId) -> nalgebra::Point2<f64> {
    model.frames().first().and_then(|f| f.node(node)).unwrap_or_default()
}

fn side(model: &Model, node: NodeId) -> Side {
    match neutral(model, node).x {
        x if x > MIDDLE => Side::Left,
        x if x < -MIDDLE => Side::Right,
        _ => Side::Middle,
    }
}

/// Name of the part of the face that contains a node.
fn part(model: &Model, node: NodeId, side: Side, tables: &Tables) -> String {
    /// Corners of the mouth.
    const CORNERS: [NodeId; 2] = [NodeId(31), NodeId(64)];
    /// Corners of the left and of the right eye.
    const EYES: [[NodeId; 2]; 2] = [[NodeId(20), NodeId(23)], [NodeId(53), NodeId(56)]];
    let level = |nodes: [NodeId; 2]| nodes.map(|n| neutral(model, n).y).iter().sum::<f64>() / 2.0;
    let above = |nodes: [NodeId; 2]| if neutral(model, node).y >= level(nodes) { "upper" } else { "lower" };
    let own = |name: &str| match side {
        Side::Left => format!("left {name}"),
        Side::Right => format!("right {name}"),
        Side::Middle => name.to_owned(),
    };
    match tables.region(node) {
        Region::Mouth if CORNERS.contains(&node) => own("corner of the mouth"),
        Region::Mouth => format!("{} lip", above(CORNERS)),
        Region::Eye => own(&format!("{} lid", above(EYES[usize::from(side == Side::Right)]))),
        Region::Contour => own("side of the face"),
        Region::Nose => "nose".to_owned(),
        Region::Jaw => "chin".to_owned(),
        Region::Forehead => "forehead".to_owned(),
        Region::Brow => own("brow"),
        Region::Cheek => own("cheek"),
    }
}

fn direction(v: Vector2<f64>, side: Side) -> String {
    let across = match (side, v.x > 0.0) {
        (Side::Left, true) | (Side::Right, false) => "further out",
        (Side::Left, false) | (Side::Right, true) => "further in",
        (Side::Middle, true) => "further to the subject\u{2019}s left",
        (Side::Middle, false) => "further to the subject\u{2019}s right",
    };
    let up = if v.y > 0.0 { "higher" } else { "lower" };
    let mut named: Vec<(f64, &str)> = vec![(v.y.abs(), up), (v.x.abs(), across)];
    named.retain(|(size, _)| *size >= LEAST_SHARE * v.norm());
    let amount = |size: f64| if size < 9.95 { format!("{size:.1}") } else { format!("{size:.0}") };
    match named.as_slice() {
        [(a, first), (b, second)] => format!("{} face units {first} and {} {second}", amount(*a), amount(*b)),
        [(a, only), ..] => format!("{} face units {only}", amount(*a)),
        [] => String::new(),
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::{model::FrameExpressionModel, wireframe::Wireframe};

    /// Candide-3 with these node displacements at the apex.
    fn model(moves: &[(u16, [f64; 2])]) -> Model {
        let neutral: Vec<Point2<f64>> = Wireframe::candide3().frontal().iter().map(|p| p * 1000.0).collect();
        let mut last = neutral.clone();
        for &(node, [x, y]) in moves {
            last[usize::from(node)] += Vector2::new(x, y);
        }
        Model::new(vec![FrameExpressionModel::new(neutral), FrameExpressionModel::new(last)]).unwrap()
    }

    #[test]
    fn outward_is_away_from_the_middle_on_either_side() {
        let tables = Tables::candide3();
        // Both corners of the mouth go 30 out and 40 up in a, nothing in b; the chin 20 down.
        let a = model(&[(31, [30.0, 40.0]), (64, [-30.0, 40.0]), (10, [0.0, -20.0])]);
        let words = directions(&a, &model(&[]), &[31, 64, 10, 15].map(NodeId), &tables);
        assert_eq!(
            words,
            [
                "left corner of the mouth 40 face units higher and 30 further out",
                "right corner of the mouth 40 face units higher and 30 further out",
                "chin 20 face units lower",
            ]
        );
        // The other way round.
        let words = directions(&model(&[]), &a, &[NodeId(64)], &tables);
        assert_eq!(words, ["right corner of the mouth 40 face units lower and 30 further in"]);
    }

    #[test]
    fn upper_and_lower_lids_are_distinguished() {
        let a = model(&[(21, [0.0, 10.0])]);
        let words = directions(&a, &model(&[]), &[NodeId(21)], &Tables::candide3());
        assert_eq!(words, ["left upper lid 10 face units higher"]);
    }
}
