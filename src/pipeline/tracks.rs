//! Reads existing tracks as input of the statistics.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::{Path, PathBuf},
};

use rayon::prelude::*;

use super::{
    AnalyzedModel, Failure, SequenceFailure, Stage, Workbench, file_blake3,
    measured::{measure, normalized},
    same::pictures_of,
};
use crate::{
    dataset::Dataset,
    features::Course,
    statistics::SequenceModel,
    track::{LOOKED_AT, Looks, TrackInfo, TrackQuality, content_of, neutral_first, read_track, read_track_info, summarize},
    units::SequenceId,
};

/// Record that `grimace analyze` leaves in its folder.
pub(crate) const ANALYZE_RECORD: &str = "analyze.b3";

/// Returns the folder of the tracks in a results folder, or the folder itself.
pub fn tracks_folder(folder: &Path) -> PathBuf {
    Some(folder.join("tracks")).filter(|tracks| tracks.is_dir()).unwrap_or_else(|| folder.to_owned())
}

/// Returns the results folder that contains a folder of tracks, or the folder itself; the inverse of `tracks_folder`.
pub fn results_folder(folder: &Path) -> PathBuf {
    let is_tracks = folder.file_name().is_some_and(|name| name == "tracks") && !folder.join("tracks").is_dir();
    folder.parent().filter(|_| is_tracks).unwrap_or(folder).to_owned()
}

/// Lists the track files that the user named, sorted by path, without duplicates. A folder (see `tracks_folder`) stands for its `.csv`
/// files.
///
/// # Errors
/// [`std::io::Error`] with the path when a folder cannot be read or has the results of `grimace analyze`, or a file does not exist.
pub fn track_files(paths: &[PathBuf]) -> std::io::Result<Vec<PathBuf>> {
    let with_path = |path: &Path| {
        let path = path.display().to_string();
        move |e: std::io::Error| std::io::Error::new(e.kind(), format!("{path}: {e}"))
    };
    let mut files = Vec::new();
    for path in paths {
        if std::fs::metadata(path).map_err(with_path(path))?.is_dir() {
            let folder = tracks_folder(path);
            if folder == *path && path.join(ANALYZE_RECORD).is_file() {
                let reason =
                    "this is a result of `grimace analyze`, which has no tracks; give a folder of `grimace run`, or of tracks";
                return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, format!("{}: {reason}", path.display())));
            }
            for entry in std::fs::read_dir(&folder).map_err(with_path(&folder))? {
                let file = entry.map_err(with_path(path))?.path();
                let is_track = file.file_name().is_some_and(|name| name != LOOKED_AT);
                if is_track && file.extension().is_some_and(|e| e.eq_ignore_ascii_case("csv")) {
                    files.push(file);
                }
            }
        } else {
            files.push(path.clone());
        }
    }
    files.sort();
    files.dedup();
    Ok(files)
}

/// Reads and normalizes tracks. Emotion and metadata come from the dataset if it has the sequence, else from the `.json` beside the track.
/// A track that fails does not stop the others. Damaged rows of the dataset are failures, too.
pub fn load_tracks(files: &[PathBuf], dataset: Option<&Dataset>, bench: &Workbench) -> (Vec<AnalyzedModel>, Vec<Failure>) {
    load_all(files, dataset, bench, false)
}

/// As [`load_tracks`] for tracks without a required emotion; a missing one is an empty string.
pub fn load_unlabelled_tracks(files: &[PathBuf], bench: &Workbench) -> (Vec<AnalyzedModel>, Vec<Failure>) {
    load_all(files, None, bench, true)
}

fn load_all(
    files: &[PathBuf],
    dataset: Option<&Dataset>,
    bench: &Workbench,
    may_be_unlabelled: bool,
) -> (Vec<AnalyzedModel>, Vec<Failure>) {
    let folders: BTreeSet<PathBuf> = files.iter().map(|path| looks_folder(path)).collect();
    let looks: BTreeMap<PathBuf, Result<Looks, SequenceFailure>> =
        folders.into_iter().map(|out| (out.clone(), Looks::read(&out).map_err(SequenceFailure::at(Stage::Dataset)))).collect();
    let with_look = |path: &PathBuf| {
        let mut model = load(path, dataset, bench, may_be_unlabelled)?;
        if let (Some(looks), Some(quality)) = (looks.get(&looks_folder(path)), &mut model.quality) {
            quality.look = looks.as_ref().map_err(Clone::clone)?.of(&quality.id, &quality.content);
        }
        Ok(model)
    };
    let loaded: Vec<(&PathBuf, Result<AnalyzedModel, SequenceFailure>)> =
        files.par_iter().map(|path| (path, with_look(path))).collect();
    let (mut models, mut failures): (Vec<AnalyzedModel>, Vec<Failure>) = (Vec::new(), Vec::new());
    let mut seen = BTreeSet::new();
    for (path, result) in loaded {
        let id = id_of(path);
        let mut fail = |id: SequenceId, stage, reason| {
            failures.push(Failure { subject: id.subject, sequence: id.sequence, stage, reason });
        };
        match result {
            Ok(model) if !seen.insert(model.model.id.to_string()) => {
                let reason =
                    format!("{}: another track of {} was read before; remove or rename one", path.display(), model.model.id);
                fail(model.model.id, Stage::Dataset, reason);
            }
            Ok(model) => models.push(model),
            Err(failure) => fail(id, failure.stage, failure.reason),
        }
    }
    // Damaged rows that did not cause the rejection of a track: doubles, and those with unreadable names.
    for row in dataset.iter().flat_map(|d| &d.failures) {
        let reason = row.reason();
        if !failures.iter().any(|f| f.stage == Stage::Dataset && f.reason == reason) {
            failures.push(Failure {
                subject: row.subject.clone(),
                sequence: row.sequence.clone(),
                stage: Stage::Dataset,
                reason,
            });
        }
    }
    (models, failures)
}

