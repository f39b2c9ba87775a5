//! `grimace locate`.

use std::{
    collections::BTreeSet,
    path::{Path, PathBuf},
};

use anyhow::Context;
use grimace::{
    locate::{FacePart, LocateOptions, LocatedFace, Locator, Model, TRUSTED},
    output::{self, nine_digits},
    overlay::{draw_points, png_bytes},
    pipeline::{PictureSource, ReadPicture, pictures_of},
    sequence::ImageSize,
};
use rayon::prelude::*;

use super::{
    Outcome,
    apart::{all, check_apart, maybe},
    progress::frame_bar,
    shared::{check_free, set_threads},
};

/// Find faces and their points in pictures.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace locate photo.jpg -o points.csv --overlay pictures
  grimace locate my-dataset -o points.csv

POINTS.csv has the columns image,face,node,x,y,expected_error. Faces count from 1, the largest first; nodes are Candide-3 vertices; x and y \
are in pixels. expected_error is the median error in pixels: half of such points are closer, half further away. In a dataset `locate` reads \
the neutral frames.

`locate` reports faces whose median expected error is above --trust as not trusted: check them before you use their points. It also reports \
covered parts of a face (by a mask, a hand, dark glasses). Their points are estimated from the rest of the face and have larger expected \
errors. It searches for turned faces only if it finds no upright face.

Exit status: 0 done, 3 a picture has no face or could not be read.")]
pub struct Args {
    /// Pictures, folders of pictures, or datasets
    #[arg(required = true, value_name = "IMAGE|FOLDER|DATASET")]
    pictures: Vec<PathBuf>,
    /// Table of points to write: image,face,node,x,y,expected_error
    #[arg(short, long, value_name = "POINTS.csv")]
    output: PathBuf,
    /// Output folder for pictures with the points drawn on them
    ///
    /// The colour shows the median expected error: green up to 2 % of the eye distance, yellow up to 5 %, red above.
    #[arg(long, value_name = "DIR")]
    overlay: Option<PathBuf>,
    /// Model file of `grimace learn locator`, to use instead of the built-in model
    #[arg(long, value_name = "FILE")]
    model: Option<PathBuf>,
    /// Maximum number of faces per picture; a message says if there are more
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u16).range(1..=1000), value_name = "COUNT")]
    faces: u16,
    /// Smallest distance between the pupils to search for, in px; by default in proportion to the picture's longer side
    #[arg(long, value_parser = clap::value_parser!(u16).range(10..), value_name = "PX")]
    least_eye_distance: Option<u16>,
    /// Also search for small faces in pictures with large faces; takes about five times as long
    #[arg(long)]
    every_size: bool,
    /// Largest median expected error of a trusted face, as a share of the eye distance
    #[arg(long, default_value_t = TRUSTED, value_parser = share, value_name = "SHARE")]
    trust: f64,
    /// Number of threads; 0 uses one per core
    #[arg(short = 'j', long, alias = "jobs", default_value_t = 0)]
    threads: usize,
    /// Overwrite existing results
    #[arg(long)]
    force: bool,
    /// Print no progress bar and no summary
    #[arg(short, long)]
    quiet: bool,
}

