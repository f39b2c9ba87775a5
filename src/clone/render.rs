//! Frames of a cloned expression: applies a source motion to a target and renders the pictures.

use image::RgbImage;
use nalgebra::{Point2, Vector2};
use serde::{Deserialize, Serialize};

use super::{CloneError, ClonedSkin, Details, Moment, Rescale, SourceMotion, Target, Teeth, Timing, detail, source::LID_PAIRS};
use crate::{
    geometry::Similarity,
    interpolation::smooth_step,
    model::{DynamicExpressionModel, FrameExpressionModel},
    units::Px,
    warp::Deformation,
    wireframe::Face,
};

/// Options of cloning.
///
/// ```
/// use grimace::clone::{CloneOptions, Teeth};
///
/// let options = CloneOptions { emphasis: 1.5, teeth: Teeth::Drawn, ..CloneOptions::default() };
/// assert_eq!((options.wrinkles, options.head), (0.0, false));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CloneOptions {
    /// How offsets are scaled to the target's face.
    pub rescale: Rescale,
    /// Factor on all offsets; 1 is the source's own strength.
    pub emphasis: f64,
    /// Whether to carry over the source's head motion.
    pub head: bool,
    /// Strength of the source's wrinkles: 0 for none, 1 for those of the source.
    pub wrinkles: f64,
    /// What shows in an open mouth.
    pub teeth: Teeth,
    /// Whether the target blinks: once as the motion begins, then every few seconds.
    pub blink: bool,
    /// Frame rate, duration and time course.
    pub timing: Timing,
}

/// Largest factor on a motion; no face moves a hundred times as far.
const MOST_EMPHASIS: f64 = 100.0;

impl CloneOptions {
    /// Checks the factors; those of time are checked with the source.
    fn check(&self) -> Result<(), CloneError> {
        let out = |what, value, allowed| Err(CloneError::Number { what, value, allowed });
        if !(self.emphasis.abs() <= MOST_EMPHASIS) {
            return out("the emphasis", self.emphasis, "-100 to 100");
        }
        if !(self.wrinkles.is_finite() && self.wrinkles >= 0.0) {
            return out("the strength of wrinkles", self.wrinkles, "a finite number of at least 0");
        }
        Ok(())
    }
}

/// Checks that a motion has the nodes of a target.
fn check_nodes(source: &SourceMotion, moments: &[Moment], target: &Target) -> Result<(), CloneError> {
    let expected = target.fitted.model.node_count();
    match moments.iter().find(|moment| moment.offsets.len() != expected) {
        Some(odd) => Err(CloneError::Topology { what: source.name.clone(), found: odd.offsets.len(), expected }),
        None => Ok(()),
    }
}

impl Default for CloneOptions {
    fn default() -> Self {
        Self {
            rescale: Rescale::default(),
            emphasis: 1.0,
            head: false,
            wrinkles: 0.0,
            teeth: Teeth::default(),
            blink: false,
            timing: Timing::default(),
        }
    }
}

/// One frame of a clone.
///
/// ```
/// # use grimace::{clone as cloning, correspondence, fit, sequence};
/// let face = grimace::wireframe::Face::candide3();
/// # let marks = "fixtures/portraits/P01_correspondences.csv".as_ref();
/// # let marks = correspondence::read_correspondences(marks, &face.tables, 113)?;
/// # let fitter = fit::Fitter::new(&face.wireframe, Default::default());
/// # let picture = image::open("fixtures/portraits/P01.jpg")?.into_rgb8();
/// # let target = grimace::clone::Target::new("P01", picture, &marks, &fitter, &face)?;
/// use grimace::clone::{SourceMotion, clone_expression};
///
/// // `target` is a portrait with its marks.
/// let source = SourceMotion::read("fixtures/golden/fap/happiness.fap".as_ref(), &face)?;
/// let smiling = clone_expression(&source, &target, None, &Default::default(), &face)?;
/// // In the picture, y goes down: the left corner of the mouth is higher in the last frame than in the first.
/// let corner = |frame: usize| smiling.frames[frame].asked[31];
/// assert!(corner(24).y < corner(0).y && smiling.frames[24].nearest == 24);
/// assert_eq!(smiling.frames[24].nodes().len(), 113);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct CloneFrame {
    /// Positions of everything in this frame.
    #[doc(hidden)]
    pub deformation: Deformation,
    /// Index of the source frame nearest in time.
    pub nearest: usize,
    /// Yaw, pitch and roll of the head relative to the source's first frame, degrees, if they are carried over. The picture shows only
    /// what a similarity in the plane can show of them.
    pub turn: Option<[f64; 3]>,
    /// Requested node positions, px. The warp may have reduced a motion that skin cannot make.
    pub asked: Vec<Point2<f64>>,
    /// Growth of the class's skin change in this frame; 0 without one.
    #[doc(hidden)]
    pub skin: f64,
}

