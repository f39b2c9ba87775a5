//! Fits the wireframe to a neutral frame: to the given marks, and to points read in the picture at nodes without a mark.
//!
//! A node without a mark follows from the shape prior; a point read in the picture places it more accurately (`docs/locate.md`). A mark has
//! more weight than a point that is read.
//!
//! The locator was trained on photographs of people with hand-set points. On rendered faces its error is twice that of the marks alone, and
//! networks place brows and chin differently. The weight of the points that are read therefore follows from two measures: the probability
//! that the marks were set by hand on a photograph ([`Fitter::share_by_hand`]), and the agreement of marks and picture. The weight is
//! continuous, so that moving a mark a little moves the fit a little.
//!
//! [`Fitter::share_by_hand`]: crate::fit::Fitter::share_by_hand

use image::GrayImage;

use super::{
    Workbench,
    beside::{face_of_marks, held},
};
use crate::{
    fit::{Correspondence, FitError, FittedWireframe, Fitter, HAND_MARK_ERROR},
    locate::{FacePart, LocateOptions, LocatedFace, Locator},
    sequence::ImageSize,
    units::NodeId,
    wireframe::{LIP_TWINS, Wireframe},
};

/// Probabilities that marks were set by hand on a photograph: up to the first, points read in the picture have no weight; from the second
/// on, full weight.
///
/// Among 90 people of the prior's training data, nine in ten reach 0.75 with eleven marks, and half reach 0.8 with seven. Among 12
/// simulated faces the maximum is 0.03 with eleven marks and 0.11 with seven.
const BY_HAND: [f64; 2] = [0.25, 0.6];

/// Fewest marks from which [`by_hand`] decides. Of the landmarks that a network placed on 30 people, 11 are classified as hand-set with
/// three marks, 4 to 7 with four to six, none with seven.
const TELLING: usize = 7;

/// Agreement of marks and picture ([`super::beside::Held::agreement`]) from which points read in the picture have full weight. At 0 they
/// have none.
const AGREEMENT: f64 = 0.4;

/// A wireframe fitted to a neutral frame.
#[derive(Clone, Debug)]
pub struct NeutralFit {
    /// The fitted wireframe.
    pub fitted: FittedWireframe,
    /// Messages about marks that do not agree with the face in the picture, one sentence each.
    pub beside: Vec<String>,
}

impl Workbench {
    /// Fits the wireframe to given marks and to points read in the picture at nodes without a mark.
    ///
    /// It uses the marks alone where [`FitOptions::read_unmarked`](crate::fit::FitOptions::read_unmarked) is off, where the picture shows
    /// no trusted face, where marks and face disagree, where there are fewer than seven marks, where the marks show a turned head, or where
    /// marks have expected errors of their own.
    ///
    /// # Errors
    /// As [`Workbench::fit`].
    #[doc(hidden)]
    pub fn fit_in(&self, picture: &GrayImage, marks: &[Correspondence]) -> Result<NeutralFit, FitError> {
        let is_said = !self.options.unchecked_marks;
        let find = |locator: &Locator| locator.locate(picture, &LocateOptions::default());
        let mut fit = self.fit_and_hold(picture, marks, is_said, find)?;
        if !is_said {
            fit.beside.clear();
        }
        Ok(fit)
    }

    /// As [`Workbench::fit_in`], without messages about the marks. It reads the picture only if the fit uses it. `find` detects all faces
    /// in it.
    ///
    /// # Errors
    /// As [`Workbench::fit`].
    pub(crate) fn fit_read(
        &self,
        picture: &GrayImage,
        marks: &[Correspondence],
        find: impl FnOnce(&Locator) -> Vec<LocatedFace>,
    ) -> Result<FittedWireframe, FitError> {
        Ok(self.fit_and_hold(picture, marks, false, find)?.fitted)
    }

    /// Largest weight that points read in a picture can have beside these marks, 0 to 1.
    pub(crate) fn reads_beside(&self, marks: &[Correspondence]) -> f64 {
        let by_hand = if self.options.fit.read_unmarked { by_hand(&self.fitter, &self.wireframe, marks) } else { 0.0 };
        // The locator was trained on frontal faces, and the marks of a turned head do not show whether they were set by hand.
        if by_hand > 0.0 { by_hand * (1.0 - self.head_fitter().turned_share(marks)) } else { 0.0 }
    }

    fn fit_and_hold(
        &self,
        picture: &GrayImage,
        marks: &[Correspondence],
        is_said: bool,
        find: impl FnOnce(&Locator) -> Vec<LocatedFace>,
    ) -> Result<NeutralFit, FitError> {
        let fitted = self.fit(marks)?;
        let by_hand = self.reads_beside(marks);
        // Without the shipped model no face is detected either; the error is reported there.
        let locator = Locator::shipped().ok().filter(|_| by_hand > 0.0 || is_said);
        let Some(locator) = locator else { return Ok(NeutralFit { fitted, beside: Vec::new() }) };
        Ok(fit_beside(|marks| self.fit(marks), fitted, by_hand, (locator, picture), || find(locator)))
    }
}

