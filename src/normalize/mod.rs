//! Normalization of a tracked model to N' upright frames with equal FAPUs [KP, section 4.1].
//!
//! The three steps are KP's: number of frames ([`resample`]), orientation and rigid motion (`orientation`), size (`size`). The last step
//! also changes the coordinates: the y axis then points up and lengths are in face units instead of pixels.

mod face_units;
mod orientation;
mod size;
mod time;

use nalgebra::Point2;
use serde::{Deserialize, Serialize};

use crate::{
    geometry::SimilarityError,
    model::{DynamicExpressionModel, FrameExpressionModel, ModelError},
    units::{FaceUnit, Px},
    wireframe::{Fapus, FapusError, LidUnits, Tables, Wireframe},
};

pub use face_units::{NotFaceUnits, check_face_units};
pub use orientation::{EyeCorners, stable_nodes};
pub use time::{Resample, resample, resample_at};

/// Number of frames of a normalized model [KP, section 4.1: "five frames are sufficient"].
pub const FRAMES_PER_MODEL: usize = 5;

/// Eye separation ES0 of the canonical neutral, face units.
pub const CANONICAL_ES: f64 = FaceUnit::PER_ES;

/// How the sizes of faces are made equal.
///
/// ```
/// let grimace::wireframe::Face { wireframe, tables } = grimace::wireframe::Face::candide3();
/// # let track = grimace::track::read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?;
/// use grimace::{normalize::{NormalizeOptions, Normalizer, SizeMode}, track::track_model};
///
/// // `track` holds the ten frames of a smile.
/// let options = NormalizeOptions { size: SizeMode::Uniform, ..NormalizeOptions::default() };
/// let by_eyes = Normalizer::new(&wireframe, &tables, options)?.normalize(&track_model(&track)?)?;
/// let by_regions = Normalizer::new(&wireframe, &tables, Default::default())?.normalize(&track_model(&track)?)?;
/// assert_eq!(by_eyes.neutral(), by_regions.neutral());
/// assert_ne!(by_eyes.apex(), by_regions.apex());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SizeMode {
    /// Scales every node's offset by the FAPUs of its region, so that all models get equal FAPUs (KP).
    #[default]
    Fapu,
    /// Scales all offsets by ES0 alone.
    Uniform,
}

/// Which head motion is removed from a track.
///
/// A [`Normalizer`] removes roll, translation and size, which needs no depth. With [`PoseMode::Full`] the pipeline
/// ([`Workbench`](crate::pipeline::Workbench)) first turns the track to a frontal view ([`HeadFitter`](crate::pose::HeadFitter)). If you
/// use a normalizer directly, do that yourself; otherwise the result is that of [`PoseMode::Roll`].
///
/// ```
/// use grimace::normalize::{NormalizeOptions, PoseMode};
///
/// // As in the paper: roll alone, no turns to a side.
/// let options = NormalizeOptions { pose: PoseMode::Roll, ..NormalizeOptions::default() };
/// assert_eq!(serde_json::to_value(options)?["pose"], "roll");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseMode {
    /// Yaw, pitch, roll, translation and size, by a three-dimensional head model.
    #[default]
    Full,
    /// Roll about the line of sight, translation and size, as Krinidis and Pitas do.
    Roll,
}

/// How IRISD0 of a neutral face is measured. The motion of the lids is scaled by it.
///
/// MPEG-4 defines IRISD0 by the opening of the lids, which the iris just fills. The height of Candide-3's iris boxes equals the opening
/// of its own face's eyes. On a person's face the springs move the boxes along, and they are some 0.6 of the opening high. Scaled by the
/// boxes, the lids of people therefore move 1.6 times too far.
///
/// ```
/// use grimace::normalize::{IrisdMode, NormalizeOptions};
///
/// // Of options that were written before there was a choice.
/// let earlier: NormalizeOptions = serde_json::from_str(r#"{"resample": "nearest", "size": "fapu"}"#)?;
/// assert_eq!((earlier.irisd, NormalizeOptions::default().irisd), (IrisdMode::Boxes, IrisdMode::Lids));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum IrisdMode {
    /// Opening of the lids ([`Fapus::measure`]).
    #[default]
    Lids,
    /// Height of the iris boxes, as in Table 2 of Candide-3's report ([`Fapus::of_nodes`]).
    Boxes,
}

impl IrisdMode {
    /// Value for options files written before this option existed.
    fn earlier() -> Self {
        Self::Boxes
    }

