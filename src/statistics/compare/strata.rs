//! Strata: labels are exchanged only between people of the same stratum, such as an age or a site.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// The stratum of every person.
///
/// ```
/// use grimace::statistics::Strata;
///
/// let rows = [("S001", vec!["24".to_owned()]), ("S002", vec!["31".to_owned()])];
/// let strata = Strata::new(&["age".to_owned()], rows);
/// assert_eq!(strata.of(&["S002", "S001"])?, ["31", "24"]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Strata {
    columns: String,
    /// Stratum by subject: one value, or all values of a subject with several, or none.
    of: BTreeMap<String, Vec<String>>,
}

/// Why people cannot be permuted within strata.
///
/// ```
/// use grimace::statistics::{Strata, StrataError};
///
/// let strata = Strata::new(&["age".to_owned()], [("S001", vec!["24".to_owned()])]);
/// assert!(matches!(strata.of(&["S001", "S002"]), Err(StrataError::Missing { people: 1, .. })));
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, thiserror::Error)]
pub enum StrataError {
    /// People without a value in a strata column.
    #[error(
        "{people} of the people have no value in `{columns}`, for example {first}; permutation within strata needs a value for every person"
    )]
    Missing {
        /// Number of such people.
        people: usize,
        /// The first of them.
        first: String,
        /// The columns.
        columns: String,
    },
    /// A person with several values in a strata column.
    #[error("{subject} has several values in `{columns}` ({values}); a person belongs to one stratum")]
    Several {
        /// The person.
        subject: String,
        /// Their values.
        values: String,
        /// The columns.
        columns: String,
    },
    /// No stratum has people of different groups.
    #[error("no stratum of `{columns}` has people of different groups: groups and strata coincide and cannot be separated")]
    Coincide {
        /// The columns.
        columns: String,
    },
}

/// Indices of the people of one stratum, and how many of them are in the first group.
pub(crate) type Block = (Vec<usize>, usize);

impl Strata {
    /// Makes strata from the joined values of `columns`. There is one row per sequence: subject and values. Rows with an empty value are
    /// ignored.
    pub fn new<'a>(columns: &[String], rows: impl IntoIterator<Item = (&'a str, Vec<String>)>) -> Self {
        let mut of: BTreeMap<String, Vec<String>> = BTreeMap::new();
        for (subject, values) in rows {
            let known = of.entry(subject.to_owned()).or_default();
            let value = values.join(" + ");
            if values.iter().all(|v| !v.is_empty()) && !known.contains(&value) {
                known.push(value);
            }
        }
        Self { columns: columns.join(", "), of }
    }

    /// Returns the values of a person: one, unless the person has none or several.
    pub fn values(&self, subject: &str) -> &[String] {
        self.of.get(subject).map_or(&[], Vec::as_slice)
    }

    /// Returns the columns, joined.
    pub fn columns(&self) -> &str {
        &self.columns
    }

    /// Returns the stratum of each subject.
    ///
    /// # Errors
    /// [`StrataError`] for people without a stratum or with several.
    pub fn of<'a>(&'a self, subjects: &[&str]) -> Result<Vec<&'a str>, StrataError> {
        let values = |subject: &&str| self.of.get(*subject).map_or(&[][..], Vec::as_slice);
        let columns = self.columns.clone();
        if let Some(first) = subjects.iter().find(|s| values(s).is_empty()) {
            let people = subjects.iter().filter(|s| values(s).is_empty()).count();
            return Err(StrataError::Missing { people, first: (*first).to_owned(), columns });
        }
        if let Some(subject) = subjects.iter().find(|s| values(s).len() > 1) {
            let values = values(subject).join(", ");
            return Err(StrataError::Several { subject: (*subject).to_owned(), values, columns });
        }
        Ok(subjects.iter().map(|s| values(s)[0].as_str()).collect())
    }

    /// Returns the indices of the people of every stratum.
    ///
    /// # Errors
    /// [`StrataError`].
    pub(crate) fn places(&self, subjects: &[&str]) -> Result<Vec<Vec<usize>>, StrataError> {
        let mut places: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        let of = self.of(subjects)?;
        of.into_iter().enumerate().for_each(|(place, stratum)| places.entry(stratum).or_default().push(place));
        Ok(places.into_values().collect())
    }

    /// Returns the people of every stratum as blocks. The first `first` subjects are the first group.
    ///
    /// # Errors
    /// [`StrataError`].
    pub(crate) fn blocks(&self, subjects: &[&str], first: usize) -> Result<Vec<Block>, StrataError> {
        let block = |places: Vec<usize>| {
            let in_first = places.iter().filter(|&&place| place < first).count();
            (places, in_first)
        };
        let blocks: Vec<Block> = self.places(subjects)?.into_iter().map(block).collect();
        if blocks.iter().all(|(places, in_first)| *in_first == 0 || *in_first == places.len()) {
            return Err(StrataError::Coincide { columns: self.columns.clone() });
        }
        Ok(blocks)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn strata(rows: &[(&str, &str)]) -> Strata {
        Strata::new(&["site".to_owned()], rows.iter().map(|&(s, v)| (s, vec![v.to_owned()])))
    }

    #[test]
    fn people_are_sorted_into_their_strata() {
        let strata = strata(&[("a", "x"), ("b", "y"), ("c", "x"), ("d", "y"), ("a", "x")]);
        assert_eq!(strata.blocks(&["a", "b", "c", "d"], 2).unwrap(), [(vec![0, 2], 1), (vec![1, 3], 1)]);
    }

    #[test]
    fn useless_strata_give_the_reason() {
        let why = |rows: &[(&str, &str)]| strata(rows).blocks(&["a", "b"], 1).unwrap_err().to_string();
        assert!(why(&[("a", "x"), ("b", "")]).starts_with("1 of the people have no value in `site`, for example b"));
        assert!(why(&[("a", "x"), ("b", "x"), ("b", "y")]).starts_with("b has several values in `site` (x, y)"));
        assert!(why(&[("a", "x"), ("b", "y")]).contains("groups and strata coincide"));
    }
}
