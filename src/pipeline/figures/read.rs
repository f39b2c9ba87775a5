//! Reads the results of a run back from its files.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use serde::Deserialize;

use super::{
    super::{ledger::JOURNAL, method::method_in_words},
    FiguresError,
};
use crate::{
    fap::{FapCatalog, FapMotion},
    features::{ACTION_UNITS, Course, FrameFeatures, Intensity, unit_column},
    input::{CsvFile, RecordError, read_record},
    output::count,
    pipeline::{RunJson, SCHEMA_VERSION, Workbench, read_model, read_run_json},
    report::figures::{BandFigure, Model},
    statistics::compare::CompareOptions,
    units::NodeId,
};

/// The fields of a representative's JSON that figures need.
#[derive(Debug, Deserialize)]
pub struct ClassJson {
    pub emotion: String,
    pub group: BTreeMap<String, String>,
    pub sequences: Vec<String>,
    pub alpha: f64,
    pub median: String,
    pub dispersion: Option<f64>,
    pub dispersion_untrimmed: Option<f64>,
    pub subjects: usize,
    pub weighting: String,
    pub trim: String,
    pub distances: BTreeMap<String, Option<f64>>,
    pub node_dispersion: Vec<f64>,
}

/// A representative with its data.
pub struct Class {
    pub stem: String,
    pub about: ClassJson,
    pub model: Model,
    /// Name of the run's method; empty if unknown.
    pub method: String,
    /// Curves of its sequences that have features, each with its person.
    pub courses: Vec<(String, Course)>,
    /// Curves of FAPs, the largest motion first; of whole emotions only.
    pub bands: Vec<BandFigure>,
    /// For each displacement field, every model's distance to the others and whether it was dropped.
    pub fields: BTreeMap<u32, Vec<(f64, bool)>>,
    /// Models at -2, 0 and 2 standard deviations along the first component.
    pub variation: Option<[Model; 3]>,
}

/// Two compared groups.
pub struct Pair {
    pub emotion: String,
    pub groups: [String; 2],
    /// p of either test after Holm's correction; `None` without a test.
    pub p: Option<f64>,
    /// p of the whole face, and after Holm's correction.
    pub whole: Option<(f64, f64)>,
    /// p of the clearest node.
    pub clearest: Option<f64>,
    pub effect: Option<f64>,
    /// Columns within whose values people were exchanged, joined; empty if among all.
    pub strata: String,
    /// Energy distance and p of every node.
    pub nodes: BTreeMap<NodeId, (f64, f64)>,
}

/// Input data of all figures.
pub struct Results {
    /// At least one.
    pub classes: Vec<Class>,
    pub pairs: Vec<Pair>,
    pub significance: f64,
    /// People of all classes.
    pub people: usize,
    /// Number of sequences in all classes, and of those without features.
    without_features: [usize; 2],
    /// Whether the last run into the folder was interrupted.
    unfinished: bool,
    /// Missing tables, each with the content that figures lack.
    missing: Vec<(&'static str, &'static str)>,
}

/// Tables used by figures, each with the content that is missing without it.
const TABLES: [(&str, &str); 2] = [
    ("trimming.csv", "the figures do not show trimmed sequences and the distances between the others"),
    ("bands.csv", "the figures of FAPs over time are left out"),
];

impl Results {
    /// Messages about content left out, with the missing file.
    pub fn left_out(&self) -> Vec<String> {
        let mut said = Vec::new();
        if self.unfinished {
            said.push(format!(
                "the run is not finished ({JOURNAL} exists), so the figures may mix it with an earlier run; run the same command again \
                 to finish it, then draw the figures again"
            ));
        }
        said.extend(self.missing.iter().map(|(name, what)| format!("{name} is missing: {what}")));
        let [all, without] = self.without_features;
        if without > 0 {
            let what = if without == all {
                "the figures of action units over time are left out"
            } else {
                "the figures of action units over time do not include them"
            };
            said.push(format!("features/ has no table of {without} of {}: {what}", count(all, "sequence", "sequences")));
        }
        said
    }