    /// Measures the FAPUs of an upright neutral face, y up.
    fn fapus(self, tables: &Tables, upright: &[Point2<f64>]) -> Result<Fapus, FapusError> {
        match self {
            Self::Lids => Fapus::measure(&tables.fapus, upright),
            Self::Boxes => Fapus::of_nodes(&tables.fapus, upright),
        }
    }
}

/// Options of the normalization.
///
/// ```
/// use grimace::normalize::{NormalizeOptions, PoseMode, Resample};
///
/// let options = NormalizeOptions { resample: Resample::Linear, ..NormalizeOptions::default() };
/// assert_eq!(options.pose, PoseMode::Full);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct NormalizeOptions {
    /// How frames are sampled; default: nearest.
    pub resample: Resample,
    /// How sizes are made equal; default: by FAPUs.
    pub size: SizeMode,
    /// Which head motion the pipeline removes; default: all. A [`Normalizer`] alone always removes roll, translation and size only: see
    /// [`PoseMode`].
    #[serde(default)]
    pub pose: PoseMode,
    /// How IRISD0 is measured; default: at the lids.
    #[serde(default = "IrisdMode::earlier")]
    pub irisd: IrisdMode,
}

impl Default for NormalizeOptions {
    fn default() -> Self {
        Self { resample: Resample::Nearest, size: SizeMode::Fapu, pose: PoseMode::Full, irisd: IrisdMode::Lids }
    }
}

/// Why a track cannot be normalized.
///
/// ```
/// use grimace::model::{DynamicExpressionModel, FrameExpressionModel};
/// use grimace::normalize::{NormalizeError, Normalizer};
///
/// let face = grimace::wireframe::Face::candide3();
/// let normalizer = Normalizer::new(&face.wireframe, &face.tables, Default::default())?;
/// let of_one_node = DynamicExpressionModel::new(vec![FrameExpressionModel::new(vec![[0.0, 0.0].into()]); 2])?;
/// let error = normalizer.normalize(&of_one_node).unwrap_err();
/// assert!(matches!(error, NormalizeError::NodeCount { found: 1, expected: 113 }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug, thiserror::Error)]
pub enum NormalizeError {
    /// The points that expressions do not move do not determine a similarity transform.
    #[error("the head's motion is not determined: {0}")]
    Rigid(#[from] SimilarityError),
    /// The FAPUs of the neutral frame cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
    /// The frames do not form a model.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The track has another wireframe.
    #[error("the track has {found} nodes, but the wireframe has {expected}")]
    NodeCount {
        /// Nodes of the track.
        found: usize,
        /// Nodes of the wireframe.
        expected: usize,
    },
}

/// The canonical neutral face: the frontal wireframe scaled so that ES0 = 1024 face units, and its FAPUs.
///
/// ```
/// use grimace::{normalize::Canonical, units::NodeId, wireframe::Face};
///
/// let face = Face::candide3();
/// let canonical = Canonical::new(&face.wireframe, &face.tables)?;
/// // The tip of the nose lies on the midline, the left corner of the mouth to its left.
/// assert_eq!(canonical.neutral.node(NodeId(5)).map(|node| node.x), Some(0.0));
/// assert!(canonical.neutral.node(NodeId(31)).is_some_and(|node| node.x > 0.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Canonical {
    /// Positions of all nodes, face units, y up.
    pub neutral: FrameExpressionModel<FaceUnit>,
    /// Its FAPU lengths, face units.
    pub fapus: Fapus,
}

impl Canonical {
    /// Computes the canonical neutral of a wireframe.
    ///
    /// # Errors
    /// [`FapusError`] when the wireframe has no FAPUs.
    pub fn new(wireframe: &Wireframe, tables: &Tables) -> Result<Self, FapusError> {
        let frontal = wireframe.frontal();
        let fapus = Fapus::measure(&tables.fapus, &frontal)?;
        let scale = CANONICAL_ES / fapus.es;
        let neutral = FrameExpressionModel::new(frontal.iter().map(|p| p * scale).collect());
        Ok(Self { neutral, fapus: fapus.scaled(scale) })
    }
}

/// Normalizes tracked models of one wireframe.
///
/// ```
/// use grimace::{normalize::Normalizer, track::{read_track, track_model}, wireframe::Face};
///
/// let Face { wireframe, tables } = Face::candide3();
/// let track = track_model(&read_track("fixtures/simulated/truth/S001_005.csv".as_ref())?)?;
/// let normalizer = Normalizer::new(&wireframe, &tables, Default::default())?;
/// let model = normalizer.normalize(&track)?;
/// // Every model starts from the same face, and this one smiles: the left corner of the mouth goes up.
/// assert_eq!(model.neutral(), &normalizer.canonical().neutral);
/// assert!(model.neutral_offsets(4)[31].y > 50.0);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Normalizer<'a> {
    wireframe: &'a Wireframe,
    tables: &'a Tables,
    canonical: Canonical,
    options: NormalizeOptions,
}