/// Parses a share of the eye distance; users may enter percent by mistake.
fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        Ok(percent) if percent > 1.0 && percent <= 100.0 => Err(format!(
            "expected a share from 0 to 1: for {percent} % of the eye distance give {}",
            nine_digits(percent / 100.0)
        )),
        _ => Err("expected a share, a number from 0 to 1".to_owned()),
    }
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let inputs: Vec<_> = all("the picture", &args.pictures).chain(maybe("--model", args.model.as_ref())).collect();
    let outputs: Vec<_> = maybe("--output", Some(&args.output)).chain(maybe("--overlay", args.overlay.as_ref())).collect();
    check_apart(&outputs, &inputs)?;
    for path in [Some(&args.output), args.overlay.as_ref()].into_iter().flatten() {
        check_free(path, args.force)?;
    }
    set_threads(args.threads)?;
    let model = match &args.model {
        Some(path) => Model::read(path)?.0,
        None => Model::shipped()?,
    };
    let locator = Locator::new(model);
    let options = LocateOptions {
        most_faces: usize::from(args.faces),
        least_eye_distance: args.least_eye_distance.map(f64::from),
        every_size: args.every_size,
    };
    let (mut pictures, mut failures) = (Vec::new(), Vec::new());
    // Overlapping patterns name a picture twice.
    let mut named = BTreeSet::new();
    for path in args.pictures.iter().filter(|path| named.insert(path.canonicalize().unwrap_or_else(|_| (*path).clone()))) {
        match pictures_of(path) {
            Ok((found, failed)) => {
                pictures.extend(found);
                failures.extend(failed);
            }
            Err(error) if args.pictures.len() == 1 => return Err(error.into()),
            Err(error) => failures.push(super::chain(&error.into())),
        }
    }
    if let Some(folder) = &args.overlay {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    let bar = frame_bar(args.quiet, Some(pictures.len() as u64));
    let found: Vec<Result<Located, String>> = pictures
        .par_iter()
        .enumerate()
        .map(|(k, picture)| {
            let faces = locate(
                &locator,
                picture,
                &options,
                args.overlay.as_deref().filter(|_| picture.may_publish).map(|folder| (folder, k)),
            );
            bar.inc(1);
            faces.map_err(|e| super::chain(&e))
        })
        .collect();
    bar.finish_and_clear();
    let rows = pictures.iter().zip(&found).flat_map(|(picture, faces)| {
        let name = picture.name.as_str();
        faces.iter().flat_map(|found| found.faces.iter().map(|face| (found.size, face))).enumerate().flat_map(
            move |(k, (size, face))| {
                // If the border cuts a face, the points beyond it are not visible.
                face.points.iter().filter(move |point| size.contains(&point.position)).map(move |point| {
                    let numbers = [point.position.x, point.position.y, point.expected_error].map(nine_digits);
                    [name.to_owned(), (k + 1).to_string(), point.node.to_string()].into_iter().chain(numbers).collect::<Vec<_>>()
                })
            },
        )
    });
    output::write_records(&args.output, ["image", "face", "node", "x", "y", "expected_error"], rows)?;
    let undrawn: Vec<&anyhow::Error> = found.iter().filter_map(|found| found.as_ref().ok()?.undrawn.as_ref()).collect();
    let (mut empty, mut unreadable, mut doubtful, mut covered, mut count) = (0, failures.len(), 0, 0, 0);
    for failure in &failures {
        eprintln!("{failure}");
    }
    for (picture, faces) in pictures.iter().zip(&found) {
        if let Ok(Located { remark: Some(said), .. }) = faces {
            eprintln!("note: {}: {said}", picture.name);
        }
        match faces {
            Err(reason) => {
                unreadable += 1;
                // Messages of OpenCV and of the file system name the file.
                if reason.contains(&picture.name) { eprintln!("{reason}") } else { eprintln!("{}: {reason}", picture.name) }
            }
            Ok(Located { faces, .. }) if faces.is_empty() => {
                empty += 1;
                eprintln!("{}: no face found", picture.name);
            }
            Ok(Located { faces, left_out, .. }) => {
                count += faces.len();
                if *left_out > 0 {
                    eprintln!(
                        "{}: at least {} left out; raise --faces {} to take more",
                        picture.name,
                        output::count(*left_out, "more face is", "more faces are"),
                        args.faces
                    );
                }
                for (k, face) in faces.iter().enumerate().filter(|(_, f)| f.expected_error() > args.trust) {
                    doubtful += 1;
                    eprintln!(
                        "{}: face {} is not trusted: its median expected error is {:.1} % of the eye distance",
                        picture.name,
                        k + 1,
                        100.0 * face.expected_error()
                    );
                }
                for (k, face) in faces.iter().enumerate() {
                    let Some(said) = FacePart::said_covered(&face.covered) else { continue };
                    covered += 1;
                    eprintln!(
                        "{}: face {}: {said}: the median expected error there is {:.1} % of the eye distance",
                        picture.name,
                        k + 1,
                        100.0 * face.expected_error_of(&face.covered)
                    );
                }
            }
        }
    }
    if !args.quiet {
        println!(
            "{}, {count} {}, {doubtful} not trusted, {empty} without a face{}{}",
            output::count(pictures.len(), "picture", "pictures"),
            if count == 1 { "face" } else { "faces" },
            if covered > 0 { format!(", {covered} partly covered") } else { String::new() },
            if unreadable > 0 { format!(", {unreadable} unreadable") } else { String::new() }
        );
    }
    if let Some(first) = undrawn.first() {
        anyhow::bail!(
            "{} of --overlay could not be written: {}; the points of all faces are in {}",
            output::count(undrawn.len(), "picture", "pictures"),
            super::chain(first),
            args.output.display()
        );
    }
    Ok(if empty + unreadable > 0 { Outcome::SomeFailed } else { Outcome::Done })
}

/// The faces of a picture.
struct Located {
    faces: Vec<LocatedFace>,
    /// How many more there may be.
    left_out: usize,
    size: ImageSize,
    /// What is to be said of the picture.
    remark: Option<String>,
    /// Why the picture with the points could not be written.
    undrawn: Option<anyhow::Error>,
}

fn locate(
    locator: &Locator,
    picture: &PictureSource,
    options: &LocateOptions,
    overlay: Option<(&Path, usize)>,
) -> anyhow::Result<Located> {
    let ReadPicture { frame, colour, remark } = picture.read()?;
    let size = frame.size();
    let image = frame.into_image();
    let (mut faces, left_out) = locator.locate_counted(&image, options);
    if let Some(colour) = &colour {
        faces.iter_mut().for_each(|face| _ = face.look_for_teeth(colour));
    }
    let draw = |(folder, number): (&Path, usize)| -> anyhow::Result<()> {
        let stem = Path::new(&picture.name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let points: Vec<_> =
            faces.iter().flat_map(|f| f.points.iter().map(|p| (p.position, p.expected_error, f.eye_distance))).collect();
        let path = folder.join(format!("{:04}_{stem}.png", number + 1));
        Ok(output::write_bytes(&path, &png_bytes(&draw_points(&image, &points))?)?)
    };
    let undrawn = overlay.and_then(|place| draw(place).err());
    Ok(Located { faces, left_out, size, remark, undrawn })
}
