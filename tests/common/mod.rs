//! A temporary work folder, a command runner, and a small simulated dataset, made once per test program and kept in memory.

// Each test program uses only a part of this module.
#![allow(dead_code)]

pub mod video;

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::Output,
    sync::{Arc, LazyLock, Mutex, OnceLock},
};

use tempfile::TempDir;

/// Returns the folder of the repository.
pub fn root() -> PathBuf {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().find(|folder| folder.join("candide").is_dir()).unwrap().to_owned()
}

/// Returns the path of shared data next to the repository; without it, prints what was skipped and returns `None`.
pub fn shared_data(name: &str, skipped: &str) -> Option<PathBuf> {
    let path = root().join("../shared/data").join(name);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: ../shared/data/{name} does not exist; {skipped}");
    None
}

/// Returns the path of `grimace`, next to which are `grimace-lab` (for `simulate` and `evaluate`) and `grimace-opencv` (for videos).
///
/// `cargo test` builds all of them, but only some when the tests of a single package are requested. In that case the others are built here,
/// unless an earlier build left them.
pub fn grimace() -> &'static Path {
    static PROGRAM: LazyLock<PathBuf> = LazyLock::new(|| {
        // The tests are in the folder `deps` beside the programs.
        let test = std::env::current_exe().unwrap();
        let folder = test.parent().and_then(Path::parent).unwrap();
        let program = |name: &str| folder.join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
        for (package, name) in [("grimace", "grimace"), ("grimace", "grimace-opencv"), ("grimace-lab", "grimace-lab")] {
            if !program(name).is_file() {
                let mut build = std::process::Command::new(env!("CARGO"));
                build.args(["build", "--quiet", "--package", package, "--bin", name, "--manifest-path"]);
                build.arg(root().join("Cargo.toml")).args(if folder.ends_with("release") { &["--release"][..] } else { &[] });
                assert!(build.status().unwrap().success(), "{name} does not exist and cannot be built");
            }
        }
        program("grimace")
    });
    &PROGRAM
}

/// Files by path relative to a folder, with `/` between folders.
pub type Files = BTreeMap<String, Vec<u8>>;

/// Ids of the sequences of [`FACES`], sorted.
pub const SEQUENCES: [&str; 6] = ["S001_005", "S001_007", "S002_005", "S002_007", "S003_005", "S003_007"];

/// Three subjects (S001 and S002 of cohort A, S003 of cohort B) with happiness (005) and surprise (007), six frames of 200x160 each.
pub static FACES: LazyLock<Files> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    let options = "--subjects 3 --emotions happiness,surprise --frames 6 --size 200x160 --seed 7 --force";
    let mut simulate = std::process::Command::new(grimace());
    simulate.arg("simulate").args(options.split_whitespace()).arg("-o").arg(folder.path());
    simulate.run().exit(0);
    files_in(folder.path())
});

/// Returns all files below a folder.
pub fn files_in(folder: &Path) -> Files {
    fn collect(root: &Path, folder: &Path, files: &mut Files) {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                collect(root, &path, files);
            } else {
                let name = path.strip_prefix(root).unwrap().to_string_lossy().replace('\\', "/");
                files.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    let mut files = Files::new();
    if folder.exists() {
        collect(folder, folder, &mut files);
    }
    files
}

/// Panics with the names of the files that differ, without their content.
pub fn assert_same_files(a: &Files, b: &Files) {
    let names = |files: &Files| files.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(a), names(b));
    let differing: Vec<_> = a.keys().filter(|name| a[*name] != b[*name]).collect();
    assert!(differing.is_empty(), "these files differ: {differing:?}");
}

/// Output and exit status of a command.
#[derive(Debug)]
pub struct Ran {
    pub status: Option<i32>,
    pub stdout: String,
    pub stderr: String,
}

impl From<Output> for Ran {
    fn from(output: Output) -> Self {
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        Self { status: output.status.code(), stdout: text(output.stdout), stderr: text(output.stderr) }
    }
}

impl Ran {
    /// Fails the test unless the command ended with this exit status, or if it panicked.
    #[track_caller]
    pub fn exit(self, status: i32) -> Self {
        assert!(!self.stderr.contains("panicked"), "{}", self.stderr);
        assert_eq!(self.status, Some(status), "{}{}", self.stdout, self.stderr);
        self
    }

    /// Fails the test unless standard error contains all of the texts.
    #[track_caller]
    pub fn says(self, texts: &[&str]) -> Self {
        for text in texts {
            assert!(self.stderr.contains(text), "`{text}` is not in: {}", self.stderr);
        }
        self
    }

    /// Fails the test unless standard error is this text.
    #[track_caller]
    pub fn only_says(self, text: &str) -> Self {
        assert_eq!(self.stderr, text);
        self
    }

    /// Fails the test unless standard output is this text.
    #[track_caller]
    pub fn only_prints(self, text: &str) -> Self {
        assert_eq!(self.stdout, text);
        self
    }

    /// Fails the test unless standard output contains all of the texts.
    #[track_caller]
    pub fn prints(self, texts: &[&str]) -> Self {
        for text in texts {
            assert!(self.stdout.contains(text), "`{text}` is not in: {}", self.stdout);
        }
        self
    }
}

