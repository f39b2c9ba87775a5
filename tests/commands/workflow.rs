//! The Snakemake workflow: it is killed, resumed, and its results are compared byte by byte with those of a plain run.
//!
//! Snakemake comes from `scripts/workflow_setup`; without it the tests print that they were skipped.

use std::{
    os::unix::process::CommandExt,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use crate::common::{Work, assert_same_files};

const OPTIONS: &str = "--by cohort --permutations 99 --bootstrap 99";

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn snakemake() -> Option<PathBuf> {
    let path = std::env::var_os("SNAKEMAKE").map_or_else(|| root().join("target/workflow-venv/bin/snakemake"), PathBuf::from);
    if !path.exists() {
        eprintln!("SKIPPED tests of the workflow: {} does not exist; scripts/workflow_setup installs it", path.display());
        return None;
    }
    Some(path)
}

/// Returns the command that runs the workflow on `faces` into `flow` on two cores, with this program.
fn workflow(snakemake: &Path, work: &Work, profile: &str, grimace: &Path) -> Command {
    let mut command = Command::new(snakemake);
    command.current_dir(work.path("."));
    command.arg("--snakefile").arg(root().join("workflow/Snakefile"));
    command.arg("--workflow-profile").arg(root().join("workflow/profiles").join(profile));
    command.args(["--cores", "2", "--config", "dataset=faces", "out=flow"]);
    command.arg(format!("grimace={}", grimace.display())).arg(format!("options={OPTIONS}"));
    command
}

#[test]
fn a_killed_and_resumed_workflow_gives_the_bytes_of_a_plain_run() {
    let Some(snakemake) = snakemake() else { return };
    let work = Work::with_faces();
    // One sequence fails on purpose.
    std::fs::remove_dir_all(work.path("faces/S003/007")).unwrap();
    work.grimace(&format!("run faces -o plain {OPTIONS}")).exit(3);
    // Slow enough to be interrupted.
    let slow = work.path("slow.sh");
    work.write("slow.sh", format!("#!/bin/sh\nsleep 1\nexec {} \"$@\"\n", crate::common::grimace().display()));
    Command::new("chmod").arg("+x").arg(&slow).status().unwrap();

    let mut command = workflow(&snakemake, &work, "local", &slow);
    let mut running = command.process_group(0).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    let done = || work.files("flow.workflow").keys().filter(|name| name.starts_with("part-")).count();
    let started = Instant::now();
    while done() < 2 {
        assert!(started.elapsed() < Duration::from_secs(300), "no job was done");
        assert!(running.try_wait().unwrap().is_none(), "the workflow ended early");
        thread::sleep(Duration::from_millis(50));
    }
    // The process group has the workflow with all its jobs, and nothing else.
    Command::new("kill").args(["-KILL", "--", &format!("-{}", running.id())]).status().unwrap();
    running.wait().unwrap();
    assert!(done() < 6 && !work.path("flow.workflow/complete").exists(), "the workflow was killed too late for the test");

    let program = crate::common::grimace();
    assert!(workflow(&snakemake, &work, "local", program).arg("--unlock").output().unwrap().status.success());
    let resumed = workflow(&snakemake, &work, "local", program).output().unwrap();
    assert!(resumed.status.success(), "{}", String::from_utf8_lossy(&resumed.stderr));
    assert_same_files(&work.files("plain"), &work.files("flow"));
    // Complete parts are not repeated.
    let again = workflow(&snakemake, &work, "local", program).output().unwrap();
    assert!(String::from_utf8_lossy(&again.stderr).contains("Nothing to be done"));
}

#[test]
fn batches_of_sequences_give_the_same_bytes_in_fewer_jobs() {
    let Some(snakemake) = snakemake() else { return };
    let work = Work::with_faces();
    work.grimace(&format!("run faces -o plain {OPTIONS}")).exit(0);
    let mut command = workflow(&snakemake, &work, "local", crate::common::grimace());
    let ran = command.arg("batch=4").output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    // 6 sequences, 4 per job: 2 jobs.
    assert!(work.path("flow.workflow/part-2-of-2").exists());
    assert_same_files(&work.files("plain"), &work.files("flow"));
}

/// Uses a real Slurm cluster on this machine (`scripts/with_slurm`). Without Slurm or the executor's plugin it prints that it was skipped.
#[test]
fn on_a_slurm_cluster_it_gives_the_bytes_of_a_plain_run() {
    let Some(snakemake) = snakemake() else { return };
    let with_slurm = root().join("scripts/with_slurm");
    let cluster = Command::new(&with_slurm).arg("true").output().unwrap();
    if cluster.status.code() == Some(77) {
        return eprintln!("SKIPPED the workflow on Slurm: {}", String::from_utf8_lossy(&cluster.stderr).trim());
    }
    assert!(cluster.status.success(), "{}", String::from_utf8_lossy(&cluster.stderr));
    let help = Command::new(&snakemake).arg("--help").output().unwrap();
    if !String::from_utf8_lossy(&help.stdout).contains("--slurm-status-command") {
        return eprintln!("SKIPPED the workflow on Slurm: no snakemake-executor-plugin-slurm; scripts/test_slurm installs it");
    }
    let work = Work::with_faces();
    work.grimace(&format!("run faces -o plain {OPTIONS}")).exit(0);
    let mut command = Command::new(with_slurm);
    command.current_dir(work.path(".")).arg(snakemake);
    command.arg("--snakefile").arg(root().join("workflow/Snakefile"));
    command.arg("--workflow-profile").arg(root().join("workflow/profiles/slurm"));
    // The cluster keeps no accounting, and is polled often.
    command.args(["--slurm-status-command", "squeue", "--slurm-init-seconds-before-status-checks", "2"]);
    command.args(["--seconds-between-status-checks", "2", "--jobs", "2", "--config", "dataset=faces", "out=flow", "threads=1"]);
    command.arg(format!("grimace={}", crate::common::grimace().display())).arg(format!("options={OPTIONS}")).arg("batch=4");
    let ran = command.output().unwrap();
    assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr));
    assert!(work.path("flow.workflow/part-2-of-2").exists());
    assert_same_files(&work.files("plain"), &work.files("flow"));
}
