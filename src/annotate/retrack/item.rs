//! One track on the desk.

use std::path::{Path, PathBuf};

use super::{
    super::RequestError,
    messages::{Opened, frame_nodes},
};
use crate::{
    dataset::{FrameSource, SequenceEntry},
    fit::Springs,
    input::file_blake3,
    pipeline::Workbench,
    track::{
        Corrections, Look, Looks, NodeState, TrackInfo, TrackSummary, TrackedFrame, content_of, correct_nodes, corrections_path,
        fitting_corrections, read_corrections, read_track, read_track_info,
    },
};

pub struct Item {
    pub csv: PathBuf,
    pub id: String,
    pub emotion: String,
    /// Its row in the manifest.
    pub entry: SequenceEntry,
    pub source: FrameSource,
    pub summary: TrackSummary,
    /// Reasons to look at it: those of the run, else those of the track alone.
    pub reasons: Vec<String>,
    pub corrected: usize,
}

impl Item {
    /// Opens a track of a dataset with these sequences.
    pub fn open(csv: PathBuf, entries: &[SequenceEntry], node_count: usize) -> Result<Self, String> {
        let info = info_of(&csv).map_err(|e| match e {
            RequestError::Refused(reason) => reason,
            other => format!("{other:?}"),
        })?;
        let entry = entries.iter().find(|e| e.id == info.id);
        let entry = entry.ok_or_else(|| format!("{}: the dataset has no sequence {}", csv.display(), info.id))?;
        if !info.has_pictures() {
            return Err(format!(
                "{}: the track was made from landmarks, so it has no pictures to correct it in; write corrections (frame,node,x,y) into {} and \
                 run again",
                csv.display(),
                corrections_path(&csv).display()
            ));
        }
        let source = entry.frames().map_err(|e| e.to_string())?;
        if source.names() != info.source {
            return Err(format!(
                "{}: the track was made from different frames than {} has now; run `grimace run` again",
                csv.display(),
                entry.frames_path.display()
            ));
        }
        let frames = read_track(&csv).map_err(|e| e.to_string())?;
        let found = frames.first().map_or(0, |f| f.nodes.len());
        if found != node_count {
            return Err(format!(
                "{}: the track has {found} nodes, but the wireframe has {node_count}; give the wireframe of the track with --wireframe FILE",
                csv.display()
            ));
        }
        let corrected = count_corrected(&frames);
        let (id, emotion) = (info.id.to_string(), info.emotion);
        Ok(Self { csv, id, emotion, entry: entry.clone(), source, summary: info.summary, reasons: Vec::new(), corrected })
    }

    /// Its sources and options.
    pub fn info(&self) -> Result<TrackInfo, RequestError> {
        info_of(&self.csv)
    }

    /// Identifies what the page shows of a track.
    pub fn content(&self) -> Result<String, RequestError> {
        let csv =
            file_blake3(&self.csv).ok_or_else(|| RequestError::Refused(format!("{}: cannot be read", self.csv.display())))?;
        Ok(content_of(Some(&self.info()?), &csv))
    }

    /// What a person found when looking at it, if it is still the same.
    pub fn look(&self, looks: &Looks) -> Option<Look> {
        looks.of(&self.entry.id, &self.content().ok()?)
    }

    /// The track to show. It includes corrections that were saved but not added, because the process was killed in between.
    pub fn frames(&self, bench: &Workbench, springs: &Springs) -> Result<Vec<TrackedFrame>, RequestError> {
        let mut frames = read_track(&self.csv).map_err(RequestError::refused)?;
        let info = self.info()?;
        let saved = read_corrections(&self.csv).map_err(RequestError::refused)?;
        if let Some(saved) = saved.filter(|s| info.corrections.as_ref().is_none_or(|c| c.blake3 != s.blake3)) {
            let set_on = info.corrections.as_ref().map_or(info.image_size, |c| c.image_size);
            let (fit, _) = fitting_corrections(&saved.corrections, set_on, info.image_size, &frames, &bench.wireframe);
            for frame in &mut frames {
                if let Some(hard) = fit.get(&frame.number) {
                    frame.nodes = correct_nodes(&bench.wireframe, springs, &frame.nodes, hard).map_err(RequestError::refused)?;
                }
            }
        }
        Ok(frames)
    }

    /// The corrections in the track's corrections file; `None` without one.
    pub fn saved_corrections(&self) -> Result<Option<Corrections>, RequestError> {
        let saved = read_corrections(&self.csv).map_err(RequestError::refused)?;
        Ok(saved.map(|saved| saved.corrections))
    }

    /// All that the page shows of it, without a look.
    pub fn opened(&self, bench: &Workbench, springs: &Springs) -> Result<Opened, RequestError> {
        let info = self.info()?;
        Ok(Opened {
            id: self.id.clone(),
            emotion: self.emotion.clone(),
            width: info.image_size.width,
            height: info.image_size.height,
            frames: self.frames(bench, springs)?.iter().map(frame_nodes).collect(),
            version: self.version(),
            file: self.csv.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            marks_from: info.marks_from,
            reasons: self.reasons.clone(),
            look: None,
        })
    }

    /// Version of a track in 16 digits: a hash of the track and its corrections.
    pub fn version(&self) -> String {
        let mut hasher = blake3::Hasher::new();
        for path in [&self.csv, &corrections_path(&self.csv)] {
            let bytes = crate::input::read(path);
            hasher.update(&[u8::from(bytes.is_ok())]);
            hasher.update(blake3::hash(&bytes.unwrap_or_default()).as_bytes());
        }
        hasher.finalize().to_hex()[..16].to_owned()
    }
}

fn info_of(csv: &Path) -> Result<TrackInfo, RequestError> {
    let info = read_track_info(csv).map_err(RequestError::refused)?;
    info.ok_or_else(|| {
        RequestError::Refused(format!(
            "{}: the .json beside the track is missing; without it the options of the track are unknown: track \
             the sequence again",
            csv.display()
        ))
    })
}

/// Nodes set by hand after the neutral frame.
pub fn count_corrected(frames: &[TrackedFrame]) -> usize {
    frames.iter().skip(1).flat_map(|f| &f.nodes).filter(|n| n.state == NodeState::Corrected).count()
}
