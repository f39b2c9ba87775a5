//! `grimace fit`: commands and their output.

use crate::common::Work;

/// Makes a folder with `neutral.png`, its `marks.csv`, and the sequence that they come from.
fn work() -> Work {
    let work = Work::with_sequences(&["S001_005"]);
    work.write("neutral.png", work.bytes("faces/S001/005/S001_005_00000001.png"));
    work.write("marks.csv", work.bytes("faces/S001/005/correspondences.csv"));
    work
}

/// Returns x and y of a row.
fn place(row: &std::collections::BTreeMap<String, String>) -> (f64, f64) {
    (row["x"].parse().unwrap(), row["y"].parse().unwrap())
}

#[test]
fn every_node_comes_out_with_state_and_residual() {
    let work = work();
    let ran = work.grimace("fit neutral.png --correspondences marks.csv -o fit.csv --overlay fit.png").exit(0);
    ran.prints(&["11 marks (0 hard), eye distance", "roll", "largest distance of a node to its mark"]);
    assert_eq!(work.header("fit.csv"), "node,x,y,state,residual");
    let rows = work.rows("fit.csv");
    assert_eq!(rows.len(), 113);
    let marks = work.rows("marks.csv");
    for (k, row) in rows.iter().enumerate() {
        assert_eq!(row["node"], k.to_string());
        match marks.iter().find(|m| m["node"] == row["node"]) {
            Some(mark) => {
                assert_eq!(row["state"], "marked");
                let ((x, y), (u, v)) = (place(row), place(mark));
                let residual: f64 = row["residual"].parse().unwrap();
                assert!((residual - (x - u).hypot(y - v)).abs() < 1e-6, "node {k}");
                assert!(residual < 2.0, "node {k} is {residual} px from its mark");
            }
            None => assert!(row["residual"].is_empty() && ["fitted", "follows"].contains(&row["state"].as_str())),
        }
    }
    // Nodes 4, 35 to 39 and 41 to 43 are in no triangle.
    let follows: Vec<_> = rows.iter().filter(|r| r["state"] == "follows").map(|r| r["node"].clone()).collect();
    assert_eq!(follows, ["4", "35", "36", "37", "38", "39", "41", "42", "43"]);
    assert!(image::load_from_memory(&work.bytes("fit.png")).unwrap().width() >= 200);
}

#[test]
fn the_fit_is_near_the_true_nodes() {
    let work = work();
    work.write("exact.csv", {
        let truth = String::from_utf8(crate::common::FACES["truth/S001_005.csv"].clone()).unwrap();
        let marked = ["20", "23", "53", "56", "31", "64", "10", "26", "59"];
        let line = |line: &str| {
            let fields: Vec<&str> = line.split(',').collect();
            (fields[0] == "1" && marked.contains(&fields[1])).then(|| fields[1..].join(","))
        };
        format!("node,x,y\n{}\n", truth.lines().filter_map(line).collect::<Vec<_>>().join("\n"))
    });
    work.grimace("fit neutral.png -c exact.csv -o fit.csv").exit(0);
    let truth = String::from_utf8(crate::common::FACES["truth/S001_005.csv"].clone()).unwrap();
    let truth: Vec<(f64, f64)> = csv::Reader::from_reader(truth.as_bytes())
        .deserialize::<(u32, usize, f64, f64)>()
        .map(Result::unwrap)
        .filter(|row| row.0 == 1)
        .map(|row| (row.2, row.3))
        .collect();
    let rows = work.rows("fit.csv");
    let errors: Vec<f64> = rows.iter().map(place).zip(&truth).map(|((x, y), (u, v))| (x - u).hypot(y - v)).collect();
    let eyes = (truth[20].0 - truth[53].0).abs();
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    // Nine exact marks for 113 nodes: a prototype with seven noisy marks had an error of 4.4 % of the eye distance.
    assert!(mean < 0.05 * eyes, "mean error {mean:.2} px with outer eye corners {eyes:.1} px apart");
}

