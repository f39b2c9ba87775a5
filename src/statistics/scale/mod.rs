//! Statistics of more than [`MANY_MODELS`] models, in bounded memory and in time nearly linear in their number.
//!
//! All quantities of [KP, eq. (6) to (8)] split over the nodes. The distance d is a mean over nodes, so `d_tf`, the sum of distances and
//! the distance to the median are means over nodes of planar sums; eq. (7) is a planar problem per node and field. A [`SlotSource`]
//! supplies the vectors of one node at a time, from memory or from a file. Only a few nodes of all models are in memory at once.
//!
//! The trimmed models are determined from bounds ([`trimming`]) instead of from all pairs. The median is the exact one. Sums over nodes
//! are taken in node order, so the result is identical for any number of threads and any memory limit.

pub mod trimming;

use std::{io, path::PathBuf};

use nalgebra::{Point2, Vector2};
use rayon::prelude::*;

use super::{
    ClassLabel, MedianKind, MedianSearch, MedianSums, Representative, StatisticsError, StatisticsOptions, TrimmingRow,
    dispersion::{Dispersions, median_of},
    distance::{DisplacementFields, length},
    median::{ExactOptions, GeometricMedian, PointSet, SearchEnding, geometric_median},
    representative::{at_all_nodes, model_from_displacements},
    sum::CompensatedSum,
    trimming::{TrimLevel, trimmed_count},
    weights::sequence_weights,
};
use crate::{units::SequenceId, wireframe::Wireframe};

pub use trimming::{Certificate, CertifiedTrimming, trim_certified};

/// Largest number of models in a class for which all pairs and the greedy median are computed. Larger classes are processed here.
pub const MANY_MODELS: usize = 2048;

/// Default memory limit, bytes.
pub const DEFAULT_MEMORY: u64 = 1 << 31;

/// Memory per model and slot of a node in work, bytes: its vectors, the copies made for the median, and sums of distances.
const BYTES_PER_SLOT: u64 = 80;

/// Largest number of nodes processed at once.
const MOST_NODES_AT_ONCE: usize = 16;

/// Error when displacement vectors cannot be read.
#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct SourceError {
    /// The file.
    pub path: PathBuf,
    /// Description of the error.
    pub reason: String,
}

impl SourceError {
    /// Makes an error from an I/O error of a file.
    pub fn io(path: &std::path::Path) -> impl Fn(io::Error) -> Self + '_ {
        move |error| Self { path: path.to_owned(), reason: error.to_string() }
    }
}

/// Displacement vectors of very many models, supplied node by node.
pub trait SlotSource: Sync {
    /// Returns the number of models N''.
    fn model_count(&self) -> usize;
    /// Returns the number of live nodes N.
    fn node_count(&self) -> usize;
    /// Returns the number of displacement fields, N' - 1.
    fn field_count(&self) -> usize;
    /// Returns the vectors of the k-th live node, by field, in the order of the models. They must be finite.
    ///
    /// # Errors
    /// `SourceError` when they cannot be read.
    fn node(&self, k: usize) -> Result<Vec<Vec<Vector2<f64>>>, SourceError>;
}

impl SlotSource for [DisplacementFields] {
    fn model_count(&self) -> usize {
        self.len()
    }

    fn node_count(&self) -> usize {
        self.first().map_or(0, DisplacementFields::node_count)
    }

    fn field_count(&self) -> usize {
        self.first().map_or(0, DisplacementFields::field_count)
    }

    fn node(&self, k: usize) -> Result<Vec<Vec<Vector2<f64>>>, SourceError> {
        Ok((0..self.field_count()).map(|m| self.iter().map(|model| model.vector(m, k)).collect()).collect())
    }
}

