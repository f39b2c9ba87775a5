//! Properties that hold across modules, for random faces and motions.

use grimace::internal::{
    dataset::LandmarkSelection,
    fap::{FapCatalog, FapMotion, FapNumber, FapSequence, read_fap, write_fap},
    fit::{Correspondence, FitOptions, Fitter, PriorKind, read_correspondences, write_correspondences},
    geometry::Similarity,
    model::DynamicExpressionModel,
    normalize::{NormalizeOptions, Normalizer},
    pipeline::{FapOptions, PipelineOptions},
    statistics::StatisticsOptions,
    track::{NodeState, TrackOptions, TrackedFrame, TrackedNode, read_track, track_csv, track_model},
    units::{FaceUnit, NodeId},
    wireframe::{Tables, UnitKind, Wireframe},
};
use nalgebra::{Point2, Vector2};
use proptest::prelude::*;

/// Returns a track of a face that moves linearly to the given strengths of the action units, each frame seen through a view, in pixels.
fn tracked(strengths: &[f64], frames: u32, view: impl Fn(u32) -> Similarity) -> Vec<TrackedFrame> {
    let wireframe = Wireframe::candide3();
    let scale = 120.0 / 0.613;
    let frame = |number: u32| {
        let share = f64::from(number - 1) / f64::from(frames - 1);
        let mut nodes: Vec<Point2<f64>> = wireframe.frontal().iter().map(|p| Point2::new(p.x, -p.y) * scale).collect();
        let units = wireframe.action_units().iter().filter(|unit| matches!(unit.kind, UnitKind::Action { .. }));
        for (unit, strength) in units.zip(strengths) {
            for (node, offset) in &unit.offsets {
                nodes[node.index()] += Vector2::new(offset.x, -offset.y) * scale * *strength * share;
            }
        }
        wireframe.place_followers(&mut nodes);
        let place = |p: &Point2<f64>| TrackedNode::new(view(number).apply(p), NodeState::Tracked, None);
        TrackedFrame { number, nodes: nodes.iter().map(place).collect() }
    };
    (1..=frames).map(frame).collect()
}

/// Returns the normalized model of a track after writing and reading its file.
fn normalized(frames: &[TrackedFrame]) -> DynamicExpressionModel<FaceUnit> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("S001_001.csv");
    std::fs::write(&path, track_csv(frames)).unwrap();
    let track = track_model(&read_track(&path).unwrap()).unwrap();
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    Normalizer::new(&wireframe, &tables, NormalizeOptions::default()).unwrap().normalize(&track).unwrap()
}

fn faps(model: &DynamicExpressionModel<FaceUnit>) -> FapSequence {
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let fapus = Normalizer::new(&wireframe, &tables, NormalizeOptions::default()).unwrap().canonical().fapus;
    FapSequence::from_model(model, &fapus, FapCatalog::mpeg4(), "face", 25, 5).unwrap().0
}

fn largest_difference(a: &DynamicExpressionModel<FaceUnit>, b: &DynamicExpressionModel<FaceUnit>) -> f64 {
    let nodes = |m: &DynamicExpressionModel<FaceUnit>| m.frames().iter().flat_map(|f| f.nodes().to_vec()).collect::<Vec<_>>();
    nodes(a).iter().zip(&nodes(b)).map(|(p, q)| (p - q).norm()).fold(0.0, f64::max)
}

fn similarity() -> impl Strategy<Value = Similarity> {
    (0.3..4.0_f64, -0.4..0.4_f64, -50.0..900.0_f64, -50.0..700.0_f64).prop_map(|(scale, angle, x, y)| Similarity {
        scale,
        angle,
        translation: Vector2::new(x, y),
    })
}

