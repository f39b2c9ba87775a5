//! Turns frames with marked points on the first one into a FAP file: fit, track, normalize, write.
//!
//!     cargo run --example fit_to_fap -- fixtures/simulated/S001/005 happiness.fap

use std::{env, error::Error, path::Path};

use grimace::{
    correspondence::read_correspondences,
    dataset::list_frames,
    fap::{FapCatalog, FapSequence, write_fap},
    fit::{FitOptions, Fitter},
    normalize::{NormalizeOptions, Normalizer},
    sequence::SequenceReader,
    track::{TrackOptions, TrackPlan, track_model, track_sequence},
    wireframe::Face,
};

fn main() -> Result<(), Box<dyn Error>> {
    match env::args().skip(1).collect::<Vec<_>>().as_slice() {
        [folder, fap] => run(Path::new(folder), Path::new(fap)),
        _ => Err("usage: fit_to_fap FOLDER_OF_FRAMES OUT.fap, with correspondences.csv among the frames".into()),
    }
}

/// Writes the expression in a folder of frames, neutral to apex, as a FAP file.
///
/// # Errors
/// Any error of the steps.
pub fn run(folder: &Path, fap: &Path) -> Result<(), Box<dyn Error>> {
    let Face { wireframe, tables } = Face::candide3();

    // Fit: moves the wireframe to the marked points of the first, neutral frame.
    let marks = read_correspondences(&folder.join("correspondences.csv"), &tables, wireframe.node_count())?;
    let fitted = Fitter::new(&wireframe, FitOptions::default()).fit(&wireframe, &marks)?;

    // Track: follows the face through the frames; the callback returns `true` to continue.
    let frames = SequenceReader::open(&list_frames(folder, None, None)?)?;
    let plan = TrackPlan::new(&wireframe, &tables);
    let track = track_sequence(&wireframe, &plan, &fitted, frames, &TrackOptions::default(), |_| true)?;

    // Normalize: five upright frames in face units, independent of the size of the face in pixels.
    let normalizer = Normalizer::new(&wireframe, &tables, NormalizeOptions::default())?;
    let model = normalizer.normalize(&track_model(&track.frames)?)?;

    // FAPs: five frames inserted between every two of the five, 25 frames per second.
    let fapus = &normalizer.canonical().fapus;
    let (sequence, limited) = FapSequence::from_model(&model, fapus, FapCatalog::mpeg4(), "expression", 25, 5)?;
    println!("{} frames, {} FAPs, {} values limited", sequence.frames.len(), sequence.set_faps().len(), limited.len());
    write_fap(fap, &sequence)?;
    Ok(())
}
