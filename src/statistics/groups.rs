//! Splits models into classes: one for every emotion, and one for every emotion within every group of people.

use std::collections::{BTreeMap, BTreeSet};

use super::{
    ClassLabel, SequenceModel, common_spellings, spelling_key,
    values::{SequenceLabels, UNKNOWN_GROUP, is_missing, number_of, thousands_said},
};
use crate::units::SequenceId;

/// The emotion labels of the project in the order of every table. Other labels follow alphabetically.
pub const EMOTIONS: [&str; 8] = ["anger", "disgust", "fear", "happiness", "sadness", "surprise", "contempt", "neutral"];

/// A model with the labels of its sequence.
#[derive(Clone, Debug)]
pub struct LabelledModel {
    /// The model and its sequence.
    pub model: SequenceModel,
    /// Emotion label.
    pub emotion: String,
    /// Values of the manifest's further columns, by column name.
    pub metadata: BTreeMap<String, String>,
}

impl LabelledModel {
    /// Returns the labels of its sequence.
    pub fn labels(&self) -> SequenceLabels<'_> {
        (&self.model.id, &self.emotion, &self.metadata)
    }
}

/// Columns that every sequence has besides its emotion.
const ID_COLUMNS: [&str; 2] = ["subject", "sequence"];

/// Name of the emotion column.
const EMOTION_COLUMN: &str = "emotion";

