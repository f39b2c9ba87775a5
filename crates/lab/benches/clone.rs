//! Frames a second of cloning at 640x480 on one thread, without writing files.
//!
//! `cargo bench --bench clone` prepares a simulated face of 640x480 and renders an expression over and over: node positions to
//! finished picture (the field, the triangles, the openings). Machines are noisy, so the figure to quote is the best of the rounds;
//! the median stands beside it. Preparing a face (mesh and weights) is timed apart.
#![allow(missing_docs, clippy::pedantic)]

use std::time::Instant;

use grimace::internal::warp::{MouthInside, Texture, Warp};
use grimace_lab::simulate::{Emotion, SimulateOptions, simulate_sequence};

/// Rounds.
const ROUNDS: usize = 30;
/// Frames of a round.
const FRAMES: usize = 24;

fn main() {
    let options = SimulateOptions { subjects: 1, frames: FRAMES, roll_degrees: 0.0, shift_px: 0.0, ..SimulateOptions::default() };
    for emotion in [Emotion::Happiness, Emotion::Surprise] {
        let frames: Vec<_> = simulate_sequence(&options, 0, emotion).expect("the options are in range").collect();
        let started = Instant::now();
        let warp = Warp::new(&frames[0].nodes).expect("a simulated face can be warped");
        let prepared = started.elapsed();
        let texture = Texture::new(&frames[0].image);
        for (name, inside) in [("dark", MouthInside::Dark), ("teeth", MouthInside::Teeth)] {
            let mut picture = image::RgbImage::default();
            let mut rates: Vec<f64> = (0..ROUNDS)
                .map(|_| {
                    let started = Instant::now();
                    for frame in &frames[1..] {
                        let deformation = warp.deform(&frame.nodes).expect("the nodes are finite");
                        warp.render_into(&texture, &deformation, &inside, &mut picture);
                    }
                    (FRAMES - 1) as f64 / started.elapsed().as_secs_f64()
                })
                .collect();
            rates.sort_by(f64::total_cmp);
            println!(
                "{emotion}, {name} mouth: best {:.0}, median {:.0} frames a second (640x480, one thread); face prepared in {:.0} ms",
                rates[ROUNDS - 1],
                rates[ROUNDS / 2],
                prepared.as_secs_f64() * 1000.0
            );
        }
    }
}
