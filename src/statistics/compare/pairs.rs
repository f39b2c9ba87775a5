//! Distances between people, node by node, and the energy distance of a split.

use rayon::prelude::*;

use super::mean;
use crate::statistics::distance::{DisplacementFields, vector_distance};

/// Distances between all pairs of n people at each of N nodes.
#[derive(Clone, Debug)]
pub(super) struct PairDistances {
    people: usize,
    nodes: usize,
    /// Distances by pair (i, j), i < j, in the order (0, 1), (0, 2), ..., (1, 2), ...; N nodes per pair.
    pairs: Vec<f64>,
    /// Sums over all others for every person, by node.
    rows: Vec<f64>,
    /// Sums over all pairs, by node.
    total: Vec<f64>,
}

/// Energy distances of one split, by node.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Energy {
    /// `E_k`.
    pub nodes: Vec<f64>,
    /// Mean distance between people of different groups, over all nodes.
    pub between: f64,
}

impl Energy {
    /// Returns H = E / (2 mean distance between the groups), or 0 if all people are equal.
    pub fn effect(&self) -> f64 {
        if self.between > 0.0 { mean(&self.nodes) / (2.0 * self.between) } else { 0.0 }
    }
}

impl PairDistances {
    /// Computes the distances of people, given by the displacement fields of their sequences: the mean of `d_v` [KP, eq. (3)] over the
    /// pairs of sequences and the fields.
    pub fn new(people: &[Vec<DisplacementFields>]) -> Self {
        let n = people.len();
        let nodes = people.first().and_then(|p| p.first()).map_or(0, DisplacementFields::node_count);
        let row = |i: usize| -> Vec<f64> { ((i + 1)..n).flat_map(|j| distances(&people[i], &people[j], nodes)).collect() };
        let pairs: Vec<f64> = (0..n).into_par_iter().map(row).collect::<Vec<_>>().concat();
        let (mut rows, mut total) = (vec![0.0; n * nodes], vec![0.0; nodes]);
        let mut chunks = pairs.chunks_exact(nodes.max(1));
        for i in 0..n {
            for j in (i + 1)..n {
                let Some(pair) = chunks.next() else { break };
                for (k, d) in pair.iter().enumerate() {
                    rows[i * nodes + k] += d;
                    rows[j * nodes + k] += d;
                    total[k] += d;
                }
            }
        }
        Self { people: n, nodes, pairs, rows, total }
    }

    pub fn people(&self) -> usize {
        self.people
    }

    pub fn nodes(&self) -> usize {
        self.nodes
    }

    /// Returns the index of the pair (i, j), i < j.
    fn place(&self, i: usize, j: usize) -> usize {
        i * self.people - i * (i + 1) / 2 + (j - i - 1)
    }

    /// Returns the energy distances between the people in `members` (ascending) and all others.
    ///
    /// # Panics
    /// If one of the two groups has fewer than two people (a programmer's error).
    pub fn energy(&self, members: &[usize]) -> Energy {
        let (a, b) = (members.len() as f64, (self.people - members.len()) as f64);
        let (mut within, mut crossing) = (vec![0.0; self.nodes], vec![0.0; self.nodes]);
        for (place, &i) in members.iter().enumerate() {
            for &j in &members[place + 1..] {
                let start = self.place(i, j) * self.nodes;
                within.iter_mut().zip(&self.pairs[start..start + self.nodes]).for_each(|(sum, d)| *sum += d);
            }
            let row = &self.rows[i * self.nodes..(i + 1) * self.nodes];
            crossing.iter_mut().zip(row).for_each(|(sum, d)| *sum += d);
        }
        let mut between = 0.0;
        let nodes = (0..self.nodes).map(|k| {
            let (a_a, a_all) = (within[k], crossing[k]);
            let a_b = a_all - 2.0 * a_a;
            let b_b = self.total[k] - a_a - a_b;
            between += a_b / (a * b);
            2.0 * a_b / (a * b) - 2.0 * a_a / (a * (a - 1.0)) - 2.0 * b_b / (b * (b - 1.0))
        });
        let nodes: Vec<f64> = nodes.collect();
        Energy { between: between / self.nodes.max(1) as f64, nodes }
    }
}

/// Returns the matrix of distances between people, as means over the nodes.
pub(crate) fn distance_matrix(people: &[Vec<DisplacementFields>]) -> Vec<Vec<f64>> {
    let n = people.len();
    let nodes = people.first().and_then(|p| p.first()).map_or(0, DisplacementFields::node_count);
    let row = |i: usize| -> Vec<f64> { (i + 1..n).map(|j| mean(&distances(&people[i], &people[j], nodes))).collect() };
    let rows: Vec<Vec<f64>> = (0..n).into_par_iter().map(row).collect();
    let distance = |i: usize, j: usize| if i == j { 0.0 } else { rows[i.min(j)][i.max(j) - i.min(j) - 1] };
    (0..n).map(|i| (0..n).map(|j| distance(i, j)).collect()).collect()
}

/// Returns the distances of two people, node by node.
fn distances(a: &[DisplacementFields], b: &[DisplacementFields], nodes: usize) -> Vec<f64> {
    let mut sums = vec![0.0; nodes];
    let mut count = 0.0;
    for (x, y) in a.iter().flat_map(|x| b.iter().map(move |y| (x, y))) {
        for m in 0..x.field_count() {
            sums.iter_mut().enumerate().for_each(|(k, sum)| *sum += vector_distance(x.vector(m, k), y.vector(m, k)));
            count += 1.0;
        }
    }
    sums.iter_mut().for_each(|sum| *sum /= count);
    sums
}
