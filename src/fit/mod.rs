//! Fitting the wireframe to a neutral face from a few marked points [KP, section 2].
//!
//! 1. A least-squares similarity places the frontal wireframe on the marks: KP's scaling pre-step.
//! 2. A [`ShapePrior`] may adapt the neutral shape to the marks first (beyond KP; [`PriorKind::None`] is the paper).
//! 3. The springs deform the wireframe: every marked node is pulled to its mark, the others follow.
//!
//! The wireframe of the result is in image space: here the y axis is flipped.

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
use crate::{geometry::Similarity, model::FrameExpressionModel, units::Px, wireframe::Wireframe};

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

/// Default gain of the force on a marked node, in units of the springs' stiffness k [KP leave both open].
pub const FIT_FORCE: f64 = 20.0;

/// Expected error of a mark that a person set, over the eye distance: half of such marks are nearer to the true point. Orders of
/// magnitude as in `candide/markable_nodes.csv`.
pub const HAND_MARK_ERROR: f64 = 0.019;

/// Median distance over the standard deviation in x and in y, where both are normal and independent: sqrt(2 ln 2).
pub(crate) const MEDIAN_OVER_DEVIATION: f64 = 1.177_410_022_515_474_7;

/// The force on a mark follows the inverse square of its expected error, within these shares of [`FitOptions::force`].
const FORCE_SHARES: (f64, f64) = (0.02, 5.0);

/// A wireframe fitted to the neutral frame.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
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
    /// Points that were read in the picture and used beside them.
    pub read: Vec<Correspondence>,
    /// Distance of every correspondence's node to its mark after the fit, px, in the order of `correspondences`.
    pub residuals: Vec<f64>,
    /// How far the marks leave every node's place on the face open, over the eye distance, before it is calibrated
    /// ([`FittedWireframe::expected_errors`]); `None` where no prior knows the wireframe.
    pub spreads: Option<Vec<f64>>,
    /// What should be looked at.
    pub warnings: Vec<FitWarning>,
}

/// Fits wireframes of one topology; holds what does not change from face to face.
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
    /// The priors that compete; empty for none.
    priors: Vec<ShapePrior>,
    /// Their logarithmic odds before the marks are seen.
    log_odds: Vec<f64>,
    /// Priors and odds by which a fit is judged; `None` where they are those it is made with.
    judges: Option<(Vec<ShapePrior>, Vec<f64>)>,
    /// What tells wrong marks, whatever the priors.
    plausible: PlausibleFaces,
    options: FitOptions,
}

/// Logarithmic odds, before the marks are seen, that marks mean what a network's landmarks mean.
///
/// Its prior is the narrower one and explains some people's hand-set marks better than the prior of such marks does: by up to 4.4 in 6 of
/// 90 people, while landmarks speak for it by 3.4 and more (11 marks; 7 marks 1.1 and more).
const NETWORK_LOG_ODDS: f64 = -1.0;

/// Distance of the pupils of Candide-3, model units.
const EYE_DISTANCE: f64 = 0.613;

impl Fitter {
    /// A fitter for a wireframe.
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

    /// A fitter as [`PriorKind::Auto`] makes it, with other priors than those that ship: of landmarks as networks set them, and of points
    /// set by hand.
    ///
    /// # Errors
    /// [`FitError::PriorNodes`] for a prior of another number of nodes than the wireframe's.
    pub fn with_faces(wireframe: &Wireframe, network: ShapePrior, by_hand: ShapePrior) -> Result<Self, FitError> {
        let (count, faces) = (wireframe.node_count(), [network, by_hand]);
        if let Some(found) = faces.iter().map(|p| p.mean.len()).find(|found| *found != count) {
            return Err(FitError::PriorNodes { found, count });
        }
        let plausible = PlausibleFaces::new(wireframe, &faces, EYE_DISTANCE);
        let priors = faces.into_iter().chain([ShapePrior::candide(wireframe)]).collect();
        let log_odds = vec![NETWORK_LOG_ODDS, 0.0, 0.0];
        Ok(Self { springs: Springs::new(wireframe), priors, log_odds, judges: None, plausible, options: FitOptions::default() })
    }

    /// Fits the wireframe to the marks.
    ///
    /// # Errors
    /// [`FitError`] for fewer than three marks, marks that coincide, marks at nodes that are not there, or a mirrored or
    /// upside-down placement.
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

    /// Fits the wireframe to the marks from places of all nodes at which it is at rest, px, y down: those of a face that is known to be
    /// turned.
    ///
    /// # Errors
    /// As [`Fitter::fit`]; [`FitError::PriorNodes`] when there is not a place for every node.
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

