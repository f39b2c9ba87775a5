//! The `grimace-lab` command: what `grimace simulate` and `grimace evaluate` start.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::main()
}
