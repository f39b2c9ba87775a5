//! The main job over real sequences, where the project's shared data is beside the repository; said loudly where it is not.

use std::path::{Path, PathBuf};

use crate::common::Work;
use grimace::internal::fap::{FapNumber, read_fap};

fn sequences() -> Option<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/sequences");
    let found = folder.join("manifest.csv").is_file();
    if !found {
        eprintln!("SKIPPED, NOTHING WAS TESTED: {} is not there", folder.display());
    }
    found.then_some(folder)
}

#[test]
fn real_sequences_give_representatives_with_the_signs_of_their_expressions() {
    let Some(folder) = sequences() else { return };
    let work = Work::new();
    let output = work.command().arg("run").arg(&folder).args(["-o", "out"]).output().unwrap();
    let ran = crate::common::Ran::from(output).exit(0);
    assert!(ran.stdout.contains(" 0 failed"), "{}", ran.stdout);
    assert_eq!(work.read("out/failures.csv").lines().count(), 1);
    let signs: [(&str, f64, &[u8]); 5] = [
        ("happiness", 1.0, &[53, 54, 59, 60]),
        ("surprise", 1.0, &[31, 32, 33, 34, 35, 36]),
        ("surprise", -1.0, &[52]),
        ("anger", -1.0, &[31, 32, 33, 34, 35, 36]),
        ("mouth_open", -1.0, &[52]),
    ];
    for (emotion, sign, faps) in signs {
        let sequence = read_fap(&work.path(&format!("out/fap/{emotion}.fap"))).unwrap().sequence;
        let apex = sequence.frames.last().unwrap();
        for &fap in faps {
            let value = apex.value(FapNumber::try_from(fap).unwrap()).unwrap();
            assert!(value * sign > 0.0, "{emotion}: FAP {fap} is {value} at the apex");
        }
    }
    for row in work.rows("out/statistics.csv") {
        assert!(row["gap"].parse::<f64>().unwrap() <= 1e-3, "greedy gap of {}: {}", row["emotion"], row["gap"]);
        assert!(row["certificate_gap"].parse::<f64>().unwrap() <= 1e-9, "certificate of {}", row["emotion"]);
    }
}
