//! `grimace init`.

use std::path::PathBuf;

use grimace::{
    dataset::{
        DatasetError, IMAGE_EXTENSIONS, Kept, UNKNOWN_EMOTION, VIDEO_EXTENSIONS, is_publish_column, manifest_path,
        propose_manifest,
    },
    output::{count, listed},
    text::single_line,
};

use super::{
    Outcome,
    apart::{check_apart, maybe},
    shared::{check_free, quoted},
};

/// Write a manifest for folders of images and videos.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace init recordings --people people.csv

Every folder of two images or more and every video, at any depth, becomes a row of recordings/manifest.csv: the first folder that is no \
emotion is the subject (but for one such as `videos` that holds everything), the others are the sequence, and the emotion is what a folder or file name says (happy, S001_anger.mp4), else \
`?`, to be filled in. Results, overlays and other pictures that grimace wrote are left out. A folder in the layout of Cohn-Kanade gets its labels and landmarks. people.csv has a column `subject`; its other \
columns, such as gender, go to every sequence of that subject, to group by with --by.

Emotions may be named in German, too (Freude, Trauer, Wut).

Single pictures of several people become sequences of two pictures, the neutral one first: neutral/anna.jpg and smiling/anna.jpg, or anna_neutral.jpg and \
anna_smiling.jpg, or names as in KDEF, RaFD and CFD. The column `frames` lists both: `neutral/anna.jpg;smiling/anna.jpg`. People who lack one of the two are \
named. Pictures that cannot be paired in this way are in no row: they are named, with how they become a sequence.")]
pub struct Args {
    /// Folder with the sequences
    folder: PathBuf,
    /// Table of people, a CSV file with a column `subject`
    #[arg(long, value_name = "CSV")]
    people: Option<PathBuf>,
    /// Write over a manifest that is there; what it says of frames that are still there and a proposal does not is kept
    #[arg(long)]
    force: bool,
    /// No summary
    #[arg(short, long)]
    quiet: bool,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let path = manifest_path(&args.folder);
    check_apart(&[("the manifest", &path)], &maybe("--people", args.people.as_ref()).collect::<Vec<_>>())?;
    check_free(&path, args.force)?;
    let folder = args.folder.display();
    anyhow::ensure!(!args.folder.is_file(), "{folder}: this is a file; give the folder that holds the sequences");
    anyhow::ensure!(args.folder.is_dir(), "{folder}: there is no such folder; give the one that holds the sequences");
    let mut manifest = propose_manifest(&args.folder).map_err(|error| match error {
        DatasetError::NothingFound { root } => anyhow::anyhow!(
            "{}: nothing found that could be a sequence: no video, and no folder with two pictures or more",
            root.display()
        ),
        other => other.into(),
    })?;
    if let Some(people) = &args.people {
        manifest.join_people(people)?;
    }
    let kept = if path.is_file() {
        manifest.keep(&path).map_err(|error| anyhow::anyhow!("{error}; what it says would be lost: mend it, or move it away"))?
    } else {
        Kept::default()
    };
    manifest.write(&path)?;
    if !args.quiet {
        say_kept(&kept);
        let open = manifest.rows.iter().filter(|row| row.emotion == UNKNOWN_EMOTION).count();
        println!("{}: {}", single_line(&path.display().to_string()), count(manifest.rows.len(), "sequence", "sequences"));
        if !manifest.skipped.is_empty() {
            println!("note: not taken: {}", shortened(&manifest.skipped));
        }
        if !manifest.left_out.is_empty() {
            println!("note: left out, with fewer than two pictures: {}", shortened(&manifest.left_out));
        }
        let pairs = manifest.rows.iter().filter(|row| row.frames.contains(';')).count();
        if pairs > 0 {
            println!(
                "note: {} of a neutral picture and one of an expression",
                count(pairs, "sequence consists", "sequences consist")
            );
        }
        if !manifest.lacking.is_empty() {
            println!("note: in no pair: {}", shortened(&manifest.lacking));
        }
        for pictures in &manifest.pictures_of_people {
            println!("note: not taken: {pictures}; then run `init` again");
        }
        if let Some(folder) = &manifest.holds_all {
            println!("note: `{folder}` holds everything: it is taken for no person");
        }
        if !manifest.unread.is_empty() {
            let formats = [IMAGE_EXTENSIONS.as_slice(), VIDEO_EXTENSIONS.as_slice()].map(|list| list.join(" "));
            println!(
                "note: not read, convert to MP4 or PNG (formats that are read: {}): {}",
                formats.join(" "),
                shortened(&manifest.unread)
            );
        }
        if !manifest.results.is_empty() {
            println!("note: left out, written by grimace itself: {}", shortened(&manifest.results));
        }
        if open > 0 {
            println!("note: the emotion of {} is not known; fill in what stands as `?`", count(open, "sequence", "sequences"));
        }
        if let (Some(people), false) = (&args.people, manifest.not_joined.is_empty()) {
            println!("note: not taken from {}: {}", people.display(), listed(&manifest.not_joined, usize::MAX));
        }
        if !manifest.unknown_people.is_empty() {
            let consent = if manifest.person_columns.iter().any(|column| is_publish_column(column)) {
                "; their `publish` is `no`"
            } else {
                ""
            };
            println!("note: not in the table of people: {}{consent}", shortened(&manifest.unknown_people));
        }
        if !manifest.people_without_rows.is_empty() {
            println!("note: in the table of people, without a sequence: {}", shortened(&manifest.people_without_rows));
        }
        let folder = quoted(&args.folder.display().to_string());
        // A model of five frames from two pictures.
        let resample = if pairs > 0 { " --resample linear" } else { "" };
        println!(
            "next: grimace check {folder}{resample}, which says in seconds what `run` would meet, then grimace run {folder} -o results{resample}"
        );
    }
    Ok(Outcome::Done)
}

/// What was taken over from the manifest that was there, and what was not.
fn say_kept(kept: &Kept) {
    if !kept.columns.is_empty() {
        println!("note: kept from the manifest that was there: {}", shortened(&kept.columns));
    }
    if !kept.other_emotions.is_empty() {
        println!("note: the manifest that was there had other emotions: {}", shortened(&kept.other_emotions));
    }
    if !kept.gone.is_empty() {
        println!("note: in the manifest that was there, and not found: {}", shortened(&kept.gone));
    }
}

/// The first names of a list, and how many more there are.
fn shortened(names: &[String]) -> String {
    const SHOWN: usize = 12;
    let more = names.len().saturating_sub(SHOWN);
    let shown = names.iter().take(SHOWN).map(|name| single_line(name)).collect::<Vec<_>>().join(", ");
    if more > 0 { format!("{shown} and {more} more") } else { shown }
}
