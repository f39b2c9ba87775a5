//! Fits the neutral face of a turned head: carries marks to the front, fits there, and carries the result back.
//!
//! The priors of a fit are frontal. On a head turned by 20 degrees the positions between the marks differ: the far cheek is narrow, the
//! nose is displaced. Marks determine the turn (an outer eye corner is deeper than an inner one, on both sides alike); with the turn and
//! the head's depth, every position can be carried to the front and back.

use nalgebra::{DVector, Point2, Vector3};

use super::{
    HEAD_ES, HeadModel, HeadPose,
    observe::{frontal, pose_of},
    solve::{Directions, Limit, Matrix, Seen, Solved, shape_with, solve},
};
use crate::{
    fit::{Correspondence, FitError, FittedWireframe, Fitter, mark_deviation},
    geometry::Similarity,
    wireframe::Wireframe,
};

/// Fewest marks that determine a turn.
const FEWEST_MARKS: usize = 7;
/// Standard deviation of a sharp mark, over the eye distance.
const SHARP: f64 = 0.012;
/// Standard deviation of the person's own offset of a marked node, model units; [`TURNED`] was determined with it.
const OWN_MARKED: f64 = 0.007;
/// Yaw, degrees, up to which a head counts as frontal, and from which a turn has full weight. For 90 people who look into the camera,
/// eleven hand-set marks give a yaw of 2.1 degrees (root mean square), at most 6.2. Pitch is not used, because marks do not distinguish it
/// from a long chin or low brows: for the same people they give 11 degrees, with a standard deviation of 8.
const TURNED: [f64; 2] = [7.0, 10.0];

/// Fits a face that may be turned to one side. Equal to [`Fitter::fit`] for a frontal face or fewer than seven marks.
///
/// # Errors
/// As [`Fitter::fit`].
pub fn fit_turned(
    model: &HeadModel,
    fitter: &Fitter,
    wireframe: &Wireframe,
    marks: &[Correspondence],
) -> Result<FittedWireframe, FitError> {
    let plain = fitter.fit(wireframe, marks)?;
    if marks.len() < FEWEST_MARKS || wireframe.node_count() != model.node_count() {
        return Ok(plain);
    }
    let Some(view) = Turned::of(model, marks) else { return Ok(plain) };
    let to_front = |m: &Correspondence| Correspondence { position: view.to_front(m.node.index(), m.position), ..*m };
    let frontal_marks: Vec<Correspondence> = marks.iter().map(to_front).collect();
    // Marks that no frontal face has keep the plain fit.
    let Ok(from_front) = fitter.fit(wireframe, &frontal_marks) else { return Ok(plain) };
    let nodes = from_front.model.nodes().iter().enumerate();
    let rest: Vec<Point2<f64>> = nodes.map(|(k, at)| view.turn_back(k, *at)).collect();
    Ok(fitter.fit_at_rest(wireframe, marks, &rest).unwrap_or(plain))
}

/// A head as seen and as it would be seen from the front.
struct Turned {
    shape: Vec<Vector3<f64>>,
    seen: HeadPose,
    front: HeadPose,
}

/// Returns how clearly marks show a head turned to one side: 0 (possibly frontal, or too few marks) to 1.
pub fn turned_share(model: &HeadModel, marks: &[Correspondence]) -> f64 {
    let determined = marks.len() >= FEWEST_MARKS && marks.iter().all(|m| m.node.index() < model.node_count());
    let solved = if determined { solved(model, marks) } else { None };
    solved.map_or(0.0, |solved| share_of(solved.pose.degrees()[0]))
}

/// Returns the weight of a turn with a given yaw, 0 to 1.
fn share_of(yaw: f64) -> f64 {
    ((yaw.abs() - TURNED[0]) / (TURNED[1] - TURNED[0])).clamp(0.0, 1.0)
}

/// Returns pose and identity from the marks.
fn solved(model: &HeadModel, marks: &[Correspondence]) -> Option<Solved> {
    let face: Vec<Point2<f64>> = marks.iter().map(|m| frontal(model, m.node.index())).collect();
    let at: Vec<Point2<f64>> = marks.iter().map(|m| m.position).collect();
    let start = pose_of(&Similarity::fit(&face, &at, None).ok()?);
    let eye_distance = start.scale * HEAD_ES;
    let seen = |m: &Correspondence| Seen {
        node: m.node.index(),
        at: m.position,
        deviation: OWN_MARKED.hypot(mark_deviation(m, eye_distance).unwrap_or(SHARP * eye_distance) / start.scale),
    };
    let seen: Vec<Seen> = marks.iter().map(seen).collect();
    let identity = Directions::new(&model.identity, model.node_count());
    let start = Solved { pose: start, coefficients: DVector::zeros(model.identity.len()) };
    let limit = Limit { steps: 60, at_rest: 1e-4 };
    solve(&model.mean, &identity, &seen, start, limit, &mut Matrix::default())
}

