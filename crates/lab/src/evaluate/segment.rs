//! Accuracy of the segmentation of recordings: detection of expressions and rests.

use std::{collections::BTreeMap, path::Path};

use super::{Cell, Table};
use grimace::internal::{
    input::{CsvFile, InputError},
    pipeline::SegmentedRecording,
    segment::Phase,
    units::SequenceId,
};

/// Largest error of an apex that counts as correct, frames.
const APEX_WITHIN: i64 = 2;
/// Margin before onset and after offset within which an apex still belongs to an expression, frames.
const AROUND: i64 = 3;
/// Shortest rest that counts, frames.
const SHORTEST_REST: i64 = 10;
/// Share of a rest's frames that must be detected as rest for the rest to count as found.
const OVERLAP: f64 = 0.5;

/// True expressions and rests of a recording, in frame numbers.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct RecordingTruth {
    /// Emotion, with onset, apex and offset.
    pub expressions: Vec<(String, [i64; 3])>,
    /// First and last frames of the rests.
    pub rests: Vec<[i64; 2]>,
}

/// Reads `truth/expressions.csv` and `truth/rests.csv` of a simulation of recordings.
///
/// # Errors
/// [`InputError`] when a file cannot be read.
pub fn read_recording_truth(dataset: &Path) -> Result<BTreeMap<SequenceId, RecordingTruth>, InputError> {
    let mut all: BTreeMap<SequenceId, RecordingTruth> = BTreeMap::new();
    let csv = CsvFile::open(&dataset.join("truth/expressions.csv"))?;
    let [subject, sequence, emotion, onset, apex, offset] =
        csv.require(["subject", "sequence", "emotion", "onset_frame", "apex_frame", "offset_frame"])?;
    for row in csv.rows() {
        let row = row?;
        let id = SequenceId { subject: row.get(subject).to_owned(), sequence: row.get(sequence).to_owned() };
        let frames = [row.number(onset)? as i64, row.number(apex)? as i64, row.number(offset)? as i64];
        all.entry(id).or_default().expressions.push((row.get(emotion).to_owned(), frames));
    }
    let csv = CsvFile::open(&dataset.join("truth/rests.csv"))?;
    let [subject, sequence, first, last] = csv.require(["subject", "sequence", "first_frame", "last_frame"])?;
    for row in csv.rows() {
        let row = row?;
        let id = SequenceId { subject: row.get(subject).to_owned(), sequence: row.get(sequence).to_owned() };
        all.entry(id).or_default().rests.push([row.number(first)? as i64, row.number(last)? as i64]);
    }
    Ok(all)
}

/// Accuracy of the segments of one recording.
#[derive(Clone, Debug, PartialEq)]
pub struct SegmentTrial {
    /// The recording.
    pub id: SequenceId,
    /// Emotion of every true expression, with the signed error of the nearest proposed apex in frames; `None` when the expression was not
    /// found.
    pub apexes: Vec<(String, Option<i64>)>,
    /// Number of proposed segments.
    pub proposed: usize,
    /// Number of proposed segments that match no true expression.
    pub wrong: usize,
    /// Number of proposed segments whose neutral frame lies in a true rest.
    pub neutral: usize,
    /// Number of true rests of sufficient length.
    pub rests: usize,
    /// Number of these rests that were found.
    pub rests_found: usize,
    /// Reason why segmentation failed, if it did.
    pub failure: Option<String>,
}

