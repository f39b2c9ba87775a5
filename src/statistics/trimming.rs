//! Removes outlying displacement fields [KP, section 4.3 and eq. (6)].
//!
//! Trimming is at frame level, as in \[KP\]: each of the N' - 1 displacement fields has its own ranking of the N'' models and loses its
//! own floor(alpha N''). A model can stay in one field and be dropped from another. [`TrimLevel::Model`] instead drops whole models,
//! ranked by `d_t`, the mean of `d_tf` over the fields. With weights (one person, one weight), the farthest models are dropped while
//! their total weight is at most alpha of all.

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::distance::DisplacementFields;

/// Number of models per block of the pairwise distances. Two blocks of one field fit into the cache. The order of summation depends on
/// nothing else.
const BLOCK: usize = 32;

/// What is trimmed: displacement fields or whole models.
///
/// ```
/// # use grimace::{model, normalize, units, wireframe};
/// let face = grimace::wireframe::Face::candide3();
/// # let neutral = normalize::Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// # let smile = |subject: &str, up: f64| {
/// #     let frame = |m: usize| {
/// #         let mut nodes = neutral.nodes().to_vec();
/// #         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
/// #         model::FrameExpressionModel::new(nodes)
/// #     };
/// #     let id = units::SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
/// #     let model = model::DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
/// #     grimace::statistics::SequenceModel { id, model }
/// # };
/// # let label = grimace::statistics::ClassLabel { emotion: "smile".to_owned(), group: Default::default() };
/// use grimace::statistics::{StatisticsOptions, TrimLevel, representative};
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 12.0), smile("P3", 14.0), smile("P4", 500.0)];
/// let options = StatisticsOptions { alpha: 0.25, trim: TrimLevel::Model, ..StatisticsOptions::default() };
/// let trimmed = representative(label, &models, &face.wireframe, &options)?;
/// // One of four models goes, as a whole: it has no distance any more.
/// assert_eq!(trimmed.distances.iter().position(Option::is_none), Some(3));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TrimLevel {
    /// Displacement fields, each by its own ranking: the frame level of \[KP\].
    #[default]
    Frame,
    /// Whole models.
    Model,
}

/// Result of the trimming: the distances, and the models kept in every field.
#[derive(Clone, Debug, PartialEq)]
pub struct Trimming {
    /// `d_tf` [KP, eq. (6)] by field, then by model: mean distance to the other models, in the models' unit. It is 0 for a single model,
    /// for which the equation gives 0 / 0.
    pub distances: Vec<Vec<f64>>,
    /// Indices of the models kept, by field, ascending. Never empty.
    pub kept: Vec<Vec<usize>>,
}

impl Trimming {
    /// Returns whether nothing was dropped.
    pub fn is_empty(&self) -> bool {
        self.kept.iter().zip(&self.distances).all(|(kept, all)| kept.len() == all.len())
    }
}

/// Drops the floor(alpha N'') models with the largest `d_tf` from every displacement field.
///
/// Implements [KP, section 4.3]. Of two models at exactly the same distance, the later one in `models` is dropped first; callers sort by
/// sequence id, so the larger id is dropped. `row_sums` are the result of [`sums_of_distances`] for all models, with the same `weights`.
pub fn trim_outliers(row_sums: &[Vec<f64>], weights: Option<&[f64]>, alpha: f64, level: TrimLevel) -> Trimming {
    let total = weights.map_or(0.0, |weights| weights.iter().sum());
    let others = |i: usize, n: usize| weights.map_or((n - 1) as f64, |weights| total - weights[i]);
    let mean = |(i, sum): (usize, &f64), n: usize| if n > 1 { sum / others(i, n) } else { 0.0 };
    let distances: Vec<Vec<f64>> =
        row_sums.iter().map(|sums| sums.iter().enumerate().map(|s| mean(s, sums.len())).collect()).collect();
    let keep = |d: &[f64]| match weights {
        None => keep(d, trimmed_count(alpha, d.len())),
        Some(weights) => keep_weighted(d, weights, alpha * total),
    };
    let kept = match level {
        TrimLevel::Frame => distances.iter().map(|d| keep(d)).collect(),
        TrimLevel::Model => {
            let models = distances.first().map_or(0, Vec::len);
            let of_model = |i: usize| distances.iter().map(|d| d[i]).sum::<f64>() / distances.len() as f64;
            vec![keep(&(0..models).map(of_model).collect::<Vec<_>>()); distances.len()]
        }
    };
    Trimming { distances, kept }
}

