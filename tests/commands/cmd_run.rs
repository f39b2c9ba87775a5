//! `grimace run`: commands and their output.

use crate::common::{FACES, Files, SEQUENCES, Work, assert_same_files, files_in, leftovers};
use std::{collections::BTreeSet, fs, sync::OnceLock, time::Duration};

/// Number of nodes of Candide-3.
const NODES: usize = 113;
/// Number of frames of each sequence.
const FRAMES: usize = 6;

#[test]
fn every_output_is_there_with_its_header_and_shape() {
    let work = Work::with_faces();
    let ran = work.grimace("run faces -o out").exit(0);
    ran.prints(&["6 sequences: 6 tracked, 0 unchanged, 0 failed", "3 sequences  out/fap/happiness.fap"]);
    let names: BTreeSet<String> = work.files("out").into_keys().collect();
    let mut expected: BTreeSet<String> = [
        "amplitudes.csv",
        "bands.csv",
        "failures.csv",
        "recognition.csv",
        "report.html",
        "run.json",
        "sequences.csv",
        "statistics.csv",
        "trimming.csv",
        "units.json",
        "variation.csv",
        "variation_scores.csv",
        "verdicts.csv",
    ]
    .map(str::to_owned)
    .into();
    for id in SEQUENCES {
        expected.extend([format!("tracks/{id}.csv"), format!("tracks/{id}.json"), format!("models/{id}.csv")]);
        expected.extend([format!("features/{id}.csv"), format!("features/{id}.json"), format!("fap/tracks/{id}.fap")]);
    }
    for emotion in ["happiness", "surprise"] {
        // Three people differ in two directions.
        expected
            .extend(["mean", "pc1_minus", "pc1_plus", "pc2_minus", "pc2_plus"].map(|m| format!("variation/{emotion}_{m}.csv")));
        expected.extend([
            format!("representatives/{emotion}.csv"),
            format!("representatives/{emotion}.json"),
            format!("fap/{emotion}.fap"),
            format!("features/{emotion}.svg"),
        ]);
    }
    assert_eq!(names, expected);

    for id in SEQUENCES {
        let track = format!("out/tracks/{id}.csv");
        assert_eq!(work.header(&track), "frame,node,x,y,state,residual,expected_error");
        let rows = work.rows(&track);
        assert_eq!(rows.len(), FRAMES * NODES);
        for (k, row) in rows.iter().enumerate() {
            assert_eq!(row["frame"], (k / NODES + 1).to_string());
            assert_eq!(row["node"], (k % NODES).to_string());
            assert!(row["x"].parse::<f64>().unwrap().is_finite() && row["y"].parse::<f64>().unwrap().is_finite());
            // In the neutral frame it is the error of the position, later that of the motion.
            assert!(row["expected_error"].parse::<f64>().is_ok_and(|e| e > 0.0), "{row:?}");
        }
        check_model(&work, &format!("out/models/{id}.csv"));
    }
    for emotion in ["happiness", "surprise"] {
        check_model(&work, &format!("out/representatives/{emotion}.csv"));
        let json: serde_json::Value = serde_json::from_str(&work.read(&format!("out/representatives/{emotion}.json"))).unwrap();
        assert_eq!(json["sequences"].as_array().unwrap().len(), 3);
        assert!(json["unit"].as_str().unwrap().contains("face unit"));
        assert!(json["dispersion"].as_f64().unwrap() > 0.0);
        // 5 key frames with 5 frames between every two.
        let fap = work.read(&format!("out/fap/{emotion}.fap"));
        assert!(fap.starts_with(&format!("2.1 {emotion} 25 25\n")), "{}", fap.lines().next().unwrap());
        work.grimace(&format!("fap check out/fap/{emotion}.fap")).exit(0);
    }
    let header = "emotion,sequences,dispersion,dispersion_untrimmed,sum_of_distances,gap,";
    assert!(work.header("out/statistics.csv").starts_with(header));
    let statistics = work.rows("out/statistics.csv");
    let emotions: Vec<_> = statistics.iter().map(|r| (r["emotion"].as_str(), r["sequences"].as_str())).collect();
    assert_eq!(emotions, [("happiness", "3"), ("surprise", "3")]);
    assert!(statistics.iter().all(|r| r["gap"].parse::<f64>().unwrap() <= 1e-3));
    assert_eq!(work.header("out/trimming.csv"), "emotion,frame,sequence,distance,dropped,id,subject");
    // 2 emotions, 4 displacement fields, 3 sequences; floor(0.1 * 3) = 0 are dropped.
    let trimming = work.rows("out/trimming.csv");
    assert_eq!(trimming.len(), 2 * 4 * 3);
    assert!(trimming.iter().all(|r| r["dropped"] == "false"));
    assert_eq!(work.read("out/failures.csv"), "subject,sequence,stage,reason,id\n");
    let verdicts = work.rows("out/verdicts.csv");
    assert_eq!(verdicts.len(), SEQUENCES.len());
    assert!(verdicts.iter().all(|r| (r["verdict"] == "good") == r["reasons"].is_empty()));
    let run: serde_json::Value = serde_json::from_str(&work.read("out/run.json")).unwrap();
    assert_eq!(run["complete"], true);
    assert_eq!(run["units"]["tracks"], "px");
    assert!(work.read("out/report.html").contains("</html>"));
}

