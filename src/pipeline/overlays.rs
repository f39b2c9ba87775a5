//! Draws the wireframe on frames of a sequence.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use image::RgbImage;
use nalgebra::Point2;

use super::{SequenceFailure, SequenceSource, Stage, Workbench};
use crate::{
    output::{self, FolderRecord, OutputError},
    overlay::{draw_axes, draw_overlay},
    pose::HeadPose,
    sequence::SequenceReader,
    track::TrackedFrame,
    units::SequenceId,
};

/// Draws the wireframe on the given frames of a track, and the head's axes if its poses are given. Returns the pictures with their frame
/// numbers.
///
/// # Errors
/// [`SequenceFailure`] when frames cannot be read.
pub fn overlay_pictures(
    source: &SequenceSource,
    (frames, poses): (&[TrackedFrame], &[HeadPose]),
    bench: &Workbench,
    wanted: impl Fn(usize) -> bool,
    mut each: impl FnMut(u32, RgbImage) -> Result<(), SequenceFailure>,
) -> Result<(), SequenceFailure> {
    let marks: Vec<Point2<f64>> = source.marks.iter().map(|m| m.position).collect();
    let reader = SequenceReader::open(&source.frames).map_err(SequenceFailure::at(Stage::Track))?;
    for (index, (frame, tracked)) in reader.zip(frames).enumerate() {
        if !wanted(index) {
            continue;
        }
        let frame = frame.map_err(SequenceFailure::at(Stage::Track))?;
        let marks = if index == 0 { marks.as_slice() } else { &[] };
        let mut picture = draw_overlay(&frame, &bench.wireframe, &tracked.nodes, marks);
        if let Some(pose) = poses.get(index) {
            draw_axes(&mut picture, frame.size().width, pose);
        }
        each(tracked.number, picture)?;
    }
    Ok(())
}

/// Folder of overlay pictures with a record of those that this program wrote. Other files with their names are not overwritten.
pub struct OverlayFolder {
    record: FolderRecord,
    /// Names of pictures that were not written because other files have them.
    taken: Mutex<BTreeSet<String>>,
}

/// Overlay pictures that would be frames to the next command.
#[derive(Debug, thiserror::Error)]
#[error(
    "{}: the overlay pictures would lie among the frames of {whose}, and later commands would read them as frames; give another folder",
    folder.display()
)]
pub struct AmongFrames {
    /// The folder for overlay pictures.
    pub folder: PathBuf,
    /// Name of the sequence whose frames it holds.
    pub whose: String,
}

impl OverlayFolder {
    /// Returns an error if overlay pictures would go into a folder of frames. `sequences` are folders of frames or videos, by name.
    ///
    /// # Errors
    /// [`AmongFrames`].
    pub fn check_apart<'a>(
        folder: &Path,
        sequences: impl IntoIterator<Item = (impl ToString, &'a Path)>,
    ) -> Result<(), AmongFrames> {
        // A folder that does not exist yet has no frames.
        let Ok(place) = folder.canonicalize() else { return Ok(()) };
        let holds = |frames: &Path| frames.canonicalize().is_ok_and(|frames| frames == place);
        match sequences.into_iter().find(|(_, frames)| holds(frames)) {
            Some((whose, _)) => Err(AmongFrames { folder: folder.to_owned(), whose: whose.to_string() }),
            None => Ok(()),
        }
    }

    /// Opens or creates the folder. With `force`, existing files of other origin are overwritten.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn open(folder: &Path, force: bool) -> Result<Self, OutputError> {
        const NAME: &str = "overlays.b3";
        std::fs::create_dir_all(folder).map_err(OutputError::at(folder))?;
        Ok(Self { record: FolderRecord::open(folder, NAME, force)?, taken: Mutex::default() })
    }

    /// Name of an overlay picture. It differs from Cohn-Kanade frame names, so that a picture never replaces its frame.
    fn name(id: &SequenceId, number: u32) -> String {
        format!("{id}_{number:08}{OVERLAY_SUFFIX}")
    }

    /// Writes the picture of a frame, unless a file of other origin has its name.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn write(&self, id: &SequenceId, number: u32, png: &[u8]) -> Result<(), OutputError> {
        let name = Self::name(id, number);
        if self.record.check_free(&name).is_err() {
            self.taken.lock().unwrap_or_else(PoisonError::into_inner).insert(name);
            return Ok(());
        }
        self.record.write(&name, |out| out.write_all(png))
    }

    /// Removes earlier pictures of the sequences for which `is_done` is true, and finishes the record. Pictures of other sequences stay.
    /// Returns a message about pictures that were not written.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn close(self, is_done: impl Fn(&str) -> bool) -> Result<Option<String>, OutputError> {
        let sequence = |name: &str| {
            let stem = name.strip_suffix(OVERLAY_SUFFIX)?;
            Some(stem.rsplit_once('_')?.0.to_owned())
        };
        self.record.keep(|name| !sequence(name).is_some_and(|id| is_done(&id)));
        self.record.remove_stale()?;
        self.record.close()?;
        let taken = self.taken.into_inner().unwrap_or_else(PoisonError::into_inner);
        Ok(taken.first().map(|first| {
            let pictures = output::count(taken.len(), "overlay picture", "overlay pictures");
            format!("{pictures} not written, because files of the same name exist that grimace did not write, such as {first}; --force \
                 overwrites them")
        }))
    }
}

/// End of the name of an overlay picture.
const OVERLAY_SUFFIX: &str = "_overlay.png";

/// Number of overlay pictures of these sequences in a folder, for example from an earlier run.
pub(super) fn overlays_of(folder: &Path, hidden: &BTreeSet<String>) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let is_theirs = |name: &str| {
        let stem = name.strip_suffix(OVERLAY_SUFFIX).and_then(|stem| stem.rsplit_once('_'));
        stem.is_some_and(|(id, number)| number.bytes().all(|b| b.is_ascii_digit()) && hidden.contains(id))
    };
    entries.flatten().filter(|entry| is_theirs(&entry.file_name().to_string_lossy())).count()
}
