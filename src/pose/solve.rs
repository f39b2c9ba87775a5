//! One frame: pose and the coefficients of some directions of shape, the maximum a posteriori by Gauss-Newton.

use nalgebra::{DMatrix, DVector, Point2, Vector2, Vector3};

use super::HeadPose;

/// Largest turn of the head in one step, radians.
const LARGEST_TURN: f64 = 0.2;
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

/// When [`solve`] ends.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limit {
    /// Steps of Gauss-Newton at most.
    pub steps: usize,
    /// A step below this is the last: radians, logarithms, standard deviations.
    pub at_rest: f64,
}

/// Directions of shape, node by node, as [`solve`] wants them: all x, all y, all z of a node behind each other.
#[derive(Clone, Debug)]
pub(super) struct Directions {
    count: usize,
    by_node: Vec<f64>,
}

impl Directions {
    /// From one list of nodes a direction.
    pub fn new(directions: &[Vec<Vector3<f64>>], nodes: usize) -> Self {
        let of_node = |k: usize| (0..3).flat_map(move |axis| directions.iter().map(move |d| d[k][axis]));
        Self { count: directions.len(), by_node: (0..nodes).flat_map(of_node).collect() }
    }

    /// No direction at all.
    pub fn none() -> Self {
        Self { count: 0, by_node: Vec::new() }
    }

    /// x, y and z of a node in all directions.
    fn of(&self, node: usize) -> [&[f64]; 3] {
        let n = self.count;
        [0, 1, 2].map(|axis| &self.by_node[(3 * node + axis) * n..(3 * node + axis + 1) * n])
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// The normal equations of one frame, and one row for x and one for y of a node.
struct System {
    size: usize,
    /// Upper triangle, column by column.
    normal: DMatrix<f64>,
    right: DVector<f64>,
    rows: [Vec<f64>; 2],
}

impl System {
    fn new(size: usize) -> Self {
        let rows = [vec![0.0; size], vec![0.0; size]];
        Self { size, normal: DMatrix::zeros(size, size), right: DVector::zeros(size), rows }
    }

    /// The standard normal priors of the coefficients.
    fn restart(&mut self, coefficients: &DVector<f64>) {
        self.normal.fill(0.0);
        self.right.fill(0.0);
        for (j, &c) in coefficients.iter().enumerate() {
            self.normal[(POSE + j, POSE + j)] = 1.0;
            self.right[POSE + j] = -c;
        }
    }

    /// Adds what the two rows say with a weight.
    fn add(&mut self, weight: f64, residual: Vector2<f64>) {
        let [x, y] = &self.rows;
        for (i, column) in self.normal.as_mut_slice().chunks_exact_mut(self.size).enumerate() {
            let (by_x, by_y) = (weight * x[i], weight * y[i]);
            self.right[i] += by_x * residual.x + by_y * residual.y;
            for ((cell, x), y) in column[..=i].iter_mut().zip(&x[..=i]).zip(&y[..=i]) {
                *cell += by_x * x + by_y * y;
            }
        }
    }

    fn step(&mut self) -> Option<DVector<f64>> {
        self.normal.fill_lower_triangle_with_upper_triangle();
        Some(self.normal.clone().cholesky()?.solve(&self.right))
    }
}

/// Pose and coefficients that explain what is seen best; the coefficients have standard normal priors, the pose has none.
///
pub(super) fn solve(
    base: &[Vector3<f64>],
    directions: &Directions,
    seen: &[Seen],
    start: Solved,
    limit: Limit,
) -> Option<Solved> {
    let mut solved = start;
    let size = POSE + directions.count;
    let mut system = System::new(size);
    for _ in 0..limit.steps {
        system.restart(&solved.coefficients);
        let pose = solved.pose;
        for s in seen {
            let along = directions.of(s.node);
            let moved = Vector3::from(along.map(|axis| dot(axis, solved.coefficients.as_slice())));
            let turned = pose.turned(&(base[s.node] + moved));
            let residual: Vector2<f64> = s.at - pose.image_of(&turned);
            let deviation = s.deviation * pose.scale;
            let weight = robust(residual.norm() / deviation) / (deviation * deviation);
            let slope = pose.slope(&turned);
            let by_turn = slope * HeadPose::rotation_slope(&turned);
            let by_point = slope * pose.rotation.matrix();
            let seen_at = pose.image_of(&turned) - pose.position;
            for (axis, line) in system.rows.iter_mut().enumerate() {
                (0..3).for_each(|k| line[k] = by_turn[(axis, k)]);
                line[3] = seen_at[axis];
                line[4] = f64::from(u8::from(axis == 0));
                line[5] = f64::from(u8::from(axis == 1));
                let by = [by_point[(axis, 0)], by_point[(axis, 1)], by_point[(axis, 2)]];
                for (((cell, x), y), z) in line[POSE..].iter_mut().zip(along[0]).zip(along[1]).zip(along[2]) {
                    *cell = by[0] * x + by[1] * y + by[2] * z;
                }
            }
            system.add(weight, residual);
        }
        let step = system.step()?;
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