/// Checks a model file: `frame,node,x,y`, frames 0 to 4, all nodes in order, frame 0 the canonical neutral with the eyes 1024 apart.
fn check_model(work: &Work, name: &str) {
    assert_eq!(work.header(name), "frame,node,x,y");
    let rows = work.rows(name);
    assert_eq!(rows.len(), 5 * NODES);
    for (k, row) in rows.iter().enumerate() {
        assert_eq!((&row["frame"], &row["node"]), (&(k / NODES).to_string(), &(k % NODES).to_string()));
    }
    // In Candide-3 the left mouth corner (31) mirrors the right one (64); y points up, and the mouth is below the eyes (y near
    // 0).
    let at = |node: usize, axis: &str| rows[node][axis].parse::<f64>().unwrap();
    assert_eq!(at(31, "x"), -at(64, "x"));
    assert!(at(31, "x") > 0.0 && at(31, "y") < at(20, "y"));
}

#[test]
fn bytes_do_not_depend_on_threads_or_on_the_run() {
    let work = Work::with_faces();
    for (out, threads) in [("one", 1), ("two", 2), ("again", 2)] {
        work.grimace(&format!("run faces -o {out} --threads {threads}")).exit(0);
    }
    assert_same_files(&work.files("one"), &work.files("two"));
    assert_same_files(&work.files("two"), &work.files("again"));
    // While another run writes into a folder, a second one is refused.
    let other = fs::File::open(work.path("two")).unwrap();
    other.lock().unwrap();
    work.grimace("run faces -o two --force").exit(1).says(&["two: another command is writing into this folder; wait for it"]);
    assert_same_files(&work.files("two"), &work.files("again"));
    drop(other);
    work.grimace("run faces -o two").exit(0);
}

#[test]
fn a_missing_column_is_reported_before_anything_is_tracked() {
    let work = Work::with_sequences(&["S001_005"]);
    for option in ["--by shoesize", "--by sex --strata shoesize"] {
        work.grimace(&format!("run faces -o out {option}")).exit(1).says(&["shoesize"]);
        assert!(!work.path("out/tracks").exists(), "{option}");
    }
    work.grimace("run faces -o out").exit(0);
}

