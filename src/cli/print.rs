//! Lines on standard output and standard error.

use grimace::text::{message, printable};
use std::{
    fmt,
    io::{self, Write},
    process::ExitCode,
    sync::OnceLock,
};

/// Reason why standard output could not be written, if this happened.
static FAILURE: OnceLock<io::Error> = OnceLock::new();

/// Prints a line to standard output. Texts of files cannot send commands to a terminal. A reader that closes the pipe early is not an
/// error; any other error is kept for `check`.
pub fn line(text: fmt::Arguments<'_>) {
    match writeln!(io::stdout(), "{}", printable(&text.to_string())) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => drop(FAILURE.set(error)),
        _ => {}
    }
}

/// Prints a line to standard error. If that fails, nothing can be reported.
pub fn error_line(text: fmt::Arguments<'_>) {
    let _ = writeln!(io::stderr(), "{}", message(&text.to_string()));
}

/// Fails if a line could not be printed.
pub fn check() -> anyhow::Result<()> {
    match FAILURE.get() {
        Some(error) => Err(anyhow::anyhow!("cannot write to standard output: {error}")),
        None => Ok(()),
    }
}

/// Prints help, version or a usage error, and returns the exit status: that of the usage, or 1 if help cannot be printed.
pub fn said_by_clap(said: &clap::Error) -> ExitCode {
    if let Some((text, expected)) = super::numbers::expected_number(said) {
        let _ = write!(io::stderr(), "{}", said.render().to_string().replace(&text, expected));
        return ExitCode::from(2);
    }
    match said.print().and_then(|()| io::stdout().flush()) {
        Err(error) if !said.use_stderr() && error.kind() != io::ErrorKind::BrokenPipe => {
            error_line(format_args!("error: cannot write to standard output: {error}"));
            ExitCode::FAILURE
        }
        _ => ExitCode::from(u8::try_from(said.exit_code()).unwrap_or(1)),
    }
}
