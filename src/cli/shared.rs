//! Flags that several commands share.

use std::path::{Path, PathBuf};

use anyhow::Context;
use grimace::{
    clone::SourceMotion,
    dataset::{LandmarkSelection, read_marks},
    input::is_stdin,
    output::target_of,
    pipeline::{
        FoundMarks, PipelineOptions, ReportFace, Workbench, file_blake3, found_marks_and_remark, showcase_remarks, track_files,
    },
    sequence::{DEFAULT_MAX_PIXELS, Frame, set_max_pixels},
};

pub use super::{
    numbers::{alpha, count, emphasis, frame_rate, gain, memory, not_negative, positive, share, thread_count},
    options::{
        AnalysisArgs, CheckArgs, ColumnArgs, FitArgs, MarksArgs, MethodArgs, ModelArgs, ProfileArgs, ResampleArgs, TrackArgs,
        WhichMarksArgs, words,
    },
};

/// The verb of one thing or several.
pub fn are(things: usize) -> &'static str {
    if things == 1 { "is" } else { "are" }
}

/// What is read as a picture, for every command.
#[derive(Debug, clap::Args)]
pub struct PictureArgs {
    /// Largest picture or video frame to read, as a number of pixels such as 200000000; larger ones are refused
    #[arg(
        long, global = true, default_value_t = DEFAULT_MAX_PIXELS, value_parser = pixels,
        value_name = "PIXELS", help_heading = "General"
    )]
    max_pixels: u64,
}

/// Side of a picture in px below which no face is visible.
const LEAST_SIDE: u64 = 32;

fn pixels(text: &str) -> Result<u64, String> {
    let least = LEAST_SIDE * LEAST_SIDE;
    let pixels = text.parse().ok().filter(|pixels| *pixels >= least);
    pixels.ok_or_else(|| {
        format!("expected a whole number of at least {least} ({LEAST_SIDE}x{LEAST_SIDE}): smaller pictures cannot show a face")
    })
}

impl PictureArgs {
    /// Sets the limit for this process.
    pub fn apply(&self) {
        set_max_pixels(self.max_pixels);
    }
}

/// The machine and the wireframe.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "General")]
pub struct GeneralArgs {
    /// Wireframe (.wfm) to use instead of Candide-3; it must have Candide-3's node numbers
    #[arg(long, value_name = "FILE")]
    wireframe: Option<PathBuf>,
    /// Overwrite existing results
    #[arg(long)]
    pub force: bool,
    /// Print no progress bar and no summary
    #[arg(short, long)]
    pub quiet: bool,
}

impl GeneralArgs {
    pub fn workbench(&self, options: PipelineOptions) -> anyhow::Result<Workbench> {
        let bench = Workbench::new(self.wireframe.as_deref(), options)?;
        // An unsuitable face is reported before hours of tracking, not after.
        if let ReportFace::Photograph { image, .. } = &bench.options.report_face {
            for said in showcase_remarks(&bench).with_context(|| format!("--portrait {}", image.display()))? {
                eprintln!("note: --portrait {}: {said}", image.display());
            }
        }
        Ok(bench)
    }

    /// BLAKE3 of the wireframe file, if one is given.
    pub fn wireframe_blake3(&self) -> Option<String> {
        file_blake3(self.wireframe.as_deref()?)
    }

    /// Refuses to overwrite a file unless `--force` is given.
    pub fn check_free(&self, path: &std::path::Path) -> anyhow::Result<()> {
        // Checked before hours of work, not after.
        target_of(path)?;
        check_free(path, self.force)
    }
}

/// Refuses to overwrite a file unless forced.
pub fn check_free(path: &std::path::Path, force: bool) -> anyhow::Result<()> {
    anyhow::ensure!(!is_stdin(path), "-: this command cannot write to standard output; for a file of that name give ./-");
    anyhow::ensure!(force || !path.exists(), "{} exists; give --force to overwrite it", path.display());
    Ok(())
}

/// The tracks in files and folders. If there are none, the error says how to make them.
pub fn some_track_files(paths: &[PathBuf]) -> anyhow::Result<Vec<PathBuf>> {
    let files = track_files(paths)?;
    anyhow::ensure!(
        !files.is_empty(),
        "found no tracks (.csv) in {}; make them with `grimace track` for one sequence or `grimace run` for a dataset",
        paths.first().map(|path| path.display().to_string()).unwrap_or_default()
    );
    Ok(files)
}

