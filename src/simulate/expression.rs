//! The emotions as sums of Candide-3's motion units, and how each person performs them.

use std::{fmt, str::FromStr};

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};
use serde::{Serialize, Serializer};

use super::random::{Purpose, generator};
use crate::{
    units::NodeId,
    wireframe::{Fapus, UnitKind, Wireframe},
};

/// An emotion that can be simulated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Emotion {
    /// Brows down and together, lids tight, lips pressed.
    Anger,
    /// One corner of the mouth tightened and raised.
    Contempt,
    /// Nose wrinkled, upper lip raised.
    Disgust,
    /// Inner brows up and together, upper lids up, lips stretched and parted.
    Fear,
    /// Corners of the mouth out and up, cheeks lifted.
    Happiness,
    /// Inner brows up, corners of the mouth down.
    Sadness,
    /// Brows up, eyes wide, jaw dropped.
    Surprise,
}

/// A text that names no emotion that can be simulated.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is not an emotion that can be simulated; choose from anger, contempt, disgust, fear, happiness, sadness, surprise"
)]
pub struct ParseEmotionError(pub String);

impl Emotion {
    /// All seven, in the order of the emotion codes 1 to 7 of the extended Cohn-Kanade database.
    pub const ALL: [Self; 7] =
        [Self::Anger, Self::Contempt, Self::Disgust, Self::Fear, Self::Happiness, Self::Sadness, Self::Surprise];

    /// The six basic emotions.
    pub const BASIC: [Self; 6] = [Self::Anger, Self::Disgust, Self::Fear, Self::Happiness, Self::Sadness, Self::Surprise];

    /// Label as in a manifest.
    pub fn label(self) -> &'static str {
        match self {
            Self::Anger => "anger",
            Self::Contempt => "contempt",
            Self::Disgust => "disgust",
            Self::Fear => "fear",
            Self::Happiness => "happiness",
            Self::Sadness => "sadness",
            Self::Surprise => "surprise",
        }
    }

    /// Emotion code 1 to 7 of the extended Cohn-Kanade database; also the number of the simulated sequence.
    pub fn code(self) -> u8 {
        self as u8 + 1
    }
}

impl fmt::Display for Emotion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.label())
    }
}

impl FromStr for Emotion {
    type Err = ParseEmotionError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|e| e.label() == text).ok_or_else(|| ParseEmotionError(text.to_owned()))
    }
}

impl Serialize for Emotion {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.label())
    }
}

/// A unit of Candide-3's animation part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExpressionUnit {
    /// Action unit vector with its number in the list of Rydfalk. The weight is Candide's parameter, 1 for full strength.
    Auv(u16),
    /// MPEG-4 FAP. The weight is a FAP value divided by 1024: the motion in the subject's own FAPU length.
    Fap(u16),
}

/// One row of the table of expressions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExpressionRow {
    /// The emotion.
    pub emotion: Emotion,
    /// The unit that takes part in it.
    pub unit: ExpressionUnit,
    /// Its weight at the apex of an average person.
    pub weight: f64,
}

const fn row(emotion: Emotion, unit: ExpressionUnit, weight: f64) -> ExpressionRow {
    ExpressionRow { emotion, unit, weight }
}

