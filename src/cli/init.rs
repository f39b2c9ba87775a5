//! `grimace init`.

use std::path::{Path, PathBuf};

use grimace::{
    dataset::{
        DatasetError, IMAGE_EXTENSIONS, Kept, UNKNOWN_EMOTION, VIDEO_EXTENSIONS, is_publish_column, manifest_path,
        propose_manifest,
    },
    output::{count, listed},
    pipeline::keep_edited,
    text::single_line,
};

use super::{
    Outcome,
    apart::{check_apart, maybe},
    shared::{check_free, quoted},
};

/// Write a manifest for a folder of image sequences and videos.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace init recordings --people people.csv

Every video and every folder with two or more images, at any depth, becomes a row of recordings/manifest.csv:
  subject   the first folder whose name is not an emotion
  sequence  the other folders
  emotion   from the name of a folder or file (happy, S001_anger.mp4), else `?`: fill it in

Emotions may be named in English or German (Freude, Trauer, Wut). A folder that holds everything, such as `videos`, is not a subject. `init` leaves out results, overlays and other pictures that grimace wrote. For a folder in the layout of Cohn-Kanade it reads the labels and \
landmarks. people.csv has a column `subject` (or `participant`, `id`, `name`); its other columns, such as gender, are added to every sequence of that subject, so that you can group with --by.