impl CloneFrame {
    /// Positions of the nodes in the picture, px.
    pub fn nodes(&self) -> &[Point2<f64>] {
        self.deformation.nodes()
    }
}

/// A source's motion on a target. Pictures are rendered one at a time.
///
/// ```
/// # use grimace::{clone as cloning, correspondence, fit, sequence};
/// let face = grimace::wireframe::Face::candide3();
/// # let marks = "fixtures/portraits/P01_correspondences.csv".as_ref();
/// # let marks = correspondence::read_correspondences(marks, &face.tables, 113)?;
/// # let fitter = fit::Fitter::new(&face.wireframe, Default::default());
/// # let picture = image::open("fixtures/portraits/P01.jpg")?.into_rgb8();
/// # let target = grimace::clone::Target::new("P01", picture, &marks, &fitter, &face)?;
/// use grimace::clone::{SourceMotion, clone_expression};
///
/// // `target` is a portrait with its marks.
/// let source = SourceMotion::read("fixtures/golden/fap/happiness.fap".as_ref(), &face)?;
/// let smiling = clone_expression(&source, &target, None, &Default::default(), &face)?;
/// // 25 frames a second, for one second; the last one has the size of the photograph.
/// assert_eq!((smiling.fps, smiling.frames.len(), smiling.apex()), (25.0, 25, 24));
/// assert_eq!(smiling.picture(24)?.dimensions(), (440, 560));
/// assert!(smiling.picture(25).is_err());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ClonedExpression<'a> {
    target: &'a Target,
    details: Option<&'a Details>,
    skin: Option<&'a ClonedSkin>,
    options: CloneOptions,
    /// Frames per second.
    pub fps: f64,
    /// The frames.
    pub frames: Vec<CloneFrame>,
    /// Nodes at rest, if the motion does not start at rest.
    rest: Option<Vec<Point2<f64>>>,
}

/// Computes the motion of a source on a target.
///
/// ```
/// use grimace::{
///     clone::{CloneOptions, SourceMotion, Target, clone_expression},
///     correspondence::read_correspondences,
///     fit::Fitter,
///     wireframe::Face,
/// };
///
/// let face = Face::candide3();
/// let marks = read_correspondences("fixtures/portraits/P01_correspondences.csv".as_ref(), &face.tables, 113)?;
/// let fitter = Fitter::new(&face.wireframe, Default::default());
/// let picture = image::open("fixtures/portraits/P01.jpg")?.into_rgb8();
/// let target = Target::new("P01", picture, &marks, &fitter, &face)?;
/// let source = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &face)?;
/// let options = CloneOptions { emphasis: 1.2, ..CloneOptions::default() };
/// let smiling = clone_expression(&source, &target, None, &options, &face)?;
/// let picture = smiling.picture(smiling.apex())?;
/// assert_ne!(picture, target.picture);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`CloneError`] for too many frames, options out of range, a source whose parts do not fit together, a source or face with
/// other nodes than the target, and details of another source or target.
pub fn clone_expression<'a>(
    source: &SourceMotion,
    target: &'a Target,
    details: Option<&'a Details>,
    options: &CloneOptions,
    face: &Face,
) -> Result<ClonedExpression<'a>, CloneError> {
    options.check()?;
    let (fps, moments) = options.timing.moments(source)?;
    check_nodes(source, &moments, target)?;
    let needed = moments.iter().map(|moment| moment.nearest + 1).max().unwrap_or(0);
    details.map_or(Ok(()), |details| details.check(target, needed))?;
    let frames = moments
        .iter()
        .enumerate()
        .map(|(k, moment)| {
            let mut nodes = target.nodes_at(source, moment, options.rescale, options.emphasis, options.head, face);
            if options.blink {
                shut_lids(&mut nodes, blink(k as f64 / fps, (moments.len() - 1) as f64 / fps));
            }
            let turn = moment.turn.filter(|_| options.head);
            Ok(CloneFrame { deformation: target.warp().deform(&nodes)?, nearest: moment.nearest, turn, asked: nodes, skin: 0.0 })
        })
        .collect::<Result<_, CloneError>>()?;
    let is_still = |moment: &Moment| moment.offsets.iter().all(|offset| offset.norm() < 1e-9);
    let rest = match moments.first() {
        Some(first) if !is_still(first) => {
            let offsets = vec![Vector2::zeros(); first.offsets.len()];
            let still = Moment { offsets, head: Similarity::identity(), turn: None, nearest: 0 };
            let nodes = target.nodes_at(source, &still, options.rescale, options.emphasis, false, face);
            Some(target.warp().deform(&nodes)?.nodes().to_vec())
        }
        _ => None,
    };
    Ok(ClonedExpression { target, details, skin: None, options: *options, fps, frames, rest })
}