#[test]
fn nodes_set_by_hand_are_hard_positions() {
    let work = work();
    let marks: Vec<String> = work.read("marks.csv").lines().skip(1).map(|line| format!("{line},")).collect();
    let file = |first: &str| format!("node,x,y,kind\n{first}\n{}\n", marks.join("\n"));
    // 8.4 is the right mouth corner, node 64, which is already marked.
    work.write("hard.csv", file("8.4,60,120,hard"));
    work.grimace("fit neutral.png -c hard.csv -o fit.csv").exit(1).says(&["hard.csv, line 8: node 64 is already in line 2"]);
    work.write("hard.csv", file("5,101.25,92.5,hard"));
    work.grimace("fit neutral.png -c hard.csv -o fit.csv").exit(0).prints(&["12 marks (1 hard)"]);
    let rows = work.rows("fit.csv");
    assert_eq!((rows[5]["x"].as_str(), rows[5]["y"].as_str(), rows[5]["state"].as_str()), ("101.25", "92.5", "corrected"));
}

#[test]
fn results_are_not_written_over_without_force() {
    let work = work();
    work.write("fit.csv", "mine").write("fit.png", "mine");
    work.grimace("fit neutral.png -c marks.csv -o fit.csv").exit(1).says(&["fit.csv exists", "--force"]);
    work.grimace("fit neutral.png -c marks.csv -o new.csv --overlay fit.png").exit(1).says(&["fit.png exists"]);
    assert!(!work.path("new.csv").exists());
    // A folder as output, as in other commands: the result has the name of the image.
    work.grimace("fit neutral.png -c marks.csv -o new.csv --overlay pictures").exit(0);
    assert_eq!(work.files("pictures").into_keys().collect::<Vec<_>>(), ["neutral.png"]);
    work.grimace("fit neutral.png -c marks.csv -o fit.csv --force -q").exit(0);
    assert_eq!(work.rows("fit.csv").len(), 113);
}

/// Runs `fit` with a correspondence file that must be refused, and checks the message.
fn refused(marks: &str, texts: &[&str]) {
    let work = work();
    work.write("bad.csv", marks);
    let ran = work.grimace("fit neutral.png -c bad.csv -o fit.csv").exit(1);
    assert!(ran.stderr.starts_with("error: bad.csv"), "{}", ran.stderr);
    ran.says(texts);
    assert!(!work.path("fit.csv").exists());
}

#[test]
fn marks_that_do_not_make_a_fit_are_refused() {
    refused("node,x,y\n", &["0 correspondences; at least 3 are needed, 5 to 8 give a good fit"]);
    refused("node,x,y\n20,80,60\n", &["1 correspondences; at least 3"]);
    refused("node,x,y\n20,80,60\n53,120,60\n", &["2 correspondences; at least 3"]);
    refused("node,x,y\n20,80,60\n23,90,60\n56,110,60\n53,120,60\n", &["the 4 marks lie on one line", "such as the chin"]);
    refused("node,x,y\n20,80,60\n53,120,60\n113,100,90\n", &["line 4", "node 113 does not exist", "nodes 0 to 112"]);
    refused("node,x,y\n20,80,60\n53,120,60\nchin,100,90\n", &["line 4", "chin"]);
    refused("node,x,y\n20,80,60\n53,120,60\n-1,100,90\n", &["line 4", "-1"]);
    refused(
        "node,x,y\n20,80,60\n53,220,60\n10,100,90\n",
        &["node 53 is marked at (220, 60), outside the image of 200 x 160 pixels"],
    );
    refused("node,x,y\n20,80,60\n53,NaN,60\n10,100,90\n", &["line 3", "x is `NaN`; a finite number was expected"]);
    refused("node,x,y\n20,80,60\n53,120,inf\n10,100,90\n", &["line 3", "y is `inf`"]);
    refused("node;x;y\n20;80,5;60\n", &["1 correspondences; at least 3"]);
    refused("node;x;z\n20;80;60\n", &["has no column `y`; found `node`, `x`, `z`"]);
    refused("node,x,y\n20,80\n", &["line 2", "the row has 2 fields, but the header has 3"]);
    refused("", &["is empty; a header line was expected"]);
    // The subject's left eye is on the right of the image: the eyes are exchanged, and the chin is at the top.
    refused(
        "node,x,y\n20,80,90\n53,120,90\n10,100,40\n",
        &["upside down", "turn the picture", "left and right are the subject's own"],
    );
}