    pub fn read(out: &Path, bench: &Workbench) -> Result<Self, FiguresError> {
        let stems = stems(&out.join("representatives"));
        if stems.is_empty() {
            return Err(FiguresError::NoResults { path: out.to_owned() });
        }
        let run: Option<RunJson> = read_run_json(out)?;
        let trimming = trimming(out)?;
        let mut bands = bands(out)?;
        let subjects = subjects(out)?;
        let of = |id: &'_ String| subjects.get(id).cloned().unwrap_or_else(|| id.split('_').next().unwrap_or(id).to_owned());
        let mut classes = Vec::new();
        let mut with_features: BTreeMap<String, bool> = BTreeMap::new();
        for stem in stems {
            let path = out.join(format!("representatives/{stem}.csv"));
            let model = read_model(&path)?;
            let (found, expected) = (model.frames()[0].nodes().len(), bench.wireframe.node_count());
            if found != expected {
                return Err(FiguresError::OtherWireframe { path, found, expected });
            }
            let about = about(&path.with_extension("json"))?;
            let mut courses = Vec::new();
            for id in &about.sequences {
                let path = out.join(format!("features/{id}.csv"));
                with_features.insert(id.clone(), path.is_file());
                if path.is_file() {
                    courses.extend(course(&path)?.map(|course| (of(id), course)));
                }
            }
            let key = (about.emotion.clone(), about.group.values().cloned().collect::<Vec<_>>());
            let variation = |part: &str| out.join(format!("variation/{stem}_{part}.csv"));
            let parts = ["pc1_minus", "mean", "pc1_plus"].map(variation);
            let variation = if parts.iter().all(|p| p.is_file()) {
                let [minus, mean, plus] = parts;
                Some([read_model(&minus)?, read_model(&mean)?, read_model(&plus)?])
            } else {
                None
            };
            classes.push(Class {
                bands: if about.group.is_empty() { bands.remove(&about.emotion).unwrap_or_default() } else { Vec::new() },
                fields: trimming.get(&key).cloned().unwrap_or_default(),
                method: run.as_ref().map(|r| method_in_words(&r.options)).unwrap_or_default(),
                variation,
                courses,
                stem,
                about,
                model,
            });
        }
        // Whole emotions first, then groups, as in the report.
        classes.sort_by(|a, b| {
            let key = |c: &Class| (c.about.emotion.clone(), c.about.group.clone());
            key(a).cmp(&key(b))
        });
        let people = classes.iter().flat_map(|c| &c.about.sequences).map(of).collect::<BTreeSet<String>>().len();
        // A journal left beside the record of a complete run has no further information.
        let unfinished = out.join(JOURNAL).exists() && run.as_ref().is_none_or(|run| !run.complete);
        let significance = run.map_or_else(CompareOptions::default, |r| r.options.groups.compare).significance;
        let without_features = [with_features.len(), with_features.values().filter(|there| !**there).count()];
        let missing = TABLES.into_iter().filter(|(name, _)| !out.join(name).exists()).collect();
        Ok(Self { pairs: pairs(out)?, classes, significance, people, without_features, unfinished, missing })
    }
}

/// Subject of every sequence by id, if tables contain it.
fn subjects(out: &Path) -> Result<BTreeMap<String, String>, FiguresError> {
    let mut subjects = BTreeMap::new();
    for name in ["trimming.csv", "verdicts.csv"] {
        let path = out.join(name);
        if !path.exists() {
            continue;
        }
        let csv = CsvFile::open(&path)?;
        let [id, subject] = csv.require(["id", "subject"])?;
        for row in csv.rows() {
            let row = row?;
            subjects.insert(row.get(id).to_owned(), row.get(subject).to_owned());
        }
    }
    Ok(subjects)
}

