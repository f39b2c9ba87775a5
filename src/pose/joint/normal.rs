//! Normal equations of a joint step. They have a block for the own offset of every node; the blocks are coupled only through the other
//! unknowns, and are eliminated: the Schur complement of bundle adjustment.
//!
//! B. Triggs, P. `McLauchlan`, R. Hartley, A. Fitzgibbon: *Bundle adjustment: a modern synthesis*, Vision Algorithms, LNCS 1883, 2000,
//! section 6.1.

use nalgebra::{Cholesky, DMatrix, Dyn, Matrix3, Matrix3x6, Vector2, Vector3};

use super::{
    super::solve::{POSE, Slopes, dots},
    Descent, LOG_DISTANCE_DEVIATION, Problem, Step,
};
use crate::least_squares::{Rows, add_mixture, cholesky};

/// Added to the diagonal of poses, so that a view in which nothing is seen stays as it is.
const RIDGE: f64 = 1e-9;

/// Sums of the normal equations over the observations.
pub(super) struct Assembly {
    /// Equations of all unknowns but the nodes' own offsets.
    others: DMatrix<f64>,
    /// Rows of the current view: identity, distance, pose, expression.
    rows: Rows,
    nodes: Vec<Node>,
}

/// Sums of one node.
#[derive(Clone)]
struct Node {
    block: Matrix3<f64>,
    by_log_distance: Vector3<f64>,
    /// View, share of the block, and coupling to the view's pose.
    views: Vec<(usize, Matrix3<f64>, Matrix3x6<f64>)>,
}

/// Factored normal equations.
pub(super) struct Normal {
    /// By node: the inverse of the lower root of its block.
    roots: Vec<Matrix3<f64>>,
    /// The nodes that some view observes; the others are coupled to nothing.
    observed: Vec<usize>,
    /// Three rows for every observed node: the inverse root times its coupling to the others.
    coupling: Rows,
    others: Cholesky<f64, Dyn>,
}

impl Assembly {
    pub fn new(problem: &Problem<'_>, views: usize) -> Self {
        let size = problem.column(views);
        let node = Node { block: Matrix3::zeros(), by_log_distance: Vector3::zeros(), views: Vec::with_capacity(views) };
        let mut others = DMatrix::zeros(size, size);
        // Priors.
        (0..problem.identity.count()).for_each(|k| others[(k, k)] = 1.0);
        others[(problem.identity.count(), problem.identity.count())] = LOG_DISTANCE_DEVIATION.powi(-2);
        for v in 0..views {
            let (pose, expression) = (problem.column(v), problem.column(v) + POSE);
            (pose..expression).for_each(|k| others[(k, k)] = RIDGE);
            (expression..problem.column(v + 1)).for_each(|k| others[(k, k)] = 1.0);
        }
        Self { others, rows: Rows::new(problem.identity.count() + 1 + POSE), nodes: vec![node; problem.model.node_count()] }
    }

    /// Adds an observation of the current view: its slopes, and that by the logarithm of the distance.
    pub fn add(&mut self, problem: &Problem<'_>, view: usize, node: usize, (slopes, by_log_distance): (&Slopes, Vector2<f64>)) {
        let root = slopes.weight.sqrt();
        for axis in 0..2 {
            let (identity, rest) = self.rows.add().split_at_mut(problem.identity.count());
            let (distance, rest) = rest.split_at_mut(1);
            let by_point = slopes.write_row(axis, rest, problem.along(view, node));
            add_mixture(identity, by_point, problem.identity.of(node));
            distance[0] = by_log_distance[axis] * root;
        }
        let weighted = slopes.by_point.transpose() * slopes.weight;
        let block = weighted * slopes.by_point;
        let sums = &mut self.nodes[node];
        sums.block += block;
        sums.by_log_distance += weighted * by_log_distance;
        sums.views.push((view, block, weighted * slopes.by_pose));
    }

    /// Ends a view: moves its sums to their columns.
    pub fn end_view(&mut self, problem: &Problem<'_>, view: usize) {
        let shared = problem.identity.count() + 1;
        let first = problem.column(view);
        let size = shared + problem.column(view + 1) - first;
        let mut sums = DMatrix::<f64>::zeros(size, size);
        self.rows.add_squares(&mut sums);
        let column = |k: usize| if k < shared { k } else { first + k - shared };
        for (j, i) in (0..size).flat_map(|j| (j..size).map(move |i| (j, i))) {
            self.others[(column(i), column(j))] += sums[(i, j)];
        }
        self.rows = Rows::new(shared + POSE + problem.expression.count());
    }

    /// Eliminates the nodes' own offsets and factors the rest. `None` when the observations determine no solution.
    pub fn normal(mut self, problem: &Problem<'_>) -> Option<Normal> {
        let (identities, size) = (problem.identity.count(), self.others.nrows());
        let mut roots = Vec::with_capacity(self.nodes.len());
        let mut coupling = Rows::new(size);
        let mut observed = Vec::new();
        for (k, node) in self.nodes.iter().enumerate() {
            let root = (node.block + problem.own[k].precision).cholesky()?.l().try_inverse()?;
            roots.push(root);
            if node.views.is_empty() {
                continue;
            }
            observed.push(k);
            let by_log_distance = root * node.by_log_distance;
            let shares = |m: &Matrix3<f64>, axis: usize| [0, 1, 2].map(|c| m[(axis, c)]);
            let by_point = root * node.block;
            let views: Vec<_> = node.views.iter().map(|(v, block, by_pose)| (*v, root * block, root * by_pose)).collect();
            for axis in 0..3 {
                let row = coupling.add();
                add_mixture(&mut row[..identities], shares(&by_point, axis), problem.identity.of(k));
                row[identities] = by_log_distance[axis];
                for (v, by_point, by_pose) in &views {
                    let (pose, expression) = row[problem.column(*v)..problem.column(v + 1)].split_at_mut(POSE);
                    pose.iter_mut().zip(by_pose.row(axis).iter()).for_each(|(cell, value)| *cell = *value);
                    add_mixture(expression, shares(by_point, axis), problem.along(*v, k));
                }
            }
        }
        let mut eliminated = DMatrix::<f64>::zeros(size, size);
        coupling.add_squares(&mut eliminated);
        self.others -= eliminated;
        // Only the lower triangle is read.
        Some(Normal { roots, observed, coupling, others: cholesky(self.others)? })
    }
}

impl Normal {
    /// Returns the step from the direction of descent.
    pub fn step(&self, descent: &Descent) -> Step {
        let pulls: Vec<Vector3<f64>> = self.roots.iter().zip(&descent.own).map(|(root, pull)| root * pull).collect();
        let mut right = descent.others.clone();
        for (&k, rows) in self.observed.iter().zip(self.coupling.threes()) {
            add_mixture(right.as_mut_slice(), (-pulls[k]).into(), rows);
        }
        let others = self.others.solve(&right);
        let mut own = pulls;
        for (&k, rows) in self.observed.iter().zip(self.coupling.threes()) {
            own[k] -= Vector3::from(dots(rows, others.as_slice()));
        }
        own.iter_mut().zip(&self.roots).for_each(|(own, root)| *own = root.transpose() * *own);
        Step { own, others }
    }
}