#[test]
fn one_bad_sequence_fails_alone() {
    let work = Work::with_faces();
    work.write("faces/S002/007/correspondences.csv", "node,x,y\n20,80,60\n53,120,60\n");
    let frame = "faces/S003/005/S003_005_00000004.png";
    let bytes = work.bytes(frame);
    work.write(frame, &bytes[..bytes.len() / 2]);
    let ran = work.grimace("run faces -o out").exit(3).prints(&["6 sequences: 4 tracked, 0 unchanged, 2 failed"]);
    ran.says(&["S002_007", "2 correspondences; at least 3 are needed", "S003_005_00000004.png: the PNG image is cut off"]);
    let failures = work.rows("out/failures.csv");
    let short: Vec<_> = failures.iter().map(|f| (f["subject"].as_str(), f["sequence"].as_str(), f["stage"].as_str())).collect();
    assert_eq!(short, [("S002", "007", "fit"), ("S003", "005", "track")]);
    assert!(failures[0]["reason"].contains("S002/007/correspondences.csv"), "{}", failures[0]["reason"]);
    assert!(failures[1]["reason"].contains("S003_005_00000004.png"));
    assert!(!work.path("out/tracks/S003_005.csv").exists());
    assert_eq!(work.rows("out/statistics.csv").iter().map(|r| r["sequences"].clone()).collect::<Vec<_>>(), ["2", "2"]);
    // Failures are remembered: nothing changed, and some sequences are still failed.
    work.grimace("run faces -o out").exit(3).prints(&["nothing changed"]).says(&["failed: S002_007 at fit"]);
    // After a repair, only the failed sequences are processed.
    work.write(frame, &bytes);
    work.write("faces/S002/007/correspondences.csv", &FACES["S002/007/correspondences.csv"]);
    work.grimace("run faces -o out").exit(0).prints(&["6 sequences: 2 tracked, 4 unchanged, 0 failed"]);
    work.grimace("run faces -o fresh").exit(0);
    assert_same_files(&work.files("fresh"), &work.files("out"));
}

#[test]
fn when_all_sequences_are_bad_the_run_fails() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    for id in ["S001", "S002"] {
        work.write(&format!("faces/{id}/005/correspondences.csv"), "node,x,y\n");
    }
    let ran = work.grimace("run faces -o out").exit(1);
    ran.says(&["none of the 2 sequences could be processed", "at fit", "0 correspondences; at least 3 are needed"]);
    assert_eq!(work.rows("out/failures.csv").len(), 2);
    assert!(!work.path("out/report.html").exists());
}

#[test]
fn an_emotion_with_a_single_sequence_is_its_own_representative() {
    let work = Work::with_sequences(&["S001_005", "S002_005", "S003_007"]);
    let ran = work.grimace("run faces -o out").exit(0);
    ran.prints(&["note: ", "surprise", "a single sequence", "is its own representative and has no dispersion"]);
    assert_eq!(work.read("out/models/S003_007.csv"), work.read("out/representatives/surprise.csv"));
    let statistics = work.rows("out/statistics.csv");
    assert_eq!((statistics[1]["sequences"].as_str(), statistics[1]["dispersion"].as_str()), ("1", ""));
    assert_eq!(statistics[1]["sum_of_distances"], "0");
}

#[test]
fn groups_get_representatives_fap_files_and_rows() {
    let work = Work::with_faces();
    work.grimace("run faces -o out --by cohort,sex").exit(0);
    assert!(work.header("out/statistics.csv").ends_with(",cohort,sex"));
    let rows = work.rows("out/statistics.csv");
    for (cohort, sex) in [("A", "f"), ("A", "m"), ("B", "f")] {
        for emotion in ["happiness", "surprise"] {
            let stem = format!("{emotion}_cohort-{cohort}_sex-{sex}");
            assert!(work.path(&format!("out/representatives/{stem}.csv")).exists(), "{stem}");
            work.grimace(&format!("fap check out/fap/{stem}.fap")).exit(0);
            let of = |r: &&std::collections::BTreeMap<String, String>| {
                r["emotion"] == emotion && r["cohort"] == cohort && r["sex"] == sex && r["sequences"] == "1"
            };
            assert_eq!(rows.iter().filter(of).count(), 1, "{stem}");
        }
    }
    // In addition to the groups there is the class of all people.
    let all: Vec<_> = rows.iter().filter(|r| r["cohort"].is_empty() && r["sex"].is_empty()).map(|r| &r["sequences"]).collect();
    assert_eq!(all, ["3", "3"]);
    assert_eq!(rows.len(), 2 * 4);
    work.grimace("run faces -o persons --by subject").exit(0);
    assert_eq!(work.read("persons/models/S002_007.csv"), work.read("persons/representatives/surprise_subject-S002.csv"));
    // A missing column is reported before anything is tracked or written.
    work.grimace("run faces -o other --by nationality").exit(1).says(&["no sequence has a column `nationality`", "cohort, sex"]);
    assert!(work.files("other").is_empty());
}

