//! The target of cloning: a neutral photograph with the wireframe fitted to it.

use image::{GrayImage, RgbImage};
use nalgebra::{Point2, Rotation2, Vector2};
use serde::{Deserialize, Serialize};

use super::{
    CloneError, SourceMotion,
    source::{LID_PAIRS, lid_gaps, lid_units, normalizer},
    timing::Moment,
};
use crate::{
    fit::{Correspondence, FitError, FittedWireframe, Fitter, validate_correspondences},
    geometry::Similarity,
    locate::{Locator, known_nodes},
    normalize::stable_nodes,
    sequence::MAX_SIDE,
    units::NodeId,
    warp::{NODE_COUNT, Texture, Warp},
    wireframe::{Face, Fapus, LidUnits},
};

/// How offsets are scaled from the source's face to the target's.
///
/// ```
/// # use grimace::{clone as cloning, correspondence, fit, sequence};
/// let face = grimace::wireframe::Face::candide3();
/// # let marks = "fixtures/portraits/P01_correspondences.csv".as_ref();
/// # let marks = correspondence::read_correspondences(marks, &face.tables, 113)?;
/// # let fitter = fit::Fitter::new(&face.wireframe, Default::default());
/// # let picture = image::open("fixtures/portraits/P01.jpg")?.into_rgb8();
/// # let target = grimace::clone::Target::new("P01", picture, &marks, &fitter, &face)?;
/// use grimace::clone::{CloneOptions, Rescale, SourceMotion, clone_expression};
///
/// // `target` is a portrait with its marks.
/// let source = SourceMotion::read("fixtures/golden/fap/happiness.fap".as_ref(), &face)?;
/// let options = CloneOptions { rescale: Rescale::Uniform, ..CloneOptions::default() };
/// let by_eyes = clone_expression(&source, &target, None, &options, &face)?;
/// let by_regions = clone_expression(&source, &target, None, &Default::default(), &face)?;
/// assert_ne!(by_eyes.frames[24].asked[31], by_regions.frames[24].asked[31]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rescale {
    /// By the FAPUs of each node's region, so that a wide mouth smiles wider.
    #[default]
    Fapu,
    /// By the eye distance alone.
    Uniform,
    /// No scaling: offsets in pixels are copied (for comparison).
    None,
}

/// Largest distance of the corners of the mouth from those of a neutral face, as the locator estimates it, that neutral faces have, in eye
/// distances.
const MOST_DRAWN: f64 = 0.05;

/// Smallest eye distance, px.
pub const LEAST_EYE_DISTANCE: f64 = 6.0;

/// Ratio of the widths of the face's halves from which it counts as turned away.
const MAX_HALF_RATIO: f64 = 1.9;
/// Depth of the midline in front of the outer eye corners, over half the face's width there (Candide-3: nose bone against eye corners).
const MIDLINE_DEPTH: f64 = 0.45;

/// A neutral photograph, prepared for cloning.
///
/// ```
/// use grimace::{clone::Target, correspondence::read_correspondences, fit::Fitter, wireframe::Face};
///
/// let face = Face::candide3();
/// let marks = read_correspondences("fixtures/portraits/P01_correspondences.csv".as_ref(), &face.tables, 113)?;
/// let picture = image::open("fixtures/portraits/P01.jpg")?.into_rgb8();
/// let fitter = Fitter::new(&face.wireframe, Default::default());
/// let target = Target::new("P01", picture, &marks, &fitter, &face)?;
/// // Its eyes are about 110 px apart, on one height.
/// assert!((target.fapus.es - 110.0).abs() < 10.0 && target.roll.to_degrees().abs() < 3.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Target {
    /// Name for files and captions.
    pub name: String,
    /// The photograph.
    pub picture: RgbImage,
    /// The wireframe fitted to it.
    pub fitted: FittedWireframe,
    /// Its FAPUs, px.
    pub fapus: Fapus,
    /// Angle from the image's up to the face's up, radians, positive towards the image's left (y up).
    pub roll: f64,
    lid_gaps: [f64; LID_PAIRS.len()],
    texture: Texture,
    warp: Warp,
    stable: Vec<usize>,
}

impl Target {
    /// Fits the wireframe to a photograph and prepares it.
    ///
    /// # Errors
    /// [`CloneError`] for marks that do not fit a frontal face, a face too small, a picture too large, or another wireframe.
    pub fn new(
        name: &str,
        picture: RgbImage,
        marks: &[Correspondence],
        fitter: &Fitter,
        face: &Face,
    ) -> Result<Self, CloneError> {
        Self::fitted_by(|marks| fitter.fit(&face.wireframe, marks), name, picture, marks, face)
    }

