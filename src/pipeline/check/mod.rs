//! `check`: reports problems that `run` would meet in a dataset, without tracking.
//!
//! Every sequence is prepared by the same functions as in a run, so that messages are the same. Of an image sequence the neutral frame and
//! the apex are decoded, of a video the neutral frame. A sequence driven by landmarks is processed completely.

mod sequence;

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use rayon::prelude::*;

pub use self::sequence::CheckedSequence;
use super::{
    Event, RunError, Workbench,
    analysis::{AnalysisError, too_short},
    classes::{ClassSize, few_said, spelling_warnings, unique_stem},
    corrected::unused_corrections,
    folder::open_dataset,
    recognition::left_out_said,
    same::{Contents, copies_said, with_face},
};
use crate::{
    dataset::{FACE_COLUMN, SEGMENT_COLUMN, SequenceEntry, is_publish_column, not_shown_said, unlisted_said},
    output::{OutputError, listed, nine_digits, write_records},
    statistics::{
        GroupError, SequenceLabels, UNKNOWN_GROUP, column_notes,
        compare::LEAST_PEOPLE,
        group_sequences, is_missing, measures_said,
        recognize::{labels_to_learn, shown_by_several},
        without_stratum_said,
    },
    units::SequenceId,
};

/// Most sequences that a note names.
const NAMED: usize = 6;

/// Counts of an emotion, without the sequences that would fail.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedEmotion {
    /// The label.
    pub emotion: String,
    /// Sequences.
    pub sequences: usize,
    /// People.
    pub people: usize,
    /// Sequences that would fail.
    pub failing: usize,
}

/// A manifest column that can serve for grouping.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedColumn {
    /// Its name.
    pub name: String,
    /// Its groups with their number of people over all emotions, in alphabetical order, without missing values; or the reason why it cannot
    /// group.
    pub groups: Result<Vec<(String, usize)>, GroupError>,
    /// People with a value over all emotions, each once.
    pub people: usize,
    /// Whether some emotion has two groups that are large enough for a test.
    pub is_testable: bool,
    /// Whether its values are measurements, such as ages, rather than names of groups.
    pub is_measure: bool,
}

/// Result of checking a dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetCheck {
    /// By id.
    pub sequences: Vec<CheckedSequence>,
    /// People in all rows that could be read.
    pub people: usize,
    /// Emotions in the order of the tables.
    pub emotions: Vec<CheckedEmotion>,
    /// By name.
    pub columns: Vec<CheckedColumn>,
    /// Sequences left out on purpose, with the reason.
    pub skipped: Vec<(String, String)>,
    /// Notes on the dataset as a whole.
    pub notes: Vec<String>,
    /// Whether one of the notes recommends linear resampling.
    pub recommends_linear: bool,
}

