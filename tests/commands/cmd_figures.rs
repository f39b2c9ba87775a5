//! `grimace figures` end to end.

use crate::common::Work;

/// Makes a grouped run of three people with two emotions.
fn work() -> Work {
    let work = Work::with_sequences(&["S001_005", "S001_007", "S002_005", "S002_007", "S003_005", "S003_007"]);
    work.grimace("run faces -o results --by cohort -q").exit(0);
    work
}

#[test]
fn a_run_gives_figures_as_svg_and_pdf_with_captions() {
    let work = work();
    work.grimace("figures results -o figures").exit(0).prints(&["each as .svg and .pdf; captions: figures/captions.md"]);
    let rows = work.rows("figures/captions.csv");
    let of = |name: &str| rows.iter().find(|r| r["figure"] == name).unwrap_or_else(|| panic!("{name}: {rows:?}"));
    for name in [
        "representatives",
        "fields_happiness",
        "dispersion_happiness",
        "distances_happiness",
        "courses_happiness",
        "bands_happiness",
    ] {
        let row = of(name);
        let svg = work.read(&format!("figures/{name}.svg"));
        assert!(svg.starts_with("<svg xmlns=") && svg.ends_with("</svg>\n") && !svg.contains("NaN"), "{name}");
        assert!(work.files("figures")[&format!("{name}.pdf")].starts_with(b"%PDF-"), "{name}");
        assert!(work.read("figures/captions.md").contains(&row["caption"]), "{name}");
    }
    // Three people smile once each; a tenth of three is less than one.
    let happiness = of("fields_happiness");
    assert_eq!((happiness["sequences"].as_str(), happiness["people"].as_str(), happiness["alpha"].as_str()), ("3", "3", "0.1"));
    assert!(happiness["method"].ends_with("equal weight for every person, default method of grimace"), "{}", happiness["method"]);
    assert!(happiness["method"].contains("greedy generalized median, nothing trimmed (too few models for 10 %)"));
    assert!(
        happiness["caption"].contains("3 sequences of 3 people")
            && happiness["caption"].contains("The subject\u{2019}s left is on the right")
    );
    // Six sequences of three people in total.
    assert_eq!((of("representatives")["sequences"].as_str(), of("representatives")["people"].as_str()), ("6", "3"));
    // A single sequence has no dispersion.
    assert!(rows.iter().all(|r| r["figure"] != "dispersion_happiness_cohort-B"));
    // All fields of the run are drawn at the same scale.
    let scale = |name: &str| {
        let svg = work.read(&format!("figures/fields_{name}.svg"));
        let at = svg.find("arrows are ").unwrap();
        svg[at..at + 20].to_owned()
    };
    assert_eq!(scale("happiness"), scale("surprise"));

    // The same input gives the same bytes; no file is overwritten.
    work.grimace("figures results -o again -q").exit(0).prints(&[]);
    assert!(work.files("figures") == work.files("again"), "the same bytes");
    work.grimace("figures results -o figures").exit(1).says(&["figures is not empty; choose another folder, or give --force"]);
    work.grimace("figures results -o figures --force -q").exit(0);
    let mine = work.path("figures/captions.csv");
    std::fs::write(&mine, "mine").unwrap();
    let foreign = "captions.csv: this file exists and differs from what an earlier `figures` wrote";
    work.grimace("figures results -o figures --force -q").exit(1).says(&[foreign]);
    assert_eq!(std::fs::read(&mine).unwrap(), b"mine");
    std::fs::remove_file(&mine).unwrap();
    let record = std::fs::File::options().append(true).open(work.path("figures/figures.b3")).unwrap();
    record.lock().unwrap();
    work.grimace("figures results -o figures --force -q").exit(1).says(&["another command is writing into this folder"]);
    drop(record);
    work.grimace("figures results -o figures --force -q").exit(0);
    work.write("file", "").grimace("figures results -o file --force").exit(1).says(&["file: this is a file"]);
    // A run that has not finished is reported.
    work.write("results/run.journal", "representatives/happiness.csv\t\n");
    let record = work.read("results/run.json");
    work.write("results/run.json", record.replacen("\"complete\": true", "\"complete\": false", 1));
    work.grimace("figures results -o half -q").exit(0).says(&["note: results: the run is not finished (run.journal exists)"]);
    // A journal left behind by a finished run is not.
    work.write("results/run.json", record);
    let whole = work.grimace("figures results -o whole -q").exit(0);
    assert!(!whole.stderr.contains("not finished"), "{}", whole.stderr);
    std::fs::remove_file(work.path("results/run.journal")).unwrap();
    // Missing files are reported.
    let record = work.read("results/run.json");
    for name in ["bands.csv", "trimming.csv", "features/S001_005.csv"] {
        std::fs::remove_file(work.path(&format!("results/{name}"))).unwrap();
    }
    work.grimace("figures results -o fewer -q").exit(0).says(&[
        "note: results: bands.csv is missing: the figures of FAPs over time are left out",
        "note: results: trimming.csv is missing",
        "note: results: features/ has no table of 1 of 6 sequences",
    ]);
    // Truncated records and records of a newer version are reported as such.
    for text in ["", &record[..record.len() / 2], &format!("\u{feff}{record}")] {
        work.write("results/run.json", text);
        for command in
            ["figures results -o none", "annotate --tracks results", "recognize results --with results", "run faces -o results"]
        {
            work.grimace(command).exit(1).says(&["results/run.json: damaged (", "restore it"]);
        }
    }
    work.write("results/run.json", record.replacen("\"schema_version\": 1", "\"schema_version\": 9", 1));
    for command in
        ["figures results -o none", "annotate --tracks results", "recognize results --with results", "run faces -o results"]
    {
        work.grimace(command).exit(1).says(&["results/run.json: schema version 9; this program reads 1"]);
    }
    work.write("results/run.json", &record);
    let about = work.read("results/representatives/happiness.json");
    work.write("results/representatives/happiness.json", about.replacen("\"schema_version\": 1", "\"schema_version\": 9", 1));
    work.grimace("figures results -o none")
        .exit(1)
        .says(&["representatives/happiness.json: schema version 9; this program reads 1"]);
    let info = work.read("results/tracks/S001_005.json");
    work.write("results/tracks/S001_005.json", info.replacen("\"schema_version\": 2", "\"schema_version\": 9", 1));
    for command in ["features results/tracks/S001_005.csv -o f", "analyze results/tracks/S001_005.csv -o a"] {
        work.grimace(command).exit(1).says(&["tracks/S001_005.json: schema version 9; this program reads 2"]);
    }
    // Times that cannot belong to the track.
    let number = info.find("\"fps\": ").unwrap() + 7;
    let end = number + info[number..].find(',').unwrap();
    for (fps, said) in [
        ("-5", "`fps` is -5"),
        ("0", "`fps` is 0"),
        ("1e9", "`fps` is 1000000000"),
        ("25, \"times\": [0, 1]", "`times` has 2 times"),
        ("25, \"times\": [0, 2, 1, 3, 4, 5]", "`times` has 1 after 2"),
    ] {
        work.write("results/tracks/S001_005.json", format!("{} {fps}{}", &info[..number], &info[end..]));
        work.grimace("features results/tracks/S001_005.csv -o f").exit(1).says(&[
            "tracks/S001_005.json: ",
            said,
            "track the sequence again",
        ]);
        work.grimace("analyze results/tracks/S001_005.csv -o a").exit(1).says(&[said]);
    }
    // There are no pictures of faces, only wireframes.
    assert!(work.files("figures").values().all(|bytes| !bytes.windows(6).any(|w| w == b"<image" || w == b"/Image")));
}

#[test]
fn an_input_that_is_not_a_run_is_reported() {
    let work = Work::new();
    work.grimace("figures nothing -o figures").exit(1).says(&["nothing: this folder has no representatives"]);
    assert!(!work.path("figures").exists());
    work.write("bad/representatives/anger.csv", "frame,node,x,y\n0,0,1,1\n1,0,1,1\n")
        .write("bad/representatives/anger.json", "{");
    work.grimace("figures bad -o figures").exit(1).says(&["anger.csv"]);
    work.grimace("figures --help").exit(0).prints(&["grimace figures results -o figures"]);
}