Single pictures of several people become sequences of two pictures, the neutral one first: neutral/anna.jpg and smiling/anna.jpg, or \
anna_neutral.jpg and anna_smiling.jpg, or names as in KDEF, RaFD, CFD and NimStim. The column `frames` lists both: `neutral/anna.jpg;smiling/anna.jpg`. \
`init` lists people who lack one of the two, and pictures that it cannot pair, with what to do.")]
pub struct Args {
    /// Folder with the sequences
    folder: PathBuf,
    /// Table of people, a CSV file with a column `subject` (or `participant`, `id`, `name`) and columns to group by
    #[arg(long, value_name = "CSV")]
    people: Option<PathBuf>,
    /// Overwrite an existing manifest
    ///
    /// Keeps what the old manifest records about frames that still exist: names, emotions and all columns. Adds rows for all other frames.
    #[arg(long)]
    force: bool,
    /// Print no summary
    #[arg(short, long)]
    quiet: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let path = manifest_path(&args.folder);
    check_apart(&[("the manifest", &path)], &maybe("--people", args.people.as_ref()).collect::<Vec<_>>())?;
    check_free(&path, args.force)?;
    let folder = args.folder.display();
    anyhow::ensure!(!args.folder.is_file(), "{folder}: this is a file; give the folder with the sequences");
    anyhow::ensure!(args.folder.is_dir(), "{folder}: there is no such folder; give the folder with the sequences");
    let mut manifest = propose_manifest(&args.folder).map_err(|error| match error {
        DatasetError::NothingFound { root } => {
            anyhow::anyhow!(
                "{}: found no sequences: no video, and no folder with two or more pictures; for landmarks without pictures, write a \
                 manifest.csv with the columns subject,sequence,emotion,landmarks",
                root.display()
            )
        }
        other => other.into(),
    })?;
    let unreadable = |error: DatasetError| {
        anyhow::anyhow!("{error}; it is not overwritten, because its content would be lost: repair it, or move it away")
    };
    let is_there = path.is_file();
    let other_emotions = if is_there { manifest.keep_names(&path).map_err(unreadable)? } else { Vec::new() };
    let frames_or_people = (!manifest.frames_or_people.is_empty()).then(|| {
        format!(
            "the files of {} have the same names, numbered from 1; they are taken for the frames of one sequence for each folder. If they show \
             several people, rename them (001.jpg to P001.jpg) and run `init` again",
            manifest.frames_or_people.join(" and ")
        )
    });
    if let Some(people) = &args.people {
        let joined = manifest.join_people(people);
        joined.map_err(|error| match &frames_or_people {
            Some(note) => anyhow::anyhow!("{error}; {note}"),
            None => error.into(),
        })?;
    }
    let kept = if is_there { manifest.keep(&path).map_err(unreadable)? } else { Kept::default() };
    // What is left out was typed by somebody, and its folder may only be away for now.
    let before = if kept.gone.is_empty() { None } else { Some(keep_edited(&path)?) };
    manifest.write(&path)?;
    if !args.quiet {
        say_kept(&kept, &other_emotions, before.as_deref());
        let open = manifest.rows.iter().filter(|row| row.emotion == UNKNOWN_EMOTION).count();
        println!("{}: {}", single_line(&path.display().to_string()), count(manifest.rows.len(), "sequence", "sequences"));
        if !manifest.skipped.is_empty() {
            println!("note: skipped: {}", shortened(&manifest.skipped));
        }
        if !manifest.left_out.is_empty() {
            println!("note: skipped, fewer than two pictures: {}", shortened(&manifest.left_out));
        }
        let pairs = manifest.rows.iter().filter(|row| row.frames.contains(';')).count();
        if pairs > 0 {
            println!(
                "note: {} of a neutral picture and one of an expression",
                count(pairs, "sequence consists", "sequences consist")
            );
        }
        let with_landmarks = manifest.rows.iter().filter(|row| !row.landmarks.is_empty()).count();
        if with_landmarks > 0 {
            println!(
                "note: landmarks of {} are in the column landmarks; `run` marks the neutral frames by them",
                count(with_landmarks, "sequence", "sequences")
            );
        }
        if let Some(note) = &frames_or_people {
            println!("note: {note}");
        }
        if !manifest.lacking.is_empty() {
            println!("note: in no pair: {}", shortened(&manifest.lacking));
        }
        for pictures in &manifest.pictures_of_people {
            println!("note: skipped: {pictures}; then run `init` again");
        }
        if let Some(folder) = &manifest.holds_all {
            println!("note: folder `{folder}` holds everything and is not used as a subject");
        }
        if !manifest.unread.is_empty() {
            let formats = [IMAGE_EXTENSIONS.as_slice(), VIDEO_EXTENSIONS.as_slice()].map(|list| list.join(" "));
            println!(
                "note: skipped, unknown format; convert to MP4 or PNG (known formats: {}): {}",
                formats.join(" "),
                shortened(&manifest.unread)
            );
        }
        if !manifest.results.is_empty() {
            println!("note: skipped, written by grimace: {}", shortened(&manifest.results));
        }
        if open > 0 {
            println!(
                "note: the emotion of {} is unknown; replace the `?` in the column emotion",
                count(open, "sequence", "sequences")
            );
        }
        if let (Some(people), false) = (&args.people, manifest.not_joined.is_empty()) {
            println!("note: columns not taken from {}: {}", people.display(), listed(&manifest.not_joined, usize::MAX));
        }
        if !manifest.unknown_people.is_empty() {
            let consent = if manifest.person_columns.iter().any(|column| is_publish_column(column)) {
                "; their column `publish` is set to `no`"
            } else {
                ""
            };
            println!("note: not in the table of people: {}{consent}", shortened(&manifest.unknown_people));
        }
        if !manifest.people_without_rows.is_empty() {
            println!("note: in the table of people, but without a sequence: {}", shortened(&manifest.people_without_rows));
        }
        let folder = quoted(&args.folder.display().to_string());
        // A model has five frames, so the frames between two pictures are interpolated.
        let resample = if pairs > 0 { " --resample linear" } else { "" };
        println!(
            "next: check the dataset in seconds with grimace check {folder}{resample}, then grimace run {folder} -o results{resample}"
        );
    }
    Ok(Outcome::Done)
}

/// Prints what was kept from the existing manifest and what was not. `before`: copy of the old manifest.
fn say_kept(kept: &Kept, other_emotions: &[String], before: Option<&Path>) {
    if !kept.columns.is_empty() {
        println!("note: kept from the old manifest: {}", shortened(&kept.columns));
    }
    if !other_emotions.is_empty() {
        println!("note: emotions kept from the old manifest, although the names say others: {}", shortened(other_emotions));
    }
    if !kept.added.is_empty() {
        println!(
            "note: not in the old manifest, added: {}; if you had deleted such a row, delete it again",
            shortened(&kept.added)
        );
    }
    if !kept.gone.is_empty() {
        let before = before.map(|path| format!("; the old manifest is kept as {}", path.display())).unwrap_or_default();
        println!("note: in the old manifest, but not found now, and left out: {}{before}", shortened(&kept.gone));
    }
}

/// The first names of a list, and the number of the others.
fn shortened(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let more = names.len().saturating_sub(SHOWN);
    let shown = names.iter().take(SHOWN).map(|name| single_line(name)).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}
