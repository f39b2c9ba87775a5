//! What must never happen, tried: hostile files by the command and by every reader, and runs that are disturbed.
#![allow(missing_docs, clippy::pedantic)]

#[cfg(unix)]
mod faults;
mod files;
mod fuzz;
mod inputs;
