use nalgebra::Vector2;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    statistics::ClassLabel,
    units::{FaceUnit, SequenceId},
};

fn fields(vectors: &[(f64, f64)]) -> DisplacementFields {
    DisplacementFields::from_vectors(vectors.len(), &vectors.iter().map(|&(x, y)| Vector2::new(x, y)).collect::<Vec<_>>())
}

/// People with one sequence of one field over one node, at positions on a line.
fn line(places: &[f64]) -> Vec<Vec<DisplacementFields>> {
    places.iter().map(|&x| vec![fields(&[(x, 0.0)])]).collect()
}

#[test]
fn the_energy_distance_of_four_people_on_a_line() {
    // A = {0, 1}, B = {4, 6}. Between: 4, 6, 3, 5, mean 4.5. Within: 1 and 2. E = 9 - 1 - 2 = 6, H = 6 / 9.
    let tested = test(&line(&[0.0, 1.0, 4.0, 6.0]), 2, &CompareOptions::default(), 0);
    assert_eq!((tested.energy, tested.effect), (6.0, 6.0 / 9.0));
    // The splits of 4 into 2 and 2: 6, in 3 pairs of complements. {0, 4}{1, 6}: between 1, 6, 3, 2 -> 6 - 4 - 5 = -3.
    // {0, 6}{1, 4}: between 1, 4, 5, 2 -> 6 - 6 - 3 = -3. Only the observed split and its complement reach 6.
    assert!(tested.exhaustive);
    assert_eq!((tested.permutations, tested.p, tested.least_p), (6, 2.0 / 6.0, 2.0 / 6.0));
    assert_eq!((tested.node_energy, tested.node_p), (vec![6.0], vec![2.0 / 6.0]));
    // H is -3 / 6 four times and 6 / 9 twice, so the 95th percentile is the largest value.
    assert_eq!(tested.effect_by_chance, 6.0 / 9.0);
}

#[test]
fn sequences_of_one_person_count_as_one_person() {
    // Person 0 at 0 and 2, person 1 at 1; persons 2 and 3 at 5 and 7. d(0, 1) = (1 + 1) / 2 = 1; d(0, 2) = (5 + 3) / 2 = 4;
    // d(0, 3) = (7 + 5) / 2 = 6; d(1, 2) = 4; d(1, 3) = 6; d(2, 3) = 2. E = 2 * 5 - 1 - 2 = 7.
    let mut people = line(&[0.0, 1.0, 5.0, 7.0]);
    people[0].push(fields(&[(2.0, 0.0)]));
    assert_eq!(test(&people, 2, &CompareOptions::default(), 0).energy, 7.0);
}

#[test]
fn the_nodes_that_differ_are_found_and_no_others() {
    // Node 1 of 3 is moved by 3 standard deviations in group B.
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut gauss = || -> f64 { StandardNormal.sample(&mut random) };
    let person = |b: bool, gauss: &mut dyn FnMut() -> f64| {
        let vectors: Vec<(f64, f64)> = (0..3).map(|k| (gauss() + if b && k == 1 { 3.0 } else { 0.0 }, gauss())).collect();
        vec![fields(&vectors)]
    };
    let people: Vec<_> = (0..30).map(|i| person(i >= 15, &mut gauss)).collect();
    let tested = test(&people, 15, &CompareOptions::default(), 0);
    assert!(!tested.exhaustive);
    assert_eq!(tested.p, 1.0 / 10_000.0);
    assert!(tested.node_p[1] <= 0.01 && tested.node_p[0] > 0.05 && tested.node_p[2] > 0.05, "{:?}", tested.node_p);
    let mean = tested.node_energy.iter().sum::<f64>() / 3.0;
    approx::assert_relative_eq!(mean, tested.energy, max_relative = 1e-12);
    // The same seed gives the same numbers; the order of the groups hardly matters.
    assert_eq!(test(&people, 15, &CompareOptions::default(), 0), tested);
}

#[test]
fn equal_people_have_no_difference() {
    let tested = test(&line(&[3.0; 20]), 9, &CompareOptions::default(), 0);
    assert_eq!((tested.energy, tested.effect, tested.p, tested.node_p), (0.0, 0.0, 1.0, vec![1.0]));
}

fn model(subject: &str, sequence: &str, x: f64) -> SequenceModel {
    let frame = |x: f64| FrameExpressionModel::<FaceUnit>::new(vec![nalgebra::Point2::new(x, 0.0)]);
    let model = DynamicExpressionModel::new(vec![frame(0.0), frame(x)]).unwrap();
    SequenceModel { id: SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() }, model }
}

#[test]
fn groups_that_can_not_be_tested_say_why() {
    let (a, b, c) = (model("a", "1", 0.0), model("b", "1", 1.0), model("c", "1", 2.0));
    let b2 = model("b", "2", 1.0);
    let live = [NodeId(0)];
    let options = CompareOptions::default();
    let error = |x: &[&SequenceModel], y: &[&SequenceModel]| compare(x, y, &live, &options, None, 0).unwrap_err();
    assert_eq!(error(&[&a, &b], &[&c]), NotTested::TooFewPeople { people: 1 });
    assert_eq!(error(&[&a], &[&b, &b2]).to_string(), "a group of 1 is too small for a test");
    assert_eq!(error(&[&a, &b], &[&b2, &c]).to_string(), "b is in both groups; a test needs different people");
}

