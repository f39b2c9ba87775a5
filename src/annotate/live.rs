//! The fit that the page shows while marks are set: the one that tracking begins with.

use std::sync::{Arc, Mutex, PoisonError};

use image::GrayImage;

use super::{
    RequestError,
    desk::Desk,
    messages::{Fit, ToFit, hundredth},
};
use crate::{
    fit::{Correspondence, FitError, validate_correspondences},
    track::eye_distance_px,
};

/// The frame that was marked last, decoded: it is fitted to with every move of a mark.
#[derive(Default)]
pub struct LiveFrame(Mutex<Option<(String, u32, Arc<GrayImage>)>>);

impl Desk {
    /// Fits the wireframe to marks that need not be saved, and to what is read in their frame, as far as the request names it, at nodes without one.
    pub fn fit(&self, request: &ToFit) -> Fit {
        let marks: Vec<Correspondence> = request.marks.iter().map(Correspondence::from).collect();
        if let Err(error) = validate_correspondences(&marks, request.width, request.height) {
            return Fit::Problem { problem: error.to_string(), node: None };
        }
        // A frame that does not decode is said where it is shown.
        let picture = request.frame.as_ref().and_then(|frame| self.live_frame(&frame.sequence, frame.number).ok());
        let fitted = match picture {
            Some(picture) => self.bench.fit_read(&picture, &marks),
            None => self.bench.fit(&marks),
        };
        match fitted {
            Ok(fitted) => Fit::Fitted {
                nodes: fitted.model.nodes().iter().map(|p| [hundredth(p.x), hundredth(p.y)]).collect(),
                residuals: fitted.residuals.iter().map(|r| hundredth(*r)).collect(),
                eye_distance: hundredth(eye_distance_px(&self.bench.tables, fitted.model.nodes()).unwrap_or(0.0)),
            },
            Err(error) => {
                let node = match &error {
                    FitError::Outlier { node, .. } => Some(*node),
                    FitError::Exchanged { pairs } => pairs.first().map(|pair| pair.0),
                    _ => None,
                };
                Fit::Problem { problem: error.to_string(), node }
            }
        }
    }

    fn live_frame(&self, id: &str, number: u32) -> Result<Arc<GrayImage>, RequestError> {
        let mut live = self.live.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, _, picture)) = live.as_ref().filter(|(of, at, _)| of == id && *at == number) {
            return Ok(Arc::clone(picture));
        }
        let picture = Arc::new(self.grey(id, number)?);
        *live = Some((id.to_owned(), number, Arc::clone(&picture)));
        Ok(picture)
    }
}