/// Weight, 0 to 1, for marks that were placed as people place them on photographs; 0 for marks with expected errors of their own.
pub fn by_hand(fitter: &Fitter, wireframe: &Wireframe, marks: &[Correspondence]) -> f64 {
    let may_be = marks.len() >= TELLING && marks.iter().all(|m| m.expected_error.is_none());
    let share = if may_be { fitter.share_by_hand(wireframe, marks) } else { None };
    share.map_or(0.0, |share| ((share - BY_HAND[0]) / (BY_HAND[1] - BY_HAND[0])).clamp(0.0, 1.0))
}

/// Compares a fit to marks with the face in a picture, and fits again to the points read at the other nodes.
///
/// The weight of these points is the product of `by_hand` and the agreement of marks and face. `fit` fits to marks, `find` detects all
/// faces.
pub fn fit_beside(
    fit: impl Fn(&[Correspondence]) -> Result<FittedWireframe, FitError>,
    by_marks: FittedWireframe,
    by_hand: f64,
    (locator, picture): (&Locator, &GrayImage),
    find: impl FnOnce() -> Vec<LocatedFace>,
) -> NeutralFit {
    let marks = &by_marks.correspondences;
    let face = face_of_marks((locator, picture), marks, &by_marks, find).filter(LocatedFace::trusted);
    let Some(face) = face else { return NeutralFit { fitted: by_marks, beside: Vec::new() } };
    let held = held(&face, marks, &by_marks);
    let beside = held.said();
    let counts = if beside.is_empty() { by_hand * (held.agreement() / AGREEMENT).clamp(0.0, 1.0) } else { 0.0 };
    let size = ImageSize { width: picture.width(), height: picture.height() };
    let read = if counts > 0.0 { read_at_free_nodes(&face, marks, size) } else { Vec::new() };
    if read.is_empty() {
        return NeutralFit { fitted: by_marks, beside };
    }
    let fitted = match fit(&[marks.as_slice(), &read].concat()) {
        // The second fit must not add warnings about the user's marks.
        Ok(fitted) if fitted.warnings.len() <= by_marks.warnings.len() => by_marks.towards(fitted.set_apart(read.len()), counts),
        _ => by_marks,
    };
    NeutralFit { fitted, beside }
}

/// Points of a face inside a picture at nodes where neither the node nor its twin on the other lip is marked.
fn read_at_free_nodes(face: &LocatedFace, marks: &[Correspondence], size: ImageSize) -> Vec<Correspondence> {
    let is_marked = |node: NodeId| marks.iter().any(|m| m.node == node);
    let twin = |node: NodeId| {
        let of = |&(a, b): &(u16, u16)| if node.0 == a { Some(NodeId(b)) } else { (node.0 == b).then_some(NodeId(a)) };
        LIP_TWINS.iter().find_map(of)
    };
    // Points of a covered part are guesses; the prior and the marks place them more accurately.
    let is_covered = |node: NodeId| FacePart::of_node(node).is_some_and(|part| face.covered.contains(&part));
    let is_free = |node: NodeId| !is_covered(node) && !is_marked(node) && !twin(node).is_some_and(is_marked);
    let least = HAND_MARK_ERROR * face.eye_distance;
    let points = face.points.iter().filter(|p| is_free(p.node) && size.contains(&p.position));
    points.map(|p| Correspondence::found(p.node, p.position, p.expected_error.max(least))).collect()
}

#[cfg(test)]
mod tests {
    use super::{super::showcase::portrait, *};
    use crate::{
        fit::{FitOptions, read_correspondences},
        pipeline::PipelineOptions,
        sequence::read_frame,
    };

    const ELEVEN: [u16; 11] = [20, 23, 53, 56, 31, 64, 10, 15, 17, 48, 50];

    fn bench(options: PipelineOptions) -> Workbench {
        Workbench::new(None, options).unwrap()
    }

    /// A composite portrait in grey, with its marks.
    fn photograph(bench: &Workbench) -> (GrayImage, Vec<Correspondence>) {
        let (picture, places) = portrait(bench).unwrap();
        (image::imageops::grayscale(&picture), places)
    }

    /// The marks at these nodes.
    fn at(nodes: &[u16], places: &[Correspondence]) -> Vec<Correspondence> {
        places.iter().filter(|m| nodes.contains(&m.node.0)).copied().collect()
    }

