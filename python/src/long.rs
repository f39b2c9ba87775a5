//! Calls that take long: in a thread of their own, the interpreter's lock released, so that other Python threads go on, Ctrl-C is heard
//! and progress is told.

use std::{
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicBool, Ordering},
        mpsc::{Receiver, RecvTimeoutError, Sender, channel},
    },
    thread,
    time::Duration,
};

use pyo3::{exceptions::PyRuntimeError, prelude::*};

/// How often Ctrl-C is looked for.
const INTERVAL: Duration = Duration::from_millis(50);

/// What a worker tells.
enum Told<T> {
    Progress(usize, Option<usize>),
    Done(PyResult<T>),
}

/// A worker's connection to the caller.
pub struct Caller<T> {
    stop: Arc<AtomicBool>,
    tell: Mutex<Sender<Told<T>>>,
}

impl<T> Caller<T> {
    /// The flag that is set when the caller was interrupted.
    pub fn stop(&self) -> &AtomicBool {
        &self.stop
    }

    /// Whether to go on.
    pub fn goes_on(&self) -> bool {
        !self.stop.load(Ordering::Relaxed)
    }

    /// Tells how much of how much is done.
    pub fn progress(&self, done: usize, total: Option<usize>) {
        self.send(Told::Progress(done, total));
    }

    fn send(&self, told: Told<T>) {
        // An interrupted caller no longer receives messages.
        let _ = self.tell.lock().unwrap_or_else(PoisonError::into_inner).send(told);
    }
}

/// Runs `work` and gives what it gives. Python's signal handlers run meanwhile; what they raise, or what `progress(done, total)` raises,
/// sets the stop flag and is raised as soon as the worker has seen it. A worker that does not look at the flag (`stops` is false) is left
/// to itself: what it gives is thrown away.
pub fn run_long<T: Send + 'static>(
    py: Python<'_>,
    progress: Option<&Bound<'_, PyAny>>,
    stops: bool,
    work: impl FnOnce(&Caller<T>) -> PyResult<T> + Send + 'static,
) -> PyResult<T> {
    let (tell, told) = channel();
    let told = Mutex::new(told);
    let stop = Arc::new(AtomicBool::new(false));
    let caller = Caller { stop: Arc::clone(&stop), tell: Mutex::new(tell) };
    let worker = thread::spawn(move || {
        let done = catch_unwind(AssertUnwindSafe(|| work(&caller)));
        let panicked = |_| Err(PyRuntimeError::new_err("grimace has a fault: its worker panicked; please report this"));
        caller.send(Told::Done(done.unwrap_or_else(panicked)));
    });
    let heard = listen(py, progress, &told);
    if heard.is_err() {
        stop.store(true, Ordering::SeqCst);
        if stops {
            // Panics of the worker were caught in it.
            let _ = py.detach(|| worker.join());
        }
    }
    heard
}

fn listen<T: Send>(py: Python<'_>, progress: Option<&Bound<'_, PyAny>>, told: &Mutex<Receiver<Told<T>>>) -> PyResult<T> {
    let next = |wait| told.lock().unwrap_or_else(PoisonError::into_inner).recv_timeout(wait);
    loop {
        match py.detach(|| next(INTERVAL)) {
            Ok(Told::Done(result)) => return result,
            Ok(Told::Progress(mut done, mut total)) => {
                // Only the latest progress is passed on.
                let mut result = None;
                while result.is_none() {
                    match next(Duration::ZERO) {
                        Ok(Told::Progress(d, t)) => (done, total) = (d, t),
                        Ok(Told::Done(r)) => result = Some(r),
                        Err(_) => break,
                    }
                }
                if let Some(progress) = progress {
                    progress.call1((done, total))?;
                }
                if let Some(result) = result {
                    return result;
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => {
                return Err(PyRuntimeError::new_err("grimace's worker ended without an answer"));
            }
        }
        py.check_signals()?;
    }
}
