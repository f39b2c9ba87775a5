//! Benchmarks the statistics of one class against their minimum cost, the sum of all pairwise distances.
//!
//! `cargo bench --bench statistics` measures both for N'' = 50, 200 and 1000 models of Candide-3 (N' = 5 frames, N = 104 live
//! nodes).
#![allow(missing_docs, clippy::pedantic)]

use std::{collections::BTreeMap, hint::black_box, time::Duration};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use grimace::internal::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    statistics::{ClassLabel, MedianKind, SequenceModel, StatisticsOptions, representative},
    units::SequenceId,
    wireframe::Wireframe,
};
use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const FRAMES: usize = 5;

/// Models that vary like people: a common expression with individual strength and timing, and noise on every node.
fn models(wireframe: &Wireframe, count: usize) -> Vec<SequenceModel> {
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut uniform = |width: f64| width * (random.random::<f64>() - 0.5);
    let neutral: Vec<Point2<f64>> = wireframe.frontal().iter().map(|p| p * 1000.0).collect();
    let expression: Vec<Vector2<f64>> = neutral.iter().map(|_| Vector2::new(uniform(60.0), uniform(120.0))).collect();
    let model = |i: usize| {
        let (strength, timing) = (1.0 + uniform(1.0), 1.0 + uniform(0.8));
        let frames = (0..FRAMES).map(|frame| {
            let share = strength * (frame as f64 / (FRAMES - 1) as f64).powf(timing);
            let mut nodes: Vec<Point2<f64>> = neutral
                .iter()
                .zip(&expression)
                .map(|(p, e)| p + e * share + if frame > 0 { Vector2::new(uniform(8.0), uniform(8.0)) } else { Vector2::zeros() })
                .collect();
            wireframe.place_followers(&mut nodes);
            FrameExpressionModel::new(nodes)
        });
        let id = SequenceId { subject: format!("S{i:04}"), sequence: "001".to_owned() };
        SequenceModel { id, model: DynamicExpressionModel::new(frames.collect()).expect("frames of one wireframe") }
    };
    (0..count).map(model).collect()
}

/// The sum of d over all pairs on one thread, written directly from the equations.
fn pairwise_sum(fields: &[Vec<Vector2<f64>>]) -> f64 {
    let mut sum = 0.0;
    for (i, a) in fields.iter().enumerate() {
        for b in &fields[..i] {
            sum += a.iter().zip(b).map(|(a, b)| (a - b).norm()).sum::<f64>();
        }
    }
    sum
}

fn bench(criterion: &mut Criterion) {
    let wireframe = Wireframe::candide3();
    let mut group = criterion.benchmark_group("statistics");
    group.sample_size(10).measurement_time(Duration::from_secs(3)).warm_up_time(Duration::from_millis(500));
    for count in [50, 200, 1000] {
        let models = models(&wireframe, count);
        let displacements = |model: &SequenceModel| {
            let field = |m| model.model.displacement_field(m);
            let live =
                |field: Vec<Vector2<f64>>| wireframe.live_nodes().iter().map(move |n| field[n.index()]).collect::<Vec<_>>();
            (0..FRAMES - 1).map(field).flat_map(live).collect::<Vec<_>>()
        };
        let fields: Vec<_> = models.iter().map(displacements).collect();
        group.bench_with_input(BenchmarkId::new("pairwise sum alone", count), &fields, |b, fields| {
            b.iter(|| pairwise_sum(black_box(fields)));
        });
        for median in [MedianKind::Greedy, MedianKind::Exact] {
            let options = StatisticsOptions { median, ..StatisticsOptions::default() };
            let label = || ClassLabel { emotion: "happiness".to_owned(), group: BTreeMap::new() };
            let compute = || representative(label(), &models, &wireframe, &options).expect("models of one shape");
            let result = compute();
            println!("N'' = {count}, {median:?}: {:?} {:?}", result.sums, result.search);
            group.bench_function(BenchmarkId::new(format!("representative, {median:?}"), count), |b| {
                b.iter(|| black_box(compute()));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
