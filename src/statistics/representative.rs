//! Computes the representative of one class: distances, trimming, medians and dispersion, in this order.

use std::{borrow::Borrow, collections::BTreeMap};

use nalgebra::{Point2, Vector2};

use super::{
    ClassLabel, MedianKind, MedianSearch, MedianSums, Representative, SequenceModel, StatisticsError, StatisticsOptions,
    TrimmingRow,
    comparable::displacement_fields,
    dispersion::{Dispersions, KeptFields, field_dispersion, median, median_of},
    distance::DisplacementFields,
    median::{ExactOptions, GreedyOptions, Median, Slots, exact_median, greedy_median},
    scale::{DEFAULT_MEMORY, MANY_MODELS, representative_of_many},
    trimming::{Trimming, sums_of_distances, trim_outliers},
    weights::sequence_weights,
};
use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::CANONICAL_ES,
    plausible::MAX_OFFSET,
    units::{FaceUnit, NodeId, SequenceId},
    wireframe::Wireframe,
};

/// Largest distance of a model's neutral node from the other models' that counts as rounding, face units. Files keep nine digits of
/// coordinates of about a thousand face units.
pub const NEUTRAL_TOLERANCE: f64 = 1e-3;

/// Displacements of this size or larger are refused, face units. Twice [`MAX_OFFSET`], the largest possible change of an offset from one
/// frame to the next; it also applies to models from other programs.
pub const MAX_DISPLACEMENT: f64 = 2.0 * MAX_OFFSET * CANONICAL_ES;

/// Computes the representative of one class: its trimmed generalized median and its dispersion.
///
/// Implements [KP, section 4.2 to 4.4]. `models` are N'' normalized models of N' frames over all nodes of `wireframe`, face units, in any
/// order. Distances are over the wireframe's live nodes.
///
/// - The median model starts at the models' common neutral frame. The median displacement vectors are added field by field, and followers
///   move with their leaders.
/// - Both medians are computed, whichever is chosen, so that the gap between them is known. Where rounding makes the greedy vector of a
///   slot better than the exact one, the exact median takes the greedy vector.
/// - Both dispersions are around medians of the chosen kind.
/// - If people have different numbers of sequences, each person has the same weight in `d_tf`, trimming, median and dispersion, unless
///   [`StatisticsOptions::weighting`] is set otherwise. Sums of distances are then weighted sums.
/// - More than 2048 models are processed by the module `scale`: trimming is decided from bounds and counts every sequence equally, and
///   the median is always the exact one.
///
/// ```
/// use std::collections::BTreeMap;
///
/// use grimace::{
///     model::{DynamicExpressionModel, FrameExpressionModel},
///     normalize::Canonical,
///     statistics::{ClassLabel, SequenceModel, StatisticsOptions, representative},
///     units::SequenceId,
///     wireframe::Face,
/// };
///
/// let face = Face::candide3();
/// let neutral = Canonical::new(&face.wireframe, &face.tables)?.neutral;
/// let smile = |subject: &str, up: f64| {
///     let frame = |m: usize| {
///         let mut nodes = neutral.nodes().to_vec();
///         [31, 64].map(|corner| nodes[corner].y += up * m as f64);
///         FrameExpressionModel::new(nodes)
///     };
///     let id = SequenceId { subject: subject.to_owned(), sequence: "smile".to_owned() };
///     let model = DynamicExpressionModel::new((0..5).map(frame).collect()).expect("five frames");
///     SequenceModel { id, model }
/// };
///
/// // `smile` makes the model of a person whose corners of the mouth rise by so much from frame to frame.
/// let models = [smile("P1", 10.0), smile("P2", 20.0), smile("P3", 30.0)];
/// let label = ClassLabel { emotion: "smile".to_owned(), group: BTreeMap::new() };
/// let options = StatisticsOptions { alpha: 0.0, ..StatisticsOptions::default() };
/// let smile = representative(label, &models, &face.wireframe, &options)?;
/// assert!((smile.model.displacement_field(0)[31].y - 20.0).abs() < 1e-6);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`StatisticsError`] for no models, alpha outside 0 <= alpha < 0.5, two models of one sequence, models whose shape or neutral frame
/// differs from the others', and displacements of 20 eye distances or more.
pub fn representative<M: Borrow<SequenceModel>>(
    label: ClassLabel,
    models: &[M],
    wireframe: &Wireframe,
    options: &StatisticsOptions,
) -> Result<Representative, StatisticsError> {
    if !(0.0..0.5).contains(&options.alpha) {
        return Err(StatisticsError::AlphaOutOfRange { alpha: options.alpha });
    }
    let models = sorted(&label, models)?;
    check_shapes(&models, wireframe)?;
    let live = wireframe.live_nodes();
    let neutral = common_neutral(&models, live)?;
    let fields = displacement_fields(&models, live)?;

    if models.len() > MANY_MODELS {
        let ids = models.iter().map(|m| m.id.clone()).collect();
        return representative_of_many(label, ids, neutral, fields.as_slice(), wireframe, options, DEFAULT_MEMORY);
    }

    let everything: Vec<Vec<usize>> = vec![(0..models.len()).collect(); fields[0].field_count()];
    let weights = sequence_weights(models.iter().map(|m| &m.id), options.weighting);
    let weights = weights.as_deref();
    let row_sums = sums_of_distances(&fields, &everything, weights);
    let trimming = trim_outliers(&row_sums, weights, options.alpha, options.trim);

    let slots = Slots::new(&fields, &trimming.kept, weights);
    let kept_sums = if trimming.is_empty() { row_sums.clone() } else { sums_of_distances(&fields, &trimming.kept, weights) };
    let greedy = greedy_median(&slots, &set_median(&fields, &trimming.kept, &kept_sums), &GreedyOptions::default());
    let mut exact = exact_median(&slots, &ExactOptions::default());
    exact.improve_with(&greedy);
    let chosen = match options.median {
        MedianKind::Greedy => &greedy,
        MedianKind::Exact => &exact,
    };
    let center = DisplacementFields::from_vectors(live.len(), &chosen.vectors);
    let center_untrimmed = if trimming.is_empty() {
        center.clone()
    } else {
        let vectors = untrimmed_median(&fields, &everything, &row_sums, weights, options.median);
        DisplacementFields::from_vectors(live.len(), &vectors)
    };

    let kept = KeptFields::by_model(&trimming.kept, models.len());
    let distances = kept.distances(&fields, &center);
    let distances_untrimmed: Vec<f64> = fields.iter().map(|model| model.distance(&center_untrimmed)).collect();
    let several = models.len() > 1;
    let dispersion_of = |distances: &[Option<f64>]| if several { median_of(distances.iter().copied(), weights) } else { None };
    let over_all =
        |center: &DisplacementFields| -> Vec<Option<f64>> { fields.iter().map(|m| Some(m.distance(center))).collect() };
    let by_field = |kept: &[Vec<usize>], center| field_dispersion(&fields, kept, center, weights).filter(|_| several);
    let dispersion_untrimmed = dispersion_of(&over_all(&center_untrimmed));
    Ok(Representative {
        model: model_from_displacements(neutral, &center, wireframe)?,
        trimming: trimming_rows(&models, &trimming),
        certificate: None,
        median: options.median,
        sums: median_sums(&slots, &greedy, &exact),
        search: MedianSearch {
            greedy_replacements: greedy.iterations,
            greedy_ending: greedy.ending,
            exact_steps: exact.iterations,
            exact_ending: exact.ending,
        },
        dispersion: dispersion_of(&distances),
        dispersion_untrimmed,
        dispersions: Dispersions {
            literal: dispersion_of(&over_all(&center)),
            literal_untrimmed: dispersion_untrimmed,
            field: by_field(&trimming.kept, &center),
            field_untrimmed: by_field(&everything, &center_untrimmed),
        },
        weighted: weights.is_some(),
        node_dispersion: at_all_nodes(&kept.node_dispersion(&fields, &center, weights), wireframe),
        sequences: models.iter().map(|m| m.id.clone()).collect(),
        label,
        distances,
        distances_untrimmed,
    })
}

