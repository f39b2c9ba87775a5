//! Marking points on a local web page: the server behind `grimace annotate`.
//!
//! The page shows the neutral frame of a sequence, takes marks (correspondences), shows the fitted wireframe while a mark is dragged, and
//! saves every change at once into the dataset's own correspondence files. With the tracks of a run it steps through tracked frames,
//! takes corrections, and tracks again from a corrected frame.
//!
//! [`Annotator::bind`] opens the port, [`Annotator::serve`] answers until it is told to stop. What the page asks for is in `routes`, who
//! may ask in `security`, what a connection may cost in `serve`, marks and frames of a dataset in `desk`, tracks in `retrack`;
//! files are written by the writers of [`crate::fit`] and [`crate::track`] and, for the manifest, by `manifest_edit`.

mod desk;
mod found;
mod frames;
mod item;
mod live;
mod manifest_edit;
mod messages;
mod page;
mod proposals;
mod request;
mod retrack;
mod routes;
mod security;
mod serve;
mod untouched;

use std::{
    io,
    net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener},
    path::PathBuf,
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
    time::Duration,
};

use crate::{
    dataset::DatasetError,
    pipeline::{RunJsonError, Workbench},
};

pub use found::Accepted;
pub use proposals::{CascadeError, Cascades, ProposalSource, ProposedMarks};
use request::RequestError;
use security::Guard;

/// Marks from which on a sequence counts as marked: the lower end of KP's working range, 5 to 8.
pub const ENOUGH_MARKS: usize = 5;

/// Port that is tried first, so that the address stays the same from start to start: Candide-3's number of nodes behind a 7.
pub const USUAL_PORT: u16 = 7113;

/// How often the server looks whether it is to stop.
const STOP_INTERVAL: Duration = Duration::from_millis(100);

/// What to serve, and where.
#[derive(Clone, Debug)]
pub struct AnnotateOptions {
    /// The dataset: a folder with `manifest.csv`, a manifest, a folder in the layout of Cohn-Kanade, or one picture, whose marks are saved
    /// beside it as a `.csv` of its name. With tracks it is where their frames
    /// are, and may be left out where it is beside them under the name that `run.json` has.
    pub dataset: Option<PathBuf>,
    /// Output folder of a run, or a folder of tracks, to correct instead of marking.
    pub tracks: Option<PathBuf>,
    /// All sequences, and not only those with fewer than [`ENOUGH_MARKS`] marks.
    pub all: bool,
    /// Address to listen on.
    pub host: IpAddr,
    /// Port; `None` for [`USUAL_PORT`], or any other where that is taken.
    pub port: Option<u16>,
    /// Folder of OpenCV's Haar cascades; `None` for the first of [`CASCADE_FOLDERS`] that is there.
    pub cascades: Option<PathBuf>,
}

impl Default for AnnotateOptions {
    fn default() -> Self {
        Self { dataset: None, tracks: None, all: false, host: Ipv4Addr::LOCALHOST.into(), port: None, cascades: None }
    }
}

/// Why the page cannot be served.
#[derive(Debug, thiserror::Error)]
pub enum AnnotateError {
    /// The dataset does not open.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Neither a dataset nor tracks.
    #[error("nothing to annotate; give a dataset, or the output folder of a run with --tracks")]
    Nothing,
    /// A dataset without a sequence.
    #[error("{}: no sequence can be annotated{}", path.display(), first_problem(reason))]
    NoSequence {
        /// The dataset.
        path: PathBuf,
        /// The first of its failures; empty where there is none.
        reason: String,
    },
    /// No track in the folder.
    #[error("{}: no tracks found; give the output folder of `grimace run`, or a folder of tracks", path.display())]
    NoTracks {
        /// The folder.
        path: PathBuf,
    },
    /// No record beside tracks that says which dataset they are of.
    #[error("{}: there is no run.json that names the dataset; give it: grimace annotate DATASET --tracks {}", path.display(), path.display())]
    NoRun {
        /// The output folder.
        path: PathBuf,
    },
    /// The record of the run does not read.
    #[error(transparent)]
    Run(#[from] RunJsonError),
    /// The frames of a run cannot be found.
    #[error(
        "{}: the dataset of this run, `{name}`, is neither beside the run nor in the current folder; give it: grimace annotate DATASET \
         --tracks {}",
        path.display(), path.display()
    )]
    DatasetNotFound {
        /// The output folder.
        path: PathBuf,
        /// Name of the dataset, as the run noted it.
        name: String,
    },
    /// A folder of tracks that cannot be read.
    #[error(transparent)]
    Tracks(io::Error),
    /// The port cannot be had.
    #[error("cannot listen on {address}: {source}; {}", listen_advice(source))]
    Listen {
        /// Address and port.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The system has no randomness for the token.
    #[error("cannot create a random token: {0}")]
    Token(getrandom::Error),
    /// The server broke off.
    #[error("the server ended: {0}")]
    Server(io::Error),
}

