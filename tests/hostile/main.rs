//! What must never happen, tried: hostile files by the command and by every reader, and runs that are disturbed.

#[cfg(unix)]
mod faults;
mod files;
mod fuzz;
mod inputs;
