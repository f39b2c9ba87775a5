//! The fit that the page shows while marks are set: the one that tracking begins with.

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

/// The frame that was marked last: it is fitted to with every move of a mark.
#[derive(Default)]
pub struct LiveFrame(Mutex<Option<(String, u32, Arc<Shown>)>>);

/// A frame and its faces, which are found once, when they are first asked for.
#[derive(Default)]
struct Shown {
    /// `None` where it does not decode, which is said where it is shown.
    picture: Option<GrayImage>,
    faces: OnceLock<Vec<LocatedFace>>,
}

impl Desk {
    /// Fits the wireframe to marks that need not be saved, and to what is read in their frame, as far as the request names it, at nodes without one.
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

    /// What is known of the frame that was marked last is read again when it is next fitted to: a sequence was opened anew.
    pub(super) fn forget_shown(&self) {
        *self.live.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}
