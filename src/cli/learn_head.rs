//! `grimace learn head`.

use std::path::PathBuf;

use grimace::{
    output::MADE_BY,
    pose::{HeadOrigin, IDENTITY_MODES, learn_head, write_head},
    synthesis::read_dense_faces,
    wireframe::{Tables, Wireframe},
};

use super::{
    Outcome,
    apart::check_not_over,
    shared::{LearnedFileArgs, check_free, file_name},
};

/// Derive a three-dimensional head with Candide-3's nodes from a dense face model.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace learn head ict -o candide/head_model.json --credit \"Whose model this is, and the licence\"

MODEL is a folder with neutral_vertices.npy (V x 3), triangles.npy or quads.npy, identity_deltas.npy (modes x V x 3, one standard deviation \
each), expression_deltas.npy, and a manifest.json that names the expressions and the vertices of the 68 landmarks. This command made \
candide/head_model.json, which is compiled into the program.")]
pub struct Args {
    /// Folder of the dense face model
    #[arg(value_name = "MODEL")]
    folder: PathBuf,
    /// Head model to write (JSON)
    #[arg(short, long, value_name = "HEAD.json")]
    output: PathBuf,
    /// Number of identity modes to use, from the first
    #[arg(long, default_value_t = IDENTITY_MODES)]
    modes: usize,
    #[command(flatten)]
    file: LearnedFileArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    check_not_over(&args.output, &args.folder)?;
    check_free(&args.output, args.file.force)?;
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let (head, blake3) = learn_head(&read_dense_faces(&args.folder, args.modes)?, args.modes, &wireframe, &tables)?;
    let command = format!("grimace learn head {} --modes {} -o {}", file_name(&args.folder), args.modes, file_name(&args.output));
    let origin =
        HeadOrigin { made_by: MADE_BY.to_owned(), command, identity_modes: args.modes, blake3, credit: args.file.credit.clone() };
    write_head(&args.output, &head, &origin)?;
    args.file.summarize(
        || println!("{} nodes, {} identity modes, {} expressions", head.mean.len(), head.identity.len(), head.expressions.len()),
        "model this is",
    );
    Ok(Outcome::Done)
}
