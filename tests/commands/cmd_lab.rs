//! How `grimace` starts `grimace-lab`, tested with scripts in its place.
#![cfg(unix)]

use std::{fs, path::Path, process::Command};

use crate::common::{Ran, Run, grimace, install};

/// Writes a script that prints its name and arguments and ends with status 3.
fn script(folder: &Path, name: &str) {
    fs::create_dir_all(folder).unwrap();
    let text = folder.join("script");
    fs::write(&text, format!("#!/bin/sh\nprintf '{name}'\nprintf ' <%s>' \"$@\"\nexit 3\n")).unwrap();
    install(&text, &folder.join("grimace-lab"));
}

/// Runs a copy of the command that is alone in `folder/bin`, with `folder/path` as the only folder of PATH.
fn run(folder: &Path, args: &str) -> Ran {
    let program = folder.join("bin/grimace");
    if !program.exists() {
        install(grimace(), &program);
    }
    let mut command = Command::new(program);
    command.env("PATH", folder.join("path")).args(args.split_whitespace());
    command.run()
}

#[test]
fn the_lab_is_found_beside_the_command_then_on_path() {
    let folder = tempfile::tempdir().unwrap();
    let absent = run(folder.path(), "simulate -o faces").exit(1);
    absent.says(&["`grimace simulate` needs the program grimace-lab", "cargo install --path crates/lab"]);
    script(&folder.path().join("path"), "path");
    // Arguments and exit status are those of the lab, help included.
    run(folder.path(), "simulate -o faces --help -x").exit(3).prints(&["path <simulate> <-o> <faces> <--help> <-x>"]);
    run(folder.path(), "help evaluate fit").exit(3).prints(&["path <evaluate> <fit> <--help>"]);
    script(&folder.path().join("bin"), "beside");
    run(folder.path(), "evaluate").exit(3).prints(&["beside <evaluate>"]);
}

#[test]
fn help_lists_the_commands_of_the_lab() {
    let output = Command::new(grimace()).arg("--help").output().unwrap();
    Ran::from(output).exit(0).prints(&["simulate", "evaluate"]);
}
