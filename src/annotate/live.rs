//! The fit that the page shows during marking, equal to the one with which tracking begins.

use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use image::GrayImage;

use super::{
    desk::Desk,
    messages::{Fit, ToFit, hundredth},
};
use crate::{
    fit::{Correspondence, FitError, validate_correspondences},
    locate::{LocateOptions, LocatedFace},
    track::eye_distance_px,
};

/// The frame that was marked last; every move of a mark fits to it.
#[derive(Default)]
pub struct LiveFrame(Mutex<Option<(String, u32, Arc<Shown>)>>);

/// A frame and its faces, which are detected on the first request.
#[derive(Default)]
struct Shown {
    /// `None` if it cannot be decoded; the error appears where the frame is shown.
    picture: Option<GrayImage>,
    faces: OnceLock<Vec<LocatedFace>>,
}

impl Desk {
    /// Fits the wireframe to marks, saved or not, and to points read in their frame, if the request names it, at nodes without a mark.
    pub fn fit(&self, request: &ToFit) -> Fit {
        let marks: Vec<Correspondence> = request.marks.iter().map(Correspondence::from).collect();
        if let Err(error) = validate_correspondences(&marks, request.width, request.height) {
            return Fit::Problem { problem: error.to_string(), node: None };
        }
        let serves = self.bench.reads_beside(&marks) > 0.0;
        let shown = request.frame.as_ref().filter(|_| serves).map(|frame| self.shown(&frame.sequence, frame.number));
        let fitted = match shown.as_ref().and_then(|shown| Some((shown, shown.picture.as_ref()?))) {
            Some((shown, picture)) => self.bench.fit_read(picture, &marks, |locator| {
                shown.faces.get_or_init(|| locator.locate(picture, &LocateOptions::default())).clone()
            }),
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
                    FitError::Exchanged { pairs } | FitError::Mirrored { pairs, .. } => pairs.first().map(|pair| pair.0),
                    _ => None,
                };
                Fit::Problem { problem: error.to_string(), node }
            }
        }
    }

    fn shown(&self, id: &str, number: u32) -> Arc<Shown> {
        let live = || self.live.0.lock().unwrap_or_else(PoisonError::into_inner);
        let known = live().as_ref().filter(|(of, at, _)| of == id && *at == number).map(|(_, _, shown)| Arc::clone(shown));
        known.unwrap_or_else(|| {
            let shown = Arc::new(Shown { picture: self.grey(id, number).ok(), ..Shown::default() });
            *live() = Some((id.to_owned(), number, Arc::clone(&shown)));
            shown
        })
    }

    /// Discards the data of the frame that was marked last, because a sequence was opened again.
    pub(super) fn forget_shown(&self) {
        *self.live.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}
