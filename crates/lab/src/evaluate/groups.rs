//! Size and power of the test between groups, and coverage of the bootstrap interval, measured on synthetic people whose truth is known.

use std::{collections::BTreeMap, time::Instant};

use rayon::prelude::*;

use super::{Cell, Spread, SyntheticPeople, Table};
use grimace::internal::{
    model::ModelError,
    statistics::{
        ClassLabel, SequenceModel, StatisticsError, StatisticsOptions,
        bootstrap::dispersion_replicates,
        compare::{CompareOptions, test},
        representative,
    },
    units::SequenceId,
    wireframe::FapusError,
};

/// Options of the study.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupStudyOptions {
    /// People in each of the two groups.
    pub people: [usize; 2],
    /// Number of pairs of groups for each difference.
    pub pairs: usize,
    /// Relative differences in the strength of the second group's smile: 0 means no difference, 0.2 means 20 % stronger.
    pub differences: Vec<f64>,
    /// Number of permutations in each test.
    pub permutations: usize,
    /// Number of classes for which an interval is computed, for each size and population; 0 for none.
    pub intervals: usize,
    /// Numbers of people in these classes.
    pub interval_people: Vec<usize>,
    /// Populations that the people are drawn from.
    pub populations: Vec<Spread>,
    /// Number of bootstrap replicates of each interval.
    pub replicates: usize,
    /// Number of people whose dispersion counts as the true one.
    pub truth: usize,
    /// Seed of people, permutations and replicates.
    pub seed: u64,
}

/// Results of the tests at one difference.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupTrial {
    /// Relative difference in the strength of the second group's smile.
    pub difference: f64,
    /// Number of tests.
    pub pairs: usize,
    /// Number of tests with p at most 0.05.
    pub rejected: usize,
    /// Number of tests that reported a node without a true difference.
    pub wrong_nodes: usize,
    /// Mean effect size H.
    pub mean_effect: f64,
}

/// Results of the intervals for classes of one size from one population.
#[derive(Clone, Debug, PartialEq)]
pub struct IntervalTrial {
    /// The population.
    pub population: Spread,
    /// Number of people in each class.
    pub people: usize,
    /// Number of classes with an interval.
    pub tried: usize,
    /// Number of intervals that contain the truth: the program's own, one around the dispersion of left-out people, and one around the
    /// dispersion of the class itself.
    pub covered: [usize; 3],
    /// Mean width of the program's own interval, face units.
    pub width: f64,
    /// Mean dispersion of the classes, face units.
    pub mean_dispersion: f64,
    /// True dispersion: that of [`GroupStudyOptions::truth`] people, face units.
    pub truth: f64,
}

/// Results of the study.
#[derive(Clone, Debug, PartialEq)]
pub struct GroupStudy {
    /// Results of the tests, by difference.
    pub trials: Vec<GroupTrial>,
    /// Results of the intervals, by population, then by number of people.
    pub intervals: Vec<IntervalTrial>,
    /// Duration of one test with 10,000 permutations on the first pair, seconds.
    pub seconds_per_10000: f64,
}

/// Significance level of every test.
const SIGNIFICANCE: f64 = 0.05;

/// Size of the range of person numbers of one pair; ranges of different pairs do not overlap.
const PEOPLE_PER_PAIR: u64 = 1 << 20;