#[test]
fn exchanged_left_and_right_are_refused() {
    let work = work();
    let exchange = |node: &str| {
        match node {
            "20" => "53",
            "53" => "20",
            "23" => "56",
            "56" => "23",
            "31" => "64",
            "64" => "31",
            "15" => "48",
            "48" => "15",
            "17" => "50",
            "50" => "17",
            other => other,
        }
        .to_owned()
    };
    let marks = work.read("marks.csv");
    let swapped = marks.lines().map(|line| match line.split_once(',') {
        Some((node, rest)) => format!("{},{rest}\n", exchange(node)),
        None => String::new(),
    });
    work.write("bad.csv", swapped.collect::<String>());
    work.grimace("fit neutral.png -c bad.csv -o fit.csv").exit(1).says(&["the marks fit a mirrored face", "the subject's own"]);
}

#[test]
fn exchanged_corners_of_an_eye_are_refused_by_name() {
    let work = work();
    let marks = work.read("marks.csv");
    // The outer and the inner corner of one eye are exchanged.
    let swapped = marks.replace("\n20,", "\n@,").replace("\n23,", "\n20,").replace("\n@,", "\n23,");
    assert_ne!(swapped, marks);
    work.write("bad.csv", swapped);
    work.grimace("fit neutral.png -c bad.csv -o fit.csv").exit(1).says(&["the marks of nodes 20 and 23 are swapped"]);
    assert!(!work.path("fit.csv").exists());
}

#[test]
fn marks_with_crlf_byte_order_mark_and_quotes_are_read() {
    let work = work();
    let text = format!("\u{feff}{}", work.read("marks.csv").replace('\n', "\r\n").replace("20,", "\"20\","));
    work.grimace("fit neutral.png -c marks.csv -o plain.csv").exit(0);
    work.write("marks.csv", text).grimace("fit neutral.png -c marks.csv -o fit.csv").exit(0);
    assert_eq!(work.read("fit.csv"), work.read("plain.csv"));
}

#[test]
fn a_file_that_is_not_an_image_is_refused() {
    let work = work();
    let png = work.bytes("neutral.png");
    work.write("empty.png", "").write("half.png", &png[..png.len() / 2]).write("text.png", "this is no picture");
    let fit = |image: &str| work.grimace(&format!("fit {image} -c marks.csv -o fit.csv")).exit(1);
    fit("missing.png").says(&["missing.png: cannot be read", "No such file"]);
    fit("empty.png").says(&["empty.png: the file is empty"]);
    fit("half.png").says(&["half.png: the PNG image is cut off"]);
    fit("text.png").says(&["text.png: not an image in a known format (PNG, JPEG", "this is no"]);
    fit("faces").says(&["faces: cannot be read"]);
    assert!(!work.path("fit.csv").exists());
}