/// Names of the representatives, sorted.
fn stems(folder: &Path) -> Vec<String> {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    let csv =
        entries.map(|e| e.path()).filter(|p| p.extension().is_some_and(|e| e == "csv") && p.with_extension("json").is_file());
    csv.filter_map(|p| Some(p.file_stem()?.to_str()?.to_owned())).collect::<BTreeSet<_>>().into_iter().collect()
}

/// Reads the JSON beside a representative.
fn about(path: &Path) -> Result<ClassJson, FiguresError> {
    let failed = |reason: String| FiguresError::About { path: path.to_owned(), reason };
    let bytes = crate::input::read(path).map_err(|e| failed(format!("cannot be read: {e}")))?;
    read_record(&bytes, SCHEMA_VERSION).map_err(|error| match error {
        RecordError::Newer { .. } => failed(error.to_string()),
        RecordError::Json(source) => failed(format!("damaged ({source}); run again to rewrite it")),
    })
}

/// By emotion, group and displacement field: distances, and whether models were dropped.
type Trimming = BTreeMap<(String, Vec<String>), BTreeMap<u32, Vec<(f64, bool)>>>;

fn trimming(out: &Path) -> Result<Trimming, FiguresError> {
    let path = out.join("trimming.csv");
    let mut trimming = Trimming::new();
    if !path.exists() {
        return Ok(trimming);
    }
    let csv = CsvFile::open(&path)?;
    let [emotion, frame, distance, dropped, subject] = csv.require(["emotion", "frame", "distance", "dropped", "subject"])?;
    for row in csv.rows() {
        let row = row?;
        // The columns after the subject are those grouped by; empty values denote whole emotions.
        let group: Vec<String> =
            (subject + 1..csv.header().len()).map(|k| row.get(k).to_owned()).filter(|v| !v.is_empty()).collect();
        let point = (row.number(distance)?, row.get(dropped) == "true");
        trimming
            .entry((row.get(emotion).to_owned(), group))
            .or_default()
            .entry(row.whole_number(frame)?)
            .or_default()
            .push(point);
    }
    Ok(trimming)
}

/// Reads the FAP curves of every emotion, the largest motion first.
fn bands(out: &Path) -> Result<BTreeMap<String, Vec<BandFigure>>, FiguresError> {
    let path = out.join("bands.csv");
    if !path.exists() {
        return Ok(BTreeMap::new());
    }
    let csv = CsvFile::open(&path)?;
    let [emotion, curve, number] = csv.require(["emotion", "curve", "number"])?;
    let values = csv.require(["representative", "mean", "q05", "q25", "q50", "q75", "q95"])?;
    let mut found: BTreeMap<(String, u32), Vec<[f64; 7]>> = BTreeMap::new();
    for row in csv.rows() {
        let row = row?;
        if row.get(curve) != "fap" {
            continue;
        }
        let mut of_frame = [0.0; 7];
        for (value, column) in of_frame.iter_mut().zip(values) {
            *value = row.number(column)?;
        }
        found.entry((row.get(emotion).to_owned(), row.whole_number(number)?)).or_default().push(of_frame);
    }
    let mut by_emotion: BTreeMap<String, Vec<(f64, BandFigure)>> = BTreeMap::new();
    for ((emotion, number), rows) in found {
        let row = FapCatalog::mpeg4().rows().iter().find(|row| u32::from(row.number.get()) == number);
        let Some(row) = row.filter(|row| !row.motion.is_some_and(FapMotion::is_angle)) else { continue };
        let size = rows.iter().map(|r| r[0].abs()).fold(0.0, f64::max);
        let figure = BandFigure { label: format!("{number} {}", row.name), unit: row.unit_name(), rows };
        by_emotion.entry(emotion).or_default().push((size, figure));
    }
    let sorted = |mut all: Vec<(f64, BandFigure)>| {
        all.sort_by(|a, b| b.0.total_cmp(&a.0));
        all.into_iter().map(|(_, figure)| figure).collect()
    };
    Ok(by_emotion.into_iter().map(|(emotion, all)| (emotion, sorted(all))).collect())
}