    /// How probable it is, 0 to 1, that marks mean what people mean who set points on photographs, and not what a network's landmarks mean, or a face
    /// that only Candide's shape units make; `None` where the embedded priors of faces do not compete, and for marks that cannot be fitted.
    pub(crate) fn share_by_hand(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Option<f64> {
        /// Among the priors that compete: see [`ShapePrior::faces`].
        const BY_HAND: usize = 1;
        let compete = matches!(self.options.prior, PriorKind::Auto | PriorKind::Faces) && self.priors.len() > BY_HAND;
        let seen = compete.then(|| self.seen(wireframe, marks).ok())??;
        if self.priors.iter().any(|p| p.mean.len() != wireframe.node_count()) {
            return None;
        }
        prior::shares(&seen.explained(marks, &self.priors).ok()?, &self.log_odds).get(BY_HAND).copied()
    }

    /// The marks as they are seen, once they are known to be good.
    fn seen(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Result<Seen, FitError> {
        if marks.len() < MINIMUM_MARKS {
            return Err(FitError::TooFewMarks { found: marks.len() });
        }
        let count = wireframe.node_count();
        if let Some(mark) = marks.iter().find(|m| m.node.index() >= count) {
            return Err(FitError::NoSuchNode { node: mark.node, count });
        }
        let places: Vec<_> = marks.iter().map(|m| flip(m.position)).collect();
        let frontal = wireframe.frontal();
        let source: Vec<_> = marks.iter().map(|m| frontal[m.node.index()]).collect();
        let image_from_face = Similarity::fit(&source, &places, None)?;
        let strays = self.plausible.check(marks, &places)?;
        Ok(Seen { places, image_from_face, strays, eye_distance: image_from_face.scale * EYE_DISTANCE })
    }

    /// The springs pull the marked nodes from where they are at rest.
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
        // A mark that tells its error may be off by some of it.
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

    /// What a mark does to the springs, on a face with an eye distance of so many px.
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

/// Standard deviation of a mark in x and in y, px, on a face with an eye distance of so many px: from the error that it tells,
/// else that of a person's click on such a feature. `None` for a mark as good as any.
pub(crate) fn mark_deviation(mark: &Correspondence, eye_distance: f64) -> Option<f64> {
    match (mark.expected_error, mark.kind) {
        (Some(error), _) => Some(error / MEDIAN_OVER_DEVIATION),
        (None, MarkKind::Mark) => soft_deviation(mark.node).map(|deviation| deviation * eye_distance),
        (None, MarkKind::Hard) => None,
    }
}

/// Marks as they are seen.
struct Seen {
    /// Their places, px, y up.
    places: Vec<Point2<f64>>,
    /// Places the frontal wireframe on them.
    image_from_face: Similarity,
    /// Marks that no face has there.
    strays: Vec<mistakes::Stray>,
    /// Eye distance, px.
    eye_distance: f64,
}

impl Seen {
    /// The most probable face of every prior.
    fn explained(&self, marks: &[Correspondence], priors: &[ShapePrior]) -> Result<Vec<Explanation>, FitError> {
        let nodes: Vec<_> = marks.iter().map(|m| m.node).collect();
        let deviations: Vec<_> = marks.iter().map(|mark| mark_deviation(mark, self.eye_distance)).collect();
        let explained = priors.iter().map(|p| p.explain_by_errors(&nodes, &self.places, &deviations));
        Ok(explained.collect::<Result<_, _>>()?)
    }

    /// The face that priors expect for the marks; `None` without a prior.
    ///
    /// A mark's error is the one that it tells, else that of a person's click on such a feature.
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

/// Where the nodes of a face are expected.
struct Expected {
    /// Places, px, y down.
    places: Vec<Point2<f64>>,
    /// Mean square distance from them, px^2.
    variances: Vec<f64>,
}

impl FittedWireframe {
    /// How far every node is expected to sit from its place on the face, px: half of such nodes are further off, half less.
    ///
    /// It is the error of the fit alone, whatever moves afterwards. `None` where no prior knows the wireframe.
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
        let told = used().filter(|m| m.expected_error.is_some()).count() as f64 / used().count().max(1) as f64;
        Some(self.spreads.as_ref()?.iter().map(|&spread| placement::calibrated(spread, told) * eye_distance).collect())
    }

    /// The last so many correspondences as points that were read in the picture.
    pub(crate) fn set_apart(mut self, read: usize) -> Self {
        let given = self.correspondences.len().saturating_sub(read);
        self.read = self.correspondences.split_off(given);
        self.residuals.truncate(given);
        self
    }

    /// The fit on the way to another one of the same marks: this one at 0, the other at 1.
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

    /// With how far its nodes are from where they were expected, and that expectation's own error; where the face is turned only that.
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

/// Expected errors that a mark may be off without a word: of normal errors one in 2000 is further.
const WITHIN_ERRORS: f64 = 4.0;
/// Distance over the eye distance beyond which no mark is given up for a triangle.
const GIVEN_UP: f64 = 0.3;
/// Distance over the eye distance at which a mark that was left behind should be looked at.
const LEFT_BEHIND: f64 = 0.1;
/// Marks from which on the others tell a wrong one ([`mistakes`]): the fit of fewer is refused when it would give up one of them.
const TELLING: usize = 6;

fn doubtful(mark: &Correspondence, distance: f64) -> FitWarning {
    FitWarning::Doubtful { node: mark.node, x: mark.position.x, y: mark.position.y, percent: 100.0 * distance }
}

/// The nodes with their triangles turned back, or as the springs have them where that would give up a mark, and what to look at.
fn choose(
    marks: &[Correspondence],
    plain: Vec<Point2<f64>>,
    unfolded: Unfolded,
    eye_distance: f64,
    mut warnings: Vec<FitWarning>,
) -> Result<(Vec<Point2<f64>>, Vec<FitWarning>), FitError> {
    let Unfolded { nodes, turned } = unfolded;
    let distance = |m: &Correspondence| (nodes[m.node.index()] - m.position).norm() / eye_distance;
    // A mark of a large expected error may stay behind.
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

/// Image space (y down) to the y-up plane in which shapes are compared, and back.
fn flip(point: Point2<f64>) -> Point2<f64> {
    Point2::new(point.x, -point.y)
}
