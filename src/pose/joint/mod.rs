//! Fits everything that is unknown of a sequence together: the person's head, the camera's distance, and pose and expression in every
//! frame.
//!
//! A turn of the head and another depth of all its nodes explain nearly the same images. Steps of one part with the other fixed follow such
//! a valley in hundreds of short moves, and end somewhere in it; a step of all parts crosses it.

mod normal;
#[cfg(test)]
mod tests;

use nalgebra::{DVector, Vector2, Vector3};

use self::normal::{Assembly, Normal};
use super::{
    CAMERA_DISTANCE, HEAD_ES, HeadModel,
    observe::Own,
    solve::{Directions, LARGEST_TURN, POSE, SERVES, Seen, Slopes, Solved, dots, robust_square},
};
use crate::least_squares::add_mixture;

/// Standard deviation of the logarithm of the camera's distance.
const LOG_DISTANCE_DEVIATION: f64 = 1.0;
/// Bounds of the camera's distance, eye distances.
const DISTANCES: [f64; 2] = [4.0, 60.0];
/// Largest number of steps.
const STEPS: usize = 100;
/// The search ends at a step that changes nothing by more than this: in standard deviations, and in units of [`POSE_UNIT`] and
/// [`DISTANCE_UNIT`].
const AT_REST: f64 = 0.003;
/// Unit of changes of a pose: radians, logarithms of sizes, and image distances over the size.
const POSE_UNIT: f64 = 0.01;
/// Unit of changes of the perspective (the inverse of the camera's distance), over that at [`CAMERA_DISTANCE`].
const DISTANCE_UNIT: f64 = 0.1;
/// A step after one larger than this has normal equations of its own.
const LARGE: f64 = 1.0;
/// Number of times that a step is halved when it increases the sum.
const HALVINGS: usize = 8;
/// Increase of the sum, as a share, that a step may have: the weights, which belong to the place where it starts, change it this little.
const INCREASE: f64 = 1e-3;

/// A person's head.
#[derive(Clone, Debug)]
pub(super) struct Head {
    /// Coefficients of identity, standard deviations.
    pub coefficients: DVector<f64>,
    /// Offsets of this person from the modes, by node, model units.
    pub own: Vec<Vector3<f64>>,
}

/// All unknowns of a sequence.
#[derive(Clone, Debug)]
pub(super) struct Unknowns {
    pub head: Head,
    /// The neutral frame, which has no coefficients, then the others. All poses have the same camera distance.
    pub views: Vec<Solved>,
}

impl Unknowns {
    fn distance(&self) -> f64 {
        self.views.first().map_or(CAMERA_DISTANCE * HEAD_ES, |view| view.pose.distance)
    }

    /// Returns the logarithm of the camera's distance over its prior mean.
    fn log_distance(&self) -> f64 {
        (self.distance() / (CAMERA_DISTANCE * HEAD_ES)).ln()
    }

    /// Sets the camera's distance of all views, within [`DISTANCES`].
    fn set_distance(&mut self, distance: f64) {
        let [nearest, farthest] = DISTANCES.map(|distance| distance * HEAD_ES);
        let distance = distance.clamp(nearest, farthest);
        self.views.iter_mut().for_each(|view| view.pose.distance = distance);
    }
}

/// The known parts of the problem.
#[derive(Clone, Copy)]
pub(super) struct Problem<'a> {
    pub model: &'a HeadModel,
    pub identity: &'a Directions,
    pub expression: &'a Directions,
    /// Priors of the person's own offsets, by node.
    pub own: &'a [Own],
}

/// Direction of descent: the negative derivatives of half the robust sum of squares.
struct Descent {
    /// By the own offset of every node.
    own: Vec<Vector3<f64>>,
    /// By all others, in the order of [`Problem::column`].
    others: DVector<f64>,
}

/// Changes of all unknowns.
struct Step {
    /// By node, model units.
    own: Vec<Vector3<f64>>,
    /// All others, in the order of [`Problem::column`].
    others: DVector<f64>,
}