#[test]
fn models_and_options_without_a_test_are_an_error() {
    let models = ["a", "b", "c", "d"].map(|name| model(name, "1", 1.0));
    let [a, b, c, d] = models.each_ref();
    let far = model("e", "1", 1e300);
    let options = CompareOptions::default();
    let why = |e, live: &[NodeId], options: &CompareOptions| compare(&[a, b], &[c, e], live, options, None, 0).unwrap_err();
    assert_eq!(why(d, &[], &options), NotTested::Models(NotComparable::NoNodes));
    assert!(matches!(why(d, &[NodeId(1)], &options), NotTested::Models(NotComparable::Node { node: NodeId(1), nodes: 1, .. })));
    assert!(matches!(why(&far, &[NodeId(0)], &options), NotTested::Models(NotComparable::Displacement { found: 1e300, .. })));
    for significance in [f64::NAN, 0.0, 1.0, -1.0] {
        let odd = CompareOptions { significance, ..options };
        assert!(matches!(why(d, &[NodeId(0)], &odd), NotTested::Significance { .. }));
    }
    for (permutations, people) in [(0, 200), (9, 1)] {
        let odd = CompareOptions { permutations, people, ..options };
        assert_eq!(why(d, &[NodeId(0)], &odd), NotTested::Options { permutations, people });
    }
}

#[test]
fn a_group_of_one_is_left_out_of_the_test_of_all() {
    let models: Vec<SequenceModel> = (0..7).map(|i| model(&format!("s{i}"), "1", f64::from(i * i))).collect();
    let group = |name: &str, range: std::ops::Range<usize>| {
        let label = ClassLabel { emotion: "joy".to_owned(), group: [("site".to_owned(), name.to_owned())].into() };
        (label, models[range].iter().collect::<Vec<_>>())
    };
    let compared = |groups: &[(ClassLabel, Vec<&SequenceModel>)]| {
        compare_groups("joy", groups, &[NodeId(0)], &GroupOptions::default(), None)
    };
    let two = compared(&[group("a", 0..3), group("c", 4..7)]);
    let with_one = compared(&[group("a", 0..3), group("b", 3..4), group("c", 4..7)]);
    assert_eq!(with_one.omnibus[0].outcome, two.omnibus[0].outcome);
    assert!(two.omnibus[0].outcome.is_ok() && two.omnibus[0].left_out.is_empty());
    assert_eq!(with_one.omnibus[0].left_out, [[("site".to_owned(), "b".to_owned())].into()]);
    let said = with_one.warnings(0.05).join(" ");
    assert!(said.contains("the test of all groups at once leaves out groups of one person: joy: b"), "{said}");
    let alone = compared(&[group("a", 0..3), group("b", 3..4)]);
    assert!(alone.omnibus[0].outcome.is_err() && alone.omnibus[0].left_out.is_empty());
}

#[test]
fn large_groups_are_tested_on_a_draw_that_the_seed_decides() {
    let models: Vec<SequenceModel> = (0..60).map(|i| model(&format!("s{i:02}"), "1", f64::from(i % 7))).collect();
    let (a, b): (Vec<_>, Vec<_>) = models.iter().partition(|m| m.id.subject.as_str() < "s40");
    let options = CompareOptions { people: 10, permutations: 199, ..CompareOptions::default() };
    let tested = compare(&a, &b, &[NodeId(0)], &options, None, 0).unwrap();
    assert_eq!(tested.people_used, [10, 10]);
    assert_eq!(compare(&a, &b, &[NodeId(0)], &options, None, 0).unwrap(), tested);
    assert_ne!(compare(&a, &b, &[NodeId(0)], &CompareOptions { seed: 2, ..options }, None, 0).unwrap(), tested);
}

#[test]
fn people_are_exchanged_within_strata_only() {
    // Two sites 50 apart; most of group A is at the first. With free exchange the groups differ, within sites they do not.
    let models: Vec<SequenceModel> =
        (0..24).map(|i| model(&format!("s{i:02}"), "1", f64::from(i % 5) + if i < 12 { 0.0 } else { 50.0 })).collect();
    let in_a = |m: &&SequenceModel| m.id.subject.as_str() < "s10" || m.id.subject.as_str() >= "s22";
    let (a, b): (Vec<_>, Vec<_>) = models.iter().partition(in_a);
    let site = |m: &SequenceModel| vec![if m.id.subject.as_str() < "s12" { "x" } else { "y" }.to_owned()];
    let strata = Strata::new(&["site".to_owned()], models.iter().map(|m| (m.id.subject.as_str(), site(m))));
    let options = CompareOptions { permutations: 999, ..CompareOptions::default() };
    let free = compare(&a, &b, &[NodeId(0)], &options, None, 0).unwrap();
    let within = compare(&a, &b, &[NodeId(0)], &options, Some(&strata), 0).unwrap();
    assert!(free.p <= 0.01 && within.p > 0.1, "{} {}", free.p, within.p);
    // If few exchanges within the sites are possible, all are tried: 3 and 3 people with 1 and 2 in A give nine.
    let few: Vec<&SequenceModel> =
        models.iter().filter(|m| matches!(&m.id.subject[1..], "08" | "09" | "10" | "12" | "22" | "23")).collect();
    let (a, b): (Vec<&SequenceModel>, Vec<&SequenceModel>) = few.into_iter().partition(in_a);
    let all = compare(&a, &b, &[NodeId(0)], &options, Some(&strata), 0).unwrap();
    assert!(all.exhaustive && all.permutations == 9 && (all.p * 9.0).fract().abs() < 1e-9, "{all:?}");
    assert_eq!(all.least_p, 1.0 / 9.0);
    let group = |m: &SequenceModel| vec![m.id.sequence.clone() + if in_a(&m) { "a" } else { "b" }];
    let same = Strata::new(&["group".to_owned()], models.iter().map(|m| (m.id.subject.as_str(), group(m))));
    let why = compare(&a, &b, &[NodeId(0)], &options, Some(&same), 0).unwrap_err();
    assert!(why.to_string().contains("groups and strata coincide"));
}
