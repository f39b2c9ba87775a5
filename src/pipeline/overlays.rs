//! Pictures of the wireframe on the frames of a sequence.

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

/// Pictures of the wireframe on the wanted frames of a track, with the frame's number, and the head's axes where its poses are given.
///
/// # Errors
/// [`SequenceFailure`] when frames do not read.
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

/// Overlay pictures in a folder, with a record of what is ours there: other files of their names are not written over.
pub struct OverlayFolder {
    record: FolderRecord,
    /// Names that files of others have.
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
    /// Whose frames it holds.
    pub whose: String,
}

impl OverlayFolder {
    /// Refuses a folder for overlay pictures in which frames are; `sequences` are folders of frames, or videos, by names.
    ///
    /// # Errors
    /// [`AmongFrames`].
    pub fn check_apart<'a>(
        folder: &Path,
        sequences: impl IntoIterator<Item = (impl ToString, &'a Path)>,
    ) -> Result<(), AmongFrames> {
        // What is not there yet holds no frames.
        let Ok(place) = folder.canonicalize() else { return Ok(()) };
        let holds = |frames: &Path| frames.canonicalize().is_ok_and(|frames| frames == place);
        match sequences.into_iter().find(|(_, frames)| holds(frames)) {
            Some((whose, _)) => Err(AmongFrames { folder: folder.to_owned(), whose: whose.to_string() }),
            None => Ok(()),
        }
    }

    /// Opens the folder, or makes it. With `force` files of others are written over.
    ///
    /// # Errors
    /// [`OutputError`].
    pub fn open(folder: &Path, force: bool) -> Result<Self, OutputError> {
        const NAME: &str = "overlays.b3";
        std::fs::create_dir_all(folder).map_err(OutputError::at(folder))?;
        Ok(Self { record: FolderRecord::open(folder, NAME, force)?, taken: Mutex::default() })
    }

    /// Name of an overlay picture: not that of a Cohn-Kanade frame, lest a picture replace the frame it shows.
    fn name(id: &SequenceId, number: u32) -> String {
        format!("{id}_{number:08}{OVERLAY_SUFFIX}")
    }

    /// Writes the picture of a frame, unless somebody else's file has its name.
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

    /// Removes earlier pictures of the sequences for which `is_done`, and ends the record; those of others stay. What is to be said of
    /// pictures that were not written.
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

/// How many overlay pictures of these sequences are in a folder, which an earlier run may have put there.
pub(super) fn overlays_of(folder: &Path, hidden: &BTreeSet<String>) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let is_theirs = |name: &str| {
        let stem = name.strip_suffix(OVERLAY_SUFFIX).and_then(|stem| stem.rsplit_once('_'));
        stem.is_some_and(|(id, number)| number.bytes().all(|b| b.is_ascii_digit()) && hidden.contains(id))
    };
    entries.flatten().filter(|entry| is_theirs(&entry.file_name().to_string_lossy())).count()
}
