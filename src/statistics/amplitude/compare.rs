//! Compares the amplitudes of two groups of people: difference, effect size, direction, equivalence, and the number of people a study
//! needs.

use std::{
    cmp::Ordering,
    collections::{BTreeMap, BTreeSet},
};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::normal::{normal_quantile, t_above, t_quantile};
use crate::{
    output::count,
    statistics::compare::{Arrangements, Strata, holm},
};

/// Options of the comparison of amplitudes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AmplitudeOptions {
    /// Equivalence margin, as a multiple of the median motion: amplitudes that differ by less are equivalent.
    pub equivalence: f64,
    /// Power for which the required number of people is computed.
    pub power: f64,
}

impl Default for AmplitudeOptions {
    fn default() -> Self {
        Self { equivalence: 0.2, power: 0.8 }
    }
}

/// One person of a group with the mean amplitude of their sequences.
#[derive(Clone, Debug, PartialEq)]
pub struct PersonValue {
    /// The person.
    pub subject: String,
    /// Mean amplitude.
    pub value: f64,
}

/// Result of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct AmplitudeTest {
    /// Number of people compared in each group.
    pub people: [usize; 2],
    /// Whether the same people are in both groups, so that their differences are tested.
    pub paired: bool,
    /// Mean amplitude of each group.
    pub means: [f64; 2],
    /// Standard deviation of each group.
    pub deviations: [f64; 2],
    /// First mean minus second mean.
    pub difference: f64,
    /// 95 % confidence interval of the difference: Welch's, or Student's for paired differences.
    pub interval: [f64; 2],
    /// Effect size, the difference in standard deviations: Hedges' g, or that of the paired differences.
    pub effect: f64,
    /// Probability of a difference at least as large by chance, from permutations of people or of the signs of pairs.
    pub p: f64,
    /// The same by Welch's t test, or Student's for paired differences. It can be smaller than permutations can give.
    pub p_t: f64,
    /// [`AmplitudeTest::p`] with Holm's correction over all amplitudes compared.
    pub p_adjusted: f64,
    /// Probability of a difference as close to 0 if the groups differed by [`AmplitudeOptions::equivalence`] or more (two one-sided
    /// tests).
    pub p_equivalence: f64,
    /// [`AmplitudeTest::p_equivalence`] with Holm's correction over all amplitudes compared.
    pub p_equivalence_adjusted: f64,
    /// Number of people per group, or of pairs, that detect a difference of this size with the requested power, and with which
    /// permutations can reach 5 %; `None` without a difference.
    pub people_for_power: Option<usize>,
}

impl AmplitudeTest {
    /// Name of [`AmplitudeTest::effect`]: Hedges' g, or that of paired differences.
    pub fn effect_name(&self) -> &'static str {
        if self.paired { "effect size of the pairs" } else { "Hedges' g" }
    }

    /// Order of clearness: the smaller corrected p first, then the smaller p, then the larger effect.
    pub fn clearer(&self, other: &Self) -> Ordering {
        let p = self.p_adjusted.total_cmp(&other.p_adjusted).then(self.p.total_cmp(&other.p));
        p.then(other.effect.abs().total_cmp(&self.effect.abs()))
    }
}

/// Two groups' amplitudes of one emotion and region.
#[derive(Clone, Debug, PartialEq)]
pub struct AmplitudeComparison {
    /// Emotion.
    pub emotion: String,
    /// Name of the region.
    pub region: &'static str,
    /// The groups.
    pub groups: [BTreeMap<String, String>; 2],
    /// The test, or the reason why there is none.
    pub outcome: Result<AmplitudeTest, String>,
    /// People of one group only, whom a comparison in pairs leaves out.
    pub not_paired: Vec<String>,
}

/// Smallest number of people in each group.
const LEAST_PEOPLE: usize = 2;

