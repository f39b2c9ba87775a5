use nalgebra::{DMatrix, Point2};

use super::{
    super::{HeadPose, observe::own_offsets},
    *,
};
use crate::{
    track::{NodeState, TrackedFrame, TrackedNode},
    wireframe::Face,
};

/// A head that differs from the mean one, seen at rest and, with an expression, turned by 12 degrees.
struct Scene {
    model: HeadModel,
    identity: Directions,
    expression: Directions,
    own: Vec<Own>,
    seen: Vec<Vec<Seen>>,
    truth: Unknowns,
}

fn pose(yaw: f64, pitch: f64) -> HeadPose {
    HeadPose {
        rotation: HeadPose::rotation_of(yaw, pitch, 2.0),
        scale: 100.0,
        position: Point2::new(320.0, 240.0),
        distance: CAMERA_DISTANCE * HEAD_ES,
    }
}

impl Scene {
    fn new() -> Self {
        let Face { wireframe, tables } = Face::candide3();
        let model = HeadModel::shipped(&wireframe, &tables);
        let count = model.node_count();
        let (identity, expression) = (Directions::new(&model.identity, count), Directions::new(&model.expression, count));
        let nodes = (0..count).map(|_| TrackedNode::new(Point2::origin(), NodeState::Tracked, None)).collect();
        let own = own_offsets(&model, &TrackedFrame { number: 1, nodes }, 100.0);
        let mut coefficients = DVector::zeros(identity.count());
        (coefficients[0], coefficients[3]) = (0.8, -0.5);
        let mut smile = DVector::zeros(expression.count());
        (smile[0], smile[1]) = (0.7, 0.3);
        let truth = Unknowns {
            head: Head { coefficients, own: vec![Vector3::zeros(); count] },
            views: vec![
                Solved { pose: pose(1.0, -3.0), coefficients: DVector::zeros(0) },
                Solved { pose: pose(12.0, 2.0), coefficients: smile },
            ],
        };
        let mut scene = Self { model, identity, expression, own, seen: Vec::new(), truth };
        let problem = scene.problem();
        let shape = problem.shape(&scene.truth.head);
        let of = |view: &Solved| {
            (0..count)
                .map(|node| Seen { node, at: view.pose.image_of(&problem.place(&shape, view, node)), deviation: 0.006 })
                .collect()
        };
        scene.seen = scene.truth.views.iter().map(of).collect();
        scene
    }

    fn problem(&self) -> Problem<'_> {
        Problem { model: &self.model, identity: &self.identity, expression: &self.expression, own: &self.own }
    }

    /// A start off the truth.
    fn start(&self) -> Unknowns {
        let mut start = self.truth.clone();
        start.head.coefficients.fill(0.0);
        start.views[0].pose.rotation = pose(0.0, 1.0).rotation;
        start.views[1].pose.rotation = pose(9.0, 6.0).rotation;
        start.views[1].coefficients.fill(0.0);
        start
    }
}

#[test]
fn a_step_solves_the_whole_system() {
    let scene = Scene::new();
    let (problem, at) = (scene.problem(), scene.start());
    let mut assembly = Assembly::new(&problem, 2);
    let descent = problem.descent(&at, &scene.seen, Some(&mut assembly));
    let step = assembly.normal(&problem).unwrap().step(&descent);

    // The same normal equations with the own offsets as further unknowns, behind the others.
    let (others, count) = (problem.column(2), scene.model.node_count());
    let size = others + 3 * count;
    let mut normal = DMatrix::<f64>::zeros(size, size);
    let shape = problem.shape(&at.head);
    for (v, seen) in scene.seen.iter().enumerate() {
        for s in seen {
            let (slopes, by_log_distance) = problem.slopes(&shape, &at.views[v], s);
            let mut rows = DMatrix::<f64>::zeros(2, size);
            let by =
                |directions: &Directions| slopes.by_point * nalgebra::Matrix3xX::from_row_slice(&directions.of(s.node).concat());
            rows.columns_mut(0, problem.identity.count()).copy_from(&by(problem.identity));
            rows.set_column(problem.identity.count(), &by_log_distance);
            rows.columns_mut(problem.column(v), POSE).copy_from(&slopes.by_pose);
            if v > 0 {
                rows.columns_mut(problem.column(v) + POSE, problem.expression.count()).copy_from(&by(problem.expression));
            }
            rows.columns_mut(others + 3 * s.node, 3).copy_from(&slopes.by_point);
            normal += rows.transpose() * rows * slopes.weight;
        }
    }
    let is_pose = |k: usize| (0..2).any(|v| (problem.column(v)..problem.column(v) + POSE).contains(&k));
    (0..others).filter(|&k| !is_pose(k)).for_each(|k| normal[(k, k)] += 1.0);
    for (k, own) in scene.own.iter().enumerate() {
        let mut block = normal.fixed_view_mut::<3, 3>(others + 3 * k, others + 3 * k);
        block += own.precision;
    }
    let right = descent.others.iter().copied().chain(descent.own.iter().flat_map(|pull| <[f64; 3]>::from(*pull)));
    let expected = normal.cholesky().unwrap().solve(&DVector::from_iterator(size, right));
    let found = step.others.iter().copied().chain(step.own.iter().flat_map(|own| <[f64; 3]>::from(*own)));
    let found = DVector::from_iterator(size, found);
    assert!((&found - &expected).amax() < 1e-6 * expected.amax(), "{}", (found - expected).amax());
}

#[test]
fn the_search_ends_at_the_lowest_sum() {
    let scene = Scene::new();
    let (problem, mut found) = (scene.problem(), scene.start());
    let before = problem.sum(&found, &found, &scene.seen);
    descend(&problem, &mut found, |_| scene.seen.clone()).unwrap();
    let sum = |at: &Unknowns| problem.sum(at, &found, &scene.seen);
    assert!(sum(&found) < 0.01 * before && sum(&found) < sum(&scene.truth));
    // Nothing is gained by a further turn of one frame or of everything.
    for v in 0..2 {
        for turn in [Vector3::x(), Vector3::y(), Vector3::z(), -Vector3::x(), -Vector3::y(), -Vector3::z()] {
            let mut aside = found.clone();
            aside.views[v].pose = aside.views[v].pose.moved(turn * 1e-3, 0.0, Vector2::zeros());
            assert!(sum(&aside) > sum(&found), "{v} {turn:?}");
        }
    }
    let [yaw, pitch, _] = found.views[1].pose.degrees();
    assert!((yaw - 12.0).abs() < 1.0 && (pitch - 2.0).abs() < 3.0, "{yaw} {pitch}");
}

#[test]
fn a_view_that_shows_nothing_keeps_its_pose() {
    let scene = Scene::new();
    let mut found = scene.start();
    let before = found.views[1].pose;
    descend(&scene.problem(), &mut found, |_| vec![scene.seen[0].clone(), Vec::new()]).unwrap();
    let after = found.views[1].pose;
    assert!(after.rotation.angle_to(&before.rotation) < 1e-12);
    assert_eq!((after.scale, after.position), (before.scale, before.position));
}