/// Returns floor(alpha N''), the number of models trimmed from a field.
///
/// A product just below a whole number because of rounding counts as that number: 0.29 of 100 models is 29, although the product of the
/// two doubles is 28.999999999999996.
pub fn trimmed_count(alpha: f64, model_count: usize) -> usize {
    let product = alpha * model_count as f64;
    // alpha and the product are each rounded by at most half an epsilon.
    (product * (1.0 + 2.0 * f64::EPSILON)).floor() as usize
}

fn keep(distances: &[f64], dropped: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..distances.len()).collect();
    order.sort_by(|&a, &b| distances[a].total_cmp(&distances[b]).then(a.cmp(&b)));
    order.truncate(distances.len() - dropped);
    order.sort_unstable();
    order
}

/// Returns the models kept when the farthest are dropped while their total weight is at most `limit`. At least one model is kept.
fn keep_weighted(distances: &[f64], weights: &[f64], limit: f64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..distances.len()).collect();
    order.sort_by(|&a, &b| distances[a].total_cmp(&distances[b]).then(a.cmp(&b)));
    let mut dropped = 0.0;
    while let Some(&last) = order.last().filter(|_| order.len() > 1) {
        dropped += weights[last];
        if dropped > limit * (1.0 + 1e-12) {
            break;
        }
        order.pop();
    }
    order.sort_unstable();
    order
}

/// Returns, for every field m and every model of `members[m]`, the sum of its distances `d_f` to the other members, weighted by their
/// weights. The order is that of `members[m]`.
///
/// The time is O(sum of squares of the member counts times N). Each pair is computed once, in parallel over pairs of blocks. The sums of
/// a model's blocks are added in block order, so the result is identical for any number of threads. Equal models get equal sums.
///
/// # Panics
/// If a member is not in `models`, or the models differ in shape (a programmer's error).
pub fn sums_of_distances(models: &[DisplacementFields], members: &[Vec<usize>], weights: Option<&[f64]>) -> Vec<Vec<f64>> {
    let mut pairs = Vec::new();
    for (m, members) in members.iter().enumerate() {
        let blocks = members.len().div_ceil(BLOCK);
        pairs.extend((0..blocks).flat_map(|row| (row..blocks).map(move |column| (m, row, column))));
    }
    let partial: Vec<_> =
        pairs.par_iter().map(|&(m, row, column)| block_sums(models, &members[m], weights, m, row, column)).collect();
    let mut sums: Vec<Vec<f64>> = members.iter().map(|members| vec![0.0; members.len()]).collect();
    let add = |sums: &mut [f64], block: usize, partial: &[f64]| {
        sums[block * BLOCK..].iter_mut().zip(partial).for_each(|(sum, partial)| *sum += partial);
    };
    // Row r adds its blocks in the order (0, r), ..., (r - 1, r), (r, r), (r, r + 1), ...
    for (&(m, row, column), (to_row, to_column)) in pairs.iter().zip(&partial) {
        add(&mut sums[m], row, to_row);
        if row != column {
            add(&mut sums[m], column, to_column);
        }
    }
    sums
}

