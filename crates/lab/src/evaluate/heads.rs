//! Heads of a dense face model, reduced to 68 landmarks, and the perspective camera that sees them.

use std::path::Path;

use nalgebra::{Point2, Vector3};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::EvaluateError;
use grimace::internal::{pose::HeadPose, synthesis::read_dense_faces};

/// Distance between the pupils in the pictures, px.
const ES_PX: f64 = 110.0;
/// Centre of the pictures, px.
const MIDDLE: Point2<f64> = Point2::new(320.0, 240.0);

/// Neutral face, identity modes and expression shapes of a face model, at its landmarks.
pub(super) struct Faces {
    pub neutral: Vec<Vector3<f64>>,
    identity: Vec<Vec<Vector3<f64>>>,
    names: Vec<String>,
    shapes: Vec<Vec<Vector3<f64>>>,
}

impl Faces {
    /// Reads a dense face model from its folder.
    pub fn read(folder: &Path) -> Result<Self, EvaluateError> {
        let dense = read_dense_faces(folder, usize::MAX).map_err(|e| EvaluateError::Synthesis(e.into()))?;
        let pick = |all: &[[f32; 3]]| -> Vec<Vector3<f64>> {
            let at = |&v: &u32| Vector3::from(all.get(v as usize).copied().unwrap_or_default().map(f64::from));
            dense.landmarks.iter().map(at).collect()
        };
        Ok(Self {
            neutral: pick(&dense.neutral),
            identity: dense.identity.iter().map(|mode| pick(mode)).collect(),
            names: dense.expressions.iter().map(|(name, _)| name.clone()).collect(),
            shapes: dense.expressions.iter().map(|(_, shape)| pick(shape)).collect(),
        })
    }

    /// Returns the sum of shapes, each named by its stem with a strength; left and right shapes are both used.
    pub fn expression(&self, recipe: &[(&str, f64)]) -> Vec<Vector3<f64>> {
        let mut sum = vec![Vector3::zeros(); self.neutral.len()];
        for (stem, strength) in recipe {
            for (name, shape) in self.names.iter().zip(&self.shapes) {
                if name == stem || name.strip_suffix("_L") == Some(stem) || name.strip_suffix("_R") == Some(stem) {
                    sum.iter_mut().zip(shape).for_each(|(s, d)| *s += d * *strength);
                }
            }
        }
        sum
    }

    /// Returns heads with normal weights of standard deviation `spread` on the identity modes from `first_mode` on.
    pub fn heads(&self, count: usize, first_mode: usize, spread: f64, random: &mut ChaCha8Rng) -> Vec<Vec<Vector3<f64>>> {
        let mut one = || {
            let mut head = self.neutral.clone();
            for mode in self.identity.iter().skip(first_mode) {
                let z: f64 = StandardNormal.sample(random);
                head.iter_mut().zip(mode).for_each(|(x, d)| *x += d * (z * spread));
            }
            head
        };
        (0..count).map(|_| one()).collect()
    }
}

/// A perspective camera that sees landmarks with noise.
pub(super) struct Camera<'a> {
    /// Distance of the camera from the middle of the head, px; the eyes of an unturned head are 110 px apart.
    pub distance: f64,
    /// Standard deviation of the noise, px.
    pub noise_px: f64,
    pub random: &'a mut ChaCha8Rng,
}

impl Camera<'_> {
    /// Returns the image positions of the landmarks `shape`, px, turned by yaw, pitch and roll (degrees) about the middle of `neutral`.
    pub fn see(&mut self, neutral: &[Vector3<f64>], shape: &[Vector3<f64>], [yaw, pitch, roll]: [f64; 3]) -> Vec<Point2<f64>> {
        let middle = neutral.iter().sum::<Vector3<f64>>() / neutral.len().max(1) as f64;
        let eye = |from: usize| neutral[from..from + 6].iter().sum::<Vector3<f64>>() / 6.0;
        let scale = ES_PX / (eye(42) - eye(36)).norm();
        let rotation = HeadPose::rotation_of(yaw, pitch, roll);
        let mut noise = || {
            let z: f64 = StandardNormal.sample(self.random);
            z * self.noise_px
        };
        let mut seen = Vec::with_capacity(shape.len());
        for x in shape {
            let y = rotation * (x - middle) * scale;
            let near = self.distance / (self.distance - y.z);
            seen.push(Point2::new(MIDDLE.x + y.x * near + noise(), MIDDLE.y - y.y * near + noise()));
        }
        seen
    }
}
