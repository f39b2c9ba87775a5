//! `grimace simulate` and `grimace evaluate`: commands of the separate program `grimace-lab`.

use std::{
    ffi::{OsStr, OsString},
    process::Command,
};

use grimace::companion::program;

use super::Outcome;

/// Name of the program.
const PROGRAM: &str = "grimace-lab";

/// Arguments, passed to the other program unchanged.
#[derive(Debug, clap::Args)]
#[command(disable_help_flag = true, disable_version_flag = true)]
pub struct Args {
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    pub arguments: Vec<OsString>,
}

/// Returns the command and arguments of the lab in a command line, `help COMMAND` included.
pub fn asked(mut arguments: impl Iterator<Item = OsString>) -> Option<(&'static str, Vec<OsString>)> {
    let command = |word: &OsStr| ["simulate", "evaluate"].into_iter().find(|name| word == *name);
    let first = arguments.next()?;
    if first == "help" {
        let name = command(&arguments.next()?)?;
        return Some((name, arguments.chain([OsString::from("--help")]).collect()));
    }
    Some((command(&first)?, arguments.collect()))
}

/// Runs a command of the lab with its output, its signals and its exit status.
pub fn run(command: &str, arguments: &[OsString]) -> anyhow::Result<Outcome> {
    let mut lab = Command::new(program(PROGRAM));
    lab.arg(command).args(arguments);
    let error = match start(lab) {
        Ok(outcome) => return Ok(outcome),
        Err(error) => error,
    };
    if error.kind() == std::io::ErrorKind::NotFound {
        anyhow::bail!(
            "`grimace {command}` needs the program {PROGRAM}, which is neither beside this program nor on PATH; in the project's folder, \
             `cargo install --path crates/lab` installs it"
        );
    }
    Err(anyhow::Error::new(error).context(format!("cannot start {PROGRAM}")))
}

/// Replaces this process by the other program.
#[cfg(unix)]
fn start(mut lab: Command) -> std::io::Result<Outcome> {
    use std::os::unix::process::CommandExt;
    Err(lab.exec())
}

/// Runs the other program until it ends.
#[cfg(not(unix))]
fn start(mut lab: Command) -> std::io::Result<Outcome> {
    Ok(lab.status()?.code().and_then(|code| u8::try_from(code).ok()).map_or(Outcome::Failed, Outcome::Other))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(line: &str) -> Option<(&'static str, Vec<OsString>)> {
        asked(line.split_whitespace().map(OsString::from))
    }

    #[test]
    fn only_its_own_commands_are_asked_of_the_lab() {
        let list = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
        assert_eq!(words("simulate -o faces --help"), Some(("simulate", list(&["-o", "faces", "--help"]))));
        assert_eq!(words("evaluate"), Some(("evaluate", vec![])));
        assert_eq!(words("help evaluate fit"), Some(("evaluate", list(&["fit", "--help"]))));
        for line in ["", "run faces -o simulate", "help", "help run", "--help", "-o simulate", "simulated"] {
            assert_eq!(words(line), None, "{line}");
        }
    }
}
