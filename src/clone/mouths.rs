//! Photographs of opened and moved mouths, made from a neutral one. The locator learns from them what no photograph at hand shows.
//!
//! A random posture of the mouth (how far the jaw opens, how wide the corners are apart, how high they are, how much of the teeth
//! the lips bare) is put on the photograph as a cloned expression is.

use image::RgbImage;
use nalgebra::Vector2;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};

use super::{CloneError, CloneOptions, SourceMotion, Target, clone_expression, source::normalizer};
use crate::{
    fap::{FapFrame, FapNumber, FapSequence},
    wireframe::Face,
};

/// A photograph whose mouth has moved.
#[derive(Clone, Debug)]
pub struct MovedMouth {
    /// The picture.
    pub picture: RgbImage,
    /// Motion of every node from the original photograph, px.
    pub motion: Vec<Vector2<f64>>,
}

/// Makes `count` photographs of a face with a moved mouth; `seed` and `stream` select the postures.
///
/// # Errors
/// [`CloneError`] if the face cannot be warped.
pub fn moved_mouths(
    target: &Target,
    face: &Face,
    count: usize,
    (seed, stream): (u64, u64),
) -> Result<Vec<MovedMouth>, CloneError> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    random.set_stream(stream);
    let fapus = normalizer(face)?.canonical().fapus;
    let units = [fapus.mns / fapus.es, fapus.mw / fapus.es];
    let mut made = Vec::with_capacity(count);
    for _ in 0..count {
        let frame = posture(&mut random, units);
        let sequence = FapSequence { version: "2.1".to_owned(), name: "mouth".to_owned(), fps: 25.0, frames: vec![frame] };
        let motion = SourceMotion::from_fap("mouth", &sequence, face)?;
        let clone = clone_expression(&motion, target, None, &CloneOptions::default(), face)?;
        let last = clone.frames.len().saturating_sub(1);
        let Some(frame) = clone.frames.last() else { continue };
        let rest = target.warp().nodes();
        let motion = frame.deformation.nodes().iter().zip(rest).map(|(p, r)| p - r).collect();
        made.push(MovedMouth { picture: clone.picture(last)?, motion });
    }
    Ok(made)
}

/// Returns a uniform random number between two bounds.
fn uniform(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * random.random::<f64>()
}

/// Returns a normal random number of mean 0.
fn normal(random: &mut ChaCha8Rng, deviation: f64) -> f64 {
    let value: f64 = StandardNormal.sample(random);
    deviation * value
}

/// Returns the FAPs of a random posture. All lengths inside are shares of the eye distance, y down; `units` are the FAPUs of the mouth's
/// distance from the nose and of its width in this unit.
fn posture(random: &mut ChaCha8Rng, [mns, mw]: [f64; 2]) -> FapFrame {
    // One mouth in five stays closed and only moves its corners; the others are ajar, open as in speech, or wide open as in surprise.
    let gap = match uniform(random, 0.0, 1.0) {
        kind if kind < 0.2 => 0.0,
        kind if kind < 0.35 => uniform(random, 0.02, 0.07),
        kind if kind < 0.7 => uniform(random, 0.07, 0.22),
        _ => uniform(random, 0.22, 0.65),
    };
    let raise = (gap * uniform(random, 0.0, 0.3)).min(0.08) + normal(random, 0.012);
    let drop = gap - raise;
    let jaw = drop * uniform(random, 0.75, 1.05);
    // An opening mouth becomes narrower, and its corners go down by a part of the way of the lower lip.
    let aside = -0.12 * gap + normal(random, 0.05);
    let down = gap * uniform(random, 0.15, 0.45) + normal(random, 0.03);
    // Opening half way between corner and middle, as a share of that in the middle: 0.6 is nearly a rhomb, 0.92 an oval.
    let round = uniform(random, 0.6, 0.92);
    // Lips become fuller when the mouth is pursed.
    let fuller = if aside < -0.03 { -0.25 * (aside + 0.03) } else { 0.0 };
    let (outer_up, outer_down) = (uniform(random, 0.6, 1.1), uniform(random, 0.9, 1.08));
    let mut frame = FapFrame::default();
    let mut set = |fap: u8, length: f64, unit: f64| {
        if let Ok(fap) = FapNumber::try_from(fap) {
            frame.set_value(fap, Some(1024.0 * length / unit));
        }
    };
    let share = |upper: f64| down + (upper - down) * round;
    set(3, jaw, mns);
    set(4, -raise, mns);
    set(5, -drop, mns);
    set(51, -raise * outer_up - fuller, mns);
    set(52, -drop * outer_down - fuller, mns);
    for side in 0..2_u8 {
        let one = 1.0 + normal(random, 0.07);
        set(6 + side, aside * one, mw);
        set(53 + side, aside * one, mw);
        set(12 + side, -down * one, mns);
        set(59 + side, -down * one, mns);
        set(8 + side, share(-raise) * one, mns);
        set(10 + side, -share(drop) * one, mns);
        set(55 + side, (share(-raise * outer_up) - fuller) * one, mns);
        set(57 + side, (-share(drop * outer_down) - fuller) * one, mns);
    }
    frame
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{clone::test_target::portrait_target, wireframe::Face};

    #[test]
    fn a_seed_and_a_stream_make_the_same_mouths_and_the_rest_of_the_face_stays() {
        let (target, face) = (portrait_target(), Face::candide3());
        let made = |stream: u64| moved_mouths(target, &face, 2, (1, stream)).unwrap();
        let (one, again, other) = (made(1), made(1), made(2));
        assert!(one.len() == 2 && one.iter().zip(&again).all(|(a, b)| a.picture == b.picture && a.motion == b.motion));
        assert!(one[0].motion != other[0].motion && one[0].motion != one[1].motion);
        let unit = target.fapus.es;
        for mouth in one.iter().chain(&other) {
            assert_eq!(mouth.picture.dimensions(), target.picture.dimensions());
            // Corners of the eyes.
            assert!([20, 23, 53, 56].iter().all(|&k| mouth.motion[k].norm() < 0.005 * unit));
            assert!([40, 31, 64].iter().any(|&k| mouth.motion[k].norm() > 0.01 * unit));
            // The lips do not pass through each other.
            assert!(mouth.motion[40].y - mouth.motion[87].y > -0.02 * unit);
        }
    }

    #[test]
    fn postures_open_by_what_their_faps_say() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let value = |frame: &FapFrame, fap: u8| frame.value(FapNumber::try_from(fap).unwrap()).unwrap();
        // With units of 0.25 and 0.5 eye distances: the lips part by the upper one's way up and the lower one's way down.
        let frames: Vec<FapFrame> = (0..200).map(|_| posture(&mut random, [0.25, 0.5])).collect();
        let gaps: Vec<f64> = frames.iter().map(|f| -(value(f, 4) + value(f, 5)) * 0.25 / 1024.0).collect();
        assert!(gaps.iter().all(|gap| (-1e-9..0.65).contains(gap)));
        let share = |is: &dyn Fn(f64) -> bool| gaps.iter().filter(|gap| is(**gap)).count();
        assert!((20..60).contains(&share(&|gap| gap < 1e-9)) && (35..85).contains(&share(&|gap| gap >= 0.22)));
        // Both corners are stretched by nearly the same.
        assert!(frames.iter().all(|f| (value(f, 6) - value(f, 53)).abs() < 1e-9));
    }
}
