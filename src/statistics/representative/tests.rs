use nalgebra::Point3;
use proptest::prelude::*;

use super::*;
use crate::statistics::{distance::tests::vectors, median::SearchEnding};

/// Nodes of [`small_wireframe`]: three live ones and a follower of node 2.
const NODES: usize = 4;
const LIVE: usize = 3;

/// A triangle 0 1 2, and node 3 above node 2, in no triangle.
fn small_wireframe() -> Wireframe {
    let vertices = [(0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, 3.0, 0.0), (0.0, 3.0, 1.0)].map(|(x, y, z)| Point3::new(x, y, z));
    Wireframe::new(vertices.to_vec(), vec![[NodeId(0), NodeId(1), NodeId(2)]], vec![], vec![]).unwrap()
}

fn id(number: usize) -> SequenceId {
    SequenceId { subject: format!("S{number:03}"), sequence: "001".to_owned() }
}

fn label() -> ClassLabel {
    ClassLabel { emotion: "fear".to_owned(), group: BTreeMap::new() }
}

fn options(alpha: f64, median: MedianKind) -> StatisticsOptions {
    StatisticsOptions { alpha, median, ..StatisticsOptions::default() }
}

/// A model of the small wireframe from its displacement vectors in slot order.
fn model(number: usize, vectors: &[Vector2<f64>]) -> SequenceModel {
    let wireframe = small_wireframe();
    let center = DisplacementFields::from_vectors(LIVE, vectors);
    SequenceModel { id: id(number), model: model_from_displacements(wireframe.frontal(), &center, &wireframe).unwrap() }
}

/// A model of one displacement field in which only node 1 moves, by (x, 0).
fn moved(number: usize, x: f64) -> SequenceModel {
    model(number, &[Vector2::zeros(), Vector2::new(x, 0.0), Vector2::zeros()])
}

fn compute(models: &[SequenceModel], alpha: f64, median: MedianKind) -> Representative {
    representative(label(), models, &small_wireframe(), &options(alpha, median)).unwrap()
}

/// A representative as text, to compare all its bits.
fn fingerprint(r: &Representative) -> String {
    format!("{r:?}")
}

#[test]
fn five_models_by_hand() {
    // Node 1 moves by 0, 3, 6, 9 and 300; the other two live nodes rest, so d_f is a third of the difference.
    // d_tf of the first: (3 + 6 + 9 + 300) / 3 / 4 = 26.5; of the last (300 + 297 + 294 + 291) / 12 = 98.5. floor(0.2 * 5) = 1 is
    // dropped: the last. The rest has medians from 3 to 6.
    let models: Vec<_> = [0.0, 3.0, 6.0, 9.0, 300.0].iter().enumerate().map(|(i, &x)| moved(i, x)).collect();
    for kind in [MedianKind::Greedy, MedianKind::Exact] {
        let r = compute(&models, 0.2, kind);
        assert_eq!(r.sequences, (0..5).map(id).collect::<Vec<_>>());
        let rows: Vec<_> = r.trimming.iter().map(|row| (row.field, row.distance, row.dropped)).collect();
        let third = |n: f64| n / 12.0;
        let expected = [third(318.0), third(309.0), third(306.0), third(309.0), third(1182.0)];
        for (row, expected) in rows.iter().zip(expected) {
            approx::assert_relative_eq!(row.1, expected, max_relative = 1e-14);
        }
        assert_eq!(rows.iter().map(|r| r.2).collect::<Vec<_>>(), [false, false, false, false, true]);
        // Sum of the kept models: anywhere from 3 to 6 it is (3 + 9) / 3 = 4 face units.
        approx::assert_relative_eq!(r.sums.exact, 4.0, max_relative = 1e-14);
        approx::assert_relative_eq!(r.sums.greedy, 4.0, max_relative = 1e-14);
        assert!(r.sums.lower_bound <= r.sums.exact && r.sums.certificate_gap < 1e-13, "{:?}", r.sums);
        // Around any median in [3, 6] the distances are t, |t - 3|, |6 - t|, 9 - t over 3, whose middle two are t - 3 or 6 - t and
        // so on: the greedy one at 3 has 0 1 1 2 -> 1, the exact one at 4.5 has 0.5 0.5 1.5 1.5 -> 1.
        approx::assert_relative_eq!(r.dispersion.unwrap(), 1.0, max_relative = 1e-14);
        // All five have the median 6: distances 2 1 0 1 98 -> 1.
        approx::assert_relative_eq!(r.dispersion_untrimmed.unwrap(), 1.0, max_relative = 1e-14);
        assert_eq!(r.distances[4], None);
        approx::assert_relative_eq!(r.distances_untrimmed[4], 98.0, max_relative = 1e-14);
        // Only node 1 has dispersion, three times the mean over nodes.
        approx::assert_relative_eq!(r.node_dispersion[1], 3.0, max_relative = 1e-14);
        assert_eq!([r.node_dispersion[0], r.node_dispersion[2], r.node_dispersion[3]], [0.0; 3]);
    }
}

