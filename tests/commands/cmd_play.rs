//! `grimace play` end to end.

use crate::common::Work;

/// Returns the parsed data embedded in a page.
fn data(html: &str) -> serde_json::Value {
    let start = html.find(r#"type="application/json">"#).unwrap() + r#"type="application/json">"#.len();
    let length = html[start..].find("</script>").unwrap();
    serde_json::from_str(&html[start..start + length]).unwrap()
}

/// Returns the mask of a FAP file with these FAPs set.
fn mask(set: &[usize]) -> String {
    (1..=68).map(|k| if set.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ")
}

/// Returns a FAP file that opens the jaw in three frames.
fn jaw() -> String {
    let frames: String = [0, 200, 400].iter().enumerate().map(|(k, v)| format!("{}\n{k} {v}\n", mask(&[3]))).collect();
    format!("2.1 jaw 25 3\n{frames}")
}

#[test]
fn a_page_plays_tracks_and_fap_files_on_the_shipped_face_and_on_portraits() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.grimace("track faces/S001/005 -c faces/S001/005/correspondences.csv -o S001_005.csv --emotion happiness -q").exit(0);
    work.write("jaw.fap", jaw());
    work.grimace("play S001_005.csv jaw.fap -o page.html").exit(0).prints(&["2 motions on 1 face: page.html"]);
    let html = work.read("page.html");
    let page = data(&html);
    let motion = |k: usize| page["motions"][k].clone();
    assert_eq!((motion(0)["label"].as_str(), motion(0)["kind"].as_str()), (Some("S001 005"), Some("track")));
    assert_eq!((motion(1)["frames"].as_u64(), motion(1)["kind"].as_str()), (Some(3), Some("fap")));
    // A track is named by its subject and emotion, not by its file name; two tracks of one sequence are named by their files.
    assert!(html.contains("<title>S001 005 and jaw"), "{}", &html[..html.find("</title>").unwrap()]);
    for (name, extension) in ["smile", "grin"].iter().flat_map(|name| [(name, "csv"), (name, "json")]) {
        work.write(&format!("{name}.{extension}"), work.read(&format!("S001_005.{extension}")));
    }
    work.grimace("play smile.csv -o smile.html").exit(0);
    let smile = work.read("smile.html");
    assert!(smile.contains("<title>S001 005"), "{}", &smile[..smile.find("</title>").unwrap()]);
    assert_eq!(data(&smile)["motions"][0]["label"], "S001 005");
    work.grimace("play smile.csv grin.csv jaw.fap -o twins.html").exit(0);
    let twins = data(&work.read("twins.html"));
    let labels: Vec<_> = (0..3).map(|k| twins["motions"][k]["label"].clone()).collect();
    assert_eq!(labels, ["smile", "grin", "jaw"]);
    // 2 steps at 25 frames per second.
    assert_eq!(motion(1)["seconds"].as_f64(), Some(0.08));
    // Lips and cheeks move with the jaw, but are not FAPs of the file.
    let faps: Vec<_> = motion(1)["faps"].as_array().unwrap().iter().map(|f| f[0].as_u64()).collect();
    assert_eq!(faps, [Some(3)], "only the jaw is among its FAPs");
    assert!(page["faps"].as_array().unwrap().iter().any(|f| f["words"] == "open jaw"));
    // Nothing is fetched: the only addresses are names of standards and data.
    assert!(!html.contains("src=\"http") && !html.contains("href=\"http") && !html.contains("@import"));
    // The same input gives the same bytes, and nothing is overwritten.
    work.grimace("play S001_005.csv jaw.fap -o again.html -q").exit(0).prints(&[]);
    assert_eq!(html, work.read("again.html"));
    work.grimace("play jaw.fap -o page.html").exit(1).says(&["page.html exists; give --force to overwrite it"]);

    let portraits = "faces/S001/005/S001_005_00000001.png faces/S002/005/S002_005_00000001.png";
    let marks = "faces/S001/005/correspondences.csv faces/S002/005/correspondences.csv";
    work.write("still.fap", jaw().replace(" 200", " 0").replace(" 400", " 0"));
    work.grimace(&format!("play jaw.fap still.fap --portrait {portraits} -c {marks} -o both.html"))
        .exit(0)
        .prints(&["2 motions on 2 faces"])
        .says(&["note: still.fap: the motion contains no movement"]);
    let both = data(&work.read("both.html"));
    assert_eq!(both["faces"][1]["label"], "S002_005_00000001");
    work.grimace(&format!("play jaw.fap --portrait {portraits} -c faces/S001/005/correspondences.csv -o c.html"))
        .exit(1)
        .says(&["2 portraits but 1 files of --correspondences"]);
    // A list of portraits takes all files behind it; those that are no pictures are motions.
    work.grimace(&format!("play --portrait {portraits} jaw.fap -c {marks} -o behind.html"))
        .exit(0)
        .prints(&["1 motion on 2 faces"]);
    work.grimace(&format!("play --portrait {portraits} -o none.html")).exit(1).says(&["name a motion to play"]);
}

#[test]
fn a_page_plays_on_the_dense_head() {
    let work = Work::new();
    work.write("jaw.fap", jaw());
    work.grimace("play jaw.fap --bank candide -o head.html").exit(0).prints(&["1 motion on 1 face: head.html"]);
    let page = data(&work.read("head.html"));
    let head = &page["faces"][0];
    assert_eq!((head["kind"].as_str(), head["label"].as_str()), (Some("head"), Some("candide")));
    assert_eq!(head["motions"][0]["frames"].as_u64(), Some(3));
    // FAP 3 opens the jaw: it moves along y.
    let faps = head["faps"].as_array().unwrap();
    assert_eq!(faps.iter().find(|f| f["number"] == 3).unwrap()["axis"].as_u64(), Some(1));
    // Its own eyes do not have the colour of skin. Base64 of one byte for each of three colours of every vertex.
    assert_eq!(head["colours"].as_str().unwrap().len(), (3 * 23_424_usize).div_ceil(3) * 4);
    work.grimace("play jaw.fap --bank head -o dense.html").exit(0).prints(&["1 motion on 1 face: dense.html"]);
    let page = data(&work.read("dense.html"));
    let head = &page["faces"][0];
    // The 52 shapes of which its 30 members are mixed; of the lids of one eye only that eye's vertices move.
    let shapes = head["shapes"].as_array().unwrap();
    assert_eq!((head["label"].as_str(), shapes.len()), (Some("head"), 52));
    assert!(shapes.iter().all(|shape| shape["vertices"].as_str().unwrap().len() < 4 * (2 * 14_416_usize).div_ceil(3)));
    assert!(head["colours"].is_string() && head["eyes"].as_array().unwrap().is_empty());
    // The mouth is closed at the back; the neck is open.
    assert!(head["openings"].as_array().unwrap().is_empty());
    work.grimace("play jaw.fap --bank gone.bank -o x.html").exit(1).says(&["gone.bank"]);
    // The jaw moves sideways, which no member of `head` does.
    let mask = (1..=68).map(|k| if k == 15 { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    work.write("side.fap", format!("2.1 side 25 2\n{mask}\n0 0\n{mask}\n1 300\n"));
    work.grimace("play side.fap --bank head -o side.html -q").exit(0).says(&[
        "warning: side.fap: on the head head, no mixture of the bank's members",
        "the face rests in the only frame with motion",
    ]);
    let mask = (1..=68).map(|k| if [12, 59].contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    work.write("smirk.fap", format!("2.1 smirk 25 2\n{mask}\n0 0 0\n{mask}\n1 300 300\n"));
    work.grimace("play smirk.fap --bank head -o smirk.html -q")
        .exit(0)
        .says(&["note: smirk.fap: the motion is on one side of the face"]);
    // A bank whose size cannot be measured.
    work.write("meshes/neutral.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    work.write("meshes/open.obj", "v 0 0 0\nv 1 -1 0\nv 0 1 0\nf 1 2 3\n");
    work.write("meshes/feature_points.csv", "fp,vertex\n2.1,1\n");
    work.grimace("bank build meshes -o one.bank").exit(0);
    let ran = work.grimace("play jaw.fap --bank one.bank -o x.html").exit(1);
    assert!(!ran.stderr.contains("--scale"), "{}", ran.stderr);
    ran.says(&["jaw.fap: the bank's facial animation units cannot be measured", "give another --bank that has them, or none"]);
    work.grimace("synthesize -m jaw.fap --bank one.bank -o x").exit(1).says(&["give --scale, the bank's units per face unit"]);
}

#[test]
fn inputs_that_cannot_be_played_are_reported() {
    let work = Work::new();
    work.write("notes.txt", "x").write("bad.fap", "no fap");
    work.grimace("play notes.txt -o a.html")
        .exit(1)
        .says(&["notes.txt: this is neither a track or model (.csv) nor a FAP file (.fap)"]);
    work.grimace("play bad.fap -o a.html").exit(1).says(&["bad.fap"]);
    // One of several: the others are played.
    let nod = jaw().replace(&mask(&[3]), &mask(&[48]));
    work.write("a/jaw.fap", jaw()).write("b/jaw.fap", jaw()).write("nod.fap", nod);
    work.grimace("play a/jaw.fap bad.fap b/jaw.fap nod.fap --bank candide -o some.html")
        .exit(3)
        .prints(&["2 motions on 1 face: some.html"])
        .says(&["failed: bad.fap", "failed: nod.fap: none of its FAPs (48) can be shown"]);
    let html = work.read("some.html");
    let page = data(&html);
    let labels: Vec<_> = page["motions"].as_array().unwrap().iter().map(|motion| motion["label"].clone()).collect();
    assert_eq!((labels, page["faces"][0]["motions"].as_array().unwrap().len()), (vec!["jaw (a)".into(), "jaw (b)".into()], 2));
    assert!(html.contains("<title>jaw (a) and jaw (b)"));
    work.grimace("play bad.fap nod.fap -o none.html").exit(1).says(&["no motion can be played", "bad.fap", "nod.fap"]);
    assert!(!work.path("none.html").exists());
    work.grimace("play missing.csv -o a.html").exit(1).says(&["missing.csv"]);
    work.grimace("play -o a.html").exit(2);
    work.grimace("play --help").exit(0).prints(&["Examples:", "grimace play results/representatives"]);
}