/// Seconds from the start to the first blink, and between blinks; then seconds to shut and to open the lids (opening takes twice as long).
const BLINKS: (f64, f64) = (0.12, 3.5);
const SHUTTING: (f64, f64) = (0.09, 0.19);

/// Closure of the lids by a blink, 0 to 1, at `time` in a film of `seconds`. Blinks that would not end within the film are left out.
fn blink(time: f64, seconds: f64) -> f64 {
    let number = ((time - BLINKS.0) / BLINKS.1).floor().max(0.0);
    let start = BLINKS.0 + number * BLINKS.1;
    let since = time - start;
    if since <= 0.0 || start + SHUTTING.0 + SHUTTING.1 > seconds {
        0.0
    } else if since < SHUTTING.0 {
        smooth_step(0.0, 1.0, since / SHUTTING.0)
    } else {
        1.0 - smooth_step(0.0, 1.0, (since - SHUTTING.0) / SHUTTING.1)
    }
}

/// Moves the upper lids towards the lower ones by a fraction of their distance.
fn shut_lids(nodes: &mut [Point2<f64>], share: f64) {
    for (above, below) in LID_PAIRS {
        nodes[above] = nodes[above] + (nodes[below] - nodes[above]) * share;
    }
}

impl<'a> ClonedExpression<'a> {
    /// Adds the skin change of a class, which grows with the motion. If wrinkles from the source's own frames are requested and available,
    /// they take precedence and the clone is returned unchanged.
    ///
    /// # Errors
    /// As [`clone_expression`].
    #[doc(hidden)]
    pub fn with_skin(mut self, skin: &'a ClonedSkin, source: &SourceMotion) -> Result<Self, CloneError> {
        if self.options.wrinkles > 0.0 && self.details.is_some() {
            return Ok(self);
        }
        let (_, moments) = self.options.timing.moments(source)?;
        check_nodes(source, &moments, self.target)?;
        for (frame, moment) in self.frames.iter_mut().zip(&moments) {
            frame.skin = skin.growth(source, moment, self.options.emphasis);
        }
        self.skin = Some(skin);
        Ok(self)
    }
}