    /// [`Target::new`] with the wireframe fitted by `fit`.
    pub(crate) fn fitted_by(
        fit: impl FnOnce(&[Correspondence]) -> Result<FittedWireframe, FitError>,
        name: &str,
        picture: RgbImage,
        marks: &[Correspondence],
        face: &Face,
    ) -> Result<Self, CloneError> {
        let (width, height) = picture.dimensions();
        if width.max(height) > MAX_SIDE {
            return Err(CloneError::TooLarge { width, height, most: MAX_SIDE });
        }
        validate_correspondences(marks, width, height)?;
        Self::from_fit(name, picture, fit(marks)?, face)
    }

    /// Creates a target from a wireframe that is already fitted.
    ///
    /// # Errors
    /// As [`Target::new`].
    pub fn from_fit(name: &str, picture: RgbImage, fitted: FittedWireframe, face: &Face) -> Result<Self, CloneError> {
        let found = fitted.model.nodes().len();
        if found != NODE_COUNT {
            return Err(CloneError::Topology { what: name.to_owned(), found, expected: NODE_COUNT });
        }
        let nodes = fitted.model.nodes();
        let stable = stable_nodes(&face.tables, nodes.len());
        let frontal = face.wireframe.frontal();
        let pick = |points: &[Point2<f64>]| stable.iter().map(|&k| points[k]).collect::<Vec<_>>();
        let y_up: Vec<Point2<f64>> = nodes.iter().map(|p| Point2::new(p.x, -p.y)).collect();
        let from_face = Similarity::fit(&pick(&frontal), &pick(&y_up), None).map_err(|_| crate::warp::WarpError::NoEyes)?;
        let unroll = Rotation2::new(-from_face.angle);
        let upright: Vec<Point2<f64>> = y_up.iter().map(|p| unroll * p).collect();
        let fapus = Fapus::measure(&face.tables.fapus, &upright)
            .map_err(|source| CloneError::Fapus { what: "the target's neutral face", source })?;
        check_frontal(&upright)?;
        if fapus.es < LEAST_EYE_DISTANCE {
            return Err(CloneError::TooSmall { eye_distance: fapus.es, least: LEAST_EYE_DISTANCE });
        }
        let texture = Texture::new(&picture);
        let by_hand = |n: u16| fitted.correspondences.iter().any(|c| c.node.0 == n && c.expected_error.is_none());
        let warp = Warp::on_photograph(nodes, &texture, by_hand)?.with_eyes(&texture);
        // The lid distances seen on the photograph, not those of the fit, so that a FAP that shuts one eye shuts the other.
        let seen: Vec<Point2<f64>> = warp.texture_nodes().iter().map(|p| unroll * Point2::new(p.x, -p.y)).collect();
        let lid_gaps = lid_gaps(&seen, &fapus, normalizer(face)?.canonical());
        Ok(Self { name: name.to_owned(), picture, fapus, lid_gaps, roll: from_face.angle, texture, warp, stable, fitted })
    }

    /// The photograph as a texture.
    #[doc(hidden)]
    pub fn texture(&self) -> &Texture {
        &self.texture
    }

    /// The photograph's warp.
    #[doc(hidden)]
    pub fn warp(&self) -> &Warp {
        &self.warp
    }

    /// Distance of the lips in the middle, in eye distances, if the photograph shows the inside of the mouth. Such a face is not neutral, and
    /// the visible inside stays in every clone.
    pub fn lips_apart(&self) -> Option<f64> {
        self.warp.lips_apart()
    }

    /// Distance by which the corners of the mouth are drawn away from those of a neutral face, in eye distances, if the photograph seems to
    /// show an expression already; `None` otherwise. `grey` is the photograph in grey.
    pub fn corners_drawn(&self, grey: &GrayImage) -> Option<f64> {
        let [corners, _] = Locator::shipped().ok()?.look(grey, &known_nodes(self.fitted.model.nodes()))?.mouth?;
        (corners > MOST_DRAWN).then_some(corners)
    }

    /// Distance of the lids at each pair of `LID_PAIRS`, px.
    pub fn lid_gaps(&self) -> [f64; LID_PAIRS.len()] {
        self.lid_gaps
    }

    /// Units of the lids' FAPs for this face.
    pub(crate) fn lid_units(&self) -> LidUnits {
        lid_units(&self.fapus, &self.lid_gaps)
    }

