//! `grimace completions` and `grimace man`: files that a package installs with the program.

use std::{io, path::PathBuf};

use clap::CommandFactory;
use clap_complete::Shell;
use clap_mangen::Man;
use grimace::output;

use super::{Cli, Outcome};

/// Arguments of `completions`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace completions bash > ~/.local/share/bash-completion/completions/grimace
  grimace completions zsh > ~/.zfunc/_grimace
  grimace completions fish > ~/.config/fish/completions/grimace.fish")]
pub struct CompletionsArgs {
    /// Shell to write the completions for
    shell: Shell,
}

/// Arguments of `man`.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  grimace man | man -l -
  grimace man -o /usr/local/share/man/man1")]
pub struct ManArgs {
    /// Folder for the pages of all commands; by default the page of `grimace` is printed
    #[arg(short, long, value_name = "DIR")]
    output: Option<PathBuf>,
}

/// Prints the completions of a shell.
pub fn completions(args: &CompletionsArgs) -> anyhow::Result<Outcome> {
    let mut bytes = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "grimace", &mut bytes);
    print(&bytes)
}

/// Prints the manual page, or writes all of them.
pub fn man(args: &ManArgs) -> anyhow::Result<Outcome> {
    let mut command = Cli::command();
    command.build();
    let Some(folder) = &args.output else { return print(&page(&command)?) };
    let mut all = vec![command];
    while let Some(command) = all.pop() {
        // The display name of a built command is its full name with hyphens: `grimace-fap-info`.
        let name = command.get_display_name().unwrap_or_else(|| command.get_name()).to_owned();
        output::write_bytes(&folder.join(format!("{name}.1")), &page(&command)?)?;
        all.extend(command.get_subcommands().filter(|c| c.get_name() != "help" && !c.is_hide_set()).cloned());
    }
    Ok(Outcome::Done)
}

fn page(command: &clap::Command) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    Man::new(command.clone()).render(&mut bytes)?;
    Ok(bytes)
}

/// Prints bytes. A reader that closes the pipe early is not an error.
fn print(bytes: &[u8]) -> anyhow::Result<Outcome> {
    match io::Write::write_all(&mut io::stdout(), bytes) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(Outcome::Done),
    }
}
