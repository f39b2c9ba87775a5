//! What `run` would meet in a dataset, up to where it would track: every sequence is prepared by the functions that prepare it for a run, and what is
//! wrong with it is said in their words.
//!
//! Of pictures the neutral frame and the apex are decoded, of a video its neutral frame. A sequence that landmarks drive has none, and is
//! gone through as a run does it.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use rayon::prelude::*;

use super::{
    Event, RunError, SequenceFailure, SequenceSource, Stage, Workbench,
    analysis::{AnalysisError, too_short},
    classes::{ClassSize, few_said, spelling_warnings, unique_stem},
    corrected::unused_corrections,
    folder::open_dataset,
    found::covered_said,
    landmarks::LandmarkSource,
    measured::normalized,
    neutral::NeutralFit,
    recognition::left_out_said,
    recording::{failed, is_recording, recording_of},
    sequence::FOUND,
    work::{Driven, Planned, Source, name_marks, plan},
};
use crate::{
    dataset::{
        CorrespondenceSource, FACE_COLUMN, FrameSource, LandmarkSelection, SEGMENT_COLUMN, SequenceEntry, is_publish_column,
        unread_beside,
    },
    output::{OutputError, listed, nine_digits, write_records},
    sequence::{ImageSize, SequenceError, SequenceReader, read_first_frame},
    statistics::{
        GroupError, SequenceLabels, UNKNOWN_GROUP,
        compare::LEAST_PEOPLE,
        group_sequences, measures_said, missing_words_said,
        recognize::{labels_to_learn, shown_by_several},
    },
    track::{TrackSummary, TrackedFrame, Verdict, missing_said, neutral_nodes, read_corrections, summarize},
    units::SequenceId,
};

/// Sequences that a note names.
const NAMED: usize = 6;

/// What is known of a sequence before it is tracked.
#[derive(Clone, Debug, PartialEq)]
pub struct CheckedSequence {
    /// Subject and sequence.
    pub id: SequenceId,
    /// Emotion label; empty for a row that is damaged.
    pub emotion: String,
    /// What drives it: `images`, `video`, `landmarks`, or `recording` for a whole one that is yet to be cut; empty where that is not known.
    pub source: &'static str,
    /// Frames from neutral to apex; of a video as its header states them. `None` where that is not known.
    pub frames: Option<usize>,
    /// Size of the neutral frame, px.
    pub size: Option<ImageSize>,
    /// Which marks serve: `file`, `landmarks`, `found`, or `none`; empty for a row that is damaged.
    pub marks: &'static str,
    /// How many there are.
    pub marked: Option<usize>,
    /// Eye distance of the fitted neutral face, px.
    pub eye_distance: Option<f64>,
    /// Median expected error of marks that were found, over the eye distance.
    pub face_error: Option<f64>,
    /// Median over the live nodes of how far they are expected to sit from their place on the neutral face, px.
    pub placement_error: Option<f64>,
    /// Why it would fail, and at which stage.
    pub failure: Option<(Stage, String)>,
    /// Why it deserves a look, a sentence each.
    pub reasons: Vec<String>,
}

/// Sequences and people of an emotion, those that would fail left out.
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

/// A column of the manifest that one may group by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckedColumn {
    /// Its name.
    pub name: String,
    /// Its groups with the number of their people, by alphabet, those without a value left out; or why nobody can group by it.
    pub groups: Result<Vec<(String, usize)>, GroupError>,
}

impl CheckedColumn {
    /// Whether there are two groups of as many people as a test takes.
    pub fn is_testable(&self) -> bool {
        self.groups.iter().flatten().filter(|(_, people)| *people >= LEAST_PEOPLE).count() >= 2
    }
}