/// Runs commands to their end.
pub trait Run {
    /// Returns the output and the exit status.
    fn run(&mut self) -> Ran;
}

impl Run for std::process::Command {
    fn run(&mut self) -> Ran {
        self.output().unwrap().into()
    }
}

/// A temporary folder to run commands in.
pub struct Work {
    folder: TempDir,
}

impl Work {
    /// Makes an empty folder.
    pub fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    /// Makes a folder with the dataset [`FACES`] in `faces`.
    pub fn with_faces() -> Self {
        Self::with_sequences(&SEQUENCES)
    }

    /// Makes a folder with some sequences of [`FACES`] in `faces`, and their manifest.
    pub fn with_sequences(ids: &[&str]) -> Self {
        let work = Self::new();
        for (name, bytes) in FACES.iter() {
            let of = |id: &&str| name.starts_with(&format!("{}/", id.replace('_', "/")));
            if ids.iter().any(of) {
                work.write(&format!("faces/{name}"), bytes);
            }
        }
        let manifest = String::from_utf8(FACES["manifest.csv"].clone()).unwrap();
        let listed = |line: &&str| ids.iter().any(|id| line.starts_with(&id.replace('_', ",")));
        let mut lines: Vec<&str> = manifest.lines().take(1).collect();
        lines.extend(manifest.lines().skip(1).filter(listed));
        work.write("faces/manifest.csv", lines.join("\n") + "\n");
        work
    }

    /// Makes a folder with some sequences of [`FACES`] in `faces`, and in the folder `out` the results of `grimace run faces -o out`. The
    /// run takes place once for all tests with the same sequences; the results do not contain the name of their folder.
    pub fn after_run(ids: &[&str], out: &str) -> Self {
        static RUNS: Mutex<BTreeMap<String, Arc<OnceLock<Files>>>> = Mutex::new(BTreeMap::new());
        let work = Self::with_sequences(ids);
        let run = RUNS.lock().unwrap().entry(ids.join(" ")).or_default().clone();
        let made = run.get_or_init(|| {
            let work = Self::with_sequences(ids);
            work.grimace("run faces -o out").exit(0);
            work.files("out")
        });
        for (name, bytes) in made {
            work.write(&format!("{out}/{name}"), bytes);
        }
        work
    }

    /// Returns a path in the folder.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a file and creates its parent folders.
    pub fn write(&self, name: &str, content: impl AsRef<[u8]>) -> &Self {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
        self
    }

    /// Returns the bytes of a file.
    pub fn bytes(&self, name: &str) -> Vec<u8> {
        fs::read(self.path(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Returns the text of a file.
    pub fn read(&self, name: &str) -> String {
        String::from_utf8(self.bytes(name)).unwrap()
    }

    /// Returns the value of a JSON file.
    pub fn json(&self, name: &str) -> serde_json::Value {
        serde_json::from_slice(&self.bytes(name)).unwrap_or_else(|e| panic!("{name}: {e}"))
    }

    /// Replaces text in a file, which must contain it.
    #[track_caller]
    pub fn replace(&self, name: &str, from: &str, to: &str) -> &Self {
        let text = self.read(name);
        assert!(text.contains(from), "`{from}` is not in {name}");
        self.write(name, text.replace(from, to))
    }

    /// Returns all files below a subfolder.
    pub fn files(&self, name: &str) -> Files {
        files_in(&self.path(name))
    }

    /// Returns the command, to be started in the folder.
    pub fn command(&self) -> std::process::Command {
        let mut command = std::process::Command::new(grimace());
        command.current_dir(self.folder.path());
        command
    }

    /// Runs `grimace ARGS`, with arguments separated by blanks.
    pub fn grimace(&self, args: &str) -> Ran {
        self.command().args(args.split_whitespace()).run()
    }

    /// Runs a shell script in which `$GRIMACE` is the command.
    pub fn shell(&self, script: &str) -> Ran {
        let mut command = std::process::Command::new("sh");
        command.current_dir(self.folder.path()).env("GRIMACE", grimace()).args(["-c", script]);
        command.run()
    }

    /// Returns the rows of a CSV file without its header, with fields by column.
    pub fn rows(&self, name: &str) -> Vec<BTreeMap<String, String>> {
        csv::Reader::from_reader(self.bytes(name).as_slice()).deserialize().map(|row| row.unwrap()).collect()
    }

    /// Returns the header line of a CSV file.
    pub fn header(&self, name: &str) -> String {
        self.read(name).lines().next().unwrap_or_default().to_owned()
    }
}

/// Installs an executable file by another process. If this process wrote it, a program that another test starts at the same moment could
/// inherit the open file, and the system starts no file that is open for writing.
#[cfg(unix)]
pub fn install(from: &Path, to: &Path) {
    assert!(std::process::Command::new("install").args(["-D", "-m", "755"]).args([from, to]).status().unwrap().success());
}

/// Returns the names of incomplete or temporary files.
pub fn leftovers(files: &Files) -> Vec<&String> {
    files.keys().filter(|name| name.ends_with(".tmp") || name.contains("/.") || name.starts_with('.')).collect()
}
