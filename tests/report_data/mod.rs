//! Synthetic input for the report: models from Candide-3's own action units, with seeded differences between people.

use std::collections::BTreeMap;

use grimace::internal::{
    fap::{FapCatalog, FapMotion, FapNumber, FapSequence},
    model::{DynamicExpressionModel, FrameExpressionModel},
    report::{ApexFap, Failure, ReportData, Stage},
    statistics::{self, ClassLabel, Representative, SequenceModel, StatisticsOptions, compare::CompareOptions},
    track::{FrameQuality, TrackQuality, TrackSummary, Verdict},
    units::{FaceUnit, NodeId, SequenceId},
    wireframe::{Fapus, Tables, Wireframe},
};
use nalgebra::{Point2, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, Normal};

/// Number of frames per model N'.
const FRAMES: usize = 5;

/// Names and intensities of the action units of six emotions.
const RECIPES: [(&str, &[(&str, f64)]); 6] = [
    ("anger", &[("Brow lowerer", 0.9), ("Lid tightener", 0.5), ("Lip presser", 0.5), ("Upper lid raiser", 0.3)]),
    ("disgust", &[("Nose wrinkler", 0.8), ("Upper lip raiser", 0.6), ("Lid tightener", 0.5), ("Brow lowerer", 0.4)]),
    ("fear", &[("Outer brow raiser", 0.5), ("Upper lid raiser", 0.6), ("Lip stretcher", 0.6), ("Jaw drop", 0.25)]),
    ("happiness", &[("Lip stretcher", 0.7), ("Lip corner depressor", -0.7), ("Lid tightener", 0.5), ("Jaw drop", 0.15)]),
    ("sadness", &[("Lip corner depressor", 0.7), ("Brow lowerer", 0.3), ("Lip presser", 0.3)]),
    ("surprise", &[("Outer brow raiser", 1.0), ("Upper lid raiser", 0.7), ("Jaw drop", 0.8)]),
];

/// Owner of the data that [`ReportData`] borrows.
pub struct Fixture {
    pub title: String,
    pub representatives: Vec<Representative>,
    pub tracks: Vec<TrackQuality>,
    pub courses: BTreeMap<SequenceId, grimace::internal::features::Course>,
    pub failures: Vec<Failure>,
    pub wireframe: Wireframe,
    pub tables: Tables,
    pub fapus: Fapus,
}

impl Fixture {
    /// Makes a report of the six emotions with `counts` sequences each, and one class per emotion and group, if groups are given.
    pub fn new(title: &str, counts: [usize; 6], groups: &[&str]) -> Self {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let model_units = Fapus::measure(&tables.fapus, &wireframe.frontal()).unwrap();
        let scale = 1024.0 / model_units.es;
        let (mut representatives, mut tracks) = (Vec::new(), Vec::new());
        let mut stream = 0;
        for ((emotion, recipe), count) in RECIPES.iter().zip(counts) {
            for group in if groups.is_empty() { &["" as &str][..] } else { groups } {
                let mut rng = ChaCha8Rng::seed_from_u64(2006);
                rng.set_stream(stream);
                stream += 1;
                let models: Vec<_> = (0..count).map(|k| model(&wireframe, scale, recipe, k, &mut rng)).collect();
                let id = |k: usize| SequenceId { subject: format!("S{:03}", k + 1), sequence: format!("{group}{emotion}") };
                let ids: Vec<_> = (0..count).map(id).collect();
                let group = if group.is_empty() { BTreeMap::new() } else { BTreeMap::from([("sex".into(), (*group).into())]) };
                let label = ClassLabel { emotion: (*emotion).into(), group };
                tracks.extend(ids.iter().map(|id| track(id, emotion, wireframe.live_nodes(), &mut rng)));
                representatives.push(representative(label, ids, models, &wireframe));
            }
        }
        tracks.sort_by(|a, b| a.id.cmp(&b.id));
        let failures = Vec::new();
        Self {
            title: title.into(),
            representatives,
            tracks,
            courses: BTreeMap::new(),
            failures,
            fapus: model_units.scaled(scale),
            wireframe,
            tables,
        }
    }

    pub fn fail(mut self, subject: &str, sequence: &str, stage: Stage, reason: &str) -> Self {
        let [subject, sequence, reason] = [subject, sequence, reason].map(str::to_owned);
        self.failures.push(Failure { subject, sequence, stage, reason });
        self
    }

    pub fn data(&self) -> ReportData<'_> {
        let options =
            [("grimace", "0.1.0"), ("alpha", "0.1"), ("median", "greedy"), ("resample", "nearest frame"), ("size", "region")];
        ReportData {
            title: self.title.clone(),
            options: options.map(|(label, value)| (label.to_owned(), value.to_owned())).into(),
            representatives: &self.representatives,
            tracks: &self.tracks,
            courses: &self.courses,
            failures: &self.failures,
            same: &[],
            wireframe: &self.wireframe,
            tables: &self.tables,
            fapus: self.fapus,
            player: None,
            face: String::new(),
            stems: Vec::new(),
            files: Vec::new(),
            tracked_here: true,
            too_short: None,
            apex_faps: self.representatives.iter().map(|r| apex_faps(r, self.fapus)).collect(),
            variations: Vec::new(),
            covariates: Vec::new(),
            compare: CompareOptions::default(),
            strata: &[],
            groups: None,
        }
    }
}

