//! Vertices that follow a weighted mean of driving nodes, where the smoothest field does not move like a face: edges of lips
//! and lids, the skin between brow and lid, and brows.

use nalgebra::Point2;

use super::{
    layout::{BROWS, LID_SKIN, LID_SKIN_HEIGHTS, LidSkin, Opening},
    mesh::{Gathered, OpeningMesh},
};
use crate::{interpolation::hermite, units::NodeId};

/// A vertex, and (index among the drivers, weight) pairs; the weights sum to 1.
pub type Tied = (u32, Vec<(usize, f64)>);

/// Exponent applied to the parabola of an opening edge's arch: lips and lids are rounder than a parabola (1), less round than an ellipse (0.5).
const LIP_ARCH: f64 = 0.54;
const LID_ARCH: f64 = 0.75;
/// Step between vertices along a brow, in eye distances.
const STEP: f64 = 0.05;
/// Distance that the hair extends beyond the inner and the outer node, in eye distances.
const BEYOND: (f64, f64) = (0.06, 0.14);
/// Slope of the motion at either end, relative to that of the straight line to the middle: hair turns but does not curl.
const END_SLOPE: f64 = 0.6;

/// Index of a node among the drivers.
fn driver(drivers: &[(NodeId, u32)], node: u16) -> Option<usize> {
    drivers.iter().position(|d| d.0.0 == node)
}

