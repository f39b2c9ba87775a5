//! Fitting the wireframe to a neutral face from a few marked points [KP, section 2].
//!
//! 1. A least-squares similarity places the frontal wireframe on the marks: KP's scaling pre-step.
//! 2. A [`ShapePrior`] may adapt the neutral shape to the marks first (beyond KP; [`PriorKind::None`] is the paper).
//! 3. The springs deform the wireframe: every marked node is pulled to its mark, the others follow.
//!
//! The wireframe of the result is in image space: here the y axis is flipped.

mod prior;
mod spring;

use std::sync::Arc;

use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};

use crate::{
    geometry::{Similarity, SimilarityError},
    model::FrameExpressionModel,
    units::{NodeId, Px},
    wireframe::Wireframe,
};

pub use crate::correspondence::{
    COLLINEAR_RATIO, Correspondence, CorrespondenceError, MINIMUM_MARKS, MarkKind, MarksError, read_correspondences,
    validate_correspondences, write_correspondences,
};
pub use prior::{
    DEFAULT_MODES, Explanation, FaceSource, FacesError, LearnError, MINIMUM_FACES, NeutralFace, NeutralFaces, PRIOR_SCHEMA,
    PriorFile, PriorFileError, PriorOrigin, ShapePrior, learn_prior, read_neutral_faces, read_prior, write_prior,
};
pub use spring::{Pull, SpringError, Springs, Target};

/// Default gain of the force on a marked node, in units of the springs' stiffness k [KP leave both open].
pub const FIT_FORCE: f64 = 20.0;

/// Expected error of a mark that a person set, over the eye distance: half of such marks are nearer to the true point. Orders of
/// magnitude as in `candide/markable_nodes.csv`.
pub const HAND_MARK_ERROR: f64 = 0.019;

/// Median distance over the standard deviation in x and in y, where both are normal and independent: sqrt(2 ln 2).
pub(crate) const MEDIAN_OVER_DEVIATION: f64 = 1.177_410_022_515_474_7;

/// The force on a mark follows the inverse square of its expected error, within these shares of [`FitOptions::force`].
const FORCE_SHARES: (f64, f64) = (0.02, 5.0);

/// Which shape prior stands ahead of the springs.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PriorKind {
    /// None: similarity and springs only, as in KP.
    None,
    /// Candide's neutral and shape units.
    Candide,
    /// Real faces, learned from 90 people ([`ShapePrior::faces`]).
    Faces,
    /// Both: each by how probable it makes the marks. Candide alone for a wireframe with another number of nodes than Candide-3.
    #[default]
    Auto,
    /// A prior file.
    File(LoadedPrior),
}

/// A prior read from a file. It is known by the content of the file: only that is compared and written.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct LoadedPrior {
    /// BLAKE3 of the file, in hexadecimal.
    pub blake3: String,
    /// The prior; `None` in options that were read back from a file of provenance.
    #[serde(skip)]
    pub prior: Option<Arc<ShapePrior>>,
}

impl LoadedPrior {
    /// Reads a prior file.
    ///
    /// # Errors
    /// As [`read_prior`].
    pub fn read(path: &std::path::Path) -> Result<Self, PriorFileError> {
        let (prior, blake3) = read_prior(path)?;
        Ok(Self { blake3, prior: Some(Arc::new(prior)) })
    }
}

impl PartialEq for LoadedPrior {
    fn eq(&self, other: &Self) -> bool {
        self.blake3 == other.blake3
    }
}

/// Options of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FitOptions {
    /// Gain of the force on a marked node over the stiffness of a spring, > 0.
    pub force: f64,
    /// Shape prior.
    pub prior: PriorKind,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self { force: FIT_FORCE, prior: PriorKind::default() }
    }
}

/// Why a wireframe cannot be fitted.
#[derive(Debug, thiserror::Error)]
pub enum FitError {
    /// Too few marks.
    #[error("{found} marks; a fit needs at least {MINIMUM_MARKS}, and 5 to 8 for a good one")]
    TooFewMarks {
        /// Marks given.
        found: usize,
    },
    /// The similarity is not determined.
    #[error("the marks do not determine a placement: {0}")]
    Placement(#[from] SimilarityError),
    /// The springs have no equilibrium.
    #[error(transparent)]
    Springs(#[from] SpringError),
    /// A mark at a node that the wireframe does not have.
    #[error("mark at node {node}, but the wireframe has nodes 0 to {}", count.saturating_sub(1))]
    NoSuchNode {
        /// The node.
        node: NodeId,
        /// Nodes there are.
        count: usize,
    },
    /// A prior over another wireframe.
    #[error("the shape prior has {found} nodes, but the wireframe has {count}; choose another --prior")]
    PriorNodes {
        /// Nodes of the prior.
        found: usize,
        /// Nodes of the wireframe.
        count: usize,
    },
    /// Options that name a prior file that was not read.
    #[error("the shape prior with BLAKE3 {blake3} was not read from its file")]
    PriorNotRead {
        /// BLAKE3 of the file.
        blake3: String,
    },
    /// Left and right were exchanged.
    #[error(
        "the marks fit the mirrored face: left and right are the subject's own, so the subject's left is on the right of the image; exchange them (or were x and y exchanged?)"
    )]
    Mirrored,
    /// The marks turn parts of the wireframe over.
    #[error(
        "the marks fold {count} triangles of the wireframe: a mark is at a wrong place, or two are exchanged (left and right, inner and outer); look first at node {node}, marked at ({x}, {y})"
    )]
    Folded {
        /// Triangles turned over.
        count: usize,
        /// The mark that fits worst.
        node: NodeId,
        /// Its x, px.
        x: f64,
        /// Its y, px.
        y: f64,
    },
    /// The wireframe lies upside down in the image.
    #[error(
        "the marks place the face upside down (roll {degrees:.0} degrees): left and right are the subject's own, are marks exchanged?"
    )]
    UpsideDown {
        /// Angle of the face's up against the image's up.
        degrees: f64,
    },
}