/// The expressions. Action unit vectors carry what they can. Where Candide-3 has none, FAPs stand in: inner brow raise (FACS AU1:
/// FAP 31, 32), cheek raise (AU6: 41, 42), brows together (AU4: 37, 38), lips parted (AU25: 4, 5, 8 to 11). A smile's raised
/// corners (AU12) are the lip corner depressor (AUV 14) with a negative weight.
///
/// AUV: 0 upper lip raiser, 2 lip stretcher, 3 brow lowerer, 5 outer brow raiser, 6 eyes closed, 7 lid tightener, 8 nose wrinkler,
/// 9 lip presser, 10 upper lid raiser, 11 jaw drop, 14 lip corner depressor.
#[rustfmt::skip]
pub const EXPRESSIONS: &[ExpressionRow] = {
    use Emotion::{Anger, Contempt, Disgust, Fear, Happiness, Sadness, Surprise};
    use ExpressionUnit::{Auv, Fap};
    &[
        row(Anger, Auv(3), 0.80),
        row(Anger, Auv(7), 0.30),
        row(Anger, Auv(9), 0.90),
        row(Anger, Auv(10), 0.35),
        row(Anger, Auv(14), 0.22),
        row(Anger, Fap(37), 0.02),
        row(Anger, Fap(38), 0.02),
        row(Anger, Fap(61), 0.03),
        row(Anger, Fap(62), 0.03),
        row(Contempt, Auv(7), 0.15),
        row(Contempt, Auv(9), 0.35),
        row(Contempt, Fap(6), 0.05),
        row(Contempt, Fap(12), 0.26),
        row(Contempt, Fap(53), 0.06),
        row(Contempt, Fap(59), 0.36),
        row(Contempt, Fap(55), -0.05),
        row(Contempt, Fap(41), 0.05),
        row(Contempt, Fap(35), 0.06),
        row(Disgust, Auv(0), 0.75),
        row(Disgust, Auv(3), 0.35),
        row(Disgust, Auv(7), 0.35),
        row(Disgust, Auv(8), 0.85),
        row(Disgust, Auv(14), 0.20),
        row(Disgust, Fap(41), 0.10),
        row(Disgust, Fap(42), 0.10),
        row(Disgust, Fap(61), 0.04),
        row(Disgust, Fap(62), 0.04),
        row(Fear, Auv(2), 0.75),
        row(Fear, Auv(5), 0.30),
        row(Fear, Auv(10), 0.95),
        row(Fear, Auv(11), 0.22),
        row(Fear, Auv(14), 0.15),
        row(Fear, Fap(31), 0.28),
        row(Fear, Fap(32), 0.28),
        row(Fear, Fap(33), 0.12),
        row(Fear, Fap(34), 0.12),
        row(Fear, Fap(37), 0.055),
        row(Fear, Fap(38), 0.055),
        row(Happiness, Auv(2), 0.95),
        row(Happiness, Auv(7), 0.28),
        row(Happiness, Auv(11), 0.14),
        row(Happiness, Auv(14), -0.82),
        row(Happiness, Auv(0), 0.35),
        row(Happiness, Fap(41), 0.17),
        row(Happiness, Fap(42), 0.17),
        row(Happiness, Fap(21), 0.10),
        row(Happiness, Fap(22), 0.10),
        row(Happiness, Fap(61), 0.05),
        row(Happiness, Fap(62), 0.05),
        row(Sadness, Auv(14), 0.65),
        row(Sadness, Auv(7), 0.16),
        row(Sadness, Auv(9), 0.30),
        row(Sadness, Fap(31), 0.30),
        row(Sadness, Fap(32), 0.30),
        row(Sadness, Fap(33), 0.02),
        row(Sadness, Fap(34), 0.02),
        row(Sadness, Fap(35), -0.06),
        row(Sadness, Fap(36), -0.06),
        row(Sadness, Fap(37), 0.04),
        row(Sadness, Fap(38), 0.04),
        row(Sadness, Fap(18), 0.25),
        row(Surprise, Auv(5), 0.90),
        row(Surprise, Auv(10), 1.00),
        row(Surprise, Auv(11), 0.72),
        row(Surprise, Fap(31), 0.24),
        row(Surprise, Fap(32), 0.24),
        row(Surprise, Fap(3), 0.30),
        row(Surprise, Fap(53), -0.05),
        row(Surprise, Fap(54), -0.05),
        row(Surprise, Fap(6), -0.05),
        row(Surprise, Fap(7), -0.05),
    ]
};

/// Spread of a person's strength over emotions, and of one unit within an expression (standard deviations, factor on the weight).
const STRENGTH_SD: f64 = 0.10;
const UNIT_SD: f64 = 0.12;
/// Standard deviation of the asymmetry: the left side moves by `1 + a`, the right by `1 - a`.
const ASYMMETRY_SD: f64 = 0.05;
/// Factors are kept within these many standard deviations.
const LIMIT_SD: f64 = 2.0;
/// Distance from the midline, in model units, over which the asymmetry grows from nothing to its full size.
const ASYMMETRY_RAMP: f64 = 0.2;