/// What a run over a dataset would meet.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetCheck {
    /// By id.
    pub sequences: Vec<CheckedSequence>,
    /// People of all sequences whose rows read.
    pub people: usize,
    /// In the order of the tables.
    pub emotions: Vec<CheckedEmotion>,
    /// By name.
    pub columns: Vec<CheckedColumn>,
    /// Left out on purpose, with the reason.
    pub skipped: Vec<(String, String)>,
    /// What a person should know of the dataset as a whole.
    pub notes: Vec<String>,
}

/// Prepares every sequence of a dataset as a run does, and tracks none. `results` is a folder of results whose corrections by hand are checked, too.
/// `event` is called from many threads.
///
/// # Errors
/// [`RunError`] when the dataset does not open, is empty, or cannot be grouped as the options say.
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
    let mut notes = notes(&usable, &labels, bench).map_err(AnalysisError::from)?;
    let lengths = sequences.iter().filter(|s| s.failure.is_none()).filter_map(|s| Some((&s.id, s.frames?)));
    notes.extend(too_short(lengths, bench.options.normalize.resample));
    let whole: Vec<String> = sequences.iter().filter(|s| s.source == RECORDING).map(|s| s.id.to_string()).collect();
    if !whole.is_empty() {
        notes.push(format!("whole recordings, of which `run` makes a sequence for each expression: {}", listed(&whole, NAMED)));
    }
    let all = || opened.sequences.iter().map(|s| s.id.to_string());
    // Of the sequences of a recording nobody knows the names yet.
    notes.extend(results.filter(|_| whole.is_empty()).and_then(|out| unused_corrections(out, &all().collect())));
    let people = labels.iter().map(|(id, ..)| id.subject.as_str()).collect::<BTreeSet<_>>().len();
    let columns = columns_of(&labels);
    sequences.extend(opened.failures.iter().map(|row| CheckedSequence::damaged(Planned::damaged(row))));
    sequences.sort_by(|a, b| a.id.cmp(&b.id));
    let skipped = opened.skipped.iter().map(|s| (s.id.to_string(), s.reason.clone())).collect();
    Ok(DatasetCheck { sequences, people, emotions, columns, skipped, notes })
}

/// Word for a row that is a whole recording.
const RECORDING: &str = "recording";