impl<'a> Normalizer<'a> {
    /// Creates a normalizer for a wireframe.
    ///
    /// # Errors
    /// [`FapusError`] when the wireframe has no FAPUs.
    pub fn new(wireframe: &'a Wireframe, tables: &'a Tables, options: NormalizeOptions) -> Result<Self, FapusError> {
        Ok(Self { wireframe, tables, canonical: Canonical::new(wireframe, tables)?, options })
    }

    /// Returns the wireframe and the tables that it was made with.
    pub(crate) fn face(&self) -> (&'a Wireframe, &'a Tables) {
        (self.wireframe, self.tables)
    }

    /// Returns the canonical neutral, the neutral frame of every normalized model.
    pub fn canonical(&self) -> &Canonical {
        &self.canonical
    }

    /// Returns all frames of a track upright, without head motion, y up, in pixels of the neutral frame.
    ///
    /// # Errors
    /// [`NormalizeError`].
    pub fn upright(&self, track: &DynamicExpressionModel<Px>) -> Result<Vec<Vec<Point2<f64>>>, NormalizeError> {
        let expected = self.wireframe.node_count();
        if track.node_count() != expected {
            return Err(NormalizeError::NodeCount { found: track.node_count(), expected });
        }
        orientation::upright(track, &self.wireframe.frontal(), self.tables)
    }

    /// Returns the units of the lids' FAPs on a tracked person's neutral face, given in pixels, y down.
    ///
    /// Falls back to the units of the canonical face if the given face cannot be turned upright.
    pub(crate) fn lid_units(&self, neutral: &[Point2<f64>]) -> LidUnits {
        let frontal = self.wireframe.frontal();
        let upright = (neutral.len() == frontal.len()).then(|| {
            let still = DynamicExpressionModel::new(vec![FrameExpressionModel::new(neutral.to_vec()); 2]).ok()?;
            orientation::upright(&still, &frontal, self.tables).ok()?.into_iter().next()
        });
        let units = |upright: Vec<Point2<f64>>| {
            let used = self.options.irisd.fapus(self.tables, &upright).ok()?;
            let lids = IrisdMode::Lids.fapus(self.tables, &upright).ok()?;
            let units = LidUnits::measure(&used, &upright);
            // Only then was a model scaled by IRISD0.
            Some(if self.options.size == SizeMode::Fapu { units.with_irisd(used.irisd, lids.irisd) } else { units })
        };
        upright.flatten().and_then(units).unwrap_or(LidUnits::CANONICAL)
    }

    /// Returns the normalized model of a track: five frames, upright, without translation, with canonical FAPUs.
    /// [`PoseMode`] describes how yaw and pitch are treated.
    ///
    /// # Errors
    /// [`NormalizeError`].
    pub fn normalize(&self, track: &DynamicExpressionModel<Px>) -> Result<DynamicExpressionModel<FaceUnit>, NormalizeError> {
        self.normalize_every_frame(&resample(track, FRAMES_PER_MODEL, self.options.resample)?)
    }

    /// As [`Normalizer::normalize`], for numbered frames, some of which may be missing: key frames are uniform in frame number.
    ///
    /// # Errors
    /// [`NormalizeError`].
    pub fn normalize_numbered(
        &self,
        track: &DynamicExpressionModel<Px>,
        numbers: &[u32],
    ) -> Result<DynamicExpressionModel<FaceUnit>, NormalizeError> {
        self.normalize_every_frame(&resample_at(track, numbers, FRAMES_PER_MODEL, self.options.resample)?)
    }

    /// As [`Normalizer::normalize`], but keeps all frames of the track.
    ///
    /// # Errors
    /// [`NormalizeError`].
    pub fn normalize_every_frame(
        &self,
        track: &DynamicExpressionModel<Px>,
    ) -> Result<DynamicExpressionModel<FaceUnit>, NormalizeError> {
        let upright = self.upright(track)?;
        size::equalize(&upright, self.tables, &self.canonical, self.wireframe, self.options)
    }
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use nalgebra::Vector2;
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::Similarity;

