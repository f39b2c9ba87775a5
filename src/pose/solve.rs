//! Fits one frame: pose and the coefficients of some directions of shape, maximum a posteriori by Gauss-Newton.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix2x3, Point2, SMatrix, Vector2, Vector3};

use super::HeadPose;
use crate::least_squares::{Rows, add_mixture};

/// Largest turn of the head in one step, radians.
pub(super) const LARGEST_TURN: f64 = 0.2;
/// Residual, in standard deviations, beyond which a node counts as an outlier.
const OUTLIER: f64 = 3.0;
/// Number of parameters of a pose.
pub(super) const POSE: usize = 6;
/// Number of first steps that each compute a new matrix.
const FIRST: usize = 2;
/// Number of later steps that share a matrix.
pub(super) const SERVES: usize = 8;

/// One observed node.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen {
    /// Index of the node.
    pub node: usize,
    /// Observed position, px.
    pub at: Point2<f64>,
    /// Standard deviation in x and in y, model units.
    pub deviation: f64,
}

/// Solution for one frame.
#[derive(Clone, Debug)]
pub(super) struct Solved {
    pub pose: HeadPose,
    /// Coefficients of the directions, in standard deviations.
    pub coefficients: DVector<f64>,
}

/// Returns the shape with the directions added.
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

/// Returns the (Cauchy) weight of a residual of `ratio` standard deviations relative to a small one.
pub(super) fn robust(ratio: f64) -> f64 {
    1.0 / (1.0 + (ratio / OUTLIER).powi(2))
}

/// Returns the contribution of a residual of `ratio` standard deviations to the sum of squares with the weights of [`robust`].
pub(super) fn robust_square(ratio: f64) -> f64 {
    OUTLIER * OUTLIER * (ratio / OUTLIER).powi(2).ln_1p()
}

/// Stopping criteria of [`solve`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    /// Largest number of Gauss-Newton steps.
    pub steps: usize,
    /// Iteration ends below this step: radians, logarithms, standard deviations.
    pub at_rest: f64,
}

/// Directions of shape, node by node, in the layout of [`solve`]: for each node all x, then all y, then all z.
#[derive(Clone, Debug)]
pub(super) struct Directions {
    count: usize,
    by_node: Vec<f64>,
}

impl Directions {
    /// Creates directions from one list of nodes per direction.
    pub fn new(directions: &[Vec<Vector3<f64>>], nodes: usize) -> Self {
        let of_node = |k: usize| (0..3).flat_map(move |axis| directions.iter().map(move |d| d[k][axis]));
        Self { count: directions.len(), by_node: (0..nodes).flat_map(of_node).collect() }
    }

    /// Creates an empty set of directions.
    pub fn none() -> Self {
        Self { count: 0, by_node: Vec::new() }
    }

    /// Returns the number of directions.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Returns x, y and z of a node in all directions.
    pub fn of(&self, node: usize) -> [&[f64]; 3] {
        let n = self.count;
        [0, 1, 2].map(|axis| &self.by_node[(3 * node + axis) * n..(3 * node + axis + 1) * n])
    }
}

/// Returns the sums of products of three lists with a fourth one. Each is added in order; the three sums run in parallel.
pub(super) fn dots([x, y, z]: [&[f64]; 3], with: &[f64]) -> [f64; 3] {
    let mut sums = [0.0; 3];
    for (((x, y), z), with) in x.iter().zip(y).zip(z).zip(with) {
        sums[0] += x * with;
        sums[1] += y * with;
        sums[2] += z * with;
    }
    sums
}

/// Derivatives of the image position of one observed node.
pub(super) struct Slopes {
    /// From the explained to the observed position, px.
    pub residual: Vector2<f64>,
    /// Robust weight over the variance, 1/px^2.
    pub weight: f64,
    /// By the node's position in face axes.
    pub by_point: Matrix2x3<f64>,
    /// By the changes of [`HeadPose::moved`].
    pub by_pose: SMatrix<f64, 2, POSE>,
}

impl Slopes {
    /// Returns the slopes of a node at a place in camera axes.
    pub fn new(pose: &HeadPose, turned: &Vector3<f64>, seen: &Seen) -> Self {
        let residual: Vector2<f64> = seen.at - pose.image_of(turned);
        let deviation = seen.deviation * pose.scale;
        Self {
            residual,
            weight: robust(residual.norm() / deviation) / (deviation * deviation),
            by_point: pose.slope(turned) * pose.rotation.matrix(),
            by_pose: pose.pose_slope(turned),
        }
    }