/// Checks that models are comparable: same shape, same neutral frame, and plausible displacements.
///
/// # Errors
/// [`StatisticsError`] for no models, and for models whose shape, neutral frame or displacements [`representative`] would refuse.
pub fn check_models(label: &ClassLabel, models: &[&SequenceModel], wireframe: &Wireframe) -> Result<(), StatisticsError> {
    if models.is_empty() {
        return Err(StatisticsError::Empty { emotion: label.emotion.clone() });
    }
    check_shapes(models, wireframe)?;
    common_neutral(models, wireframe.live_nodes())?;
    displacement_fields(models, wireframe.live_nodes())?;
    Ok(())
}

/// Sorts the models by sequence id. Ids must be unique.
fn sorted<'a, M: Borrow<SequenceModel>>(label: &ClassLabel, models: &'a [M]) -> Result<Vec<&'a SequenceModel>, StatisticsError> {
    let mut models: Vec<&SequenceModel> = models.iter().map(Borrow::borrow).collect();
    models.sort_by(|a, b| a.id.cmp(&b.id));
    if models.is_empty() {
        return Err(StatisticsError::Empty { emotion: label.emotion.clone() });
    }
    match models.windows(2).find(|pair| pair[0].id == pair[1].id) {
        Some(pair) => Err(StatisticsError::DuplicateSequence { id: pair[0].id.clone() }),
        None => Ok(models),
    }
}

/// Checks node counts against the wireframe and frame counts against the most frequent one.
fn check_shapes(models: &[&SequenceModel], wireframe: &Wireframe) -> Result<(), StatisticsError> {
    let mut frame_counts: BTreeMap<usize, usize> = BTreeMap::new();
    models.iter().for_each(|m| *frame_counts.entry(m.model.frame_count()).or_default() += 1);
    // Of equally frequent counts take the larger one: a truncated sequence is the more likely mistake.
    let frames = frame_counts.iter().max_by_key(|&(frames, models)| (models, frames)).map_or(0, |(&frames, _)| frames);
    let shape = |id: &SequenceId, what, found, expected| {
        if found == expected { Ok(()) } else { Err(StatisticsError::Shape { id: id.clone(), what, found, expected }) }
    };
    for SequenceModel { id, model } in models {
        shape(id, "nodes", model.node_count(), wireframe.node_count())?;
        shape(id, "frames", model.frame_count(), frames)?;
    }
    Ok(())
}

