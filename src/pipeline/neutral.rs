//! The fit of a neutral frame: by the marks that are given, and by what is read in the picture where no mark is.
//!
//! A node without a mark follows from what faces are like; read in the picture it is nearer to its place: the 53 nodes that eleven marks leave
//! out are off by 3.3 % of the eye distance without, 2.4 with what is read there (20 people whom the locator had not seen, `docs/locate.md`).
//! A mark always wins: what is read has an expected error and bends.
//!
//! Not every face is one that the locator reads: it was learned from photographs of people and points that people set. Rendered faces are read
//! with twice the error that the marks alone leave, and a network's landmarks have brows and chin elsewhere. The marks tell which of these they
//! are ([`Fitter::share_by_hand`]).
//!
//! [`Fitter::share_by_hand`]: crate::fit::Fitter::share_by_hand

use image::GrayImage;
use serde::{Deserialize, Serialize};

use super::{
    Workbench,
    beside::{face_of_marks, held},
};
use crate::{
    fit::{Correspondence, FitError, FittedWireframe, Fitter},
    locate::{LocateOptions, LocatedFace, Locator},
    sequence::ImageSize,
    wireframe::Wireframe,
};

/// What is read serves where marks are with this probability those of a person on a photograph. Of 90 people, whom the prior knows, nine in ten have
/// 0.75 and more with eleven marks, and half 0.8 and more with seven; of 12 simulated faces the most is 0.03 with eleven and 0.11 with seven.
const BY_HAND: f64 = 0.5;

/// What nodes without a mark follow, where marks were set by hand.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Unmarked {
    /// What is read in the picture, where that serves.
    #[default]
    Read,
    /// The marks alone.
    Fitted,
}

/// A wireframe fitted to a neutral frame.
#[derive(Clone, Debug)]
pub struct NeutralFit {
    /// The wireframe.
    pub fitted: FittedWireframe,
    /// What a person should know of the marks where they lie beside the face of the picture, a sentence each.
    pub beside: Vec<String>,
}

impl Workbench {
    /// The wireframe fitted to marks that somebody gave for a picture, and to what is read in it at nodes that have none; by the marks alone
    /// where [`Unmarked::Fitted`] is asked for, where the picture shows no face that is trusted, where
    /// marks and face do not agree, and where the marks tell expected errors of their own.
    ///
    /// # Errors
    /// As [`Workbench::fit`].
    pub(crate) fn fit_in(&self, picture: &GrayImage, marks: &[Correspondence]) -> Result<NeutralFit, FitError> {
        self.fit_and_hold(picture, marks, !self.options.unchecked_marks)
    }

    /// [`Workbench::fit_in`] without a word of the marks, and without a look at the picture where that serves nothing else.
    ///
    /// # Errors
    /// As [`Workbench::fit`].
    pub(crate) fn fit_read(&self, picture: &GrayImage, marks: &[Correspondence]) -> Result<FittedWireframe, FitError> {
        Ok(self.fit_and_hold(picture, marks, false)?.fitted)
    }

    fn fit_and_hold(&self, picture: &GrayImage, marks: &[Correspondence], is_said: bool) -> Result<NeutralFit, FitError> {
        let fitted = self.fit(marks)?;
        let serves = self.options.unmarked == Unmarked::Read && are_by_hand(&self.fitter, &self.wireframe, marks);
        // A program that was built without the model finds no faces either, and says so there.
        let locator = Locator::shipped().ok().filter(|_| serves || is_said);
        let face = locator.and_then(|locator| {
            let find = || locator.locate(picture, &LocateOptions::default());
            face_of_marks((locator, picture), marks, &fitted, find).filter(LocatedFace::trusted)
        });
        let Some(face) = face else { return Ok(NeutralFit { fitted, beside: Vec::new() }) };
        let beside = held(&face, marks, &fitted).said();
        let size = ImageSize { width: picture.width(), height: picture.height() };
        let fitted = if serves && beside.is_empty() { fit_to_both(|marks| self.fit(marks), fitted, &face, size) } else { fitted };
        Ok(NeutralFit { fitted, beside: if is_said { beside } else { Vec::new() } })
    }
}

/// Whether marks mean what people mean who mark photographs.
pub fn are_by_hand(fitter: &Fitter, wireframe: &Wireframe, marks: &[Correspondence]) -> bool {
    marks.iter().all(|m| m.expected_error.is_none())
        && fitter.share_by_hand(wireframe, marks).is_some_and(|share| share >= BY_HAND)
}

