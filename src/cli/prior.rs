//! `grimace prior`.

use std::path::{Path, PathBuf};

use anyhow::Context;
use grimace::{
    fit::{DEFAULT_MODES, FaceSource, PriorFile, PriorOrigin, check_faces_once, learn_prior, read_neutral_faces, write_prior},
    output::MADE_BY,
    wireframe::{Tables, Wireframe},
};

use super::{
    Outcome,
    apart::{all, check_apart},
    shared::{LearnedFileArgs, check_free, file_name, quoted},
};

/// Learn a shape prior for the fit from landmarks of neutral faces.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace prior landmarks68.csv -o people.json --credit \"Whose faces these are, and the licence\"
  grimace run faces -o results --prior people.json

LANDMARKS is one of:
  a CSV file with the columns x0,y0,...,x67,y67 (68 points in the iBUG order, pixels, y down) and a column person, subject or frame; \
every row is one face; with a column state only the rows of --state are used
  a table of nodes (person,node,x,y, or the output of `grimace locate`)
  a dataset whose manifest names landmarks; the neutral frame of each subject is used

Give one neutral face per person: at least 10 people, better 50 or more. The prior holds the mean face and its modes, not the landmarks of \
any person.")]
pub struct Args {
    /// Landmarks of neutral faces: CSV files or datasets
    #[arg(required = true, value_name = "LANDMARKS")]
    landmarks: Vec<PathBuf>,
    /// Prior file to write (JSON)
    #[arg(short, long, value_name = "PRIOR.json")]
    output: PathBuf,
    /// State of the rows to use, in files with a column `state`
    #[arg(long, default_value = "neutral")]
    state: String,
    /// Number of modes to keep
    #[arg(long, default_value_t = DEFAULT_MODES)]
    modes: usize,
    #[command(flatten)]
    file: LearnedFileArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    check_apart(&[("--output", &args.output)], &all("the landmarks", &args.landmarks).collect::<Vec<_>>())?;
    check_free(&args.output, args.file.force)?;
    let (wireframe, tables) = (Wireframe::candide3(), Tables::candide3());
    let (mut faces, mut sources, mut skipped) = (Vec::new(), Vec::new(), Vec::new());
    let mut inputs = Vec::new();
    for path in &args.landmarks {
        inputs.push((path, read_neutral_faces(path, &args.state)?));
    }
    check_faces_once(&inputs.iter().map(|(path, read)| (path.display().to_string(), read)).collect::<Vec<_>>())?;
    for (path, read) in inputs {
        sources.push(FaceSource { name: name_of(path), faces: read.faces.len(), blake3: read.blake3 });
        faces.extend(read.faces);
        skipped.extend(read.skipped);
    }
    if !args.file.quiet {
        for (subject, reason) in &skipped {
            eprintln!("skipped {subject}: {reason}");
        }
    }
    let prior = learn_prior(&wireframe, &tables, &faces, args.modes).context("no prior was learned")?;
    let origin = PriorOrigin {
        made_by: MADE_BY.to_owned(),
        command: command(args),
        faces: faces.len(),
        sources,
        credit: args.file.credit.clone(),
    };
    write_prior(&args.output, &PriorFile::new(&prior, origin))?;
    args.file.summarize(|| println!("{} faces, {} modes", faces.len(), prior.modes.len()), "faces these are");
    Ok(Outcome::Done)
}

/// The command line without folders of this machine.
fn command(args: &Args) -> String {
    let mut words = vec!["grimace prior".to_owned()];
    words.extend(args.landmarks.iter().map(|path| quoted(&name_of(path))));
    words.push(format!("--state {} --modes {}", quoted(&args.state), args.modes));
    words.push(format!("-o {}", quoted(&file_name(&args.output))));
    words.join(" ")
}

/// Name of a file or folder; `.` is resolved.
fn name_of(path: &Path) -> String {
    file_name(&path.canonicalize().unwrap_or_else(|_| path.to_owned()))
}