/// Returns the number of nodes whose data fit into `memory` bytes, at least one.
fn nodes_at_once<S: SlotSource + ?Sized>(source: &S, memory: u64) -> usize {
    let per_node = BYTES_PER_SLOT * (source.model_count() * source.field_count()).max(1) as u64;
    usize::try_from(memory / per_node).unwrap_or(usize::MAX).clamp(1, MOST_NODES_AT_ONCE)
}

/// The exact median of a class and the models' distances to it.
#[derive(Clone, Debug)]
pub struct StreamedMedian {
    /// The median's vectors, in slot order.
    pub vectors: Vec<Vector2<f64>>,
    /// Sum of distances [KP, eq. (7)] over the kept models, face units.
    pub sum: f64,
    /// Proven lower bound of `sum`.
    pub lower_bound: f64,
    /// Number of steps over all slots.
    pub steps: usize,
    /// The worst ending of any slot.
    pub ending: SearchEnding,
    /// Distance of every model over its kept fields; `None` if no field is kept.
    pub distances: Vec<Option<f64>>,
    /// Distance of every model over all fields.
    pub distances_all: Vec<f64>,
    /// Mean over the fields of the median of `d_f` over the models kept in the field.
    pub field_dispersion: Option<f64>,
    /// For every live node the median over the models of the mean of `d_v` over the kept fields.
    pub node_dispersion: Vec<f64>,
}

/// Computes the exact median in one pass over the nodes.
///
/// `kept[m]` are the indices of the models kept in field m, ascending; `None` keeps all. `weights` are the models' weights, or `None` if
/// all are equal.
///
/// # Errors
/// `SourceError`.
pub fn streamed_median<S: SlotSource + ?Sized>(
    source: &S,
    kept: Option<&[Vec<usize>]>,
    weights: Option<&[f64]>,
    memory: u64,
) -> Result<StreamedMedian, SourceError> {
    let (models, nodes, fields) = (source.model_count(), source.node_count(), source.field_count());
    let options = ExactOptions::default();
    // Whether a model is kept, by field and model; `None` without trimming.
    let is_kept: Option<Vec<Vec<bool>>> = kept.map(|kept| {
        let of_field = |members: &Vec<usize>| {
            let mut flags = vec![false; models];
            members.iter().for_each(|&i| flags[i] = true);
            flags
        };
        kept.iter().map(of_field).collect()
    });
    let fields_of: Vec<usize> =
        (0..models).map(|i| is_kept.as_ref().map_or(fields, |flags| flags.iter().filter(|field| field[i]).count())).collect();
    let mut vectors = vec![Vector2::zeros(); nodes * fields];
    let (mut sums, mut bounds) = (vec![0.0; nodes * fields], vec![0.0; nodes * fields]);
    let (mut steps, mut ending) = (0, SearchEnding::Converged);
    // Sums over the nodes of d_v, by field and model.
    let mut totals = vec![vec![0.0; models]; fields];
    let member_weights: Option<Vec<Vec<f64>>> = kept
        .zip(weights)
        .map(|(kept, weights)| kept.iter().map(|members| members.iter().map(|&i| weights[i]).collect()).collect());
    let mut node_dispersion = Vec::with_capacity(nodes);
    let mut start = 0;
    while start < nodes {
        let end = nodes.min(start + nodes_at_once(source, memory));
        let read: Vec<Vec<Vec<Vector2<f64>>>> = (start..end).map(|k| source.node(k)).collect::<Result<_, _>>()?;
        let slots: Vec<(usize, usize)> = (0..read.len()).flat_map(|k| (0..fields).map(move |m| (k, m))).collect();
        let solve = |&(k, m): &(usize, usize)| {
            let points = &read[k][m];
            match &is_kept {
                None => geometric_median(&PointSet::known(points, weights), &options),
                Some(flags) => {
                    let members: Vec<Vector2<f64>> =
                        points.iter().zip(&flags[m]).filter(|(_, kept)| **kept).map(|(p, _)| *p).collect();
                    geometric_median(&PointSet::known(&members, member_weights.as_ref().map(|w| w[m].as_slice())), &options)
                }
            }
        };
        let medians: Vec<GeometricMedian> = slots.par_iter().map(solve).collect();
        for (&(k, m), found) in slots.iter().zip(&medians) {
            let slot = m * nodes + start + k;
            (vectors[slot], sums[slot], bounds[slot]) = (found.point, found.sum, found.lower_bound);
            steps += found.iterations;
            ending = ending.max(found.ending);
        }
        // d_v of every model, by field, at one node.
        let of_node = |k: usize| -> Vec<Vec<f64>> {
            let of_field = |m: usize| {
                let center = medians[k * fields + m].point;
                read[k][m].iter().map(|p| length(p.x - center.x, p.y - center.y)).collect()
            };
            (0..fields).map(of_field).collect()
        };
        let per_node: Vec<(Vec<Vec<f64>>, f64)> = (0..read.len())
            .into_par_iter()
            .map(|k| {
                let distances = of_node(k);
                let means = (0..models).map(|i| mean_of_kept(&distances, is_kept.as_deref(), fields_of[i], i));
                let scatter = median_of(means, weights).unwrap_or(0.0);
                (distances, scatter)
            })
            .collect();
        for (distances, scatter) in per_node {
            for (totals, distances) in totals.iter_mut().zip(&distances) {
                totals.iter_mut().zip(distances).for_each(|(total, d)| *total += d);
            }
            node_dispersion.push(scatter);
        }
        start = end;
    }
    let total = |values: &[f64]| CompensatedSum::of(values.iter().copied()) / (nodes * fields) as f64;
    totals.iter_mut().flatten().for_each(|total| *total /= nodes as f64);
    let distance = |i: usize| mean_of_kept(&totals, is_kept.as_deref(), fields_of[i], i);
    let of_field = |m: usize| {
        let is_in = |i: usize| is_kept.as_ref().is_none_or(|flags| flags[m][i]);
        median_of((0..models).map(|i| is_in(i).then(|| totals[m][i])), weights)
    };
    let by_field: Option<Vec<f64>> = (0..fields).map(of_field).collect();
    Ok(StreamedMedian {
        sum: total(&sums),
        lower_bound: total(&bounds),
        steps,
        ending,
        distances: (0..models).map(distance).collect(),
        distances_all: (0..models).map(|i| totals.iter().map(|field| field[i]).sum::<f64>() / fields as f64).collect(),
        field_dispersion: by_field.map(|medians| medians.iter().sum::<f64>() / fields as f64),
        node_dispersion,
        vectors,
    })
}

