use std::collections::BTreeMap;

use proptest::prelude::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{
    super::{
        median::{Slots, exact_median},
        trimming::{sums_of_distances, trim_outliers},
    },
    *,
};

/// Models of `fields` fields over `nodes` nodes. The scatter of a model increases with its number modulo 10.
fn models(count: usize, nodes: usize, fields: usize, seed: u64) -> Vec<DisplacementFields> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut gauss = || -> f64 { StandardNormal.sample(&mut random) };
    let model = |i: usize, gauss: &mut dyn FnMut() -> f64| {
        let spread = 1.0 + (i % 10) as f64 * 0.2;
        let vectors: Vec<_> = (0..nodes * fields).map(|k| Vector2::new(3.0 + spread * gauss(), k as f64 * gauss())).collect();
        DisplacementFields::from_vectors(nodes, &vectors)
    };
    (0..count).map(|i| model(i, &mut gauss)).collect()
}

fn direct(models: &[DisplacementFields], alpha: f64) -> super::super::trimming::Trimming {
    let everything: Vec<Vec<usize>> = vec![(0..models.len()).collect(); models[0].field_count()];
    trim_outliers(&sums_of_distances(models, &everything, None), None, alpha, TrimLevel::Frame)
}

#[test]
fn certified_trimming_drops_what_all_pairs_drop() {
    let models = models(1500, 7, 3, 1);
    let expected = direct(&models, 0.1);
    let found = trim_certified(models.as_slice(), 150, DEFAULT_MEMORY).unwrap();
    assert_eq!(found.kept, expected.kept);
    assert!(found.undecided.is_empty());
    // Bounds decide most of the 4,500 (field, model) pairs.
    assert!(found.exact < 1200, "{}", found.exact);
    for (found_field, expected_field) in found.distances.iter().zip(&expected.distances) {
        for (f, e) in found_field.iter().zip(expected_field) {
            assert!((f - e).abs() <= found.relative_bound * e, "{f} {e}");
        }
    }
}

#[test]
fn equal_models_are_dropped_in_the_order_of_their_ids() {
    let mut all = models(40, 3, 2, 2);
    let far = DisplacementFields::from_vectors(3, &[Vector2::new(500.0, 0.0); 6]);
    for i in [3, 20, 31] {
        all[i] = far.clone();
    }
    // Three equal models are farthest. Two are dropped: the later two.
    let found = trim_certified(all.as_slice(), 2, DEFAULT_MEMORY).unwrap();
    assert!(found.kept.iter().all(|kept| kept.contains(&3) && !kept.contains(&20) && !kept.contains(&31)));
}

#[test]
fn the_streamed_median_is_the_exact_one_whatever_the_memory() {
    let models = models(60, 9, 2, 3);
    let kept = direct(&models, 0.2).kept;
    let slots = Slots::new(&models, &kept, None);
    let expected = exact_median(&slots, &ExactOptions::default());
    let found = streamed_median(models.as_slice(), Some(&kept), None, DEFAULT_MEMORY).unwrap();
    assert_eq!(found.vectors, expected.vectors);
    assert_eq!(found.sum, slots.total(&expected.sums));
    let center = DisplacementFields::from_vectors(9, &expected.vectors);
    let by_model = super::super::dispersion::KeptFields::by_model(&kept, 60);
    for (f, e) in found.distances.iter().zip(by_model.distances(&models, &center)) {
        approx::assert_relative_eq!(f.unwrap_or(-1.0), e.unwrap_or(-1.0), max_relative = 1e-12);
    }
    for (f, e) in found.node_dispersion.iter().zip(by_model.node_dispersion(&models, &center, None)) {
        approx::assert_relative_eq!(*f, e, max_relative = 1e-12);
    }
    let small = streamed_median(models.as_slice(), Some(&kept), None, 1).unwrap();
    assert_eq!((small.vectors, small.distances), (found.vectors, found.distances));
}

#[test]
fn the_representative_of_many_is_that_of_few() {
    let wireframe = Wireframe::candide3();
    let live = wireframe.live_nodes().len();
    let fields = models(120, live, 4, 4);
    let neutral: Vec<_> = wireframe.frontal().iter().map(|p| p * 1024.0 / 0.613).collect();
    let label = ClassLabel { emotion: "happiness".to_owned(), group: BTreeMap::new() };
    let ids: Vec<SequenceId> = (0..120).map(|i| SequenceId { subject: format!("s{i:03}"), sequence: "1".to_owned() }).collect();
    let sequences: Vec<_> = ids
        .iter()
        .zip(&fields)
        .map(|(id, fields)| {
            let model = model_from_displacements(neutral.clone(), fields, &wireframe).unwrap();
            super::super::SequenceModel { id: id.clone(), model }
        })
        .collect();
    let options = StatisticsOptions { median: MedianKind::Exact, ..StatisticsOptions::default() };
    let few = super::super::representative(label.clone(), &sequences, &wireframe, &options).unwrap();
    let many = representative_of_many(label, ids, neutral, fields.as_slice(), &wireframe, &options, DEFAULT_MEMORY).unwrap();
    assert_eq!(many.sequences, few.sequences);
    let dropped = |r: &Representative| r.trimming.iter().map(|row| row.dropped).collect::<Vec<_>>();
    assert_eq!(dropped(&many), dropped(&few));
    for (a, b) in [(many.dispersion, few.dispersion), (many.dispersion_untrimmed, few.dispersion_untrimmed)] {
        approx::assert_relative_eq!(a.unwrap(), b.unwrap(), max_relative = 1e-9);
    }
    let forms = |d: &Dispersions| [d.literal, d.literal_untrimmed, d.field, d.field_untrimmed].map(Option::unwrap);
    for (a, b) in forms(&many.dispersions).into_iter().zip(forms(&few.dispersions)) {
        approx::assert_relative_eq!(a, b, max_relative = 1e-9);
    }
    approx::assert_relative_eq!(many.sums.exact, few.sums.exact, max_relative = 1e-9);
    let certificate = many.certificate.unwrap();
    assert_eq!(certificate.decided_by_bounds + certificate.decided_exactly, 4 * 120);
    assert!(certificate.undecided.is_empty() && few.certificate.is_none());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_number_dropped_is_the_right_ones(count in 5..90usize, share in 0.05..0.49f64, seed in 0..1000u64) {
        let models = models(count, 4, 2, seed);
        let dropped = trimmed_count(share, count);
        prop_assume!(dropped > 0);
        let found = trim_certified(models.as_slice(), dropped, 1 << 20).unwrap();
        prop_assert_eq!(found.kept, direct(&models, share).kept);
    }
}

#[test]
fn distances_are_means_over_any_number_of_fields() {
    let models = models(12, 2, 300, 5);
    let found = streamed_median(models.as_slice(), None, None, DEFAULT_MEMORY).unwrap();
    let center = DisplacementFields::from_vectors(2, &found.vectors);
    for (model, distance) in models.iter().zip(&found.distances) {
        let all = (0..300).flat_map(|m| [(m, 0), (m, 1)]);
        let expected = all.map(|(m, k)| (model.vector(m, k) - center.vector(m, k)).norm()).sum::<f64>() / 600.0;
        assert!((distance.unwrap() / expected - 1.0).abs() < 1e-9, "{distance:?} {expected}");
    }
}
