//! The pictures that a track was made from, for commands that show them.

use std::path::Path;

use grimace::{
    clone::SourceMotion,
    dataset::{FrameSource, list_readable},
    sequence::{ImageSize, content_blake3, read_colour_frames},
    track::TrackInfo,
};
use image::RgbImage;

/// Refuses frames that are not called as those that a track was made from: of another person as a rule. Folders may have moved.
fn check_names(
    folder: &Path,
    listed: &FrameSource,
    numbers: &[u32],
    motion: &SourceMotion,
    info: &TrackInfo,
) -> anyhow::Result<()> {
    let names = listed.names();
    let used: Vec<String> = match listed {
        FrameSource::Images(files) => {
            files.iter().zip(names).filter(|(f, _)| numbers.contains(&f.number)).map(|(_, name)| name).collect()
        }
        FrameSource::Video { .. } => names,
    };
    let other = used.iter().find(|name| !info.source.contains(name));
    if let (Some(other), Some(known)) = (other, info.source.first()) {
        let more = if info.source.len() > 1 { " and others" } else { "" };
        // Pictures of several folders have paths for names.
        let what =
            if info.source.iter().all(|name| name.contains('/')) { "pictures, separated by `;`," } else { "folder or video" };
        anyhow::bail!(
            "{}: {other} is not one of the files that the track {} was made from ({known}{more}); give the {what} of the track",
            folder.display(),
            motion.name
        );
    }
    Ok(())
}

/// Refuses frames of the right names that hold something else: numbers alone are what everybody's frames are called.
fn check_content(folder: &Path, listed: &FrameSource, motion: &SourceMotion, info: &TrackInfo) -> anyhow::Result<()> {
    let Some(known) = &info.frames_blake3 else { return Ok(()) };
    let tracked = match listed {
        FrameSource::Images(files) => {
            let names = listed.names();
            let named = |name: &String| names.iter().position(|n| n == name).and_then(|place| files.get(place)).cloned();
            let Some(files) = info.source.iter().map(named).collect() else { return Ok(()) };
            FrameSource::Images(files)
        }
        FrameSource::Video { .. } => listed.clone(),
    };
    anyhow::ensure!(
        content_blake3(&tracked)?.to_hex().as_str() == known.as_str(),
        "{}: the files have the same names as those that the track {} was made from, but another content; give the folder or video of the track",
        folder.display(),
        motion.name
    );
    Ok(())
}

/// Whether frames are images as those of the track were, or a video as it was. Of frames that were taken out of a video since, or made into
/// one, neither names nor bytes say anything.
fn is_same_kind(listed: &FrameSource, info: &TrackInfo) -> bool {
    info.has_pictures() && info.is_of_video() == matches!(listed, FrameSource::Video { .. })
}

/// The pictures of a track's frames, in its order: those that were tracked, by their names, content and size, as far as these are known.
pub fn source_pictures(folder: &Path, motion: &SourceMotion, info: Option<&TrackInfo>) -> anyhow::Result<Vec<RgbImage>> {
    anyhow::ensure!(
        !motion.frames.is_empty(),
        "--source-frames belong to a track, but {} is a representative, a model or a FAP file; leave --source-frames out",
        motion.name
    );
    let numbers: Vec<u32> = motion.frames.iter().map(|f| f.0).collect();
    let listed = list_readable(folder)?;
    let size = info.map(|info| info.image_size);
    let comparable = info.filter(|info| is_same_kind(&listed, info));
    if let Some(info) = comparable {
        check_names(folder, &listed, &numbers, motion, info)?;
    }
    let read = read_colour_frames(&listed, &numbers)?;
    anyhow::ensure!(
        read.len() == numbers.len(),
        "{}: has only {} of the {} frames of the track {}; give the folder or video of the track",
        folder.display(),
        read.len(),
        numbers.len(),
        motion.name
    );
    for (number, picture) in &read {
        let found = ImageSize { width: picture.width(), height: picture.height() };
        anyhow::ensure!(
            size.is_none_or(|expected| found == expected),
            "{}: frame {number} is {found}, but the frames of the track {} are {}; give the folder or video of the track",
            folder.display(),
            motion.name,
            size.unwrap_or(found)
        );
    }
    // What tells more than that something differs comes first.
    if let Some(info) = comparable {
        check_content(folder, &listed, motion, info)?;
    }
    Ok(read.into_iter().map(|(_, picture)| picture).collect())
}
