//! Fits the wireframe to a neutral face from a few marked points [KP, section 2].
//!
//! 1. A least-squares similarity places the frontal wireframe on the marks: KP's scaling pre-step.
//! 2. A [`ShapePrior`] may first adapt the neutral shape to the marks. KP have no prior ([`PriorKind::None`]).
//! 3. The springs deform the wireframe: every marked node is pulled to its mark, the others follow.
//!
//! The resulting wireframe is in image space: this module flips the y axis.

mod clicks;
mod error;
mod exchanges;
mod mistakes;
mod options;
pub mod placement;
mod prior;
mod skyline;
mod spring;
mod unfold;

use nalgebra::{Point2, Vector2};

use self::{
    clicks::soft_deviation,
    mistakes::PlausibleFaces,
    prior::Explanation,
    unfold::{Frontal, Unfolded, unfold},
};
use crate::{correspondence::marked_twice, geometry::Similarity, model::FrameExpressionModel, units::Px, wireframe::Wireframe};

pub use super::correspondence::{
    Correspondence, CorrespondenceError, MINIMUM_MARKS, MarkKind, MarksError, read_correspondences, validate_correspondences,
    write_correspondences,
};
pub use error::{FitError, FitWarning};
pub use options::{FitOptions, LoadedPrior, PriorKind};
pub(crate) use prior::mirror_nodes;
pub use prior::{
    DEFAULT_MODES, FacePoints, FaceSource, LearnError, NeutralFace, PriorFile, PriorFileError, PriorOrigin, ShapePrior,
    check_faces_once, learn_prior, read_neutral_faces, read_prior, write_prior,
};
pub(crate) use skyline::{BlockPlaces, Layout, Skyline};
pub use spring::{DrivenNode, Pull, SpringError, Springs};

/// Default gain of the force on a marked node, in units of the springs' stiffness k (KP specify neither).
pub const FIT_FORCE: f64 = 20.0;

/// Expected error of a hand-set mark, over the eye distance: half of such marks are nearer to the true point. Orders of magnitude as in
/// `candide/markable_nodes.csv`.
pub const HAND_MARK_ERROR: f64 = 0.019;

/// Ratio of the median distance to the standard deviation in x and in y, for normal and independent x and y: sqrt(2 ln 2).
pub(crate) const MEDIAN_OVER_DEVIATION: f64 = 1.177_410_022_515_474_7;

/// Bounds of the force on a mark, as shares of [`FitOptions::force`]; within them it is proportional to the inverse square of the expected
/// error.
const FORCE_SHARES: (f64, f64) = (0.02, 5.0);

/// A wireframe fitted to the neutral frame.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let folder = std::path::Path::new("fixtures/simulated/S001/005");
/// # let marks = folder.join("correspondences.csv");
/// # let marks = grimace::correspondence::read_correspondences(&marks, &tables, wireframe.node_count())?;
/// use grimace::fit::Fitter;
///
/// // `marks` are eleven points of a neutral frame.
/// let fitted = Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
/// assert_eq!((fitted.model.node_count(), fitted.residuals.len()), (113, marks.len()));
/// assert!(fitted.warnings.is_empty() && fitted.residuals.iter().all(|px| *px < 2.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FittedWireframe {
    /// All node positions, px, y down.
    pub model: FrameExpressionModel<Px>,
    /// Placement of the frontal wireframe (y flipped) in the image, before any deformation.
    pub image_from_face: Similarity,
    /// The correspondences that were given.
    pub correspondences: Vec<Correspondence>,
    /// Points that were read in the picture and used in addition.
    pub read: Vec<Correspondence>,
    /// Distance of every correspondence's node to its mark after the fit, px, in the order of `correspondences`.
    pub residuals: Vec<f64>,
    /// Uncertainty of every node's position given the marks, over the eye distance, before calibration
    /// ([`FittedWireframe::expected_errors`]); `None` when no prior fits the wireframe.
    pub spreads: Option<Vec<f64>>,
    /// Warnings for the user.
    pub warnings: Vec<FitWarning>,
}