/// Smallest number of pairs, and of people in each of two groups, with which the smallest p of all permutations is at most 5 %: 2 of 2^6
/// signs and 2 of the 70 splits of 4 against 4.
const LEAST_FOR_PERMUTATIONS: [usize; 2] = [6, 4];

/// Largest standard deviation, relative to the largest magnitude, that counts as rounding error.
const ROUNDING: f64 = 1e-12;

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn variance(values: &[f64]) -> f64 {
    let center = mean(values);
    values.iter().map(|v| (v - center).powi(2)).sum::<f64>() / (values.len() - 1) as f64
}

/// Compares the amplitudes of two groups of people; each person occurs once per group.
///
/// If most people of the smaller group are also in the other one, as before and after a treatment with some drop-outs, the comparison is
/// paired and uses these people only. With `strata`, people are permuted within strata only.
///
/// # Errors
/// The reason why no test is possible, in words.
pub fn compare_amplitudes(
    a: &[PersonValue],
    b: &[PersonValue],
    strata: Option<&Strata>,
    options: &AmplitudeOptions,
    permutations: &Permutations,
) -> Result<AmplitudeTest, String> {
    let smaller = a.len().min(b.len());
    if smaller < LEAST_PEOPLE {
        return Err(format!("a group of {smaller} cannot be compared; {LEAST_PEOPLE} people or more are needed"));
    }
    let of_b: BTreeMap<&str, f64> = b.iter().map(|p| (p.subject.as_str(), p.value)).collect();
    let pairs: Vec<(f64, f64)> = a.iter().filter_map(|p| Some((p.value, *of_b.get(p.subject.as_str())?))).collect();
    match pairs.len() {
        0 => independent(a, b, strata, options, permutations),
        n if n >= LEAST_PEOPLE && 2 * n > smaller => paired(&pairs, options, permutations),
        n => Err(format!(
            "{} in both groups, but most of the smaller group only in one; compare different people, or the same people twice",
            count(n, "person is", "people are")
        )),
    }
}

/// Returns the people who are in one of two groups only.
pub fn in_one_only(a: &[PersonValue], b: &[PersonValue]) -> Vec<String> {
    let [a, b] = [a, b].map(|group| group.iter().map(|p| p.subject.as_str()).collect::<BTreeSet<_>>());
    a.symmetric_difference(&b).map(|&subject| subject.to_owned()).collect()
}

/// The permutations of a test: all possible ones, or random draws.
#[derive(Clone, Copy, Debug)]
pub struct Permutations {
    /// Number of random permutations in addition to the observed arrangement. If no more than this many are possible, all are used.
    pub count: usize,
    /// Seed of the random numbers.
    pub seed: u64,
    /// Number of the comparison, so that each has its own random numbers.
    pub stream: u32,
}

impl Permutations {
    /// Returns the share of random permutations, including the observed one, with a difference at least as large as `observed`. Each call
    /// of `draw` gets its own random numbers.
    fn share_at_least(&self, observed: f64, draw: impl Fn(ChaCha8Rng) -> f64 + Sync) -> f64 {
        let slack = 1e-10 * observed.abs();
        let is_as_large = |&unit: &usize| draw(self.generator(unit)).abs() >= observed.abs() - slack;
        let at_least = (0..self.count).into_par_iter().filter(is_as_large).count();
        (1 + at_least) as f64 / (1 + self.count) as f64
    }

    /// Returns the share of all `count` permutations with a difference at least as large as `observed`. The observed one is among them.
    fn share_of_all(observed: f64, count: usize, nth: impl Fn(usize) -> f64 + Sync) -> f64 {
        let slack = 1e-10 * observed.abs();
        let at_least = (0..count).into_par_iter().filter(|&k| nth(k).abs() >= observed.abs() - slack).count();
        at_least as f64 / count as f64
    }

