//! Starts `grimace-opencv`, a separate program for everything that needs OpenCV.
//!
//! OpenCV depends on some 250 libraries, which take longer to load than a short sequence takes to track, and a decoder that crashes on a
//! damaged video must not end a run of hundreds of sequences. The library therefore does not link OpenCV. The program lies beside this one,
//! or on PATH. Its arguments select the task; messages go over its standard input and output (see `wire`). It ends when its input ends, and
//! so never outlives the program that started it.

pub mod wire;

use std::{
    env,
    ffi::OsStr,
    io::{self, BufRead, BufReader, BufWriter, Read, Write},
    path::PathBuf,
    process::{Child, ChildStderr, ChildStdin, ChildStdout, Command, ExitStatus, Stdio},
    thread::JoinHandle,
};

use serde::{Serialize, de::DeserializeOwned};

use self::wire::{Message, Pixels, Reply};

/// Name of the program.
pub const PROGRAM: &str = "grimace-opencv";

/// Why the program fails.
#[derive(Debug, thiserror::Error)]
pub enum CompanionError {
    /// The program is not installed.
    #[error(
        "this needs {PROGRAM}, which is neither beside this program nor on PATH; install both with `cargo install --path .` in the \
         project's folder, after OpenCV (on Debian: apt-get install libopencv-dev clang libclang-dev)"
    )]
    NotInstalled,
    /// The program cannot be started.
    #[error("cannot start {PROGRAM}: {0}")]
    CannotStart(#[source] io::Error),
    /// The program has another version, or another program has its name.
    #[error("{} has another version than this program; install both from the same source", program.display())]
    OtherVersion {
        /// The program that was started.
        program: PathBuf,
    },
    /// The program ended early, for example because a decoder crashed.
    #[error("{PROGRAM} ended before its work was done ({status}){}{last_words}", if last_words.is_empty() { "" } else { ": " })]
    Ended {
        /// Exit status.
        status: ExitStatus,
        /// The last line it wrote to its standard error.
        last_words: String,
    },
    /// The connection to the program failed.
    #[error("cannot talk to {PROGRAM}: {0}")]
    Connection(#[source] io::Error),
    /// The program gave an unexpected answer.
    #[error("{PROGRAM} gave an unknown answer: {found}")]
    NotUnderstood {
        /// The beginning of the answer.
        found: String,
    },
}

/// Path of a program by its name: beside this one, else found by the system on PATH.
pub fn program(name: &str) -> PathBuf {
    let name = format!("{name}{}", env::consts::EXE_SUFFIX);
    let here = env::current_exe().ok();
    let folder = here.as_deref().and_then(|path| path.parent());
    // Cargo puts tests and examples one folder below the programs.
    let below = folder.filter(|f| f.ends_with("deps") || f.ends_with("examples")).and_then(|f| f.parent());
    let beside = [folder, below].into_iter().flatten().map(|f| f.join(&name)).find(|path| path.is_file());
    beside.unwrap_or_else(|| PathBuf::from(name))
}

/// The running program; dropping it ends the process.
#[derive(Debug)]
pub struct Companion {
    child: Child,
    input: BufWriter<ChildStdin>,
    output: BufReader<ChildStdout>,
    /// Reads its standard error (messages of libraries about codecs and tags, on which a user cannot act), and returns the last line.
    listener: Option<JoinHandle<String>>,
}

/// Longest line kept from the program's standard error, bytes.
const LONGEST_LINE: u64 = 4096;

/// The last non-empty line.
fn last_line(errors: ChildStderr) -> String {
    let mut errors = BufReader::new(errors);
    let (mut last, mut line) = (String::new(), Vec::new());
    loop {
        line.clear();
        match errors.by_ref().take(LONGEST_LINE).read_until(b'\n', &mut line) {
            Ok(count) if count > 0 => {
                let text = String::from_utf8_lossy(&line);
                if !text.trim().is_empty() {
                    last = crate::text::excerpt(text.trim());
                }
            }
            _ => return last,
        }
    }
}

impl Companion {
    /// Starts it with arguments.
    ///
    /// # Errors
    /// [`CompanionError`] when it does not exist, does not start, or has another version.
    pub fn start<A: AsRef<OsStr>>(arguments: impl IntoIterator<Item = A>) -> Result<Self, CompanionError> {
        let program = program(PROGRAM);
        let mut command = Command::new(&program);
        command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
        // Ctrl-C goes to this program, which ends the other one at the right time.
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(&mut command, 0);
        let mut child = command.spawn().map_err(|error| match error.kind() {
            io::ErrorKind::NotFound => CompanionError::NotInstalled,
            _ => CompanionError::CannotStart(error),
        })?;
        let (Some(input), Some(output)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(CompanionError::CannotStart(io::Error::other("its input and output are not there")));
        };
        let listener = child.stderr.take().map(|errors| std::thread::spawn(|| last_line(errors)));
        let output = BufReader::with_capacity(1 << 16, output);
        let mut companion = Self { child, input: BufWriter::new(input), output, listener };
        match companion.receive::<Reply>(0) {
            Ok(Answer::Said(Reply::Hello { version })) if version == wire::VERSION => Ok(companion),
            Ok(_) | Err(CompanionError::NotUnderstood { .. }) => Err(CompanionError::OtherVersion { program }),
            Err(error) => Err(error),
        }
    }

    /// Sends a message.
    ///
    /// # Errors
    /// [`CompanionError`] when the connection is closed.
    pub fn send(&mut self, said: &impl Serialize) -> Result<(), CompanionError> {
        let sent = wire::write_text(&mut self.input, said).and_then(|()| self.input.flush());
        sent.map_err(|error| self.broken(error))
    }

    /// Sends pixels.
    ///
    /// # Errors
    /// [`CompanionError`] when the connection is closed.
    pub fn send_pixels(&mut self, size: (u32, u32), channels: u8, data: &[u8]) -> Result<(), CompanionError> {
        let sent = wire::write_pixels(&mut self.input, size, channels, data).and_then(|()| self.input.flush());
        sent.map_err(|error| self.broken(error))
    }

    /// Receives the next message. A picture of more than `most` pixels is rejected before memory is allocated.
    ///
    /// # Errors
    /// [`CompanionError`] when the program ended, or its message is invalid.
    pub fn receive<T: DeserializeOwned>(&mut self, most: u64) -> Result<Answer<T>, CompanionError> {
        match wire::read(&mut self.output, most) {
            Ok(Some(Message::Pixels(pixels))) => Ok(Answer::Pixels(pixels)),
            Ok(Some(Message::Text(text))) => match serde_json::from_str(&text) {
                Ok(said) => Ok(Answer::Said(said)),
                Err(_) => Err(not_understood(&text)),
            },
            Ok(None) => Err(self.broken(io::ErrorKind::UnexpectedEof.into())),
            Err(error) => Err(self.broken(error)),
        }
    }

    /// The error for a broken connection: that the program ended, if it did.
    fn broken(&mut self, error: io::Error) -> CompanionError {
        match error.kind() {
            io::ErrorKind::InvalidData => not_understood(&error.to_string()),
            io::ErrorKind::UnexpectedEof | io::ErrorKind::BrokenPipe => match self.child.wait() {
                Ok(status) => {
                    let last_words = self.listener.take().and_then(|listener| listener.join().ok()).unwrap_or_default();
                    CompanionError::Ended { status, last_words }
                }
                Err(error) => CompanionError::Connection(error),
            },
            _ => CompanionError::Connection(error),
        }
    }
}

impl Drop for Companion {
    fn drop(&mut self) {
        // Both fail only if the program has ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Messages of the program.
#[derive(Debug)]
pub enum Answer<T> {
    /// A text message.
    Said(T),
    /// A picture.
    Pixels(Pixels),
}

impl<T> Answer<T> {
    /// The error for an answer of an unexpected kind.
    pub fn unexpected(&self) -> CompanionError {
        match self {
            Self::Said(_) => not_understood("an answer to another question"),
            Self::Pixels(pixels) => not_understood(&format!("a picture of {}x{}", pixels.width, pixels.height)),
        }
    }
}

fn not_understood(found: &str) -> CompanionError {
    CompanionError::NotUnderstood { found: crate::text::excerpt(found) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn nothing_of_opencv_is_linked_to_the_library() {
        let loaded = std::fs::read_to_string("/proc/self/maps").unwrap();
        assert!(loaded.contains("libc") && !loaded.contains("opencv"));
    }

    #[test]
    fn a_program_that_is_not_beside_this_one_is_searched_on_path() {
        let name = format!("no-such-program{}", env::consts::EXE_SUFFIX);
        assert_eq!(program("no-such-program"), PathBuf::from(name));
    }

    #[test]
    fn a_missing_program_is_reported_with_the_command_that_installs_it() {
        let text = CompanionError::NotInstalled.to_string();
        assert!(text.contains(PROGRAM) && text.contains("cargo install --path ."), "{text}");
    }
}
