//! Values of the metadata columns by which people are told apart: missing ones, numbers, and notes about them.

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    output::{count, listed},
    robust::median,
    text::is_missing_word,
    units::SequenceId,
};

/// Group of the models without a value in the grouping column ([`is_missing`]).
pub const UNKNOWN_GROUP: &str = "unknown";

/// Returns whether a value of a grouping or stratum column means "missing": it is blank, one of the words for it, or `unknown` in any case.
pub fn is_missing(value: &str) -> bool {
    let value = value.trim();
    value.is_empty() || is_missing_word(value) || value.eq_ignore_ascii_case(UNKNOWN_GROUP)
}

/// Labels of a sequence: its id, its emotion, and the further columns of the manifest.
pub type SequenceLabels<'a> = (&'a SequenceId, &'a str, &'a BTreeMap<String, String>);

/// Returns a note to the user if grouping or stratum columns contain words for a missing value.
pub fn missing_words_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let (values, list) = counted_values(labels, columns, |value| !value.is_empty() && is_missing(value));
    let example = values.first()?;
    Some(format!(
        "words for a missing value are treated as missing: {} (if this is the name of a group, use a longer name, such as `{example} \
         group`)",
        listed(&list, 6)
    ))
}

/// Words, in any case, that are values but may stand for a missing one.
const PERHAPS_MISSING: [&str; 3] = ["none", "nil", "missing"];

/// Returns a note to the user if grouping or stratum columns contain words that may stand for a missing value. They are values.
pub fn perhaps_missing_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let is_word = |value: &str| PERHAPS_MISSING.iter().any(|word| value.eq_ignore_ascii_case(word));
    let (_, list) = counted_values(labels, columns, is_word);
    (!list.is_empty()).then(|| {
        format!("values that may be words for a missing value: {}; if nothing is known there, write NA", listed(&list, 6))
    })
}

/// Returns the values of some columns that satisfy a condition, and each in words, with its column and its number of sequences. They are in
/// the order of columns, then of their bytes.
fn counted_values<'a>(
    labels: &[SequenceLabels<'a>],
    columns: &[String],
    is_one: impl Fn(&str) -> bool,
) -> (Vec<&'a str>, Vec<String>) {
    let mut found: BTreeMap<(&str, &'a str), usize> = BTreeMap::new();
    for column in columns.iter().collect::<BTreeSet<_>>() {
        let values = labels.iter().filter_map(|(.., metadata)| metadata.get(column)).map(|value| value.trim());
        values.filter(|value| is_one(value)).for_each(|value| *found.entry((column, value)).or_default() += 1);
    }
    let text = |((column, value), n): (&(&str, &str), &usize)| {
        format!("`{value}` in the column `{column}` ({})", count(*n, "sequence", "sequences"))
    };
    (found.keys().map(|(_, value)| *value).collect(), found.iter().map(text).collect())
}

/// Largest number of values of a number column that are taken for group names without further checks, such as 0 and 1 or the numbers of
/// sites.
const FEW_NUMBERS: usize = 6;

/// Mean number of people per group from which numbers are taken for group names, however many groups there are.
const MANY_PEOPLE: usize = 10;

/// Parses a number with a decimal point or a decimal comma.
///
/// A value whose comma may separate thousands, such as `1,500`, is ambiguous and gives `None`.
pub fn number_of(value: &str) -> Option<f64> {
    let value = value.trim();
    let may_be_thousands = value.split_once(',').is_some_and(|(whole, rest)| {
        let whole = whole.trim_start_matches(['-', '+']);
        (1..=3).contains(&whole.len()) && whole != "0" && rest.len() == 3 && rest.chars().all(|c| c.is_ascii_digit())
    });
    let number = value.replacen(',', ".", 1).parse().ok();
    number.filter(|number: &f64| number.is_finite() && !may_be_thousands)
}

/// Returns an addition to a message if a value is rejected because its comma may separate thousands; otherwise an empty text.
pub(super) fn thousands_said(value: &str) -> &'static str {
    let point = value.replacen(',', ".", 1);
    if point != value && number_of(&point).is_some() { "; the comma could separate thousands: write a decimal point" } else { "" }
}