/// Fits wireframes of one topology; holds everything that is the same for all faces.
///
/// ```
/// use grimace::{correspondence::read_correspondences, fit::{FitOptions, Fitter}, units::NodeId, wireframe::Face};
///
/// let Face { wireframe, tables } = Face::candide3();
/// let marks = read_correspondences("fixtures/simulated/S001/005/correspondences.csv".as_ref(), &tables, 113)?;
/// let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks)?;
/// // A marked node, the outer corner of the left eye, goes to its mark.
/// let corner = fitted.model.node(NodeId(20)).expect("node 20");
/// assert!((corner - marks[0].position).norm() < 1.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Fitter {
    springs: Springs,
    /// Competing priors; empty for none.
    priors: Vec<ShapePrior>,
    /// Prior log odds of the priors.
    log_odds: Vec<f64>,
    /// Priors and log odds by which a fit is judged; `None` when they are those of the fit.
    judges: Option<(Vec<ShapePrior>, Vec<f64>)>,
    /// Detects wrong marks, whatever the priors.
    plausible: PlausibleFaces,
    options: FitOptions,
}

/// Prior log odds that marks follow a network's definition of landmarks.
///
/// The network's prior is narrower and explains some people's hand-set marks better than the prior of such marks: by up to 4.4 in 6 of 90
/// people. Landmarks favour it by 3.4 and more (11 marks; 7 marks 1.1 and more).
const NETWORK_LOG_ODDS: f64 = -1.0;

/// Distance between the pupils of Candide-3, model units.
const EYE_DISTANCE: f64 = 0.613;

impl Fitter {
    /// Creates a fitter for a wireframe.
    pub fn new(wireframe: &Wireframe, options: FitOptions) -> Self {
        let candide = || (ShapePrior::candide(wireframe), 0.0);
        let faces = ShapePrior::faces();
        let with_odds = faces.iter().cloned().zip([NETWORK_LOG_ODDS, 0.0]);
        let every = || faces.iter().cloned().zip([NETWORK_LOG_ODDS, 0.0]).filter(|(p, _)| p.mean.len() == wireframe.node_count());
        let competing: Vec<(ShapePrior, f64)> = match &options.prior {
            PriorKind::None => vec![],
            PriorKind::Candide => vec![candide()],
            PriorKind::Faces => with_odds.collect(),
            PriorKind::Auto => every().chain([candide()]).collect(),
            PriorKind::File(LoadedPrior { prior, .. }) => prior.iter().map(|p| (ShapePrior::clone(p), 0.0)).collect(),
        };
        let (priors, log_odds): (Vec<_>, Vec<_>) = competing.into_iter().unzip();
        let judges = (options.prior != PriorKind::Auto).then(|| every().chain([candide()]).unzip());
        let known: Vec<ShapePrior> = match &options.prior {
            PriorKind::File(_) => priors.iter().cloned().chain(faces).collect(),
            _ => faces.to_vec(),
        };
        let plausible = PlausibleFaces::new(wireframe, &known, EYE_DISTANCE);
        Self { springs: Springs::new(wireframe), priors, log_odds, judges, plausible, options }
    }

    /// Creates a fitter like that of [`PriorKind::Auto`] with other priors than the shipped ones: one of network landmarks and one of
    /// points set by hand.
    ///
    /// # Errors
    /// [`FitError::PriorNodes`] if a prior and the wireframe differ in the number of nodes; [`FitError::Prior`] for a prior with
    /// numbers that are not finite or deviations that are not positive.
    pub fn with_faces(wireframe: &Wireframe, network: ShapePrior, by_hand: ShapePrior) -> Result<Self, FitError> {
        let (count, faces) = (wireframe.node_count(), [network, by_hand]);
        if let Some(found) = faces.iter().map(|p| p.mean.len()).find(|found| *found != count) {
            return Err(FitError::PriorNodes { found, count });
        }
        for prior in &faces {
            prior.check().map_err(|reason| FitError::Prior { reason })?;
        }
        let plausible = PlausibleFaces::new(wireframe, &faces, EYE_DISTANCE);
        let priors = faces.into_iter().chain([ShapePrior::candide(wireframe)]).collect();
        let log_odds = vec![NETWORK_LOG_ODDS, 0.0, 0.0];
        Ok(Self { springs: Springs::new(wireframe), priors, log_odds, judges: None, plausible, options: FitOptions::default() })
    }

