//! Groups and scale: the permutation test of two groups of 50, and the statistics of many models in memory.
//!
//! `cargo bench --bench populations`. Larger numbers, with memory, are measured by `grimace evaluate scale`.
#![allow(missing_docs, clippy::pedantic)]

use std::{collections::BTreeMap, hint::black_box, time::Duration};

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use grimace::internal::{
    statistics::{
        ClassLabel, MedianKind, StatisticsOptions,
        compare::{CompareOptions, test},
        distance::DisplacementFields,
        scale::{DEFAULT_MEMORY, representative_of_many, streamed_median, trim_certified},
    },
    units::SequenceId,
};
use grimace_lab::evaluate::SyntheticPeople;

fn bench(criterion: &mut Criterion) {
    let people = SyntheticPeople::new(1).expect("Candide-3 has FAPUs");
    let mut group = criterion.benchmark_group("populations");
    group.sample_size(10).measurement_time(Duration::from_secs(3)).warm_up_time(Duration::from_millis(500));

    let two: Vec<Vec<DisplacementFields>> = (0..100).map(|i| vec![people.fields(i, 1.0)]).collect();
    let options = CompareOptions { permutations: 10_000, ..CompareOptions::default() };
    group.bench_function("10000 permutations, 50 and 50 people", |b| b.iter(|| black_box(test(&two, 50, &options, 0))));

    for count in [1000, 4000] {
        let fields: Vec<DisplacementFields> = (0..count).map(|i| people.fields(i, 1.0)).collect();
        let fields = fields.as_slice();
        group.bench_function(BenchmarkId::new("certified trimming", count), |b| {
            b.iter(|| trim_certified(black_box(fields), count as usize / 10, DEFAULT_MEMORY).expect("in memory"));
        });
        group.bench_function(BenchmarkId::new("streamed median", count), |b| {
            b.iter(|| streamed_median(black_box(fields), None, None, DEFAULT_MEMORY).expect("in memory"));
        });
        group.bench_function(BenchmarkId::new("representative of many", count), |b| {
            b.iter(|| {
                let ids = (0..count).map(|i| SequenceId { subject: format!("{i:06}"), sequence: "1".to_owned() }).collect();
                let label = ClassLabel { emotion: "happiness".to_owned(), group: BTreeMap::new() };
                let statistics = StatisticsOptions { median: MedianKind::Exact, ..StatisticsOptions::default() };
                let neutral = people.frames(0, 1.0).swap_remove(0);
                representative_of_many(label, ids, neutral, fields, people.wireframe(), &statistics, DEFAULT_MEMORY)
                    .expect("models of one shape")
            });
        });
    }
    group.finish();
}

criterion_group!(benches, bench);
criterion_main!(benches);