    /// Returns the random numbers of one draw. Bit 62 of the stream is set; the bootstrap sets bit 63.
    fn generator(&self, unit: usize) -> ChaCha8Rng {
        let mut random = ChaCha8Rng::seed_from_u64(self.seed);
        random.set_stream((1 << 62) | (u64::from(self.stream) << 30) | unit as u64);
        random
    }
}

/// Returns the number of people per group for a two-sided test at 5 % of an effect of `effect` standard deviations. `groups` is 2, or 1
/// for pairs.
///
/// Uses Lehr's form of the normal approximation, with Guenther's correction for the unknown standard deviation. Permutations of fewer
/// than [`LEAST_FOR_PERMUTATIONS`] never reach 5 %, however large the effect.
fn people_for_power(effect: f64, power: f64, groups: f64) -> Option<usize> {
    const MOST: f64 = 1e9;
    let (z_level, z_power) = (normal_quantile(0.975)?, normal_quantile(power)?);
    let people = groups * ((z_level + z_power) / effect).powi(2) + z_level.powi(2) / (2.0 * groups);
    let [pairs, each] = LEAST_FOR_PERMUTATIONS;
    let least = if groups == 1.0 { pairs } else { each };
    (people < MOST).then(|| (people.ceil() as usize).max(least))
}

fn finished(
    people: [usize; 2],
    paired: bool,
    of: [&[f64]; 2],
    (error, freedom, deviation): (f64, f64, f64),
    small_sample: f64,
    p: f64,
    options: &AmplitudeOptions,
) -> Result<AmplitudeTest, String> {
    let means = of.map(mean);
    let difference = means[0] - means[1];
    let unusable = || "the amplitudes allow no interval".to_owned();
    let half = t_quantile(0.975, freedom).ok_or_else(unusable)? * error;
    let effect = small_sample * difference / deviation;
    let lower = t_above((difference + options.equivalence) / error, freedom).ok_or_else(unusable)?;
    let upper = t_above((options.equivalence - difference) / error, freedom).ok_or_else(unusable)?;
    Ok(AmplitudeTest {
        people,
        paired,
        means,
        deviations: of.map(|values| variance(values).sqrt()),
        difference,
        interval: [difference - half, difference + half],
        effect,
        p,
        p_t: 2.0 * t_above(difference.abs() / error, freedom).ok_or_else(unusable)?,
        p_adjusted: 1.0,
        p_equivalence: lower.max(upper),
        p_equivalence_adjusted: 1.0,
        people_for_power: people_for_power(effect, options.power, if paired { 1.0 } else { 2.0 }),
    })
}

fn independent(
    a: &[PersonValue],
    b: &[PersonValue],
    strata: Option<&Strata>,
    options: &AmplitudeOptions,
    permutations: &Permutations,
) -> Result<AmplitudeTest, String> {
    let values: Vec<f64> = a.iter().chain(b).map(|p| p.value).collect();
    let (of_a, of_b) = values.split_at(a.len());
    let (na, nb) = (a.len() as f64, b.len() as f64);
    let (va, vb) = (variance(of_a), variance(of_b));
    let scale = values.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
    if (va + vb).sqrt() <= ROUNDING * scale {
        return Err("all amplitudes within each group are equal; a test needs people who differ".to_owned());
    }
    let subjects: Vec<&str> = a.iter().chain(b).map(|p| p.subject.as_str()).collect();
    let blocks = match strata {
        Some(strata) => strata.blocks(&subjects, a.len()).map_err(|why| why.to_string())?,
        None => vec![((0..values.len()).collect(), a.len())],
    };
    let (ea, eb) = (va / na, vb / nb);
    // Degrees of freedom after Welch and Satterthwaite.
    let freedom = (ea + eb).powi(2) / (ea * ea / (na - 1.0) + eb * eb / (nb - 1.0));
    let pooled = (((na - 1.0) * va + (nb - 1.0) * vb) / (na + nb - 2.0)).sqrt();
    let total: f64 = values.iter().sum();
    let difference_of = |sum: f64| sum / na - (total - sum) / nb;
    let observed = difference_of(of_a.iter().sum());
    let labels: Vec<usize> = (0..values.len()).map(|place| usize::from(place >= a.len())).collect();
    let all = Arrangements::new(&labels, blocks.iter().map(|(places, _)| places.as_slice()), permutations.count);
    let p = match all {
        Some(all) => Permutations::share_of_all(observed, all.count(), |k| {
            difference_of(all.nth(k).iter().zip(&values).filter(|(label, _)| **label == 0).map(|(_, value)| value).sum())
        }),
        None => permutations.share_at_least(observed, |mut random| {
            let mut sum = 0.0;
            for (places, first) in &blocks {
                let mut places = places.clone();
                for k in 0..*first {
                    let other = random.random_range(k..places.len());
                    places.swap(k, other);
                    sum += values[places[k]];
                }
            }
            difference_of(sum)
        }),
    };
    let small_sample = 1.0 - 3.0 / (4.0 * (na + nb - 2.0) - 1.0);
    finished([a.len(), b.len()], false, [of_a, of_b], ((ea + eb).sqrt(), freedom, pooled), small_sample, p, options)
}

