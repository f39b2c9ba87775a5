//! The dense synthesis on a real face bank, which is not shipped: the bank is built, mixed and measured.

use std::path::Path;

use grimace::internal::synthesis::{
    Bank, BuildOptions, Crossover, FpMotion, GaOptions, OVERLAP, PerformanceOptions, RegionScheme, Regions, Solver,
    SynthesisOptions, Synthesizer, arkit, build_bank, choose_members, choose_targets, mix, mix_bank, perform, recipe_motions,
};
use grimace_lab::evaluate::{Seams, SynthesisStudy, SynthesisTarget, evaluate_crossovers, evaluate_solvers};

/// Builds the 53 shapes, the bank of 30 and the 354 unseen models; prints a notice and returns `None` without the data.
fn banks(folder: &Path) -> Option<(Bank, Bank, Bank)> {
    let source = &crate::common::root().join("../shared/data/ict");
    if !source.is_dir() {
        eprintln!("SKIPPED: {} does not exist; the real face bank was not tested", source.display());
        return None;
    }
    let options = BuildOptions { part: Some("narrow_face".to_owned()), subdivide: 1, ..BuildOptions::default() };
    let shapes_file = folder.join("shapes.bank");
    let summary = build_bank(source, &shapes_file, &options).unwrap();
    // One round over 6706 vertices and 13120 triangles; all 56 feature points are on this surface.
    assert_eq!((summary.vertices, summary.triangles, summary.members), (26_534, 52_480, 53));
    assert_eq!((summary.feature_points.len(), summary.missing.len()), (56, 0));
    let shapes = Bank::open(&shapes_file).unwrap();
    let expressions = arkit::dominant_expressions(shapes.names()).unwrap();
    let sides: Vec<f64> = shapes.names().iter().map(|n| arkit::side(n)).collect();
    let recipes = perform(&expressions, &sides, &PerformanceOptions::default());
    let chosen = choose_members(&recipe_motions(&shapes, &recipes), 6, 30);
    let write = |file: &str, models: Vec<usize>| {
        let recipes: Vec<_> = models.iter().map(|&k| recipes[k].clone()).collect();
        mix_bank(&shapes, &recipes, &folder.join(file)).unwrap();
        Bank::open(&folder.join(file)).unwrap()
    };
    let rest = (0..recipes.len()).filter(|k| !chosen.contains(k)).collect();
    let (bank, unseen) = (write("bank", chosen), write("unseen", rest));
    Some((shapes, bank, unseen))
}

#[test]
fn the_papers_experiments_reach_the_figures_of_the_issue() {
    let folder = tempfile::tempdir().unwrap();
    let Some((_, bank, unseen)) = banks(folder.path()) else { return };
    let target = |k: usize| SynthesisTarget { name: unseen.names()[k].clone(), truth: unseen.displacements(k) };
    let study = SynthesisStudy {
        bank: &bank,
        targets: choose_targets(unseen.member_count(), 20, 1).into_iter().map(target).collect(),
        region_targets: 10,
        runs: 10,
        crossovers: vec![Crossover::Line],
        ga: GaOptions::default(),
        overlap: OVERLAP,
        bound_starts: 4,
    };
    let line = &evaluate_crossovers(&study, &|| true).unwrap()[0];
    assert!((line.fitness - 0.970).abs() <= 0.02, "{}", line.fitness);
    let rows = evaluate_solvers(&study, &|| true).unwrap();
    let row = |scheme: RegionScheme, solver: Solver| rows.iter().find(|r| r.scheme == scheme && r.solver == solver).unwrap();
    let whole = row(RegionScheme::Whole, Solver::Refined);
    assert!(whole.fitness.0 >= 0.99 && whole.share_of_bound.unwrap().0 >= 0.995, "{whole:?}");
    assert!(row(RegionScheme::Quarters, Solver::Refined).fitness.0 >= 0.995);
    let rbf = row(RegionScheme::Whole, Solver::Rbf).mean_error();
    assert!(whole.mean_error() <= 0.06 && whole.mean_error() <= rbf / 5.0, "{} {rbf}", whole.mean_error());
    // The refinement improves what it starts from, and the genetic algorithm the best member.
    let fitness = |solver| row(RegionScheme::Whole, solver).fitness.0;
    assert!(fitness(Solver::Best) < fitness(Solver::Ga) && fitness(Solver::Ga) < fitness(Solver::Refined));
    let seams: Vec<_> = rows.iter().filter_map(|r| r.seam).collect();
    assert!(seams.len() == 10 && seams.iter().all(|s| s.inside <= 1.1 && s.own <= 1.1), "{seams:?}");
}

#[test]
fn different_halves_join_without_a_seam() {
    let folder = tempfile::tempdir().unwrap();
    let Some((_, bank, _)) = banks(folder.path()) else { return };
    let member = |name: &str| bank.displacements(bank.names().iter().position(|n| n == name).unwrap());
    let halves = Regions::new(&bank, RegionScheme::Halves, OVERLAP).unwrap();
    // The right side angry, the left side surprised; and the left side at rest.
    for (right, left) in [("anger", "surprise"), ("happiness", "sadness")] {
        let sides = member(right).iter().zip(member(left)).enumerate().map(|(v, (r, l))| {
            let share = halves.vertex_shares(1)[v];
            std::array::from_fn(|k| (1.0 - share) * r[k] + share * l[k])
        });
        let target: Vec<[f32; 3]> = sides.collect();
        for scheme in [RegionScheme::Halves, RegionScheme::Quarters] {
            let options = SynthesisOptions { regions: scheme, bound_starts: 0, ..SynthesisOptions::default() };
            let synthesizer = Synthesizer::new(&bank, options).unwrap();
            let motion = FpMotion::of_surface(&bank, &target);
            let answer = synthesizer.solve(&motion, 0);
            assert!(answer.fitness.unwrap() > 0.9, "{right} {left} {:?}", answer.fitness);
            let surface = synthesizer.surface(&answer, &motion);
            let own: Vec<_> = answer.weights.iter().map(|w| mix(&bank, w)).collect();
            let seam = Seams::new(bank.mesh(), synthesizer.regions()).measure(bank.mesh(), &surface, &own).unwrap();
            assert!(seam.inside <= 1.1 && seam.own <= 1.1, "{right} {left} {scheme:?}: {seam:?}");
        }
    }
}

#[test]
fn the_solved_weights_are_the_arkit_coefficients_behind_a_model() {
    let folder = tempfile::tempdir().unwrap();
    let Some((_, bank, _)) = banks(folder.path()) else { return };
    // Half of happiness, whose recipe has mouthSmileLeft 0.85.
    let half: Vec<[f32; 3]> = bank.displacements(3).iter().map(|d| d.map(|c| c / 2.0)).collect();
    let synthesizer = Synthesizer::new(&bank, SynthesisOptions { bound_starts: 0, ..SynthesisOptions::default() }).unwrap();
    let answer = synthesizer.solve(&FpMotion::of_surface(&bank, &half), 0);
    let values =
        arkit::coefficients(bank.names(), bank.info().composition.as_ref(), RegionScheme::Whole, &answer.weights).unwrap();
    let at = |name: &str| values[arkit::coefficient(name).unwrap()];
    assert!((at("mouthSmileLeft") - 0.425).abs() < 0.02, "{}", at("mouthSmileLeft"));
    assert!((at("cheekSquintRight") - 0.35).abs() < 0.03 && at("jawForward").abs() < 0.02);
}
