//! `recognition.csv`: the emotion recognized for every sequence, with its person left out of the training data.

use std::path::Path;

use super::Workbench;
use crate::{
    output::{OutputError, listed, nine_digits, write_records},
    statistics::{
        LabelledModel, SequenceModel,
        recognize::{Recognized, Recognizer, shown_by_several},
    },
    units::SequenceId,
};

/// Typicality below which a sequence has none of the labels.
pub const NONE_LEVEL: f64 = 0.02;

/// Largest number of sequences for which recognition runs; time is proportional to the cube of the number.
const MOST_SEQUENCES: usize = 2048;

/// Text for a sequence with none of the labels.
pub const NONE_OF_THESE: &str = "none of these";

/// Recognition of one sequence.
#[derive(Clone, Debug, PartialEq)]
pub struct RecognizedRow {
    /// The sequence.
    pub id: SequenceId,
    /// Its own label, if known.
    pub emotion: String,
    /// The recognition result.
    pub recognized: Recognized,
}

/// Recognition of all sequences.
#[derive(Clone, Debug, PartialEq)]
pub struct RecognitionResults {
    /// Labels in the order of the probabilities.
    pub labels: Vec<String>,
    /// By sequence.
    pub rows: Vec<RecognizedRow>,
    /// Labels that only one person shows: without that person no training data remains.
    pub left_out: Vec<String>,
}

/// Message about labels that are left out.
pub fn left_out_said(labels: &[String]) -> Option<String> {
    let (are, ones) = if labels.len() == 1 { ("is", "a label") } else { ("are", "labels") };
    (!labels.is_empty())
        .then(|| format!("{} {are} excluded from recognition: {ones} that only one person shows", listed(labels, 6)))
}

/// Recognizes every model with its person left out.
///
/// # Errors
/// The reason why it is not possible, as text.
pub(super) fn recognize_left_out(models: &[LabelledModel], bench: &Workbench) -> Result<RecognitionResults, String> {
    if models.len() > MOST_SEQUENCES {
        return Err(format!(
            "there are {} sequences; recognition of held-out people is computed for at most {MOST_SEQUENCES}",
            models.len()
        ));
    }
    let mut sorted: Vec<&LabelledModel> = models.iter().collect();
    sorted.sort_by(|a, b| a.model.id.cmp(&b.model.id));
    let (sorted, left_out) = shown_by_several(sorted, |m| (&m.model.id.subject, &m.emotion));
    let labelled: Vec<(&SequenceModel, &str)> = sorted.iter().map(|m| (&m.model, m.emotion.as_str())).collect();
    let recognizer = Recognizer::new(&labelled, bench.wireframe.live_nodes(), || {}).map_err(|why| why.to_string())?;
    let rows = sorted.iter().zip(&recognizer.left_out).map(|(m, recognized)| RecognizedRow {
        id: m.model.id.clone(),
        emotion: m.emotion.clone(),
        recognized: recognized.clone(),
    });
    Ok(RecognitionResults { rows: rows.collect(), labels: recognizer.labels.clone(), left_out })
}

/// Writes `subject,sequence,emotion,recognized,probability`, the probability of every label as `p_LABEL`, `distance,typicality,id`.
///
/// # Errors
/// [`OutputError`].
pub fn write_recognition(path: &Path, results: &RecognitionResults, level: f64) -> Result<blake3::Hash, OutputError> {
    write_records(path, recognition_header(&results.labels), results.rows.iter().map(|row| recognition_record(row, level)))
}

/// Header of a table of recognized sequences.
pub fn recognition_header(labels: &[String]) -> Vec<String> {
    let before = ["subject", "sequence", "emotion", "recognized", "probability"].map(str::to_owned);
    let of_labels = labels.iter().map(|label| format!("p_{label}"));
    before.into_iter().chain(of_labels).chain(["distance", "typicality", "id"].map(str::to_owned)).collect()
}

/// A row of it.
pub fn recognition_record(row: &RecognizedRow, level: f64) -> Vec<String> {
    let r = &row.recognized;
    let named = if r.is_none(level) { NONE_OF_THESE.to_owned() } else { r.label.clone() };
    let mut record =
        vec![row.id.subject.clone(), row.id.sequence.clone(), row.emotion.clone(), named, nine_digits(r.probability)];
    record.extend(r.probabilities.iter().copied().map(nine_digits));
    record.extend([nine_digits(r.distance), nine_digits(r.typicality), row.id.to_string()]);
    record
}
