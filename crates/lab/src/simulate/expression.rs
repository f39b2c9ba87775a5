//! Expressions of simulated people: offsets of the nodes for emotions and for FAP values.

use nalgebra::Vector3;
use rand_distr::{Distribution, StandardNormal};

use grimace::internal::{
    fap::{FapFrame, FapNumber, FapSequence},
    wireframe::{Emotion, ExpressionUnit, Fapu, Fapus, UnitKind, Wireframe, expressions, find_unit, settle_offsets},
};

use super::random::{Purpose, generator};

/// Standard deviation of a person's strength over emotions, and (`UNIT_SD`) of one unit within an expression, as factors on the weight.
const STRENGTH_SD: f64 = 0.10;
const UNIT_SD: f64 = 0.12;
/// Standard deviation of the asymmetry a: the left side moves by `1 + a`, the right by `1 - a`.
const ASYMMETRY_SD: f64 = 0.05;
/// Limit of random factors, in standard deviations.
const LIMIT_SD: f64 = 2.0;
/// Distance from the midline, in model units, over which the asymmetry grows from zero to its full size.
const ASYMMETRY_RAMP: f64 = 0.2;

/// The eight nodes of the iris boxes. They do not move with expressions, because eyeballs are rigid, although two action unit vectors of
/// Candide-3 include them.
const EYEBALL: std::ops::RangeInclusive<u16> = 67..=74;

/// Returns the offset from neutral of every node at the apex of one person's expression, in model units of face space.
///
/// The weights are those of [`expressions`] times `strength`, times seeded factors of this person and emotion, so that an emotion looks
/// different on each person. Units that the wireframe lacks are skipped.
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
    // Left and right FAPs of a pair are neighbours in the table and share one factor, so that only `asymmetry` makes the sides differ.
    let mut pair_factor: Option<(u16, f64)> = None;
    for row in expressions().iter().filter(|r| r.emotion == emotion) {
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

/// Returns the offset from neutral of every node under the FAP values of a frame, in model units of face space.
///
/// The FAPs use Candide-3's own units and the subject's FAPUs. FAPs without a unit, such as angles, have no effect ([`faps_without_unit`]).
/// When only the inner or only the outer edge of a lip has a FAP, the other edge moves with it.
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

/// Returns the FAPs that a sequence sets and that `fap_offsets` ignores, ascending.
pub fn faps_without_unit(wireframe: &Wireframe, faps: &FapSequence) -> Vec<FapNumber> {
    let is_length = |kind: &UnitKind| fap_of(kind).filter(|(_, fapu)| *fapu != Fapu::Au).map(|(fap, _)| fap);
    let known: Vec<FapNumber> = wireframe.action_units().iter().filter_map(|unit| is_length(&unit.kind)).collect();
    faps.set_faps().into_iter().filter(|fap| !known.contains(fap)).collect()
}

/// Returns the FAP of the other edge of the same lip: 4 to 13 are inner, 51 to 60 outer.
fn lip_twin(fap: FapNumber) -> Option<FapNumber> {
    const APART: u8 = 47;
    let twin = match fap.get() {
        inner @ 4..=13 => inner + APART,
        outer @ 51..=60 => outer - APART,
        _ => return None,
    };
    FapNumber::all().find(|fap| fap.get() == twin)
}

/// Number of FAP values per FAPU.
const FAPU_PARTS: u16 = 1024;

fn fap_of(kind: &UnitKind) -> Option<(FapNumber, Fapu)> {
    match kind {
        UnitKind::Fap { number, fapu } => Some((FapNumber::all().find(|fap| u16::from(fap.get()) == *number)?, (*fapu)?)),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use grimace::internal::wireframe::Tables;

    /// Nodes of the inner upper lip, each with its twin on the lower lip.
    const LIP_TWINS: [(u16, u16); 3] = [(87, 40), (81, 83), (82, 84)];

    fn apex(emotion: Emotion, subject: u32) -> Vec<Vector3<f64>> {
        let w = Wireframe::candide3();
        let fapus = Fapus::measure(&Tables::candide3().fapus, &w.frontal()).unwrap();
        apex_offsets(&w, &fapus, emotion, 1.0, 1, subject)
    }

    #[test]
    fn expressions_move_the_right_way() {
        for subject in 0..20 {
            let happy = apex(Emotion::Happiness, subject);
            // The corners move out and up on both sides (x grows to the subject's left).
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
}