    /// Candide-3 in pixels, 100 px between the eyes. The mouth corners (31, 64) move by `smile` px out and up over `frames` frames; each
    /// frame is transformed by `view`.
    fn track(frames: usize, smile: f64, view: impl Fn(usize) -> Similarity) -> DynamicExpressionModel<Px> {
        let scale = 100.0 / 0.613;
        let frame = |m: usize| {
            let share = m as f64 / (frames - 1) as f64;
            let mut nodes: Vec<Point2<f64>> =
                Wireframe::candide3().vertices().iter().map(|v| Point2::new(v.x * scale, -v.y * scale)).collect();
            nodes[31] += Vector2::new(smile, -smile) * share;
            nodes[64] += Vector2::new(-smile, -smile) * share;
            FrameExpressionModel::new(nodes.iter().map(|p| view(m).apply(p)).collect())
        };
        DynamicExpressionModel::new((0..frames).map(frame).collect()).unwrap()
    }

    fn normalized(track: &DynamicExpressionModel<Px>) -> DynamicExpressionModel<FaceUnit> {
        let (w, t) = (Wireframe::candide3(), Tables::candide3());
        Normalizer::new(&w, &t, NormalizeOptions::default()).unwrap().normalize(track).unwrap()
    }

    #[test]
    fn a_smile_comes_out_in_face_units_with_y_up() {
        let model = normalized(&track(9, 5.0, |_| Similarity::identity()));
        assert_eq!(model.frame_count(), FRAMES_PER_MODEL);
        // 5 px of a face with ES0 = 100 px are 5 * 1024 / 100 = 51.2 face units; the FAPUs of this face are Candide's own.
        let offsets = model.neutral_offsets(4);
        assert_relative_eq!(offsets[31], Vector2::new(51.2, 51.2), epsilon = 1e-9);
        assert_relative_eq!(offsets[64], Vector2::new(-51.2, 51.2), epsilon = 1e-9);
        assert_relative_eq!(offsets[16], Vector2::zeros(), epsilon = 1e-9);
        // Frame 2 of 5 is frame 4 of 9: half the motion.
        assert_relative_eq!(model.neutral_offsets(2)[31].x, 25.6, epsilon = 1e-9);
    }

    #[test]
    fn a_nose_that_is_drawn_down_leaves_the_head_its_size() {
        let mut frames = track(2, 0.0, |_| Similarity::identity()).frames().to_vec();
        let mut nodes = frames[1].nodes().to_vec();
        // The lower edge of the nose's bone and the mouth corners, 5 % of the eye distance down.
        [92, 93, 94, 31, 64].iter().for_each(|&k: &usize| nodes[k].y += 5.0);
        frames[1] = FrameExpressionModel::new(nodes);
        let model = normalized(&DynamicExpressionModel::new(frames).unwrap());
        let offsets = model.neutral_offsets(4);
        // Eye corners, the sides of the face, the top of the head.
        for k in [20, 53, 23, 56, 29, 62, 0] {
            assert!(offsets[k].norm() < 1e-6, "node {k} moves by {}", offsets[k]);
        }
        assert!(offsets[31].y < -40.0);
    }

    #[test]
    fn a_still_face_has_no_offsets() {
        let model = normalized(&track(6, 0.0, |m| Similarity {
            scale: 1.0 + 0.01 * m as f64,
            angle: 0.02 * m as f64,
            translation: Vector2::new(m as f64, 2.0),
        }));
        for m in 0..FRAMES_PER_MODEL {
            assert!(model.neutral_offsets(m).iter().all(|v| v.norm() < 1e-9));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn roll_size_and_place_do_not_matter(angle in -0.5..0.5f64, scale in 0.2..5.0f64, x in -500.0..500.0f64, y in -500.0..500.0f64) {
            let plain = normalized(&track(7, 6.0, |_| Similarity::identity()));
            let seen = normalized(&track(7, 6.0, |_| Similarity { scale, angle, translation: Vector2::new(x, y) }));
            for (a, b) in plain.frames().iter().zip(seen.frames()) {
                for (p, q) in a.nodes().iter().zip(b.nodes()) {
                    prop_assert!((p - q).norm() < 1e-6);
                }
            }
        }

        #[test]
        fn normalizing_twice_equals_once(smile in -8.0..8.0f64) {
            let once = normalized(&track(5, smile, |_| Similarity::identity()));
            let as_pixels = |f: &FrameExpressionModel<FaceUnit>| {
                FrameExpressionModel::new(f.nodes().iter().map(|p| Point2::new(p.x, -p.y)).collect())
            };
            let twice = normalized(&DynamicExpressionModel::new(once.frames().iter().map(as_pixels).collect()).unwrap());
            for (a, b) in once.frames().iter().zip(twice.frames()) {
                for (p, q) in a.nodes().iter().zip(b.nodes()) {
                    prop_assert!((p - q).norm() < 1e-6);
                }
            }
        }
    }
}
