//! `grimace fit`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use grimace::{
    fit::{MarkKind, validate_correspondences},
    output::{self, nine_digits},
    overlay::{draw_overlay, png_bytes},
    pipeline::{NeutralFit, PipelineOptions},
    sequence::{read_colour, read_frame},
    track::{eye_distance_px, neutral_nodes},
};
use serde::Serialize;

use super::{
    Outcome,
    apart::{check_apart, check_png, maybe},
    shared::{CheckArgs, FitArgs, GeneralArgs, MethodArgs, marks_or_found},
};

/// Fit the wireframe to one neutral face from marked points.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace fit neutral.png -o fit.csv --overlay fit.png
  grimace fit neutral.png --correspondences marks.csv -o fit.csv --overlay fit.png

marks.csv has the columns node,x,y. A node is a Candide-3 vertex (0 to 112) or an MPEG-4 feature point such as 8.3; x and y are in pixels, \
and 0,0 is the centre of the top-left pixel. Left and right are the subject's own. A fit needs 5 to 8 marks; these eleven give a good one:
  20, 23  left eye, outer and inner corner      31, 64  left and right corner of the mouth
  53, 56  right eye, outer and inner corner     10      lowest point of the chin
  15, 17  left brow, outer and inner end        48, 50  right brow, outer and inner end
The overlay shows marks as yellow rings and fitted nodes as blue dots; it enlarges small images.")]
pub struct Args {
    /// Image of a neutral, frontal face
    image: PathBuf,
    /// Marked points, a CSV file node,x,y in pixels; by default found in the image
    #[arg(short, long, value_name = "C.csv")]
    correspondences: Option<PathBuf>,
    /// Output table with the position of every node: node,x,y,state,residual
    #[arg(short, long, value_name = "FIT.csv")]
    output: PathBuf,
    /// Draw the wireframe on the image, into this .png file, or into a folder under the image's name
    #[arg(long, value_name = "PNG|DIR")]
    overlay: Option<PathBuf>,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    fit: FitArgs,
    #[command(flatten)]
    check: CheckArgs,
    #[command(flatten)]
    general: GeneralArgs,
}

#[derive(Serialize)]
struct Row {
    node: usize,
    x: String,
    y: String,
    state: &'static str,
    residual: String,
}

/// File of the overlay picture: the given one or, for a path without extension, a file with the name of the image in this folder.
fn overlay_file(path: &Path, image: &Path) -> anyhow::Result<PathBuf> {
    if path.is_dir() || path.extension().is_none() {
        return Ok(path.join(format!("{}.png", image.file_stem().unwrap_or_default().to_string_lossy())));
    }
    check_png("--overlay", path, ", or a folder")?;
    Ok(path.to_owned())
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let overlay = args.overlay.as_deref().map(|path| overlay_file(path, &args.image)).transpose()?;
    let outputs: Vec<_> = maybe("--output", Some(&args.output)).chain(maybe("--overlay", overlay.as_ref())).collect();
    let inputs: Vec<_> =
        maybe("the image", Some(&args.image)).chain(maybe("--correspondences", args.correspondences.as_ref())).collect();
    check_apart(&outputs, &inputs)?;
    args.general.check_free(&args.output)?;
    if let Some(path) = &overlay {
        args.general.check_free(path)?;
    }
    let options = PipelineOptions {
        fit: args.fit.options_of(args.method.method),
        unchecked_marks: args.check.unchecked(),
        ..PipelineOptions::default()
    };
    let bench = args.general.workbench(options)?;
    let frame = read_frame(&args.image)?;
    let in_colour = || Ok((frame.clone(), Some(read_colour(&args.image)?)));
    let marks = marks_or_found(args.correspondences.as_deref(), &bench, &args.image, in_colour)?.marks;
    let in_file = || args.correspondences.as_ref().unwrap_or(&args.image).display().to_string();
    let size = frame.size();
    validate_correspondences(&marks, size.width, size.height).with_context(in_file)?;
    let NeutralFit { fitted, beside } = match &args.correspondences {
        Some(_) => bench.fit_in(frame.image(), &marks).with_context(in_file)?,
        None => NeutralFit { fitted: bench.fit(&marks).with_context(in_file)?, beside: Vec::new() },
    };
    let nodes = neutral_nodes(&bench.wireframe, &fitted);
    let rows = nodes.iter().enumerate().map(|(node, n)| Row {
        node,
        x: nine_digits(n.position.x),
        y: nine_digits(n.position.y),
        state: n.state.name(),
        residual: n.residual.map(nine_digits).unwrap_or_default(),
    });
    output::write_csv(&args.output, rows)?;
    if let Some(path) = &overlay {
        let points: Vec<_> = marks.iter().map(|m| m.position).collect();
        output::write_bytes(path, &png_bytes(&draw_overlay(&frame, &bench.wireframe, &nodes, &points))?)?;
    }
    if !args.general.quiet {
        let eye_distance = eye_distance_px(&bench.tables, fitted.model.nodes()).unwrap_or(0.0);
        let worst = fitted.residuals.iter().copied().fold(0.0, f64::max);
        let hard = marks.iter().filter(|m| m.kind == MarkKind::Hard).count();
        println!(
            "{} marks ({hard} hard), eye distance {eye_distance:.1} px, roll {:.1} degrees, largest distance of a node to its mark {worst:.2} px",
            marks.len(),
            -fitted.image_from_face.angle.to_degrees(),
        );
        for warning in &fitted.warnings {
            println!("note: {warning}");
        }
        for said in &beside {
            println!("note: {said}");
        }
        if !fitted.read.is_empty() {
            println!(
                "found {} nodes without a mark in the picture (--read-unmarked off fits to the marks only)",
                fitted.read.len()
            );
        }
        if marks.len() < 5 {
            println!("note: a fit needs 5 to 8 marks; the marks listed by `grimace fit --help` give a good one");
        }
    }
    Ok(Outcome::Done)
}