impl Turned {
    /// Returns the turned head of the marks; `None` when it may be frontal.
    fn of(model: &HeadModel, marks: &[Correspondence]) -> Option<Self> {
        let solved = solved(model, marks)?;
        let [yaw, pitch, roll] = solved.pose.degrees();
        let share = share_of(yaw);
        let shape = shape_with(&model.mean, &model.identity, &solved.coefficients);
        let rotation = HeadPose::rotation_of(yaw * (1.0 - share), pitch, roll);
        (share > 0.0).then_some(Self { shape, seen: solved.pose, front: HeadPose { rotation, ..solved.pose } })
    }

    fn to_front(&self, node: usize, at: Point2<f64>) -> Point2<f64> {
        self.front.project(&self.seen.back(&at, self.seen.turned(&self.shape[node]).z))
    }

    fn turn_back(&self, node: usize, at: Point2<f64>) -> Point2<f64> {
        self.seen.project(&self.front.back(&at, self.front.turned(&self.shape[node]).z))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::{super::frontal::visibility, *};
    use crate::{dataset::DEFAULT_LANDMARK_NODES, fit::FitOptions, pose::CAMERA_DISTANCE, wireframe::Face};

    /// Positions of all nodes of a head, 100 px per unit, and the default marks on it.
    fn seen(model: &HeadModel, shape: &[Vector3<f64>], yaw: f64, pitch: f64) -> (Vec<Point2<f64>>, HeadPose) {
        let pose = HeadPose {
            rotation: HeadPose::rotation_of(yaw, pitch, 3.0),
            scale: 100.0,
            position: Point2::new(320.0, 240.0),
            distance: CAMERA_DISTANCE * HEAD_ES,
        };
        assert_eq!(shape.len(), model.node_count());
        (shape.iter().map(|x| pose.project(&Point3::from(*x))).collect(), pose)
    }

    fn marks(nodes: &[Point2<f64>]) -> Vec<Correspondence> {
        DEFAULT_LANDMARK_NODES.iter().map(|&node| Correspondence::mark(node, nodes[node.index()])).collect()
    }

    fn setup() -> (Wireframe, HeadModel, Fitter) {
        let Face { wireframe, tables } = Face::candide3();
        let model = HeadModel::shipped(&wireframe, &tables);
        let fitter = Fitter::new(&wireframe, FitOptions::default());
        (wireframe, model, fitter)
    }

    #[test]
    fn a_frontal_face_is_fitted_as_ever() {
        let (wireframe, model, fitter) = setup();
        let (nodes, _) = seen(&model, &model.mean, 2.0, -2.0);
        let marks = marks(&nodes);
        let fitted = fit_turned(&model, &fitter, &wireframe, &marks).unwrap();
        assert_eq!(fitted, fitter.fit(&wireframe, &marks).unwrap());
    }

    #[test]
    fn on_a_turned_head_the_nodes_between_the_marks_are_nearer() {
        let (wireframe, model, fitter) = setup();
        // A person different from the mean: half a standard deviation along two modes.
        let shape: Vec<_> =
            (0..model.node_count()).map(|k| model.mean[k] + (model.identity[0][k] - model.identity[1][k]) * 0.5).collect();
        for (yaw, pitch, share) in [(20.0, 0.0, 0.75), (-20.0, 5.0, 0.8), (15.0, -5.0, 0.85)] {
            let (nodes, pose) = seen(&model, &shape, yaw, pitch);
            let marks = marks(&nodes);
            let visible = visibility(&model, &shape, &pose);
            let live: Vec<usize> = wireframe.live_nodes().iter().map(|n| n.index()).filter(|&k| visible[k] > 0.5).collect();
            let error = |fitted: &FittedWireframe| {
                live.iter().map(|&k| (fitted.model.nodes()[k] - nodes[k]).norm()).sum::<f64>() / live.len() as f64
            };
            let turned = error(&fit_turned(&model, &fitter, &wireframe, &marks).unwrap());
            let plain = error(&fitter.fit(&wireframe, &marks).unwrap());
            assert!(turned < share * plain, "{yaw} {pitch}: {turned} px, {plain} px");
        }
    }

    #[test]
    fn marks_that_cannot_be_fitted_are_refused_as_ever() {
        let (wireframe, model, fitter) = setup();
        let (nodes, _) = seen(&model, &model.mean, 20.0, 0.0);
        let mut marks = marks(&nodes);
        marks.truncate(2);
        let refused = fit_turned(&model, &fitter, &wireframe, &marks).unwrap_err();
        assert!(matches!(refused, FitError::TooFewMarks { found: 2 }));
    }
}
