//! The warp on real photographs, when the project's shared data is next to the repository; otherwise the test prints that it was skipped.
//!
//! On every target, at the apex of every emotion and in a blink, there must be no hole, no folded or doubled skin, and no changed pixel
//! outside the surroundings of the face.

use std::{
    fs,
    path::{Path, PathBuf},
};

use grimace::internal::{
    clone::Target,
    dataset::{Dataset, LandmarkSelection, read_marks},
    fit::Correspondence,
    pipeline::{PipelineOptions, Workbench, showcase_target},
    sequence::read_colour,
    warp::{MouthInside, Texture},
    wireframe::{Emotion, ExpressionUnit, UnitKind, expressions},
};
use nalgebra::{Point2, Vector2};

/// Largest distance from the convex hull of the nodes at which pixels may change, relative to the eye distance.
const SURROUNDINGS: f64 = 0.76;

fn data(name: &str) -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data").join(name);
    let found = folder.join("manifest.csv").is_file();
    if !found {
        eprintln!("SKIPPED, NOTHING WAS TESTED: {} does not exist", folder.display());
    }
    found.then_some(folder)
}

/// Returns the offsets of the nodes at the apex of an emotion, or with closed eyes, in model units of face space.
fn offsets(bench: &Workbench, emotion: Option<Emotion>) -> Vec<Vector2<f64>> {
    let mut offsets = vec![Vector2::zeros(); bench.wireframe.node_count()];
    let fapus = grimace::internal::wireframe::Fapus::measure(&bench.tables.fapus, &bench.wireframe.frontal()).unwrap();
    let mut add = |unit: ExpressionUnit, weight: f64| {
        for candidate in bench.wireframe.action_units() {
            let length = match (unit, &candidate.kind) {
                (ExpressionUnit::Auv(wanted), UnitKind::Action { number }) if wanted == *number => 1.0,
                (ExpressionUnit::Fap(wanted), UnitKind::Fap { number, fapu }) if wanted == *number => {
                    fapu.and_then(|f| fapus.length(f)).unwrap_or(1.0)
                }
                _ => continue,
            };
            for (node, offset) in &candidate.offsets {
                offsets[node.index()] += offset.xy() * weight * length;
            }
        }
    };
    match emotion {
        Some(emotion) => expressions().iter().filter(|r| r.emotion == emotion).for_each(|r| add(r.unit, r.weight)),
        None => add(ExpressionUnit::Auv(6), 1.0),
    }
    offsets
}

/// Returns directions with the extent of the nodes in each; the distance of a point from the convex hull is at least its excess in any of
/// them.
fn supports(nodes: &[Point2<f64>]) -> Vec<(Vector2<f64>, f64)> {
    (0..64)
        .map(|k| {
            let angle = std::f64::consts::TAU * f64::from(k) / 64.0;
            let direction = Vector2::new(angle.cos(), angle.sin());
            (direction, nodes.iter().map(|p| p.coords.dot(&direction)).fold(f64::NEG_INFINITY, f64::max))
        })
        .collect()
}

fn check(name: &str, picture: image::RgbImage, marks: &[Correspondence], bench: &Workbench) {
    let size = picture.dimensions();
    let target = Target::new(name, picture, marks, bench.fitter(), bench).unwrap_or_else(|e| panic!("{name}: {e}"));
    let (warp, neutral) = (target.warp(), target.fitted.model.nodes());
    let still = warp.render(target.texture(), &warp.deform(neutral).unwrap(), &MouthInside::Dark);
    assert!(still == target.picture, "{name}: the neutral face is not reproduced bit for bit");
    let supports = supports(neutral);
    let reach = SURROUNDINGS * warp.eye_distance() + 1.0;
    let beyond: Vec<(u32, u32)> = (0..size.1)
        .flat_map(|y| (0..size.0).map(move |x| (x, y)))
        .filter(|&(x, y)| {
            let point = Vector2::new(f64::from(x), f64::from(y));
            supports.iter().any(|(direction, support)| point.dot(direction) - support > reach)
        })
        .collect();
    for emotion in Emotion::BASIC.map(Some).into_iter().chain([None]) {
        let moved: Vec<Point2<f64>> = neutral
            .iter()
            .zip(offsets(bench, emotion))
            .map(|(p, o)| p + target.fitted.image_from_face.apply_vector(&Vector2::new(o.x, -o.y)))
            .collect();
        let deformation = warp.deform(&moved).unwrap();
        let audit = warp.audit(&deformation, size);
        assert_eq!((audit.folded, audit.holes), (0, 0), "{name}, {emotion:?}: {audit:?}");
        // Pixels that two thin triangles share where closed lips meet at the corner.
        assert!(audit.doubled <= audit.inside / 10_000, "{name}, {emotion:?}: {audit:?}");
        assert!(audit.inside > 100);
        let frame = warp.render(target.texture(), &deformation, &MouthInside::Dark);
        let changed = beyond.iter().find(|&&(x, y)| frame.get_pixel(x, y) != target.picture.get_pixel(x, y));
        assert!(changed.is_none(), "{name}, {emotion:?}: pixel {changed:?} outside the surroundings of the face changed");
        assert!(frame != target.picture, "{name}, {emotion:?}: nothing moved");
    }
}