/// Fits all unknowns by Gauss-Newton with robust weights. `observe` returns the observations of every view, given the unknowns. Returns
/// `None` when the observations determine no solution.
pub(super) fn descend(
    problem: &Problem<'_>,
    unknowns: &mut Unknowns,
    observe: impl Fn(&Unknowns) -> Vec<Vec<Seen>>,
) -> Option<()> {
    let mut normal: Option<Normal> = None;
    let (mut served, mut largest) = (0, f64::INFINITY);
    for _ in 0..STEPS {
        let seen = observe(unknowns);
        let before = problem.sum(unknowns, unknowns, &seen);
        if largest > LARGE || served == SERVES {
            normal = None;
        }
        loop {
            let is_new = normal.is_none();
            let mut assembly = is_new.then(|| Assembly::new(problem, unknowns.views.len()));
            let descent = problem.descent(unknowns, &seen, assembly.as_mut());
            if let Some(assembly) = assembly {
                normal = Some(assembly.normal(problem)?);
                served = 0;
            }
            let step = normal.as_ref()?.step(&descent);
            served += 1;
            // A shared matrix that no longer fits is replaced; a step of its own matrix that leads too far is halved.
            let shares = (0..if is_new { HALVINGS } else { 1 }).map(|halvings| 0.5_f64.powi(halvings as i32));
            let mut tried = shares.map(|share| problem.moved(unknowns, &step, share));
            let lower = tried.find(|(next, _)| problem.sum(next, unknowns, &seen) <= before * (1.0 + INCREASE));
            if let Some((next, change)) = lower {
                (*unknowns, largest) = (next, change);
                break;
            }
            if is_new {
                return Some(());
            }
            normal = None;
        }
        if largest < AT_REST {
            break;
        }
    }
    Some(())
}