/// Returns the mean of a model's distances over the `count` fields in which it is kept, or `None` if `count` is 0.
fn mean_of_kept(distances: &[Vec<f64>], is_kept: Option<&[Vec<bool>]>, count: usize, model: usize) -> Option<f64> {
    let of_field = |(m, field): (usize, &Vec<f64>)| {
        if is_kept.is_none_or(|flags| flags[m][model]) { field[model] } else { 0.0 }
    };
    (count > 0).then(|| distances.iter().enumerate().map(of_field).sum::<f64>() / (count as f64))
}

/// Computes the representative of a class of very many models: certified trimming, exact median, dispersions.
///
/// `ids` are the sequences of the models in the order of `source`, ascending and unique. `neutral` is the neutral frame they share, with
/// all nodes. In medians and dispersions each person has one weight, as for fewer models; in `d_tf` and trimming each sequence does.
///
/// The median is always the exact one ([`Representative::median`]). If alpha trims nothing, no `d_tf` is computed and the trimming trace
/// is empty.
///
/// # Errors
/// [`StatisticsError::Source`], [`StatisticsError::AlphaOutOfRange`], [`StatisticsError::Empty`],
/// [`StatisticsError::ModelTrimmingOfMany`].
pub fn representative_of_many<S: SlotSource + ?Sized>(
    label: ClassLabel,
    ids: Vec<SequenceId>,
    neutral: Vec<Point2<f64>>,
    source: &S,
    wireframe: &Wireframe,
    options: &StatisticsOptions,
    memory: u64,
) -> Result<Representative, StatisticsError> {
    if !(0.0..0.5).contains(&options.alpha) {
        return Err(StatisticsError::AlphaOutOfRange { alpha: options.alpha });
    }
    if source.model_count() == 0 {
        return Err(StatisticsError::Empty { emotion: label.emotion });
    }
    let dropped = trimmed_count(options.alpha, source.model_count());
    if dropped > 0 && options.trim == TrimLevel::Model {
        return Err(StatisticsError::ModelTrimmingOfMany { found: source.model_count(), limit: MANY_MODELS });
    }
    let weights = sequence_weights(&ids, options.weighting);
    let weights = weights.as_deref();
    let trimming = if dropped > 0 { Some(trim_certified(source, dropped, memory)?) } else { None };
    let kept = trimming.as_ref().map(|t| t.kept.as_slice());
    let trimmed = streamed_median(source, kept, weights, memory)?;
    let untrimmed = match &trimming {
        Some(_) => streamed_median(source, None, weights, memory)?,
        None => trimmed.clone(),
    };
    let dispersion_of = |distances: &[Option<f64>]| {
        if ids.len() > 1 { median_of(distances.iter().copied(), weights) } else { None }
    };
    let gap = if trimmed.sum == trimmed.lower_bound { 0.0 } else { (trimmed.sum - trimmed.lower_bound) / trimmed.sum };
    let center = DisplacementFields::from_vectors(wireframe.live_nodes().len(), &trimmed.vectors);
    let rows = trimming.as_ref().map_or_else(Vec::new, |t| trimming_rows(&ids, t));
    Ok(Representative {
        model: model_from_displacements(neutral, &center, wireframe)?,
        trimming: rows,
        certificate: trimming.map(|t| t.certificate(&ids)),
        median: MedianKind::Exact,
        sums: MedianSums {
            greedy: trimmed.sum,
            exact: trimmed.sum,
            lower_bound: trimmed.lower_bound,
            greedy_gap: 0.0,
            certificate_gap: gap,
        },
        search: MedianSearch { exact_steps: trimmed.steps, exact_ending: trimmed.ending, ..MedianSearch::default() },
        dispersion: dispersion_of(&trimmed.distances),
        dispersion_untrimmed: dispersion_of(&untrimmed.distances),
        dispersions: Dispersions {
            literal: dispersion_of(&trimmed.distances_all.iter().copied().map(Some).collect::<Vec<_>>()),
            literal_untrimmed: dispersion_of(&untrimmed.distances),
            field: trimmed.field_dispersion.filter(|_| ids.len() > 1),
            field_untrimmed: untrimmed.field_dispersion.filter(|_| ids.len() > 1),
        },
        weighted: weights.is_some(),
        node_dispersion: at_all_nodes(&trimmed.node_dispersion, wireframe),
        distances: trimmed.distances,
        distances_untrimmed: untrimmed.distances.into_iter().map(Option::unwrap_or_default).collect(),
        sequences: ids,
        label,
    })
}

fn trimming_rows(ids: &[SequenceId], trimming: &CertifiedTrimming) -> Vec<TrimmingRow> {
    let mut rows = Vec::with_capacity(trimming.kept.len() * ids.len());
    for (field, (kept, distances)) in trimming.kept.iter().zip(&trimming.distances).enumerate() {
        let mut kept = kept.iter().peekable();
        for (i, (id, &distance)) in ids.iter().zip(distances).enumerate() {
            let is_kept = kept.next_if(|&&next| next == i).is_some();
            rows.push(TrimmingRow { field, id: id.clone(), distance, dropped: !is_kept });
        }
    }
    rows
}

#[cfg(test)]
mod tests;