/// Why models cannot be grouped.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GroupError {
    /// A column that no sequence has.
    #[error("no sequence has a column `{column}`; the columns are: {}; name one of these, or add yours to manifest.csv (`grimace init --people \
             TABLE` adds columns of a table of people)", known.join(", "))]
    UnknownColumn {
        /// Requested column.
        column: String,
        /// `subject`, `sequence`, and the metadata columns that at least one sequence has, sorted.
        known: Vec<String>,
    },
    /// The emotion, which divides the sequences in any case.
    #[error("cannot group by `{column}`: every emotion always has its own representative, and groups divide each emotion")]
    Emotion {
        /// Requested column.
        column: String,
    },
    /// A column that identifies sequences, given as a covariate.
    #[error("`{column}` identifies sequences; --covariate needs another column of the manifest, with a number for every person")]
    NoNumbersOfPeople {
        /// Requested column.
        column: String,
    },
    /// A covariate without any number.
    #[error("the column `{column}` has no numbers (a value is {example}), but --covariate needs numbers; use --by for words")]
    NoNumber {
        /// Requested column.
        column: String,
        /// One of its values.
        example: String,
    },
    /// A column that is empty in every sequence.
    #[error("the column `{column}` is empty in all {sequences} sequences")]
    EmptyColumn {
        /// Requested column.
        column: String,
        /// Number of sequences.
        sequences: usize,
    },
    /// Too many groups; each has a representative, a FAP file and a part of the report.
    #[error("grouping by {} makes {found} classes of emotion and group, more than {limit}; group by fewer columns, or by a column with fewer values", columns.join(", "))]
    TooManyGroups {
        /// The columns grouped by.
        columns: Vec<String>,
        /// Number of classes.
        found: usize,
        /// Largest number of classes allowed.
        limit: usize,
    },
}

/// Largest number of classes of emotion and group.
pub const MAX_CLASSES: usize = 1000;

/// Splits models into classes: one for every emotion and, with columns in `by`, one for every emotion and combination of the columns'
/// values that occurs.
///
/// A missing or blank value, or a word for it, gives the group [`UNKNOWN_GROUP`]. Values that differ only in case or blanks are one group
/// ([`common_spellings`]).
///
/// Emotions are in the order of [`EMOTIONS`], then alphabetical. Within an emotion the class of all its models comes first, then its
/// groups, alphabetically by the values in the order of `by`. A class's models keep the order of `models`.
///
/// # Errors
/// [`GroupError`] for a column that no model has or that is empty in all, and for more than `MAX_CLASSES` classes.
pub fn group_models<'a>(
    models: &'a [LabelledModel],
    by: &[String],
) -> Result<Vec<(ClassLabel, Vec<&'a SequenceModel>)>, GroupError> {
    check_columns(by, models.iter().map(|m| &m.metadata))?;
    group_models_unchecked(models, by)
}

/// [`group_models`] for a part of the models: a column may be empty in all of them.
///
/// # Errors
/// [`GroupError::TooManyGroups`].
pub fn group_models_unchecked<'a>(
    models: &'a [LabelledModel],
    by: &[String],
) -> Result<Vec<(ClassLabel, Vec<&'a SequenceModel>)>, GroupError> {
    let classes = group_sequences(models, LabelledModel::labels, by)?;
    let models_of =
        |(label, models): (ClassLabel, Vec<&'a LabelledModel>)| (label, models.into_iter().map(|m| &m.model).collect());
    Ok(classes.into_iter().map(models_of).collect())
}

/// [`group_models_unchecked`] for any items with labels.
///
/// # Errors
/// [`GroupError::TooManyGroups`].
pub fn group_sequences<'a, T>(
    sequences: &'a [T],
    labels: impl Fn(&'a T) -> SequenceLabels<'a>,
    by: &[String],
) -> Result<Vec<(ClassLabel, Vec<&'a T>)>, GroupError> {
    let all: Vec<SequenceLabels<'a>> = sequences.iter().map(labels).collect();
    let columns = Columns::new(by, all.iter().map(|&(.., metadata)| metadata));
    // Sorted by emotion, then by group values. The class of the whole emotion has no values and sorts first.
    let mut classes: BTreeMap<(usize, &str, Vec<&str>), Vec<&'a T>> = BTreeMap::new();
    for (sequence, &(id, emotion, metadata)) in sequences.iter().zip(&all) {
        let rank = EMOTIONS.iter().position(|&e| e == emotion).unwrap_or(EMOTIONS.len());
        classes.entry((rank, emotion, Vec::new())).or_default().push(sequence);
        if !by.is_empty() {
            classes.entry((rank, emotion, columns.values(id, metadata))).or_default().push(sequence);
        }
    }
    check_count(by, classes.len())?;
    let label = |emotion: &str, values: &[&str]| ClassLabel {
        emotion: emotion.to_owned(),
        group: by.iter().zip(values).map(|(column, &value)| (column.clone(), value.to_owned())).collect(),
    };
    Ok(classes.into_iter().map(|((_, emotion, values), of)| (label(emotion, &values), of)).collect())
}

/// The grouping columns, each with the most frequent spelling of its values.
struct Columns<'a> {
    by: &'a [String],
    spellings: BTreeMap<&'a str, BTreeMap<String, String>>,
}

impl<'a> Columns<'a> {
    fn new(by: &'a [String], metadata: impl Iterator<Item = &'a BTreeMap<String, String>> + Clone) -> Self {
        let values = move |column: &'a String| metadata.clone().filter_map(move |m| m.get(column)).map(String::as_str);
        let spellings = by.iter().map(|column| (column.as_str(), common_spellings(values(column)))).collect();
        Self { by, spellings }
    }

    /// Returns the group of a sequence: one value per column.
    fn values<'b>(&'b self, id: &'b SequenceId, metadata: &'b BTreeMap<String, String>) -> Vec<&'b str> {
        let value = |column: &String| {
            let value = match column.as_str() {
                "subject" => &id.subject,
                "sequence" => &id.sequence,
                _ => metadata.get(column).map_or("", |value| self.spelled(column, value)),
            };
            if value.is_empty() { UNKNOWN_GROUP } else { value }
        };
        self.by.iter().map(value).collect()
    }

    /// A value of a column in its most frequent spelling; empty if it is missing.
    fn spelled<'b>(&'b self, column: &str, value: &'b str) -> &'b str {
        if is_missing(value) {
            return "";
        }
        let common = self.spellings.get(column).and_then(|known| known.get(&spelling_key(value)));
        common.map_or(value.trim(), String::as_str)
    }
}

/// Writes the values of grouping columns as groups have them: each in its most frequent spelling, and nothing for a missing one. `all` is
/// every sequence that is grouped, `rows` are those to write.
pub fn spell_as_groups<'a, 'b>(
    by: &'a [String],
    all: impl Iterator<Item = &'a BTreeMap<String, String>> + Clone,
    rows: impl Iterator<Item = &'b mut BTreeMap<String, String>>,
) {
    let columns = Columns::new(by, all);
    for metadata in rows {
        for column in by {
            if let Some(value) = metadata.get_mut(column) {
                *value = columns.spelled(column, value).to_owned();
            }
        }
    }
}

fn check_count(by: &[String], found: usize) -> Result<(), GroupError> {
    if !by.is_empty() && found > MAX_CLASSES {
        return Err(GroupError::TooManyGroups { columns: by.to_vec(), found, limit: MAX_CLASSES });
    }
    Ok(())
}

/// Checks that grouping sequences gives at most `MAX_CLASSES` (1000) classes.
///
/// # Errors
/// [`GroupError::TooManyGroups`].
pub fn check_groups<'a>(by: &'a [String], sequences: impl Iterator<Item = SequenceLabels<'a>> + Clone) -> Result<(), GroupError> {
    if by.is_empty() {
        return Ok(());
    }
    let columns = Columns::new(by, sequences.clone().map(|(.., metadata)| metadata));
    let emotions: BTreeSet<&str> = sequences.clone().map(|(_, emotion, _)| emotion).collect();
    let groups: BTreeSet<_> = sequences.map(|(id, emotion, metadata)| (emotion, columns.values(id, metadata))).collect();
    check_count(by, emotions.len() + groups.len())
}

/// Checks that every grouping column is `subject`, `sequence`, or a metadata column of at least one sequence. Without sequences nothing
/// is checked.
///
/// # Errors
/// [`GroupError::UnknownColumn`], [`GroupError::EmptyColumn`], [`GroupError::Emotion`].
pub fn check_columns<'a>(
    by: &[String],
    metadata: impl IntoIterator<Item = &'a BTreeMap<String, String>>,
) -> Result<(), GroupError> {
    let mut sequences = 0;
    let (mut known, mut filled) = (BTreeSet::new(), BTreeSet::new());
    for columns in metadata {
        sequences += 1;
        known.extend(columns.keys());
        filled.extend(columns.iter().filter(|(_, value)| !is_missing(value)).map(|(column, _)| column));
    }
    if let Some(column) = by.iter().find(|column| *column == EMOTION_COLUMN && !known.contains(column)) {
        return Err(GroupError::Emotion { column: column.clone() });
    }
    let is_empty = |column: &&String| known.contains(column) && !filled.contains(column);
    if let Some(column) = by.iter().find(is_empty) {
        return Err(GroupError::EmptyColumn { column: column.clone(), sequences });
    }
    let is_known = |column: &String| ID_COLUMNS.contains(&column.as_str()) || known.contains(column);
    match by.iter().find(|&column| !is_known(column)) {
        Some(column) if sequences > 0 => {
            let known = ID_COLUMNS.map(str::to_owned).into_iter().chain(known.into_iter().cloned()).collect();
            Err(GroupError::UnknownColumn { column: column.clone(), known })
        }
        _ => Ok(()),
    }
}

/// Checks that every number column is a metadata column of at least one sequence and contains at least one number.
///
/// # Errors
/// As [`check_columns`], and [`GroupError::NoNumber`].
pub fn check_numbers<'a>(
    columns: &[String],
    metadata: &(impl IntoIterator<Item = &'a BTreeMap<String, String>> + Clone),
) -> Result<(), GroupError> {
    let own = |column: &&String| ID_COLUMNS.contains(&column.as_str()) || *column == EMOTION_COLUMN;
    if let Some(column) = columns.iter().find(own).filter(|column| metadata.clone().into_iter().all(|m| !m.contains_key(*column)))
    {
        return Err(GroupError::NoNumbersOfPeople { column: column.clone() });
    }
    check_columns(columns, metadata.clone())?;
    for column in columns {
        let values = metadata.clone().into_iter().filter_map(|m| m.get(column)).filter(|value| !is_missing(value));
        let (mut example, mut found) = (None, false);
        values.for_each(|value| if number_of(value).is_some() { found = true } else { example = Some(value) });
        if let (Some(example), false) = (example, found) {
            let example = format!("{example}{}", thousands_said(example));
            return Err(GroupError::NoNumber { column: column.clone(), example });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::{super::values::*, *};
    use crate::model::{DynamicExpressionModel, FrameExpressionModel};

    fn labelled(subject: &str, emotion: &str, metadata: &[(&str, &str)]) -> LabelledModel {
        let frame = FrameExpressionModel::new(vec![Point2::origin()]);
        let model = DynamicExpressionModel::new(vec![frame; 2]).unwrap();
        let id = SequenceId { subject: subject.to_owned(), sequence: "1".to_owned() };
        let metadata = metadata.iter().map(|&(k, v)| (k.to_owned(), v.to_owned())).collect();
        LabelledModel { model: SequenceModel { id, model }, emotion: emotion.to_owned(), metadata }
    }

    fn labels(models: &[LabelledModel]) -> Vec<SequenceLabels<'_>> {
        models.iter().map(LabelledModel::labels).collect()
    }

    fn classes(models: &[LabelledModel], by: &[&str]) -> Vec<String> {
        let by: Vec<String> = by.iter().map(|&c| c.to_owned()).collect();
        let text = |(label, models): (ClassLabel, Vec<&SequenceModel>)| {
            let group: Vec<_> = label.group.values().map(String::as_str).collect();
            let subjects: String = models.iter().map(|m| m.id.subject.as_str()).collect();
            format!("{}/{}: {subjects}", label.emotion, group.join("+"))
        };
        group_models(models, &by).unwrap().into_iter().map(text).collect()
    }

    fn sample() -> Vec<LabelledModel> {
        vec![
            labelled("a", "zest", &[("sex", "f"), ("age", "old")]),
            labelled("b", "surprise", &[("sex", "m"), ("age", "young")]),
            labelled("c", "anger", &[("sex", "m"), ("age", "")]),
            labelled("d", "bliss", &[]),
            labelled("e", "anger", &[("sex", "f"), ("age", "old")]),
            labelled("f", "anger", &[("sex", "m"), ("age", "old")]),
        ]
    }

    #[test]
    fn emotions_are_in_the_order_of_the_tables() {
        assert_eq!(classes(&sample(), &[]), ["anger/: cef", "surprise/: b", "bliss/: d", "zest/: a"]);
        assert_eq!(classes(&[], &["sex"]), [""; 0]);
    }

    #[test]
    fn groups_follow_their_emotion_and_missing_values_are_unknown() {
        let expected =
            ["anger/: cef", "anger/f: e", "anger/m: cf", "surprise/: b", "surprise/m: b", "bliss/: d", "bliss/unknown: d"];
        assert_eq!(classes(&sample(), &["sex"])[..7], expected);
        let both = classes(&sample(), &["sex", "age"]);
        // Label values are in column order (age, sex); classes are in the order of the requested columns.
        assert_eq!(both[..4], ["anger/: cef", "anger/old+f: e", "anger/old+m: f", "anger/unknown+m: c"]);
    }

    #[test]
    fn words_for_missing_values_become_unknown_and_are_reported() {
        let values = ["NA", "n/a", " nan", "NULL", "null", "", "Nauru", "native", "none", "na"];
        let models: Vec<LabelledModel> =
            values.iter().zip('a'..).map(|(v, s)| labelled(&s.to_string(), "anger", &[("land", v)])).collect();
        assert_eq!(
            classes(&models, &["land"])[1..],
            ["anger/Nauru: g", "anger/native: h", "anger/none: i", "anger/unknown: abcdefj"]
        );
        let said = missing_words_said(&labels(&models), &["land".to_owned()]).unwrap();
        assert!(
            said.starts_with("words for a missing value are treated as missing: `NA` in the column `land` (1 sequence); "),
            "{said}"
        );
        assert!(said.ends_with("such as `NA group`)"), "{said}");
        assert_eq!(missing_words_said(&labels(&sample()), &["age".to_owned(), "sex".to_owned()]), None);
        // The name of the group without a value is such a word, in any case.
        let cases: Vec<LabelledModel> = ["unknown", "UNKNOWN", " Unknown", "known"]
            .iter()
            .zip('a'..)
            .map(|(v, s)| labelled(&s.to_string(), "anger", &[("land", v)]))
            .collect();
        assert_eq!(classes(&cases, &["land"])[1..], ["anger/known: d", "anger/unknown: abc"]);
        let said = missing_words_said(&labels(&cases), &["land".to_owned()]).unwrap();
        assert!(
            said.contains("`UNKNOWN` in the column `land` (1 sequence); `Unknown` in the column `land` (1 sequence)"),
            "{said}"
        );
        // A column with only such values is empty.
        let error = group_models(&models[..6], &["land".to_owned()]).unwrap_err();
        assert!(matches!(error, GroupError::EmptyColumn { sequences: 6, .. }), "{error}");
    }

    #[test]
    fn errors_of_spreadsheets_and_signs_alone_are_missing_and_none_is_asked_about() {
        let missing = ["#N/A", "<NA>", "#DIV/0!", "#VALUE!", "#REF!", "n.a.", ".", "-", "--", "?", "\u{2014}", "N.A."];
        assert!(missing.iter().all(|value| is_missing(value)));
        assert!(["+", "-1", "None", "nil", "missing", "a-b", "n.a.b", "0"].iter().all(|value| !is_missing(value)));
        let models: Vec<LabelledModel> = ["None", "none", "Missing", "nil", "none of these", "NA"]
            .iter()
            .zip('a'..)
            .map(|(v, s)| labelled(&s.to_string(), "anger", &[("land", v)]))
            .collect();
        let said = perhaps_missing_said(&labels(&models), &["land".to_owned()]).unwrap();
        let words =
            ["Missing", "None", "nil", "none"].map(|word| format!("`{word}` in the column `land` (1 sequence)")).join("; ");
        assert_eq!(said, format!("values that may be words for a missing value: {words}; if nothing is known there, write NA"));
        assert_eq!(perhaps_missing_said(&labels(&sample()), &["sex".to_owned()]), None);
    }

    #[test]
    fn measures_are_distinguished_from_numbers_that_name_groups() {
        let said = |values: &[&str], columns: &[&str]| {
            let models: Vec<LabelledModel> =
                (0..).zip(values).map(|(k, v)| labelled(&k.to_string(), "fear", &[("Age", v)])).collect();
            measures_said(&labels(&models), &columns.iter().map(|&c| c.to_owned()).collect::<Vec<_>>())
        };
        let text = said(&["23", "31", "45.5", "NA", ""], &["Age", "Age"]).unwrap();
        assert!(
            text.starts_with(
                "each number forms its own group: `Age` (3 numbers of 5 people); to test whether expressions change with \
                 numbers, use --covariate"
            ),
            "{text}"
        );
        assert!(text.contains("`Age_group` with `under 30`"), "{text}");
        assert!(said(&["23", "31,5", " 40"], &["Age"]).is_some());
        // Seven of twenty, six of twenty, codes of two sexes, numbers with words among them, and a column not used for grouping.
        let of = |n: usize| (0..20).map(|k| ["1", "2", "3", "4", "5", "6", "7"][k % n]).collect::<Vec<_>>();
        assert!(said(&of(7), &["Age"]).is_some());
        for values in [of(6), vec!["0", "1", "1"], vec!["23", "31", "45", "old"]] {
            assert_eq!(said(&values, &["Age"]), None, "{values:?}");
        }
        assert_eq!(said(&["23", "31", "45"], &["sex"]), None);
    }

    #[test]
    fn spellings_of_one_value_are_one_group() {
        let models = ["FEMALE", "female", " female", "Male"].map(|sex| labelled(&sex.to_lowercase(), "anger", &[("sex", sex)]));
        assert_eq!(classes(&models, &["sex"])[1..], ["anger/Male: male", "anger/female: femalefemale female"]);
    }

    #[test]
    fn the_emotion_is_no_column_to_group_by() {
        let error = group_models(&sample(), &["emotion".to_owned()]).unwrap_err();
        assert_eq!(error, GroupError::Emotion { column: "emotion".to_owned() });
    }

    #[test]
    fn a_column_that_no_sequence_has_is_an_error() {
        let error = group_models(&sample(), &["nationality".to_owned()]).unwrap_err();
        assert_eq!(
            error.to_string(),
            "no sequence has a column `nationality`; the columns are: subject, sequence, age, sex; name one of these, or add yours to \
             manifest.csv (`grimace init --people TABLE` adds columns of a table of people)"
        );
    }

    #[test]
    fn tables_of_sequences_have_the_values_of_groups() {
        let models = [("a", "female"), ("b", "Female "), ("c", "female"), ("d", "n/a"), ("e", "male")]
            .map(|(subject, sex)| labelled(subject, "joy", &[("sex", sex), ("site", " A")]));
        let mut rows: Vec<BTreeMap<String, String>> = models.iter().map(|m| m.metadata.clone()).collect();
        spell_as_groups(&["sex".to_owned()], models.iter().map(|m| &m.metadata), rows.iter_mut());
        assert_eq!(rows.iter().map(|row| row["sex"].as_str()).collect::<Vec<_>>(), ["female", "female", "female", "", "male"]);
        assert!(rows.iter().all(|row| row["site"] == " A"));
    }

    #[test]
    fn codes_for_missing_numbers_are_named() {
        let said = |ages: &[&str]| {
            let models: Vec<LabelledModel> =
                ages.iter().enumerate().map(|(k, age)| labelled(&format!("p{k}"), "joy", &[("age", age)])).collect();
            let labels: Vec<SequenceLabels<'_>> = models.iter().map(LabelledModel::labels).collect();
            far_numbers_said(&labels, &["age".to_owned()])
        };
        let text = said(&["21", "24", "30", "-99", "35", "999", "999", "28", "41"]).unwrap();
        let expected = "numbers far from all others: -99 in the column `age` (1 person); 999 in the column `age` (2 people);";
        assert!(text.starts_with(expected), "{text}");
        assert_eq!(said(&["21", "74", "60", "99", "35", "88", "48"]), None, "people may be 99 years old");
        assert_eq!(said(&["21", "22", "20", "21", "19", "18", "54"]), None);
        assert_eq!(said(&["0", "0", "0", "0", "0", "1"]), None);
        assert!(said(&["20", "20", "20", "20", "21", "-99"]).unwrap().contains("-99"));
        assert_eq!(said(&["21", "24", "999"]), None, "too few to judge by");
    }
}