#[test]
fn portraits_move_without_holes_and_without_touching_the_background() {
    let Some(folder) = data("portraits") else { return };
    let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
    let mut count = 0;
    let mut files: Vec<PathBuf> = fs::read_dir(&folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for path in files.iter().filter(|p| p.extension().is_some_and(|e| e == "jpg" || e == "png")) {
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        let marks = folder.join(format!("{stem}_landmarks68_auto.csv"));
        for selection in [LandmarkSelection::Default, LandmarkSelection::HighAndMedium] {
            let marks = read_marks(&marks, &selection, &bench.tables, bench.wireframe.node_count()).unwrap();
            check(&format!("{stem} {selection:?}"), read_colour(path).unwrap(), &marks, &bench);
        }
        count += 1;
    }
    assert!(count >= 8, "{count} portraits");
}

#[test]
fn shipped_portraits_move_without_holes_and_one_is_that_of_the_report() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/portraits");
    let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
    let showcase = showcase_target(&bench).unwrap();
    let mut of_the_report = 0;
    for number in 1..=12 {
        let path = folder.join(format!("P{number:02}.jpg"));
        let marks = folder.join(format!("P{number:02}_correspondences.csv"));
        let marks = read_marks(&marks, &LandmarkSelection::Auto, &bench.tables, bench.wireframe.node_count()).unwrap();
        let picture = read_colour(&path).unwrap();
        if picture == showcase.picture {
            let target = Target::new("P", picture.clone(), &marks, bench.fitter(), &bench).unwrap();
            assert_eq!(target.fitted.model.nodes(), showcase.fitted.model.nodes());
            of_the_report += 1;
        }
        check(&format!("P{number:02}"), picture, &marks, &bench);
    }
    assert_eq!(of_the_report, 1);
}

#[test]
fn first_frames_of_sequences_move_without_holes_and_without_touching_the_background() {
    let Some(folder) = data("sequences") else { return };
    let bench = Workbench::new(None, PipelineOptions::default()).unwrap();
    let dataset = Dataset::open(&folder).unwrap();
    let mut count = 0;
    for entry in dataset.sequences.iter().filter(|e| e.id.sequence == "001") {
        let frames = entry.frames().unwrap();
        let node_count = bench.wireframe.node_count();
        let marks =
            entry.correspondences(frames.neutral_number(), &bench.tables, node_count, &LandmarkSelection::Default).unwrap();
        let picture = read_colour(frames.files()[0]).unwrap();
        check(&entry.id.to_string(), picture, &marks, &bench);
        count += 1;
    }
    assert!(count >= 15, "{count} people");
}

#[test]
fn the_warp_of_a_grey_picture_is_grey() {
    let nodes: Vec<Point2<f64>> = grimace::internal::wireframe::Wireframe::candide3()
        .vertices()
        .iter()
        .map(|v| Point2::new(80.0 + 60.0 * v.x, 90.0 - 60.0 * v.y))
        .collect();
    let grey = image::GrayImage::from_fn(160, 190, |x, y| image::Luma([(x * 3 + y * 2) as u8]));
    let texture = Texture::from_gray(&grey);
    let warp = grimace::internal::warp::Warp::new(&nodes).unwrap().with_eyes(&texture);
    let mut moved = nodes.clone();
    moved[31].x += 3.0;
    // The middles of both upper lids are on those of the lower lids: their skin, and the line of lashes.
    for (upper, lower) in [(21, 22), (54, 55)] {
        moved[upper] = nodes[lower];
    }
    let frame = warp.render(&texture, &warp.deform(&moved).unwrap(), &MouthInside::Dark);
    assert!(frame.pixels().all(|p| p.0[0] == p.0[1] && p.0[1] == p.0[2]));
}
