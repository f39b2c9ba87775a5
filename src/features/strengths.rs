//! Strengths of shapes: the non-negative mixture that explains a frame, alone or among the frames before and after it.
//!
//! Muscles do not jump. A frame alone may be explained by one unit as well as by another, and then the smallest error decides: in the next
//! frame it may be the other. So the frames of a film are explained together: the log prior of the strengths `x_i` of frames `t` and `u` is
//! `-(x_i(t) - x_i(u))^2 / (2 r_i |t - u|)` further (a random walk), with the rate `r_i` of the shape. This is a quadratic programme over
//! all frames, solved by projected successive over-relaxation.

use nalgebra::{DMatrix, DVector};

/// Iterations of the non-negative solution.
const TURNS: usize = 300;
/// Sweeps over all frames of a film.
const SWEEPS: usize = 80;
/// Over-relaxation of the sweeps, 1 to 2.
const RELAXATION: f64 = 1.5;
/// Change of a strength below which a solution is final.
const FINAL: f64 = 1e-7;
/// The same for the frames of a film.
const FINAL_IN_TIME: f64 = 1e-5;

/// What one frame says about the strengths: the minimum of `x' N x / 2 - r' x` with `x >= 0`.
#[derive(Clone, Debug)]
pub(super) struct System {
    /// `N`.
    pub normal: DMatrix<f64>,
    /// `r`.
    pub right: DVector<f64>,
    /// The time, s, if known. Frames of unknown time are explained on their own.
    pub seconds: Option<f64>,
    /// Whether all strengths are 0 by definition.
    pub is_neutral: bool,
}

impl System {
    /// Returns the strengths that explain the frame alone.
    pub fn alone(&self) -> DVector<f64> {
        non_negative(&self.normal, &self.right)
    }

    /// Returns the log posterior of strengths, but for a constant.
    pub fn log_posterior(&self, x: &DVector<f64>) -> f64 {
        self.right.dot(x) - 0.5 * (&self.normal * x).dot(x)
    }
}

/// Returns the seconds between a frame and the next one of a film; `None` if a time is unknown (minus infinity, too) or does not advance. Such
/// frames say nothing of each other.
pub(super) fn seconds_between(frame: Option<f64>, next: Option<f64>) -> Option<f64> {
    let seconds = next? - frame?;
    (seconds > 0.0 && seconds.is_finite()).then_some(seconds)
}

/// Returns the strengths that explain frames together, from those that explain each alone. Frames are in order of time. `rates`: variance
/// of the change of each strength within a second.
pub(super) fn together(systems: &[System], alone: &[DVector<f64>], rates: &[f64]) -> Vec<DVector<f64>> {
    let apart = |k: usize| seconds_between(systems[k].seconds, systems.get(k + 1)?.seconds);
    // Precision per rate of the change to the next frame; 0 where the two are not coupled.
    let links: Vec<f64> = (0..systems.len()).map(|k| apart(k).map_or(0.0, f64::recip)).collect();
    let mut x = alone.to_vec();
    for (strengths, system) in x.iter_mut().zip(systems) {
        if system.is_neutral {
            strengths.fill(0.0);
        }
    }
    let order: Vec<usize> = (0..systems.len()).chain((0..systems.len()).rev()).collect();
    for _ in 0..SWEEPS {
        let mut largest: f64 = 0.0;
        for &k in order.iter().filter(|&&k| !systems[k].is_neutral) {
            let before = k.checked_sub(1).map_or(0.0, |before| links[before]);
            let after = links[k];
            if before + after == 0.0 {
                continue;
            }
            for i in 0..rates.len() {
                let pull = |link: f64, at: usize| if link > 0.0 { link / rates[i] * x[at][i] } else { 0.0 };
                let stiff = (before + after) / rates[i];
                let slope = systems[k].right[i] - systems[k].normal.column(i).dot(&x[k]) - stiff * x[k][i]
                    + pull(before, k.saturating_sub(1))
                    + pull(after, k + 1);
                let to = (x[k][i] + RELAXATION * slope / (systems[k].normal[(i, i)] + stiff)).max(0.0);
                largest = largest.max((to - x[k][i]).abs());
                x[k][i] = to;
            }
        }
        if largest < FINAL_IN_TIME {
            break;
        }
    }
    x
}

/// Returns the non-negative minimum of `x' N x / 2 - r' x`, by coordinate descent.
pub(super) fn non_negative(normal: &DMatrix<f64>, right: &DVector<f64>) -> DVector<f64> {
    non_negative_from(&DVector::zeros(right.len()), normal, right, |_| true)
}