fn listen_advice(source: &io::Error) -> &'static str {
    if source.kind() == io::ErrorKind::AddrNotAvailable {
        "this machine has no such address; choose another one with --host, or leave --host out to serve this machine only"
    } else {
        "choose another port with --port, or leave --port out to use any free port"
    }
}

fn first_problem(reason: &str) -> String {
    if reason.is_empty() { ": it has none".to_owned() } else { format!("; the first problem: {reason}") }
}

/// What every request works on.
struct App {
    guard: Guard,
    work: Work,
}

type Shared = Arc<App>;

/// The two jobs of the page.
enum Work {
    /// Marking the neutral frames of a dataset.
    Marks(Box<desk::Desk>),
    /// Correcting tracks.
    Tracks(Box<retrack::TrackDesk>),
}

/// A server that has its port and waits to be started.
pub struct Annotator {
    listener: TcpListener,
    app: Shared,
}

impl Annotator {
    /// Opens dataset or tracks and the port. From here on the address is known and connections wait.
    ///
    /// # Errors
    /// [`AnnotateError`] for anything but the running server.
    pub fn bind(options: &AnnotateOptions, bench: Workbench) -> Result<Self, AnnotateError> {
        let work = match (&options.tracks, &options.dataset) {
            (Some(out), dataset) => Work::Tracks(Box::new(retrack::TrackDesk::open(out, dataset.as_deref(), bench)?)),
            (None, Some(dataset)) => Work::Marks(Box::new(desk::Desk::open(dataset, options, bench)?)),
            (None, None) => return Err(AnnotateError::Nothing),
        };
        let listener = listen(options)?;
        let address = listener.local_addr().map_err(AnnotateError::Server)?;
        let guard = Guard::new(address).map_err(AnnotateError::Token)?;
        Ok(Self { listener, app: Arc::new(App { guard, work }) })
    }

    /// The address to open in a browser, with its token.
    pub fn url(&self) -> String {
        self.app.guard.url()
    }

    /// Sequences on the page, and how many of them are left to mark (for tracks: all of them).
    pub fn sequences(&self) -> (usize, usize) {
        match &self.app.work {
            Work::Marks(desk) => desk.counts(),
            Work::Tracks(tracks) => (tracks.count(), tracks.count()),
        }
    }

    /// Sequences of the dataset, those that are not on the page, too.
    pub fn total(&self) -> usize {
        match &self.app.work {
            Work::Marks(desk) => desk.total(),
            Work::Tracks(tracks) => tracks.count(),
        }
    }

    /// Rows of the dataset that are no sequences and not on the page, each with its reason.
    pub fn failures(&self) -> &[String] {
        match &self.app.work {
            Work::Marks(desk) => desk.failures(),
            Work::Tracks(tracks) => tracks.failures(),
        }
    }

    /// Saves found marks of sequences that have none, where half of them are expected to be less than `limit` percent of the eye distance
    /// off; a mark set by hand always wins. `progress` is told how many of how many sequences have been looked at, from any thread.
    /// Nothing to do for tracks.
    pub fn accept(&self, limit: f64, progress: impl Fn(usize, usize) + Sync) -> Accepted {
        match &self.app.work {
            Work::Marks(desk) => desk.accept(limit, progress),
            Work::Tracks(_) => Accepted::default(),
        }
    }

    /// Answers requests until `stop` is set.
    ///
    /// # Errors
    /// [`AnnotateError::Server`] when the system takes the port away or gives no threads.
    pub fn serve(self, stop: &AtomicBool) -> Result<(), AnnotateError> {
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().map_err(AnnotateError::Server)?;
        let limits = serve::Limits::default();
        let router = routes::router(self.app, limits);
        runtime.block_on(async {
            self.listener.set_nonblocking(true).map_err(AnnotateError::Server)?;
            let listener = tokio::net::TcpListener::from_std(self.listener).map_err(AnnotateError::Server)?;
            let serving = serve::serve(listener, router, limits);
            // Every change was saved when it was made: connections may be cut.
            tokio::select! {
                ended = serving => ended.map_err(AnnotateError::Server),
                () = stopped(stop) => Ok(()),
            }
        })
    }
}

async fn stopped(stop: &AtomicBool) {
    while !stop.load(Ordering::Relaxed) {
        tokio::time::sleep(STOP_INTERVAL).await;
    }
}

fn listen(options: &AnnotateOptions) -> Result<TcpListener, AnnotateError> {
    let usual = SocketAddr::new(options.host, options.port.unwrap_or(USUAL_PORT));
    TcpListener::bind(usual).or_else(|source| match options.port {
        None => {
            let any = SocketAddr::new(options.host, 0);
            TcpListener::bind(any).map_err(|source| AnnotateError::Listen { address: any, source })
        }
        Some(_) => Err(AnnotateError::Listen { address: usual, source }),
    })
}
