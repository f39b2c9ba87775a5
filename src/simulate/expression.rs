//! The emotions as sums of Candide-3's motion units, and how each person performs them.

use std::{fmt, str::FromStr};

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};
use serde::{Serialize, Serializer};

use super::random::{Purpose, generator};
use crate::{
    fap::{FapFrame, FapNumber, FapSequence},
    units::NodeId,
    wireframe::{Fapu, Fapus, UnitKind, Wireframe},
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
/// FAP 31, 32), cheek raise (AU6: 41, 42; 39, 40 make room for the smile), brows together (AU4: 37, 38), lips parted (AU25: 4, 5, 8 to 11). A smile's raised
/// corners (AU12) are the lip corner depressor (AUV 14) with a negative weight.
///
/// AUV: 0 upper lip raiser, 2 lip stretcher, 3 brow lowerer, 5 outer brow raiser, 6 eyes closed, 7 lid tightener, 8 nose wrinkler,
/// 9 lip presser, 10 upper lid raiser, 11 jaw drop, 14 lip corner depressor.
#[rustfmt::skip]
pub const EXPRESSIONS: &[ExpressionRow] = {
    use Emotion::{Anger, Contempt, Disgust, Fear, Happiness, Sadness, Surprise};
    use ExpressionUnit::{Auv, Fap};
    &[
        row(Anger, Auv(3), 0.50),
        row(Anger, Auv(7), 0.30),
        row(Anger, Auv(9), 0.90),
        row(Anger, Auv(10), 0.35),
        row(Anger, Auv(14), 0.22),
        row(Anger, Fap(31), -0.07),
        row(Anger, Fap(32), -0.07),
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
        row(Disgust, Auv(8), 0.70),
        row(Disgust, Auv(14), 0.20),
        row(Disgust, Fap(41), 0.10),
        row(Disgust, Fap(42), 0.10),
        row(Disgust, Fap(61), 0.04),
        row(Disgust, Fap(62), 0.04),
        row(Disgust, Fap(63), 0.07),
        row(Fear, Auv(2), 0.75),
        row(Fear, Auv(5), 0.30),
        row(Fear, Auv(10), 0.75),
        row(Fear, Auv(11), 0.22),
        row(Fear, Auv(14), 0.15),
        row(Fear, Fap(31), 0.28),
        row(Fear, Fap(32), 0.28),
        row(Fear, Fap(33), 0.12),
        row(Fear, Fap(34), 0.12),
        row(Fear, Fap(37), 0.055),
        row(Fear, Fap(38), 0.055),
        row(Happiness, Auv(2), 0.86),
        row(Happiness, Auv(7), 0.28),
        row(Happiness, Auv(11), 0.14),
        row(Happiness, Auv(14), -0.74),
        row(Happiness, Auv(0), 0.35),
        row(Happiness, Fap(39), 0.07),
        row(Happiness, Fap(40), 0.07),
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
        row(Surprise, Auv(10), 0.80),
        row(Surprise, Auv(11), 0.78),
        row(Surprise, Auv(14), 0.15),
        row(Surprise, Fap(31), 0.24),
        row(Surprise, Fap(32), 0.24),
        row(Surprise, Fap(3), 0.30),
        row(Surprise, Fap(53), -0.08),
        row(Surprise, Fap(54), -0.08),
        row(Surprise, Fap(6), -0.07),
        row(Surprise, Fap(7), -0.07),
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

/// The forehead's node between the brows, the brows' inner and upper nodes, and the share of their rise that it takes: raised
/// brows would otherwise push their skin over it, as no unit of Candide-3 moves it.
const FOREHEAD: usize = 2;
const BROWS: [usize; 4] = [16, 17, 49, 50];
const FOREHEAD_SHARE: f64 = 0.5;

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
    settle_offsets(wireframe, &mut offsets);
    offsets
}

/// The offset from neutral of every node under the FAP values of a frame, in model units of face space: Candide-3's own units for
/// FAPs, in the subject's FAPUs. FAPs without such a unit, angles among them, move nothing ([`faps_without_unit`]); where only the inner
/// or the outer edge of a lip has a FAP, the other edge moves with it.
pub fn fap_offsets(wireframe: &Wireframe, fapus: &Fapus, frame: &FapFrame) -> Vec<Vector3<f64>> {
    let mut offsets = vec![Vector3::zeros(); wireframe.node_count()];
    for unit in wireframe.action_units() {
        let Some((fap, length)) = fap_of(&unit.kind).and_then(|(fap, fapu)| Some((fap, fapus.length(fapu)?))) else { continue };
        let Some(value) = frame.value(fap).or_else(|| frame.value(lip_twin(fap)?)) else { continue };
        for &(node, offset) in &unit.offsets {
            if !EYEBALL.contains(&node.0) {
                offsets[node.index()] += offset * (value / f64::from(FAPU_PARTS) * length);
            }
        }
    }
    offsets
}

/// FAPs that a sequence sets and that move nothing in [`fap_offsets`], ascending.
pub fn faps_without_unit(wireframe: &Wireframe, faps: &FapSequence) -> Vec<FapNumber> {
    let is_length = |kind: &UnitKind| fap_of(kind).filter(|(_, fapu)| *fapu != Fapu::Au).map(|(fap, _)| fap);
    let known: Vec<FapNumber> = wireframe.action_units().iter().filter_map(|unit| is_length(&unit.kind)).collect();
    faps.set_faps().into_iter().filter(|fap| !known.contains(fap)).collect()
}

/// The FAP that moves the other edge of a lip alike: 4 to 13 inner, 51 to 60 outer.
fn lip_twin(fap: FapNumber) -> Option<FapNumber> {
    const APART: u8 = 47;
    let twin = match fap.get() {
        inner @ 4..=13 => inner + APART,
        outer @ 51..=60 => outer - APART,
        _ => return None,
    };
    FapNumber::all().find(|fap| fap.get() == twin)
}

/// FAP values per FAPU.
const FAPU_PARTS: u16 = 1024;

fn fap_of(kind: &UnitKind) -> Option<(FapNumber, Fapu)> {
    match kind {
        UnitKind::Fap { number, fapu } => Some((FapNumber::all().find(|fap| u16::from(fap.get()) == *number)?, (*fapu)?)),
        _ => None,
    }
}

/// What summed units leave undone: raised brows take the forehead along, and lips do not pass through each other.
pub(crate) fn settle_offsets(wireframe: &Wireframe, offsets: &mut [Vector3<f64>]) {
    let raised = BROWS.iter().map(|&n| offsets[n].y).sum::<f64>() / BROWS.len() as f64;
    offsets[FOREHEAD].y += FOREHEAD_SHARE * raised.max(0.0);
    keep_lips_apart(wireframe, offsets);
}

/// Index of the unit, and the length in model units of one unit of its weight.
pub(crate) fn find_unit(wireframe: &Wireframe, fapus: &Fapus, unit: ExpressionUnit) -> Option<(usize, f64)> {
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
pub(super) fn keep_lips_apart(wireframe: &Wireframe, offsets: &mut [Vector3<f64>]) {
    for (upper, lower) in LIP_TWINS.map(|(u, l)| (NodeId(u).index(), NodeId(l).index())) {
        let gap = (wireframe.vertices()[upper].y + offsets[upper].y) - (wireframe.vertices()[lower].y + offsets[lower].y);
        if gap < 0.0 {
            offsets[upper].y -= gap / 2.0;
            offsets[lower].y += gap / 2.0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wireframe::Tables;

    fn apex(emotion: Emotion, subject: u32) -> Vec<Vector3<f64>> {
        let w = Wireframe::candide3();
        let fapus = Fapus::measure(&Tables::candide3().fapus, &w.frontal()).unwrap();
        apex_offsets(&w, &fapus, emotion, 1.0, 1, subject)
    }

    #[test]
    fn every_row_names_a_unit_that_the_wireframe_has() {
        let w = Wireframe::candide3();
        let fapus = Fapus::measure(&Tables::candide3().fapus, &w.frontal()).unwrap();
        for row in EXPRESSIONS {
            assert!(find_unit(&w, &fapus, row.unit).is_some(), "{row:?}");
            assert!(row.weight != 0.0 && row.weight.abs() <= 1.2, "{row:?}");
        }
        for emotion in Emotion::ALL {
            let units: Vec<_> = EXPRESSIONS.iter().filter(|r| r.emotion == emotion).map(|r| r.unit).collect();
            assert!(units.len() >= 5);
            assert!(units.iter().enumerate().all(|(k, u)| !units[..k].contains(u)), "{emotion} lists a unit twice");
        }
    }

    #[test]
    fn expressions_move_the_right_way() {
        for subject in 0..20 {
            let happy = apex(Emotion::Happiness, subject);
            // Corners out and up, on both sides (x to the subject's left).
            assert!(happy[31].x > 0.03 && happy[64].x < -0.03 && happy[31].y > 0.05 && happy[64].y > 0.05);
            let surprise = apex(Emotion::Surprise, subject);
            assert!([15, 16, 17, 48, 49, 50].iter().all(|&n: &usize| surprise[n].y > 0.05));
            assert!(surprise[8].y < -0.1 && surprise[10].y < -0.1 && surprise[21].y > 0.0);
            let anger = apex(Emotion::Anger, subject);
            assert!(anger[17].y < -0.05 && anger[17].x < -0.03 && anger[50].x > 0.03 && anger[21].y < 0.0);
            let fear = apex(Emotion::Fear, subject);
            assert!(fear[17].y > 0.05 && fear[17].x < 0.0 && fear[21].y > 0.0 && fear[31].x > 0.03);
            let sadness = apex(Emotion::Sadness, subject);
            assert!(sadness[17].y > 0.05 && sadness[17].y > sadness[15].y && sadness[31].y < -0.05 && sadness[64].y < -0.05);
            let disgust = apex(Emotion::Disgust, subject);
            assert!(disgust[7].y > 0.03 && disgust[26].y > 0.02);
            let contempt = apex(Emotion::Contempt, subject);
            assert!(contempt[31].y > 0.03 && contempt[64].y.abs() < 0.01);
        }
    }

    #[test]
    fn lips_never_pass_through_each_other_and_eyeballs_stay() {
        let w = Wireframe::candide3();
        for emotion in Emotion::ALL {
            for subject in 0..20 {
                let offsets = apex(emotion, subject);
                for (u, l) in LIP_TWINS.map(|(u, l)| (usize::from(u), usize::from(l))) {
                    assert!(w.vertices()[u].y + offsets[u].y >= w.vertices()[l].y + offsets[l].y - 1e-12);
                }
                assert!(EYEBALL.clone().all(|n| offsets[usize::from(n)] == Vector3::zeros()));
            }
        }
    }

    #[test]
    fn people_differ_and_are_a_little_asymmetric() {
        let (a, b) = (apex(Emotion::Happiness, 0), apex(Emotion::Happiness, 1));
        assert!((a[31] - b[31]).norm() > 1e-3);
        let skew = (a[31].y - a[64].y).abs() / a[31].y;
        assert!(skew > 1e-4 && skew < 0.25, "{skew}");
        assert_eq!(a, apex(Emotion::Happiness, 0));
    }

    #[test]
    fn labels_parse_back() {
        for emotion in Emotion::ALL {
            assert_eq!(emotion.label().parse(), Ok(emotion));
        }
        assert_eq!("joy".parse::<Emotion>(), Err(ParseEmotionError("joy".to_owned())));
        assert_eq!((Emotion::Anger.code(), Emotion::Surprise.code()), (1, 7));
    }
}