/// Returns the non-negative minimum of `x' N x / 2 - r' x` over the unknowns that are `used`, the others being 0, by coordinate descent from
/// a start.
pub(super) fn non_negative_from(
    start: &DVector<f64>,
    normal: &DMatrix<f64>,
    right: &DVector<f64>,
    used: impl Fn(usize) -> bool,
) -> DVector<f64> {
    let used: Vec<usize> = (0..start.len()).filter(|&i| used(i)).collect();
    let mut x = DVector::<f64>::zeros(start.len());
    used.iter().for_each(|&i| x[i] = start[i]);
    for _ in 0..TURNS {
        let mut largest: f64 = 0.0;
        for &i in &used {
            let slope = right[i] - normal.column(i).dot(&x);
            let to = (x[i] + slope / normal[(i, i)]).max(0.0);
            largest = largest.max((to - x[i]).abs());
            x[i] = to;
        }
        if largest < FINAL {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_non_negative_minimum_has_no_negative_part() {
        // The unconstrained x1 is -1 and x2 is 2: x1 becomes 0.
        let x = non_negative(&DMatrix::identity(2, 2), &DVector::from_vec(vec![-1.0, 2.0]));
        assert_eq!(x.as_slice(), [0.0, 2.0]);
    }

    /// A frame in which one unknown is `value`, known with this precision.
    fn frame(seconds: Option<f64>, value: f64, precision: f64) -> System {
        let normal = DMatrix::from_element(1, 1, precision);
        System { normal, right: DVector::from_element(1, precision * value), seconds, is_neutral: false }
    }

    fn of(systems: &[System], rate: f64) -> Vec<f64> {
        let alone: Vec<_> = systems.iter().map(System::alone).collect();
        together(systems, &alone, &[rate]).iter().map(|x| x[0]).collect()
    }

    #[test]
    fn frames_of_a_film_share_what_they_know() {
        // Two frames, half a second apart, with a rate of 2: the change has a variance of 1, as has each value. The minimum of
        // (x - 1)^2 + y^2 + (x - y)^2 is at 2/3 and 1/3.
        let found = of(&[frame(Some(0.0), 1.0, 1.0), frame(Some(0.5), 0.0, 1.0)], 2.0);
        assert!((found[0] - 2.0 / 3.0).abs() < 1e-4 && (found[1] - 1.0 / 3.0).abs() < 1e-4, "{found:?}");
        // Without times, or at one time, each is explained alone.
        for times in [[None, Some(0.5)], [Some(0.5), Some(0.5)]] {
            assert_eq!(of(&[frame(times[0], 1.0, 1.0), frame(times[1], 0.0, 1.0)], 2.0), [1.0, 0.0]);
        }
    }

    #[test]
    fn the_neutral_frame_shows_nothing() {
        let mut systems = [frame(Some(0.0), 0.0, 1.0), frame(Some(0.5), 1.0, 1.0)];
        systems[0].is_neutral = true;
        let found = of(&systems, 2.0);
        assert!(found[0] == 0.0 && (found[1] - 0.5).abs() < 1e-4, "{found:?}");
    }

    #[test]
    fn of_two_shapes_that_explain_a_frame_equally_the_one_of_its_neighbours_stays() {
        // Both unknowns move the face alike; only in the first frame is it known that it is the first one.
        let alike = DMatrix::from_row_slice(2, 2, &[9.1, 9.0, 9.0, 9.1]);
        let sure = DMatrix::from_diagonal(&DVector::from_vec(vec![9.0, 9.0]));
        let system = |t: f64, normal: &DMatrix<f64>, right: [f64; 2]| System {
            normal: normal.clone(),
            right: DVector::from_row_slice(&right),
            seconds: Some(t),
            is_neutral: false,
        };
        let systems = [system(0.0, &sure, [9.0, 0.0]), system(0.04, &alike, [8.95, 9.05]), system(0.08, &alike, [9.05, 8.95])];
        let alone: Vec<_> = systems.iter().map(System::alone).collect();
        assert!(alone[1][0] < 0.1 && alone[1][1] > 0.9, "{alone:?}");
        let found = together(&systems, &alone, &[0.8, 0.8]);
        assert!(found.iter().all(|x| x[0] > 0.8 && x[1] < 0.2), "{found:?}");
    }
}