#[test]
fn the_model_is_neutral_plus_displacements_and_followers_follow() {
    let up = [(0.0, 0.0), (0.0, 0.0), (1.0, 2.0), (0.0, 0.0), (1.0, 1.0), (0.5, 0.5)].map(|(x, y)| Vector2::new(x, y));
    let r = compute(&[model(0, &up)], 0.1, MedianKind::Greedy);
    let p = Point2::new;
    assert_eq!(r.model.neutral().nodes(), [p(0.0, 0.0), p(4.0, 0.0), p(0.0, 3.0), p(0.0, 3.0)]);
    assert_eq!(r.model.frames()[1].nodes(), [p(0.0, 0.0), p(4.0, 0.0), p(1.0, 5.0), p(1.0, 5.0)]);
    assert_eq!(r.model.apex().nodes(), [p(0.0, 0.0), p(5.0, 1.0), p(1.5, 5.5), p(1.5, 5.5)]);
    assert_eq!((r.dispersion, r.dispersion_untrimmed), (None, None));
    assert_eq!((r.distances, r.distances_untrimmed, r.node_dispersion), (vec![Some(0.0)], vec![0.0], vec![0.0; NODES]));
    assert_eq!((r.sums.greedy, r.sums.greedy_gap, r.sums.certificate_gap), (0.0, 0.0, 0.0));
    assert!(r.trimming.iter().all(|row| row.distance == 0.0 && !row.dropped));
}

#[test]
fn of_two_tied_models_the_larger_id_is_dropped() {
    // Two models are equally far from each other: floor(0.49 * 3) = 1 of three, 0 and 2 tie around 1.
    let r = compute(&[moved(2, 0.0), moved(1, 1.0), moved(0, 2.0)], 0.49, MedianKind::Greedy);
    assert_eq!(r.trimming.iter().map(|row| row.dropped).collect::<Vec<_>>(), [false, false, true]);
}

#[test]
fn a_still_face_has_a_still_representative() {
    let still: Vec<_> = (0..5).map(|i| model(i, &[Vector2::zeros(); 2 * LIVE])).collect();
    let r = compute(&still, 0.2, MedianKind::Exact);
    assert_eq!(r.model.neutral(), r.model.apex());
    assert_eq!((r.dispersion, r.dispersion_untrimmed), (Some(0.0), Some(0.0)));
    assert_eq!((r.sums.exact, r.sums.lower_bound, r.sums.greedy_gap), (0.0, 0.0, 0.0));
}

#[test]
fn bad_input_is_named() {
    let wireframe = small_wireframe();
    let error = |models: &[SequenceModel], alpha: f64| {
        representative(label(), models, &wireframe, &options(alpha, MedianKind::Greedy)).unwrap_err().to_string()
    };
    let good = || vec![moved(0, 1.0), moved(1, 2.0), moved(2, 3.0)];
    assert_eq!(error(&[], 0.1), "there is no model of `fear` to compute a median from");
    for alpha in [-0.1, 0.5, 1.0, f64::NAN] {
        assert!(error(&good(), alpha).starts_with(&format!("alpha is {alpha}; it must be")), "{alpha}");
    }
    assert!(error(&[moved(7, 1.0), moved(7, 2.0)], 0.1).starts_with("there are two models of sequence S007_001"));
    let mut longer = good();
    longer[0] = model(0, &[Vector2::zeros(); 2 * LIVE]);
    assert!(error(&longer, 0.1).starts_with("S000_001: it has 3 frames, but the others have 2"));
    let mut fewer = good();
    let frame = FrameExpressionModel::new(vec![Point2::origin(); 3]);
    fewer[1].model = DynamicExpressionModel::new(vec![frame; 2]).unwrap();
    assert!(error(&fewer, 0.1).starts_with("S001_001: it has 3 nodes, but the others have 4"));
    let mut elsewhere = good();
    let shifted = elsewhere[0].model.frames().iter().map(|f| f.nodes().iter().map(|p| p + Vector2::new(0.0, 0.5)).collect());
    elsewhere[0].model = DynamicExpressionModel::new(shifted.map(FrameExpressionModel::new).collect()).unwrap();
    assert!(error(&elsewhere, 0.1).starts_with("S000_001: node 2 of the neutral frame is 0.5 face units from"));
    let mut far = good();
    far[2] = moved(2, -1e300);
    assert!(error(&far, 0.1).contains("S002_001: node 1 moves by -1000"), "{}", error(&far, 0.1));
}