#[test]
fn a_custom_wireframe_is_used_and_a_truncated_one_is_refused() {
    let work = work();
    let wfm = grimace::internal::wireframe::write_wfm(&grimace::internal::wireframe::Wireframe::candide3());
    let half: Vec<&str> = wfm.lines().take(wfm.lines().count() / 2).collect();
    work.write("own.wfm", &wfm).write("half.wfm", half.join("\n")).write("torn.wfm", &wfm[..wfm.len() / 2 - 3]);
    work.grimace("fit neutral.png -c marks.csv -o built-in.csv").exit(0);
    work.grimace("fit neutral.png -c marks.csv -o own.csv --wireframe own.wfm").exit(0);
    assert_eq!(work.read("own.csv"), work.read("built-in.csv"));
    let ran = work.grimace("fit neutral.png -c marks.csv -o fit.csv --wireframe half.wfm").exit(1);
    ran.says(&["half.wfm: line", "units list", "truncated or a count is too large"]);
    let ran = work.grimace("fit neutral.png -c marks.csv -o fit.csv --wireframe torn.wfm").exit(1);
    ran.says(&["torn.wfm: line", "units list: found", "was expected"]);
    work.grimace("fit neutral.png -c marks.csv -o fit.csv --wireframe none.wfm").exit(1).says(&["none.wfm: cannot be read"]);
    work.write("image.wfm", work.bytes("neutral.png"));
    work.grimace("fit neutral.png -c marks.csv -o fit.csv --wireframe image.wfm").exit(1).says(&["image.wfm: line"]);
}

#[test]
fn the_help_has_an_example_and_bad_usage_ends_with_2() {
    let work = Work::new();
    let commands =
        [("run", "Example:"), ("fit", "Example:"), ("track", "Example:"), ("analyze", "Example:"), ("simulate", "Examples:")];
    for (command, heading) in commands {
        work.grimace(&format!("{command} --help")).exit(0).prints(&[heading, &format!("grimace {command} ")]);
        work.grimace(&format!("{command} --no-such-flag")).exit(2).says(&["--no-such-flag"]);
    }
    work.grimace("fit").exit(2).says(&["<IMAGE>", "--output"]);
    work.grimace("run faces -o out --alpha 0.5").exit(2).says(&["--alpha", "0.5", "less than 0.5"]);
    work.grimace("run faces -o out --alpha -0.1").exit(2);
    work.grimace("run faces -o out --alpha NaN").exit(2).says(&["NaN"]);
    work.grimace("run faces -o out --window 0").exit(2).says(&["greater than 0"]);
    work.grimace("run faces -o out --levels 9").exit(2).says(&["1..=8"]);
    work.grimace("run faces -o out --fps 0").exit(2).says(&["fps"]);
    work.grimace("run faces -o out --marks 20,abc").exit(2).says(&["abc"]);
}

#[cfg(unix)]
#[test]
fn only_regular_files_are_written_and_links_stay_links() {
    let work = Work::with_sequences(&["S001_005"]);
    work.shell("ln -s real.csv link.csv; mkfifo pipe; ln -s nowhere dead.csv; touch real.csv").exit(0);
    let fit = |out: &str| {
        let (image, marks) = ("faces/S001/005/S001_005_00000001.png", "faces/S001/005/correspondences.csv");
        work.grimace(&format!("fit {image} --correspondences {marks} -o {out} --force"))
    };
    fit("link.csv").exit(0);
    assert!(std::fs::symlink_metadata(work.path("link.csv")).unwrap().is_symlink());
    assert!(work.read("real.csv").starts_with("node,x,y"));
    fit("pipe").exit(1).says(&["cannot write pipe: it is a pipe"]);
    fit("dead.csv").exit(1).says(&["dead.csv: it is a link to a file that does not exist"]);
    fit("/dev/null").exit(1).says(&["cannot write /dev/null: it is a device"]);
    // Standard output of the tests is a pipe, and none of these is a link that may be removed.
    if std::path::Path::new("/dev/stdout").exists() {
        fit("/dev/stdout")
            .exit(1)
            .says(&["cannot write /dev/stdout: it is a pipe, but results are written to regular files only"]);
    }
    fit("-").exit(1).says(&["-: this command cannot write to standard output; for a file of that name give ./-"]);
    fit("./-").exit(0);
    assert!(!work.path("nowhere").exists() && !work.path("pipe").is_file());
    work.grimace("run faces -o out -j 100000").exit(2).says(&["expected a whole number from 0 to 1024"]);
}