/// Prepares every sequence of a dataset as a run does, without tracking.
///
/// `results` is a results folder whose manual corrections are checked, too. `event` is called from many threads.
///
/// # Errors
/// [`RunError`] when the dataset cannot be opened, is empty, or cannot be grouped as the options require.
pub fn check_dataset(
    dataset: &Path,
    bench: &Workbench,
    results: Option<&Path>,
    event: impl Fn(Event) + Sync,
) -> Result<DatasetCheck, RunError> {
    let opened = open_dataset(dataset, bench)?;
    if opened.sequences.is_empty() && opened.failures.is_empty() {
        return Err(RunError::Empty { path: dataset.to_owned() });
    }
    event(Event::Started { sequences: opened.sequences.len() });
    let one = |entry: &SequenceEntry| {
        let checked = CheckedSequence::of(entry, bench, results);
        event(Event::Finished { id: entry.id.clone(), reused: false, failure: None });
        checked
    };
    let mut sequences: Vec<CheckedSequence> = opened.sequences.par_iter().map(one).collect();
    let labels: Vec<SequenceLabels<'_>> = opened.sequences.iter().map(SequenceEntry::labels).collect();
    let is_usable = sequences.iter().map(|s| s.failure.is_none());
    let usable: Vec<SequenceLabels<'_>> = labels.iter().zip(is_usable).filter(|(_, usable)| *usable).map(|(l, _)| *l).collect();
    let emotions = emotions_of(&labels, &usable).map_err(AnalysisError::from)?;
    let whole: Vec<&SequenceId> = sequences.iter().filter(|s| s.is_recording()).map(|s| &s.id).collect();
    let mut notes = notes(&usable, &labels, &whole, bench).map_err(AnalysisError::from)?;
    let lengths = sequences.iter().filter(|s| s.failure.is_none() && !s.is_recording()).filter_map(|s| Some((&s.id, s.frames?)));
    let contents = sequences.iter().zip(&labels).map(|(s, (.., metadata))| Contents {
        id: &s.id,
        emotion: &s.emotion,
        keys: [s.pictures.as_ref().map(|pictures| with_face(pictures, metadata)), None],
    });
    notes.extend(copies_said(contents.collect(), "the same neutral and apex pictures"));
    let too_short = too_short(lengths, bench.options.normalize.resample);
    let recommends_linear = too_short.is_some();
    notes.extend(too_short);
    notes.extend(unlisted_said(dataset));
    if !whole.is_empty() {
        let named: Vec<String> = whole.iter().map(ToString::to_string).collect();
        notes.push(format!(
            "whole recordings are not searched here; `run` makes a sequence of each expression that it finds in them: {}",
            listed(&named, NAMED)
        ));
    }
    let damaged: Vec<CheckedSequence> = opened.failures.iter().map(CheckedSequence::damaged).collect();
    let all = || sequences.iter().chain(&damaged).map(|s| s.id.to_string());
    // The sequences of whole recordings have no names yet.
    notes.extend(results.filter(|_| whole.is_empty()).and_then(|out| unused_corrections(out, &all().collect())));
    let people = labels.iter().map(|(id, ..)| id.subject.as_str()).collect::<BTreeSet<_>>().len();
    let columns = columns_of(&labels);
    sequences.extend(damaged);
    sequences.sort_by(|a, b| a.id.cmp(&b.id));
    let skipped = opened.skipped.iter().map(|s| (s.id.to_string(), s.reason.clone())).collect();
    Ok(DatasetCheck { sequences, people, emotions, columns, skipped, notes, recommends_linear })
}

/// Counts sequences and people of every emotion.
fn emotions_of(all: &[SequenceLabels<'_>], usable: &[SequenceLabels<'_>]) -> Result<Vec<CheckedEmotion>, GroupError> {
    let usable: BTreeMap<String, Vec<&SequenceLabels<'_>>> =
        group_sequences(usable, |labels| *labels, &[])?.into_iter().map(|(label, of)| (label.emotion, of)).collect();
    let emotion = |emotion: String, all: usize| {
        let of = usable.get(&emotion).map_or(&[][..], Vec::as_slice);
        CheckedEmotion { sequences: of.len(), people: people_of(of), failing: all - of.len(), emotion }
    };
    Ok(group_sequences(all, |labels| *labels, &[])?.into_iter().map(|(label, of)| emotion(label.emotion, of.len())).collect())
}

