use nalgebra::{Point2, Vector2};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::*;
use crate::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    units::SequenceId,
};

const NODES: u16 = 6;

/// People with one sequence per label, whose nodes move in the label's direction plus noise.
fn people(count: usize, noise: f64, seed: u64) -> Vec<(SequenceModel, &'static str)> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut gauss = || -> f64 { StandardNormal.sample(&mut random) };
    let mut all = Vec::new();
    for person in 0..count {
        for (label, direction) in [("fear", Vector2::new(1.0, 0.0)), ("anger", Vector2::new(0.0, 1.0))] {
            let still = vec![Point2::origin(); usize::from(NODES)];
            let moved = (0..NODES).map(|_| Point2::origin() + direction + Vector2::new(gauss(), gauss()) * noise).collect();
            let model = DynamicExpressionModel::new(vec![FrameExpressionModel::new(still), FrameExpressionModel::new(moved)]);
            let id = SequenceId { subject: format!("p{person:02}"), sequence: label.to_owned() };
            all.push((SequenceModel { id, model: model.unwrap() }, label));
        }
    }
    all
}

fn recognizer(people: &[(SequenceModel, &'static str)]) -> Result<Recognizer, RecognizeError> {
    let live: Vec<NodeId> = (0..NODES).map(NodeId).collect();
    Recognizer::new(&people.iter().map(|(m, label)| (m, *label)).collect::<Vec<_>>(), &live, || {})
}

#[test]
fn strangers_are_recognized_and_probabilities_hold() {
    let recognizer = recognizer(&people(60, 1.6, 1)).unwrap();
    assert_eq!(recognizer.labels, ["anger", "fear"]);
    let strangers = people(200, 1.6, 2);
    let found: Vec<Recognized> = strangers.iter().map(|(m, _)| recognizer.recognize(m).unwrap()).collect();
    let right = found.iter().zip(&strangers).filter(|(f, (_, label))| f.label == *label).count() as f64 / 400.0;
    let claimed = found.iter().map(|f| f.probability).sum::<f64>() / 400.0;
    // Means differ by sqrt(12) / 1.6 = 2.2 standard deviations: at most 86 % can be correct. 0.06 is three standard errors.
    assert!(right > 0.78 && (claimed - right).abs() < 0.06, "{right} {claimed}");
    assert!(found.iter().all(|f| (f.probabilities.iter().sum::<f64>() - 1.0).abs() < 1e-12));
}

#[test]
fn one_outlier_makes_no_guess_of_all_others() {
    let mut all = people(12, 0.2, 8);
    // Person 0 has both labels exchanged.
    all[0].1 = "anger";
    all[1].1 = "fear";
    let recognizer = recognizer(&all).unwrap();
    let others = &recognizer.left_out[2..];
    assert!(others.iter().zip(&all[2..]).all(|(r, (_, label))| r.label == *label && r.probability > 0.85), "{others:?}");
    assert!(others.iter().all(|r| r.probability < 0.999));
}

#[test]
fn an_unknown_expression_is_none_of_the_labels() {
    let recognizer = recognizer(&people(60, 0.5, 3)).unwrap();
    let mut odd = people(1, 0.0, 4).remove(0).0;
    let still = odd.model.neutral().clone();
    let moved = (0..NODES).map(|k| Point2::new(if k % 2 == 0 { 8.0 } else { -8.0 }, -8.0)).collect();
    odd.model = DynamicExpressionModel::new(vec![still, FrameExpressionModel::new(moved)]).unwrap();
    assert!(recognizer.recognize(&odd).unwrap().is_none(0.02));
    let usual = people(20, 0.5, 5);
    let none = usual.iter().filter(|(m, _)| recognizer.recognize(m).unwrap().is_none(0.02)).count();
    assert!(none <= 4, "{none}");
}

#[test]
fn a_face_that_does_not_move_is_none_of_the_labels() {
    for (count, level) in [(5, 0.02), (60, 0.02)] {
        let recognizer = recognizer(&people(count, 0.3, 3)).unwrap();
        // Motion of the size of a tracker's noise, and none.
        for noise in [0.01, 0.0] {
            let mut still = people(1, noise, 4).remove(0).0;
            let frames = still.model.frames().iter().map(|frame| {
                FrameExpressionModel::new(frame.nodes().iter().map(|node| Point2::from(node.coords * noise)).collect())
            });
            still.model = DynamicExpressionModel::new(frames.collect()).unwrap();
            let found = recognizer.recognize(&still).unwrap();
            assert!(found.is_none(level), "{count} people, {noise}: {found:?}");
        }
    }
    // Almost all known sequences with the smallest motion are typical.
    let recognizer = recognizer(&people(60, 0.5, 3)).unwrap();
    assert!(recognizer.left_out.iter().filter(|found| found.is_none(0.02)).count() <= 5);
}

#[test]
fn an_unknown_expression_is_none_of_the_labels_of_few_sequences() {
    // 2 labels of 4 people: the smallest possible share is 1/9.
    let recognizer = recognizer(&people(4, 0.5, 3)).unwrap();
    assert!(recognizer.is_beyond_counting(0.02) && recognizer.is_beyond_counting(1.0 / 9.0));
    assert!(!recognizer.is_beyond_counting(0.12) && !recognizer.is_beyond_counting(0.0));
    let mut odd = people(1, 0.0, 4).remove(0).0;
    let still = odd.model.neutral().clone();
    let moved = (0..NODES).map(|k| Point2::new(if k % 2 == 0 { 20.0 } else { -20.0 }, -20.0)).collect();
    odd.model = DynamicExpressionModel::new(vec![still, FrameExpressionModel::new(moved)]).unwrap();
    let found = recognizer.recognize(&odd).unwrap();
    assert!(found.is_none(0.02) && !found.is_none(0.0), "{found:?}");
    let usual = people(50, 0.5, 5);
    let none = usual.iter().filter(|(m, _)| recognizer.recognize(m).unwrap().is_none(0.02)).count();
    assert!(none <= 5, "{none} of 100");
}

#[test]
fn beyond_all_that_are_known_their_scatter_tells() {
    // Logarithms 0, 1 and 2: mean 1, standard deviation 1. For t with 2 degrees of freedom P(T > t) = (1 - t / sqrt(2 + t^2)) / 2.
    let usual = Usual { distances: [0.0, 1.0, 2.0].map(f64::exp).to_vec(), amounts: vec![2.0, 3.0, 4.0], people: 3 };
    let chance = |distance: f64| usual.chance_above(&usual.distances, distance);
    let t = 4.0 / (4.0f64 / 3.0).sqrt();
    let expected = f64::midpoint(1.0, -t / (2.0 + t * t).sqrt());
    assert!((chance(5.0f64.exp()).unwrap() - expected).abs() < 1e-9);
    assert_eq!(usual.typicality(5.0f64.exp(), 3.0), chance(5.0f64.exp()).unwrap());
    assert_eq!(usual.typicality(1.5, 3.0), 0.75, "two of three are as far away, and the sequence itself counts as one more");
    // Moving a tenth of a value is as rare as a ten times larger reciprocal.
    let turned: Vec<f64> = usual.amounts.iter().map(|amount| 1.0 / amount).collect();
    assert_eq!(usual.typicality(1.5, 0.1), 4.0 * usual.chance_above(&turned, 10.0).unwrap());
    assert_eq!(usual.typicality(1.5, 1.9), 0.75, "one of four has the smallest motion");
    assert_eq!(Usual { people: 1, ..usual.clone() }.chance_above(&usual.distances, 5.0), None);
    assert_eq!(usual.chance_above(&[0.0, 0.0, 1.0], 5.0), None);
}

#[test]
fn labels_of_one_person_are_left_out_where_two_others_remain() {
    let mut all = people(4, 1.0, 1);
    let (mut odd, _) = all[0].clone();
    odd.id.sequence = "odd".to_owned();
    all.push((odd, "awe"));
    let (kept, alone) = shown_by_several(all.clone(), |(model, label)| (&model.id.subject, label));
    assert_eq!((kept.len(), alone), (8, vec!["awe".to_owned()]));
    assert!(recognizer(&kept).is_ok() && recognizer(&all).is_err());
    let few: Vec<_> = all.into_iter().filter(|(_, label)| *label != "fear").collect();
    assert_eq!(shown_by_several(few, |(model, label)| (&model.id.subject, label)).1, [""; 0], "one label would remain");
}

#[test]
fn too_few_labels_or_people_say_so() {
    let two = recognizer(&people(2, 1.0, 1)).unwrap_err();
    assert!(two.to_string().starts_with("found 2 people; recognition needs at least three people"), "{two}");
    let one: Vec<_> = people(4, 1.0, 1).into_iter().filter(|(_, label)| *label == "fear").collect();
    assert!(recognizer(&one).unwrap_err().to_string().starts_with("found 1 label; recognition"));
    let alone: Vec<_> = people(4, 1.0, 1).into_iter().enumerate().filter(|(k, (_, label))| *label == "fear" || *k < 2).collect();
    let alone: Vec<_> = alone.into_iter().map(|(_, model)| model).collect();
    assert!(recognizer(&alone).unwrap_err().to_string().starts_with("only one person shows `anger`"));
}

#[test]
fn no_label_is_left_out_with_all_who_show_it() {
    // 60 people in 50 folds: persons 0 and 50 share one, and only they show label 1.
    let subjects: Vec<usize> = (0..60).chain([0, 50]).collect();
    let labels: Vec<usize> = vec![0; 60].into_iter().chain([1, 1]).collect();
    let fold_of = folds_of_people(&subjects, &labels, 2, 50);
    assert_ne!(fold_of[0], fold_of[50]);
    assert!((0..60).filter(|&k| k != 50).all(|k| fold_of[k] == k % 50), "no other person changes the fold");
    assert!(fold_of.iter().all(|&f| f < 50));
}

#[test]
fn models_of_other_shapes_and_impossible_ones_are_an_error() {
    let people = people(4, 0.5, 3);
    let live: Vec<NodeId> = (0..NODES).map(NodeId).collect();
    let with = |odd: &SequenceModel, live: &[NodeId]| {
        let mut labelled: Vec<_> = people.iter().map(|(m, label)| (m, *label)).collect();
        labelled[0].0 = odd;
        Recognizer::new(&labelled, live, || ()).map(|_| ()).unwrap_err()
    };
    let model = |nodes: usize, frames: usize, x: f64| {
        let frame = |m: usize| FrameExpressionModel::new(vec![Point2::new(x * m as f64, 0.0); nodes]);
        SequenceModel { model: DynamicExpressionModel::new((0..frames).map(frame).collect()).unwrap(), ..people[0].0.clone() }
    };
    let known = recognizer(&people).unwrap();
    // The six nodes move twice.
    let odd = model(6, 3, 1.0);
    assert_eq!(known.recognize(&odd).unwrap_err(), RecognizeError::Shape { id: odd.id.to_string(), found: 12, expected: 6 });
    assert!(matches!(with(&odd, &live), RecognizeError::Shape { .. }));
    for odd in [model(5, 2, 1.0), model(6, 2, 1e300)] {
        assert!(matches!(known.recognize(&odd).unwrap_err(), RecognizeError::Models(_)));
        assert!(matches!(with(&odd, &live), RecognizeError::Models(_)));
    }
    assert_eq!(with(&people[0].0, &[]), RecognizeError::Models(NotComparable::NoNodes));
}