impl Problem<'_> {
    /// Returns the neutral shape of a head.
    pub fn shape(&self, head: &Head) -> Vec<Vector3<f64>> {
        let at = |(k, (mean, own)): (usize, (&Vector3<f64>, &Vector3<f64>))| {
            mean + own + Vector3::from(dots(self.identity.of(k), head.coefficients.as_slice()))
        };
        self.model.mean.iter().zip(&head.own).enumerate().map(at).collect()
    }

    /// Returns the first column of a view among the unknowns without own offsets: coefficients of identity, the logarithm of the distance,
    /// and for every view a pose and, except for the neutral frame, coefficients of expression.
    fn column(&self, view: usize) -> usize {
        let neutral = self.identity.count() + 1;
        match view {
            0 => neutral,
            _ => neutral + POSE + (view - 1) * (POSE + self.expression.count()),
        }
    }

    /// Returns the directions in which a view's expression moves a node; none in the neutral frame.
    fn along(&self, view: usize, node: usize) -> [&[f64]; 3] {
        if view > 0 { self.expression.of(node) } else { [&[]; 3] }
    }

    /// Returns a node with the expression of a view, in camera axes.
    fn place(&self, shape: &[Vector3<f64>], view: &Solved, node: usize) -> Vector3<f64> {
        let moved = Vector3::from(dots(self.expression.of(node), view.coefficients.as_slice()));
        view.pose.turned(&(shape[node] + moved))
    }

    /// Returns half the robust sum of squares of the residuals and priors. Standard deviations are in px of the sizes of `sized`: a head
    /// must not become larger in order to explain more.
    fn sum(&self, unknowns: &Unknowns, sized: &Unknowns, seen: &[Vec<Seen>]) -> f64 {
        let shape = self.shape(&unknowns.head);
        let mut sum = LOG_DISTANCE_DEVIATION.powi(-2) * unknowns.log_distance().powi(2);
        for ((view, sized), seen) in unknowns.views.iter().zip(&sized.views).zip(seen) {
            let residual = |s: &Seen| (s.at - view.pose.image_of(&self.place(&shape, view, s.node))).norm();
            sum += seen.iter().map(|s| robust_square(residual(s) / (s.deviation * sized.pose.scale))).sum::<f64>();
            sum += view.coefficients.norm_squared();
        }
        sum += unknowns.head.own.iter().zip(self.own).map(|(offset, own)| offset.dot(&(own.precision * offset))).sum::<f64>();
        0.5 * (sum + unknowns.head.coefficients.norm_squared())
    }

    /// Returns the slopes of an observation, and that by the logarithm of the camera's distance.
    fn slopes(&self, shape: &[Vector3<f64>], view: &Solved, seen: &Seen) -> (Slopes, Vector2<f64>) {
        let turned = self.place(shape, view, seen.node);
        (Slopes::new(&view.pose, &turned, seen), view.pose.distance_slope(&turned))
    }

    /// Returns the direction of descent; adds the second derivatives to `assembly`.
    fn descent(&self, unknowns: &Unknowns, seen: &[Vec<Seen>], mut assembly: Option<&mut Assembly>) -> Descent {
        let identities = self.identity.count();
        let shape = self.shape(&unknowns.head);
        let mut own = vec![Vector3::zeros(); shape.len()];
        let mut others = DVector::<f64>::zeros(self.column(unknowns.views.len()));
        for (v, (view, seen)) in unknowns.views.iter().zip(seen).enumerate() {
            let first = self.column(v);
            for s in seen {
                let (slopes, by_log_distance) = self.slopes(&shape, view, s);
                own[s.node] += slopes.pull(&mut others.as_mut_slice()[first..], self.along(v, s.node));
                others[identities] += by_log_distance.dot(&(slopes.residual * slopes.weight));
                if let Some(assembly) = &mut assembly {
                    assembly.add(self, v, s.node, (&slopes, by_log_distance));
                }
            }
            if let Some(assembly) = &mut assembly {
                assembly.end_view(self, v);
            }
            others.rows_mut(first + POSE, view.coefficients.len()).axpy(-1.0, &view.coefficients, 1.0);
        }
        for (k, (pull, offset)) in own.iter_mut().zip(&unknowns.head.own).enumerate() {
            add_mixture(&mut others.as_mut_slice()[..identities], (*pull).into(), self.identity.of(k));
            *pull -= self.own[k].precision * offset;
        }
        others.rows_mut(0, identities).axpy(-1.0, &unknowns.head.coefficients, 1.0);
        others[identities] -= LOG_DISTANCE_DEVIATION.powi(-2) * unknowns.log_distance();
        Descent { own, others }
    }

    /// Returns the unknowns after a share of a step, and the largest change, in the units of [`AT_REST`]. No head turns by more than
    /// [`LARGEST_TURN`].
    fn moved(&self, unknowns: &Unknowns, step: &Step, share: f64) -> (Unknowns, f64) {
        let turn = |v: usize| step.others.fixed_rows::<3>(self.column(v)).into_owned();
        let farthest = (0..unknowns.views.len()).map(|v| turn(v).norm()).fold(LARGEST_TURN, f64::max);
        let share = share * LARGEST_TURN / farthest;
        let others = &step.others * share;
        let mut next = unknowns.clone();
        let mut largest = 0.0_f64;
        for (offset, (step, own)) in next.head.own.iter_mut().zip(step.own.iter().zip(self.own)) {
            *offset += step * share;
            largest = largest.max((own.per_spread * step * share).amax());
        }
        let identities = self.identity.count();
        let changed = others.rows(0, identities);
        next.head.coefficients += changed;
        largest = largest.max(changed.amax());
        for (v, view) in next.views.iter_mut().enumerate() {
            let first = self.column(v);
            let pose = others.fixed_rows::<POSE>(first);
            let (placed, shift) = (pose.fixed_rows::<4>(0), Vector2::new(pose[4], pose[5]));
            largest = largest.max(placed.amax().max(shift.amax() / view.pose.scale) / POSE_UNIT);
            view.pose = view.pose.moved(Vector3::new(pose[0], pose[1], pose[2]), pose[3], shift);
            let changed = others.rows(first + POSE, view.coefficients.len());
            view.coefficients += changed;
            largest = largest.max(changed.amax());
        }
        let distance = unknowns.distance();
        next.set_distance(distance * others[identities].exp());
        let perspective = CAMERA_DISTANCE * HEAD_ES * (1.0 / next.distance() - 1.0 / distance);
        (next, largest.max(perspective.abs() / DISTANCE_UNIT))
    }
}
