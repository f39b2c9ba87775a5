//! The `grimace` command.

use std::process::ExitCode;

fn main() -> ExitCode {
    grimace::internal::cli::main()
}
