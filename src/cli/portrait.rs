//! Photographs on which expressions are put.

use std::path::Path;

use anyhow::Context;
use grimace::{
    clone::Target,
    dataset::{LandmarkSelection, read_marks},
    pipeline::Workbench,
    sequence::{Frame, Portrait},
};

use super::shared::marks_found;

/// Reads a photograph with the marks of a file, or with found marks. It has the name of its file. Marks of a file that miss the face of the
/// photograph are reported.
pub fn target(path: &Path, marks: Option<&Path>, selection: &LandmarkSelection, bench: &Workbench) -> anyhow::Result<Target> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let portrait = Portrait::read(path)?;
    let remark = portrait.remark();
    let Portrait { picture, grey, .. } = portrait;
    let frame = Frame::new(0, grey);
    let (target, beside) = match marks {
        Some(marks) => {
            let points = read_marks(marks, selection, &bench.tables, bench.wireframe.node_count())?;
            let in_files = || format!("{} with {}", path.display(), marks.display());
            bench.marked_target(&name, (picture, frame.image()), &points).with_context(in_files)?
        }
        None => {
            anyhow::ensure!(
                *selection == LandmarkSelection::Auto,
                "{}: --marks selects landmarks of a file, but no file is given; name it with --correspondences, or leave --marks out \
                 to find the marks",
                path.display()
            );
            let points = marks_found(bench, path, &frame, Some(&picture))?.marks;
            let with_found = || format!("{} with found marks", path.display());
            (bench.target(&name, picture, &points).with_context(with_found)?, Vec::new())
        }
    };
    if let Some(said) = remark {
        eprintln!("note: {}: {said}", path.display());
    }
    if let Some(apart) = target.lips_apart() {
        eprintln!(
            "note: {}: the lips are parted by {:.0} % of the eye distance; what is visible between them stays in place. Use a neutral face with \
             closed lips for the best result",
            path.display(),
            100.0 * apart
        );
    } else if let Some(drawn) = target.corners_drawn(frame.image()) {
        eprintln!(
            "note: {}: the face seems to show an expression already: the corners of its mouth are {:.0} % of the eye distance from those of a neutral \
             face. Motions are added to what it shows; use a neutral face for the best result",
            path.display(),
            100.0 * drawn
        );
    }
    if let Some(marks) = marks {
        for said in beside {
            eprintln!("note: {} with {}: {said}", path.display(), marks.display());
        }
    }
    Ok(target)
}