impl CheckedSequence {
    /// Whether it would fail, deserves a look, or is good.
    pub fn verdict(&self) -> &'static str {
        match (&self.failure, self.reasons.is_empty()) {
            (Some(_), _) => "fails",
            (None, false) => Verdict::LookAgain.name(),
            (None, true) => Verdict::Good.name(),
        }
    }

    fn of(entry: &SequenceEntry, bench: &Workbench, results: Option<&Path>) -> Self {
        let may_find = bench.options.marks == LandmarkSelection::Auto;
        let marks = match entry.correspondence_source() {
            Ok(CorrespondenceSource::File(_)) => "file",
            Ok(CorrespondenceSource::Landmarks(_)) => "landmarks",
            Ok(CorrespondenceSource::None) if may_find => FOUND,
            Ok(CorrespondenceSource::None) | Err(_) => "none",
        };
        let mut checked = Self { emotion: entry.emotion.clone(), marks, ..Self::named(entry.id.clone()) };
        if let Err(SequenceFailure { stage, reason, .. }) = checked.prepare(entry, bench, results) {
            checked.failure = Some((stage, reason));
            // What can be told all the same.
            if let (Ok(frames), "") = (entry.frames(), checked.source) {
                checked.list(&frames, None);
                checked.size = read_first_frame(&frames).ok().filter(|_| stage == Stage::Fit).map(|frame| frame.size());
            }
        }
        checked
    }

    fn named(id: SequenceId) -> Self {
        Self {
            id,
            emotion: String::new(),
            source: "",
            frames: None,
            size: None,
            marks: "",
            marked: None,
            eye_distance: None,
            face_error: None,
            placement_error: None,
            failure: None,
            reasons: Vec::new(),
        }
    }

    fn damaged(row: Planned<'_>) -> Self {
        Self { failure: row.source.err().map(|failure| (failure.stage, failure.reason)), ..Self::named(row.id) }
    }

    /// Enters what the list of its frames says; `stated` is how many a video says it has.
    fn list(&mut self, frames: &FrameSource, stated: Option<usize>) {
        (self.source, self.frames) = match frames {
            FrameSource::Images(files) => ("images", Some(files.len())),
            &FrameSource::Video { first, last, .. } => {
                let first = first.unwrap_or(1) as usize;
                let last = last.map(|last| last as usize).or(stated);
                ("video", last.map(|last| first.abs_diff(last) + 1))
            }
        };
    }

    /// All that a run does with the sequence before it tracks it.
    fn prepare(&mut self, entry: &SequenceEntry, bench: &Workbench, results: Option<&Path>) -> Result<(), SequenceFailure> {
        if is_recording(entry) {
            return self.prepare_recording(entry, bench);
        }
        let Driven { source, remark, found_error, .. } = plan(entry, false, bench)?;
        if let Some(out) = results {
            read_corrections(&out.join(format!("tracks/{}.csv", entry.id))).map_err(SequenceFailure::at(Stage::Dataset))?;
        }
        let (summary, notes) = match &source {
            Source::Images(source) => self.prepare_images(source, bench),
            Source::Landmarks(source) => self.follow_landmarks(source, bench),
        }
        .map_err(|failure| name_marks(failure, Some(entry)))?;
        self.face_error = found_error;
        self.eye_distance = Some(summary.eye_distance_px).filter(|px| *px > 0.0);
        self.placement_error = summary.placement_error_px;
        self.reasons = remark.into_iter().chain(notes).collect();
        let is_new = |reason: &String| !self.reasons.iter().any(|said| said.contains(reason.as_str()));
        let new: Vec<String> = summary.reasons.into_iter().filter(is_new).collect();
        self.reasons.extend(new);
        Ok(())
    }

    /// A whole recording: its row is looked at, and its first frame.
    fn prepare_recording(&mut self, entry: &SequenceEntry, bench: &Workbench) -> Result<(), SequenceFailure> {
        self.source = RECORDING;
        let fails =
            |reason: String| SequenceFailure { stage: Stage::Dataset, reason: failed(entry, reason).reason(), fatal: false };
        let recording = recording_of(entry, bench).map_err(|error| fails(error.to_string()))?;
        let first = read_first_frame(&recording.frames).map_err(|error| fails(error.to_string()))?;
        self.size = Some(first.size());
        self.marked = recording.marks.as_ref().map(|(_, marks)| marks.len());
        Ok(())
    }

    /// Decodes the neutral frame, fits the wireframe in it, and decodes the apex of pictures; what would be said of the track that begins there, and
    /// further notes.
    fn prepare_images(
        &mut self,
        source: &SequenceSource,
        bench: &Workbench,
    ) -> Result<(TrackSummary, Vec<String>), SequenceFailure> {
        let failed = SequenceFailure::at(Stage::Track);
        self.list(&source.frames, None);
        self.marked = Some(source.marks.len());
        let opened = match &source.frames {
            // Of a video that is read backwards all up to its last frame would be decoded.
            FrameSource::Video { path, first, last: Some(last) } if first.is_some_and(|first| first > *last) => {
                SequenceReader::open(&FrameSource::Video { path: path.clone(), first: *first, last: None })
            }
            frames => SequenceReader::open(frames),
        };
        let mut reader = opened.map_err(&failed)?;
        self.list(&source.frames, reader.stated_frames());
        let first = reader.next().unwrap_or(Err(SequenceError::TooFewFrames { found: 0 })).map_err(&failed)?;
        self.size = Some(first.size());
        let NeutralFit { fitted, beside } = source.fit_neutral(&first, bench)?;
        let neutral = TrackedFrame { number: first.number(), nodes: neutral_nodes(&bench.wireframe, &fitted) };
        let mut summary = summarize(&[neutral], &bench.wireframe, &bench.tables)
            .with_marks_beside(beside)
            .with_covered(covered_said(&source.covered));
        if let FrameSource::Images(files) = &source.frames {
            let ends = [files.first(), files.last()].into_iter().flatten().cloned().collect();
            let ends = SequenceReader::open_part(&FrameSource::Images(ends), &source.frames).map_err(&failed)?;
            ends.collect::<Result<Vec<_>, _>>().map_err(&failed)?;
            summary.reasons.extend(missing_said(files.iter().map(|file| file.number)));
        }
        Ok((summary, unread_beside(&source.frames).into_iter().collect()))
    }

    /// Lets landmarks drive the wireframe, as a run does it; what is said of the track, and further notes.
    fn follow_landmarks(
        &mut self,
        source: &LandmarkSource,
        bench: &Workbench,
    ) -> Result<(TrackSummary, Vec<String>), SequenceFailure> {
        self.source = "landmarks";
        self.marks = source.marks_from;
        let (frames, info) = source.track(bench).1?;
        (self.frames, self.marked) = (Some(frames.len()), Some(info.marks.len()));
        let normalized = normalized(&frames, &info.mark_places(), info.times.as_deref(), bench)?;
        let mut summary = info.summary.clone();
        normalized.judge(&mut summary, &frames, bench);
        Ok((summary, info.notes))
    }
}