/// The fit to the marks of `by_marks` and to what is read inside a picture of this size at the other nodes; `by_marks` itself where these make no fit, or
/// one of which there is more to say.
pub fn fit_to_both(
    fit: impl Fn(&[Correspondence]) -> Result<FittedWireframe, FitError>,
    by_marks: FittedWireframe,
    face: &LocatedFace,
    size: ImageSize,
) -> FittedWireframe {
    let is_free = |node| by_marks.correspondences.iter().all(|m| m.node != node);
    let points = face.points.iter().filter(|p| is_free(p.node) && size.contains(&p.position));
    let read: Vec<_> = points.map(|p| Correspondence::found(p.node, p.position, p.expected_error)).collect();
    let both = [by_marks.correspondences.as_slice(), &read].concat();
    match fit(&both) {
        Ok(fitted) if fitted.warnings.len() <= by_marks.warnings.len() => fitted.set_apart(read.len()),
        _ => by_marks,
    }
}

#[cfg(test)]
mod tests {
    use super::{super::showcase::portrait, *};
    use crate::{fit::read_correspondences, pipeline::PipelineOptions, sequence::read_frame};

    const ELEVEN: [u16; 11] = [20, 23, 53, 56, 31, 64, 10, 15, 17, 48, 50];

    fn bench(options: PipelineOptions) -> Workbench {
        Workbench::new(None, options).unwrap()
    }

    /// Mean distance of the nodes that `marks` leave out from their places, px.
    fn off(fitted: &FittedWireframe, places: &[Correspondence]) -> f64 {
        let left: Vec<_> = places.iter().filter(|m| !ELEVEN.contains(&m.node.0)).collect();
        left.iter().map(|m| (fitted.model.nodes()[m.node.index()] - m.position).norm()).sum::<f64>() / left.len() as f64
    }

    #[test]
    fn of_a_photograph_what_is_read_is_nearer_than_what_faces_are_like() {
        let bench = bench(PipelineOptions::default());
        let (picture, places) = portrait(&bench).unwrap();
        let grey = image::imageops::grayscale(&picture);
        let marks: Vec<_> = places.iter().filter(|m| ELEVEN.contains(&m.node.0)).copied().collect();
        let alone = bench.fit(&marks).unwrap();
        let with_read = bench.fit_in(&grey, &marks).unwrap();
        assert_eq!(with_read.beside, Vec::<String>::new());
        let NeutralFit { fitted, .. } = with_read;
        assert!(fitted.read.len() > 40 && fitted.read.iter().all(|r| !ELEVEN.contains(&r.node.0)));
        assert_eq!((fitted.correspondences.len(), fitted.residuals.len()), (11, 11));
        assert!(off(&fitted, &places) < 0.8 * off(&alone, &places), "{} {}", off(&fitted, &places), off(&alone, &places));
        // The marks stay where they were set.
        assert!(fitted.residuals.iter().all(|r| *r < 0.02 * 0.613 * fitted.image_from_face.scale), "{:?}", fitted.residuals);
        // What the page shows while marks are set is the same.
        assert_eq!(bench.fit_read(&grey, &marks).unwrap(), fitted);
    }

    #[test]
    fn nothing_is_read_where_marks_are_not_set_by_hand_or_nobody_wants_it() {
        let plain = bench(PipelineOptions::default());
        let (picture, places) = portrait(&plain).unwrap();
        let grey = image::imageops::grayscale(&picture);
        let marks: Vec<_> = places.iter().filter(|m| ELEVEN.contains(&m.node.0)).copied().collect();
        let alone = bench(PipelineOptions { unmarked: Unmarked::Fitted, ..PipelineOptions::default() });
        assert_eq!(alone.fit_in(&grey, &marks).unwrap().fitted, plain.fit(&marks).unwrap());
        // Marks that tell errors were found or measured, and bring all that there is.
        let told: Vec<_> = marks.iter().map(|m| Correspondence::found(m.node, m.position, 1.0)).collect();
        assert_eq!(plain.fit_in(&grey, &told).unwrap().fitted, plain.fit(&told).unwrap());
        // Marks beside the face are said, and nothing is read into them.
        let aside: Vec<_> =
            marks.iter().map(|m| Correspondence { position: m.position + nalgebra::Vector2::new(40.0, 0.0), ..*m }).collect();
        let fit = plain.fit_in(&grey, &aside).unwrap();
        assert!(fit.beside.len() == 1 && fit.fitted == plain.fit(&aside).unwrap(), "{:?}", fit.beside);
    }

    #[test]
    fn nothing_is_read_in_a_face_that_was_painted() {
        let bench = bench(PipelineOptions::default());
        let folder = std::path::Path::new("fixtures/simulated/S001/005");
        let marks = read_correspondences(&folder.join("correspondences.csv"), &bench.tables, 113).unwrap();
        let frame = read_frame(&folder.join("S001_005_00000001.jpg")).unwrap();
        assert!(
            bench.fitter().share_by_hand(&bench.wireframe, &marks).unwrap() < 0.2
                && !are_by_hand(bench.fitter(), &bench.wireframe, &marks)
        );
        assert_eq!(bench.fit_in(frame.image(), &marks).unwrap().fitted, bench.fit(&marks).unwrap());
    }
}