/// Returns the neutral frame that the models share: the componentwise median, from which no model may differ by more than rounding.
fn common_neutral(models: &[&SequenceModel], live: &[NodeId]) -> Result<Vec<Point2<f64>>, StatisticsError> {
    let mut values = vec![0.0; models.len()];
    let mut coordinate = |k: usize, axis: usize| {
        values.iter_mut().zip(models).for_each(|(value, m)| *value = m.model.neutral().nodes()[k][axis]);
        median(&mut values).unwrap_or(0.0)
    };
    let nodes = (0..models[0].model.node_count()).map(|k| Point2::new(coordinate(k, 0), coordinate(k, 1)));
    let neutral: Vec<Point2<f64>> = nodes.collect();
    for SequenceModel { id, model } in models {
        let off = |n: &NodeId| (model.neutral().nodes()[n.index()] - neutral[n.index()]).norm();
        let worst = live.iter().map(|n| (*n, off(n))).max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((node, distance)) = worst.filter(|(_, distance)| !(*distance <= NEUTRAL_TOLERANCE)) {
            return Err(StatisticsError::Neutral { id: id.clone(), node, distance, tolerance: NEUTRAL_TOLERANCE });
        }
    }
    Ok(neutral)
}

/// Returns, for every field, the vectors of the member with the smallest sum of distances to the others (the first of several).
fn set_median(fields: &[DisplacementFields], members: &[Vec<usize>], sums: &[Vec<f64>]) -> Vec<Vector2<f64>> {
    let of_field = |(m, (members, sums)): (usize, (&Vec<usize>, &Vec<f64>))| {
        let best = members.iter().zip(sums).min_by(|a, b| a.1.total_cmp(b.1)).map_or(0, |(&i, _)| i);
        (0..fields[best].node_count()).map(|k| fields[best].vector(m, k)).collect::<Vec<_>>()
    };
    members.iter().zip(sums).enumerate().flat_map(of_field).collect()
}

/// Returns the median of all models before trimming, of the chosen kind.
fn untrimmed_median(
    fields: &[DisplacementFields],
    everything: &[Vec<usize>],
    row_sums: &[Vec<f64>],
    weights: Option<&[f64]>,
    kind: MedianKind,
) -> Vec<Vector2<f64>> {
    let slots = Slots::new(fields, everything, weights);
    match kind {
        MedianKind::Greedy => greedy_median(&slots, &set_median(fields, everything, row_sums), &GreedyOptions::default()).vectors,
        MedianKind::Exact => exact_median(&slots, &ExactOptions::default()).vectors,
    }
}

fn trimming_rows(models: &[&SequenceModel], trimming: &Trimming) -> Vec<TrimmingRow> {
    let row = |field: usize, i: usize| TrimmingRow {
        field,
        id: models[i].id.clone(),
        distance: trimming.distances[field][i],
        dropped: trimming.kept[field].binary_search(&i).is_err(),
    };
    (0..trimming.kept.len()).flat_map(|field| (0..models.len()).map(move |i| row(field, i))).collect()
}

fn median_sums(slots: &Slots, greedy: &Median, exact: &Median) -> MedianSums {
    let (greedy, lower_bound) = (slots.total(&greedy.sums), slots.total(&exact.lower_bounds));
    let exact = slots.total(&exact.sums);
    let gap = |upper: f64, lower: f64| if upper == lower { 0.0 } else { (upper - lower) / exact };
    MedianSums { greedy, exact, lower_bound, greedy_gap: gap(greedy, exact), certificate_gap: gap(exact, lower_bound) }
}

/// Builds a model from the neutral frame by adding the displacement vectors frame by frame.
pub(super) fn model_from_displacements(
    neutral: Vec<Point2<f64>>,
    center: &DisplacementFields,
    wireframe: &Wireframe,
) -> Result<DynamicExpressionModel<FaceUnit>, StatisticsError> {
    let mut nodes = neutral;
    wireframe.place_followers(&mut nodes);
    let mut frames = vec![FrameExpressionModel::new(nodes.clone())];
    for m in 0..center.field_count() {
        for (k, n) in wireframe.live_nodes().iter().enumerate() {
            nodes[n.index()] += center.vector(m, k);
        }
        wireframe.place_followers(&mut nodes);
        frames.push(FrameExpressionModel::new(nodes.clone()));
    }
    Ok(DynamicExpressionModel::new(frames)?)
}

/// Spreads the values of live nodes over all nodes; the other nodes get 0.
pub(super) fn at_all_nodes(values: &[f64], wireframe: &Wireframe) -> Vec<f64> {
    let mut all = vec![0.0; wireframe.node_count()];
    wireframe.live_nodes().iter().zip(values).for_each(|(n, &value)| all[n.index()] = value);
    all
}

#[cfg(test)]
mod tests;