#[test]
fn landmarks_are_marks_too() {
    let work = Work::new();
    let frame = crate::common::root().join("fixtures/simulated/S001/005/S001_005_00000001.jpg").display().to_string();
    // 68 landmarks of the first frame, from the true nodes of the simulation that they correspond to; the others are beside the
    // chin.
    let truth = std::fs::read_to_string(crate::common::root().join("fixtures/simulated/truth/S001_005.csv")).unwrap();
    let nodes: Vec<[f64; 2]> = truth
        .lines()
        .skip(1)
        .filter_map(|line| line.strip_prefix("1,"))
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').map(|n| n.parse().unwrap()).collect();
            [numbers[1], numbers[2]]
        })
        .collect();
    let face = grimace::internal::wireframe::Face::candide3();
    let mut points = vec![nodes[10]; 68];
    for row in &face.tables.landmarks {
        if let [(node, _)] = row.nodes[..] {
            points[usize::from(row.landmark)] = nodes[node.index()];
        }
    }
    let table: String = points.iter().enumerate().map(|(k, [x, y])| format!("{k},{x},{y}\n")).collect();
    let pts: String = points.iter().map(|[x, y]| format!("{} {}\n", x + 1.0, y + 1.0)).collect();
    work.write("marks.csv", format!("point,x,y\n{table}"));
    work.write("marks.pts", format!("version: 1\nn_points: 68\n{{\n{pts}}}\n"));
    for marks in ["marks.csv", "marks.pts"] {
        work.grimace(&format!("fit {frame} -c {marks} -o {marks}.fit.csv")).exit(0);
    }
    assert_eq!(work.rows("marks.csv.fit.csv").len(), 113);
    let near = |a: &str, b: &str| (a.parse::<f64>().unwrap() - b.parse::<f64>().unwrap()).abs() < 1e-4;
    for (a, b) in work.rows("marks.csv.fit.csv").iter().zip(work.rows("marks.pts.fit.csv")) {
        assert!(near(&a["x"], &b["x"]) && near(&a["y"], &b["y"]));
    }
}

#[test]
fn the_choice_among_several_faces_is_reported() {
    let work = Work::new();
    let portrait = |name: &str| image::open(crate::common::root().join("fixtures/portraits").join(name)).unwrap().to_rgb8();
    let (left, right) = (portrait("P01.jpg"), portrait("P02.jpg"));
    let mut both = image::RgbImage::new(left.width() + right.width(), left.height().max(right.height()));
    image::imageops::replace(&mut both, &left, 0, 0);
    image::imageops::replace(&mut both, &right, i64::from(left.width()), 0);
    std::fs::create_dir_all(work.path("faces/both")).unwrap();
    for name in ["both.png", "faces/both/1.png", "faces/both/2.png"] {
        both.save(work.path(name)).unwrap();
    }
    left.save(work.path("one.png")).unwrap();
    let said = "found 2 faces; the largest is used";
    work.grimace("fit both.png -o both.csv").exit(0).says(&[&format!("both.png: {said}"), "grimace annotate"]);
    let alone = work.grimace("fit one.png -o one.csv").exit(0);
    assert!(!alone.stderr.contains("faces; the largest"));
    // A run says so about the sequence, and that nothing moves if one picture is repeated.
    work.write("faces/manifest.csv", "subject,sequence,emotion,frames\nA,1,joy,both\n");
    work.grimace("run faces -o out").exit(0).prints(&[&format!("A_1: {said}")]);
    let verdict = &work.rows("out/verdicts.csv")[0];
    assert_eq!(verdict["verdict"], "look again");
    assert!(verdict["reasons"].contains("the face does not move: in frame 2 fewer than 5 nodes are more than"), "{verdict:?}");
}
