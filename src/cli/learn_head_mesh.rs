//! `grimace learn head-mesh`.

use std::path::PathBuf;

use anyhow::Context;
use grimace::{
    output::{self, MADE_BY},
    synthesis::{HeadMeshOrigin, learn_head_mesh},
};

use super::{
    Outcome,
    apart::check_not_over,
    shared::{LearnedFileArgs, about, check_free, file_name},
};

/// Derive the dense head that ships with the program from a symmetric face model.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn head-mesh ict -o candide/head_mesh.bin --credit \"Whose model this is, and the licence\"

MODEL is a folder with neutral_vertices.npy (V x 3, centimetres), triangles.npy or quads.npy, expression_deltas.npy, and a manifest.json \
that names the expressions (as in ARKit, with _L and _R for the sides) and the vertices of the 68 landmarks.

The command removes the neck and stores the left half, rounded to 0.01 mm (positions) and 0.02 mm (shapes); the right half mirrors it. \
This command made candide/head_mesh.bin, which is compiled into the program: `--bank head`.")]
pub struct Args {
    /// Folder of the dense face model
    #[arg(value_name = "MODEL")]
    folder: PathBuf,
    /// Head file to write
    #[arg(short, long, value_name = "HEAD.bin")]
    output: PathBuf,
    #[command(flatten)]
    file: LearnedFileArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    check_not_over(&args.output, &args.folder)?;
    check_free(&args.output, args.file.force)?;
    let (head, blake3) = learn_head_mesh(&args.folder).map_err(|e| about(&args.folder)(&e))?;
    let command = format!("grimace learn head-mesh {} -o {}", file_name(&args.folder), file_name(&args.output));
    let origin = HeadMeshOrigin { made_by: MADE_BY.to_owned(), command, blake3, credit: args.file.credit.clone() };
    let bytes = head.to_bytes(&origin).map_err(anyhow::Error::msg).context("the head does not fit into its file")?;
    output::write_bytes(&args.output, &bytes)?;
    args.file.summarize(
        || println!("{} vertices, {} shapes, {} bytes", head.positions.len(), head.shapes.len(), bytes.len()),
        "model this is",
    );
    Ok(Outcome::Done)
}