/// Returns a note to the user if number columns contain values that are neither numbers nor words for a missing value.
pub fn no_numbers_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let mut found: BTreeMap<(&str, &str), BTreeSet<&str>> = BTreeMap::new();
    for ((id, _, metadata), column) in labels.iter().flat_map(|l| columns.iter().map(move |column| (l, column))) {
        let value = metadata.get(column).map(|value| value.trim());
        if let Some(value) = value.filter(|value| !is_missing(value) && number_of(value).is_none()) {
            found.entry((column, value)).or_default().insert(&id.subject);
        }
    }
    let said = |((column, value), who): ((&str, &str), BTreeSet<&str>)| {
        format!("`{value}` in the column `{column}` ({}{})", count(who.len(), "person", "people"), thousands_said(value))
    };
    let list: Vec<String> = found.into_iter().map(said).collect();
    (!list.is_empty()).then(|| format!("values that are not numbers are ignored: {}", listed(&list, 6)))
}

/// Distance of a number from the median of all people, in robust standard deviations, from which it is named; and the same for
/// [`MISSING_CODES`].
const FAR_DEVIATIONS: [f64; 2] = [25.0, 3.0];
/// Numbers that often stand for a missing value.
const MISSING_CODES: [f64; 10] = [-9.0, -77.0, -88.0, -99.0, -999.0, -9999.0, 99.0, 999.0, 9999.0, 99999.0];
/// Fewest people among whom a number can be far from all others.
const FEWEST_PEOPLE: usize = 5;

/// Returns a note to the user if number columns contain numbers far from all others, such as an age of -99 or 999. They are used.
pub fn far_numbers_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let mut list = Vec::new();
    for column in columns.iter().collect::<BTreeSet<_>>() {
        let number = |metadata: &BTreeMap<String, String>| metadata.get(column).and_then(|value| number_of(value));
        // A person may have several numbers.
        let people: BTreeSet<(&str, u64)> =
            labels.iter().filter_map(|(id, _, metadata)| Some((id.subject.as_str(), number(metadata)?.to_bits()))).collect();
        let mut numbers: Vec<f64> = people.iter().map(|(_, bits)| f64::from_bits(*bits)).collect();
        let Some(middle) = median(&mut numbers).filter(|_| people.len() >= FEWEST_PEOPLE) else { continue };
        let mut ways: Vec<f64> = numbers.iter().map(|value| (value - middle).abs()).collect();
        // 1.4826 times the median absolute deviation is the standard deviation of normal numbers.
        let deviation = 1.4826 * median(&mut ways).unwrap_or(0.0);
        let mut far: Vec<(f64, usize)> = Vec::new();
        numbers.sort_by(f64::total_cmp);
        let is_far = |value: &f64| match (MISSING_CODES.contains(value), (value - middle).abs()) {
            (true, way) => way > FAR_DEVIATIONS[1] * deviation,
            // Without a deviation nothing else can be judged.
            (false, way) => deviation > 0.0 && way > FAR_DEVIATIONS[0] * deviation,
        };
        for value in numbers.into_iter().filter(is_far) {
            match far.last_mut() {
                Some((last, count)) if *last == value => *count += 1,
                _ => far.push((value, 1)),
            }
        }
        list.extend(far.iter().map(|(value, n)| format!("{value} in the column `{column}` ({})", count(*n, "person", "people"))));
    }
    (!list.is_empty()).then(|| {
        format!("numbers far from all others: {}; if they stand for a missing value, leave the field empty", listed(&list, 6))
    })
}

/// Returns a note to the user if grouping or stratum columns seem to hold measurements instead of groups.
///
/// A column counts as a measurement if all its values are numbers and either of these holds: it has more than 6 different values, shared
/// by fewer than 10 people each on average; or it has more than 2 different values and more than half as many as there are people. The
/// values are still used as groups.
pub fn measures_said(labels: &[SequenceLabels<'_>], columns: &[String]) -> Option<String> {
    let people = labels.iter().map(|(id, ..)| id.subject.as_str()).collect::<BTreeSet<_>>().len();
    let measure = |column: &String| {
        let values: BTreeSet<&str> =
            labels.iter().filter_map(|(.., m)| m.get(column)).map(|v| v.trim()).filter(|v| !is_missing(v)).collect();
        let many = (values.len() > FEW_NUMBERS && people < MANY_PEOPLE * values.len())
            || (values.len() > 2 && 2 * values.len() > people);
        (many && values.iter().all(|value| number_of(value).is_some()))
            .then(|| format!("`{column}` ({} numbers of {people} people)", values.len()))
    };
    let found: Vec<String> = columns.iter().collect::<BTreeSet<_>>().into_iter().filter_map(measure).collect();
    let first = columns.iter().find(|column| measure(column).is_some())?;
    Some(format!(
        "each number forms its own group: {}; to test whether expressions change with numbers, use --covariate; for groups of several \
         people, add a column of classes, such as `{first}_group` with `under 30` and `30 and over`, and group by it",
        listed(&found, 6)
    ))
}