/// The marks of a file or, without a file, marks found in the frame of `picture` (in colour if it is given), with notes printed.
pub fn marks_or_found(
    path: Option<&Path>,
    bench: &Workbench,
    picture: &Path,
    frame: impl FnOnce() -> anyhow::Result<(Frame, Option<image::RgbImage>)>,
) -> anyhow::Result<FoundMarks> {
    match path {
        Some(path) => {
            let marks = read_marks(path, &LandmarkSelection::HighAndMedium, &bench.tables, bench.wireframe.node_count())?;
            Ok(FoundMarks { marks, ..FoundMarks::default() })
        }
        None => {
            let (frame, colour) = frame()?;
            marks_found(bench, picture, &frame, colour.as_ref())
        }
    }
}

/// Marks found in a frame of `picture` (in colour if it is given), with notes printed.
pub fn marks_found(
    bench: &Workbench,
    picture: &Path,
    frame: &Frame,
    colour: Option<&image::RgbImage>,
) -> anyhow::Result<FoundMarks> {
    let found = found_marks_and_remark(frame, colour, bench).map_err(|error| about(picture)(&error))?;
    if let Some(said) = &found.remark {
        eprintln!("note: {}: {said}", picture.display());
    }
    Ok(found)
}

/// Notes that a motion does not move.
pub fn note_if_still(path: &Path, motion: &SourceMotion) {
    if motion.is_still() {
        eprintln!("note: {}: the motion contains no movement: it shows the neutral face", path.display());
    }
}

/// Quotes a word for a shell.
pub fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_alphanumeric() || "_-./:,+=@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', "'\\''")) }
}

/// Error about a file: its name, unless the text of the error has it, and the text.
pub fn about(path: &Path) -> impl Fn(&dyn std::fmt::Display) -> anyhow::Error {
    move |error| {
        let (path, error) = (path.display().to_string(), error.to_string());
        if error.contains(&path) { anyhow::anyhow!(error) } else { anyhow::anyhow!("{path}: {error}") }
    }
}

/// Uses `threads` threads for everything that runs in parallel; 0 for one per processor.
pub fn set_threads(threads: usize) -> anyhow::Result<()> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().context("cannot start the threads")
}

pub use super::signals::stop_flag;

/// What commands that learn a file to be passed on have in common.
#[derive(Debug, clap::Args)]
pub struct LearnedFileArgs {
    /// Credit and licence of the training data, written into the file
    #[arg(long, default_value = "", value_name = "TEXT")]
    pub credit: String,
    /// Overwrite an existing file
    #[arg(long)]
    pub force: bool,
    /// Print no summary
    #[arg(short, long)]
    pub quiet: bool,
}

impl LearnedFileArgs {
    /// Prints a summary, and a note if no credit is given for `whose`.
    pub fn summarize(&self, summary: impl FnOnce(), whose: &str) {
        if !self.quiet {
            summary();
            if self.credit.is_empty() {
                println!("note: no --credit given; record whose {whose} before you pass the file on");
            }
        }
    }
}

/// Name of a folder at the beginning of a sentence, where `.` would be hard to see.
pub fn named_folder(path: &Path) -> String {
    match path.to_str() {
        Some("." | "./") => "the current folder".to_owned(),
        _ if path.file_name().is_none() => format!("the folder {}", path.display()),
        _ => path.display().to_string(),
    }
}

/// Name of a file or folder without its parent folders: results contain no folders of this machine.
pub fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_without_a_name_are_called_something() {
        let named = [".", "./", "..", "out", "a/.."].map(|path| named_folder(Path::new(path)));
        assert_eq!(named, ["the current folder", "the current folder", "the folder ..", "out", "the folder a/.."]);
    }

    #[test]
    fn a_limit_below_every_picture_is_refused() {
        assert_eq!((pixels("1024"), pixels("200000000")), (Ok(1024), Ok(200_000_000)));
        let said = "expected a whole number of at least 1024 (32x32): smaller pictures cannot show a face";
        for wrong in ["1000", "0", "-1", "many"] {
            assert_eq!(pixels(wrong), Err(said.to_owned()), "{wrong}");
        }
    }
}
