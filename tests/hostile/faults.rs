//! Runs that are killed, have no disk space or permission, or meet failing system calls, a second run, or a bad file among many. Each test
//! compares the results byte by byte with those of an undisturbed run.
//!
//! The ordinary tests use few rounds; `scripts/faults N` runs N rounds of each fault and prints the table. `GRIMACE_FAULTS_SEED` (default
//! 0) selects the moments, so that a round can be repeated on a machine of similar speed.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    time::{Duration, Instant},
};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

/// Number of rounds of each fault in the ordinary tests.
const ROUNDS: u64 = 2;

/// Sequences of the dataset.
const SEQUENCES: [(&str, &str, &str); 3] = [("S001", "001", "anger"), ("S001", "005", "happiness"), ("S002", "005", "happiness")];

/// Number of frames of each sequence; the number of written files does not depend on it.
const FRAMES: u32 = 6;

/// Number of tracks in the batch with one bad track: in the ordinary tests, and in `scripts/faults`.
const BATCH: (usize, usize) = (16, 80);

/// Results by path, without temporary files.
type Files = BTreeMap<String, Vec<u8>>;

fn files_in(folder: &Path) -> Files {
    let mut files = Files::new();
    let mut left = vec![folder.to_owned()];
    while let Some(next) = left.pop() {
        for entry in fs::read_dir(&next).into_iter().flatten() {
            let path = entry.unwrap().path();
            let name = path.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
            if path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(".grimace-")) {
                continue;
            }
            if path.is_dir() { left.push(path) } else { drop(files.insert(name, fs::read(&path).unwrap())) }
        }
    }
    files
}

/// Returns the names in which two sets of results differ.
fn differing(a: &Files, b: &Files) -> Vec<String> {
    let names: std::collections::BTreeSet<&String> = a.keys().chain(b.keys()).collect();
    names.into_iter().filter(|&name| a.get(name) != b.get(name)).cloned().collect()
}

/// A work folder with a dataset, the results of an undisturbed run, and the duration of that run.
struct Bench {
    folder: TempDir,
    expected: Files,
    duration: Duration,
    random: ChaCha8Rng,
    table: Vec<(&'static str, u64, String)>,
}

/// Copies a sequence of the fixtures, limited to its first [`FRAMES`] frames.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let number: Option<u32> = path.file_stem().and_then(|stem| stem.to_str()?.rsplit('_').next()?.parse().ok());
        if number.is_none_or(|number| number <= FRAMES) {
            fs::copy(&path, to.join(path.file_name().unwrap())).unwrap();
        }
    }
}

