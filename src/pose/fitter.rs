//! Everything that pose needs of a wireframe, computed once.

use nalgebra::Point2;

use super::{HeadFit, HeadModel, HeadPose, PoseError, fit_head, fit_turned, follow_head, frontalized, turned_share};
use crate::{
    fit::{Correspondence, FitError, FittedWireframe, Fitter, Springs},
    model::{DynamicExpressionModel, FrameExpressionModel},
    track::TrackedFrame,
    units::{NodeId, Px},
    wireframe::{Tables, Wireframe},
};

/// Fits heads to tracks and takes their motion out.
///
/// ```
/// # let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::pose::HeadFitter;
///
/// // `track` holds the ten frames of a smile.
/// let fitter = HeadFitter::new(&wireframe, &tables);
/// let fit = fitter.fit(&tables, &track, &[])?;
/// // The same face, looking into the camera all the time.
/// let frontal = fitter.frontal((&wireframe, &tables), &fit, &track)?;
/// assert_eq!(frontal.frame_count(), 10);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct HeadFitter {
    model: HeadModel,
    springs: Springs,
}

impl HeadFitter {
    /// A fitter for a wireframe with the head model that comes with the program.
    pub fn new(wireframe: &Wireframe, tables: &Tables) -> Self {
        Self::with_model(HeadModel::shipped(wireframe, tables), wireframe)
    }

    /// A fitter with a head model over the wireframe's nodes.
    pub fn with_model(model: HeadModel, wireframe: &Wireframe) -> Self {
        Self { model, springs: Springs::new(wireframe) }
    }

    /// The head model.
    pub fn model(&self) -> &HeadModel {
        &self.model
    }

    /// The wireframe fitted to the marks of a face that may be turned: `fit_turned`.
    ///
    /// # Errors
    /// [`FitError`].
    pub fn fit_neutral(
        &self,
        fitter: &Fitter,
        wireframe: &Wireframe,
        marks: &[Correspondence],
    ) -> Result<FittedWireframe, FitError> {
        fit_turned(&self.model, fitter, wireframe, marks)
    }

    /// How far marks say that a head is turned to one side, 0 to 1: `turned_share`.
    pub fn turned_share(&self, marks: &[Correspondence]) -> f64 {
        turned_share(&self.model, marks)
    }

    /// Head, poses and expressions of tracked frames, the neutral one first, with the marks on it.
    ///
    /// # Errors
    /// [`PoseError`].
    pub fn fit(&self, tables: &Tables, track: &[TrackedFrame], marks: &[(NodeId, Point2<f64>)]) -> Result<HeadFit, PoseError> {
        fit_head(&self.model, tables, track, marks)
    }

    /// Pose and expression of further frames of a known head: `follow_head`.
    ///
    /// # Errors
    /// [`PoseError`].
    pub fn follow(
        &self,
        tables: &Tables,
        known: (&HeadFit, Option<HeadPose>),
        track: &[TrackedFrame],
        marks: &[(NodeId, Point2<f64>)],
    ) -> Result<HeadFit, PoseError> {
        follow_head(&self.model, tables, known, track, marks)
    }

    /// The track as the head would show it looking into the camera all the time, px.
    ///
    /// # Errors
    /// [`PoseError`] when the springs have no equilibrium or the frames make no model.
    pub fn frontal(
        &self,
        (wireframe, tables): (&Wireframe, &Tables),
        fit: &HeadFit,
        track: &[TrackedFrame],
    ) -> Result<DynamicExpressionModel<Px>, PoseError> {
        let frames = frontalized(&self.model, fit, track, (wireframe, tables), &self.springs)?;
        Ok(DynamicExpressionModel::new(frames.into_iter().map(FrameExpressionModel::new).collect())?)
    }
}
