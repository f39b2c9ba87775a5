//! Compensated summation.

/// A running sum whose rounding error does not grow with the number of terms (Neumaier 1974).
///
/// The error is about 2^-53 of the sum's magnitude plus n 2^-106 of the sum of magnitudes. The order of the terms, which is fixed
/// everywhere in this crate anyway, therefore hardly matters.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct CompensatedSum {
    sum: f64,
    correction: f64,
}

impl CompensatedSum {
    /// Adds one term.
    #[inline]
    pub(crate) fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        self.correction += if self.sum.abs() >= term.abs() { (self.sum - sum) + term } else { (term - sum) + self.sum };
        self.sum = sum;
    }

    /// Returns the sum of the terms so far.
    pub(crate) fn value(self) -> f64 {
        self.sum + self.correction
    }

    /// Returns the sum of all terms of an iterator.
    pub(crate) fn of(terms: impl IntoIterator<Item = f64>) -> f64 {
        let mut sum = Self::default();
        terms.into_iter().for_each(|term| sum.add(term));
        sum.value()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_terms_survive_large_ones() {
        // A plain sum gives 0: 1 is lost in 1e100, which then cancels.
        assert_eq!(CompensatedSum::of([1.0, 1e100, 1.0, -1e100]), 2.0);
        assert_eq!(CompensatedSum::of([]), 0.0);
    }
}