/// A wireframe fitted to the neutral frame.
#[derive(Clone, Debug, PartialEq)]
pub struct FittedWireframe {
    /// All node positions, px, y down.
    pub model: FrameExpressionModel<Px>,
    /// Placement of the frontal wireframe (y flipped) in the image, before any deformation.
    pub image_from_face: Similarity,
    /// The correspondences used.
    pub correspondences: Vec<Correspondence>,
    /// Distance of every correspondence's node to its mark after the fit, px, in the order of `correspondences`.
    pub residuals: Vec<f64>,
}

/// Fits wireframes of one topology; holds what does not change from face to face.
#[derive(Clone, Debug)]
pub struct Fitter {
    springs: Springs,
    /// The priors that compete; empty for none.
    priors: Vec<ShapePrior>,
    options: FitOptions,
}

/// Distance of the pupils of Candide-3, model units.
const EYE_DISTANCE: f64 = 0.613;

/// Largest roll of a plausible portrait, radians; beyond it the picture stands on its head.
const MAX_ROLL: f64 = std::f64::consts::FRAC_PI_2;

impl Fitter {
    /// A fitter for a wireframe.
    pub fn new(wireframe: &Wireframe, options: FitOptions) -> Self {
        let candide = || ShapePrior::candide(wireframe);
        let priors = match &options.prior {
            PriorKind::None => vec![],
            PriorKind::Candide => vec![candide()],
            PriorKind::Faces => vec![ShapePrior::faces()],
            PriorKind::Auto => {
                let faces = Some(ShapePrior::faces()).filter(|p| p.mean.len() == wireframe.node_count());
                faces.into_iter().chain([candide()]).collect()
            }
            PriorKind::File(LoadedPrior { prior, .. }) => prior.iter().map(|p| ShapePrior::clone(p)).collect(),
        };
        Self { springs: Springs::new(wireframe), priors, options }
    }

    /// Fits the wireframe to the marks.
    ///
    /// # Errors
    /// [`FitError`] for fewer than three marks, marks that coincide, marks at nodes that are not there, or a mirrored or
    /// upside-down placement.
    pub fn fit(&self, wireframe: &Wireframe, marks: &[Correspondence]) -> Result<FittedWireframe, FitError> {
        if marks.len() < MINIMUM_MARKS {
            return Err(FitError::TooFewMarks { found: marks.len() });
        }
        let count = wireframe.node_count();
        if let Some(mark) = marks.iter().find(|m| m.node.index() >= count) {
            return Err(FitError::NoSuchNode { node: mark.node, count });
        }
        let seen: Vec<_> = marks.iter().map(|m| flip(m.position)).collect();
        let frontal = wireframe.frontal();
        let source: Vec<_> = marks.iter().map(|m| frontal[m.node.index()]).collect();
        let image_from_face = Similarity::fit(&source, &seen, None)?;
        if is_mirrored(&source, &seen, &image_from_face) {
            return Err(FitError::Mirrored);
        }
        if image_from_face.angle.abs() > MAX_ROLL {
            return Err(FitError::UpsideDown { degrees: image_from_face.angle.to_degrees() });
        }
        let placed = self.expected(marks, &seen, count)?;
        let placed = placed.unwrap_or_else(|| frontal.iter().map(|p| image_from_face.apply(p)).collect());
        let rest: Vec<_> = placed.into_iter().map(flip).collect();
        let eye_distance = image_from_face.scale * EYE_DISTANCE;
        let targets: Vec<_> = marks.iter().map(|m| self.target(m, eye_distance)).collect();
        let nodes = self.springs.deform(wireframe, &rest, &targets)?;
        let folded = folded_triangles(wireframe, &frontal, &nodes);
        if folded >= FOLDED_TRIANGLES {
            // The mark that the rigid placement explains worst is the likeliest to be wrong.
            let misfit = |i: usize| (image_from_face.apply(&source[i]) - seen[i]).norm();
            let worst = (0..marks.len()).max_by(|&a, &b| misfit(a).total_cmp(&misfit(b))).unwrap_or(0);
            let Correspondence { node, position, .. } = marks[worst];
            return Err(FitError::Folded { count: folded, node, x: position.x, y: position.y });
        }
        let residuals = marks.iter().map(|m| (nodes[m.node.index()] - m.position).norm()).collect();
        Ok(FittedWireframe {
            model: FrameExpressionModel::new(nodes),
            image_from_face,
            correspondences: marks.to_vec(),
            residuals,
        })
    }