/// Reads a sequence's curve from its features; `None` for fewer than two frames.
fn course(path: &Path) -> Result<Option<Course>, FiguresError> {
    let csv = CsvFile::open(path)?;
    let [frame, yaw, pitch, roll] = csv.require(["frame", "pose_yaw", "pose_pitch", "pose_roll"])?;
    let units: Vec<(u8, usize)> =
        ACTION_UNITS.iter().filter_map(|u| Some((u.number, csv.column(&unit_column(u.number, "r"))?))).collect();
    if units.len() != ACTION_UNITS.len() {
        return Ok(None);
    }
    let mut rows = Vec::new();
    for row in csv.rows() {
        let row = row?;
        let mut action_units = Vec::new();
        for &(number, column) in &units {
            // Charts need values only.
            action_units.push(Intensity { number, value: row.number(column)?, sides: None, expected_error: 0.0, evidence: 0.0 });
        }
        rows.push(FrameFeatures {
            frame: row.whole_number(frame)?,
            confidence: 1.0,
            reason: None,
            pose: [row.number(yaw)?, row.number(pitch)?, row.number(roll)?],
            position: nalgebra::Point2::origin(),
            landmarks: Vec::new(),
            eye_distance: 0.0,
            faps: Vec::new(),
            action_units,
            eye_opening: [1.0; 2],
            mouth_opening: 0.0,
            iris: None,
        });
    }
    Ok(Course::of(&rows))
}

fn pairs(out: &Path) -> Result<Vec<Pair>, FiguresError> {
    let path = out.join("comparisons.csv");
    if !path.exists() {
        return Ok(Vec::new());
    }
    let nodes_path = out.join("comparison_nodes.csv");
    let mut nodes: BTreeMap<[String; 3], BTreeMap<NodeId, (f64, f64)>> = BTreeMap::new();
    if nodes_path.exists() {
        let csv = CsvFile::open(&nodes_path)?;
        let [emotion, a, b, node, energy, p] = csv.require(["emotion", "group_a", "group_b", "node", "energy", "p"])?;
        for row in csv.rows() {
            let row = row?;
            let number = u16::try_from(row.whole_number(node)?).map_err(|_| row.field_error(node, "the number of a node"))?;
            let key = [emotion, a, b].map(|c| row.get(c).to_owned());
            nodes.entry(key).or_default().insert(NodeId(number), (row.number(energy)?, row.number(p)?));
        }
    }
    let csv = CsvFile::open(&path)?;
    let columns = ["emotion", "group_a", "group_b", "effect", "p_either_holm", "p", "p_holm", "p_max_node"];
    let [emotion, a, b, effect, p, of_whole, of_whole_holm, of_node] = csv.require(columns)?;
    // Tables of earlier versions do not have it.
    let strata = csv.column("strata");
    let mut pairs = Vec::new();
    for row in csv.rows() {
        let row = row?;
        let key = [emotion, a, b].map(|c| row.get(c).to_owned());
        let optional = |column: usize| if row.get(column).is_empty() { Ok(None) } else { row.number(column).map(Some) };
        let [emotion, first, second] = key.clone();
        pairs.push(Pair {
            emotion,
            groups: [first, second],
            p: optional(p)?,
            whole: optional(of_whole)?.zip(optional(of_whole_holm)?),
            clearest: optional(of_node)?,
            effect: optional(effect)?,
            strata: strata.map(|column| row.get(column).to_owned()).unwrap_or_default(),
            nodes: nodes.remove(&key).unwrap_or_default(),
        });
    }
    // Pairs without a test have no figure.
    pairs.retain(|pair| pair.p.is_some());
    Ok(pairs)
}