fn people_of(sequences: &[&SequenceLabels<'_>]) -> usize {
    sequences.iter().map(|(id, ..)| id.subject.as_str()).collect::<BTreeSet<_>>().len()
}

/// Manifest columns that belong to a person, with their groups over all emotions.
fn columns_of(all: &[SequenceLabels<'_>]) -> Vec<CheckedColumn> {
    let has_meaning = |name: &&String| is_publish_column(name) || [SEGMENT_COLUMN, FACE_COLUMN].contains(&name.as_str());
    let names: BTreeSet<&String> = all.iter().flat_map(|(.., metadata)| metadata.keys()).filter(|n| !has_meaning(n)).collect();
    let column = |name: &String| {
        let by = std::slice::from_ref(name);
        // Groups with their people, among the sequences of one emotion or of all.
        let groups = |emotion: Option<&str>| {
            let chosen: Vec<SequenceLabels<'_>> =
                all.iter().filter(|(_, own, _)| emotion.is_none_or(|e| e == *own)).copied().collect();
            let classes = group_sequences(&chosen, |&(id, _, metadata)| (id, "", metadata), by)?;
            let groups = classes.iter().filter_map(|(label, of)| Some((label.group.get(name)?.clone(), people_of(of))));
            Ok::<Vec<_>, GroupError>(groups.filter(|(group, _)| group != UNKNOWN_GROUP).collect())
        };
        let emotions: BTreeSet<&str> = all.iter().map(|(_, emotion, _)| *emotion).collect();
        let is_enough = |groups: Vec<(String, usize)>| groups.iter().filter(|(_, people)| *people >= LEAST_PEOPLE).count() >= 2;
        let is_testable = emotions.into_iter().any(|emotion| groups(Some(emotion)).is_ok_and(is_enough));
        let has_value = |(.., metadata): &&SequenceLabels<'_>| metadata.get(name).is_some_and(|value| !is_missing(value));
        let people = people_of(&all.iter().filter(has_value).collect::<Vec<_>>());
        let is_measure = measures_said(all, by).is_some();
        CheckedColumn { name: name.clone(), groups: groups(None), people, is_testable, is_measure }
    };
    names.into_iter().map(column).collect()
}

/// Notes of a run over the `usable` sequences on classes and labels. Classes with `whole` recordings are skipped: the number of their
/// sequences is not known yet.
fn notes(
    usable: &[SequenceLabels<'_>],
    all: &[SequenceLabels<'_>],
    whole: &[&SequenceId],
    bench: &Workbench,
) -> Result<Vec<String>, GroupError> {
    let by = &bench.options.by;
    let mut stems = BTreeSet::new();
    let classes = group_sequences(usable, |labels| *labels, by)?;
    let classes: Vec<_> = classes.into_iter().map(|(label, of)| (unique_stem(&label, &mut stems), of)).collect();
    let is_known = |of: &[&SequenceLabels<'_>]| !of.iter().any(|(id, ..)| whole.contains(id));
    let known = classes.iter().filter(|(_, of)| is_known(of));
    let sizes = known.map(|(stem, of)| ClassSize { stem, sequences: of.len(), people: people_of(of) });
    let mut notes = few_said(&sizes.collect::<Vec<_>>());
    notes.extend(spelling_warnings(all, by));
    notes.extend(column_notes(all, by, &bench.options.strata, &bench.options.covariates));
    notes.extend(without_stratum_said(usable, &bench.options.strata));
    notes.extend(not_shown_said(all.iter().map(|&(id, _, metadata)| (id.subject.as_str(), metadata))));
    let shown: Vec<(&str, &str)> = usable.iter().map(|&(id, emotion, _)| (id.subject.as_str(), emotion)).collect();
    let (shown, left_out) = shown_by_several(shown, |&shown| shown);
    // Recognition needs at least two emotions; with one, no note about it is useful.
    let several = usable.iter().map(|(_, emotion, _)| emotion).collect::<BTreeSet<_>>().len() > 1;
    if several && whole.is_empty() {
        notes.extend(labels_to_learn(shown.into_iter()).err().map(|why| format!("no recognition.csv: {why}")));
        notes.extend(left_out_said(&left_out));
    }
    Ok(notes)
}

/// Writes `subject,sequence,emotion,verdict,stage,reasons,notes,source,frames,width,height,marks,marked,eye_distance,face_error_percent_es,
/// placement_error_percent_es,id`: a row for every sequence.
///
/// # Errors
/// [`OutputError`].
pub fn write_check(path: &Path, check: &DatasetCheck) -> Result<blake3::Hash, OutputError> {
    let header = [
        "subject",
        "sequence",
        "emotion",
        "verdict",
        "stage",
        "reasons",
        "notes",
        "source",
        "frames",
        "width",
        "height",
        "marks",
        "marked",
        "eye_distance",
        "face_error_percent_es",
        "placement_error_percent_es",
        "id",
    ];
    let number = |value: Option<f64>| value.map(nine_digits).unwrap_or_default();
    let count = |value: Option<usize>| value.map(|n| n.to_string()).unwrap_or_default();
    let side = |of: Option<u32>| of.map(|n| n.to_string()).unwrap_or_default();
    let row = |s: &CheckedSequence| {
        let (stage, reasons) = match &s.failure {
            Some((stage, reason)) => (stage.to_string(), reason.clone()),
            None => (String::new(), s.reasons.join("; ")),
        };
        let placement = s.placement_error.zip(s.eye_distance).map(|(px, unit)| 100.0 * px / unit);
        vec![
            s.id.subject.clone(),
            s.id.sequence.clone(),
            s.emotion.clone(),
            s.verdict().to_owned(),
            stage,
            reasons,
            s.notes.join("; "),
            s.source.to_owned(),
            count(s.frames),
            side(s.size.map(|size| size.width)),
            side(s.size.map(|size| size.height)),
            s.marks.to_owned(),
            count(s.marked),
            number(s.eye_distance),
            number(s.face_error.map(|share| 100.0 * share)),
            number(placement),
            s.id.to_string(),
        ]
    };
    write_records(path, header, check.sequences.iter().map(row))
}