/// Returns the sums of distances between the members of two blocks, for the row block's members and for the column block's.
fn block_sums(
    models: &[DisplacementFields],
    members: &[usize],
    weights: Option<&[f64]>,
    m: usize,
    row: usize,
    column: usize,
) -> ([f64; BLOCK], [f64; BLOCK]) {
    let block = |b: usize| &members[b * BLOCK..members.len().min((b + 1) * BLOCK)];
    let (mut to_row, mut to_column) = ([0.0; BLOCK], [0.0; BLOCK]);
    for (r, &a) in block(row).iter().enumerate() {
        let first = if row == column { r + 1 } else { 0 };
        for (c, &b) in block(column).iter().enumerate().skip(first) {
            let distance = models[a].frame_distance(&models[b], m);
            let (weight_a, weight_b) = weights.map_or((1.0, 1.0), |weights| (weights[a], weights[b]));
            to_row[r] += weight_b * distance;
            let mirrored = if row == column { &mut to_row } else { &mut to_column };
            mirrored[c] += weight_a * distance;
        }
    }
    (to_row, to_column)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;
    use proptest::prelude::*;

    use super::{super::distance::tests::vectors, *};

    fn models(xs: &[f64]) -> Vec<DisplacementFields> {
        xs.iter().map(|&x| DisplacementFields::from_vectors(1, &[Vector2::new(x, 0.0)])).collect()
    }

    fn all(models: &[DisplacementFields]) -> Vec<Vec<usize>> {
        models.first().map_or(Vec::new(), |model| vec![(0..models.len()).collect(); model.field_count()])
    }

    fn trim(models: &[DisplacementFields], alpha: f64) -> Trimming {
        trim_outliers(&sums_of_distances(models, &all(models), None), None, alpha, TrimLevel::Frame)
    }

    #[test]
    fn the_farthest_is_dropped() {
        // One node, one field, vectors 0, 1, 2, 9 on a line.
        // d_tf: (1+2+9)/3 = 4, (1+1+8)/3, (2+1+7)/3, (9+8+7)/3 = 8.
        let trimming = trim(&models(&[0.0, 1.0, 9.0, 2.0]), 0.25);
        assert_eq!(trimming.distances, [[4.0, 10.0 / 3.0, 8.0, 10.0 / 3.0]]);
        assert_eq!(trimming.kept, [[0, 1, 3]]);
    }

    #[test]
    fn of_two_tied_models_the_later_is_dropped() {
        // 0 and 2 are equally far (3) from the rest {0, 1, 1, 2}: (1+1+2)/3.
        let tied = models(&[0.0, 1.0, 1.0, 2.0]);
        let trimming = trim(&tied, 0.25);
        assert_eq!(trimming.distances[0][0], trimming.distances[0][3]);
        assert_eq!(trimming.kept, [[0, 1, 2]]);
        assert_eq!(trim(&models(&[5.0; 10]), 0.3).kept, [(0..7).collect::<Vec<_>>()]);
    }

    #[test]
    fn whole_models_are_dropped_by_their_mean_distance() {
        // Two fields; d_tf: field 0 of 0, 1, 2, 9: 4, 10/3, 10/3, 8; field 1 of 20, 0, 1, 2: 19, 23/3, 7, 7. By field 3 and 0 go; by
        // model 0 with (4 + 19) / 2 against (8 + 7) / 2.
        let model = |a: f64, b: f64| DisplacementFields::from_vectors(1, &[Vector2::new(a, 0.0), Vector2::new(b, 0.0)]);
        let models = [model(0.0, 20.0), model(1.0, 0.0), model(2.0, 1.0), model(9.0, 2.0)];
        let sums = sums_of_distances(&models, &all(&models), None);
        assert_eq!(trim_outliers(&sums, None, 0.25, TrimLevel::Frame).kept, [[0, 1, 2], [1, 2, 3]]);
        assert_eq!(trim_outliers(&sums, None, 0.25, TrimLevel::Model).kept, [[1, 2, 3], [1, 2, 3]]);
    }

    #[test]
    fn many_sequences_of_one_person_are_trimmed_by_their_weight() {
        // Person a at 10 with three sequences, b to e at 0 with one each. Alpha 0.4 of 5 people is two. Counted by sequences, two of a's
        // are dropped; by people, all three and one of the four others.
        let people = models(&[10.0, 10.0, 10.0, 0.0, 0.0, 0.0, 0.0]);
        let third = 1.0 / 3.0;
        let weights = [third, third, third, 1.0, 1.0, 1.0, 1.0];
        let sums = sums_of_distances(&people, &all(&people), Some(&weights));
        // From a to the four others: 40, divided by a weight of 5 - 1/3. From b to person a: 10, divided by 4.
        let trimming = trim_outliers(&sums, Some(&weights), 0.4, TrimLevel::Frame);
        approx::assert_relative_eq!(trimming.distances[0][0], 40.0 / (5.0 - third), max_relative = 1e-12);
        approx::assert_relative_eq!(trimming.distances[0][3], 2.5, max_relative = 1e-12);
        assert_eq!(trimming.kept, [[3, 4, 5]]);
        assert_eq!(trim(&people, 0.4).kept, [[0, 3, 4, 5, 6]]);
    }

    #[test]
    fn a_single_model_is_kept_at_distance_zero() {
        let trimming = trim(&models(&[7.0]), 0.49);
        assert_eq!((trimming.distances.clone(), trimming.kept.clone()), (vec![vec![0.0]], vec![vec![0]]));
        assert!(trimming.is_empty());
    }

    #[test]
    fn the_number_trimmed_is_the_floor() {
        let cases =
            [(0.1, 9, 0), (0.1, 10, 1), (0.1, 19, 1), (0.1, 20, 2), (0.29, 100, 29), (0.07, 100, 7), (0.0, 50, 0), (0.49, 1, 0)];
        for (alpha, n, expected) in cases {
            assert_eq!(trimmed_count(alpha, n), expected, "{alpha} of {n}");
        }
    }

    #[test]
    fn blocks_cover_every_pair_once() {
        // 0, 1, ..., 99 on a line, more than three blocks: the sum for i is i (i + 1) / 2 + (99 - i)(100 - i) / 2, exact in doubles.
        let line = models(&(0..100).map(f64::from).collect::<Vec<_>>());
        let sums = sums_of_distances(&line, &all(&line), None);
        let expected: Vec<f64> = (0..100).map(|i| f64::from(i * (i + 1) / 2 + (99 - i) * (100 - i) / 2)).collect();
        assert_eq!(sums, [expected]);
        // Only the members count: 3, 50 and 90 have distances 47 + 87, 47 + 40 and 87 + 40.
        assert_eq!(sums_of_distances(&line, &[vec![3, 50, 90]], None), [[134.0, 87.0, 127.0]]);
    }

    proptest! {
        #[test]
        fn a_larger_alpha_trims_a_superset(values in vectors(40 * 6), small in 0.0..0.5f64, large in 0.0..0.5f64) {
            let models: Vec<_> = values.chunks(6).map(|v| DisplacementFields::from_vectors(3, v)).collect();
            let (small, large) = (small.min(large), small.max(large));
            let (few, many) = (trim(&models, small), trim(&models, large));
            for (few, many) in few.kept.iter().zip(&many.kept) {
                prop_assert_eq!(few.len(), 40 - trimmed_count(small, 40));
                prop_assert!(many.iter().all(|i| few.contains(i)));
            }
            prop_assert!(trim(&models, 0.0).is_empty());
        }

        #[test]
        fn equal_models_have_equal_sums(values in vectors(70 * 5), copy in 0..69usize) {
            let mut models: Vec<_> = values.chunks(5).map(|v| DisplacementFields::from_vectors(5, v)).collect();
            models[69] = models[copy].clone();
            let sums = sums_of_distances(&models, &all(&models), None);
            prop_assert_eq!(sums[0][69], sums[0][copy]);
        }
    }
}
