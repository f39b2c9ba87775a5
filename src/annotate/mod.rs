//! Marks points on a local web page: the server of `grimace annotate`.
//!
//! The page shows the neutral frame of a sequence, accepts marks (correspondences), shows the fitted wireframe while a mark is dragged, and
//! saves every change immediately into the dataset's own correspondence files. With the tracks of a run it shows tracked frames, accepts
//! corrections, and tracks again from a corrected frame.
//!
//! [`Annotator::bind`] opens the port, [`Annotator::serve`] answers requests until it is stopped. Requests are defined in `routes`, access
//! control in `security`, limits of connections in `serve`, marks and frames of a dataset in `desk`, tracks in `retrack`. Files are written
//! by [`crate::fit`] and [`crate::track`], and the manifest by `manifest_edit`.

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

/// Number of marks from which a sequence counts as marked: the lower end of KP's working range, 5 to 8.
pub const ENOUGH_MARKS: usize = 5;

/// Port that is tried first, so that the address remains the same: 7 followed by Candide-3's number of nodes.
pub const USUAL_PORT: u16 = 7113;

/// Interval at which the server checks whether to stop.
const STOP_INTERVAL: Duration = Duration::from_millis(100);

/// Options of [`Annotator`].
#[derive(Clone, Debug)]
pub struct AnnotateOptions {
    /// The dataset: a folder with `manifest.csv`, a manifest, a folder in the layout of Cohn-Kanade, or one picture, whose marks are saved
    /// beside it in a `.csv` of the same name. With tracks it contains their frames, and may be omitted if it lies beside them under the
    /// name in `run.json`.
    pub dataset: Option<PathBuf>,
    /// Output folder of a run, or a folder of tracks, to correct instead of marking.
    pub tracks: Option<PathBuf>,
    /// Whether to show all sequences instead of those with fewer than [`ENOUGH_MARKS`] marks.
    pub all: bool,
    /// Address to listen on.
    pub host: IpAddr,
    /// Port; `None` for [`USUAL_PORT`], or any free port if that is taken.
    pub port: Option<u16>,
    /// Folder of OpenCV's Haar cascades; `None` for the first of [`CASCADE_FOLDERS`] that exists.
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
    /// The dataset cannot be opened.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// Neither a dataset nor tracks are given.
    #[error("nothing to annotate; give a dataset, or the output folder of a run with --tracks")]
    Nothing,
    /// No sequence of the dataset can be annotated.
    #[error("{}: no sequence can be annotated{}", path.display(), first_problem(reason))]
    NoSequence {
        /// The dataset.
        path: PathBuf,
        /// Its first failure; empty if there is none.
        reason: String,
    },
    /// The folder has no tracks.
    #[error("{}: no tracks found; give the output folder of `grimace run`, or a folder of tracks", path.display())]
    NoTracks {
        /// The folder.
        path: PathBuf,
    },
    /// No record beside the tracks names their dataset.
    #[error("{}: there is no run.json that names the dataset; give it: grimace annotate DATASET --tracks {}", path.display(), path.display())]
    NoRun {
        /// The output folder.
        path: PathBuf,
    },
    /// The record of the run cannot be read.
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
        /// Name of the dataset in the run's record.
        name: String,
    },
    /// A folder of tracks that cannot be read.
    #[error(transparent)]
    Tracks(io::Error),
    /// The port is not available.
    #[error("cannot listen on {address}: {source}; {}", listen_advice(source))]
    Listen {
        /// Address and port.
        address: SocketAddr,
        /// Why.
        source: io::Error,
    },
    /// The system gives no random numbers for the token.
    #[error("cannot create a random token: {0}")]
    Token(getrandom::Error),
    /// The server stopped.
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

/// Shared state of all requests.
struct App {
    guard: Guard,
    work: Work,
}

type Shared = Arc<App>;

/// Tasks of the page.
enum Work {
    /// Marking the neutral frames of a dataset.
    Marks(Box<desk::Desk>),
    /// Correcting tracks.
    Tracks(Box<retrack::TrackDesk>),
}

/// A server with an open port, ready to start.
pub struct Annotator {
    listener: TcpListener,
    app: Shared,
}

impl Annotator {
    /// Opens the dataset or tracks, and the port. After it, the address is known and connections wait.
    ///
    /// # Errors
    /// [`AnnotateError`] for everything except the running server.
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

    /// Number of sequences on the page, and of those left to mark (for tracks: all).
    pub fn sequences(&self) -> (usize, usize) {
        match &self.app.work {
            Work::Marks(desk) => desk.counts(),
            Work::Tracks(tracks) => (tracks.count(), tracks.count()),
        }
    }

    /// Number of sequences in the dataset, including those not on the page.
    pub fn total(&self) -> usize {
        match &self.app.work {
            Work::Marks(desk) => desk.total(),
            Work::Tracks(tracks) => tracks.count(),
        }
    }

    /// Rows of the dataset that are not valid sequences and not on the page, each with its reason.
    pub fn failures(&self) -> &[String] {
        match &self.app.work {
            Work::Marks(desk) => desk.failures(),
            Work::Tracks(tracks) => tracks.failures(),
        }
    }

    /// Saves the marks found in sequences without marks, if their median expected error is below `limit` percent of the eye distance.
    /// Hand-set marks always have precedence. `progress` is called from any thread with the number of processed and of all sequences. It
    /// does nothing for tracks.
    pub fn accept(&self, limit: f64, progress: impl Fn(usize, usize) + Sync) -> Accepted {
        match &self.app.work {
            Work::Marks(desk) => desk.accept(limit, progress),
            Work::Tracks(_) => Accepted::default(),
        }
    }

    /// Answers requests until `stop` is set.
    ///
    /// # Errors
    /// [`AnnotateError::Server`] when the system closes the port or provides no threads.
    pub fn serve(self, stop: &AtomicBool) -> Result<(), AnnotateError> {
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().map_err(AnnotateError::Server)?;
        let limits = serve::Limits::default();
        let router = routes::router(self.app, limits);
        runtime.block_on(async {
            self.listener.set_nonblocking(true).map_err(AnnotateError::Server)?;
            let listener = tokio::net::TcpListener::from_std(self.listener).map_err(AnnotateError::Server)?;
            let serving = serve::serve(listener, router, limits);
            // Every change is already saved, so connections may be closed at any time.
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
