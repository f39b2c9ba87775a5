//! Variation among the people of each emotion, and its files: components, scores, bands, and models.

use std::{collections::BTreeMap, path::Path};

use super::{AnalyzedClass, Workbench, analysis::EmotionGroups, classes::whole_class, model_file::write_model, write::Wrote};
use crate::{
    fap::{FapCatalog, FapMotion, measure_faps},
    output::{OutputError, nine_digits, write_records},
    report::BandCurve,
    statistics::{
        SequenceModel,
        variation::{Band, MOST_SEQUENCES, Variation, band_weights},
    },
    wireframe::Fapus,
};

/// Number of components whose models, at -2 and +2 standard deviations from the mean, are written and shown.
pub const SHOWN_COMPONENTS: usize = 3;

/// Distance of these models from the mean, standard deviations.
pub const SHOWN_DEVIATIONS: f64 = 2.0;

/// Quantity of a curve.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Curve {
    /// Offset of a node from neutral along x (`x`) or y (`y`), face units.
    Node(u16, char),
    /// Value of a FAP, in its unit.
    Fap(u8),
}

/// The variation of one emotion.
#[derive(Clone, Debug, PartialEq)]
pub struct EmotionVariation {
    /// The emotion.
    pub emotion: String,
    /// Stem of the emotion's files.
    pub stem: String,
    /// Mean, components and scores, or the reason why there are none.
    pub outcome: Result<Variation, String>,
    /// Bands of every curve by frame, with the representative's value; empty for a single sequence, and for more sequences than components
    /// are computed of.
    pub bands: BTreeMap<Curve, Vec<(f64, Band)>>,
}

/// Computes the variation of every emotion over all its people.
pub(super) fn variations(
    emotions: &EmotionGroups<'_>,
    classes: &[AnalyzedClass],
    fapus: &Fapus,
    bench: &Workbench,
) -> Vec<EmotionVariation> {
    let of = |(emotion, groups): &(String, Vec<(_, Vec<&SequenceModel>)>)| {
        let (_, models): &(crate::statistics::ClassLabel, Vec<&SequenceModel>) = groups.first()?;
        let class = whole_class(classes, emotion)?;
        Some(EmotionVariation {
            emotion: emotion.clone(),
            stem: class.stem.clone(),
            outcome: Variation::new(models, &bench.wireframe).map_err(|why| why.to_string()),
            bands: if (2..=MOST_SEQUENCES).contains(&models.len()) {
                bands(models, class, fapus, bench)
            } else {
                BTreeMap::new()
            },
        })
    };
    emotions.iter().filter_map(of).collect()
}

/// Values of every curve of a model, by frame.
fn curves(
    model: &crate::model::DynamicExpressionModel<crate::units::FaceUnit>,
    fapus: &Fapus,
    bench: &Workbench,
) -> BTreeMap<Curve, Vec<f64>> {
    let mut curves: BTreeMap<Curve, Vec<f64>> = BTreeMap::new();
    for m in 0..model.frame_count() {
        let offsets = model.neutral_offsets(m);
        for n in bench.wireframe.live_nodes() {
            let offset = offsets[n.index()];
            curves.entry(Curve::Node(n.0, 'x')).or_default().push(offset.x);
            curves.entry(Curve::Node(n.0, 'y')).or_default().push(offset.y);
        }
    }
    // A wireframe without Candide-3's nodes has no FAPs.
    for frame in measure_faps(model, fapus, FapCatalog::mpeg4()).unwrap_or_default() {
        for row in FapCatalog::mpeg4().rows() {
            if let Some(value) = frame.value(row.number) {
                curves.entry(Curve::Fap(row.number.get())).or_default().push(value);
            }
        }
    }
    curves
}

fn bands(
    models: &[&SequenceModel],
    class: &AnalyzedClass,
    fapus: &Fapus,
    bench: &Workbench,
) -> BTreeMap<Curve, Vec<(f64, Band)>> {
    use rayon::prelude::*;
    let weights = band_weights(models);
    let of_models: Vec<BTreeMap<Curve, Vec<f64>>> = models.par_iter().map(|m| curves(&m.model, fapus, bench)).collect();
    let of_curve = |(curve, values): (Curve, Vec<f64>)| {
        let band = |(m, value): (usize, f64)| {
            let at = |(model, &w): (&BTreeMap<Curve, Vec<f64>>, &f64)| Some((*model.get(&curve)?.get(m)?, w));
            let values: Vec<(f64, f64)> = of_models.iter().zip(&weights).filter_map(at).collect();
            Some((value, Band::of(&values)?))
        };
        let bands: Vec<(f64, Band)> = values.into_iter().enumerate().filter_map(band).collect();
        (curve, bands)
    };
    curves(&class.representative.model, fapus, bench).into_iter().map(of_curve).collect()
}

