//! The whole pipeline, compared with the ground truth of simulated sequences.

use crate::common::Work;
use grimace::internal::{
    fap::{FapNumber, read_fap},
    fit::FittedWireframe,
    geometry::Similarity,
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::{NormalizeOptions, Normalizer},
    pipeline::read_model,
    sequence::{Frame, SequenceError},
    track::{AlignOptions, TrackOptions, TrackPlan, read_track, track_model, track_sequence},
    units::{FaceUnit, Px},
    wireframe::{Tables, Wireframe},
};
use grimace_lab::simulate::{Emotion, SimulateOptions, SimulatedFrame, simulate_dataset, simulate_sequence};
use nalgebra::Point2;
use rayon::prelude::*;

/// Returns the mean error over the live nodes at the last frame, px, for a track that starts from the true nodes of the neutral frame.
fn error_at_apex(simulated: &[SimulatedFrame], options: &TrackOptions) -> f64 {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let fitted = FittedWireframe {
        model: FrameExpressionModel::new(simulated[0].nodes.clone()),
        image_from_face: Similarity::identity(),
        correspondences: Vec::new(),
        read: Vec::new(),
        residuals: Vec::new(),
        spreads: None,
        warnings: Vec::new(),
    };
    let frames = (1..).zip(simulated).map(|(number, frame)| {
        let grey = image::DynamicImage::from(frame.image.clone()).to_luma8();
        Ok::<_, SequenceError>(Frame::new(number, grey))
    });
    let plan = TrackPlan::new(&wireframe, &tables);
    let track = track_sequence(&wireframe, &plan, &fitted, frames, options, |_| true).unwrap();
    let (found, truth) = (&track.frames.last().unwrap().nodes, &simulated.last().unwrap().nodes);
    let live = wireframe.live_nodes();
    live.iter().map(|n| (found[n.index()].position - truth[n.index()]).norm()).sum::<f64>() / live.len() as f64
}

/// Goal of the project: for 24 frames of 640x480 the mean error at the last frame is at most 1 px, and lower than without deformation.
#[test]
fn tracking_from_the_true_nodes_stays_within_a_pixel_and_deformation_helps() {
    let options = SimulateOptions { seed: 2006, ..SimulateOptions::default() };
    assert_eq!((options.frames, options.width, options.height), (24, 640, 480));
    let cases = [(0, Emotion::Happiness), (1, Emotion::Surprise), (2, Emotion::Anger)];
    let errors: Vec<(f64, f64)> = cases
        .par_iter()
        .map(|&(subject, emotion)| {
            let frames: Vec<_> = simulate_sequence(&options, subject, emotion).unwrap().collect();
            let with = error_at_apex(&frames, &TrackOptions::default());
            let align = AlignOptions { gain: 0.0, ..AlignOptions::default() };
            let without = error_at_apex(&frames, &TrackOptions { deform: false, align, ..TrackOptions::default() });
            eprintln!("subject {subject}, {emotion}: {with:.3} px with deformation, {without:.3} px without");
            (with, without)
        })
        .collect();
    for ((subject, emotion), (with, _)) in cases.iter().zip(&errors) {
        assert!(*with <= 1.0, "subject {subject}, {emotion}: {with:.3} px");
    }
    let mean = |each: fn(&(f64, f64)) -> f64| errors.iter().map(each).sum::<f64>() / errors.len() as f64;
    let (with, without) = (mean(|e| e.0), mean(|e| e.1));
    assert!(with < without, "{with:.4} px with deformation, {without:.4} px without: {errors:.3?}");
}

/// Reads the true positions of a simulated sequence from its file.
fn truth(work: &Work, name: &str) -> DynamicExpressionModel<Px> {
    track_model(&read_track(&work.path(name)).unwrap()).unwrap()
}