#[test]
fn the_candide_wireframe_works_with_borrowed_models() {
    let wireframe = Wireframe::candide3();
    let frames = [0.0, 5.0]
        .map(|d| FrameExpressionModel::new(wireframe.frontal().iter().map(|p| p * 1000.0 + Vector2::new(d, 0.0)).collect()));
    let model = SequenceModel { id: id(0), model: DynamicExpressionModel::new(frames.to_vec()).unwrap() };
    let r = representative(label(), &[&model], &wireframe, &StatisticsOptions::default()).unwrap();
    for offset in r.model.neutral_offsets(1) {
        approx::assert_relative_eq!(offset, Vector2::new(5.0, 0.0), epsilon = 1e-12);
    }
}

/// Displacement vectors of 12 models of two fields.
fn twelve() -> impl Strategy<Value = Vec<SequenceModel>> {
    vectors(12 * 2 * LIVE).prop_map(|v| v.chunks(2 * LIVE).enumerate().map(|(i, v)| model(i, v)).collect())
}

fn kind() -> impl Strategy<Value = MedianKind> {
    prop_oneof![Just(MedianKind::Greedy), Just(MedianKind::Exact)]
}

proptest! {
    #[test]
    fn the_order_of_the_models_changes_nothing(models in twelve(), kind in kind(), shuffled in Just((0..12).collect::<Vec<usize>>()).prop_shuffle()) {
        let other: Vec<_> = shuffled.iter().map(|&i| models[i].clone()).collect();
        prop_assert_eq!(fingerprint(&compute(&models, 0.2, kind)), fingerprint(&compute(&other, 0.2, kind)));
    }

    #[test]
    fn medians_are_ordered_and_certified(models in twelve(), alpha in 0.0..0.5f64) {
        let r = compute(&models, alpha, MedianKind::Exact);
        prop_assert!(r.sums.lower_bound <= r.sums.exact && r.sums.exact <= r.sums.greedy);
        prop_assert!(r.sums.certificate_gap <= 1e-11 && (0.0..=1e-3).contains(&r.sums.greedy_gap), "{:?} {:?} {}", r.sums, r.search, r.trimming.iter().filter(|t| !t.dropped).map(|t| format!("{} {}, ", t.field, t.id)).collect::<String>());
        prop_assert_eq!((r.search.greedy_ending, r.search.exact_ending), (SearchEnding::Converged, SearchEnding::Converged));
    }

    #[test]
    fn no_member_beats_the_generalized_median(models in twelve(), kind in kind()) {
        let r = compute(&models, 0.0, kind);
        let live = small_wireframe().live_nodes().to_vec();
        let fields: Vec<_> = models.iter().map(|m| DisplacementFields::of_model(&m.model, &live)).collect();
        let sum = |center: &DisplacementFields| fields.iter().map(|f| f.distance(center)).sum::<f64>();
        let of_median = sum(&DisplacementFields::of_model(&r.model, &live));
        // 1e-9: positions are rounded when vectors are summed to frames.
        prop_assert!(fields.iter().all(|f| of_median <= sum(f) + 1e-9));
        approx::assert_relative_eq!(of_median, match kind { MedianKind::Greedy => r.sums.greedy, MedianKind::Exact => r.sums.exact }, max_relative = 1e-9);
    }

    #[test]
    fn equal_models_have_dispersion_zero(v in vectors(2 * LIVE), kind in kind()) {
        let models: Vec<_> = (0..6).map(|i| model(i, &v)).collect();
        let r = compute(&models, 0.2, kind);
        prop_assert_eq!((r.dispersion, r.dispersion_untrimmed), (Some(0.0), Some(0.0)));
        prop_assert_eq!(r.sums.exact, 0.0);
    }

    #[test]
    fn alpha_zero_drops_nothing(models in twelve(), kind in kind()) {
        let r = compute(&models, 0.0, kind);
        prop_assert!(r.trimming.iter().all(|row| !row.dropped));
        prop_assert_eq!(r.dispersion, r.dispersion_untrimmed);
    }
}

#[test]
fn the_number_of_threads_changes_nothing() {
    use rand::{RngExt, SeedableRng};
    let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(7);
    // More than three blocks of pairwise distances.
    let models: Vec<_> = (0..100)
        .map(|i| {
            model(i, &std::array::from_fn::<_, { 4 * LIVE }, _>(|_| Vector2::new(random.random::<f64>(), random.random::<f64>())))
        })
        .collect();
    let with_threads = |count: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
        pool.install(|| fingerprint(&compute(&models, 0.1, MedianKind::Greedy)))
    };
    assert_eq!(with_threads(1), with_threads(2));
}