    /// The box around the face with a margin, in the photograph: left, top, width, height, px.
    pub fn surroundings(&self) -> (u32, u32, u32, u32) {
        let unit = self.warp.eye_distance();
        let nodes = self.fitted.model.nodes();
        let (mut low, mut high) = (nodes[0], nodes[0]);
        for p in nodes {
            low = low.inf(p);
            high = high.sup(p);
        }
        let (width, height) = self.picture.dimensions();
        let clip = |p: f64, side: u32| p.clamp(0.0, f64::from(side)) as u32;
        let low = Point2::new(clip(low.x - 0.45 * unit, width), clip(low.y - 0.4 * unit, height));
        let high = Point2::new(clip(high.x + 0.45 * unit, width), clip(high.y + 0.7 * unit, height));
        (low.x, low.y, (high.x - low.x).max(1), (high.y - low.y).max(1))
    }

    /// Computes the requested positions of the target's nodes at a moment of a source's motion, px.
    ///
    /// Each offset from neutral is scaled along the face's x and y by target over source FAPU of its node's region times `emphasis`,
    /// rotated by the target's roll, and added to the target's neutral node. Lids and lips are then made to open round. With `head`, the source's
    /// head motion is added, scaled from the source's face to the target's.
    #[doc(hidden)]
    pub fn nodes_at(
        &self,
        source: &SourceMotion,
        moment: &Moment,
        rescale: Rescale,
        emphasis: f64,
        head: bool,
        face: &Face,
    ) -> Vec<Point2<f64>> {
        let mut nodes = self.unshaped_nodes_at(source, moment, rescale, emphasis, face);
        let neutral = self.fitted.model.nodes();
        self.shape_openings(&mut nodes);
        // A head at rest leaves every bit unchanged, so the photograph stays identical.
        if head
            && moment.head != Similarity::identity()
            && let Some((_, first)) = source.frames.first()
        {
            let pick = |points: &[Point2<f64>]| self.stable.iter().map(|&k| points[k]).collect::<Vec<_>>();
            if let Ok(target_from_source) = Similarity::fit(&pick(first), &pick(neutral), None) {
                let motion = target_from_source.after(&moment.head).after(&target_from_source.inverse());
                nodes.iter_mut().for_each(|p| *p = motion.apply(p));
            }
        }
        nodes
    }

    /// [`Target::nodes_at`] without the rounding of lids and lips and without head motion: what the source itself asks for.
    pub(super) fn unshaped_nodes_at(
        &self,
        source: &SourceMotion,
        moment: &Moment,
        rescale: Rescale,
        emphasis: f64,
        face: &Face,
    ) -> Vec<Point2<f64>> {
        let roll = Rotation2::new(self.roll);
        let ratio = |fapu| match (self.fapus.length(fapu), source.fapus.length(fapu)) {
            (Some(target), Some(source)) => target / source,
            _ => self.fapus.es / source.fapus.es,
        };
        // IRISD is the neutral opening of the lids (see `LidUnits`): a motion that shuts the source's eye shuts the target's.
        let lid_ratio = |pair: usize, irisd: f64| {
            let (own, other) = (self.lid_gaps[pair], source.lid_gaps[pair]);
            if own > 0.0 && other > 0.0 { own / other } else { irisd }
        };
        let neutral = self.fitted.model.nodes();
        neutral
            .iter()
            .zip(&moment.offsets)
            .enumerate()
            .map(|(k, (p, offset))| {
                let scale = match rescale {
                    Rescale::Fapu => {
                        let (x, y) = face.tables.node_fapus(NodeId(k as u16));
                        let lid = LID_PAIRS.iter().position(|&(above, below)| k == above || k == below);
                        Vector2::new(ratio(x), lid.map_or(ratio(y), |pair| lid_ratio(pair, ratio(y))))
                    }
                    Rescale::Uniform => Vector2::repeat(self.fapus.es / source.fapus.es),
                    Rescale::None => Vector2::repeat(1.0),
                };
                let up = roll * (offset.component_mul(&scale) * emphasis);
                p + Vector2::new(up.x, -up.y)
            })
            .collect()
    }
}