/// Why the study failed.
#[derive(Debug, thiserror::Error)]
pub enum GroupStudyError {
    /// The FAPUs of Candide-3 cannot be measured.
    #[error(transparent)]
    Fapus(#[from] FapusError),
    /// A model is invalid.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// The statistics of a class failed.
    #[error(transparent)]
    Statistics(#[from] StatisticsError),
}

/// Runs tests and intervals on synthetic people. `tick` is called from many threads after every pair and interval.
///
/// # Errors
/// [`GroupStudyError`] when models or statistics cannot be made.
pub fn evaluate_groups(options: &GroupStudyOptions, tick: impl Fn() + Sync) -> Result<GroupStudy, GroupStudyError> {
    let people = SyntheticPeople::new(options.seed)?;
    let [first, second] = options.people;
    // Nodes that the smile does not move cannot differ.
    let still = people.fields(0, 0.0);
    let strong = people.fields(0, 1.0);
    let is_still: Vec<bool> = (0..still.node_count())
        .map(|k| (0..still.field_count()).all(|m| (strong.vector(m, k) - still.vector(m, k)).norm() < 1e-9))
        .collect();
    let pair = |number: usize, trial: usize, difference: f64| {
        let base = ((trial * options.pairs + number) as u64 + 1) * PEOPLE_PER_PAIR;
        let fields = |i: usize| vec![people.fields(base + i as u64, if i < first { 1.0 } else { 1.0 + difference })];
        (0..first + second).map(fields).collect::<Vec<_>>()
    };
    let compare =
        |permutations| CompareOptions { permutations, people: usize::MAX, significance: SIGNIFICANCE, seed: options.seed };
    let mut trials = Vec::new();
    for (trial, &difference) in options.differences.iter().enumerate() {
        let one = |number: usize| {
            let stream = (trial * options.pairs + number) as u32;
            let tested = test(&pair(number, trial, difference), first, &compare(options.permutations), stream);
            let wrong = tested.node_p.iter().zip(&is_still).any(|(&p, &still)| p <= SIGNIFICANCE && (still || difference == 0.0));
            tick();
            (tested.p <= SIGNIFICANCE, wrong, tested.effect)
        };
        let outcomes: Vec<(bool, bool, f64)> = (0..options.pairs).into_par_iter().map(one).collect();
        trials.push(GroupTrial {
            difference,
            pairs: options.pairs,
            rejected: outcomes.iter().filter(|o| o.0).count(),
            wrong_nodes: outcomes.iter().filter(|o| o.1).count(),
            mean_effect: outcomes.iter().map(|o| o.2).sum::<f64>() / options.pairs.max(1) as f64,
        });
    }
    let started = Instant::now();
    let _ = test(&pair(0, 0, 0.0), first, &compare(10_000), 0);
    let seconds_per_10000 = started.elapsed().as_secs_f64();
    let mut intervals = Vec::new();
    if options.intervals > 0 {
        for &population in &options.populations {
            intervals.extend(coverage(&people.clone().with_spread(population), population, options, &tick)?);
        }
    }
    Ok(GroupStudy { trials, intervals, seconds_per_10000 })
}

/// Counts the intervals that contain the dispersion of a very large class.
fn coverage(
    people: &SyntheticPeople,
    population: Spread,
    options: &GroupStudyOptions,
    tick: &(impl Fn() + Sync),
) -> Result<Vec<IntervalTrial>, GroupStudyError> {
    let statistics = StatisticsOptions::default();
    let label = || ClassLabel { emotion: "happiness".to_owned(), group: BTreeMap::new() };
    let class = |base: u64, count: usize| -> Result<Vec<SequenceModel>, GroupStudyError> {
        let model = |i: usize| {
            let id = SequenceId { subject: format!("p{i:07}"), sequence: "1".to_owned() };
            Ok(SequenceModel { id, model: people.model(base + i as u64, 1.0)? })
        };
        (0..count).into_par_iter().map(model).collect()
    };
    let far = u64::MAX / 2;
    let truth = representative(label(), &class(far, options.truth)?, people.wireframe(), &statistics)?.dispersion.unwrap_or(0.0);
    let live = people.wireframe().live_nodes();
    let mut trials = Vec::new();
    for &count in &options.interval_people {
        let mut trial =
            IntervalTrial { population, people: count, tried: 0, covered: [0; 3], width: 0.0, mean_dispersion: 0.0, truth };
        for number in 0..options.intervals {
            let models = class(far + (number as u64 + 1) * PEOPLE_PER_PAIR, count)?;
            let of_class = representative(label(), &models, people.wireframe(), &statistics)?;
            let models: Vec<&SequenceModel> = models.iter().collect();
            let made =
                dispersion_replicates(&of_class, &models, live, &statistics, options.replicates, (options.seed, number as u32));
            tick();
            let Some(made) = made else { continue };
            let ours = made.interval();
            trial.tried += 1;
            for (covered, i) in trial.covered.iter_mut().zip([ours, made.around_left_out(), made.around_own()]) {
                *covered += usize::from((i.low..=i.high).contains(&truth));
            }
            trial.width += (ours.high - ours.low) / options.intervals as f64;
            trial.mean_dispersion += made.dispersion / options.intervals as f64;
        }
        trials.push(trial);
    }
    Ok(trials)
}

impl GroupStudy {
    /// Returns a row for each difference, with the share of rejected tests and its 95 % interval.
    pub fn table(&self) -> Table {
        let mut table = Table::new([
            "difference_percent",
            "pairs",
            "rejected",
            "rejected_percent",
            "low_percent",
            "high_percent",
            "wrong_nodes_percent",
            "mean_effect_percent",
        ]);
        for t in &self.trials {
            let (low, high) = wilson(t.rejected, t.pairs);
            table.rows.push(vec![
                Cell::Number(100.0 * t.difference, 0),
                Cell::Count(t.pairs),
                Cell::Count(t.rejected),
                Cell::Number(100.0 * t.rejected as f64 / t.pairs.max(1) as f64, 1),
                Cell::Number(100.0 * low, 1),
                Cell::Number(100.0 * high, 1),
                Cell::Number(100.0 * t.wrong_nodes as f64 / t.pairs.max(1) as f64, 1),
                Cell::Number(100.0 * t.mean_effect, 2),
            ]);
        }
        table
    }
}

impl GroupStudy {
    /// Returns a row for each population and number of people, with the share of intervals that contain the truth and its 95 % interval.
    pub fn interval_table(&self) -> Table {
        let mut table = Table::new([
            "population",
            "people",
            "intervals",
            "covered_percent",
            "low_percent",
            "high_percent",
            "covered_left_out_percent",
            "covered_own_percent",
            "mean_width",
            "mean_dispersion",
            "true_dispersion",
        ]);
        for t in &self.intervals {
            let (low, high) = wilson(t.covered[0], t.tried);
            let percent = |count: usize| Cell::Number(100.0 * count as f64 / t.tried.max(1) as f64, 1);
            table.rows.push(vec![
                Cell::Text(t.population.name().to_owned()),
                Cell::Count(t.people),
                Cell::Count(t.tried),
                percent(t.covered[0]),
                Cell::Number(100.0 * low, 1),
                Cell::Number(100.0 * high, 1),
                percent(t.covered[1]),
                percent(t.covered[2]),
                Cell::Number(t.width, 3),
                Cell::Number(t.mean_dispersion, 3),
                Cell::Number(t.truth, 3),
            ]);
        }
        table
    }
}

/// Returns the 95 % interval of a share (Wilson 1927).
pub fn wilson(successes: usize, trials: usize) -> (f64, f64) {
    const Z: f64 = 1.959_963_985;
    if trials == 0 {
        return (0.0, 1.0);
    }
    let (n, p) = (trials as f64, successes as f64 / trials as f64);
    let center = p + Z * Z / (2.0 * n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    let scale = 1.0 + Z * Z / n;
    (((center - half) / scale).max(0.0), ((center + half) / scale).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wilson_s_interval_of_a_half() {
        // n = 100, p = 0.5: (0.5 + 0.0192 -+ 1.96 sqrt(0.0025 + 0.000096)) / 1.0384 = 0.4038 and 0.5962.
        let (low, high) = wilson(50, 100);
        assert!((low - 0.4038).abs() < 1e-4 && (high - 0.5962).abs() < 1e-4);
        assert_eq!(wilson(0, 0), (0.0, 1.0));
    }

    #[test]
    fn a_large_difference_is_found_and_none_is_hardly_ever() {
        let options = GroupStudyOptions {
            people: [12, 12],
            pairs: 40,
            differences: vec![0.0, 1.0],
            permutations: 199,
            intervals: 0,
            interval_people: Vec::new(),
            populations: Vec::new(),
            replicates: 0,
            truth: 0,
            seed: 3,
        };
        let study = evaluate_groups(&options, || {}).unwrap();
        // With 40 true null hypotheses at 5 %, more than 8 rejections occur for one in a hundred thousand seeds; this seed is fixed.
        assert!(study.trials[0].rejected <= 8, "{:?}", study.trials);
        assert!(study.trials[1].rejected >= 38, "{:?}", study.trials);
        assert_eq!(evaluate_groups(&options, || {}).unwrap().trials, study.trials);
    }
}