/// The folder with the looks at a track: that of the results, or its own for a track that is not in a folder `tracks`.
fn looks_folder(track: &Path) -> PathBuf {
    results_folder(track.parent().unwrap_or(Path::new("")))
}

/// Subject and sequence from a file name such as `S005_001.csv`: the sequence follows the last underscore.
pub fn id_of(path: &Path) -> SequenceId {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    match stem.rsplit_once('_') {
        Some((subject, sequence)) if !subject.is_empty() && !sequence.is_empty() => {
            SequenceId { subject: subject.to_owned(), sequence: sequence.to_owned() }
        }
        _ => SequenceId { subject: stem.into_owned(), sequence: "1".to_owned() },
    }
}

fn load(
    path: &Path,
    dataset: Option<&Dataset>,
    bench: &Workbench,
    may_be_unlabelled: bool,
) -> Result<AnalyzedModel, SequenceFailure> {
    let frames = read_track(path).map_err(SequenceFailure::at(Stage::Dataset))?;
    let info = read_track_info(path).map_err(SequenceFailure::at(Stage::Dataset))?;
    let id = info.as_ref().map_or_else(|| id_of(path), |i| i.id.clone());
    if id.to_string().contains(['/', '\\', '\0']) {
        let reason = format!("{}: subject and sequence `{id}` do not form a valid file name", path.display());
        return Err(SequenceFailure { stage: Stage::Dataset, reason, fatal: false });
    }
    let listed = dataset.and_then(|d| d.sequences.iter().find(|s| s.id == id));
    if listed.is_none()
        && let Some(row) =
            dataset.and_then(|d| d.failures.iter().find(|row| (&row.subject, &row.sequence) == (&id.subject, &id.sequence)))
    {
        // The content of a damaged row may differ from the one recorded beside the track.
        return Err(SequenceFailure { stage: Stage::Dataset, reason: row.reason(), fatal: false });
    }
    // Without the `.json`, only the manifest shows that a sequence is in reverse order.
    let frames = match listed.and_then(|entry| entry.first_frame) {
        Some(neutral) if info.is_none() => neutral_first(frames, Some(neutral)),
        _ => frames,
    };
    let marks = info.as_ref().map(TrackInfo::mark_places).unwrap_or_default();
    let times = info.as_ref().and_then(|info| info.times.clone());
    let clock = info.as_ref().map(|info| info.clock_of_numbers(frames.iter().map(|f| f.number))).unwrap_or_default();
    let earlier = info.as_ref().map(|info| info.summary.clone());
    let content = file_blake3(path).map(|csv| content_of(info.as_ref(), &csv)).unwrap_or_default();
    let pictures = info.as_ref().and_then(pictures_of);
    let marks_from = info.as_ref().map(|info| info.marks_from.clone());
    let (emotion, metadata) = match (listed, info) {
        (Some(entry), _) => (entry.emotion.clone(), entry.metadata.clone()),
        (None, Some(info)) => (info.emotion.trim().to_lowercase(), info.metadata),
        (None, None) if may_be_unlabelled => (String::new(), BTreeMap::new()),
        (None, None) => {
            return Err(SequenceFailure {
                stage: Stage::Dataset,
                reason: format!(
                    "{}: the emotion is unknown; give --dataset with a manifest that lists {id}, or keep the .json beside the track",
                    path.display()
                ),
                fatal: false,
            });
        }
    };
    let normalized = normalized(&frames, &marks, times.as_deref(), bench).map_err(|failure| {
        let reason = format!("{}: {}", path.display(), failure.reason);
        SequenceFailure { reason, ..failure }
    })?;
    let summary = summarize(&frames, &bench.wireframe, &bench.tables);
    let mut summary = match &earlier {
        Some(earlier) => summary.told_by_the_pictures_of(earlier),
        None => summary,
    };
    normalized.judge(&mut summary, &frames, bench);
    let course = measure(&normalized, &frames, &clock, bench)?.as_deref().and_then(Course::of);
    let model = normalized.model;
    let mut quality = TrackQuality::new(id.clone(), emotion.clone(), summary, &frames, &bench.wireframe);
    quality.content = content;
    let (model, quality) = (SequenceModel { id, model }, Some(quality));
    Ok(AnalyzedModel { model, emotion, metadata, quality, course, pictures, marks_from })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sequence_stands_behind_the_last_underscore() {
        let id = |path: &str| id_of(Path::new(path)).to_string();
        assert_eq!(id("out/S005_001.csv"), "S005_001");
        assert_eq!(id_of(Path::new("a_b_7.csv")).subject, "a_b");
        assert_eq!(id_of(Path::new("alone.csv")).subject, "alone");
    }

    #[test]
    fn results_and_their_tracks_lead_to_each_other() {
        let out = tempfile::tempdir().unwrap();
        assert_eq!(tracks_folder(out.path()), out.path(), "a folder of tracks alone");
        assert_eq!(results_folder(out.path()), out.path());
        let tracks = out.path().join("tracks");
        std::fs::create_dir(&tracks).unwrap();
        assert_eq!(tracks_folder(out.path()), tracks);
        assert_eq!(results_folder(&tracks).canonicalize().unwrap(), out.path().canonicalize().unwrap());
    }
}