fn paired(pairs: &[(f64, f64)], options: &AmplitudeOptions, permutations: &Permutations) -> Result<AmplitudeTest, String> {
    let (of_a, of_b): (Vec<f64>, Vec<f64>) = pairs.iter().copied().unzip();
    let differences: Vec<f64> = pairs.iter().map(|(a, b)| a - b).collect();
    let n = pairs.len() as f64;
    let deviation = variance(&differences).sqrt();
    let scale = of_a.iter().chain(&of_b).fold(0.0, |most: f64, v| most.max(v.abs()));
    if deviation <= ROUNDING * scale {
        return Err("all people differ by the same amount; a test needs people who differ".to_owned());
    }
    let mean_of = |is_kept: &mut dyn FnMut(usize) -> bool| {
        differences.iter().enumerate().map(|(i, d)| if is_kept(i) { *d } else { -d }).sum::<f64>() / n
    };
    let signs = u32::try_from(pairs.len()).ok().and_then(|n| 1_usize.checked_shl(n)).filter(|signs| *signs <= permutations.count);
    let p = match signs {
        Some(signs) => Permutations::share_of_all(mean(&differences), signs, |k| mean_of(&mut |i| k >> i & 1 == 0)),
        None => permutations.share_at_least(mean(&differences), |mut random| mean_of(&mut |_| random.random::<bool>())),
    };
    let small_sample = 1.0 - 3.0 / (4.0 * (n - 1.0) - 1.0);
    finished([pairs.len(); 2], true, [&of_a, &of_b], (deviation / n.sqrt(), n - 1.0, deviation), small_sample, p, options)
}

/// Corrects the p values of all comparisons for their number.
pub fn adjust_amplitudes(comparisons: &mut [AmplitudeComparison]) {
    let mut tests: Vec<&mut AmplitudeTest> = comparisons.iter_mut().filter_map(|c| c.outcome.as_mut().ok()).collect();
    let adjusted = holm(&tests.iter().map(|t| t.p).collect::<Vec<_>>());
    let equivalence = holm(&tests.iter().map(|t| t.p_equivalence).collect::<Vec<_>>());
    tests.iter_mut().zip(adjusted).for_each(|(test, p)| test.p_adjusted = p);
    tests.iter_mut().zip(equivalence).for_each(|(test, p)| test.p_equivalence_adjusted = p);
}

