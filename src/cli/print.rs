//! Lines on standard output and standard error.

use grimace::text::{message, printable};
use std::{
    fmt,
    io::{self, Write},
    sync::OnceLock,
};

/// Why standard output could not be written, if so.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Prints a line to standard output; what files hold commands no terminal. A reader that has seen enough is no failure; any other
/// is kept for `check`.
pub fn line(text: fmt::Arguments<'_>) {
    match writeln!(io::stdout(), "{}", printable(&text.to_string())) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => drop(FAILURE.set(error)),
        _ => {}
    }
}

/// Prints a line to standard error. Where that fails nobody can be told.
pub fn error_line(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{}", message(&text.to_string()));
}

/// Fails when a line could not be printed.
pub fn check() -> anyhow::Result<()> {
    match FAILURE.get() {
        Some(error) => Err(anyhow::anyhow!("cannot write to standard output: {error}")),
        None => Ok(()),
    }
}
