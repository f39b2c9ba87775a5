//! Computes the representative of models from another source: here Candide's smile at different strengths.
//!
//!     cargo run --example own_statistics

use std::{collections::BTreeMap, error::Error};

use grimace::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::Canonical,
    statistics::{ClassLabel, Representative, SequenceModel, StatisticsOptions, representative},
    units::{FaceUnit, SequenceId},
    wireframe::Face,
};
use nalgebra::{Point2, Vector2};

fn main() -> Result<(), Box<dyn Error>> {
    let smile = run(&[0.6, 0.8, 1.0, 1.1, 5.0])?;
    println!("{} models, dispersion {:.2} face units", smile.sequences.len(), smile.dispersion.unwrap_or(0.0));
    for row in smile.trimming.iter().filter(|row| row.dropped) {
        println!("trimmed: {} in displacement field {}", row.id, row.field);
    }
    Ok(())
}

/// Returns the representative of smiles with these strengths: the mouth corners (nodes 31 and 64) move up and out over five
/// frames.
///
/// # Errors
/// Any error of the steps.
pub fn run(strengths: &[f64]) -> Result<Representative, Box<dyn Error>> {
    let face = Face::candide3();
    // Models start from the canonical neutral: face units, x to the subject's left, y up, ES0 = 1024.
    let neutral = Canonical::new(&face.wireframe, &face.tables)?.neutral;
    let reach = 0.05 * FaceUnit::PER_ES;
    let model = |(person, &strength): (usize, &f64)| {
        let frame = |m: usize| {
            let mut nodes: Vec<Point2<f64>> = neutral.nodes().to_vec();
            let share = strength * m as f64 / 4.0;
            nodes[31] += Vector2::new(reach, reach) * share;
            nodes[64] += Vector2::new(-reach, reach) * share;
            FrameExpressionModel::new(nodes)
        };
        let id = SequenceId { subject: format!("S{:03}", person + 1), sequence: "smile".to_owned() };
        Ok(SequenceModel { id, model: DynamicExpressionModel::new((0..5).map(frame).collect())? })
    };
    let models = strengths.iter().enumerate().map(model).collect::<Result<Vec<_>, Box<dyn Error>>>()?;
    let label = ClassLabel { emotion: "smile".to_owned(), group: BTreeMap::new() };
    let options = StatisticsOptions { alpha: 0.2, ..StatisticsOptions::default() };
    Ok(representative(label, &models, &face.wireframe, &options)?)
}