/// Ties the vertices of an edge between its nodes. The surrounding skin would pull them into straight pieces with a corner at every node, while
/// parting lips and rising lids form arches. Beyond the motion of the corners, each vertex follows the nodes beside it, with
/// weights that form an arch over the corners.
pub fn edge(
    nodes: [u16; 5],
    edge: &[u32],
    opening: &OpeningMesh,
    points: &[Point2<f64>],
    drivers: &[(NodeId, u32)],
) -> Vec<Tied> {
    let stops = opening.stops;
    let power = if opening.opening == Opening::Mouth { LIP_ARCH } else { LID_ARCH };
    let at = |k: usize| points[edge[k] as usize];
    let chord = at(stops[4]) - at(stops[0]);
    let place = |k: usize| ((at(k) - at(stops[0])).dot(&chord) / chord.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    let places = stops.map(place);
    let drives: Option<Vec<usize>> = nodes.iter().map(|&n| driver(drivers, n)).collect();
    let ascends = places.windows(2).all(|w| w[0] < w[1]);
    let (Some(drives), true) = (drives, ascends) else { return Vec::new() };
    let follower = |k: usize| {
        let shares = arch_shares(places, place(k), power);
        (edge[k], drives.iter().copied().zip(shares).collect())
    };
    (1..edge.len() - 1).filter(|k| !stops.contains(k)).map(follower).collect()
}

/// Weights of five nodes, the first and last of which are corners, at a position on their arch.
fn arch_shares(places: [f64; 5], at: f64, power: f64) -> [f64; 5] {
    let arch = |u: f64| (4.0 * u * (1.0 - u)).max(0.0).powf(power);
    // Between the inner nodes a cubic; at the middle node it has the slope between its neighbours, elsewhere it is flat.
    let [_, a, b, c, _] = places;
    let slope = 1.0 / (c - a);
    let inner = if at <= a {
        [1.0, 0.0, 0.0]
    } else if at <= b {
        let [from, _, _, bend] = hermite((at - a) / (b - a));
        let bend = bend * (b - a) * slope;
        [from - bend, 1.0 - from, bend]
    } else if at <= c {
        let [from, bend, _, _] = hermite((at - b) / (c - b));
        let bend = bend * (c - b) * slope;
        [-bend, from, 1.0 - from + bend]
    } else {
        [0.0, 0.0, 1.0]
    };
    let whole = arch(at);
    let inner: [f64; 3] = std::array::from_fn(|k| inner[k] * whole / arch(places[k + 1]));
    let corner = |own: fn(f64) -> f64| own(at) - (0..3).map(|k| inner[k] * own(places[k + 1])).sum::<f64>();
    [corner(|u| 1.0 - u), inner[0], inner[1], inner[2], corner(|u| u)]
}

/// Ties vertices between brow and upper lid. A shutting lid unfolds the skin below its crease; the skin above and the brow stay.
pub fn lid_skin(reference: &[Point2<f64>], drivers: &[(NodeId, u32)], gathered: &mut Gathered) -> Vec<Tied> {
    let at = |node: u16| reference[usize::from(node)].coords;
    let mut tied = Vec::new();
    for Column { lid, corners, brow, share } in LID_SKIN.iter().flat_map(columns) {
        let foot = at(lid[0]).lerp(&at(lid[1]), 0.5);
        let above = at(brow[0]).lerp(&at(brow[1]), share);
        for (height, lid_share, brow_share) in LID_SKIN_HEIGHTS {
            let point = Point2::from(foot.lerp(&above, height));
            let rest = (1.0 - brow_share - lid_share) / 2.0;
            let shares = [
                (brow[0], brow_share * (1.0 - share)),
                (brow[1], brow_share * share),
                (lid[0], lid_share / 2.0),
                (lid[1], lid_share / 2.0),
                (corners[0], rest),
                (corners[1], rest),
            ];
            let shares: Option<Vec<(usize, f64)>> = shares.iter().map(|&(n, s)| Some((driver(drivers, n)?, s))).collect();
            if let Some(shares) = shares
                && gathered.has_room(&point)
            {
                tied.push((gathered.add(point), shares));
            }
        }
    }
    tied
}

/// A column of vertices from the lid to a brow; it starts half-way between two lid nodes, or at one that is listed twice.
struct Column {
    lid: [u16; 2],
    corners: [u16; 2],
    brow: [u16; 2],
    share: f64,
}

/// The columns above an eye: over the nodes of its upper lid and half-way between them, so that the crease does not sag between
/// nodes.
fn columns(skin: &LidSkin) -> Vec<Column> {
    let LidSkin { lid, corners, brow, shares, .. } = *skin;
    let column = |lid: [u16; 2], share: f64| Column { lid, corners, brow, share };
    let over = lid.iter().zip(shares).map(|(&node, share)| column([node; 2], share));
    let between = lid.windows(2).zip(shares.windows(2)).map(|(pair, at)| column([pair[0], pair[1]], f64::midpoint(at[0], at[1])));
    over.chain(between).collect()
}

/// Ties vertices on the brows. The smoothest field overshoots between unevenly spaced nodes such as a brow's, and leaves behind the end of
/// the hair beyond the outermost node, so that raised brows turn into hooks.
pub fn brows(reference: &[Point2<f64>], drivers: &[(NodeId, u32)], gathered: &mut Gathered) -> Vec<Tied> {
    let unit = gathered.eye_distance;
    let mut tied = Vec::new();
    for brow in BROWS {
        let [Some(inner), Some(upper), Some(lower), Some(outer)] = brow.map(|n| driver(drivers, n)) else { continue };
        let [start, above, below, end] = brow.map(|n| reference[usize::from(n)].coords);
        let middle = above.lerp(&below, 0.5);
        let lengths = [(middle - start).norm(), (end - middle).norm()];
        if !lengths.iter().all(|&l| l > STEP * unit) {
            continue;
        }
        let whole = lengths[0] + lengths[1] + (BEYOND.0 + BEYOND.1) * unit;
        let count = (whole / (STEP * unit)).ceil().clamp(1.0, 64.0) as usize;
        // Lines along the hair, from its lower to its upper edge.
        for level in [0.0, 0.5, 1.0] {
            let raised = (above - below) * level;
            let (first, second) = (start + raised, below + raised);
            for k in 0..=count {
                let along = whole * k as f64 / count as f64 - BEYOND.0 * unit;
                let point = Point2::from(if along < lengths[0] {
                    first.lerp(&second, along / lengths[0])
                } else {
                    second.lerp(&end, (along - lengths[0]) / lengths[1])
                });
                if gathered.has_room(&point) {
                    let [a, b, c] = brow_shares(lengths, along);
                    let shares = vec![(inner, a), (upper, b * level), (lower, b * (1.0 - level)), (outer, c)];
                    tied.push((gathered.add(point), shares));
                }
            }
        }
    }
    tied
}

/// Weights of the inner node, the middle and the outer node at a position on a brow whose two pieces have these lengths. Each piece is a cubic; in
/// the middle it has the slope of the parabola through all three. Beyond an end, its node has all the weight.
fn brow_shares([first, second]: [f64; 2], along: f64) -> [f64; 3] {
    // Slopes of the straight lines and of the middle, as weights of the three motions.
    let (inner, outer) = ([-1.0 / first, 1.0 / first, 0.0], [0.0, -1.0 / second, 1.0 / second]);
    let middle: [f64; 3] = std::array::from_fn(|k| (second * inner[k] + first * outer[k]) / (first + second));
    let end = |line: [f64; 3]| line.map(|slope| END_SLOPE * slope);
    let (piece, length, place, slopes) =
        if along < first { (0, first, along, [end(inner), middle]) } else { (1, second, along - first, [middle, end(outer)]) };
    let [from, slope_from, to, slope_to] = hermite((place / length).clamp(0.0, 1.0));
    let mut shares = std::array::from_fn(|k| length * (slope_from * slopes[0][k] + slope_to * slopes[1][k]));
    shares[piece] += from;
    shares[piece + 1] += to;
    shares
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn skin_above_a_lid_is_held_over_its_nodes_and_half_way_between_them() {
        for skin in &LID_SKIN {
            let mut columns = columns(skin);
            columns.sort_by(|a, b| a.share.total_cmp(&b.share));
            let [a, b, c] = skin.lid;
            assert_eq!(columns.iter().map(|column| column.lid).collect::<Vec<_>>(), [[a, a], [a, b], [b, b], [b, c], [c, c]]);
            assert!(columns.windows(2).all(|pair| (pair[1].share - pair[0].share - 0.1).abs() < 1e-12));
        }
    }

    #[test]
    fn an_edge_follows_an_arch_through_its_nodes() {
        let places = [0.0, 0.25, 0.5, 0.75, 1.0];
        let value =
            |motion: [f64; 5], at: f64| arch_shares(places, at, LIP_ARCH).iter().zip(motion).map(|(s, m)| s * m).sum::<f64>();
        // The corners' motion alone is interpolated linearly; at a node the edge lies at the node.
        for k in 0..=20 {
            let u = f64::from(k) / 20.0;
            assert!((value([1.0, 2.0, 3.0, 4.0, 5.0], u) - (1.0 + 4.0 * u)).abs() < 1e-12, "{u}");
            let arch = (4.0 * u * (1.0 - u)).powf(LIP_ARCH);
            assert!((value(places.map(|p| (4.0 * p * (1.0 - p)).powf(LIP_ARCH)), u) - arch).abs() < 1e-12, "{u}");
        }
        for (k, &at) in places.iter().enumerate() {
            let mut motion = [0.0; 5];
            motion[k] = 1.0;
            assert!((value(motion, at) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn hair_goes_with_its_nodes_and_hardly_beyond_them() {
        let lengths = [48.0, 33.0];
        let motion = |along: f64| {
            let shares = brow_shares(lengths, along);
            assert!((shares.iter().sum::<f64>() - 1.0).abs() < 1e-12, "{along}");
            shares[0] * 12.4 + shares[1] * 16.8 + shares[2] * 10.3
        };
        for (along, expected) in [(0.0, 12.4), (48.0, 16.8), (81.0, 10.3), (-5.0, 12.4), (95.0, 10.3)] {
            assert!((motion(along) - expected).abs() < 1e-9, "{along}: {}", motion(along));
        }
        let highest = (0..=81).map(|k| motion(f64::from(k))).fold(0.0, f64::max);
        assert!(highest < 17.3, "{highest}");
    }
}