    /// Fits the wireframe to the marks.
    ///
    /// # Errors
    /// [`FitError`] for fewer than three marks, marks that coincide, marks at nodes that do not exist or are marked twice,
    /// positions and expected errors that no mark has, or a mirrored or upside-down placement.
    pub fn fit(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Result<FittedWireframe, FitError> {
        let seen = self.seen(wireframe, marks)?;
        if let PriorKind::File(LoadedPrior { blake3, prior: None }) = &self.options.prior {
            return Err(FitError::PriorNotRead { blake3: blake3.clone() });
        }
        let count = wireframe.node_count();
        if let Some(prior) = self.priors.iter().find(|p| p.mean.len() != count) {
            return Err(FitError::PriorNodes { found: prior.mean.len(), count });
        }
        let expected = seen.expected(marks, &self.priors, &self.log_odds)?;
        let rest = match &expected {
            Some(expected) => expected.places.clone(),
            None => wireframe.frontal().iter().map(|p| flip(seen.image_from_face.apply(p))).collect(),
        };
        let fitted = self.deform(wireframe, marks, &seen, &rest)?;
        let judged = match &self.judges {
            Some((priors, odds)) => seen.expected(marks, priors, odds)?,
            None => expected,
        };
        Ok(fitted.judged(judged.as_ref().map(|j| (j, true)), seen.eye_distance))
    }

    /// Fits the wireframe to the marks, starting from given rest positions of all nodes, px, y down: those of a face known to be turned.
    ///
    /// # Errors
    /// As [`Fitter::fit`]; [`FitError::PriorNodes`] if there is not one position per node.
    pub fn fit_at_rest(
        &self,
        wireframe: &Wireframe,
        marks: &[Correspondence],
        rest: &[Point2<f64>],
    ) -> Result<FittedWireframe, FitError> {
        let count = wireframe.node_count();
        if rest.len() != count {
            return Err(FitError::PriorNodes { found: rest.len(), count });
        }
        let seen = self.seen(wireframe, marks)?;
        let fitted = self.deform(wireframe, marks, &seen, rest)?;
        let (priors, odds) = self.judges.as_ref().map_or((&self.priors, &self.log_odds), |(priors, odds)| (priors, odds));
        let judged = if priors.iter().all(|p| p.mean.len() == count) { seen.expected(marks, priors, odds)? } else { None };
        Ok(fitted.judged(judged.as_ref().map(|j| (j, false)), seen.eye_distance))
    }

    /// Returns the probability, 0 to 1, that marks follow the definition of points set by hand on photographs, rather than that of a
    /// network's landmarks or a face of Candide's shape units alone. `None` when the embedded priors do not compete, or the marks cannot be
    /// fitted.
    pub(crate) fn share_by_hand(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Option<f64> {
        /// Index among the competing priors; see [`ShapePrior::faces`].
        const BY_HAND: usize = 1;
        let compete = matches!(self.options.prior, PriorKind::Auto | PriorKind::Faces) && self.priors.len() > BY_HAND;
        let seen = compete.then(|| self.seen(wireframe, marks).ok())??;
        if self.priors.iter().any(|p| p.mean.len() != wireframe.node_count()) {
            return None;
        }
        prior::shares(&seen.explained(marks, &self.priors).ok()?, &self.log_odds).get(BY_HAND).copied()
    }

    /// Checks the marks and converts them to y up.
    fn seen(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Result<Seen, FitError> {
        if marks.len() < MINIMUM_MARKS {
            return Err(FitError::TooFewMarks { found: marks.len() });
        }
        let count = wireframe.node_count();
        if let Some(mark) = marks.iter().find(|m| m.node.index() >= count) {
            return Err(FitError::NoSuchNode { node: mark.node, count });
        }
        check_marks(marks)?;
        let places: Vec<_> = marks.iter().map(|m| flip(m.position)).collect();
        let frontal = wireframe.frontal();
        let source: Vec<_> = marks.iter().map(|m| frontal[m.node.index()]).collect();
        let image_from_face = Similarity::fit(&source, &places, None)?;
        let strays = self.plausible.check(marks, &places)?;
        Ok(Seen { places, image_from_face, strays, eye_distance: image_from_face.scale * EYE_DISTANCE })
    }

    /// Lets the springs pull the marked nodes from their rest positions.
    fn deform(
        &self,
        wireframe: &Wireframe,
        marks: &[Correspondence],
        seen: &Seen,
        rest: &[Point2<f64>],
    ) -> Result<FittedWireframe, FitError> {
        let (frontal, eye_distance, image_from_face) = (wireframe.frontal(), seen.eye_distance, seen.image_from_face);
        let targets: Vec<_> = marks.iter().map(|m| self.target(m, eye_distance)).collect();
        let nodes = self.springs.deform(wireframe, rest, &targets)?;
        let upright = frontal.iter().map(|p| flip(image_from_face.apply(p))).collect();
        let view = Frontal::new(wireframe, &frontal, upright);
        // A mark with an expected error may be off by a multiple of it.
        let may_be_off = |m: &Correspondence| m.expected_error.map_or(0.0, |e| WITHIN_ERRORS * e / eye_distance);
        let strays = seen.strays.iter().filter(|s| s.distance > may_be_off(&marks[s.index]));
        let warned = strays.map(|s| doubtful(&marks[s.index], s.distance)).collect();
        let (nodes, warnings) = match unfold(&self.springs, wireframe, rest, &targets, &nodes, &view, eye_distance)? {
            Some(unfolded) => choose(marks, nodes, unfolded, eye_distance, warned)?,
            None => (nodes, warned),
        };
        let residuals = marks.iter().map(|m| (nodes[m.node.index()] - m.position).norm()).collect();
        Ok(FittedWireframe {
            model: FrameExpressionModel::new(nodes),
            image_from_face,
            correspondences: marks.to_vec(),
            read: Vec::new(),
            residuals,
            spreads: None,
            warnings,
        })
    }

    /// Returns the target of a marked node for the springs, for an eye distance in px.
    fn target(&self, mark: &Correspondence, eye_distance: f64) -> DrivenNode {
        let share = mark.expected_error.map_or(1.0, |error| {
            let ratio = HAND_MARK_ERROR * eye_distance / error;
            if ratio.is_finite() { (ratio * ratio).clamp(FORCE_SHARES.0, FORCE_SHARES.1) } else { 1.0 }
        });
        let pull = match mark.kind {
            MarkKind::Mark => Pull::Force(self.options.force * share),
            MarkKind::Hard => Pull::Hard,
        };
        DrivenNode { node: mark.node, position: mark.position, pull }
    }
}

/// Returns the standard deviation of a mark in x and in y, px, for an eye distance in px. It comes from the mark's expected error, or else
/// from the accuracy of a person's click on such a feature. `None` for a sharp mark.
pub(crate) fn mark_deviation(mark: &Correspondence, eye_distance: f64) -> Option<f64> {
    match (mark.expected_error, mark.kind) {
        (Some(error), _) => Some(error / MEDIAN_OVER_DEVIATION),
        (None, MarkKind::Mark) => soft_deviation(mark.node).map(|deviation| deviation * eye_distance),
        (None, MarkKind::Hard) => None,
    }
}

/// Checks that every node is marked once, at a finite position, and that expected errors are positive.
fn check_marks(marks: &[Correspondence]) -> Result<(), FitError> {
    if let Some(node) = marked_twice(marks) {
        return Err(FitError::DuplicateNode { node });
    }
    for Correspondence { node, position, expected_error, .. } in marks {
        for (what, value) in [("x", position.x), ("y", position.y)] {
            if !value.is_finite() {
                return Err(FitError::Mark { node: *node, what, value, allowed: "a finite number of pixels" });
            }
        }
        if let Some(value) = expected_error.filter(|error| !(error.is_finite() && *error > 0.0)) {
            return Err(FitError::Mark {
                node: *node,
                what: "expected error",
                value,
                allowed: "a finite number of pixels above 0",
            });
        }
    }
    Ok(())
}

/// Checked marks, y up.
struct Seen {
    /// Positions, px, y up.
    places: Vec<Point2<f64>>,
    /// Placement of the frontal wireframe on the marks.
    image_from_face: Similarity,
    /// Doubtful marks.
    strays: Vec<mistakes::Stray>,
    /// Eye distance, px.
    eye_distance: f64,
}

impl Seen {
    /// Returns the most probable face of every prior.
    fn explained(&self, marks: &[Correspondence], priors: &[ShapePrior]) -> Result<Vec<Explanation>, FitError> {
        let nodes: Vec<_> = marks.iter().map(|m| m.node).collect();
        let deviations: Vec<_> = marks.iter().map(|mark| mark_deviation(mark, self.eye_distance)).collect();
        let explained = priors.iter().map(|p| p.explain_by_errors(&nodes, &self.places, &deviations));
        Ok(explained.collect::<Result<_, _>>()?)
    }

    /// Returns the face that the priors predict for the marks; `None` without a prior.
    ///
    /// A mark's error is its expected error, or else that of a person's click on such a feature.
    fn expected(&self, marks: &[Correspondence], priors: &[ShapePrior], log_odds: &[f64]) -> Result<Option<Expected>, FitError> {
        let Some(first) = priors.first() else { return Ok(None) };
        let faces = self.explained(marks, priors)?;
        let shares = prior::shares(&faces, log_odds);
        let place = |k: usize| {
            let each = faces.iter().map(|f| f.marks_from_face.apply(&f.shape[k]));
            let mean = each.clone().zip(&shares).map(|(p, share)| p.coords * *share).sum::<Vector2<f64>>();
            let apart = |p: Point2<f64>, f: &Explanation| 2.0 * f.deviations[k].powi(2) + (p.coords - mean).norm_squared();
            let variance: f64 = each.zip(&faces).zip(&shares).map(|((p, f), share)| share * apart(p, f)).sum();
            (flip(Point2::from(mean)), variance)
        };
        let (places, variances) = (0..first.mean.len()).map(place).unzip();
        Ok(Some(Expected { places, variances }))
    }
}

/// Predicted node positions of a face.
struct Expected {
    /// Positions, px, y down.
    places: Vec<Point2<f64>>,
    /// Mean squared distance from them, px^2.
    variances: Vec<f64>,
}

impl FittedWireframe {
    /// Returns the expected error of every node's position on the face, px: half of such nodes are closer, half further away.
    ///
    /// It is the error of the fit alone, without later motion. `None` when no prior fits the wireframe.
    ///
    /// ```
    /// use grimace::{correspondence::read_correspondences, fit::Fitter, wireframe::Face};
    ///
    /// let Face { wireframe, tables } = Face::candide3();
    /// let marks = read_correspondences("fixtures/simulated/S001/005/correspondences.csv".as_ref(), &tables, 113)?;
    /// let fitted = Fitter::new(&wireframe, Default::default()).fit(&wireframe, &marks)?;
    /// let errors = fitted.expected_errors().expect("Candide-3 has priors");
    /// // A marked eye corner is known better than the side of the forehead.
    /// assert!(errors[20] < errors[12]);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn expected_errors(&self) -> Option<Vec<f64>> {
        let eye_distance = self.image_from_face.scale * EYE_DISTANCE;
        let used = || self.correspondences.iter().chain(&self.read);
        let found_share = used().filter(|m| m.expected_error.is_some()).count() as f64 / used().count().max(1) as f64;
        Some(self.spreads.as_ref()?.iter().map(|&spread| placement::calibrated(spread, found_share) * eye_distance).collect())
    }

    /// Moves the last `read` correspondences to [`FittedWireframe::read`].
    pub(crate) fn set_apart(mut self, read: usize) -> Self {
        let given = self.correspondences.len().saturating_sub(read);
        self.read = self.correspondences.split_off(given);
        self.residuals.truncate(given);
        self
    }

    /// Interpolates between this fit (share 0) and another fit of the same marks (share 1).
    pub(crate) fn towards(self, other: Self, share: f64) -> Self {
        let between = |a: f64, b: f64| a + share * (b - a);
        let nodes = self.model.nodes().iter().zip(other.model.nodes());
        let nodes: Vec<Point2<f64>> = nodes.map(|(p, q)| Point2::new(between(p.x, q.x), between(p.y, q.y))).collect();
        let spreads = self.spreads.zip(other.spreads);
        Self {
            residuals: self.correspondences.iter().map(|m| (nodes[m.node.index()] - m.position).norm()).collect(),
            model: FrameExpressionModel::new(nodes),
            image_from_face: self.image_from_face,
            correspondences: self.correspondences,
            read: other.read,
            spreads: spreads.map(|(a, b)| a.iter().zip(&b).map(|(a, b)| between(*a, *b)).collect()),
            warnings: self.warnings,
        }
    }

    /// Sets the spreads: distance of the nodes from their predicted positions combined with the error of the prediction; for a turned face
    /// the latter only.
    fn judged(mut self, expected: Option<(&Expected, bool)>, eye_distance: f64) -> Self {
        self.spreads = expected.map(|(expected, frontal)| {
            let nodes = self.model.nodes().iter().zip(&expected.places).zip(&expected.variances);
            let square = |((node, place), variance): ((&Point2<f64>, &Point2<f64>), &f64)| {
                variance + if frontal { (node - place).norm_squared() } else { 0.0 }
            };
            nodes.map(|n| square(n).sqrt() / eye_distance).collect()
        });
        self
    }
}

/// Tolerated error of a mark, in expected errors: of normal errors, one in 2000 is larger.
const WITHIN_ERRORS: f64 = 4.0;
/// Distance over the eye distance beyond which a mark is never given up to turn a triangle back.
const GIVEN_UP: f64 = 0.3;
/// Distance over the eye distance between a mark and its node from which the user is warned.
const LEFT_BEHIND: f64 = 0.1;
/// Number of marks from which wrong ones are detected by the others ([`mistakes`]). With fewer marks, a fit that would give one up is
/// refused.
const TELLING: usize = 6;

fn doubtful(mark: &Correspondence, distance: f64) -> FitWarning {
    FitWarning::Doubtful { node: mark.node, x: mark.position.x, y: mark.position.y, percent: 100.0 * distance }
}

/// Chooses the nodes with their triangles turned back, or those of the springs if that would give up a mark; also returns warnings.
fn choose(
    marks: &[Correspondence],
    plain: Vec<Point2<f64>>,
    unfolded: Unfolded,
    eye_distance: f64,
    mut warnings: Vec<FitWarning>,
) -> Result<(Vec<Point2<f64>>, Vec<FitWarning>), FitError> {
    let Unfolded { nodes, turned } = unfolded;
    let distance = |m: &Correspondence| (nodes[m.node.index()] - m.position).norm() / eye_distance;
    // A mark with a large expected error may stay away from its node.
    let set = || marks.iter().filter(|m| m.expected_error.is_none_or(|e| e < LEFT_BEHIND * eye_distance));
    let worst = set().max_by(|a, b| distance(a).total_cmp(&distance(b))).filter(|m| distance(m) > GIVEN_UP);
    if let Some(&Correspondence { node, position, .. }) = worst {
        if marks.len() >= TELLING {
            warnings.push(FitWarning::Turned);
            return Ok((plain, warnings));
        }
        let (expected, percent) = (nodes[node.index()], 100.0 * (nodes[node.index()] - position).norm() / eye_distance);
        let (expected_x, expected_y, others) = (expected.x, expected.y, Vec::new());
        return Err(FitError::Outlier { node, x: position.x, y: position.y, expected_x, expected_y, percent, others });
    }
    let known = |node| warnings.iter().any(|w| matches!(w, FitWarning::Doubtful { node: n, .. } if *n == node));
    let behind: Vec<_> =
        set().filter(|m| distance(m) > LEFT_BEHIND && !known(m.node)).map(|m| doubtful(m, distance(m))).collect();
    warnings.extend(behind);
    warnings.extend((turned > 0).then_some(FitWarning::Turned));
    Ok((nodes, warnings))
}

/// Converts image space (y down) to the y-up plane in which shapes are compared, and back.
fn flip(point: Point2<f64>) -> Point2<f64> {
    Point2::new(point.x, -point.y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{correspondence::read_correspondences, wireframe::Face};

    #[test]
    fn marks_that_are_none_and_nodes_marked_twice_are_refused() {
        let Face { wireframe, tables } = Face::candide3();
        let marks = read_correspondences("fixtures/simulated/S001/005/correspondences.csv".as_ref(), &tables, 113).unwrap();
        let fitter = Fitter::new(&wireframe, FitOptions::default());
        let why = |change: &dyn Fn(&mut Vec<Correspondence>)| {
            let mut marks = marks.clone();
            change(&mut marks);
            let rest = vec![Point2::origin(); 113];
            let error = fitter.fit(&wireframe, &marks).unwrap_err().to_string();
            assert_eq!(fitter.fit_at_rest(&wireframe, &marks, &rest).unwrap_err().to_string(), error);
            error
        };
        let (node, at) = (marks[0].node, marks[0].position);
        let twice = format!("node {node} is marked twice; keep one of the two marks");
        assert_eq!(why(&|m| m.push(Correspondence::hard(node, Point2::new(at.x + 50.0, at.y)))), twice);
        for bad in [f64::NAN, f64::INFINITY, 0.0, -2.0] {
            let said =
                format!("the expected error of the mark at node {node} is {bad}; it must be a finite number of pixels above 0");
            assert_eq!(why(&|m| m[0].expected_error = Some(bad)), said);
        }
        let said = format!("the y of the mark at node {node} is NaN; it must be a finite number of pixels");
        assert_eq!(why(&|m| m[0].position.y = f64::NAN), said);
    }

    #[test]
    fn priors_that_are_none_are_refused() {
        let wireframe = Wireframe::candide3();
        let [network, by_hand] = ShapePrior::faces();
        let why = |change: fn(&mut ShapePrior)| {
            let mut odd = by_hand.clone();
            change(&mut odd);
            Fitter::with_faces(&wireframe, network.clone(), odd).unwrap_err().to_string()
        };
        assert!(Fitter::with_faces(&wireframe, network.clone(), by_hand.clone()).is_ok());
        assert_eq!(
            why(|p| p.mean[7].x = f64::NAN),
            "the shape prior is not valid: node 7 of its mean is not at a finite position"
        );
        assert!(why(|p| p.modes[0][3].y = f64::INFINITY).ends_with("an offset of a mode is not finite"));
        assert!(why(|p| p.modes[0].truncate(3)).ends_with("it has 3 offsets in a mode, but 113 are needed"));
        assert!(why(|p| p.deviations[0] = 0.0).ends_with("a deviation is 0; it must be a finite number above 0"));
        assert!(why(|p| p.mark_deviation = f64::NAN).ends_with("a deviation is NaN; it must be a finite number above 0"));
        assert!(why(|p| p.residuals.clear()).ends_with("it has 0 residuals, but 113 are needed"));
    }
}