#[test]
fn overlays_show_the_neutral_and_the_apex_frame() {
    let work = Work::with_sequences(&["S001_005"]);
    work.grimace("run faces -o out --overlay pictures").exit(0);
    let names: Vec<_> = work.files("pictures").into_keys().collect();
    assert_eq!(names, ["S001_005_00000001_overlay.png", "S001_005_00000006_overlay.png", "overlays.b3"]);
    // Another user's file with such a name is kept; overlays that no longer belong to the sequence are removed.
    work.write("others/S001_005_00000001_overlay.png", "mine");
    let ran = work.grimace("run faces -o out --overlay others").exit(0);
    ran.prints(&["1 overlay picture not written, because files of the same name exist that grimace did not write"]);
    assert_eq!(work.read("others/S001_005_00000001_overlay.png"), "mine");
    let manifest = work.read("faces/manifest.csv");
    work.write(
        "faces/manifest.csv",
        "subject,sequence,emotion,last_frame,correspondences\nS001,005,happiness,5,S001/005/correspondences.csv\n",
    );
    work.grimace("run faces -o shorter --overlay pictures").exit(0);
    let names: Vec<_> = work.files("pictures").into_keys().collect();
    assert_eq!(names, ["S001_005_00000001_overlay.png", "S001_005_00000005_overlay.png", "overlays.b3"]);
    work.write("faces/manifest.csv", manifest);
    work.grimace("run faces -o out --overlay pictures").exit(0);
    work.grimace("run faces -o out --plan --overlay pictures").exit(2).says(&["--overlay"]);
    let picture = image::load_from_memory(&work.bytes("pictures/S001_005_00000006_overlay.png")).unwrap().to_rgb8();
    let frame = image::load_from_memory(&work.bytes("faces/S001/005/S001_005_00000006.png")).unwrap().to_rgb8();
    assert_eq!(picture.width() * frame.height(), frame.width() * picture.height());
    assert!(picture.pixels().any(|p| p.0[0] != p.0[1] || p.0[1] != p.0[2]), "the wireframe is drawn in colour on grey");
}

/// Option of `env`: no matter what the tests' own parent ignores.
#[cfg(unix)]
const NO_SIGNAL_IGNORED: &str = "--default-signal=INT,TERM,HUP";

/// Interrupts a run when `enough` tracks exist. `signals` is an option of `env` for the signals that the run ignores. Returns the run's
/// output and status.
#[cfg(unix)]
fn interrupt(work: &Work, out: &str, (signal, signals): (&str, &str), enough: usize) -> crate::common::Ran {
    use std::process::Stdio;
    let plain = work.command();
    let mut command = std::process::Command::new("env");
    command.arg(signals).arg(plain.get_program()).args(["run", "faces", "-o", out, "-j", "1"]);
    command.current_dir(plain.get_current_dir().unwrap()).stdout(Stdio::piped()).stderr(Stdio::piped());
    for (name, value) in plain.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    let child = command.spawn().unwrap();
    let tracks = || fs::read_dir(work.path(out).join("tracks")).map_or(0, |entries| entries.flatten().count());
    let start = std::time::Instant::now();
    while tracks() < enough && start.elapsed() < Duration::from_secs(600) {
        std::thread::sleep(Duration::from_millis(1));
    }
    let kill = std::process::Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
    assert!(kill.success());
    child.wait_with_output().unwrap().into()
}

