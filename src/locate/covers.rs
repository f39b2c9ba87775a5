//! Detects covered parts of a face: a mask, a hand, a scarf or dark glasses, under which the other stages still place points.
//!
//! The descriptors that the local stages read around each point are classified as visible or covered. A second linear step combines all
//! points, because a cover mostly hides neighbouring points too. The position of a hidden point is a guess from the rest of the face; its
//! expected error is set accordingly.

use super::{linear::dot, part::FacePart, points};

/// Value from which a point counts as visible. Below [`HIDDEN`] it counts as hidden; between the two, partly.
const SEEN: f32 = 0.5;
/// See [`SEEN`].
const HIDDEN: f32 = -0.8;

/// Learned weights for covered faces. The visibility of a point is a number: about 1 if visible, about -1 if covered.
#[derive(Clone, Debug, PartialEq)]
pub struct CoverStage {
    /// Weights of the local stages' descriptors: points x numbers per point.
    pub weights: Vec<f32>,
    /// Constant of each point.
    pub base: Vec<f32>,
    /// Square matrix that combines the values of all points.
    pub mix: Vec<f32>,
    /// Constant of each point in that combination.
    pub mix_base: Vec<f32>,
    /// Expected error of each point if hidden, over the eye distance.
    pub errors: Vec<f32>,
    /// Mean visibility of its points below which a part is covered, in the order of [`FacePart::ALL`].
    pub limits: Vec<f32>,
}

impl CoverStage {
    /// Returns the value of each point of a view by itself. `looks`: descriptors of each local stage, the points one after the other.
    pub fn say(&self, looks: &[Vec<f32>]) -> Vec<f32> {
        let count = self.base.len();
        let mut weights = self.weights.as_slice();
        let mut said = self.base.clone();
        for look in looks {
            let length = look.len() / count.max(1);
            let Some((own, rest)) = weights.split_at_checked(length * count) else { break };
            weights = rest;
            let pairs = own.chunks_exact(length.max(1)).zip(look.chunks_exact(length.max(1)));
            said.iter_mut().zip(pairs).for_each(|(said, (row, read))| *said += dot(row, read));
        }
        said
    }

    /// Returns the visibility of each point, from the values of both readings.
    pub fn seen(&self, [plain, mirrored]: [&[f32]; 2]) -> Vec<f32> {
        let mean: Vec<f32> = plain.iter().zip(mirrored).map(|(p, q)| 0.5 * (p + q)).collect();
        self.mix.chunks_exact(mean.len().max(1)).zip(&self.mix_base).map(|(row, base)| base + dot(row, &mean)).collect()
    }

    /// Returns the covered parts. A nose alone is not covered: what covers it covers a mouth or an eye as well, and the noses of turned heads
    /// and wide smiles look like that.
    pub fn covered(&self, seen: &[f32]) -> Vec<FacePart> {
        let parts = FacePart::ALL.into_iter().zip(&self.limits);
        let mut covered: Vec<FacePart> =
            parts.filter(|(part, limit)| part_seen(*part, seen) < **limit).map(|(part, _)| part).collect();
        if covered == [FacePart::Nose] {
            covered.clear();
        }
        covered
    }

    /// Returns the expected error of a point over the eye distance, given its expected error if visible, `expected`.
    pub fn expect(&self, point: usize, seen: &[f32], expected: f32) -> f32 {
        let seen = seen.get(point).copied().unwrap_or(SEEN);
        let share = ((SEEN - seen) / (SEEN - HIDDEN)).clamp(0.0, 1.0);
        let guessed = self.errors.get(point).copied().unwrap_or(0.0).max(expected);
        if share > 0.0 && expected > 0.0 { expected * (guessed / expected).powf(share) } else { expected }
    }
}

/// Returns the mean visibility over the points of a part.
pub fn part_seen(part: FacePart, seen: &[f32]) -> f32 {
    let own = points().iter().zip(seen).filter(|(point, _)| FacePart::of(point) == Some(part));
    let (sum, count) = own.fold((0.0, 0), |(sum, count), (_, seen)| (sum + seen, count + 1));
    sum / count.max(1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A stage in which the value of each point is the first number of the first local stage minus twice the first of the second.
    fn stage() -> CoverStage {
        let count = points().len();
        let first = std::iter::repeat_n([1.0, 0.0], count).flatten();
        let second = std::iter::repeat_n([-2.0, 0.0], count).flatten();
        let mut mix = vec![0.0; count * count];
        (0..count).for_each(|k| mix[k * count + k] = 1.0);
        CoverStage {
            weights: first.chain(second).collect(),
            base: vec![0.25; count],
            mix,
            mix_base: vec![0.0; count],
            errors: vec![0.09; count],
            limits: vec![-0.4; FacePart::ALL.len()],
        }
    }

    #[test]
    fn points_say_what_was_read_around_them() {
        let count = points().len();
        let said = stage().say(&[[3.0, 9.0].repeat(count), [0.5, 9.0].repeat(count)]);
        assert_eq!(said, vec![0.25 + 3.0 - 1.0; count]);
        // Both readings have the same weight.
        assert_eq!(stage().seen([&said, &vec![0.25; count]]), vec![1.25; count]);
    }

    #[test]
    fn a_part_is_covered_where_its_points_are_on_the_mean() {
        let mut seen = vec![1.0; points().len()];
        assert_eq!(stage().covered(&seen), []);
        for (point, seen) in points().iter().zip(&mut seen) {
            match FacePart::of(point) {
                Some(FacePart::Mouth) => *seen = -0.5,
                Some(FacePart::Chin) => *seen = -0.3,
                _ => {}
            }
        }
        assert_eq!(stage().covered(&seen), [FacePart::Mouth]);
    }

    #[test]
    fn the_less_is_seen_of_a_point_the_nearer_its_error_is_to_that_of_a_guess() {
        let expect = |seen: f32, expected: f32| stage().expect(0, &[seen], expected);
        assert_eq!((expect(0.6, 0.01), expect(2.0, 0.2)), (0.01, 0.2));
        // Half way between 0.5 and -0.8, the error is the root of 0.01 times 0.09.
        approx::assert_relative_eq!(expect(-0.15, 0.01), 0.03, epsilon = 1e-5);
        approx::assert_relative_eq!(expect(-1.5, 0.01), 0.09, epsilon = 1e-6);
        // An expected error larger than that of a guess is kept.
        approx::assert_relative_eq!(expect(-1.5, 0.2), 0.2, epsilon = 1e-6);
    }
}