/// The eight nodes of the iris boxes. Eyeballs are rigid: lids and noses do not squeeze them, although two action unit vectors
/// of Candide-3 list them.
const EYEBALL: std::ops::RangeInclusive<u16> = 67..=74;

/// The offset from neutral of every node at the apex of one person's expression, in model units of face space.
///
/// Weights are those of [`EXPRESSIONS`] times `strength`, times seeded factors of this person and emotion, so that the same
/// emotion looks different on everybody. A unit that the wireframe lacks moves nothing.
pub fn apex_offsets(
    wireframe: &Wireframe,
    fapus: &Fapus,
    emotion: Emotion,
    strength: f64,
    seed: u64,
    subject: u32,
) -> Vec<Vector3<f64>> {
    let mut random = generator(seed, Purpose::Expression, subject, emotion.code(), 0);
    let mut normal = |sd: f64| -> f64 {
        let z: f64 = StandardNormal.sample(&mut random);
        z.clamp(-LIMIT_SD, LIMIT_SD) * sd
    };
    let strength = strength * (1.0 + normal(STRENGTH_SD));
    let asymmetry = normal(ASYMMETRY_SD);
    let mut offsets = vec![Vector3::zeros(); wireframe.node_count()];
    // Left and right FAPs of a pair follow each other in the table: they share one factor, so only `asymmetry` parts the sides.
    let mut pair_factor: Option<(u16, f64)> = None;
    for row in EXPRESSIONS.iter().filter(|r| r.emotion == emotion) {
        let factor = match (row.unit, pair_factor) {
            (ExpressionUnit::Fap(number), Some((previous, factor))) if number == previous + 1 => factor,
            _ => 1.0 + normal(UNIT_SD),
        };
        pair_factor = if let ExpressionUnit::Fap(number) = row.unit { Some((number, factor)) } else { None };
        let Some((unit, length)) = find_unit(wireframe, fapus, row.unit) else { continue };
        for &(node, offset) in &wireframe.action_units()[unit].offsets {
            if !EYEBALL.contains(&node.0) {
                let side = (wireframe.vertices()[node.index()].x / ASYMMETRY_RAMP).clamp(-1.0, 1.0);
                offsets[node.index()] += offset * (row.weight * strength * factor * length * (1.0 + asymmetry * side));
            }
        }
    }
    keep_lips_apart(wireframe, &mut offsets);
    offsets
}

/// Index of the unit, and the length in model units of one unit of its weight.
fn find_unit(wireframe: &Wireframe, fapus: &Fapus, unit: ExpressionUnit) -> Option<(usize, f64)> {
    wireframe.action_units().iter().enumerate().find_map(|(index, candidate)| match (unit, &candidate.kind) {
        (ExpressionUnit::Auv(wanted), UnitKind::Action { number }) if wanted == *number => Some((index, 1.0)),
        (ExpressionUnit::Fap(wanted), UnitKind::Fap { number, fapu }) if wanted == *number => {
            Some((index, fapu.and_then(|fapu| fapus.length(fapu)).unwrap_or(1.0)))
        }
        _ => None,
    })
}

/// Inner upper lip nodes with their lower twins.
const LIP_TWINS: [(u16, u16); 3] = [(87, 40), (81, 83), (82, 84)];

/// Lips touch but do not pass through each other: where an upper inner lip node would end below its lower twin, both move to the middle.
fn keep_lips_apart(wireframe: &Wireframe, offsets: &mut [Vector3<f64>]) {
    for (upper, lower) in LIP_TWINS.map(|(u, l)| (NodeId(u).index(), NodeId(l).index())) {
        let gap = (wireframe.vertices()[upper].y + offsets[upper].y) - (wireframe.vertices()[lower].y + offsets[lower].y);
        if gap < 0.0 {
            offsets[upper].y -= gap / 2.0;
            offsets[lower].y += gap / 2.0;
        }
    }
}
