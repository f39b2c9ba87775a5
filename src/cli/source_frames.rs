//! The pictures from which a track was made, for commands that show them.

use std::path::Path;

use grimace::{
    clone::SourceMotion,
    dataset::{FrameSource, list_readable},
    sequence::{ImageSize, content_blake3, read_colour_frames},
    track::TrackInfo,
};
use image::RgbImage;

/// Refuses frames whose names differ from those of the tracked ones, which are usually of another person. Folders may have moved.
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
        // Pictures from several folders are named by their paths.
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

/// Refuses frames with the right names but other content: many sequences have frames named by number.
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

/// Returns whether frames are of the same kind as those of the track, images or a video. For frames that were extracted from a video since,
/// or converted to one, neither names nor bytes can be compared.
fn is_same_kind(listed: &FrameSource, info: &TrackInfo) -> bool {
    info.has_pictures() && info.is_of_video() == matches!(listed, FrameSource::Video { .. })
}

/// The pictures of a track's frames in its order. They must be the tracked ones by name, content and size, as far as these are known.
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
    // The more specific error comes first.
    if let Some(info) = comparable {
        check_content(folder, &listed, motion, info)?;
    }
    Ok(read.into_iter().map(|(_, picture)| picture).collect())
}