impl ClonedExpression<'_> {
    /// Whether the skin change of a class is applied.
    #[doc(hidden)]
    pub fn has_skin(&self) -> bool {
        self.skin.is_some()
    }

    /// Renders one frame; the first is 0.
    ///
    /// # Errors
    /// [`CloneError::NoSuchFrame`]; [`CloneError::OtherDetails`] if `nearest` of that frame was set to a frame the source does not have.
    pub fn picture(&self, frame: usize) -> Result<RgbImage, CloneError> {
        let no_such_frame = CloneError::NoSuchFrame { frame, count: self.frames.len() };
        let frame = self.frames.get(frame).ok_or(no_such_frame)?;
        self.details.map_or(Ok(()), |details| details.check(self.target, frame.nearest.saturating_add(1)))?;
        Ok(self.rendered(frame))
    }

    fn rendered(&self, frame: &CloneFrame) -> RgbImage {
        let CloneFrame { deformation, nearest, skin, .. } = frame;
        let grown = self.skin.and_then(|s| s.texture(self.target, *skin));
        let (warp, plain) = (self.target.warp(), grown.as_ref().unwrap_or(self.target.texture()));
        let teeth = self.options.teeth;
        let Some(details) = self.details else { return warp.render(plain, deformation, &detail::inside(None, teeth)) };
        let of_source = details.show_mouth(teeth);
        let mouth = if of_source { details.mouth(*nearest) } else { None };
        // With the source's mouth, closed lips get a dark inside: drawn teeth would change when the source's lips open.
        let teeth = if of_source { Teeth::Dark } else { teeth };
        let inside = detail::inside(mouth.as_ref(), teeth);
        if self.options.wrinkles > 0.0 {
            let strength = self.options.wrinkles * self.options.emphasis;
            warp.render(&details.texture(self.target, *nearest, strength), deformation, &inside)
        } else {
            warp.render(plain, deformation, &inside)
        }
    }

    /// Node positions that the source asks for, per frame, without blinks and head motion and with lids and lips as the source has them.
    pub(super) fn unshaped(&self, source: &SourceMotion, face: &Face) -> Result<Vec<Vec<Point2<f64>>>, CloneError> {
        let CloneOptions { rescale, emphasis, timing, .. } = self.options;
        let (_, moments) = timing.moments(source)?;
        check_nodes(source, &moments, self.target)?;
        Ok(moments.iter().map(|m| self.target.unshaped_nodes_at(source, m, rescale, emphasis, face)).collect())
    }

    /// The target's dynamic model, px.
    ///
    /// # Errors
    /// [`CloneError::Model`] for fewer than two frames.
    pub fn model(&self) -> Result<DynamicExpressionModel<Px>, CloneError> {
        let frames = self.frames.iter().map(|f| FrameExpressionModel::new(f.deformation.nodes().to_vec()));
        Ok(DynamicExpressionModel::new(frames.collect())?)
    }

    /// The target.
    pub fn target(&self) -> &Target {
        self.target
    }

    /// The target's nodes at rest, if the first frame is not at rest.
    pub(super) fn rest_before(&self) -> Option<&[Point2<f64>]> {
        self.rest.as_deref()
    }

    /// Whether a blink moves the lids in frame `k`.
    pub(super) fn blinks(&self, k: usize) -> bool {
        let seconds = self.frames.len().saturating_sub(1) as f64 / self.fps;
        self.options.blink && blink(k as f64 / self.fps, seconds) > 0.0
    }

    /// Index of the frame whose nodes are farthest from neutral, without head motion and blinks; the first one of equals.
    pub fn apex(&self) -> usize {
        let neutral = self.target.warp().nodes();
        let blinks = |k: usize| LID_PAIRS.iter().any(|&(above, below)| self.options.blink && (k == above || k == below));
        let size = |f: &CloneFrame| {
            let moved = f.deformation.nodes().iter().zip(neutral).enumerate().filter(|(k, _)| !blinks(*k));
            moved.map(|(_, (p, n))| (p - f.deformation.background().apply(n)).norm()).sum::<f64>()
        };
        let sizes: Vec<f64> = self.frames.iter().map(size).collect();
        let open: Vec<usize> = (0..sizes.len()).filter(|&k| !self.blinks(k)).collect();
        let first = open.first().copied().unwrap_or(0);
        open.into_iter().fold(first, |best, k| if sizes[k] > sizes[best] { k } else { best })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_out_of_range_and_other_nodes_are_an_error() {
        let face = Face::candide3();
        let source = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &face).unwrap();
        let target = crate::clone::test_target::portrait_target();
        let why = |source: &SourceMotion, options: CloneOptions| {
            clone_expression(source, target, None, &options, &face).unwrap_err().to_string()
        };
        let options = CloneOptions::default();
        for emphasis in [f64::NAN, f64::INFINITY, 1e300, -101.0] {
            let said = why(&source, CloneOptions { emphasis, ..options });
            assert_eq!(said, format!("the emphasis is {emphasis}; it must be -100 to 100"));
        }
        assert!(why(&source, CloneOptions { wrinkles: f64::NAN, ..options }).starts_with("the strength of wrinkles is NaN"));
        let mut small = source.clone();
        small.offsets.iter_mut().for_each(|offsets| offsets.truncate(80));
        assert!(why(&small, options).starts_with("happiness has 80 nodes, but the wireframe has 113"));
        assert!(clone_expression(&source, target, None, &CloneOptions { emphasis: -1.0, ..options }, &face).is_ok());
    }

    #[test]
    fn a_frame_that_a_clone_does_not_have_is_an_error() {
        let face = Face::candide3();
        let source = SourceMotion::read("fixtures/golden/representatives/happiness.csv".as_ref(), &face).unwrap();
        let target = crate::clone::test_target::portrait_target();
        let clone = clone_expression(&source, target, None, &CloneOptions::default(), &face).unwrap();
        let count = clone.frames.len();
        assert!(clone.picture(count - 1).is_ok());
        let error = clone.picture(count).unwrap_err();
        assert!(matches!(error, CloneError::NoSuchFrame { frame, count: known } if (frame, known) == (count, count)));
        assert_eq!(error.to_string(), "the clone has no frame 26; its 26 frames are numbered from 0");
    }

    #[test]
    fn a_blink_shuts_the_lids_and_ends_in_the_film() {
        assert_eq!((blink(0.0, 1.0), blink(1.0, 1.0)), (0.0, 0.0));
        assert!((blink(0.21, 1.0) - 1.0).abs() < 1e-9);
        assert!((blink(0.12 + 3.5 + 0.09, 5.0) - 1.0).abs() < 1e-9);
        // The second one would not end in this film.
        assert_eq!(blink(0.12 + 3.5 + 0.09, 3.8), 0.0);
        let mut nodes: Vec<Point2<f64>> = (0..113).map(|k| Point2::new(f64::from(k), 2.0 * f64::from(k))).collect();
        shut_lids(&mut nodes, 1.0);
        assert!(LID_PAIRS.iter().all(|&(above, below)| nodes[above] == nodes[below]));
    }
}
