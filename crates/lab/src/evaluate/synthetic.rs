//! Synthetic models with known truth, in any number: one smile of Candide-3's action units, performed by different people.
//!
//! A person's smile has a strength (lognormal), a pace (the timing of the motion), an asymmetry, and an independent error at every node of
//! every frame. Studies of tests between groups and of statistics on very many models use them.

use nalgebra::{Point2, Vector2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal, StudentT};
use serde::{Deserialize, Serialize};

use grimace::internal::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    normalize::{CANONICAL_ES, FRAMES_PER_MODEL},
    statistics::distance::DisplacementFields,
    units::FaceUnit,
    wireframe::{Fapus, FapusError, Tables, Wireframe},
};

/// Action units of the smile, with their strengths.
const SMILE: [(&str, f64); 4] =
    [("Lip stretcher", 0.7), ("Lip corner depressor", -0.7), ("Lid tightener", 0.5), ("Jaw drop", 0.15)];

/// Standard deviation of the logarithm of a person's strength.
const STRENGTH_SD: f64 = 0.35;
/// Standard deviation of the logarithm of a person's pace.
const PACE_SD: f64 = 0.25;
/// Standard deviation of the difference between a person's two halves, as a share of the motion.
const ASYMMETRY_SD: f64 = 0.15;
/// Standard deviation of every coordinate of every node in every frame, face units.
const NOISE_SD: f64 = 4.0;

/// Distribution of the differences between people in a population.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Spread {
    /// Strength lognormal, errors normal.
    #[default]
    Smile,
    /// Logarithms of strength and pace, and errors, from Student's t with 3 degrees of freedom.
    HeavyTails,
    /// One person in eight makes the opposite expression.
    Mixture,
    /// Half of the people smile half as strongly, the other half one and a half times as strongly.
    Clusters,
}

impl Spread {
    /// All distributions.
    pub const ALL: [Self; 4] = [Self::Smile, Self::HeavyTails, Self::Mixture, Self::Clusters];

    /// Returns the name in tables and on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::Smile => "smile",
            Self::HeavyTails => "heavy-tails",
            Self::Mixture => "mixture",
            Self::Clusters => "clusters",
        }
    }
}

/// Degrees of freedom of the heavy tails.
const TAIL_FREEDOM: f64 = 3.0;
/// Share of people in a mixture who make the opposite expression.
const OPPOSITE_SHARE: f64 = 0.125;
/// Strengths of the two clusters.
const CLUSTER_STRENGTHS: [f64; 2] = [0.5, 1.5];
/// Largest magnitude of the logarithm of strength or pace: a factor of about 20.
const MOST_LOGARITHM: f64 = 3.0;

/// A population of synthetic people.
#[derive(Clone, Debug)]
pub struct SyntheticPeople {
    wireframe: Wireframe,
    neutral: Vec<Point2<f64>>,
    apex: Vec<Vector2<f64>>,
    seed: u64,
    spread: Spread,
}

/// Returns a uniform random number from 0 to 1 for a person; it does not depend on the seed of the population.
fn uniform(person: u64) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(person);
    random.random()
}

impl SyntheticPeople {
    /// Makes the population of a seed, with the distribution [`Spread::Smile`].
    ///
    /// # Errors
    /// [`FapusError`] never, because Candide-3 has FAPUs.
    pub fn new(seed: u64) -> Result<Self, FapusError> {
        let wireframe = Wireframe::candide3();
        let fapus = Fapus::measure(&Tables::candide3().fapus, &wireframe.frontal())?;
        let scale = CANONICAL_ES / fapus.es;
        let neutral: Vec<Point2<f64>> = wireframe.frontal().iter().map(|p| p * scale).collect();
        let mut apex = vec![Vector2::zeros(); neutral.len()];
        for (name, intensity) in SMILE {
            for unit in wireframe.action_units().iter().filter(|unit| unit.name.starts_with(name)) {
                unit.offsets.iter().for_each(|(node, offset)| apex[node.index()] += offset.xy() * intensity * scale);
            }
        }
        Ok(Self { wireframe, neutral, apex, seed, spread: Spread::Smile })
    }

    /// Sets the distribution of the differences between people.
    #[must_use]
    pub fn with_spread(mut self, spread: Spread) -> Self {
        self.spread = spread;
        self
    }

    /// Returns the wireframe of the models.
    pub fn wireframe(&self) -> &Wireframe {
        &self.wireframe
    }

    /// Returns the positions of all nodes in all frames of one person's smile, `strength` times as strong as the person's own.
    pub fn frames(&self, person: u64, strength: f64) -> Vec<Vec<Point2<f64>>> {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream(person);
        let tails = (self.spread == Spread::HeavyTails).then(|| StudentT::new(TAIL_FREEDOM).ok()).flatten();
        let mut gauss = || -> f64 {
            match tails {
                Some(tails) => tails.sample(&mut random),
                None => StandardNormal.sample(&mut random),
            }
        };
        let exp = |logarithm: f64| logarithm.clamp(-MOST_LOGARITHM, MOST_LOGARITHM).exp();
        let kind = match self.spread {
            Spread::Mixture if uniform(person) < OPPOSITE_SHARE => -1.0,
            Spread::Smile | Spread::HeavyTails | Spread::Mixture => 1.0,
            Spread::Clusters => CLUSTER_STRENGTHS[usize::from(uniform(person) < 0.5)],
        };
        let strength = kind * strength * exp(STRENGTH_SD * gauss());
        let pace = exp(PACE_SD * gauss());
        let asymmetry = ASYMMETRY_SD * gauss();
        let mut frames = vec![self.neutral.clone()];
        for m in 1..FRAMES_PER_MODEL {
            let part = strength * (m as f64 / (FRAMES_PER_MODEL - 1) as f64).powf(pace);
            let mut nodes: Vec<Point2<f64>> = self
                .neutral
                .iter()
                .zip(&self.apex)
                .map(|(p, offset)| {
                    let side = 1.0 + asymmetry * p.x.signum();
                    p + offset * part * side + Vector2::new(NOISE_SD * gauss(), NOISE_SD * gauss())
                })
                .collect();
            self.wireframe.place_followers(&mut nodes);
            frames.push(nodes);
        }
        frames
    }

    /// Returns the displacement fields of [`SyntheticPeople::frames`].
    pub fn fields(&self, person: u64, strength: f64) -> DisplacementFields {
        let frames = self.frames(person, strength);
        let live = self.wireframe.live_nodes();
        let field = |pair: &[Vec<Point2<f64>>]| live.iter().map(|n| pair[1][n.index()] - pair[0][n.index()]).collect::<Vec<_>>();
        DisplacementFields::from_vectors(live.len(), &frames.windows(2).flat_map(field).collect::<Vec<_>>())
    }

    /// Returns the model of [`SyntheticPeople::frames`].
    ///
    /// # Errors
    /// [`grimace::internal::model::ModelError`] for a strength that is not finite.
    pub fn model(
        &self,
        person: u64,
        strength: f64,
    ) -> Result<DynamicExpressionModel<FaceUnit>, grimace::internal::model::ModelError> {
        DynamicExpressionModel::new(self.frames(person, strength).into_iter().map(FrameExpressionModel::new).collect())
    }
}
