//! Whom an expression is put on: a neutral photograph and the wireframe on it.

use image::RgbImage;
use nalgebra::{Point2, Rotation2, Vector2};
use serde::{Deserialize, Serialize};

use super::{CloneError, SourceMotion, timing::Moment};
use crate::{
    fit::{Correspondence, FittedWireframe, validate_correspondences},
    geometry::Similarity,
    normalize::stable_nodes,
    pipeline::Workbench,
    sequence::MAX_SIDE,
    units::NodeId,
    warp::{NODE_COUNT, Texture, Warp},
    wireframe::Fapus,
};

/// How offsets are scaled from the source's face to the target's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Rescale {
    /// By the FAPUs of each node's region: a wide mouth smiles wider.
    #[default]
    Fapu,
    /// By the distance of the eyes alone.
    Uniform,
    /// Not at all: pixels are pixels (for comparison).
    None,
}

/// Least distance of the eyes, px.
pub const LEAST_EYE_DISTANCE: f64 = 6.0;

/// One half of the face wider than the other by more than this is a face turned away.
const MAX_HALF_RATIO: f64 = 1.9;
/// Depth of the midline before the outer eye corners over half the face's width there (Candide-3: nose bone against eye corners).
const MIDLINE_DEPTH: f64 = 0.45;

/// A neutral photograph, ready to be moved.
#[derive(Clone, Debug)]
pub struct Target {
    /// Name for files and captions.
    pub name: String,
    /// The photograph.
    pub picture: RgbImage,
    /// The wireframe on it.
    pub fitted: FittedWireframe,
    /// Its FAPUs, px.
    pub fapus: Fapus,
    /// Angle of the face's up against the image's up, radians, towards the image's left (y up).
    pub roll: f64,
    texture: Texture,
    warp: Warp,
    stable: Vec<usize>,
}

impl Target {
    /// Fits the wireframe to a photograph and prepares it.
    ///
    /// # Errors
    /// [`CloneError`] for marks that do not fit a frontal face, a face too small, a picture too large, or another wireframe.
    pub fn new(name: &str, picture: RgbImage, marks: &[Correspondence], bench: &Workbench) -> Result<Self, CloneError> {
        let (width, height) = picture.dimensions();
        if width.max(height) > MAX_SIDE {
            return Err(CloneError::TooLarge { width, height, most: MAX_SIDE });
        }
        validate_correspondences(marks, width, height)?;
        let fitted = bench.fitter().fit(&bench.wireframe, marks)?;
        Self::from_fit(name, picture, fitted, bench)
    }

    /// A target whose wireframe is already there.
    ///
    /// # Errors
    /// As [`Target::new`].
    pub fn from_fit(name: &str, picture: RgbImage, fitted: FittedWireframe, bench: &Workbench) -> Result<Self, CloneError> {
        let nodes = fitted.model.nodes();
        if nodes.len() != NODE_COUNT {
            return Err(CloneError::Topology { what: name.to_owned(), found: nodes.len(), expected: NODE_COUNT });
        }
        let stable = stable_nodes(&bench.tables, nodes.len());
        let frontal = bench.wireframe.frontal();
        let pick = |points: &[Point2<f64>]| stable.iter().map(|&k| points[k]).collect::<Vec<_>>();
        let y_up: Vec<Point2<f64>> = nodes.iter().map(|p| Point2::new(p.x, -p.y)).collect();
        let from_face = Similarity::fit(&pick(&frontal), &pick(&y_up), None).map_err(|_| crate::warp::WarpError::NoEyes)?;
        let unroll = Rotation2::new(-from_face.angle);
        let upright: Vec<Point2<f64>> = y_up.iter().map(|p| unroll * p).collect();
        let fapus = Fapus::measure(&bench.tables.fapus, &upright)
            .map_err(|source| CloneError::Fapus { what: "the target's neutral face", source })?;
        check_frontal(&upright)?;
        if fapus.es < LEAST_EYE_DISTANCE {
            return Err(CloneError::TooSmall { eye_distance: fapus.es, least: LEAST_EYE_DISTANCE });
        }
        let warp = Warp::new(nodes)?;
        let texture = Texture::new(&picture);
        Ok(Self { name: name.to_owned(), picture, fapus, roll: from_face.angle, texture, warp, stable, fitted })
    }

