//! Exchanges labels between people and collects the results.

use rand::RngExt;
use rayon::prelude::*;

use super::{CompareOptions, Strata, StrataError, arrangements::Arrangements, permutation::generator};

/// Labels of people, and the blocks of people (indices) within which labels are exchanged.
#[derive(Clone, Debug)]
pub(crate) struct Exchange {
    pub labels: Vec<usize>,
    pub blocks: Vec<Vec<usize>>,
}

impl Exchange {
    /// Exchanges labels between all people, or within strata.
    ///
    /// # Errors
    /// [`StrataError`]; [`StrataError::Coincide`] if all people of each stratum have the same label.
    pub fn new(labels: Vec<usize>, subjects: &[&str], strata: Option<&Strata>) -> Result<Self, StrataError> {
        let Some(strata) = strata else {
            let blocks = vec![(0..labels.len()).collect()];
            return Ok(Self { labels, blocks });
        };
        let blocks = strata.places(subjects)?;
        if blocks.iter().all(|places| places.iter().all(|&p| labels[p] == labels[places[0]])) {
            return Err(StrataError::Coincide { columns: strata.columns().to_owned() });
        }
        Ok(Self { labels, blocks })
    }

    /// Evaluates `of` on exchanged labels.
    ///
    /// If there are no more arrangements than the requested permutations, all are evaluated. Otherwise as many as requested are drawn,
    /// each with its own random numbers.
    pub fn permute<T: Send>(
        &self,
        options: &CompareOptions,
        (stream, purpose): (u32, u64),
        of: impl Fn(&[usize]) -> T + Sync,
    ) -> Exchanged<T> {
        let wanted = options.permutations.max(1);
        if let Some(all) = Arrangements::new(&self.labels, self.blocks.iter().map(Vec::as_slice), wanted) {
            return Exchanged { outcomes: (0..all.count()).into_par_iter().map(|k| of(&all.nth(k))).collect(), exhaustive: true };
        }
        let drawn = |unit: usize| {
            let mut random = generator(options.seed, stream, purpose, unit as u64);
            let mut shuffled = self.labels.clone();
            for places in &self.blocks {
                for k in (1..places.len()).rev() {
                    shuffled.swap(places[k], places[random.random_range(0..=k)]);
                }
            }
            of(&shuffled)
        };
        Exchanged { outcomes: (0..wanted).into_par_iter().map(drawn).collect(), exhaustive: false }
    }
}

/// Results of exchanged labels.
pub(crate) struct Exchanged<T> {
    pub outcomes: Vec<T>,
    /// Whether these are all arrangements.
    pub exhaustive: bool,
}

impl<T> Exchanged<T> {
    /// Returns the share of results for which `is_as_large` holds. The observed arrangement is one of all; to drawn ones it is added.
    pub fn p(&self, is_as_large: impl Fn(&T) -> bool) -> f64 {
        let count = self.outcomes.iter().filter(|outcome| is_as_large(outcome)).count();
        (self.extra() + count) as f64 / (self.extra() + self.outcomes.len()) as f64
    }

    /// Returns the smallest possible p.
    pub fn least_p(&self) -> f64 {
        1.0 / (self.extra() + self.outcomes.len()) as f64
    }

    fn extra(&self) -> usize {
        usize::from(!self.exhaustive)
    }
}
