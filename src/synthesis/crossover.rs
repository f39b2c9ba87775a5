//! The crossovers of [ZL, section 3], as the shares of the parents in their offspring.

use serde::{Deserialize, Serialize};

use super::random::unit;

/// How two parents produce an offspring.
///
/// ```
/// use grimace::synthesis::Crossover;
///
/// assert_eq!([Crossover::Line.name(), Crossover::Blx { alpha: 0.2 }.name()], ["line", "blx-0.2"]);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Crossover {
    /// `0.5 P1 + 0.5 P2`.
    Midpoint,
    /// `t P1 + (1 - t) P2`, t uniform in 0 to 1.
    Line,
    /// BLX-alpha: `t (P1 - D) + (1 - t)(P2 + D)` with `D = alpha (P2 - P1)`, t uniform in 0 to 1.
    Blx {
        /// 0 to 1; 0.2 was the best in \[ZL\].
        alpha: f64,
    },
}

impl Crossover {
    /// Returns the shares of the first and the second parent; they sum to 1.
    ///
    /// \[ZL\] call line a case of BLX-alpha "when t = 0.5" and midpoint a case of line "when alpha = 0 and t = 0.5". By their
    /// formulas, line is the case alpha = 0, and midpoint the case alpha = 0 and t = 0.5. This code follows the formulas.
    pub(crate) fn shares(self, random: &mut impl rand::Rng) -> (f64, f64) {
        let (t, alpha) = match self {
            Self::Midpoint => (0.5, 0.0),
            Self::Line => (unit(random), 0.0),
            Self::Blx { alpha } => (unit(random), alpha),
        };
        let first = t * (1.0 + alpha) - (1.0 - t) * alpha;
        (first, 1.0 - first)
    }

    /// Name of the crossover: `midpoint`, `line` or `blx-0.2`.
    pub fn name(self) -> String {
        match self {
            Self::Midpoint => "midpoint".to_owned(),
            Self::Line => "line".to_owned(),
            Self::Blx { alpha } => format!("blx-{alpha}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn shares_lie_where_the_formulas_put_them() {
        let mut random = ChaCha8Rng::seed_from_u64(1);
        assert_eq!(Crossover::Midpoint.shares(&mut random), (0.5, 0.5));
        let range = |crossover: Crossover, random: &mut ChaCha8Rng| {
            let shares: Vec<f64> = (0..2000).map(|_| crossover.shares(random).0).collect();
            assert!(shares.iter().all(|s| s.is_finite()));
            (shares.iter().copied().fold(f64::INFINITY, f64::min), shares.iter().copied().fold(f64::NEG_INFINITY, f64::max))
        };
        let (low, high) = range(Crossover::Line, &mut random);
        assert!((0.0..0.01).contains(&low) && (0.99..1.0).contains(&high));
        // t = 0: -alpha; t = 1: 1 + alpha.
        let (low, high) = range(Crossover::Blx { alpha: 0.2 }, &mut random);
        assert!((-0.2..-0.19).contains(&low) && (1.19..1.2).contains(&high));
    }

    #[test]
    fn the_formula_of_blx_holds() {
        // P1 = 3, P2 = 7, alpha = 0.2: D = 0.8. The offspring is t 2.2 + (1 - t) 7.8 for any t.
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut again = random.clone();
        let (a, b) = Crossover::Blx { alpha: 0.2 }.shares(&mut random);
        let t = unit(&mut again);
        assert!((a * 3.0 + b * 7.0 - (t * 2.2 + (1.0 - t) * 7.8)).abs() < 1e-12);
    }
}
