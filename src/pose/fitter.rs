//! Everything that head pose needs of a wireframe, computed once.

use nalgebra::Point2;

use super::{
    HeadFit, HeadModel, HeadPose, PoseError, fit::check_fit, fit_head, fit_turned, follow_head, frontalized, turned_share,
};
use crate::{
    fit::{Correspondence, FitError, FittedWireframe, Fitter, Springs},
    model::{DynamicExpressionModel, FrameExpressionModel},
    track::TrackedFrame,
    units::{NodeId, Px},
    wireframe::{Tables, Wireframe},
};

/// Fits heads to tracks and removes their motion.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
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
    /// Creates a fitter for a wireframe with the embedded head model.
    pub fn new(wireframe: &Wireframe, tables: &Tables) -> Self {
        Self::with_model(HeadModel::shipped(wireframe, tables), wireframe)
    }

    /// Creates a fitter with a head model over the wireframe's nodes.
    pub fn with_model(model: HeadModel, wireframe: &Wireframe) -> Self {
        Self { model, springs: Springs::new(wireframe) }
    }

    /// Returns the head model.
    pub fn model(&self) -> &HeadModel {
        &self.model
    }

    /// Fits the wireframe to the marks of a face that may be turned; see `fit_turned`.
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

    /// Returns how clearly the marks show a head turned to one side, 0 to 1; see `turned_share`.
    pub fn turned_share(&self, marks: &[Correspondence]) -> f64 {
        turned_share(&self.model, marks)
    }

    /// Fits head, poses and expressions to tracked frames, the neutral one first, with its marks.
    ///
    /// # Errors
    /// [`PoseError`].
    pub fn fit(&self, tables: &Tables, track: &[TrackedFrame], marks: &[(NodeId, Point2<f64>)]) -> Result<HeadFit, PoseError> {
        fit_head(&self.model, tables, track, marks)
    }

    /// Returns pose and expression of further frames of a known head; see `follow_head`.
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

    /// Returns the track as if the head looked into the camera all the time, px.
    ///
    /// # Errors
    /// [`PoseError`] when the springs have no equilibrium or the frames make no model, for a head fit with fewer frames than the
    /// track, and for a track, head fit or wireframe with another number of nodes than the head model.
    pub fn frontal(
        &self,
        (wireframe, tables): (&Wireframe, &Tables),
        fit: &HeadFit,
        track: &[TrackedFrame],
    ) -> Result<DynamicExpressionModel<Px>, PoseError> {
        check_fit(&self.model, fit, track)?;
        let (found, expected) = (wireframe.node_count(), self.model.node_count());
        if found != expected {
            return Err(PoseError::OtherWireframe { what: "wireframe", found, expected });
        }
        let frames = frontalized(&self.model, fit, track, (wireframe, tables), &self.springs)?;
        Ok(DynamicExpressionModel::new(frames.into_iter().map(FrameExpressionModel::new).collect())?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{track::read_track, wireframe::Face};

    #[test]
    fn tracks_marks_and_fits_of_another_shape_are_an_error() {
        let Face { wireframe, tables } = Face::candide3();
        let track = read_track("fixtures/simulated/truth/S001_005.csv".as_ref()).unwrap();
        let fitter = HeadFitter::new(&wireframe, &tables);
        let fit = fitter.fit(&tables, &track, &[]).unwrap();
        let frontal = |fit: &HeadFit, track: &[TrackedFrame]| fitter.frontal((&wireframe, &tables), fit, track).unwrap_err();
        let long = [track.clone(), track.clone()].concat();
        assert_eq!(frontal(&fit, &long), PoseError::FrameCount { found: 10, expected: 20 });
        let mut cut = track.clone();
        cut[4].nodes.truncate(20);
        let of_cut = PoseError::NodeCount { frame: 5, found: 20, expected: 113 };
        assert_eq!(frontal(&fit, &cut), of_cut);
        assert_eq!(fitter.fit(&tables, &cut, &[]).unwrap_err(), of_cut);
        assert_eq!(fitter.follow(&tables, (&fit, None), &cut, &[]).unwrap_err(), of_cut);
        let mut small = fit.clone();
        small.shapes[3].truncate(9);
        assert_eq!(frontal(&small, &track), PoseError::OtherWireframe { what: "head fit", found: 9, expected: 113 });
        let mark = [(NodeId(113), Point2::origin())];
        let beyond = PoseError::NoSuchNode { node: NodeId(113), count: 113 };
        assert_eq!(fitter.fit(&tables, &track, &mark).unwrap_err(), beyond);
        assert_eq!(fitter.follow(&tables, (&fit, None), &track, &mark).unwrap_err(), beyond);
        for frames in [0, 1] {
            let error = fitter.fit(&tables, &track[..frames], &[]).unwrap_err();
            assert_eq!(error, PoseError::TooFewFrames { found: frames });
        }
        let none = HeadFit { poses: Vec::new(), ..fit };
        assert_eq!(
            fitter.follow(&tables, (&none, None), &track, &[]).unwrap_err(),
            PoseError::FrameCount { found: 0, expected: 1 }
        );
    }
}