    /// Mean distance of the nodes without a mark from their true positions, px.
    fn off(fitted: &FittedWireframe, places: &[Correspondence]) -> f64 {
        let left: Vec<_> = places.iter().filter(|m| !ELEVEN.contains(&m.node.0)).collect();
        left.iter().map(|m| (fitted.model.nodes()[m.node.index()] - m.position).norm()).sum::<f64>() / left.len() as f64
    }

    #[test]
    fn of_a_photograph_what_is_read_is_nearer_than_what_faces_are_like() {
        let bench = bench(PipelineOptions::default());
        let (grey, places) = photograph(&bench);
        let marks = at(&ELEVEN, &places);
        let alone = bench.fit(&marks).unwrap();
        let with_read = bench.fit_in(&grey, &marks).unwrap();
        assert_eq!(with_read.beside, Vec::<String>::new());
        let NeutralFit { fitted, .. } = with_read;
        assert!(fitted.read.len() > 40 && fitted.read.iter().all(|r| !ELEVEN.contains(&r.node.0)));
        assert_eq!((fitted.correspondences.len(), fitted.residuals.len()), (11, 11));
        assert!(off(&fitted, &places) < 0.8 * off(&alone, &places), "{} {}", off(&fitted, &places), off(&alone, &places));
        // The marks keep their positions.
        assert!(fitted.residuals.iter().all(|r| *r < 0.02 * 0.613 * fitted.image_from_face.scale), "{:?}", fitted.residuals);
        // The fit that the `annotate` page shows during marking is the same.
        let find = |locator: &Locator| locator.locate(&grey, &LocateOptions::default());
        assert_eq!(bench.fit_read(&grey, &marks, find).unwrap(), fitted);
    }

    #[test]
    fn no_point_is_read_without_hand_set_marks_or_when_switched_off() {
        let plain = bench(PipelineOptions::default());
        let (grey, places) = photograph(&plain);
        let marks = at(&ELEVEN, &places);
        let fit = FitOptions { read_unmarked: false, ..FitOptions::default() };
        let alone = bench(PipelineOptions { fit, ..PipelineOptions::default() });
        assert_eq!(alone.fit_in(&grey, &marks).unwrap().fitted, plain.fit(&marks).unwrap());
        // Marks with expected errors were detected or measured; no point is read beside them.
        let found_marks: Vec<_> = marks.iter().map(|m| Correspondence::found(m.node, m.position, 1.0)).collect();
        assert_eq!(plain.fit_in(&grey, &found_marks).unwrap().fitted, plain.fit(&found_marks).unwrap());
        // Marks that miss the face are reported, and no point is read.
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
        assert_eq!(bench.reads_beside(&marks), 0.0);
        assert_eq!(bench.fit_in(frame.image(), &marks).unwrap().fitted, bench.fit(&marks).unwrap());
    }

    #[test]
    fn what_is_read_fades_where_a_mark_leaves_its_feature() {
        let bench = bench(PipelineOptions::default());
        let (grey, places) = photograph(&bench);
        let marks = |down: f64| -> Vec<_> {
            let down =
                |m: &Correspondence| if m.node.0 == 31 { nalgebra::Vector2::new(0.0, down) } else { nalgebra::Vector2::zeros() };
            at(&ELEVEN, &places).iter().map(|m| Correspondence { position: m.position + down(m), ..*m }).collect()
        };
        // Moves a mouth corner in steps of 2 px: no node jumps at the distance where the points read lose their weight.
        let fits: Vec<_> = (0..14).map(|k| bench.fit_in(&grey, &marks(2.0 * f64::from(k))).unwrap().fitted).collect();
        assert!(!fits[0].read.is_empty() && fits[13].read.is_empty());
        for pair in fits.windows(2) {
            let moved = pair[0].model.nodes().iter().zip(pair[1].model.nodes()).map(|(p, q)| (p - q).norm());
            let most = moved.fold(0.0, f64::max);
            assert!(most < 4.0, "{most}");
        }
    }

    #[test]
    fn few_marks_and_twins_of_marked_lips_are_left_to_the_marks() {
        let bench = bench(PipelineOptions::default());
        let (grey, places) = photograph(&bench);
        let six = at(&[20, 23, 53, 56, 31, 64], &places);
        assert_eq!((six.len(), bench.reads_beside(&six)), (6, 0.0));
        let twins = at(&[20, 23, 53, 56, 31, 64, 10, 15, 17, 48, 50, 87], &places);
        assert!(twins.iter().any(|m| m.node.0 == 87), "the portrait has the upper inner lip");
        let read = bench.fit_in(&grey, &twins).unwrap().fitted.read;
        assert!(!read.is_empty() && read.iter().all(|r| r.node.0 != 40));
    }
}
