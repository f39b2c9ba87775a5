//! Finds implausible points of faces, such as a digit too many or two exchanged columns.
//!
//! A robust similarity aligns every face with the median of all faces; then the distances of its points from the median's are checked.

use nalgebra::Point2;

use crate::{geometry::Similarity, units::NodeId};

/// Fewest points with which a wrong point can be identified.
const LEAST_POINTS: usize = 5;

/// Fewest faces for a median position of a node; with fewer, Candide's position is used.
const LEAST_FACES: usize = 3;

/// Iterations of median and alignment.
const TURNS: usize = 2;

/// Limit of the distance, in median distances, of points used for the alignment.
const PLACING: f64 = 3.0;

/// Known points of a face, y up.
pub(super) type Known = (Vec<NodeId>, Vec<Point2<f64>>);

/// Implausible points of one face.
pub(super) struct Far {
    /// Index of the point furthest away, in the face's list.
    pub point: usize,
    /// Its distance, in the unit of `start`.
    pub distance: f64,
    /// Number of points beyond the bound.
    pub count: usize,
}

/// Returns for each face the points further than `bound` from the median face. `start` has a position for every node.
pub(super) fn far_points(faces: &[Known], start: &[Point2<f64>], bound: f64) -> Vec<Option<Far>> {
    let mut median = start.to_vec();
    for _ in 0..TURNS {
        let mut places = vec![(Vec::new(), Vec::new()); start.len()];
        for (nodes, seen) in faces {
            let Some(onto) = robust_similarity(seen, &of(&median, nodes)) else { continue };
            for (node, p) in nodes.iter().zip(seen) {
                let p = onto.apply(p);
                let (xs, ys) = &mut places[node.index()];
                xs.push(p.x);
                ys.push(p.y);
            }
        }
        for (place, (xs, ys)) in median.iter_mut().zip(&mut places) {
            if xs.len() >= LEAST_FACES {
                *place = Point2::new(middle(xs), middle(ys));
            }
        }
    }
    let far = |(nodes, seen): &Known| {
        let target = of(&median, nodes);
        let distances = distances(&robust_similarity(seen, &target)?, seen, &target);
        // NaN counts as far.
        let is_far = |d: &f64| d.is_nan() || *d > bound;
        let (point, &distance) = distances.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1))?;
        is_far(&distance).then(|| Far { point, distance, count: distances.iter().filter(|d| is_far(d)).count() })
    };
    faces.iter().map(far).collect()
}

fn of(shape: &[Point2<f64>], nodes: &[NodeId]) -> Vec<Point2<f64>> {
    nodes.iter().map(|n| shape[n.index()]).collect()
}

fn distances(onto: &Similarity, seen: &[Point2<f64>], target: &[Point2<f64>]) -> Vec<f64> {
    seen.iter().zip(target).map(|(p, t)| (onto.apply(p) - t).norm()).collect()
}

fn middle(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or_default()
}

/// Returns the similarity through two points that gives the smallest median distance, refined by all points near it (least median of
/// squares, Rousseeuw 1984). `None` if there are too few points, or all coincide.
fn robust_similarity(seen: &[Point2<f64>], target: &[Point2<f64>]) -> Option<Similarity> {
    let count = seen.len();
    if count < LEAST_POINTS {
        return None;
    }
    // The two points of a pair fit by construction; the list goes from part to part of a face, so the point half a list away is far off.
    let median = |onto: &Similarity| {
        let mut all = distances(onto, seen, target);
        all.sort_by(f64::total_cmp);
        all[count / 2 + 1]
    };
    let mut best: Option<(f64, Similarity)> = None;
    for step in [count / 2, count / 3] {
        for i in 0..count {
            let k = (i + step) % count;
            let Ok(onto) = Similarity::fit(&[seen[i], seen[k]], &[target[i], target[k]], None) else { continue };
            let left = median(&onto);
            if best.as_ref().is_none_or(|(least, _)| left < *least) {
                best = Some((left, onto));
            }
        }
    }
    let (left, onto) = best?;
    let near = |d: f64| if d <= PLACING * left { 1.0 } else { 0.0 };
    let weights: Vec<f64> = distances(&onto, seen, target).into_iter().map(near).collect();
    Some(Similarity::fit(seen, target, Some(&weights)).unwrap_or(onto))
}