/// Curves for the report: the FAPs that move most, in descending order.
pub(super) fn shown_bands(of: &EmotionVariation) -> Vec<BandCurve> {
    /// Largest useful number of menu entries.
    const MOST: usize = 24;
    let catalog = FapCatalog::mpeg4();
    let mut curves: Vec<(f64, BandCurve)> = Vec::new();
    for row in catalog.rows().iter().filter(|row| !row.motion.is_some_and(FapMotion::is_angle)) {
        let Some(values) = of.bands.get(&Curve::Fap(row.number.get())) else { continue };
        let size = values.iter().map(|(value, _)| value.abs()).fold(0.0, f64::max);
        let label = format!("FAP {} {}", row.number, row.name);
        curves.push((size, BandCurve { label, unit: row.unit_name(), values: values.clone() }));
    }
    curves.sort_by(|a, b| b.0.total_cmp(&a.0));
    curves.into_iter().take(MOST).map(|(_, curve)| curve).collect()
}

/// Names of the component models of an emotion: the mean, and -2 and +2 standard deviations of each component.
pub(super) fn model_names(stem: &str) -> Vec<String> {
    let of_component = |k: usize| ["minus", "plus"].map(|sign| format!("variation/{stem}_pc{k}_{sign}.csv"));
    [format!("variation/{stem}_mean.csv")].into_iter().chain((1..=SHOWN_COMPONENTS).flat_map(of_component)).collect()
}

/// Writes `variation.csv`, `variation_scores.csv`, `bands.csv` and the models of `variation/`. Calls `wrote` after each file.
pub(super) fn write_variations(
    out: &Path,
    variations: &[EmotionVariation],
    bench: &Workbench,
    wrote: &mut Wrote<'_>,
) -> Result<(), super::AnalysisError> {
    let header = ["emotion", "component", "share", "cumulative_share", "sd", "subjects", "sequences", "not_made"];
    let rows = variations.iter().flat_map(|v| match &v.outcome {
        Err(why) => {
            let blanks = std::iter::repeat_n(String::new(), header.len() - 2);
            vec![[v.emotion.clone()].into_iter().chain(blanks).chain([why.clone()]).collect()]
        }
        Ok(found) => {
            let mut sum = 0.0;
            let row = |(k, c): (usize, &crate::statistics::variation::Component)| {
                sum += c.share;
                let numbers = [c.share, sum, c.deviation].map(nine_digits);
                let counts = [found.people, found.scores.len()].map(|n| n.to_string());
                let before = vec![v.emotion.clone(), (k + 1).to_string()];
                before.into_iter().chain(numbers).chain(counts).chain([String::new()]).collect::<Vec<String>>()
            };
            found.components.iter().enumerate().map(row).collect()
        }
    });
    let rows: Vec<Vec<String>> = rows.collect();
    wrote("variation.csv", write_records(&out.join("variation.csv"), header, rows)?)?;
    wrote("variation_scores.csv", write_scores(&out.join("variation_scores.csv"), variations)?)?;
    wrote("bands.csv", write_bands(&out.join("bands.csv"), variations)?)?;
    for v in variations {
        let Ok(found) = &v.outcome else { continue };
        let deviations = [-SHOWN_DEVIATIONS, SHOWN_DEVIATIONS];
        let shown = found.components.len().min(SHOWN_COMPONENTS);
        let of_components = (0..shown).flat_map(|k| deviations.map(|d| found.at(k, d, &bench.wireframe)));
        for (name, model) in model_names(&v.stem).into_iter().zip([Ok(found.mean.clone())].into_iter().chain(of_components)) {
            wrote(&name, write_model(&out.join(&name), &model?)?)?;
        }
    }
    Ok(())
}

fn write_scores(path: &Path, variations: &[EmotionVariation]) -> Result<blake3::Hash, OutputError> {
    let rows = variations.iter().filter_map(|v| Some((v, v.outcome.as_ref().ok()?))).flat_map(|(v, found)| {
        found.scores.iter().flat_map(move |(id, scores)| {
            scores.iter().enumerate().map(move |(k, score)| {
                let names = [id.subject.clone(), id.sequence.clone(), v.emotion.clone(), (k + 1).to_string()];
                names.into_iter().chain([nine_digits(*score), id.to_string()]).collect::<Vec<String>>()
            })
        })
    });
    write_records(path, ["subject", "sequence", "emotion", "component", "score", "id"], rows)
}

fn write_bands(path: &Path, variations: &[EmotionVariation]) -> Result<blake3::Hash, OutputError> {
    let header = ["emotion", "curve", "number", "axis", "frame", "representative", "mean", "q05", "q25", "q50", "q75", "q95"];
    let rows = variations.iter().flat_map(|v| {
        v.bands.iter().flat_map(move |(curve, bands)| {
            let (kind, number, axis) = match curve {
                Curve::Node(node, axis) => ("node", node.to_string(), axis.to_string()),
                Curve::Fap(fap) => ("fap", fap.to_string(), String::new()),
            };
            let names = [v.emotion.clone(), kind.to_owned(), number, axis];
            bands.iter().enumerate().map(move |(m, (value, band))| {
                let numbers = [*value, band.mean].into_iter().chain(band.quantiles).map(nine_digits);
                names.iter().cloned().chain([m.to_string()]).chain(numbers).collect::<Vec<String>>()
            })
        })
    });
    write_records(path, header, rows)
}