/// Generates strengths of the action units.
fn strengths() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-0.6..0.9_f64, 11)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(24) })]

    #[test]
    fn a_still_face_has_no_faps_however_the_head_moves(view in similarity(), dx in -9.0..9.0_f64, turn in -0.02..0.02_f64) {
        let course = |m: u32| Similarity {
            angle: view.angle + turn * f64::from(m),
            translation: view.translation + Vector2::new(dx, -dx) * f64::from(m),
            ..view
        };
        let sequence = faps(&normalized(&tracked(&[], 7, course)));
        for frame in &sequence.frames {
            for fap in FapNumber::low_level() {
                prop_assert!(frame.value(fap).is_none_or(|v| v == 0.0), "FAP {fap} is {:?}", frame.value(fap));
            }
        }
    }

    #[test]
    fn roll_size_and_place_are_gone_after_track_file_and_normalization(strengths in strengths(), view in similarity()) {
        let plain = normalized(&tracked(&strengths, 9, |_| Similarity::identity()));
        let seen = normalized(&tracked(&strengths, 9, |_| view));
        // Nine digits for coordinates up to some thousand pixels: 1e-5 px, or 1e-4 face units in a face 36 px or more wide.
        let difference = largest_difference(&plain, &seen);
        prop_assert!(difference < 2e-3, "{difference} face units");
    }

    #[test]
    fn fap_files_read_back_as_written(strengths in strengths()) {
        let sequence = faps(&normalized(&tracked(&strengths, 5, |_| Similarity::identity())));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("face.fap");
        write_fap(&path, &sequence).unwrap();
        prop_assert_eq!(read_fap(&path).unwrap().sequence, sequence);
    }

    #[test]
    fn twice_the_motion_is_twice_the_faps(strengths in prop::collection::vec(-0.12..0.12_f64, 11)) {
        let twice: Vec<f64> = strengths.iter().map(|s| 2.0 * s).collect();
        let apex = |strengths: &[f64]| {
            let sequence = faps(&normalized(&tracked(strengths, 5, |_| Similarity::identity())));
            FapNumber::low_level().map(|fap| sequence.frames[24].value(fap)).collect::<Vec<_>>()
        };
        for (fap, (one, two)) in FapNumber::low_level().zip(apex(&strengths).into_iter().zip(apex(&twice))) {
            let row = FapCatalog::mpeg4().row(fap);
            // Angles are sines, and values at the end of a range are clamped; rounding loses up to half a unit in either
            // direction.
            let clamped = |v: f64| row.range.is_some_and(|(min, max)| v <= f64::from(min) || v >= f64::from(max));
            let (Some(one), Some(two)) = (one, two) else { continue };
            if !row.motion.is_some_and(FapMotion::is_angle) && !clamped(one) && !clamped(two) {
                prop_assert!((two - 2.0 * one).abs() <= 1.5, "FAP {fap}: {one}, twice {two}");
            }
        }
    }

    #[test]
    fn marks_that_went_through_their_file_give_the_same_fit(jitter in prop::collection::vec(-4.0..4.0_f64, 14), view in similarity()) {
        let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
        let frontal = wireframe.frontal();
        let marks: Vec<Correspondence> = [10, 20, 23, 31, 53, 56, 64u16]
            .iter()
            .zip(jitter.chunks(2))
            .map(|(&node, j)| {
                let p = frontal[usize::from(node)] * (120.0 / 0.613);
                let position = view.apply(&Point2::new(p.x + j[0], -p.y + j[1]));
                Correspondence::mark(NodeId(node), position)
            })
            .collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("C.csv");
        write_correspondences(&path, &marks).unwrap();
        let read = read_correspondences(&path, &tables, wireframe.node_count()).unwrap();
        let fitter = Fitter::new(&wireframe, FitOptions::default());
        let nodes = |marks: &[Correspondence]| fitter.fit(&wireframe, marks).unwrap().model.nodes().to_vec();
        for (p, q) in nodes(&marks).iter().zip(&nodes(&read)) {
            prop_assert!((p - q).norm() < 1e-4);
        }
    }

    /// A run compares its options with those in `run.json`, so reading must return exactly the same numbers.
    #[test]
    fn options_read_back_from_json_as_written(a in any::<f64>(), b in 0.0..1.0_f64, c in 1e-9..1e9_f64, between in 0usize..99) {
        prop_assume!(a.is_finite());
        let options = PipelineOptions {
            fit: FitOptions { force: a, prior: PriorKind::None, ..FitOptions::default() },
            track: TrackOptions { window: b, extreme: c, force: b / 3.0, ..TrackOptions::default() },
            statistics: StatisticsOptions { alpha: b / 2.0, ..StatisticsOptions::default() },
            fap: FapOptions { between, fps: 30, ..FapOptions::default() },
            by: vec!["a\"b".to_owned(), "ü".to_owned()],
            marks: LandmarkSelection::default(),
            ..PipelineOptions::default()
        };
        let text = serde_json::to_string_pretty(&options).unwrap();
        prop_assert_eq!(serde_json::from_str::<PipelineOptions>(&text).unwrap(), options);
    }

    /// Invalid text in any column of a track file gives an error or a track, never a panic.
    #[test]
    fn any_track_file_reads_or_fails(text in "frame,node,x,y(,state)?\n([0-9]{1,3},[0-9]{0,2},[0-9.eN-]{0,6},[0-9]{1,3}(,tracked|,)?\n){0,6}") {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("t.csv");
        std::fs::write(&path, &text).unwrap();
        if let Ok(frames) = read_track(&path) {
            prop_assert!(frames.len() >= 2);
            prop_assert!(track_model(&frames).is_ok());
        }
    }
}

/// A track with all states: they are preserved in the file.
#[test]
fn states_and_residuals_survive_the_file() {
    let mut frames = tracked(&[0.3], 3, |_| Similarity::identity());
    frames[1].nodes[7] = TrackedNode { residual: Some(0.125), state: NodeState::Corrected, ..frames[1].nodes[7] };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("t.csv");
    std::fs::write(&path, track_csv(&frames)).unwrap();
    let read = read_track(&path).unwrap();
    assert_eq!(track_csv(&read), track_csv(&frames));
    assert_eq!((read[1].nodes[7].state, read[1].nodes[7].residual), (NodeState::Corrected, Some(0.125)));
}
