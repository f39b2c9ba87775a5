//! Notes about the columns by which people are told apart: people with several values or without one, and values that may mean something
//! else than they say.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    common_spellings,
    values::{
        SequenceLabels, far_numbers_said, is_missing, measures_said, missing_words_said, no_numbers_said, number_of,
        perhaps_missing_said,
    },
};
use crate::output::{count, listed};

/// Most people or values that a note names.
const NAMED: usize = 6;

/// Returns the notes to the user about the columns to group by, of strata and of numbers.
pub fn column_notes(labels: &[SequenceLabels<'_>], by: &[String], strata: &[String], covariates: &[String]) -> Vec<String> {
    let told_apart_by = [by, strata].concat();
    [
        missing_words_said(labels, &told_apart_by),
        perhaps_missing_said(labels, &told_apart_by),
        measures_said(labels, &told_apart_by),
        same_numbers_said(labels, &told_apart_by),
        several_groups_said(labels, by),
        no_numbers_said(labels, covariates),
        perhaps_thousands_said(labels, covariates),
        far_numbers_said(labels, covariates),
        several_numbers_said(labels, covariates),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Returns a note to the user about people without a value in a stratum column: no test within strata can be made with them.
pub fn without_stratum_said(labels: &[SequenceLabels<'_>], strata: &[String]) -> Option<String> {
    let people: BTreeSet<&str> = labels.iter().map(|(id, ..)| id.subject.as_str()).collect();
    let without = |column: &String| {
        let has = |(.., metadata): &&SequenceLabels<'_>| metadata.get(column).is_some_and(|value| !is_missing(value));
        let known: BTreeSet<&str> = labels.iter().filter(has).map(|(id, ..)| id.subject.as_str()).collect();
        let without: Vec<String> = people.difference(&known).map(|&subject| subject.to_owned()).collect();
        (!without.is_empty()).then(|| format!("`{column}` of {}", listed(&without, NAMED)))
    };
    let found: Vec<String> = strata.iter().collect::<BTreeSet<_>>().into_iter().filter_map(without).collect();
    (!found.is_empty()).then(|| {
        format!(
            "emotions that these people show are not tested, as permutation within strata needs a value for every person: {}; add the \
             values, or leave these people out",
            found.join("; ")
        )
    })
}

/// Returns the different values of each person in a column, as `value` reads them.
fn values_of<'a, T: Ord>(
    labels: &[SequenceLabels<'a>],
    column: &str,
    value: impl Fn(&'a str) -> Option<T>,
) -> BTreeMap<&'a str, BTreeSet<T>> {
    let mut people: BTreeMap<&str, BTreeSet<T>> = BTreeMap::new();
    for (id, _, metadata) in labels {
        if let Some(value) = metadata.get(column).and_then(|text| value(text)) {
            people.entry(&id.subject).or_default().insert(value);
        }
    }
    people
}

/// Returns a note to the user about people in several groups. Where most people are in several, as before and after a treatment, there is
/// nothing to say.
fn several_groups_said(labels: &[SequenceLabels<'_>], by: &[String]) -> Option<String> {
    let of_column = |column: &String| {
        let spellings = common_spellings(labels.iter().filter_map(|(.., metadata)| metadata.get(column)).map(String::as_str));
        let spelled = |text: &str| Some(spellings.get(&super::spelling_key(text))?.clone()).filter(|value| !is_missing(value));
        let people = values_of(labels, column, spelled);
        let several: Vec<(&&str, &BTreeSet<String>)> = people.iter().filter(|(_, values)| values.len() > 1).collect();
        let said = |(subject, values): &(&&str, &BTreeSet<String>)| {
            format!("{subject} ({})", values.iter().cloned().collect::<Vec<_>>().join(", "))
        };
        (!several.is_empty() && 2 * several.len() < people.len())
            .then(|| format!("{} in `{column}`", listed(&several.iter().map(said).collect::<Vec<_>>(), NAMED)))
    };
    let found: Vec<String> = by.iter().collect::<BTreeSet<_>>().into_iter().filter_map(of_column).collect();
    (!found.is_empty()).then(|| {
        format!(
            "people who are in several groups, each sequence in its own; two groups that share a person in an emotion are not tested as a \
             whole: {}",
            found.join("; ")
        )
    })
}

/// Returns a note to the user about people with several numbers in a column.
fn several_numbers_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let of_column = |column: &String| {
        let people = values_of(labels, column, |text| Some(number_of(text)?.to_bits()));
        let several = people.iter().filter(|(_, numbers)| numbers.len() > 1);
        let said = |(subject, numbers): (&&str, &BTreeSet<u64>)| {
            let mut numbers: Vec<f64> = numbers.iter().map(|bits| f64::from_bits(*bits)).collect();
            numbers.sort_by(f64::total_cmp);
            let named = numbers.iter().take(3).map(f64::to_string).collect::<Vec<_>>().join(", ");
            format!("{subject} ({named}{})", if numbers.len() > 3 { " and others" } else { "" })
        };
        let several: Vec<String> = several.map(said).collect();
        (!several.is_empty()).then(|| {
            let how_many = count(several.len(), "person", "people");
            format!("{how_many} in `{column}`: {}", listed(&several, NAMED))
        })
    };
    let found: Vec<String> = columns.iter().collect::<BTreeSet<_>>().into_iter().filter_map(of_column).collect();
    (!found.is_empty()).then(|| {
        format!(
            "several numbers of one person, who counts in each emotion with the mean of those of its sequences: {}",
            found.join("; ")
        )
    })
}

/// Returns a note to the user about one number in several spellings, such as `1` and `1.0`: these are several groups.
fn same_numbers_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let mut found = Vec::new();
    for column in columns.iter().collect::<BTreeSet<_>>() {
        let mut spelled: BTreeMap<u64, BTreeSet<&str>> = BTreeMap::new();
        for value in labels.iter().filter_map(|(.., metadata)| metadata.get(column)).map(|value| value.trim()) {
            if let Some(number) = number_of(value) {
                // 0 and -0 are one number.
                spelled.entry((number + 0.0).to_bits()).or_default().insert(value);
            }
        }
        let several = spelled.into_values().filter(|spellings| spellings.len() > 1);
        found.extend(several.map(|spellings| {
            let quoted: Vec<String> = spellings.into_iter().map(|value| format!("`{value}`")).collect();
            format!("{} in the column `{column}`", quoted.join(" and "))
        }));
    }
    (!found.is_empty())
        .then(|| format!("one number in several spellings, each a group of its own; write them alike: {}", listed(&found, NAMED)))
}

/// Returns a note to the user about numbers whose point may separate thousands, such as `1.200` in a column whose other numbers are whole.
/// They are read with a decimal point.
fn perhaps_thousands_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let has_three = |value: &str| {
        let parts = value.trim_start_matches(['-', '+']).split_once('.');
        parts.is_some_and(|(whole, rest)| {
            (1..=3).contains(&whole.len()) && whole != "0" && rest.len() == 3 && rest.bytes().all(|b| b.is_ascii_digit())
        })
    };
    let mut found = Vec::new();
    for column in columns.iter().collect::<BTreeSet<_>>() {
        let values = labels.iter().filter_map(|(.., metadata)| metadata.get(column)).map(|value| value.trim());
        let values: BTreeSet<&str> = values.filter(|value| number_of(value).is_some()).collect();
        let (three, others): (Vec<&str>, Vec<&str>) = values.into_iter().partition(|value| has_three(value));
        if !others.is_empty() && others.iter().all(|value| !value.contains(['.', ','])) {
            let said = |value| format!("`{value}` in the column `{column}` as {}", number_of(value).unwrap_or_default());
            found.extend(three.into_iter().map(said));
        }
    }
    (!found.is_empty())
        .then(|| format!("numbers read with a decimal point; if it separates thousands, leave it out: {}", listed(&found, NAMED)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::units::SequenceId;

    type Rows = Vec<(SequenceId, &'static str, BTreeMap<String, String>)>;

    /// Rows of subject, emotion and value of the column `c`.
    fn rows(rows: &[(&str, &'static str, &str)]) -> Rows {
        let row = |(k, &(subject, emotion, value)): (usize, &(&str, &'static str, &str))| {
            let id = SequenceId { subject: subject.to_owned(), sequence: k.to_string() };
            (id, emotion, BTreeMap::from([("c".to_owned(), value.to_owned())]))
        };
        rows.iter().enumerate().map(row).collect()
    }

    fn labels(rows: &Rows) -> Vec<SequenceLabels<'_>> {
        rows.iter().map(|(id, emotion, metadata)| (id, *emotion, metadata)).collect()
    }

    fn column() -> [String; 1] {
        ["c".to_owned()]
    }

    #[test]
    fn a_person_in_two_groups_is_named_unless_most_are() {
        let one = rows(&[("a", "joy", "x"), ("a", "fear", "y"), ("b", "joy", "x"), ("c", "joy", "y"), ("b", "fear", "X ")]);
        let said = several_groups_said(&labels(&one), &column()).unwrap();
        assert!(said.ends_with("as a whole: a (x, y) in `c`"), "{said}");
        let sessions = rows(&[("a", "joy", "x"), ("a", "joy", "y"), ("b", "joy", "x"), ("b", "joy", "y"), ("c", "joy", "y")]);
        assert_eq!(several_groups_said(&labels(&sessions), &column()), None);
        let missing = rows(&[("a", "joy", "x"), ("a", "fear", "NA"), ("b", "joy", "y"), ("c", "joy", "y")]);
        assert_eq!(several_groups_said(&labels(&missing), &column()), None);
    }

    #[test]
    fn people_with_several_numbers_are_named_with_them() {
        let two = rows(&[("a", "joy", "100"), ("a", "fear", "9"), ("a", "fear", "9.0"), ("b", "joy", "4"), ("b", "joy", "x")]);
        let said = several_numbers_said(&labels(&two), &column()).unwrap();
        assert!(said.ends_with(": 1 person in `c`: a (9, 100)"), "{said}");
        assert_eq!(several_numbers_said(&labels(&two)[3..], &column()), None);
    }

    #[test]
    fn one_number_in_two_spellings_is_named() {
        let codes = rows(&[("a", "joy", "1"), ("b", "joy", "1.0 "), ("c", "joy", "2"), ("d", "joy", "x")]);
        let said = same_numbers_said(&labels(&codes), &column()).unwrap();
        assert!(said.ends_with(": `1` and `1.0` in the column `c`"), "{said}");
        assert_eq!(same_numbers_said(&labels(&codes)[2..], &column()), None);
    }

    #[test]
    fn a_point_that_may_separate_thousands_is_named() {
        let ages = rows(&[("a", "joy", "1.200"), ("b", "joy", "34"), ("c", "joy", "NA")]);
        let said = perhaps_thousands_said(&labels(&ages), &column()).unwrap();
        assert!(said.ends_with(": `1.200` in the column `c` as 1.2"), "{said}");
        // All numbers have three decimals, or others have decimals.
        let doses = rows(&[("a", "joy", "1.200"), ("b", "joy", "34.000"), ("c", "joy", "2.5"), ("d", "joy", "3")]);
        assert_eq!(perhaps_thousands_said(&labels(&doses)[..2], &column()), None);
        assert_eq!(perhaps_thousands_said(&labels(&doses), &column()), None);
    }

    #[test]
    fn people_without_a_stratum_are_named() {
        let sites = rows(&[("a", "joy", "x"), ("b", "joy", ""), ("b", "fear", "NA"), ("c", "joy", ""), ("c", "fear", "y")]);
        let said = without_stratum_said(&labels(&sites), &column()).unwrap();
        assert!(said.contains("every person: `c` of b; add"), "{said}");
        assert_eq!(without_stratum_said(&labels(&sites)[..1], &column()), None);
    }
}