    /// The photograph as a texture.
    pub fn texture(&self) -> &Texture {
        &self.texture
    }

    /// The photograph's warp.
    pub fn warp(&self) -> &Warp {
        &self.warp
    }

    /// Where the target's nodes are asked to be at a moment of a source's motion, px.
    ///
    /// Every neutral offset is scaled, along the face's x and y, by target over source FAPU of its node's region times `emphasis`,
    /// turned by the target's roll, and added to the target's neutral node. With `head`, the source's head motion is added, in the
    /// proportions of the two faces.
    pub fn nodes_at(
        &self,
        source: &SourceMotion,
        moment: &Moment,
        rescale: Rescale,
        emphasis: f64,
        head: bool,
        bench: &Workbench,
    ) -> Vec<Point2<f64>> {
        let roll = Rotation2::new(self.roll);
        let ratio = |fapu| match (self.fapus.length(fapu), source.fapus.length(fapu)) {
            (Some(target), Some(source)) => target / source,
            _ => self.fapus.es / source.fapus.es,
        };
        let neutral = self.fitted.model.nodes();
        let mut nodes: Vec<Point2<f64>> = neutral
            .iter()
            .zip(&moment.offsets)
            .enumerate()
            .map(|(k, (p, offset))| {
                let scale = match rescale {
                    Rescale::Fapu => {
                        let (x, y) = bench.tables.node_fapus(NodeId(k as u16));
                        Vector2::new(ratio(x), ratio(y))
                    }
                    Rescale::Uniform => Vector2::repeat(self.fapus.es / source.fapus.es),
                    Rescale::None => Vector2::repeat(1.0),
                };
                let up = roll * (offset.component_mul(&scale) * emphasis);
                p + Vector2::new(up.x, -up.y)
            })
            .collect();
        self.round_lower_lip(&mut nodes);
        if head && let Some((_, first)) = source.frames.first() {
            let pick = |points: &[Point2<f64>]| self.stable.iter().map(|&k| points[k]).collect::<Vec<_>>();
            if let Ok(target_from_source) = Similarity::fit(&pick(first), &pick(neutral), None) {
                let motion = target_from_source.after(&moment.head).after(&target_from_source.inverse());
                nodes.iter_mut().for_each(|p| *p = motion.apply(p));
            }
        }
        nodes
    }
}

impl Target {
    /// The middle of the inner lower lip opens at least as far as the mean of the points beside it. A median over people, and a tracker
    /// on lips that part, may have it the other way round; no mouth does.
    fn round_lower_lip(&self, nodes: &mut [Point2<f64>]) {
        let down = self.warp.down();
        let neutral = self.fitted.model.nodes();
        let opened = |n: usize| (nodes[n] - neutral[n]).dot(&down);
        let missing = (opened(83) + opened(84)) / 2.0 - opened(40);
        if missing > 0.0 && opened(83) + opened(84) > 0.0 {
            nodes[40] += down * missing;
        }
    }
}

/// Refuses a face that is turned away: from the front both halves of the face are about equally wide, at the eyes and at the mouth.
fn check_frontal(upright: &[Point2<f64>]) -> Result<(), CloneError> {
    let x = |n: usize| upright[n].x;
    // Outer eye corners against the bone of the nose, mouth corners against the lips' middle.
    let eyes = (x(20) - x(94), x(94) - x(53));
    let mouth = (x(31) - x(7), x(7) - x(64));
    let widths = (eyes.0 + mouth.0, eyes.1 + mouth.1);
    let ratio = widths.0.max(widths.1) / widths.0.min(widths.1).max(1e-9);
    if widths.0 <= 0.0 || widths.1 <= 0.0 || ratio > MAX_HALF_RATIO {
        // The midline lies before the corners: turned by a, the halves are cos a -+ d sin a.
        let share = ((ratio - 1.0) / (ratio + 1.0)).min(1.0);
        let degrees = (share / MIDLINE_DEPTH).atan().to_degrees();
        return Err(CloneError::Profile { degrees, ratio: ratio.min(99.0) });
    }
    Ok(())
}
