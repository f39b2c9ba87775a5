//! The `grimace-lab` command: what `grimace simulate` and `grimace evaluate` start.
#![allow(missing_docs, clippy::pedantic)]

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
