//! `grimace --version --verbose`: the capabilities of this build.

use std::{ffi::OsString, process::Command};

use grimace::{
    companion::{PROGRAM, program},
    output::MADE_BY,
    pipeline::SCHEMA_VERSION,
    synthesis::BANK_VERSION,
    track::TRACK_SCHEMA,
};

use super::Outcome;

/// Returns whether a command line requests the full version.
pub fn asked(arguments: impl Iterator<Item = OsString>) -> bool {
    let words: Vec<OsString> = arguments.collect();
    let is = |word: &OsString, names: [&str; 2]| names.iter().any(|name| word == *name);
    words.len() == 2 && words.iter().any(|w| is(w, ["--version", "-V"])) && words.iter().any(|w| is(w, ["--verbose", "-v"]))
}

/// Prints it.
pub fn run() -> anyhow::Result<Outcome> {
    let of = |there: bool, name: &'static str| there.then_some(name);
    let features: Vec<&str> = [
        of(cfg!(feature = "annotate"), "annotate"),
        of(cfg!(feature = "columnar"), "columnar"),
        of(cfg!(feature = "opencv"), "opencv"),
        of(cfg!(feature = "tool"), "tool"),
    ]
    .into_iter()
    .flatten()
    .collect();
    println!("{MADE_BY}");
    println!("features: {}", features.join(", "));
    println!("platform: {} {}", std::env::consts::OS, std::env::consts::ARCH);
    println!("pictures: PNG, JPEG, TIFF, BMP, PGM, PPM, WebP; films without OpenCV: GIF, APNG");
    println!("versions of files: run.json {SCHEMA_VERSION}, track .json {TRACK_SCHEMA}, bank {BANK_VERSION}");
    let program = program(PROGRAM);
    match Command::new(&program).arg("--about").output() {
        Ok(said) if said.status.success() => {
            println!("{PROGRAM}: {}", program.display());
            String::from_utf8_lossy(&said.stdout).lines().for_each(|line| println!("  {line}"));
        }
        Ok(said) => println!("{PROGRAM}: {}: does not run ({}); videos are not available", program.display(), said.status),
        Err(_) => println!("{PROGRAM}: not installed; videos are not available"),
    }
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn both_words_in_either_order_ask_for_it() {
        let asks = |line: &str| asked(line.split_whitespace().map(OsString::from));
        assert!(asks("--version --verbose") && asks("-v -V") && asks("--verbose --version"));
        assert!(!asks("--version") && !asks("run --version --verbose") && !asks("--verbose --verbose"));
    }
}