/// Compares the segments of a recording with the truth. With an error in place of segments, nothing counts as found.
pub fn judge_recording(id: &SequenceId, truth: &RecordingTruth, found: Result<&SegmentedRecording, String>) -> SegmentTrial {
    let nothing = |(emotion, _): &(String, [i64; 3])| (emotion.clone(), None);
    let is_long = |rest: &&[i64; 2]| rest[1] - rest[0] + 1 >= SHORTEST_REST;
    let mut trial = SegmentTrial {
        id: id.clone(),
        apexes: truth.expressions.iter().map(nothing).collect(),
        proposed: 0,
        wrong: 0,
        neutral: 0,
        rests: truth.rests.iter().filter(is_long).count(),
        rests_found: 0,
        failure: None,
    };
    let found = match found {
        Ok(found) => found,
        Err(reason) => return SegmentTrial { failure: Some(reason), ..trial },
    };
    let belongs = |apex: i64, [onset, _, offset]: &[i64; 3]| (onset - AROUND..=offset + AROUND).contains(&apex);
    trial.proposed = found.segments.len();
    for segment in &found.segments {
        let (apex, neutral) = (i64::from(segment.apex_frame), i64::from(segment.neutral_frame));
        trial.wrong += usize::from(!truth.expressions.iter().any(|(_, frames)| belongs(apex, frames)));
        trial.neutral += usize::from(truth.rests.iter().any(|[first, last]| (*first..=*last).contains(&neutral)));
    }
    for ((_, frames), (_, off)) in truth.expressions.iter().zip(&mut trial.apexes) {
        let apexes = found.segments.iter().map(|s| i64::from(s.apex_frame)).filter(|&apex| belongs(apex, frames));
        *off = apexes.map(|apex| apex - frames[1]).min_by_key(|d| d.abs());
    }
    let resting: std::collections::BTreeSet<i64> =
        found.frames.iter().filter(|f| f.phase == Phase::Rest).map(|f| i64::from(f.measured.number)).collect();
    let is_found = |rest: &&[i64; 2]| {
        let share = (rest[0]..=rest[1]).filter(|n| resting.contains(n)).count() as f64 / (rest[1] - rest[0] + 1) as f64;
        share >= OVERLAP
    };
    trial.rests_found = truth.rests.iter().filter(is_long).filter(is_found).count();
    trial
}

/// Returns a row for each emotion and one for all: number of expressions, share found, share with an apex error of at most 2 frames, mean
/// and largest apex error of the found expressions.
///
/// The row `all` also has the share of wrong proposals, of neutral frames in rests, and of rests found.
pub fn segment_table(trials: &[SegmentTrial]) -> Table {
    let header = [
        "emotion",
        "expressions",
        "found",
        "apex within 2",
        "apex off, mean",
        "apex off, largest",
        "wrong proposals",
        "neutral at rest",
        "rests found",
    ];
    let mut table = Table::new(header);
    let all: Vec<&(String, Option<i64>)> = trials.iter().flat_map(|t| &t.apexes).collect();
    let emotions: std::collections::BTreeSet<&str> = all.iter().map(|(emotion, _)| emotion.as_str()).collect();
    let share = |part: usize, of: usize| if of == 0 { None } else { Some(part as f64 / of as f64) };
    let row = |name: &str, of: &[&(String, Option<i64>)]| {
        let off: Vec<i64> = of.iter().filter_map(|(_, off)| *off).map(i64::abs).collect();
        let mean = (!off.is_empty()).then(|| off.iter().sum::<i64>() as f64 / off.len() as f64);
        vec![
            Cell::text(name),
            Cell::Count(of.len()),
            Cell::maybe(share(off.len(), of.len()), 3),
            Cell::maybe(share(off.iter().filter(|&&d| d <= APEX_WITHIN).count(), of.len()), 3),
            Cell::maybe(mean, 2),
            Cell::maybe(off.iter().max().map(|&d| d as f64), 0),
        ]
    };
    for emotion in emotions {
        let of: Vec<_> = all.iter().copied().filter(|(name, _)| name == emotion).collect();
        let empty = [Cell::text(""), Cell::text(""), Cell::text("")];
        table.rows.push(row(emotion, &of).into_iter().chain(empty).collect());
    }
    let sum = |of: fn(&SegmentTrial) -> usize| trials.iter().map(of).sum::<usize>();
    let proposed = sum(|t| t.proposed);
    let last = [
        Cell::maybe(share(sum(|t| t.wrong), proposed), 3),
        Cell::maybe(share(sum(|t| t.neutral), proposed), 3),
        Cell::maybe(share(sum(|t| t.rests_found), sum(|t| t.rests)), 3),
    ];
    table.rows.push(row("all", &all).into_iter().chain(last).collect());
    table
}