impl Bench {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/simulated");
        let mut manifest = "subject,sequence,emotion\n".to_owned();
        for (subject, sequence, emotion) in SEQUENCES {
            copy(&fixtures.join(subject).join(sequence), &folder.path().join("faces").join(subject).join(sequence));
            manifest += &format!("{subject},{sequence},{emotion}\n");
        }
        fs::write(folder.path().join("faces/manifest.csv"), manifest).unwrap();
        let seed = std::env::var("GRIMACE_FAULTS_SEED").ok().and_then(|s| s.parse().ok()).unwrap_or(0);
        let random = ChaCha8Rng::seed_from_u64(seed);
        let mut bench = Self { folder, expected: Files::new(), duration: Duration::ZERO, random, table: Vec::new() };
        let started = Instant::now();
        assert_eq!(bench.end(bench.run("undisturbed")), (Some(0), String::new()));
        bench.duration = started.elapsed();
        bench.expected = files_in(&bench.path("undisturbed"));
        assert!(bench.expected.len() > 10);
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Starts a command in the work folder and writes its errors to a file.
    fn start(&self, program: &str, arguments: &[&str]) -> Child {
        let errors = fs::File::create(self.path("stderr")).unwrap();
        let mut command = Command::new(program);
        command.args(arguments).current_dir(self.folder.path());
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors).spawn().unwrap()
    }

    fn run(&self, out: &str) -> Child {
        self.start(GRIMACE, &["run", "faces", "-o", out, "-q"])
    }

    /// Like [`Self::run`] within a line of shell, with `$0` the program and `$1` the folder of results.
    fn run_in_shell(&self, line: &str, out: &str) -> Child {
        let line = format!("{line}exec \"$0\" run faces -o \"$1\" -q");
        self.start("sh", &["-c", &line, GRIMACE, out])
    }

    /// Returns the exit status (`None` when killed) and the messages.
    fn end(&self, mut child: Child) -> (Option<i32>, String) {
        let status = child.wait().unwrap().code();
        (status, String::from_utf8_lossy(&fs::read(self.path("stderr")).unwrap()).into_owned())
    }

    /// Returns a random moment of an undisturbed run.
    fn moment(&mut self) -> Duration {
        self.duration.mul_f64(self.random.random_range(0.0..1.1))
    }

    /// Checks that no result differs from that of the undisturbed run; the record of the run itself may contain less.
    fn assert_no_half_file(&self, out: &str, fault: &str) {
        let found = files_in(&self.path(out));
        let wrong = differing(&found, &self.expected);
        let half: Vec<_> =
            wrong.iter().filter(|name| found.contains_key(*name) && *name != "run.json" && *name != "run.journal").collect();
        assert!(half.is_empty(), "{fault}: partly written files {half:?}");
    }

    /// Checks that the next run completes the work and gives the results of an undisturbed run.
    fn assert_recovers(&self, out: &str, fault: &str) {
        let (status, said) = self.end(self.run(out));
        assert_eq!(status, Some(0), "{fault}: the next run printed {said}");
        let wrong = differing(&files_in(&self.path(out)), &self.expected);
        assert!(wrong.is_empty(), "{fault}: after the next run these differ: {wrong:?}");
    }

    /// Checks that a failed run states the reason, without a panic.
    fn assert_said(status: Option<i32>, said: &str, fault: &str) {
        assert!(matches!(status, Some(0 | 1 | 3)), "{fault}: exit status {status:?}: {said}");
        assert!(status == Some(0) || said.contains("error:") || said.contains("failed"), "{fault}: no error message: {said}");
        assert!(!said.contains("panicked"), "{fault}: {said}");
    }

    fn note(&mut self, fault: &'static str, rounds: u64, ended: impl Into<String>) {
        self.table.push((fault, rounds, ended.into()));
    }

    fn kills(&mut self, rounds: u64) {
        let mut killed = 0;
        for round in 0..rounds {
            // Every third folder is killed again and again, as on a machine that keeps failing.
            let out = format!("killed-{}", round / 3);
            let moment = self.moment();
            let mut child = self.run(&out);
            std::thread::sleep(moment);
            child.kill().unwrap();
            killed += u64::from(self.end(child).0.is_none());
            self.assert_no_half_file(&out, "kill");
            if round % 3 == 2 || round + 1 == rounds {
                self.assert_recovers(&out, "kill");
            }
        }
        self.note("kill -9 at a random moment", rounds, format!("{killed} hit; no half file, next run ends with the same bytes"));
    }

    fn small_disk(&mut self, rounds: u64) {
        let largest = self.expected.values().map(Vec::len).max().unwrap_or(0);
        let mut refused = 0;
        for round in 0..rounds {
            let out = format!("limited-{round}");
            let blocks = self.random.random_range(0..=largest / 512);
            let (status, said) = self.end(self.run_in_shell(&format!("trap '' XFSZ; ulimit -f {blocks}; "), &out));
            Self::assert_said(status, &said, "file size limit");
            refused += u64::from(status != Some(0));
            self.assert_no_half_file(&out, "file size limit");
            self.assert_recovers(&out, "file size limit");
        }
        self.note(
            "files larger than a limit fail",
            rounds,
            format!("{refused} failed with a message; next run ends with the same bytes"),
        );
    }

    /// Whether this user may mount in a new namespace.
    fn may_mount() -> bool {
        let tried = Command::new("unshare").args(["-rm", "mount", "-t", "tmpfs", "none", "/mnt"]).stderr(Stdio::null()).status();
        tried.is_ok_and(|status| status.success())
    }

    /// Like [`Self::run`] in a namespace after the commands `mounts`, with `$2` the folder of results; results are copied to `$1` at the
    /// end.
    fn run_mounted(&self, mounts: &str, out: &str) -> (Option<i32>, String) {
        fs::create_dir_all(self.path("mounted")).unwrap();
        let line = format!(
            "{mounts}; \"$0\" run faces -o mounted/out -q; status=$?; cp -r mounted/out \"$1\" 2>/dev/null; exit $status"
        );
        self.end(self.start("unshare", &["-rm", "sh", "-c", &line, GRIMACE, out]))
    }

    fn full_disk(&mut self, rounds: u64) {
        if !Self::may_mount() {
            return self.note("disk full (tmpfs)", 0, "skipped: this user may not mount");
        }
        let all: usize = self.expected.values().map(Vec::len).sum();
        let mut refused = 0;
        for round in 0..rounds {
            let out = format!("full-{round}");
            let size = self.random.random_range(4096..all);
            let (status, said) = self.run_mounted(&format!("mount -t tmpfs -o size={size} none mounted"), &out);
            Self::assert_said(status, &said, "disk full");
            refused += u64::from(status != Some(0));
            self.assert_no_half_file(&out, "disk full");
            self.assert_recovers(&out, "disk full");
        }
        self.note("disk full (tmpfs)", rounds, format!("{refused} failed with a message; next run ends with the same bytes"));
    }

    fn read_only(&mut self) {
        if !Self::may_mount() {
            return self.note("read-only place", 0, "skipped: this user may not mount");
        }
        let (status, said) = self.run_mounted("mount -t tmpfs -o ro none mounted", "read-only");
        assert_eq!(status, Some(1), "read-only place: {said}");
        assert!(said.contains("mounted/out") && said.contains("Read-only"), "read-only place: {said}");
        self.note("read-only place", 1, "exit 1, the folder named");
    }

    fn few_handles(&mut self) {
        let (status, said) = self.end(self.run_in_shell("ulimit -n 24; ", "handles"));
        Self::assert_said(status, &said, "few file handles");
        self.assert_no_half_file("handles", "few file handles");
        self.assert_recovers("handles", "few file handles");
        self.note("24 file handles", 1, format!("exit {}; next run ends with the same bytes", status.unwrap_or(-1)));
    }

    fn failing_calls(&mut self, rounds: u64) {
        if !Command::new("strace").arg("-V").stdout(Stdio::null()).stderr(Stdio::null()).status().is_ok_and(|s| s.success()) {
            return self.note("failing system calls", 0, "skipped: no strace");
        }
        let faults = [
            ("write", "ENOSPC"),
            ("rename", "EIO"),
            ("openat", "EIO"),
            ("fsync", "EIO"),
            ("mkdir", "EACCES"),
            ("write", "EINTR"),
        ];
        let mut failed = 0;
        for round in 0..rounds {
            let (call, error) = faults[round as usize % faults.len()];
            let out = format!("injected-{round}");
            // The first files that are opened are libraries; without them no program can start.
            let first = if call == "openat" { 10 } else { 1 };
            let when = first + self.random.random_range(0..40);
            let inject = format!("inject={call}:error={error}:when={when}");
            let arguments = [
                "-f",
                "-o",
                "/dev/null",
                "-e",
                &format!("trace={call}"),
                "-e",
                &inject,
                GRIMACE,
                "run",
                "faces",
                "-o",
                &out,
                "-q",
            ];
            let (status, said) = self.end(self.start("strace", &arguments));
            let fault = format!("{inject} round {round}");
            Self::assert_said(status, &said, &fault);
            failed += u64::from(status != Some(0));
            self.assert_no_half_file(&out, &fault);
            self.assert_recovers(&out, &fault);
        }
        self.note("failing system calls", rounds, format!("{failed} failed with a message; next run ends with the same bytes"));
    }

    fn two_at_once(&mut self, rounds: u64) {
        for round in 0..rounds {
            let out = format!("twice-{round}");
            let first = self.run(&out);
            let moment = self.moment();
            std::thread::sleep(moment);
            let second = self.run(&out);
            let statuses = [self.end(first), self.end(second)];
            assert!(statuses.iter().any(|(status, _)| *status == Some(0)), "two runs: {statuses:?}");
            assert!(statuses.iter().all(|(_, said)| !said.contains("panicked")), "two runs: {statuses:?}");
            self.assert_no_half_file(&out, "two runs");
            self.assert_recovers(&out, "two runs");
        }
        self.note("two runs into one folder", rounds, "one at least ends well; next run ends with the same bytes");
    }

    fn one_bad_file(&mut self, batch: usize) {
        let tracks = self.path("tracks");
        fs::create_dir_all(&tracks).unwrap();
        let source = self.path("undisturbed/tracks");
        let (csv, json) = ("S001_005.csv", "S001_005.json");
        let record = fs::read_to_string(source.join(json)).unwrap();
        for k in 0..batch {
            fs::copy(source.join(csv), tracks.join(format!("P{k:03}_005.csv"))).unwrap();
            let own = record.replace("\"subject\": \"S001\"", &format!("\"subject\": \"P{k:03}\""));
            assert_ne!(own, record);
            fs::write(tracks.join(format!("P{k:03}_005.json")), own).unwrap();
        }
        let name = format!("P{:03}", batch - 3);
        let bad = tracks.join(format!("{name}_005.csv"));
        let whole = fs::read_to_string(&bad).unwrap();
        fs::remove_file(&bad).unwrap();
        let analyze = |out: &str| self.end(self.start(GRIMACE, &["analyze", "tracks", "-o", out, "-q"]));
        assert_eq!(analyze("without").0, Some(0));
        let broken: [Vec<u8>; 4] = [
            whole.as_bytes()[..whole.len() / 2].to_vec(),
            whole.replacen(",1.", ",1e30", 40).into_bytes(),
            b"PK\x03\x04\x00\xFF\xFE".to_vec(),
            Vec::new(),
        ];
        for bytes in &broken {
            fs::write(&bad, bytes).unwrap();
            let (status, said) = analyze("with");
            assert_eq!(status, Some(3), "one bad file: {said}");
            let (mut with, mut without) = (files_in(&self.path("with")), files_in(&self.path("without")));
            let failures = String::from_utf8_lossy(&with["failures.csv"]).into_owned();
            assert!(failures.contains(&name) && failures.lines().count() == 2, "{failures}");
            // The files that describe the failure differ, and the record with their hashes; all numbers are the same.
            for name in ["analyze.b3", "failures.csv", "report.html", "run.json"] {
                with.remove(name);
                without.remove(name);
            }
            assert_eq!(differing(&with, &without), Vec::<String>::new());
            fs::remove_dir_all(self.path("with")).unwrap();
        }
        let rounds = broken.len() as u64;
        self.note("one bad file among many", rounds, format!("among {batch}: exit 3, the file named, all numbers as without it"));
    }
}

