//! `grimace annotate`.

use std::{
    net::IpAddr,
    path::PathBuf,
    process::{Command, Stdio},
};

use grimace::{
    annotate::{AnnotateOptions, Annotator, ENOUGH_MARKS},
    dataset::is_picture,
    output::count,
    pipeline::{PipelineOptions, Workbench},
    sequence::read_frame,
};

use super::{
    Outcome,
    progress::counted_bar,
    shared::{FitArgs, positive, stop_flag},
};

/// Mark facial points, or correct tracks, on a local web page.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Example:
  grimace annotate faces                      mark the sequences that have fewer than 5 marks
  grimace annotate faces --accept 2.5         save the marks of well-found faces, show the others
  grimace annotate faces --accept 2.5 --no-page       the same in a script, without the page
  grimace annotate anna.jpg                   mark one picture; its marks are saved as anna.csv
  grimace run faces -o results
  grimace annotate faces --tracks results     step through the tracks, correct nodes, track again

The page is available on this machine only. It proposes marks for the face in every neutral frame, each with its expected error; press A \
to accept a face and ? to see all keys. Every mark is saved at once in the dataset's correspondence files, which `fit` and `run` read. \
Ctrl-C in the terminal ends the server; no mark is lost.

Exit status with --no-page: 0 all sequences are marked, 3 some are left to mark.")]
pub struct Args {
    /// Dataset folder, manifest file, or one picture
    ///
    /// With --tracks it may be omitted if the dataset lies beside OUT.
    #[arg(required_unless_present = "tracks")]
    dataset: Option<PathBuf>,
    /// Output folder of a run, or a folder of tracks, to review and correct
    #[arg(long, value_name = "OUT")]
    tracks: Option<PathBuf>,
    /// Show all sequences, including those with 5 or more marks
    #[arg(long, conflicts_with = "tracks")]
    all: bool,
    /// Save the found marks of faces whose median expected error is below LIMIT, in percent of the eye distance
    ///
    /// This applies to sequences without hand-set marks. The page shows the other sequences.
    #[arg(long, value_name = "LIMIT", conflicts_with = "tracks", value_parser = positive)]
    accept: Option<f64>,
    /// With --accept: start no page, list the sequences that are left, and exit with status 3 if there are any
    #[arg(long, requires = "accept", conflicts_with_all = ["tracks", "port", "host"])]
    no_page: bool,
    /// Port of the page; by default 7113, or a free port if 7113 is in use
    #[arg(long, value_name = "N")]
    port: Option<u16>,
    /// Do not open the page in a browser
    #[arg(long)]
    no_open: bool,
    /// Address to listen on; an address other than loopback lets other machines connect and prints a warning
    #[arg(long, default_value = "127.0.0.1", value_name = "ADDRESS")]
    host: IpAddr,
    /// Folder of OpenCV's Haar cascades, if they are not in the usual place
    #[arg(long, value_name = "DIR")]
    cascades: Option<PathBuf>,
    /// Wireframe (.wfm) to use instead of Candide-3; it must have Candide-3's node numbers
    #[arg(long, value_name = "FILE")]
    wireframe: Option<PathBuf>,
    #[command(flatten)]
    fit: FitArgs,
}

/// Runs the command.
pub fn run(args: &Args) -> anyhow::Result<Outcome> {
    let options = PipelineOptions { fit: args.fit.options(), ..PipelineOptions::default() };
    let bench = Workbench::new(args.wireframe.as_deref(), options)?;
    let options = AnnotateOptions {
        dataset: args.dataset.clone(),
        tracks: args.tracks.clone(),
        all: args.all,
        host: args.host,
        // Without a page the port is not printed, so any port is fine.
        port: if args.no_page { Some(0) } else { args.port },
        cascades: args.cascades.clone(),
    };
    if let Some(folder) = args.cascades.as_ref().filter(|folder| !folder.is_dir()) {
        anyhow::bail!("{}: there is no such folder; --cascades needs the folder of OpenCV's Haar cascades", folder.display());
    }
    // A picture that cannot be read would give an empty page.
    if let Some(picture) = args.dataset.as_ref().filter(|path| path.is_file() && is_picture(path)) {
        read_frame(picture)?;
    }
    let annotator = Annotator::bind(&options, bench)?;
    for failure in annotator.failures() {
        eprintln!("note: {failure}");
    }
    if !args.host.is_loopback() {
        eprintln!(
            "warning: the page is served on {}: anyone who can reach this address and knows the link below can see the faces and change \
             the marks; the connection is not encrypted",
            args.host
        );
    }
    if let Some(limit) = args.accept {
        accept(&annotator, limit)?;
    }
    let (sequences, left) = annotator.sequences();
    if args.tracks.is_some() {
        println!(
            "{}: the first of those to look at opens; the list has most lost nodes first",
            count(sequences, "track", "tracks")
        );
    } else if sequences == 0 {
        println!(
            "nothing is left to mark: {} with {ENOUGH_MARKS} marks or more; --all shows all sequences",
            count(annotator.total(), "sequence", "sequences")
        );
    } else {
        println!("{left} of {} left to mark", count(sequences, "sequence", "sequences"));
    }
    if args.no_page {
        return Ok(if left == 0 && annotator.failures().is_empty() { Outcome::Done } else { Outcome::SomeFailed });
    }
    let stop = stop_flag()?;
    let url = annotator.url();
    println!("open {url}");
    println!("Ctrl-C ends the server; every mark is saved at once");
    if !args.no_open {
        open_browser(&url);
    }
    annotator.serve(&stop)?;
    Ok(Outcome::Done)
}

/// Saves reliable found marks and prints what is left to mark.
fn accept(annotator: &Annotator, limit: f64) -> anyhow::Result<()> {
    let bar = counted_bar(false, None, "sequences");
    let accepted = annotator.accept(limit, |done, total| {
        bar.set_length(total as u64);
        bar.set_position(done as u64);
    });
    bar.finish_and_clear();
    println!("accepted the found marks of {}", count(accepted.accepted.len(), "sequence", "sequences"));
    for (id, reason) in &accepted.left {
        println!("  not accepted: {id}: {reason}");
    }
    Ok(())
}

/// Opens an address in the user's browser, if there is one. The address is printed in any case.
fn open_browser(url: &str) {
    let opener = if cfg!(target_os = "macos") {
        "open"
    } else if cfg!(windows) {
        "explorer"
    } else {
        let has_screen = ["DISPLAY", "WAYLAND_DISPLAY"].iter().any(|name| std::env::var_os(name).is_some_and(|v| !v.is_empty()));
        if !has_screen {
            return;
        }
        "xdg-open"
    };
    // The address is a separate argument: no shell interprets it.
    let started = Command::new(opener).arg(url).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn();
    if let Ok(mut child) = started {
        std::thread::spawn(move || child.wait());
    }
}