/// Makes a dataset with a long run, 24 sequences that share their frames, and in `whole` the results of an undisturbed run.
#[cfg(unix)]
fn long_dataset() -> Work {
    static WHOLE: OnceLock<Files> = OnceLock::new();
    let work = Work::with_sequences(&["S001_005"]);
    let mut manifest = "subject,sequence,emotion,frames,correspondences\n".to_owned();
    for k in 1..=24 {
        manifest += &format!("P{k:02},1,happiness,S001/005,S001/005/correspondences.csv\n");
    }
    work.write("faces/manifest.csv", manifest);
    let whole = WHOLE.get_or_init(|| {
        work.grimace("run faces -o whole").exit(0);
        work.files("whole")
    });
    for (name, bytes) in whole {
        work.write(&format!("whole/{name}"), bytes);
    }
    work
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_complete_files_and_the_next_one_finishes_it() {
    let work = long_dataset();
    for signal in ["-INT", "-TERM"] {
        let out = format!("out{signal}");
        let ran = interrupt(&work, &out, (signal, NO_SIGNAL_IGNORED), 5).exit(1);
        ran.says(&["interrupted; finished sequences are kept; run the same command again to continue"]);
        let files = work.files(&out);
        assert!(leftovers(&files).is_empty(), "{:?}", leftovers(&files));
        let done = files.keys().filter(|name| name.starts_with("tracks/") && name.ends_with(".json")).count();
        assert!((1..24).contains(&done), "{done} of 24 sequences were done");
        let whole = work.files("whole");
        for name in files.keys().filter(|name| name.starts_with("features/")) {
            assert!(files[name] == whole[name], "{name} differs from that of a whole run");
        }
        for name in files.keys().filter(|name| name.ends_with(".csv") && !name.starts_with("features/")) {
            let rows = work.rows(&format!("{out}/{name}")).len();
            assert_eq!(rows % NODES, 0, "{name} has {rows} rows");
        }
        work.grimace(&format!("run faces -o {out}")).exit(0).prints(&["unchanged, 0 failed"]);
        assert_same_files(&work.files("whole"), &work.files(&out));
    }
}

#[cfg(unix)]
#[test]
fn a_run_goes_on_when_its_terminal_closes_if_its_parent_wants_that() {
    let work = long_dataset();
    interrupt(&work, "out", ("-HUP", "--ignore-signal=HUP"), 5).exit(0);
    assert_same_files(&work.files("whole"), &work.files("out"));
}

#[cfg(unix)]
#[test]
fn a_killed_run_leaves_no_partial_file_with_the_name_of_a_result() {
    let work = long_dataset();
    let ran = interrupt(&work, "out", ("-KILL", NO_SIGNAL_IGNORED), 5);
    assert_eq!(ran.status, None);
    let whole = work.files("whole");
    let files = work.files("out");
    for name in files.keys().filter(|name| name.starts_with("tracks/") && !name.contains("/.")) {
        assert!(files[name] == whole[name], "{name} differs from that of a whole run");
    }
    work.grimace("run faces -o out").exit(0);
    let named = |files: Files| files.into_iter().filter(|(name, _)| !name.ends_with(".tmp")).collect();
    assert_same_files(&whole, &named(work.files("out")));
}

#[test]
fn an_output_that_cannot_be_written_is_reported() {
    let work = Work::with_sequences(&["S001_005"]);
    work.write("file", "x");
    work.grimace("run faces -o file/out").exit(1).says(&["cannot write file/out"]);
    work.grimace("run faces -o file").exit(1).says(&["file"]);
    assert_eq!(work.read("file"), "x");
}

/// `ulimit -f` simulates a full disk: it limits the size of a file in blocks of 512 bytes, and writing more is an error.
#[cfg(unix)]
#[test]
fn a_full_disk_ends_the_run_with_a_clear_error_and_no_partial_file() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    for (blocks, file) in [(0, "run.json"), (16, "out16/tracks/S00"), (120, "report.html")] {
        let out = format!("out{blocks}");
        let ran = work.shell(&format!("ulimit -f {blocks}; exec \"$GRIMACE\" run faces -o {out} -j 1 2>{out}.txt || exit $?"));
        // The limit also applies to the file of standard error: with 0 blocks no message can be written.
        assert_eq!(ran.status, Some(1), "{blocks}");
        let said = work.read(&format!("{out}.txt"));
        if blocks > 0 {
            assert!(said.contains("cannot write") && said.contains(file), "{said}");
            assert!(said.to_lowercase().contains("too large"), "{said}");
        }
        let files = work.files(&out);
        assert!(leftovers(&files).is_empty(), "{:?}", leftovers(&files));
        assert!(files.keys().all(|name| !name.contains("report.html")));
        // With free space the run continues.
        work.grimace(&format!("run faces -o {out}")).exit(0);
    }
    assert_same_files(&work.files("out16"), &work.files("out120"));
    assert_same_files(&files_in(&work.path("out0")), &work.files("out120"));
}