    /// The face that the priors expect for the marks at `seen` (y up), in the space of `seen`; `None` without a prior.
    fn expected(
        &self,
        marks: &[Correspondence],
        seen: &[Point2<f64>],
        count: usize,
    ) -> Result<Option<Vec<Point2<f64>>>, FitError> {
        if let PriorKind::File(LoadedPrior { blake3, prior: None }) = &self.options.prior {
            return Err(FitError::PriorNotRead { blake3: blake3.clone() });
        }
        if let Some(prior) = self.priors.iter().find(|p| p.mean.len() != count) {
            return Err(FitError::PriorNodes { found: prior.mean.len(), count });
        }
        if self.priors.is_empty() {
            return Ok(None);
        }
        let nodes: Vec<_> = marks.iter().map(|m| m.node).collect();
        let deviations: Vec<_> = marks.iter().map(|m| m.expected_error.map(|e| e / MEDIAN_OVER_DEVIATION)).collect();
        let explained = self.priors.iter().map(|p| p.explain_by_errors(&nodes, seen, &deviations));
        let faces = explained.collect::<Result<Vec<_>, _>>()?;
        let shares = prior::shares(&faces);
        let place = |k: usize| -> Point2<f64> {
            let places = faces.iter().zip(&shares).map(|(f, share)| f.marks_from_face.apply(&f.shape[k]).coords * *share);
            Point2::from(places.sum::<Vector2<f64>>())
        };
        Ok(Some((0..count).map(place).collect()))
    }

    /// What a mark does to the springs, on a face with an eye distance of so many px.
    fn target(&self, mark: &Correspondence, eye_distance: f64) -> Target {
        let share = mark.expected_error.map_or(1.0, |error| {
            let ratio = HAND_MARK_ERROR * eye_distance / error;
            if ratio.is_finite() { (ratio * ratio).clamp(FORCE_SHARES.0, FORCE_SHARES.1) } else { 1.0 }
        });
        let pull = match mark.kind {
            MarkKind::Mark => Pull::Force(self.options.force * share),
            MarkKind::Hard => Pull::Hard,
        };
        Target { node: mark.node, position: mark.position, pull }
    }
}

/// Folded triangles from which on a fit is refused.
const FOLDED_TRIANGLES: usize = 3;

/// Least area of a triangle, model units squared, that counts as folded: slivers at lids and closed lips turn over without harm.
const FOLDED_AREA: f64 = 2e-3;

/// Number of triangles that lie the other way round than in the frontal view.
fn folded_triangles(wireframe: &Wireframe, frontal: &[Point2<f64>], nodes: &[Point2<f64>]) -> usize {
    let area = |points: &[Point2<f64>], [a, b, c]: &[NodeId; 3]| {
        (points[b.index()] - points[a.index()]).perp(&(points[c.index()] - points[a.index()])) / 2.0
    };
    // y is down in the image, so an unfolded triangle changes its sign.
    let folded = |t: &&[NodeId; 3]| area(frontal, t).abs() > FOLDED_AREA && area(frontal, t) * area(nodes, t) > 0.0;
    wireframe.triangles().iter().filter(folded).count()
}

/// Share of the direct placement's squared error below which a mirrored placement says that left and right were exchanged.
const MIRRORED_ERROR: f64 = 0.25;

/// Whether the marks lie much better on the mirrored wireframe than on the wireframe itself.
fn is_mirrored(source: &[Point2<f64>], seen: &[Point2<f64>], direct: &Similarity) -> bool {
    let error = |points: &[Point2<f64>], placement: &Similarity| -> f64 {
        points.iter().zip(seen).map(|(p, q)| (placement.apply(p) - q).norm_squared()).sum()
    };
    let mirrored: Vec<_> = source.iter().map(|p| Point2::new(-p.x, p.y)).collect();
    Similarity::fit(&mirrored, seen, None).is_ok_and(|m| error(&mirrored, &m) < MIRRORED_ERROR * error(source, direct))
}

/// Image space (y down) to the y-up plane in which shapes are compared, and back.
fn flip(point: Point2<f64>) -> Point2<f64> {
    Point2::new(point.x, -point.y)
}