/// Checks that the face is not turned away: from the front, both halves are about equally wide at the eyes and at the mouth.
fn check_frontal(upright: &[Point2<f64>]) -> Result<(), CloneError> {
    let x = |n: usize| upright[n].x;
    // Outer eye corners against the nose bone, mouth corners against the middle of the lips.
    let eyes = (x(20) - x(94), x(94) - x(53));
    let mouth = (x(31) - x(7), x(7) - x(64));
    let widths = (eyes.0 + mouth.0, eyes.1 + mouth.1);
    let ratio = widths.0.max(widths.1) / widths.0.min(widths.1).max(1e-9);
    if widths.0 <= 0.0 || widths.1 <= 0.0 || ratio > MAX_HALF_RATIO {
        // The midline lies in front of the corners: at an angle a, the halves are cos a -+ d sin a.
        let share = ((ratio - 1.0) / (ratio + 1.0)).min(1.0);
        let degrees = (share / MIDLINE_DEPTH).atan().to_degrees();
        return Err(CloneError::Profile { degrees, ratio: ratio.min(99.0) });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        clone::Moment,
        model::FrameExpressionModel,
        track::{NodeState, TrackedFrame, TrackedNode},
        wireframe::Wireframe,
    };

    /// Candide-3 on a picture, with 100 px between the eyes, seen through a similarity.
    fn neutral(view: &Similarity) -> Vec<Point2<f64>> {
        let scale = 100.0 / 0.613;
        let place = |v: &nalgebra::Point3<f64>| view.apply(&Point2::new(200.0 + v.x * scale, 180.0 - v.y * scale));
        Wireframe::candide3().vertices().iter().map(place).collect()
    }

    fn tracked(number: u32, nodes: &[Point2<f64>]) -> TrackedFrame {
        let node = |&position: &Point2<f64>| TrackedNode::new(position, NodeState::Tracked, None);
        TrackedFrame { number, nodes: nodes.iter().map(node).collect() }
    }

    fn target(nodes: Vec<Point2<f64>>, bench: &Face) -> Result<Target, CloneError> {
        let fitted = FittedWireframe {
            model: FrameExpressionModel::new(nodes),
            image_from_face: Similarity::identity(),
            correspondences: Vec::new(),
            read: Vec::new(),
            residuals: Vec::new(),
            spreads: None,
            warnings: Vec::new(),
        };
        Target::from_fit("t", RgbImage::new(400, 400), fitted, bench)
    }

    /// The target of the neutral face as it is, made once for all tests.
    fn upright() -> &'static Target {
        static TARGET: std::sync::LazyLock<Target> =
            std::sync::LazyLock::new(|| target(neutral(&Similarity::identity()), &bench()).unwrap());
        &TARGET
    }

    /// A smile: the mouth corners go 0.4 px out and 1.5 px up, in a head that rolls.
    fn smile(bench: &Face) -> (SourceMotion, Vec<Point2<f64>>) {
        let start = neutral(&Similarity::identity());
        let roll = Similarity { scale: 1.02, angle: 0.05, translation: Vector2::new(3.0, -2.0) };
        let mut end = start.clone();
        end[31] += Vector2::new(0.4, -1.5);
        end[64] += Vector2::new(-0.4, -1.5);
        let end: Vec<_> = end.iter().map(|p| roll.apply(p)).collect();
        let motion = SourceMotion::from_track("smile", &[tracked(1, &start), tracked(2, &end)], &[], bench).unwrap();
        (motion, end)
    }

    fn bench() -> Face {
        Face::candide3()
    }

    #[test]
    fn cloning_onto_the_same_face_is_the_motion_itself() {
        let bench = bench();
        let (motion, end) = smile(&bench);
        let same = upright();
        for rescale in [Rescale::Fapu, Rescale::Uniform, Rescale::None] {
            let nodes = same.nodes_at(&motion, &motion.at(1.0), rescale, 1.0, true, &bench);
            assert!(nodes.iter().zip(&end).all(|(a, b)| (a - b).norm() < 1e-6), "{rescale:?}");
        }
    }

    #[test]
    fn a_face_twice_as_large_and_rolled_smiles_twice_as_wide_along_its_own_axes() {
        let bench = bench();
        let (motion, _) = smile(&bench);
        let view = Similarity { scale: 2.0, angle: 0.3, translation: Vector2::new(10.0, 20.0) };
        let start = neutral(&view);
        let large = target(start.clone(), &bench).unwrap();
        let nodes = large.nodes_at(&motion, &motion.at(1.0), Rescale::Fapu, 1.0, false, &bench);
        // The offset (0.4, -1.5) px of the left corner, doubled and rotated with the face.
        assert!(((nodes[31] - start[31]) - view.apply_vector(&Vector2::new(0.4, -1.5))).norm() < 1e-6);
        let half = large.nodes_at(&motion, &motion.at(1.0), Rescale::Fapu, 0.5, false, &bench);
        assert!(((half[31] - start[31]) * 2.0 - (nodes[31] - start[31])).norm() < 1e-9);
    }

    #[test]
    fn a_head_at_rest_leaves_every_bit_as_it_is() {
        // Anything that moves makes eyes and lips separate layers.
        let bench = bench();
        let (motion, _) = smile(&bench);
        for (scale, angle) in [(1.3, 0.2), (2.0, -0.1), (0.7, 0.05)] {
            let start = neutral(&Similarity { scale, angle, translation: Vector2::new(10.3, 20.7) });
            let nodes =
                target(start.clone(), &bench).unwrap().nodes_at(&motion, &motion.at(0.0), Rescale::Fapu, 1.0, true, &bench);
            assert_eq!(nodes, start);
        }
    }

    /// Neutral nodes, and their positions when some of the source's nodes have these offsets (canonical, upright, px, y up).
    fn moved(ways: &[(usize, Vector2<f64>)]) -> (Vec<Point2<f64>>, Vec<Point2<f64>>) {
        let bench = bench();
        let (motion, _) = smile(&bench);
        let start = neutral(&Similarity::identity());
        let mut offsets = vec![Vector2::zeros(); 113];
        ways.iter().for_each(|&(node, way)| offsets[node] = way);
        let moment = Moment { offsets, head: Similarity::identity(), turn: None, nearest: 0 };
        let nodes = upright().nodes_at(&motion, &moment, Rescale::None, 1.0, false, &bench);
        (start, nodes)
    }

    #[test]
    fn a_notched_lower_lip_opens_round() {
        // The points beside the middle go down, the middle itself does not.
        let (start, nodes) = moved(&[83, 84].map(|n| (n, Vector2::new(0.0, -10.0))));
        let down = |n: usize| nodes[n].y - start[n].y;
        assert!((down(83) - 0.97 * down(40)).abs() < 1e-6 && down(40) > 6.0, "{} {}", down(83), down(40));
    }

    #[test]
    fn the_outer_edge_of_a_lower_lip_that_drops_is_round() {
        // The middle goes down and the points beside it hardly do: they follow at least an arch through the middle.
        let (start, nodes) =
            moved(&[(8, Vector2::new(0.0, -20.0)), (85, Vector2::new(0.0, -2.0)), (86, Vector2::new(0.0, -2.0))]);
        let down = |n: usize| nodes[n].y - start[n].y;
        assert!(down(85) > 6.0 && down(85) < down(8) && (down(85) - down(86)).abs() < 1e-6, "{} {}", down(85), down(8));
        // A lip that is already round stays.
        let (start, nodes) =
            moved(&[(8, Vector2::new(0.0, -20.0)), (85, Vector2::new(0.0, -18.0)), (86, Vector2::new(0.0, -18.0))]);
        assert!((nodes[8].y - start[8].y - 20.0).abs() < 1e-6);
        // A lip whose middle goes up while the points beside it go down is not changed.
        let (start, nodes) = moved(&[(8, Vector2::new(0.0, 3.0)), (85, Vector2::new(0.0, -2.0)), (86, Vector2::new(0.0, -2.0))]);
        assert!((nodes[85].y - start[85].y - 2.0).abs() < 1e-6 && (nodes[8].y - start[8].y + 3.0).abs() < 1e-6);
    }

    #[test]
    fn the_end_of_the_opening_goes_with_the_corner_of_the_mouth() {
        let at = |way: Vector2<f64>| moved(&[31, 64].map(|n| (n, way)));
        // Half a pixel turns and stretches the piece between them a little, and its end stays. At 14 up, it turns by 0.55 and has 1.15 of its length.
        let (start, nodes) = at(Vector2::new(0.5, 0.5));
        assert!((nodes[88] - start[88]).norm() < 1e-9);
        let (start, nodes) = at(Vector2::new(0.0, 14.0));
        let (was, is) = (start[31] - start[88], nodes[31] - nodes[88]);
        assert!((is.norm() / was.norm() - 1.15).abs() < 1e-9 && (was.angle(&is) - 0.55).abs() < 1e-9, "{was} {is}");
        assert!((nodes[31] - start[31] - Vector2::new(0.0, -14.0)).norm() < 1e-9);
    }

    #[test]
    fn a_face_in_profile_is_refused() {
        let bench = bench();
        let start = neutral(&Similarity::identity());
        let turned = start.iter().map(|p| if p.x > 200.0 { Point2::new(200.0 + 0.3 * (p.x - 200.0), p.y) } else { *p }).collect();
        let error = target(turned, &bench).unwrap_err();
        assert!(matches!(error, CloneError::Profile { ratio, .. } if (ratio - 1.0 / 0.3).abs() < 0.1), "{error}");
    }
}
