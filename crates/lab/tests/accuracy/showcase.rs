//! The simulated person on whom the report shows the representatives: shipped as a picture with its nodes.
//!
//! After a change of the simulation that is meant, `REGENERATE=1 cargo test --test accuracy showcase` writes both anew.

use std::{fmt::Write as _, fs};

use grimace_lab::simulate::{Emotion, SimulateOptions, simulate_sequence};

#[test]
fn the_face_of_the_report_is_what_the_simulation_makes() {
    let options = SimulateOptions {
        subjects: 1,
        frames: 2,
        width: 360,
        height: 400,
        noise_sigma: 0.0,
        roll_degrees: 0.0,
        shift_px: 0.0,
        scale_change: 0.0,
        ..SimulateOptions::default()
    };
    let neutral = simulate_sequence(&options, 0, Emotion::Happiness).unwrap().next().unwrap();
    let assets = crate::common::root().join("src/pipeline/assets");
    let (picture, table) = (assets.join("simulated_face.png"), assets.join("simulated_face.csv"));
    if std::env::var_os("REGENERATE").is_some() {
        neutral.image.save(&picture).unwrap();
        let mut text = "node,x,y\n".to_owned();
        // As many digits as it takes to read the same numbers back.
        for (node, p) in neutral.nodes.iter().enumerate() {
            writeln!(text, "{node},{},{}", p.x, p.y).unwrap();
        }
        fs::write(&table, text).unwrap();
    }
    // Libraries of other machines may round a sine differently.
    let shipped = image::open(&picture).unwrap().into_rgb8();
    assert_eq!(shipped.dimensions(), neutral.image.dimensions());
    let largest = shipped.as_raw().iter().zip(neutral.image.as_raw()).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(largest <= Some(2), "{largest:?} grey levels");
    let rows: Vec<(usize, f64, f64)> = csv::Reader::from_path(&table).unwrap().deserialize().map(|row| row.unwrap()).collect();
    assert_eq!(rows.len(), neutral.nodes.len());
    for (index, (node, x, y)) in rows.into_iter().enumerate() {
        let expected = neutral.nodes[node];
        assert!((x - expected.x).hypot(y - expected.y) < 1e-9 && index == node, "node {node}");
    }
}
