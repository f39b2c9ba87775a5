//! One frame: pose and the coefficients of some directions of shape, the maximum a posteriori by Gauss-Newton.

use nalgebra::{DMatrix, DVector, Point2, Vector2, Vector3};

use super::HeadPose;

/// Turns of Gauss-Newton at most.
const TURNS: usize = 20;
/// Largest turn of the head in one step, radians.
const LARGEST_TURN: f64 = 0.2;
/// A step below this (radians, logarithms, standard deviations) is the last.
const AT_REST: f64 = 1e-6;
/// Residual, in standard deviations, beyond which a node counts as an outlier.
const OUTLIER: f64 = 3.0;
/// Numbers of a pose.
const POSE: usize = 6;

/// One observed node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Which.
    pub node: usize,
    /// Where, px.
    pub at: Point2<f64>,
    /// Standard deviation in x and in y, model units; the smaller the more it counts.
    pub deviation: f64,
}

/// The answer for one frame.
#[derive(Clone, Debug)]
pub(super) struct Solved {
    pub pose: HeadPose,
    /// Coefficients of the directions, standard deviations.
    pub coefficients: DVector<f64>,
}

/// The shape with the directions added.
pub(super) fn shape_with(
    base: &[Vector3<f64>],
    directions: &[Vec<Vector3<f64>>],
    coefficients: &DVector<f64>,
) -> Vec<Vector3<f64>> {
    let mut shape = base.to_vec();
    for (direction, &c) in directions.iter().zip(coefficients.iter()) {
        shape.iter_mut().zip(direction).for_each(|(x, d)| *x += d * c);
    }
    shape
}

/// Weight of a residual of `ratio` standard deviations against a small one (Cauchy).
pub(super) fn robust(ratio: f64) -> f64 {
    1.0 / (1.0 + (ratio / OUTLIER).powi(2))
}

/// What a residual of `ratio` standard deviations costs, where half its square is the cost of a small one (Cauchy).
pub(super) fn cost(ratio: f64) -> f64 {
    0.5 * OUTLIER * OUTLIER * (ratio / OUTLIER).powi(2).ln_1p()
}

/// Pose and coefficients that explain what is seen best; the coefficients have standard normal priors, the pose has none.
pub(super) fn solve(base: &[Vector3<f64>], directions: &[Vec<Vector3<f64>>], seen: &[Seen], start: Solved) -> Option<Solved> {
    let mut solved = start;
    let size = POSE + directions.len();
    let mut row = [vec![0.0; size], vec![0.0; size]];
    for _ in 0..TURNS {
        let mut normal = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        for (j, &c) in solved.coefficients.iter().enumerate() {
            normal[(POSE + j, POSE + j)] += 1.0;
            right[POSE + j] -= c;
        }
        let pose = solved.pose;
        for s in seen {
            let moved: Vector3<f64> = directions.iter().zip(solved.coefficients.iter()).map(|(d, c)| d[s.node] * *c).sum();
            let turned = pose.turned(&(base[s.node] + moved));
            let residual: Vector2<f64> = s.at - pose.image_of(&turned);
            let deviation = s.deviation * pose.scale;
            let weight = robust(residual.norm() / deviation) / (deviation * deviation);
            let slope = pose.slope(&turned);
            let by_turn = slope * HeadPose::rotation_slope(&turned);
            let by_point = slope * pose.rotation.matrix();
            let seen_at = pose.image_of(&turned) - pose.position;
            for axis in 0..2 {
                let line = &mut row[axis];
                (0..3).for_each(|k| line[k] = by_turn[(axis, k)]);
                line[3] = seen_at[axis];
                line[4] = f64::from(u8::from(axis == 0));
                line[5] = f64::from(u8::from(axis == 1));
                for (j, direction) in directions.iter().enumerate() {
                    line[POSE + j] = by_point.row(axis).transpose().dot(&direction[s.node]);
                }
                for i in 0..size {
                    let value = weight * line[i];
                    right[i] += value * residual[axis];
                    for (j, other) in line.iter().enumerate().take(i + 1) {
                        normal[(i, j)] += value * other;
                    }
                }
            }
        }
        normal.fill_upper_triangle_with_lower_triangle();
        let step = normal.cholesky()?.solve(&right);
        let turn = Vector3::new(step[0], step[1], step[2]);
        let share = (LARGEST_TURN / turn.norm().max(LARGEST_TURN)).min(1.0);
        let step = step * share;
        solved.pose = pose.moved(Vector3::new(step[0], step[1], step[2]), step[3], Vector2::new(step[4], step[5]));
        solved.coefficients += step.rows(POSE, directions.len());
        let small = |k: usize| step[k].abs() < AT_REST;
        let shifts = step[4].abs().max(step[5].abs()) < AT_REST * solved.pose.scale;
        if shifts && (0..size).all(|k| k == 4 || k == 5 || small(k)) {
            break;
        }
    }
    let finite = solved.pose.scale.is_finite() && solved.pose.scale > 0.0 && solved.coefficients.iter().all(|c| c.is_finite());
    finite.then_some(solved)
}