    /// Adds the residual to the right side of a pose and, behind it, of the directions in which the node moves; returns that of its place.
    pub fn pull(&self, right: &mut [f64], along: [&[f64]; 3]) -> Vector3<f64> {
        let pull = self.residual * self.weight;
        let (pose, shape) = right.split_at_mut(POSE);
        let by_pose = self.by_pose.transpose() * pull;
        pose.iter_mut().zip(by_pose.iter()).for_each(|(right, value)| *right += value);
        let by_point: Vector3<f64> = self.by_point.transpose() * pull;
        add_mixture(shape, by_point.into(), along);
        by_point
    }

    /// Writes the row of x or y, over the standard deviation: a pose and, behind it, the directions. Returns the slopes by the place.
    pub fn write_row(&self, axis: usize, row: &mut [f64], along: [&[f64]; 3]) -> [f64; 3] {
        let root = self.weight.sqrt();
        let (pose, shape) = row.split_at_mut(POSE);
        pose.iter_mut().zip(self.by_pose.row(axis).iter()).for_each(|(cell, value)| *cell = value * root);
        let by_point = [0, 1, 2].map(|k| self.by_point[(axis, k)] * root);
        add_mixture(shape, by_point, along);
        by_point
    }
}

/// Least-squares problem of one step: a row for x and one for y of every node, and the normal equations.
struct System {
    /// Rows of the Jacobian over the standard deviations.
    rows: Rows,
    normal: DMatrix<f64>,
    right: DVector<f64>,
}

impl System {
    fn new(size: usize) -> Self {
        Self { rows: Rows::new(size), normal: DMatrix::zeros(size, size), right: DVector::zeros(size) }
    }

    /// Starts with the standard normal priors of the coefficients.
    fn restart(&mut self, coefficients: &DVector<f64>) {
        self.rows.clear();
        self.normal.fill(0.0);
        self.right.fill(0.0);
        for (j, &c) in coefficients.iter().enumerate() {
            self.normal[(POSE + j, POSE + j)] = 1.0;
            self.right[POSE + j] = -c;
        }
    }

    fn step(&mut self, matrix: &mut Matrix) -> Option<DVector<f64>> {
        if matrix.is_due() {
            self.rows.add_squares(&mut self.normal);
            // Only the lower triangle is read.
            matrix.factor = Some(self.normal.clone().cholesky()?);
        }
        matrix.steps += 1;
        Some(matrix.factor.as_ref()?.solve(&self.right))
    }
}

/// Factored matrix of the normal equations, the most expensive part of a step. It changes little from step to step, and only the right side
/// determines the solution, so it is used for several steps.
#[derive(Clone, Debug, Default)]
pub(super) struct Matrix {
    factor: Option<Cholesky<f64, Dyn>>,
    steps: usize,
}

impl Matrix {
    fn is_due(&self) -> bool {
        self.factor.is_none() || self.steps < FIRST || (self.steps - FIRST).is_multiple_of(SERVES)
    }

    /// Starts another frame: its first steps compute new matrices.
    pub fn renew(&mut self) {
        self.steps = 0;
    }
}

/// Returns pose and coefficients that best explain the observations. The coefficients have standard normal priors; the pose has none.
/// `matrix`: that of earlier nearby steps, or empty.
pub(super) fn solve(
    base: &[Vector3<f64>],
    directions: &Directions,
    seen: &[Seen],
    start: Solved,
    limit: Limit,
    matrix: &mut Matrix,
) -> Option<Solved> {
    let mut solved = start;
    let size = POSE + directions.count;
    let mut system = System::new(size);
    for _ in 0..limit.steps {
        system.restart(&solved.coefficients);
        let pose = solved.pose;
        for s in seen {
            let along = directions.of(s.node);
            let moved = Vector3::from(dots(along, solved.coefficients.as_slice()));
            let turned = pose.turned(&(base[s.node] + moved));
            let slopes = Slopes::new(&pose, &turned, s);
            slopes.pull(system.right.as_mut_slice(), along);
            if matrix.is_due() {
                (0..2).for_each(|axis| {
                    slopes.write_row(axis, system.rows.add(), along);
                });
            }
        }
        let step = system.step(matrix)?;
        let turn = Vector3::new(step[0], step[1], step[2]);
        let share = (LARGEST_TURN / turn.norm().max(LARGEST_TURN)).min(1.0);
        let step = step * share;
        solved.pose = pose.moved(Vector3::new(step[0], step[1], step[2]), step[3], Vector2::new(step[4], step[5]));
        solved.coefficients += step.rows(POSE, directions.count);
        let small = |k: usize| step[k].abs() < limit.at_rest;
        let shifts = step[4].abs().max(step[5].abs()) < limit.at_rest * solved.pose.scale;
        if shifts && (0..size).all(|k| k == 4 || k == 5 || small(k)) {
            break;
        }
    }
    let finite = solved.pose.scale.is_finite() && solved.pose.scale > 0.0 && solved.coefficients.iter().all(|c| c.is_finite());
    finite.then_some(solved)
}
