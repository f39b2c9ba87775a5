//! Effects of expressions on the skin, collected by `run` and applied by `clone`.

use crate::common::{Work, files_in, root};
use serde_json::Value;

/// Makes a dataset of five smiling people: four simulated ones, and the first of them again under a second name.
fn work() -> Work {
    let work = Work::new();
    for (name, bytes) in files_in(&root().join("fixtures/simulated")) {
        if name.contains("/005/") {
            work.write(&format!("faces/{name}"), bytes);
        }
    }
    let row = |subject: &str, folder: &str| format!("{subject},005,happiness,{folder}/005,{folder}/005/correspondences.csv\n");
    let rows: String = ["S001", "S002", "S003", "S004"].iter().map(|s| row(s, s)).chain([row("S005", "S001")]).collect();
    work.write("faces/manifest.csv", format!("subject,sequence,emotion,frames,correspondences\n{rows}"));
    work
}

fn json(work: &Work, name: &str) -> Value {
    serde_json::from_slice(&work.bytes(name)).unwrap()
}

#[test]
fn a_run_collects_the_skin_of_a_class_and_a_clone_puts_it_on() {
    let work = work();
    // The other emotion is shown by fewer people than a skin needs.
    let row = |s: &str| format!("{s},006,surprise,{s}/005,{s}/005/correspondences.csv\n");
    let rows = work.read("faces/manifest.csv") + &row("S001") + &row("S002");
    work.write("faces/manifest.csv", rows);
    work.grimace("run faces -o out -q").exit(0);
    let why = json(&work, "out/representatives/surprise.json")["no_skin"].clone();
    assert_eq!(why, "2 people have pictures that show folds; at least 5 are needed");
    let skin = work.bytes("out/representatives/happiness_skin.png");
    let about = json(&work, "out/representatives/happiness.json");
    assert_eq!((&about["skin_people"], &about["no_skin"]), (&Value::from(5), &Value::Null));
    assert!(json(&work, "out/run.json")["outputs"]["representatives/happiness_skin.png"].is_string());

    let target = "--target faces/S002/005/S002_005_00000001.jpg --correspondences faces/S002/005/correspondences.csv --fps 4";
    let clone = |source: &str, out: &str, more: &str| {
        work.grimace(&format!("clone --source {source} {target} -o {out} {more} -q")).exit(0);
        json(&work, &format!("{out}/clone.json"))
    };
    let last = |out: &str| work.bytes(&format!("{out}/frames/S002_005_00000001_00000005.png"));
    assert_eq!(clone("out/representatives/happiness.csv", "with", "")["skin"], "happiness_skin.png");
    assert_eq!(clone("out/representatives/happiness.csv", "without", "--skin none")["skin"], Value::Null);
    assert_ne!(last("with"), last("without"));
    let first = |out: &str| work.bytes(&format!("{out}/frames/S002_005_00000001_00000001.png"));
    assert_eq!(first("with"), first("without"));

    // A FAP file has no class: it gets the folds of its form. On request a representative does, too.
    let of_form = clone("out/fap/happiness.fap", "fap", "");
    assert_eq!((&of_form["skin"], &of_form["skin_blake3"]), (&Value::from("form"), &Value::Null));
    assert_eq!(clone("out/representatives/happiness.csv", "form", "--skin form")["skin"], "form");
    assert!([last("with"), last("without")].iter().all(|other| *other != last("form")));
    assert_eq!(first("form"), first("without"));
    clone("out/fap/happiness.fap", "fap_with", "--skin out/representatives/happiness.csv");
    assert_ne!(last("fap"), last("fap_with"));
    work.grimace(&format!("clone --source out/fap/happiness.fap {target} -o x --skin out/fap/happiness.fap"))
        .exit(1)
        .says(&["this is not a representative"]);

    // The same bytes again. Without consent there is no skin, and the earlier one is removed.
    work.grimace("run faces -o again -q").exit(0);
    assert_eq!(work.bytes("again/representatives/happiness_skin.png"), skin);
    work.grimace("run faces -o again -q --no-faces --force").exit(0);
    assert!(!work.files("again").contains_key("representatives/happiness_skin.png"));
    let why = json(&work, "again/representatives/happiness.json")["no_skin"].clone();
    assert_eq!(why, "no sequence has pictures that may be shown (0 use landmarks only, 5 show people who may not be shown)");
}

#[test]
fn four_people_have_no_common_skin_and_the_reason_is_given() {
    let work = work();
    let four: String = work.read("faces/manifest.csv").lines().take(5).map(|l| format!("{l}\n")).collect();
    work.write("faces/manifest.csv", four);
    work.grimace("run faces -o out -q").exit(0);
    assert!(!work.files("out").contains_key("representatives/happiness_skin.png"));
    let why = json(&work, "out/representatives/happiness.json")["no_skin"].clone();
    assert!(why.as_str().unwrap().starts_with("4 people have pictures that show folds; at least 5"), "{why}");
}
