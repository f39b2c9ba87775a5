//! Compares representatives, statistics and FAP files of a small set of models with the files in `fixtures/golden`, within 1e-6 (face
//! units, or FAP units).
//!
//! The models are computed from Candide-3's action units by plain arithmetic, without images, tracking or random numbers. After an intended
//! change of the statistics,
//!
//! ```text
//! REGENERATE=1 cargo test --test method golden
//! ```
//!
//! writes the files again; the commit message states why they changed. `fixtures/golden/README.md` describes how the first ones were
//! checked.

use std::{collections::BTreeMap, fs, path::Path};

use crate::common::{Files, files_in};
use grimace::internal::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    pipeline::{AnalyzedModel, PipelineOptions, Workbench, analyze, write_analysis},
    statistics::{MedianKind, SequenceModel, StatisticsOptions},
    units::SequenceId,
    wireframe::UnitKind,
};
use nalgebra::{Point2, Vector2};

/// Largest difference of two numbers.
const TOLERANCE: f64 = 1e-6;

/// Emotions as action unit vectors (number in Rydfalk's list) with their strengths.
const EMOTIONS: [(&str, &[(u16, f64)]); 2] =
    [("happiness", &[(2, 0.7), (14, -0.6), (7, 0.3)]), ("surprise", &[(5, 0.9), (10, 0.5), (11, 0.8)])];

/// Number of models of each emotion. It is odd, and so is the number of kept models (floor(0.2 * 11) = 2 are dropped): vectors of nodes
/// that one unit moves lie on a line, where the median of an even number is not unique.
const SUBJECTS: u32 = 11;

/// Makes the model of a subject: every unit has its own strength and timing, and the last subject moves the other way.
fn model(bench: &Workbench, units: &[(u16, f64)], subject: u32) -> SequenceModel {
    let canonical = bench.normalizer().unwrap().canonical().clone();
    let face_units = 1024.0 / 0.613;
    let frame = |m: u32| {
        let mut nodes: Vec<Point2<f64>> = canonical.neutral.nodes().to_vec();
        for (k, &(number, strength)) in units.iter().enumerate() {
            let unit = bench.wireframe.action_units().iter().find(|u| u.kind == UnitKind::Action { number }).unwrap();
            // Strengths from 70 % to 130 %, distributed differently in every unit; the last subject moves in the opposite
            // direction.
            let spread = 0.7 + 0.06 * f64::from((subject * (k as u32 + 2)) % SUBJECTS);
            let sign = if subject == SUBJECTS - 1 { -1.0 } else { 1.0 };
            // Some are quick and some slow: the share of the motion after m of 4 steps.
            let way = f64::from(m) / 4.0;
            let share = if subject.is_multiple_of(2) { way } else { way * way };
            for (node, offset) in &unit.offsets {
                nodes[node.index()] += Vector2::new(offset.x, offset.y) * (strength * spread * sign * share * face_units);
            }
        }
        bench.wireframe.place_followers(&mut nodes);
        FrameExpressionModel::new(nodes)
    };
    let id = SequenceId { subject: format!("S{:03}", subject + 1), sequence: "001".to_owned() };
    SequenceModel { id, model: DynamicExpressionModel::new((0..5).map(frame).collect()).unwrap() }
}

/// Returns the files made by the current code.
fn made() -> Files {
    let statistics = StatisticsOptions { alpha: 0.2, median: MedianKind::Exact, ..StatisticsOptions::default() };
    let bench = Workbench::new(None, PipelineOptions { statistics, ..PipelineOptions::default() }).unwrap();
    let models = EMOTIONS.iter().flat_map(|(emotion, units)| {
        let bench = &bench;
        (0..SUBJECTS).map(move |subject| AnalyzedModel {
            model: model(bench, units, subject),
            emotion: (*emotion).to_owned(),
            metadata: BTreeMap::new(),
            quality: None,
            course: None,
            pictures: None,
            marks_from: None,
        })
    });
    let analysis = analyze(models.collect(), Vec::new(), &bench).unwrap();
    let folder = tempfile::tempdir().unwrap();
    write_analysis(&analysis, folder.path(), "golden", &bench, |_, _| Ok(())).unwrap();
    let mut files = files_in(folder.path());
    // The report has its own tests, the JSON files repeat the tables, and the bands and the variation are long.
    files.retain(|name, _| {
        [".csv", ".fap"].iter().any(|end| name.ends_with(end))
            && !["failures.csv", "bands.csv"].contains(&name.as_str())
            && !name.starts_with("variation/")
    });
    files
}

/// Fails with file, line and field when the texts differ by more than [`TOLERANCE`].
fn compare(name: &str, golden: &str, made: &str) {
    let fields = |line: &str| line.split([',', ' ']).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(golden.lines().count(), made.lines().count(), "{name}: lines");
    for (line, (a, b)) in (1..).zip(golden.lines().zip(made.lines())) {
        let (a, b) = (fields(a), fields(b));
        assert_eq!(a.len(), b.len(), "{name}:{line}: fields");
        for (a, b) in a.iter().zip(&b) {
            let same = match (a.parse::<f64>(), b.parse::<f64>()) {
                (Ok(x), Ok(y)) => (x - y).abs() <= TOLERANCE,
                _ => a == b,
            };
            assert!(same, "{name}:{line}: found {b}, but the golden file has {a}");
        }
    }
}

#[test]
fn representatives_statistics_and_fap_files_are_the_golden_ones() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/golden");
    let made = made();
    if std::env::var_os("REGENERATE").is_some() {
        for (name, bytes) in &made {
            let path = folder.join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
    }
    let mut golden = files_in(&folder);
    golden.retain(|name, _| !["README.md", "check.py"].contains(&name.as_str()));
    assert_eq!(golden.keys().collect::<Vec<_>>(), made.keys().collect::<Vec<_>>(), "REGENERATE=1 writes the golden files");
    for (name, bytes) in &made {
        compare(name, std::str::from_utf8(&golden[name]).unwrap(), std::str::from_utf8(bytes).unwrap());
    }
}