fn gauss(rng: &mut ChaCha8Rng, mean: f64, deviation: f64) -> f64 {
    Normal::new(mean, deviation).unwrap().sample(rng)
}

type Model = DynamicExpressionModel<FaceUnit>;

fn model(wireframe: &Wireframe, scale: f64, recipe: &[(&str, f64)], k: usize, rng: &mut ChaCha8Rng) -> Model {
    // Every eleventh person exaggerates, so that there is something to trim.
    let strength = if k % 11 == 5 { 1.9 } else { gauss(rng, 1.0, 0.18).clamp(0.4, 1.5) };
    let pace = gauss(rng, 1.0, 0.25).clamp(0.5, 1.8);
    let neutral: Vec<Point2<f64>> = wireframe.frontal().iter().map(|p| p * scale).collect();
    let mut apex = vec![Vector2::zeros(); neutral.len()];
    for (name, intensity) in recipe {
        let unit = wireframe.action_units().iter().find(|u| u.name.starts_with(name)).unwrap();
        let intensity = intensity * strength * gauss(rng, 1.0, 0.25);
        for (node, offset) in &unit.offsets {
            apex[node.index()] += offset.xy() * intensity * scale;
        }
    }
    let still: Vec<Vector2<f64>> =
        (0..FRAMES * neutral.len()).map(|_| Vector2::new(gauss(rng, 0.0, 4.0), gauss(rng, 0.0, 4.0))).collect();
    let frames = (0..FRAMES).map(|m| {
        let part = (m as f64 / (FRAMES - 1) as f64).powf(pace);
        let noise = |n: usize| if m == 0 { Vector2::zeros() } else { still[m * neutral.len() + n] };
        FrameExpressionModel::new(neutral.iter().enumerate().map(|(n, p)| p + apex[n] * part + noise(n)).collect())
    });
    Model::new(frames.collect()).unwrap()
}

fn representative(label: ClassLabel, sequences: Vec<SequenceId>, models: Vec<Model>, wireframe: &Wireframe) -> Representative {
    let models: Vec<_> = sequences.into_iter().zip(models).map(|(id, model)| SequenceModel { id, model }).collect();
    statistics::representative(label, &models, wireframe, &StatisticsOptions::default()).unwrap()
}

fn track(id: &SequenceId, emotion: &str, live: &[NodeId], rng: &mut ChaCha8Rng) -> TrackQuality {
    let frames = 8 + gauss(rng, 8.0, 3.0).clamp(0.0, 20.0) as usize;
    let loss = gauss(rng, 0.0, 0.04).abs().min(0.6);
    let pairs = ((frames - 1) * live.len()) as f64 * loss;
    let pick = |rng: &mut ChaCha8Rng| live[(gauss(rng, 0.0, 40.0).abs() as usize) % live.len()];
    let worst = ((pairs / 8.0) as usize).min(5);
    let share = (pairs * 0.7) as usize;
    let doubtful = loss > 0.1;
    TrackQuality {
        id: id.clone(),
        emotion: emotion.into(),
        summary: TrackSummary {
            frames,
            tracked_share: 1.0 - loss,
            mean_residual_px: gauss(rng, 0.08, 0.03).abs(),
            eye_distance_px: gauss(rng, 118.0, 14.0),
            recovered: BTreeMap::from([
                ("forward-backward".into(), share),
                ("extreme displacement".into(), pairs as usize - share),
            ]),
            placement_error_px: Some(1.9),
            expected_error_px: Some(1.2 + 20.0 * loss),
            beside: Vec::new(),
            covered: None,
            covered_at_apex: None,
            mouth_back: None,
            verdict: if doubtful { Verdict::LookAgain } else { Verdict::Good },
            reasons: if doubtful {
                vec![format!("{:.0} % of the nodes were lost in all frames together", 100.0 * loss)]
            } else {
                Vec::new()
            },
            worst_nodes: (0..worst).map(|k| (pick(rng), (frames - 1).saturating_sub(2 * k).max(1))).collect(),
        },
        course: (1..frames)
            .map(|k| {
                let part = k as f64 / (frames - 1) as f64;
                FrameQuality { lost: loss * part * 2.0, expected_error_px: Some((1.2 + 20.0 * loss) * part) }
            })
            .collect(),
        pictures: None,
        content: String::new(),
        look: None,
    }
}

/// Returns the FAP values of the apex frame.
fn apex_faps(r: &Representative, fapus: Fapus) -> Vec<ApexFap> {
    let catalog = FapCatalog::mpeg4();
    let (faps, _) = FapSequence::from_model(&r.model, &fapus, catalog, "test", 25, 0).unwrap();
    let apex = faps.frames.last().unwrap();
    let value = |fap: FapNumber| {
        let row = catalog.row(fap);
        Some(ApexFap {
            number: fap.get(),
            name: row.name.clone(),
            unit: row.unit_name(),
            is_angle: row.motion.is_some_and(FapMotion::is_angle),
            value: apex.value(fap)? as i32,
        })
    };
    faps.set_faps().into_iter().filter_map(value).collect()
}