const GRIMACE: &str = env!("CARGO_BIN_EXE_grimace");

/// Disturbs runs in a new folder and prints the results.
fn disturb(faults: impl FnOnce(&mut Bench, u64)) {
    let rounds = std::env::var("GRIMACE_FAULTS_ROUNDS").ok().and_then(|text| text.parse().ok()).unwrap_or(ROUNDS);
    let mut bench = Bench::new();
    faults(&mut bench, rounds);
    let rows = bench.table.iter().map(|(fault, rounds, ended)| format!("{fault:<34} {rounds:>7}  {ended}\n"));
    println!("{:<34} {:>7}  ended\n{}", "fault", "rounds", rows.collect::<String>());
}

#[test]
fn a_bad_file_among_many_fails_alone() {
    let batch = if std::env::var_os("GRIMACE_FAULTS_ROUNDS").is_some() { BATCH.1 } else { BATCH.0 };
    disturb(|bench, _| bench.one_bad_file(batch));
}

#[test]
fn after_kills_and_two_runs_at_once_results_are_complete_and_the_next_run_finishes_them() {
    disturb(|bench, rounds| {
        bench.kills(rounds * 3);
        bench.two_at_once(rounds);
    });
}

#[test]
fn after_failing_disks_and_calls_results_are_complete_and_the_next_run_finishes_them() {
    disturb(|bench, rounds| {
        bench.small_disk(rounds);
        bench.full_disk(rounds);
        bench.read_only();
        bench.few_handles();
        bench.failing_calls(rounds * 3);
    });
}