impl AmplitudeComparison {
    /// Returns the result as a sentence.
    pub fn words(&self, significance: f64, options: &AmplitudeOptions) -> String {
        let name = |k: usize| self.groups[k].values().map(String::as_str).collect::<Vec<_>>().join(" + ");
        let what = if self.region == "face" { self.emotion.clone() } else { format!("{} of the {}", self.emotion, self.region) };
        let test = match &self.outcome {
            Err(why) => return format!("{what}: {} and {} not compared: {why}", name(0), name(1)),
            Ok(test) => test,
        };
        let [a, b] = test.means;
        if test.p_adjusted <= significance {
            let (more, less) = if a > b { (0, 1) } else { (1, 0) };
            let means = [a, b];
            let (larger, opposite) = if means[less] < 0.0 {
                ("goes more along the median", " (below 0 is the opposite motion)")
            } else {
                ("is larger", "")
            };
            return format!(
                "{what} {larger} in {} than in {}: {:.2} against {:.2}{opposite}",
                name(more),
                name(less),
                means[more],
                means[less]
            );
        }
        if test.p_equivalence_adjusted <= significance {
            return format!(
                "{what} is equally strong in {} and {} within {}: {a:.2} and {b:.2}",
                name(0),
                name(1),
                options.equivalence
            );
        }
        format!("{what}: no difference shown between {} and {}: {a:.2} and {b:.2}", name(0), name(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn people(values: &[f64], prefix: &str) -> Vec<PersonValue> {
        values.iter().enumerate().map(|(i, &value)| PersonValue { subject: format!("{prefix}{i}"), value }).collect()
    }

    const A: [f64; 8] = [1.31, 0.92, 1.54, 1.20, 0.81, 1.66, 1.43, 1.02];
    const B: [f64; 7] = [0.71, 0.95, 0.62, 1.10, 0.84, 0.55, 0.99];

    fn compared(a: &[PersonValue], b: &[PersonValue]) -> Result<AmplitudeTest, String> {
        compare_amplitudes(a, b, None, &AmplitudeOptions::default(), &Permutations { count: 19_999, seed: 1, stream: 0 })
    }

    fn close(found: f64, expected: f64) {
        approx::assert_relative_eq!(found, expected, max_relative = 2e-6);
    }

    #[test]
    fn independent_groups_agree_with_scipy() {
        // scripts/check_statistics.py prints these.
        let t = compared(&people(&A, "a"), &people(&B, "b")).unwrap();
        close(t.difference, SCIPY_INDEPENDENT[0]);
        close(t.interval[0], SCIPY_INDEPENDENT[1]);
        close(t.interval[1], SCIPY_INDEPENDENT[2]);
        close(t.effect, SCIPY_INDEPENDENT[3]);
        close(t.p_equivalence, SCIPY_INDEPENDENT[4]);
        // All 6435 splits, by scipy; of fewer draws, within four standard errors.
        close(t.p, SCIPY_INDEPENDENT[5]);
        let drawn = Permutations { count: 5000, seed: 1, stream: 0 };
        let p = compare_amplitudes(&people(&A, "a"), &people(&B, "b"), None, &AmplitudeOptions::default(), &drawn).unwrap().p;
        assert!((p - t.p).abs() < 4.0 * (t.p / 5000.0).sqrt() && p != t.p, "{p}");
        assert_eq!((t.people_for_power, t.paired), (Some(SCIPY_PEOPLE), false));
    }

    #[test]
    fn the_same_people_twice_are_paired_and_agree_with_scipy() {
        let (a, b) = (people(&A[..7], "p"), people(&B, "p"));
        let t = compared(&a, &b).unwrap();
        close(t.difference, SCIPY_PAIRED[0]);
        close(t.interval[0], SCIPY_PAIRED[1]);
        close(t.interval[1], SCIPY_PAIRED[2]);
        close(t.p_equivalence, SCIPY_PAIRED[3]);
        // All 128 ways to turn the signs.
        close(t.p, SCIPY_PAIRED[4]);
        assert!(t.paired);
        let all = people(&A, "p");
        assert!(compared(&all, &b).unwrap().paired && in_one_only(&all, &b) == ["p7"] && in_one_only(&a, &b).is_empty());
        let why = compared(&people(&A, "p"), &[people(&B[..3], "p"), people(&B, "q")].concat()).unwrap_err();
        assert!(why.starts_with("3 people are in both groups, but most of the smaller group only in one"), "{why}");
        // Drop-outs on both sides: the pairs are the same test.
        let (before, after) =
            ([a.clone(), people(&A[..1], "only before")].concat(), [b.clone(), people(&B[..3], "only after")].concat());
        assert_eq!(compared(&before, &after).unwrap(), t);
        assert_eq!(in_one_only(&before, &after).len(), 4);
    }

    #[test]
    fn a_study_has_the_people_with_whom_permutations_can_reach_five_percent() {
        assert_eq!((people_for_power(40.0, 0.8, 1.0), people_for_power(-40.0, 0.8, 2.0)), (Some(6), Some(4)));
        assert_eq!(people_for_power(0.0, 0.8, 2.0), None);
    }

    #[test]
    fn people_are_exchanged_within_strata_in_all_ways() {
        // Two sites, 2 against 2 at each: 36 ways. The largest at each site are in one group: one way, and its mirror image.
        let (a, b) = (people(&[8.0, 9.0, 18.0, 19.0], "a"), people(&[1.0, 2.0, 11.0, 12.0], "b"));
        let site = |p: &PersonValue| vec![if p.value < 10.0 { "x" } else { "y" }.to_owned()];
        let strata = Strata::new(&["site".to_owned()], a.iter().chain(&b).map(|p| (p.subject.as_str(), site(p))));
        let permutations = Permutations { count: 36, seed: 1, stream: 0 };
        let p = compare_amplitudes(&a, &b, Some(&strata), &AmplitudeOptions::default(), &permutations).unwrap().p;
        close(p, 2.0 / 36.0);
    }

    #[test]
    fn equal_strength_is_claimed_by_the_corrected_p() {
        let group = |name: &str| BTreeMap::from([("sex".to_owned(), name.to_owned())]);
        let test = AmplitudeTest { p: 0.9, p_equivalence: 0.02, ..compared(&people(&A, "a"), &people(&B, "b")).unwrap() };
        let comparison = AmplitudeComparison {
            emotion: "joy".to_owned(),
            region: "face",
            groups: [group("f"), group("m")],
            outcome: Ok(test),
            not_paired: Vec::new(),
        };
        let words = |comparisons: &mut [AmplitudeComparison]| {
            adjust_amplitudes(comparisons);
            let test = comparisons[0].outcome.clone().unwrap();
            (test.p_equivalence_adjusted, comparisons[0].words(0.05, &AmplitudeOptions::default()))
        };
        let (p, said) = words(&mut [comparison.clone()]);
        assert!(p == 0.02 && said.contains("equally strong"), "{said}");
        let (p, said) = words(&mut [comparison.clone(), comparison.clone(), comparison]);
        assert!((p - 0.06).abs() < 1e-12 && said.contains("no difference shown"), "{said}");
    }

    #[test]
    fn impossible_comparisons_give_the_reason() {
        assert!(compared(&people(&[1.0], "a"), &people(&B, "b")).unwrap_err().starts_with("a group of 1 cannot"));
        let equal = compared(&people(&[1.0; 4], "a"), &people(&[1.0; 3], "b")).unwrap_err();
        assert!(equal.starts_with("all amplitudes within each group are equal"), "{equal}");
        assert!(compared(&people(&[1.0; 4], "a"), &people(&[1.0; 4], "a")).unwrap_err().contains("same amount"));
    }

    // From scripts/check_statistics.py
    const SCIPY_INDEPENDENT: [f64; 6] = [0.413392857, 0.126274073, 0.700511642, 1.48356058, 0.93418154, 0.0116550117];
    const SCIPY_PEOPLE: usize = 9;
    const SCIPY_PAIRED: [f64; 5] = [0.444285714, 0.0201031124, 0.868468316, 0.895776984, 0.0625];
}
