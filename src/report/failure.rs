//! Failures and their stages.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::{text::single_line, units::SequenceId};

/// A stage of the main job, as named in `failures.csv`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Stage {
    /// Reading the user's input: manifest row, marks, landmarks, list of frames.
    Dataset,
    /// Fitting the wireframe to the neutral frame.
    Fit,
    /// Decoding and tracking the frames.
    Track,
    /// Normalizing the track.
    Normalize,
    /// Statistics over the models.
    Statistics,
    /// Writing results.
    Write,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl Stage {
    /// The word for it in `failures.csv`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Dataset => "dataset",
            Self::Fit => "fit",
            Self::Track => "track",
            Self::Normalize => "normalize",
            Self::Statistics => "statistics",
            Self::Write => "write",
        }
    }
}

/// A sequence that failed: a row of `failures.csv`.
///
/// ```
/// use grimace::pipeline::Failure;
///
/// let json = r#"{ "subject": "S009", "sequence": "5", "stage": "fit", "reason": "no marks" }"#;
/// let failed: Failure = serde_json::from_str(json)?;
/// assert_eq!((failed.subject.as_str(), failed.stage_name()), ("S009", "fit"));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Failure {
    /// Subject.
    pub subject: String,
    /// Sequence.
    pub sequence: String,
    /// Stage that failed.
    #[doc(hidden)]
    pub stage: Stage,
    /// Full error message.
    pub reason: String,
}

impl Failure {
    /// The stage that failed: `dataset`, `fit`, `track`, `normalize`, `statistics` or `write`.
    pub fn stage_name(&self) -> &'static str {
        self.stage.name()
    }
}

/// Id of a sequence that failed; `None` for an unreadable row of a manifest.
pub fn failed_id(subject: &str, sequence: &str) -> Option<SequenceId> {
    let is_named = !(subject.is_empty() && sequence.is_empty());
    is_named.then(|| SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() })
}

/// Name of a failed sequence in messages: its id or, for a row without one, the file and line at the beginning of the reason.
pub fn failed_name(subject: &str, sequence: &str, reason: &str) -> String {
    failed_id(subject, sequence).map_or_else(|| place_in(reason).to_owned(), |id| single_line(&id.to_string()).into_owned())
}

/// File and line at the beginning of a reason, or the whole reason.
fn place_in(reason: &str) -> &str {
    const LINE: &str = ", line ";
    let end = |(at, _): (usize, &str)| {
        let number = at + LINE.len();
        let behind = reason[number..].trim_start_matches(|c: char| c.is_ascii_digit());
        let end = reason.len() - behind.len();
        (end > number && behind.starts_with(": ")).then_some(end)
    };
    reason.match_indices(LINE).find_map(end).map_or(reason, |end| &reason[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn failures_have_a_name() {
        assert_eq!(failed_name("S001", "5", "m.csv, line 3: no frames"), "S001_5");
        assert_eq!(failed_name("a\nerror: b", "5", "no frames"), "a\\nerror: b_5");
        assert_eq!(failed_name("", "", "m.csv, line 3: a quotation mark is not closed"), "m.csv, line 3");
        // A folder's name may contain anything.
        let reason = "data/Study: joy, line of 2/m.csv, line 31: emotion is `a: b, line 4: c`";
        assert_eq!(failed_name("", "", reason), "data/Study: joy, line of 2/m.csv, line 31");
        assert_eq!(failed_name("", "", "no place"), "no place");
        assert_eq!(failed_id("", "5").map(|id| id.to_string()).as_deref(), Some("_5"));
    }
}
