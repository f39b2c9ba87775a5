//! Points of faces that lie where no face has them: a digit too many, or two columns exchanged.
//!
//! Every face is laid on the median of all faces by a similarity that its wrong points do not touch, and how far its points lie from the
//! median's is looked at.

use nalgebra::Point2;

use crate::{geometry::Similarity, units::NodeId};

/// Fewest points that tell which of them is wrong.
const LEAST_POINTS: usize = 5;

/// Fewest faces whose median says where a node is; Candide's own place serves where fewer know it.
const LEAST_FACES: usize = 3;

/// Turns of median and alignment.
const TURNS: usize = 2;

/// Points within so many times the median distance place a face.
const PLACING: f64 = 3.0;

/// The known points of a face, y up.
pub(super) type Known = (Vec<NodeId>, Vec<Point2<f64>>);

/// What lies too far off in one face.
pub(super) struct Far {
    /// The point that lies furthest, by its place in the face's list.
    pub point: usize,
    /// How far it lies, in the unit of `start`.
    pub distance: f64,
    /// Points beyond the bound.
    pub count: usize,
}

/// For each face its points that lie further than `bound` from the median face; `start` has a place for every node.
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
        // What is no number is far, too.
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

/// The similarity of two points that leaves the least median distance, then that of all points near it (least median of squares, Rousseeuw 1984).
/// `None` where points are too few, or all at one place.
fn robust_similarity(seen: &[Point2<f64>], target: &[Point2<f64>]) -> Option<Similarity> {
    let count = seen.len();
    if count < LEAST_POINTS {
        return None;
    }
    // The two points of a pair lie in place by themselves; the list goes from part to part of a face, so that its half is far off.
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