/// Sequences and people of every emotion.
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

/// The columns of the manifest that are a person's own, with their groups over all emotions.
fn columns_of(all: &[SequenceLabels<'_>]) -> Vec<CheckedColumn> {
    let has_meaning = |name: &&String| is_publish_column(name) || [SEGMENT_COLUMN, FACE_COLUMN].contains(&name.as_str());
    let names: BTreeSet<&String> = all.iter().flat_map(|(.., metadata)| metadata.keys()).filter(|n| !has_meaning(n)).collect();
    let groups = |name: &String| {
        // Whatever they show: one emotion of all.
        let classes = group_sequences(all, |&(id, _, metadata)| (id, "", metadata), std::slice::from_ref(name))?;
        let groups = classes.iter().filter_map(|(label, of)| Some((label.group.get(name)?.clone(), people_of(of))));
        Ok(groups.filter(|(group, _)| group != UNKNOWN_GROUP).collect())
    };
    names.into_iter().map(|name| CheckedColumn { name: name.clone(), groups: groups(name) }).collect()
}

/// What a run over the `usable` sequences would say of classes and labels.
fn notes(usable: &[SequenceLabels<'_>], all: &[SequenceLabels<'_>], bench: &Workbench) -> Result<Vec<String>, GroupError> {
    let by = &bench.options.by;
    let mut stems = BTreeSet::new();
    let classes = group_sequences(usable, |labels| *labels, by)?;
    let classes: Vec<_> = classes.into_iter().map(|(label, of)| (unique_stem(&label, &mut stems), of)).collect();
    let sizes = classes.iter().map(|(stem, of)| ClassSize { stem, sequences: of.len(), people: people_of(of) });
    let mut notes = few_said(&sizes.collect::<Vec<_>>());
    notes.extend(spelling_warnings(all, by));
    notes.extend(missing_words_said(all, by));
    notes.extend(measures_said(all, by));
    let shown: Vec<(&str, &str)> = usable.iter().map(|&(id, emotion, _)| (id.subject.as_str(), emotion)).collect();
    let (shown, left_out) = shown_by_several(shown, |&shown| shown);
    // One emotion alone is nothing to recognize, and nobody expects it.
    let several = usable.iter().map(|(_, emotion, _)| emotion).collect::<BTreeSet<_>>().len() > 1;
    if several {
        notes.extend(labels_to_learn(shown.into_iter()).err().map(|why| format!("no recognition.csv: {why}")));
        notes.extend(left_out_said(&left_out));
    }
    Ok(notes)
}

/// Writes `subject,sequence,emotion,verdict,stage,reasons,source,frames,width,height,marks,marked,eye_distance,face_error_percent_es,
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