/// The representative of three people with the same face, performance and picture, marked at all nodes, is that person.
#[test]
fn the_representative_of_identical_subjects_is_that_subject() {
    /// Tolerance of the mean distance to the truth at the apex, face units: 2 % of the eye distance (1024), similar to the tracker's limit
    /// for the forward-backward check.
    const TOLERANCE: f64 = 20.0;
    let work = Work::new();
    let options = SimulateOptions {
        subjects: 1,
        emotions: vec![Emotion::Happiness],
        frames: 8,
        width: 320,
        height: 240,
        noise_sigma: 0.5,
        seed: 11,
        ..SimulateOptions::default()
    };
    simulate_dataset(&options, &work.path("faces"), true, |_, _| {}).unwrap();
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let model = truth(&work, "faces/truth/S001_005.csv");
    let mark = |n: &grimace::internal::units::NodeId| {
        let p: Point2<f64> = model.neutral().node(*n).unwrap();
        format!("{n},{},{},hard\n", p.x, p.y)
    };
    work.write("faces/marks.csv", format!("node,x,y,kind\n{}", wireframe.live_nodes().iter().map(mark).collect::<String>()));
    let row = |who: &str| format!("{who},1,happiness,S001/005,marks.csv\n");
    work.write(
        "faces/manifest.csv",
        format!("subject,sequence,emotion,frames,correspondences\n{}{}{}", row("A"), row("B"), row("C")),
    );
    work.grimace("run faces -o out").exit(0);

    let representative = read_model(&work.path("out/representatives/happiness.csv")).unwrap();
    let one = read_model(&work.path("out/models/B_1.csv")).unwrap();
    let normalizer = Normalizer::new(&wireframe, &tables, NormalizeOptions::default()).unwrap();
    let expected = normalizer.normalize(&model).unwrap();
    let distance = |a: &DynamicExpressionModel<FaceUnit>, b: &DynamicExpressionModel<FaceUnit>, frame: usize| {
        let (a, b) = (a.frames()[frame].nodes(), b.frames()[frame].nodes());
        let distances = wireframe.live_nodes().iter().map(|n| nalgebra::distance(&a[n.index()], &b[n.index()]));
        distances.sum::<f64>() / wireframe.live_nodes().len() as f64
    };
    for frame in 0..5 {
        assert!(distance(&representative, &one, frame) < 1e-6, "frame {frame}");
    }
    let (error, motion) = (distance(&representative, &expected, 4), distance(&expected, &one, 0));
    eprintln!("mean distance to the truth at the apex: {error:.2} face units (neutral: {motion:.2e})");
    assert!(motion < 1e-6, "both start at the canonical neutral");
    assert!(error < TOLERANCE, "{error:.2} face units from the truth");
    let statistics = work.rows("out/statistics.csv");
    for column in ["dispersion", "dispersion_untrimmed", "sum_of_distances"] {
        let value: f64 = statistics[0][column].parse().unwrap();
        assert!(value < 1e-6, "{column} of equal models is {value}");
    }
}

/// Required signs of the apex FAPs of an expression.
#[test]
fn fap_signs_are_those_of_the_expressions() {
    let work = Work::new();
    let options = SimulateOptions {
        subjects: 3,
        emotions: vec![Emotion::Anger, Emotion::Happiness, Emotion::Surprise],
        frames: 8,
        width: 320,
        height: 240,
        seed: 5,
        ..SimulateOptions::default()
    };
    simulate_dataset(&options, &work.path("faces"), true, |_, _| {}).unwrap();
    work.grimace("run faces -o out").exit(0);
    let signs: [(&str, i32, &[u8]); 4] = [
        ("happiness", 1, &[53, 54, 59, 60]),
        ("surprise", 1, &[31, 32, 33, 34, 35, 36]),
        ("surprise", -1, &[52]),
        ("anger", -1, &[31, 32, 33, 34, 35, 36]),
    ];
    for (emotion, sign, faps) in signs {
        let sequence = read_fap(&work.path(&format!("out/fap/{emotion}.fap"))).unwrap().sequence;
        let apex = sequence.frames.last().unwrap();
        for &fap in faps {
            let value = apex.value(FapNumber::try_from(fap).unwrap()).unwrap();
            // 20 FAP units of 1024 are 2 % of a FAPU: more than noise.
            assert!(value * f64::from(sign) > 20.0, "{emotion}: FAP {fap} is {value}");
        }
    }
}
