//! Benchmarks one search with its dense surface, and an animation to glTF, on the embedded bank (23,424 vertices).
#![allow(missing_docs, clippy::pedantic)]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use grimace::internal::synthesis::{
    Animation, FpMotion, RegionScheme, Solver, SynthesisOptions, Synthesizer, candide_bank, candide_study, write_gltf,
};

fn search(c: &mut Criterion) {
    let (bank, unseen) = candide_study(1).unwrap();
    let motion = FpMotion::of_surface(&bank, unseen.displacements(100));
    let mut group = c.benchmark_group("search and surface");
    for scheme in [RegionScheme::Whole, RegionScheme::Halves, RegionScheme::Quarters] {
        for solver in [Solver::Ga, Solver::Refined, Solver::Nnls, Solver::Rbf] {
            let options = SynthesisOptions { solver, regions: scheme, bound_starts: 0, ..SynthesisOptions::default() };
            let synthesizer = Synthesizer::new(&bank, options).unwrap();
            group.bench_function(format!("{solver}, {} regions", scheme.names().len()), |b| {
                b.iter(|| {
                    let answer = synthesizer.solve(black_box(&motion), 0);
                    synthesizer.surface(&answer, &motion)
                });
            });
        }
    }
    group.finish();
}

fn animation(c: &mut Criterion) {
    let bank = candide_bank().unwrap();
    let synthesizer = Synthesizer::new(&bank, SynthesisOptions { bound_starts: 0, ..SynthesisOptions::default() }).unwrap();
    let apex = FpMotion::of_surface(&bank, bank.displacements(3));
    let motions: Vec<FpMotion> = (0..25).map(|k| apex.emphasized(f64::from(k) / 24.0)).collect();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("animation.glb");
    let mut group = c.benchmark_group("animation");
    group.sample_size(10);
    group.bench_function("25 frames to glTF", |b| {
        b.iter(|| {
            let answers = synthesizer.animate(black_box(&motions), || ());
            let animation = Animation {
                synthesizer: &synthesizer,
                motions: &motions,
                answers: &answers,
                name: "bench",
                fps: 25.0,
                texture: None,
            };
            write_gltf(&path, &[animation]).unwrap();
        });
    });
    group.bench_function("the embedded bank", |b| b.iter(|| black_box(candide_bank().unwrap())));
    group.finish();
}

criterion_group!(benches, search, animation);
criterion_main!(benches);
