//! Linear relation between amplitudes and a number of the people.

use super::{Centred, NoCovariate, Numbers, ROUNDING, exchange};
use crate::statistics::{
    Strata,
    amplitude::{PersonValue, t_above, t_quantile},
    compare::{CompareOptions, holm},
};

/// Purpose of the random numbers.
const PERMUTATIONS: u64 = 130;

/// Least-squares line of amplitudes over a number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AmplitudeSlope {
    /// Number of people.
    pub people: usize,
    /// Change of the amplitude, as a multiple of the median motion, per unit of the number.
    pub slope: f64,
    /// Student's 95 % confidence interval of the slope.
    pub interval: [f64; 2],
    /// Pearson's correlation.
    pub correlation: f64,
    /// Probability of a correlation at least as far from 0 by chance, from permutations.
    pub p: f64,
    /// The same by Student's t test.
    pub p_t: f64,
    /// [`AmplitudeSlope::p`] with Holm's correction over all slopes of the analysis; 1 until [`adjust_slopes`] is called.
    pub p_adjusted: f64,
}

/// Fits the line of people's amplitudes over their numbers.
///
/// # Errors
/// [`NoCovariate`].
pub fn amplitude_slope(
    people: &[PersonValue],
    numbers: &Numbers,
    options: &CompareOptions,
    strata: Option<&Strata>,
    stream: u32,
) -> Result<AmplitudeSlope, NoCovariate> {
    let known: Vec<(&str, f64, f64)> =
        people.iter().filter_map(|p| Some((p.subject.as_str(), numbers.get(&p.subject)?, p.value))).collect();
    let numbers: Vec<f64> = known.iter().map(|k| k.1).collect();
    let Centred { z, deviation, .. } = Centred::new(&numbers)?;
    let subjects: Vec<&str> = known.iter().map(|k| k.0).collect();
    let (exchange, by_label) = exchange(&numbers, &z, &subjects, strata)?;
    let n = known.len() as f64;
    let mean = known.iter().map(|k| k.2).sum::<f64>() / n;
    let length = known.iter().map(|k| (k.2 - mean).powi(2)).sum::<f64>().sqrt();
    if !(length > ROUNDING * known.iter().map(|k| k.2.abs()).fold(0.0, f64::max)) {
        return Err(NoCovariate::Alike);
    }
    let y: Vec<f64> = known.iter().map(|k| (k.2 - mean) / length).collect();
    let r = z.iter().zip(&y).map(|(a, b)| a * b).sum::<f64>().clamp(-1.0, 1.0);
    let correlation = |labels: &[usize]| labels.iter().zip(&y).map(|(&label, b)| by_label[label] * b).sum::<f64>().abs();
    let tried = exchange.permute(options, (stream, PERMUTATIONS), correlation);
    // Converts a correlation to amplitude per unit of the number.
    let scale = length / (deviation * (n - 1.0).sqrt());
    let freedom = n - 2.0;
    let error = ((1.0 - r * r).max(0.0) / freedom).sqrt();
    let half = t_quantile(0.975, freedom).unwrap_or(f64::INFINITY) * error * scale;
    let p_t = if error > 0.0 { t_above((r / error).abs(), freedom).map_or(1.0, |p| 2.0 * p) } else { 0.0 };
    Ok(AmplitudeSlope {
        people: known.len(),
        slope: r * scale,
        interval: [r * scale - half, r * scale + half],
        correlation: r,
        p: tried.p(|other| *other >= r.abs() - ROUNDING),
        p_t,
        p_adjusted: 1.0,
    })
}

/// Corrects the p values for the number of slopes.
pub fn adjust_slopes(slopes: &mut [&mut AmplitudeSlope]) {
    let adjusted = holm(&slopes.iter().map(|t| t.p).collect::<Vec<_>>());
    slopes.iter_mut().zip(adjusted).for_each(|(slope, p)| slope.p_adjusted = p);
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;

    use super::*;

    #[test]
    fn amplitudes_have_the_line_of_least_squares() {
        let five = [("a", 1.0, 10.0), ("b", 2.0, 20.0), ("c", 3.0, 30.0), ("d", 4.0, 40.0), ("e", 5.0, 100.0)];
        let people = five.map(|(who, _, value)| PersonValue { subject: who.to_owned(), value });
        let numbers = Numbers::new(five.iter().map(|p| (p.0, Some(p.1))));
        let found = amplitude_slope(&people, &numbers, &CompareOptions::default(), None, 0).unwrap();
        assert_relative_eq!(found.slope, 20.0, max_relative = 1e-9);
        assert_relative_eq!(found.correlation, 0.8f64.sqrt(), max_relative = 1e-9);
        // Student's t of 3 degrees of freedom: 3.182446, times the root of 0.2 / 3 times that of 5000 / 10.
        assert_relative_eq!(found.interval[1] - 20.0, 18.373_863, max_relative = 1e-6);
        assert_relative_eq!(found.p, 2.0 / 120.0, max_relative = 1e-9);
        // t = r / sqrt((1 - r²) / 3) = 3.4641, two-sided.
        assert_relative_eq!(found.p_t, 0.040_519, max_relative = 1e-4);
    }
}
