//! `grimace completions`, `grimace man` and `grimace --version --verbose`: the files of packages, and the description of a build.

use crate::common::Work;

#[test]
fn completions_know_every_command_and_are_what_their_shell_reads() {
    let work = Work::new();
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        work.grimace(&format!("completions {shell}")).exit(0).prints(&["grimace", "synthesize", "completions", "profile"]);
    }
    work.shell("\"$GRIMACE\" completions bash > grimace.bash && bash -n grimace.bash").exit(0);
    work.grimace("completions tcsh").exit(2).says(&["bash", "zsh", "fish"]);
}

#[test]
fn there_is_a_manual_page_for_every_command() {
    let work = Work::new();
    work.grimace("man").exit(0).prints(&[".TH grimace 1", "grimace\\-run(1)", "Exit status"]);
    work.grimace("man -o man").exit(0);
    for page in ["grimace", "grimace-run", "grimace-fap-check", "grimace-bank-build", "grimace-man"] {
        assert!(work.read(&format!("man/{page}.1")).contains(&format!(".TH {page} 1")), "{page}");
    }
    assert!(work.read("man/grimace-fap-check.1").contains("\\-\\-strict"));
    assert!(!work.path("man/grimace-help.1").exists());
}

#[test]
#[cfg(target_os = "linux")]
fn help_that_cannot_be_printed_is_no_success() {
    let work = Work::new();
    for what in ["--help", "run --help", "--version"] {
        work.shell(&format!("\"$GRIMACE\" {what} > /dev/full")).exit(1).says(&["cannot write to standard output"]);
        work.shell(&format!("\"$GRIMACE\" {what} > /dev/null")).exit(0);
    }
    work.grimace("run --nonsense").exit(2).says(&["--nonsense"]);
}

#[test]
fn the_version_in_full_says_what_the_build_can_do() {
    let work = Work::new();
    work.grimace("--version --verbose").exit(0).prints(&[
        concat!("grimace ", env!("CARGO_PKG_VERSION")),
        "features: annotate, columnar, opencv, tool",
        "versions of files: run.json 1, track .json 2, bank 2",
        "  OpenCV 4.",
        "  mp4 is written with: ",
    ]);
    work.grimace("--version").exit(0).prints(&[concat!("grimace ", env!("CARGO_PKG_VERSION"), "\n")]);
}
