//! People who did not agree to publication are counted, but not shown.

use crate::common::Work;
use serde_json::Value;

/// Returns the parsed data of a report.
fn data(html: &str) -> Value {
    let start = html.find(r#"id="data">"#).unwrap() + r#"id="data">"#.len();
    let length = html[start..].find("</script>").unwrap();
    serde_json::from_str(&html[start..start + length]).unwrap()
}

/// Makes a dataset in which S001 and S002 smile, and S001 does not agree to be shown.
fn work() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    let manifest = work.read("faces/manifest.csv");
    let line = |line: &str| match line {
        _ if line.starts_with("subject") => format!("{line},publish\n"),
        _ if line.starts_with("S001") => format!("{line},no\n"),
        _ => format!("{line},\n"),
    };
    work.write("faces/manifest.csv", manifest.lines().map(line).collect::<String>());
    work
}

#[test]
fn people_without_consent_are_counted_but_not_shown() {
    let work = work();
    work.grimace("run faces -o out --overlay pictures -q").exit(0);
    let report = data(&work.read("out/report.html"));
    let pictures = |row: usize| report["tracks"][row][13].clone();
    assert_eq!((&report["ids"][0][0], pictures(0)), (&Value::from("S001"), Value::Null));
    for picture in pictures(1).as_array().unwrap() {
        let base64 = picture.as_str().unwrap();
        // JPEG of at most 6 kB: four characters of Base64 are three bytes.
        assert!(base64.starts_with("/9j/") && base64.len() <= 8000, "{}", base64.len());
    }
    assert!(!report["player"].is_null());
    let overlays: Vec<String> = work.files("pictures").into_keys().filter(|name| name.ends_with(".png")).collect();
    assert_eq!(overlays.len(), 2);
    assert!(overlays.iter().all(|name| name.starts_with("S002_005")), "{overlays:?}");
    let rows = work.rows("out/statistics.csv");
    assert_eq!(rows[0]["sequences"], "2");

    // With wireframes only there are no pictures, and the numbers are the same.
    work.grimace("run faces -o plain --no-faces -q").exit(0);
    let html = work.read("plain/report.html");
    let plain = data(&html);
    assert!(plain["tracks"].as_array().unwrap().iter().all(|row| row[13].is_null()) && plain["player"].is_null());
    assert!(!html.contains("/9j/"), "a JPEG");
    assert_eq!(work.read("plain/statistics.csv"), work.read("out/statistics.csv"));
    work.grimace("run faces -o x --no-faces --overlay y").exit(2).says(&["--no-faces", "--overlay"]);
}

#[test]
fn pictures_of_people_who_withdraw_consent_are_removed_or_reported() {
    let work = work();
    let agreed = work.read("faces/manifest.csv").replace(",no", ",yes");
    let withdrawn = work.read("faces/manifest.csv");
    work.write("faces/manifest.csv", agreed).grimace("run faces -o out --overlay out/overlays -q").exit(0);
    assert_eq!(work.files("out/overlays").keys().filter(|name| name.ends_with(".png")).count(), 4);
    // The folder of overlays belongs to the user: nothing in it is removed.
    work.write("faces/manifest.csv", withdrawn);
    work.grimace("run faces -o out").exit(0).prints(&["out/overlays: 2 pictures of people who may not be shown"]);
    assert_eq!(work.files("out/overlays").keys().filter(|name| name.ends_with(".png")).count(), 4);
}

#[test]
fn a_clone_does_not_show_people_without_consent() {
    let work = work();
    work.grimace("run faces -o out -q").exit(0);
    let clone = |more: &str| {
        let target = "--target faces/S002/005/S002_005_00000001.png --correspondences faces/S002/005/correspondences.csv";
        work.grimace(&format!("clone --source out/tracks/S001_005.csv {target} -o clone {more} -q"))
    };
    clone("--source-frames faces/S001/005").exit(1).says(&["`publish`", "forbids showing pictures of this person"]);
    clone("").exit(0);
}
