//! `grimace annotate` over plain HTTP: what it saves, what it refuses, and how it recovers. The page itself is tested in
//! `annotate_page.rs`.

use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    thread,
    time::{Duration, Instant},
};

use crate::annotation::Server;
use crate::common::{Work, root};
use serde_json::{Value, json};

/// Makes two sequences without correspondences and without a column for them.
fn unmarked() -> Work {
    let work = Work::with_sequences(&["S001_005", "S002_007"]);
    for name in ["faces/S001/005/correspondences.csv", "faces/S002/007/correspondences.csv"] {
        fs::remove_file(work.path(name)).unwrap();
    }
    let column = work.header("faces/manifest.csv").split(',').position(|name| name == "correspondences").unwrap();
    let without =
        |line: &str| line.split(',').enumerate().filter(|(k, _)| *k != column).map(|(_, f)| f).collect::<Vec<_>>().join(",");
    let lines: Vec<String> = work.read("faces/manifest.csv").lines().map(without).collect();
    work.write("faces/manifest.csv", lines.join("\n") + "\n");
    work
}

/// Returns the simulation's marks of a sequence.
fn true_marks(sequence: &str) -> Vec<Value> {
    let file = &crate::common::FACES[&format!("{sequence}/correspondences.csv")];
    let rows = csv::Reader::from_reader(file.as_slice()).into_deserialize::<(u16, f64, f64)>().map(Result::unwrap);
    rows.map(|(node, x, y)| json!({"node": node, "x": x, "y": y, "kind": "mark"})).collect()
}

fn save(server: &Server, id: &str, version: &Value, marks: &[Value]) -> crate::annotation::Answer {
    server.send("PUT", &format!("api/sequences/{id}/marks"), &json!({"version": version, "marks": marks}))
}

fn open(server: &Server, id: &str) -> Value {
    server.get(&format!("api/sequences/{id}")).ok()
}

#[test]
fn it_listens_on_loopback_only_and_prints_its_address() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    assert_eq!(server.lines[0], "2 of 2 sequences left to mark");
    assert!(server.url.starts_with("http://127.0.0.1:"), "{}", server.url);
    assert_eq!(server.token.len(), 33, "/ and 32 hexadecimal digits");
    // Local address and port of every listening socket, in hexadecimal.
    if let Ok(sockets) = fs::read_to_string("/proc/net/tcp") {
        let port = format!(":{:04X}", server.port());
        let own: Vec<&str> = sockets.lines().filter_map(|l| l.split_whitespace().nth(1)).filter(|a| a.ends_with(&port)).collect();
        assert!(!own.is_empty() && own.iter().all(|address| address.starts_with("0100007F")), "{own:?}");
    }
    let page = server.get("");
    assert_eq!(page.status, 200);
    assert!(page.head.contains("content-type: text/html") && page.text().contains("<title>grimace annotate</title>"));
}

#[test]
fn proposed_sequences_are_shown_with_their_confidence() {
    // Both have all their marks; only one is a proposal.
    let work = Work::with_sequences(&["S001_005", "S002_007"]);
    let manifest = work.read("faces/manifest.csv");
    let lines: Vec<String> =
        manifest.lines().zip(["confidence", "0.62", ""]).map(|(line, confidence)| format!("{line},{confidence}\n")).collect();
    work.write("faces/manifest.csv", lines.concat());
    let server = Server::start(&work, "faces");
    let list = server.get("api/sequences").ok();
    assert_eq!((list["sequences"].as_array().unwrap().len(), &list["left"], &list["total"]), (1, &json!(0), &json!(2)));
    assert_eq!(list["sequences"][0]["confidence"], 0.62);
    assert_eq!(list["sequences"][0]["id"], "S001_005");
}

#[test]
fn another_address_needs_a_flag_and_warns() {
    let work = unmarked();
    let ran = work.shell(
        "\"$GRIMACE\" annotate faces --no-open --host 0.0.0.0 --port 0 > out.txt 2> warning.txt & pid=$!
         for i in $(seq 100); do grep -q '^open ' out.txt && break; sleep 0.1; done; kill $pid; wait $pid; cat out.txt",
    );
    assert!(ran.stdout.contains("open http://127.0.0.1:"), "{}", ran.stdout);
    let warning = work.read("warning.txt");
    assert!(warning.starts_with("warning: the page is served on 0.0.0.0: anyone who can reach this address"), "{warning}");
}

#[test]
fn a_port_in_use_is_reported_only_if_it_was_requested() {
    let work = unmarked();
    let first = Server::start(&work, "faces");
    let port = first.port();
    work.grimace(&format!("annotate faces --no-open --port {port}")).exit(1).says(&["cannot listen on 127.0.0.1", "--port"]);
    let second = Server::start(&work, "faces");
    assert_ne!(second.port(), port);
    assert_ne!(second.token, first.token);
}

#[test]
fn foreign_hosts_origins_and_guesses_are_refused() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let target = format!("{}/api/sequences", server.token);
    let status = |target: &str, headers: &[(&str, &str)]| server.request("GET", target, headers, b"").status;
    assert_eq!(status(&target, &[]), 200);
    assert_eq!(status(&target, &[("Host", "evil.example")]), 403);
    assert_eq!(status(&target, &[("Host", &format!("evil.example:{}", server.port()))]), 403);
    assert_eq!(status(&target, &[("Host", &format!("localhost:{}", server.port()))]), 200);
    assert_eq!(status(&target, &[("Origin", "http://evil.example")]), 403);
    assert_eq!(status(&target, &[("Origin", "null")]), 403);
    assert_eq!(status(&target, &[("Origin", &format!("http://{}", server.authority))]), 200);
    assert_eq!(status(&target, &[("Sec-Fetch-Site", "cross-site")]), 403);
    for guess in ["/", "/api/sequences", "/0123456789abcdef0123456789abcdef/api/sequences", &server.token[..32]] {
        assert_eq!(status(guess, &[]), 404, "{guess}");
    }
    // Another web page can send a form without a preflight request; forms are refused.
    let form = server.request("POST", &format!("{}/api/fit", server.token), &[("Content-Type", "text/plain")], b"{}");
    assert_eq!(form.status, 415);
    // No answer, refused or not, may be framed, sniffed or load anything from elsewhere.
    for answer in [server.get(""), server.get("nothing"), server.request("GET", "/", &[], b"")] {
        for header in [
            "content-security-policy: default-src 'none'; script-src 'self'",
            "x-content-type-options: nosniff",
            "x-frame-options: deny",
            "referrer-policy: no-referrer",
        ] {
            assert!(answer.head.contains(header), "{header} is not in {}", answer.head);
        }
    }
}

#[test]
fn no_file_but_frames_of_the_dataset_can_be_reached() {
    let work = unmarked();
    work.write("faces/S001/005/secret.txt", "TOPSECRET\n")
        .write("secret.txt", "TOPSECRET\n")
        .write("faces/S001/005/S001_005_00000099.png", "TOPSECRET\n");
    let server = Server::start(&work, "faces");
    let frame = server.get("api/sequences/S001_005/frames/1");
    assert_eq!((frame.status, frame.head.contains("content-type: image/png")), (200, true));
    let targets = [
        "../../../../../../../../etc/passwd",
        "..%2f..%2f..%2f..%2fetc%2fpasswd",
        "%2e%2e/%2e%2e/%2e%2e/etc/passwd",
        "/etc/passwd",
        "..\\..\\secret.txt",
        "api/sequences/S001_005/frames/secret.txt",
        "api/sequences/S001_005/frames/..%2fsecret.txt",
        "api/sequences/S001_005/frames/..%2f..%2f..%2fmanifest.csv",
        "api/sequences/S001_005/frames/1/../../../../../secret.txt",
        "api/sequences/S001_005/frames/77",
        "api/sequences/S001_005/frames/99",
        "api/sequences/S001_005/frames/-1",
        "api/sequences/S001_005/frames/99999999999999999999",
        "api/sequences/..%2f..%2fsecret.txt",
        "api/sequences/%2fetc/frames/1",
        "api/sequences/S001%2f005/frames/1",
        "manifest.csv",
        "assets/main.js",
        "main.js%00.txt",
        "simulate.json",
    ];
    for target in targets {
        let answer = server.get(target);
        assert!((400..500).contains(&answer.status), "{target}: {} {}", answer.status, answer.head);
        assert!(!answer.text().contains("TOPSECRET\n") && !answer.text().contains("root:"), "{target}: {}", answer.text());
    }
}

#[test]
fn bodies_are_limited_and_must_be_json() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let long = vec![b' '; 100_000];
    let json = [("Content-Type", "application/json")];
    let fit = format!("{}/api/fit", server.token);
    assert_eq!(server.request("POST", &fit, &json, &long).status, 413);
    let bodies: [&[u8]; 5] = [
        b"{",
        b"[]",
        b"{\"marks\":[{\"node\":-1,\"x\":1,\"y\":1}],\"width\":9,\"height\":9}",
        b"\xff\xfe",
        b"{\"marks\":[],\"width\":9,\"height\":NaN}",
    ];
    for body in bodies {
        let status = server.request("POST", &fit, &json, body).status;
        assert!(matches!(status, 400 | 422), "{status} for {}", String::from_utf8_lossy(body));
    }
    // The server still answers.
    assert_eq!(server.get("api/setup").status, 200);
}

#[test]
fn marks_are_saved_byte_for_byte_where_fit_and_run_find_them() {
    let work = unmarked();
    let manifest = work.read("faces/manifest.csv");
    let server = Server::start(&work, "faces");
    for (id, folder) in [("S001_005", "S001/005"), ("S002_007", "S002/007")] {
        let opened = open(&server, id);
        assert_eq!((opened["marks"].as_array().unwrap().len(), &opened["problem"]), (0, &Value::Null));
        let mut marks = true_marks(folder);
        let first = save(&server, id, &opened["version"], &marks).ok();
        let path = format!("faces/{folder}/correspondences.csv");
        let bytes = work.bytes(&path);
        assert!(work.header(&path) == "node,x,y,kind" && work.rows(&path).len() == marks.len());
        // If the answer was lost and the marks are sent again in another order, the bytes are the same and there is no
        // conflict.
        marks.reverse();
        assert_eq!(save(&server, id, &opened["version"], &marks).ok()["version"], first["version"]);
        assert_eq!(work.bytes(&path), bytes);
        assert_eq!(open(&server, id)["version"], first["version"]);
    }
    assert_eq!(server.get("api/sequences").ok()["left"], 0);
    // The manifest names the files; everything else in it is unchanged.
    let named = work.read("faces/manifest.csv");
    let without: String = named.lines().map(|line| line.rsplit_once(',').unwrap().0.to_owned() + "\n").collect();
    assert_eq!(without, manifest);
    assert!(named.lines().nth(1).unwrap().ends_with(",S001/005/correspondences.csv"), "{named}");
    drop(server);
    work.grimace("fit faces/S001/005/S001_005_00000001.png -c faces/S001/005/correspondences.csv -o fit.csv").exit(0);
    work.grimace("run faces -o results -q").exit(0);
    assert_eq!(work.rows("results/failures.csv").len(), 0);
    // No partly written file remains.
    assert!(crate::common::leftovers(&work.files("faces")).is_empty());
}

#[test]
fn a_hard_position_is_kept_as_such_and_released() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let mut marks = true_marks("S001/005");
    let version = open(&server, "S001_005")["version"].clone();
    marks.push(json!({"node": 6, "x": 100.25, "y": 90.5, "kind": "hard"}));
    let version = save(&server, "S001_005", &version, &marks).ok()["version"].clone();
    let text = work.read("faces/S001/005/correspondences.csv");
    assert!(text.contains("\n6,100.25,90.5,hard\n"), "{text}");
    marks.pop();
    save(&server, "S001_005", &version, &marks).ok();
    assert!(!work.read("faces/S001/005/correspondences.csv").contains("hard"));
}

#[test]
fn removing_all_marks_restores_the_sequence() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let version = open(&server, "S001_005")["version"].clone();
    let saved = save(&server, "S001_005", &version, &true_marks("S001/005")).ok();
    let emptied = save(&server, "S001_005", &saved["version"], &[]).ok();
    assert_eq!((&emptied["version"], &emptied["left"]), (&version, &json!(2)));
    assert!(!work.path("faces/S001/005/correspondences.csv").exists());
    assert!(work.read("faces/manifest.csv").lines().nth(1).unwrap().ends_with(','), "the field is empty again");
}

#[test]
fn two_tabs_do_not_overwrite_each_other() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let (first, second) = (open(&server, "S001_005"), open(&server, "S001_005"));
    let marks = true_marks("S001/005");
    save(&server, "S001_005", &first["version"], &marks).ok();
    let bytes = work.bytes("faces/S001/005/correspondences.csv");
    let refused = save(&server, "S001_005", &second["version"], &marks[..3]);
    assert_eq!(refused.status, 409);
    let current = &refused.json()["current"];
    assert_eq!(current["marks"].as_array().unwrap().len(), marks.len());
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), bytes, "nothing was written");
    // With the current version, the marks may be replaced.
    save(&server, "S001_005", &current["version"], &marks[..3]).ok();
    // A change by an editor is like a change in another tab.
    work.replace("faces/S001/005/correspondences.csv", "mark", "hard");
    assert_eq!(save(&server, "S001_005", &current["version"], &marks).status, 409);
}

#[test]
fn a_killed_server_loses_nothing() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let marks = true_marks("S001/005");
    let mut version = open(&server, "S001_005")["version"].clone();
    for count in 1..=marks.len() {
        version = save(&server, "S001_005", &version, &marks[..count]).ok()["version"].clone();
    }
    server.kill();
    assert!(crate::common::leftovers(&work.files("faces")).is_empty());
    let server = Server::start(&work, "faces");
    assert_eq!(server.lines[0], "1 of 1 sequence left to mark");
    assert_eq!(server.get("api/sequences").ok()["sequences"][0]["id"], "S002_007");
    drop(server);
    let server = Server::start(&work, "faces --all");
    let opened = open(&server, "S001_005");
    assert_eq!((opened["marks"].as_array().unwrap().len(), &opened["version"]), (marks.len(), &version));
}

#[test]
fn wrong_marks_are_refused_and_the_file_stays() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    let saved = save(&server, "S001_005", &opened["version"], &true_marks("S001/005")).ok();
    let bytes = work.bytes("faces/S001/005/correspondences.csv");
    let mark = |node: u32, x: f64, y: f64| json!({"node": node, "x": x, "y": y});
    let cases = [
        (vec![mark(20, -3.0, 10.0)], "outside the image of 200x160"),
        (vec![mark(20, 10.0, 1e300)], "outside the image"),
        (vec![mark(20, 10.0, 10.0), mark(20, 11.0, 10.0)], "node 20 is marked twice"),
        (vec![mark(35, 10.0, 10.0)], "node 35 cannot be marked"),
        (vec![mark(113, 10.0, 10.0)], "node 113 cannot be marked"),
    ];
    for (marks, reason) in cases {
        let refused = save(&server, "S001_005", &saved["version"], &marks);
        assert_eq!(refused.status, 422);
        assert!(refused.json()["error"].as_str().unwrap().contains(reason), "{}", refused.text());
    }
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), bytes);
    assert_eq!(save(&server, "S009_009", &saved["version"], &[]).status, 404);
    // A file that cannot be read may be somebody's work: it is not replaced.
    work.write("faces/S002/007/correspondences.csv", "node,x,y\n20,ten,10\n");
    let opened = open(&server, "S002_007");
    assert!(opened["problem"].as_str().unwrap().contains("x is `ten`"), "{opened}");
    let refused = save(&server, "S002_007", &opened["version"], &true_marks("S002/007"));
    assert!(refused.status == 422 && refused.text().contains("correct the file or move it away"), "{}", refused.text());
    assert!(work.read("faces/S002/007/correspondences.csv").contains("ten"));
}

#[test]
fn any_frame_may_be_neutral_or_apex() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["neutral"], &opened["apex"], opened["frames"].as_array().unwrap().len()), (&json!(1), &json!(6), 6));
    let range = |version: &Value, neutral: u32, apex: u32| {
        server.send("PUT", "api/sequences/S001_005/range", &json!({"version": version, "neutral": neutral, "apex": apex}))
    };
    let changed = range(&opened["version"], 2, 5).ok();
    assert_eq!((&changed["neutral"], &changed["apex"]), (&json!(2), &json!(5)));
    let row = |work: &Work| work.rows("faces/manifest.csv")[0].clone();
    assert_eq!((row(&work)["first_frame"].as_str(), row(&work)["last_frame"].as_str()), ("2", "5"));
    assert_eq!(range(&opened["version"], 1, 6).status, 409, "another tab has changed the frames");
    assert!(range(&changed["version"], 5, 5).text().contains("cannot be both the neutral and the apex frame"));
    assert!(range(&changed["version"], 2, 7).text().contains("there is no frame 7"));
    assert_eq!(row(&work)["first_frame"], "2");
    drop(server);
    // If the named frame no longer exists, the first frame is shown and can be chosen.
    work.replace("faces/manifest.csv", ",2,5", ",0,5");
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["neutral"], &opened["apex"]), (&json!(1), &json!(5)));
    assert!(opened["problem"].as_str().unwrap().starts_with("first_frame is 0 in the manifest, but the frames are 1 to 6"));
    let refused = save(&server, "S001_005", &opened["version"], &true_marks("S001/005"));
    assert!(refused.status == 422 && refused.text().contains("first_frame is 0"), "marks on another frame are refused");
    server.send("PUT", "api/sequences/S001_005/range", &json!({"version": opened["version"], "neutral": 1, "apex": 5})).ok();
    assert_eq!(row(&work)["first_frame"], "1");
}

#[test]
fn a_video_is_marked_and_scrubbed_like_images() {
    let work = unmarked();
    if !crate::common::video::write_video(&work, "faces/S001/005", "faces/face.avi") {
        return;
    }
    work.write("faces/manifest.csv", "subject,sequence,emotion,frames\nS001,005,happiness,face.avi\n");
    let server = Server::start(&work, "faces");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["frames"], &opened["width"], &opened["apex"]), (&json!([1, 2, 3, 4, 5, 6]), &json!(200), &json!(6)));
    let frame = server.get("api/sequences/S001_005/frames/4");
    let shown = image::load_from_memory(&frame.body).unwrap().to_luma8();
    let still = image::open(work.path("faces/S001/005/S001_005_00000004.png")).unwrap().to_luma8();
    let differences = shown.iter().zip(still.iter()).map(|(a, b)| f64::from(a.abs_diff(*b)));
    assert!(differences.sum::<f64>() / f64::from(200 * 160) < 5.0, "frame 4 is shown, up to JPEG compression");
    assert_eq!(server.get("api/sequences/S001_005/frames/7").status, 404);
    save(&server, "S001_005", &opened["version"], &true_marks("S001/005")).ok();
    work.grimace("run faces -o results -q").exit(0);
    drop(server);
    let server = Server::start(&work, "--tracks results");
    let track = open(&server, "S001_005");
    let body = json!({"version": track["version"], "frame": 3, "corrections": [{"node": 31, "x": 90.5, "y": 100.25}]});
    let corrected = server.send("PUT", "api/sequences/S001_005/corrections", &body).ok();
    let again = server.send("POST", "api/sequences/S001_005/retrack", &json!({"version": corrected["version"], "frame": 3})).ok();
    assert_eq!(
        (&again["frames"][2]["nodes"][31], &again["frames"][2]["states"][31]),
        (&json!([90.5, 100.25]), &json!("corrected"))
    );
}

/// Makes the two sequences of [`unmarked`] in the layout of Cohn-Kanade.
fn cohn_kanade() -> Work {
    let work = unmarked();
    for (subject, sequence, code) in [("S001", "005", 5), ("S002", "007", 7)] {
        for (name, bytes) in work.files(&format!("faces/{subject}/{sequence}")) {
            if name.ends_with(".png") {
                work.write(&format!("ck/cohn-kanade-images/{subject}/{sequence}/{name}"), bytes);
            }
        }
        work.write(
            &format!("ck/Emotion/{subject}/{sequence}/{subject}_{sequence}_00000006_emotion.txt"),
            format!("   {code}.0000000e+00\n"),
        );
    }
    work
}

#[test]
fn a_dataset_without_a_manifest_gets_one_by_consent_only() {
    let work = cohn_kanade();
    let server = Server::start(&work, "ck");
    let opened = open(&server, "S001_005");
    // Marks need no manifest: they are beside the frames.
    save(&server, "S001_005", &opened["version"], &true_marks("S001/005")).ok();
    assert_eq!(work.rows("ck/cohn-kanade-images/S001/005/correspondences.csv").len(), true_marks("S001/005").len());
    let opened = open(&server, "S001_005");
    let mut request = json!({"version": opened["version"], "neutral": 2, "apex": 5});
    let asked = server.send("PUT", "api/sequences/S001_005/range", &request);
    assert_eq!((asked.status, &asked.json()["consent"]), (428, &json!(true)));
    assert!(!work.path("ck/manifest.csv").exists());
    request["createManifest"] = json!(true);
    server.send("PUT", "api/sequences/S001_005/range", &request).ok();
    assert_eq!(
        work.read("ck/manifest.csv"),
        "subject,sequence,emotion,frames,first_frame,last_frame,correspondences,landmarks\n\
         S001,005,happiness,cohn-kanade-images/S001/005,2,5,cohn-kanade-images/S001/005/correspondences.csv,\n\
         S002,007,surprise,cohn-kanade-images/S002/007,,,,\n"
    );
    drop(server);
    let server = Server::start(&work, "ck --all");
    let opened = open(&server, "S001_005");
    assert_eq!((&opened["neutral"], opened["marks"].as_array().unwrap().len()), (&json!(2), true_marks("S001/005").len()));
}

#[test]
fn proposals_come_from_landmarks_and_missing_cascades_are_explained() {
    let work = unmarked();
    let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
    let points: String = (0..68).map(|k| format!(",{k},{}", k + 10)).collect();
    work.write("faces/S001/005/landmarks.csv", format!("frame{header}\n1{points}\n"));
    let manifest = work.read("faces/manifest.csv");
    let mut lines = manifest.lines();
    let header = lines.next().unwrap();
    let rows: Vec<String> = lines.map(|l| format!("{l}{}", if l.starts_with("S001") { ",landmarks.csv" } else { "," })).collect();
    work.write("faces/manifest.csv", format!("{header},landmarks\n{}\n", rows.join("\n")));
    // A wall instead of a face.
    for number in 1..=2 {
        let path = work.path(&format!("faces/S002/wall/{number}.png"));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        image::GrayImage::from_fn(160, 120, |x, y| image::Luma([(100 + (x / 40 + y / 30) % 3) as u8])).save(path).unwrap();
    }
    let manifest = work.read("faces/manifest.csv");
    let fields = manifest.lines().next().unwrap().split(',').map(|column| match column {
        "subject" => "S002",
        "sequence" => "wall",
        "emotion" => "anger",
        "frames" => "S002/wall",
        _ => "",
    });
    let row = fields.collect::<Vec<_>>().join(",");
    work.write("faces/manifest.csv", format!("{manifest}{row}\n"));
    let server = Server::start(&work, "faces --cascades .");
    let proposed = server.get("api/sequences/S001_005/proposals").ok();
    assert_eq!((&proposed["source"], proposed["marks"].as_array().unwrap().len()), (&json!("landmarks"), 11));
    // Landmark 8, from 0, is the chin, node 10.
    let chin = proposed["marks"].as_array().unwrap().iter().find(|mark| mark["node"] == 10).unwrap();
    assert_eq!((&chin["x"], &chin["y"], &chin["kind"]), (&json!(8.0), &json!(18.0), &json!("mark")), "{chin}");
    let none = server.get("api/sequences/S002_wall/proposals").ok();
    assert_eq!((&none["source"], none["marks"].as_array().unwrap().len()), (&Value::Null, 0));
    assert!(none["note"].as_str().unwrap().contains("apt-get install opencv-data"), "{none}");
    // Proposals are never saved before they are accepted.
    assert!(!work.path("faces/S001/005/correspondences.csv").exists());
    assert_eq!(open(&server, "S001_005")["marks"], json!([]));
}

/// Copies the first composite portrait of the fixtures as `NAME.jpg` and `NAME/1.jpg`, `NAME/2.jpg`.
fn portrait(work: &Work, name: &str) {
    let folder = crate::common::root().join("fixtures/portraits");
    let mut pictures: Vec<_> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    pictures.retain(|path| path.extension().is_some_and(|e| e == "jpg"));
    pictures.sort();
    let bytes = fs::read(&pictures[0]).unwrap();
    for file in [format!("{name}.jpg"), format!("faces/{name}/1.jpg"), format!("faces/{name}/2.jpg")] {
        work.write(&file, &bytes);
    }
}

#[test]
fn a_found_face_is_proposed_with_its_expected_errors_and_accepted_by_a_limit() {
    let work = Work::new();
    portrait(&work, "anna");
    work.write("faces/anna/by_hand.csv", "node,x,y\n20,10,10\n");
    let manifest = "subject,sequence,emotion,frames,correspondences\nA,found,joy,anna,\nA,hand,joy,anna,anna/by_hand.csv\n";
    work.write("faces/manifest.csv", manifest);
    let server = Server::start(&work, "faces");
    let found = server.get("api/sequences/A_found/proposals").ok();
    assert_eq!(found["source"], "found", "{found}");
    let marks = found["marks"].as_array().unwrap();
    assert!(marks.len() > 40 && marks.iter().all(|m| m["expected_error"].as_f64().unwrap() > 0.0), "{found}");
    // Accepted unchanged, they keep their expected errors.
    let version = open(&server, "A_found")["version"].clone();
    save(&server, "A_found", &version, marks).ok();
    assert_eq!(work.header("faces/A/found/correspondences.csv"), "node,x,y,kind,expected_error");
    drop(server);
    fs::remove_dir_all(work.path("faces/A")).unwrap();
    work.write("faces/manifest.csv", manifest);
    // No points are that certain: all remain to be reviewed.
    let server = Server::start(&work, "faces --accept 0.001");
    assert_eq!(server.lines[0], "accepted the found marks of 0 sequences");
    assert!(server.lines[1].contains("not accepted: A_found: the median expected error of the points is"), "{:?}", server.lines);
    drop(server);
    let server = Server::start(&work, "faces --accept 5 --all");
    assert_eq!(server.lines[0], "accepted the found marks of 1 sequence");
    assert!(open(&server, "A_found")["marks"].as_array().unwrap().len() > 30);
    // A mark set by hand has precedence.
    assert_eq!(open(&server, "A_hand")["marks"].as_array().unwrap().len(), 1);
    drop(server);
    work.grimace("annotate faces --accept -1 --no-open").exit(2);
    // `--no-page` opens no page, and the command ends.
    work.grimace("annotate faces --accept 5 --no-page")
        .exit(3)
        .prints(&["1 of 1 sequence left to mark", "A_hand: it has 1 mark"]);
    work.write("faces/manifest.csv", "subject,sequence,emotion,frames\nA,found,joy,anna\n");
    fs::remove_dir_all(work.path("faces/A")).unwrap();
    work.grimace("annotate faces --accept 0.001 --no-page")
        .exit(3)
        .prints(&["not accepted: A_found: the median", "1 of 1 sequence left"]);
    work.grimace("annotate faces --accept 5 --no-page")
        .exit(0)
        .prints(&["accepted the found marks of 1 sequence", "0 of 1 sequence left to mark"]);
    work.grimace("annotate faces --accept 5 --no-page").exit(0).prints(&["nothing is left to mark"]);
    work.grimace("annotate faces --no-page").exit(2);
}

#[test]
fn one_picture_is_marked_beside_itself() {
    let work = Work::new();
    portrait(&work, "anna");
    let server = Server::start(&work, "anna.jpg");
    let opened = open(&server, "anna_picture");
    assert_eq!((&opened["frames"], &opened["file"]), (&json!([1]), &json!("anna.csv")));
    assert_eq!(server.get("api/sequences/anna_picture/frames/1").status, 200);
    let marks = [json!({"node": 20, "x": 100.5, "y": 90.25, "kind": "mark"})];
    save(&server, "anna_picture", &opened["version"], &marks).ok();
    assert_eq!(work.read("anna.csv"), "node,x,y,kind\n20,100.5,90.25,mark\n");
    let range = json!({"version": open(&server, "anna_picture")["version"], "neutral": 1, "apex": 1});
    let refused = server.send("PUT", "api/sequences/anna_picture/range", &range);
    assert!(refused.status == 422 && refused.text().contains("one picture"), "{}", refused.text());
    assert!(!work.path("manifest.csv").exists());
    drop(server);
    work.grimace("annotate anna.jpg --tracks anna").exit(1);
}

#[test]
fn the_face_of_one_picture_is_proposed_and_accepted() {
    let work = Work::new();
    portrait(&work, "anna");
    let server = Server::start(&work, "anna.jpg");
    let found = server.get("api/sequences/anna_picture/proposals").ok();
    assert_eq!((&found["source"], &found["note"]), (&json!("found"), &Value::Null), "{found}");
    assert!(found["marks"].as_array().unwrap().len() > 40, "{found}");
    assert!(!work.path("anna.csv").exists());
    drop(server);
    let server = Server::start(&work, "anna.jpg --accept 5");
    assert_eq!(server.lines[0], "accepted the found marks of 1 sequence");
    assert_eq!(work.header("anna.csv"), "node,x,y,kind,expected_error");
    let opened = open(&server, "anna_picture");
    assert_eq!(opened["marks"].as_array().unwrap().len(), work.rows("anna.csv").len());
    drop(server);
    work.grimace("fit anna.jpg -c anna.csv -o fit.csv").exit(0);
    // A file in the place of the marks that is not a file of marks is reported and kept.
    for text in ["", "eggs\nmilk\n"] {
        work.write("anna.csv", text);
        let ran = work.grimace("annotate anna.jpg --accept 5 --no-page").exit(3);
        ran.prints(&[
            "accepted the found marks of 0 sequences",
            "not accepted: anna_picture: ",
            "anna.csv",
            "correct the file or move it away",
        ]);
        assert_eq!(work.read("anna.csv"), text);
    }
}

/// A connection that is kept open for many requests, as in a browser.
struct Connection {
    stream: BufReader<TcpStream>,
    head: String,
}

impl Connection {
    fn new(server: &Server) -> Self {
        let stream = TcpStream::connect(&server.authority).unwrap();
        stream.set_nodelay(true).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(300))).unwrap();
        let head =
            format!("POST {}/api/fit HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\n", server.token, server.authority);
        Self { stream: BufReader::new(stream), head }
    }

    fn ask(&mut self, body: &str) -> Value {
        write!(self.stream.get_mut(), "{}Content-Length: {}\r\n\r\n{body}", self.head, body.len()).unwrap();
        let mut length = 0;
        let mut line = String::new();
        while line != "\r\n" {
            line.clear();
            assert!(self.stream.read_line(&mut line).unwrap() > 0, "the connection was closed");
            if let Some(value) = line.to_lowercase().strip_prefix("content-length:") {
                length = value.trim().parse().unwrap();
            }
        }
        let mut body = vec![0; length];
        self.stream.read_exact(&mut body).unwrap();
        serde_json::from_slice(&body).unwrap()
    }
}

#[test]
fn fits_are_answered_on_a_kept_connection() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let mut marks = true_marks("S001/005");
    let mut connection = Connection::new(&server);
    let mut times: Vec<f64> = (0..200)
        .map(|k| {
            // Drag a mark.
            marks[0]["x"] = json!(marks[0]["x"].as_f64().unwrap() + f64::from(k % 5 - 2) * 0.1);
            let body = json!({"marks": marks, "width": 200, "height": 160}).to_string();
            let start = Instant::now();
            let answer = connection.ask(&body);
            let time = start.elapsed().as_secs_f64() * 1e3;
            assert_eq!(answer["nodes"].as_array().unwrap().len(), 113, "{answer}");
            time
        })
        .collect();
    times.sort_by(f64::total_cmp);
    eprintln!("200 fits over one connection: median {:.2} ms, 95 % below {:.2} ms", times[100], times[190]);
}

#[test]
fn the_page_shows_the_fit_that_the_commands_make() {
    let work = Work::new();
    work.write("anna.jpg", fs::read(root().join("fixtures/portraits/P02.jpg")).unwrap());
    let all = fs::read_to_string(root().join("fixtures/portraits/P02_correspondences.csv")).unwrap();
    let is_of_eleven = |line: &&str| {
        ["node", "20", "23", "53", "56", "31", "64", "10", "15", "17", "48", "50"].contains(&line.split(',').next().unwrap())
    };
    work.write("marks.csv", all.lines().filter(is_of_eleven).collect::<Vec<_>>().join("\n"));
    work.grimace("fit anna.jpg -c marks.csv -o read.csv").exit(0).prints(&["11 marks", "nodes without a mark in the picture"]);
    let alone = work.grimace("fit anna.jpg -c marks.csv -o alone.csv --read-unmarked off").exit(0);
    assert!(!alone.stdout.contains("without a mark"), "{}", alone.stdout);

    let server = Server::start(&work, "anna.jpg");
    let id = "anna_picture";
    let number = |row: &std::collections::BTreeMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
    let marks: Vec<Value> = work
        .rows("marks.csv")
        .iter()
        .map(|row| json!({"node": number(row, "node") as u16, "x": number(row, "x"), "y": number(row, "y"), "kind": "mark"}))
        .collect();
    let shown = |frame: Value| {
        let answer = server.send("POST", "api/fit", &json!({"marks": marks, "width": 440, "height": 560, "frame": frame})).ok();
        let nodes = answer["nodes"].as_array().unwrap().clone();
        nodes.iter().map(|node| [node[0].as_f64().unwrap(), node[1].as_f64().unwrap()]).collect::<Vec<_>>()
    };
    let fitted = |file: &str| work.rows(file).iter().map(|row| [number(row, "x"), number(row, "y")]).collect::<Vec<_>>();
    let apart =
        |a: &[[f64; 2]], b: &[[f64; 2]]| a.iter().zip(b).map(|(p, q)| (p[0] - q[0]).hypot(p[1] - q[1])).fold(0.0, f64::max);
    let frame = json!({"sequence": id, "number": 1});
    // Positions are sent in hundredths of a pixel.
    assert!(apart(&shown(frame.clone()), &fitted("read.csv")) < 0.01 && apart(&shown(frame), &fitted("read.csv")) < 0.01);
    // With a frame that does not exist, or without one, the fit uses the marks only.
    for none in [Value::Null, json!({"sequence": id, "number": 99}), json!({"sequence": "no one", "number": 1})] {
        assert!(apart(&shown(none), &fitted("alone.csv")) < 0.01);
    }
    assert!(apart(&fitted("read.csv"), &fitted("alone.csv")) > 2.0);
}

#[test]
fn many_connections_are_answered_at_once() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let body = json!({"marks": true_marks("S001/005"), "width": 200, "height": 160}).to_string();
    let first = Connection::new(&server).ask(&body);
    // Connections that send nothing do not block others.
    let idle: Vec<_> = (0..20).map(|_| TcpStream::connect(&server.authority).unwrap()).collect();
    thread::scope(|scope| {
        for _ in 0..8 {
            scope.spawn(|| {
                let mut connection = Connection::new(&server);
                (0..10).for_each(|_| assert_eq!(connection.ask(&body), first));
            });
        }
    });
    drop(idle);
}

#[test]
fn a_fit_says_what_is_wrong_with_the_marks() {
    let work = unmarked();
    let server = Server::start(&work, "faces");
    let fit = |marks: &[Value]| server.send("POST", "api/fit", &json!({"marks": marks, "width": 200, "height": 160})).ok();
    let marks = true_marks("S001/005");
    assert!(fit(&marks[..2])["problem"].as_str().unwrap().contains("at least 3"));
    let mut swapped = marks.clone();
    for mark in &mut swapped {
        mark["x"] = json!(199.0 - mark["x"].as_f64().unwrap());
    }
    assert!(fit(&swapped)["problem"].as_str().unwrap().contains("mirrored"));
    assert!(
        fit(&[json!({"node": 4000, "x": 1, "y": 1}), marks[0].clone(), marks[1].clone(), marks[2].clone()])["problem"]
            .is_string()
    );
}

#[test]
fn names_are_only_names() {
    let work = unmarked();
    let names = ["<img src=x onerror=alert(1)>", "$(touch pwned)", "a&b;touch pwned"];
    let mut manifest = "subject,sequence,emotion,frames\n".to_owned();
    for name in names {
        manifest += &format!("\"{name}\",1,happiness,S001/005\n");
    }
    work.write("faces/manifest.csv", manifest);
    let server = Server::start(&work, "faces");
    let list = server.get("api/sequences").ok();
    let listed: Vec<&str> = list["sequences"].as_array().unwrap().iter().map(|s| s["id"].as_str().unwrap()).collect();
    assert!(names.iter().all(|name| listed.contains(&format!("{name}_1").as_str())), "{listed:?}");
    let encoded = "%24%28touch%20pwned%29_1";
    let opened = open(&server, encoded);
    save(&server, encoded, &opened["version"], &true_marks("S001/005")).ok();
    assert!(work.path("faces/$(touch pwned)/1/correspondences.csv").exists());
    assert!(!work.path("pwned").exists() && !work.path("faces/pwned").exists());
}

#[test]
fn tracks_are_corrected_and_tracked_again() {
    let work = Work::after_run(&["S001_005", "S002_007"], "results");
    // The dataset is found by its name, beside the results.
    let server = Server::start(&work, "--tracks results");
    let track = open(&server, "S001_005");
    assert_eq!(track["marksFrom"], "file");
    let frames = track["frames"].as_array().unwrap();
    assert_eq!((frames.len(), &frames[0]["number"]), (6, &json!(1)));
    let before = work.files("results/tracks");
    let node = |track: &Value, frame: usize, node: usize| -> (f64, f64) {
        let p = &track["frames"][frame]["nodes"][node];
        (p[0].as_f64().unwrap(), p[1].as_f64().unwrap())
    };
    let (x, y) = node(&track, 2, 31);
    let wanted = (x + 4.0, y - 3.0);
    let correction = json!([{"node": 31, "x": wanted.0, "y": wanted.1}]);
    // A preview is not saved.
    let preview = server.send("POST", "api/sequences/S001_005/preview", &json!({"frame": 3, "corrections": correction})).ok();
    assert_eq!(preview["nodes"][31], json!([wanted.0, wanted.1]));
    assert!(before == work.files("results/tracks"), "a preview does not change the file");
    let body = json!({"version": track["version"], "frame": 3, "corrections": correction});
    let corrected = server.send("PUT", "api/sequences/S001_005/corrections", &body).ok();
    assert_eq!(server.send("PUT", "api/sequences/S001_005/corrections", &body).status, 409, "the second tab is informed");
    let now = open(&server, "S001_005");
    assert_eq!((node(&now, 2, 31), &now["frames"][2]["states"][31]), (wanted, &json!("corrected")));
    assert_eq!(node(&now, 3, 31), node(&track, 3, 31), "later frames are unchanged");
    let again = server.send("POST", "api/sequences/S001_005/retrack", &json!({"version": corrected["version"], "frame": 3})).ok();
    assert_eq!(node(&again, 2, 31), wanted);
    let moved = |frame: usize| {
        let ((ax, ay), (bx, by)) = (node(&again, frame, 31), node(&track, frame, 31));
        (ax - bx).hypot(ay - by)
    };
    assert!(moved(3) > 1.0 && moved(1) == 0.0, "the correction affects later frames only: {} {}", moved(3), moved(1));
    // Every answer equals the content of the file, and the other track is unchanged.
    let rows = work.rows("results/tracks/S001_005.csv");
    let row = rows.iter().find(|r| r["frame"] == "3" && r["node"] == "31").unwrap();
    assert_eq!(row["state"], "corrected");
    assert_eq!(work.bytes("results/tracks/S002_007.csv"), before["S002_007.csv"]);
    // The neutral frame is not tracked, and a node that is in no triangle cannot be corrected.
    let neutral = json!({"version": again["version"], "frame": 1, "corrections": correction});
    assert!(server.send("PUT", "api/sequences/S001_005/corrections", &neutral).text().contains("fitted, not tracked"));
    let follower = json!({"version": again["version"], "frame": 3, "corrections": [{"node": 35, "x": 9, "y": 9}]});
    assert!(server.send("PUT", "api/sequences/S001_005/corrections", &follower).text().contains("node 35"));
    drop(server);
    // `run` keeps the corrected track and computes everything that depends on it again.
    let corrected = work.bytes("results/tracks/S001_005.csv");
    let model = work.bytes("results/models/S001_005.csv");
    work.grimace("run faces -o results").exit(0).prints(&["2 sequences: 0 tracked, 2 unchanged, 0 failed"]);
    assert!(work.bytes("results/tracks/S001_005.csv") == corrected && work.bytes("results/models/S001_005.csv") != model);
}

#[test]
fn a_look_at_a_track_is_saved_and_ends_where_the_track_changes() {
    let work = Work::after_run(&["S001_005", "S002_007"], "results");
    let server = Server::start(&work, "--tracks results");
    let track = open(&server, "S001_005");
    assert_eq!((&track["look"], &track["reasons"]), (&Value::Null, &json!([])));
    let look = |look: Value, version: &Value| {
        server.send("PUT", "api/sequences/S001_005/look", &json!({"version": version, "look": look}))
    };
    let listed = || server.get("api/sequences").ok()["sequences"].as_array().unwrap().clone();
    let found = |id: &str| listed().iter().find(|s| s["id"] == id).unwrap()["look"].clone();
    assert_eq!(look(json!("leave_out"), &track["version"]).ok(), json!({"look": "leave_out"}));
    let saved = work.read("results/looked_at.csv");
    assert!(saved.starts_with("id,look,content\nS001_005,leave out,b3-"), "{saved}");
    assert_eq!((found("S001_005"), found("S002_007")), (json!("leave_out"), Value::Null));
    // What is not a look is refused, and so is one at another state of the track.
    assert!(!look(json!("fine"), &track["version"]).status.eq(&200));
    assert!(look(json!("outdated"), &track["version"]).text().contains("not looked at"));
    assert_eq!(look(json!("right"), &json!("0")).status, 409);
    assert_eq!(work.read("results/looked_at.csv"), saved);
    work.grimace("run faces -o results").exit(0).prints(&["left out of the statistics after a look (looked_at.csv): S001_005"]);
    // A correction makes another track.
    let at = &track["frames"][2]["nodes"][31];
    let correction = json!([{"node": 31, "x": at[0].as_f64().unwrap() + 4.0, "y": at[1]}]);
    let body = json!({"version": track["version"], "frame": 3, "corrections": correction});
    let corrected = server.send("PUT", "api/sequences/S001_005/corrections", &body).ok();
    assert_eq!(open(&server, "S001_005")["look"], "outdated");
    look(json!("right"), &corrected["version"]).ok();
    work.grimace("run faces -o results").exit(0).prints(&["1 sequence was looked at and found right"]);
    look(Value::Null, &corrected["version"]).ok();
    assert_eq!(found("S001_005"), Value::Null);
    // A file that does not read is left as it is.
    work.write("results/looked_at.csv", "id,look\nS001_005,fine\n");
    assert!(look(json!("right"), &corrected["version"]).text().contains("look is `fine`"));
    assert_eq!(work.read("results/looked_at.csv"), "id,look\nS001_005,fine\n");
}

#[test]
fn tracks_that_do_not_belong_are_named_and_left_out() {
    let work = Work::after_run(&["S001_005", "S002_007"], "results");
    // A track with fewer nodes than the wireframe.
    let short: String = work
        .read("results/tracks/S001_005.csv")
        .lines()
        .filter(|l| l.split(',').nth(1).unwrap().parse::<u32>().map_or(true, |node| node < 50))
        .map(|l| l.to_owned() + "\n")
        .collect();
    work.write("results/tracks/S001_005.csv", short);
    let server = Server::start(&work, "faces --tracks results");
    let list = server.get("api/sequences").ok();
    assert_eq!(list["sequences"].as_array().unwrap().len(), 1);
    assert!(list["failures"][0].as_str().unwrap().contains("the track has 50 nodes, but the wireframe has 113"), "{list}");
    drop(server);
    // The frames have changed.
    fs::remove_file(work.path("results/tracks/S001_005.csv")).unwrap();
    fs::remove_file(work.path("faces/S002/007/S002_007_00000003.png")).unwrap();
    work.grimace("annotate faces --tracks results --no-open").exit(1).says(&["was made from different frames"]);
}

#[test]
fn a_released_correction_leaves_no_trace() {
    let work = Work::after_run(&["S001_005"], "results");
    let server = Server::start(&work, "faces --tracks results");
    let track = open(&server, "S001_005");
    let correct = |version: &Value, corrections: Value| {
        let body = json!({"version": version, "frame": 3, "corrections": corrections});
        server.send("PUT", "api/sequences/S001_005/corrections", &body).ok()["version"].clone()
    };
    let version = correct(&track["version"], json!([{"node": 31, "x": 90, "y": 90}, {"node": 64, "x": 60, "y": 90}]));
    let version =
        server.send("POST", "api/sequences/S001_005/retrack", &json!({"version": version, "frame": 3})).ok()["version"].clone();
    let version = correct(&version, json!([]));
    let again = server.send("POST", "api/sequences/S001_005/retrack", &json!({"version": version, "frame": 3})).ok();
    // Positions come from the file with nine digits. Such a difference may decide whether a node near a limit is lost, which
    // moves that node by a fraction of a pixel in this small picture; the corrections moved their nodes by many pixels.
    let mut apart = Vec::new();
    for frame in 0..6 {
        for node in 0..113 {
            let at = |t: &Value, axis: usize| t["frames"][frame]["nodes"][node][axis].as_f64().unwrap();
            let distance = (at(&again, 0) - at(&track, 0)).hypot(at(&again, 1) - at(&track, 1));
            assert!(distance < 0.5, "frame {frame}, node {node}: {distance} px");
            if distance > 0.016 {
                apart.push((frame, node));
            }
        }
    }
    assert!(apart.len() <= 6 * 113 / 50, "{apart:?}");
}

#[test]
fn corrections_far_from_the_face_are_reported_as_by_run() {
    let work = Work::after_run(&["S001_005"], "results");
    let server = Server::start(&work, "--tracks results");
    let track = open(&server, "S001_005");
    let put = |version: &Value, frame: u32, node: u16, x: f64, y: f64| {
        let body = json!({"version": version, "frame": frame, "corrections": [{"node": node, "x": x, "y": y}]});
        server.send("PUT", "api/sequences/S001_005/corrections", &body).ok()["version"].clone()
    };
    let far = || -> Value {
        let info: Value = serde_json::from_str(&work.read("results/tracks/S001_005.json")).unwrap();
        info["corrections"]["far"].clone()
    };
    let version = put(&track["version"], 3, 31, 5.0, 5.0);
    let named = far();
    assert!(named[0].as_str().unwrap().starts_with("frame 3, node 31 at (5, 5): ") && named[1].is_null(), "{named}");
    // A second, valid correction does not hide the first warning. A run that tracks again reports both in the same way.
    let place = &track["frames"][4]["nodes"][64];
    put(&version, 5, 64, place[0].as_f64().unwrap() + 2.0, place[1].as_f64().unwrap());
    assert_eq!(far(), named);
    drop(server);
    ["csv", "json"].iter().for_each(|end| fs::remove_file(work.path(&format!("results/tracks/S001_005.{end}"))).unwrap());
    work.grimace("run faces -o results").exit(0).prints(&["1 tracked"]);
    assert_eq!(far(), named);
}

#[test]
fn inputs_that_cannot_be_annotated_are_reported() {
    let work = unmarked();
    work.grimace("annotate").exit(2);
    work.grimace("annotate nowhere --no-open").exit(1).says(&["nowhere: there is no such dataset"]);
    work.grimace("annotate --tracks nowhere --no-open").exit(1).says(&["nowhere"]);
    fs::create_dir(work.path("empty")).unwrap();
    work.grimace("annotate faces --tracks empty --no-open").exit(1).says(&["no tracks found"]);
    work.write("bad/manifest.csv", "subject,sequence,emotion\n../x,1,joy\n");
    work.grimace("annotate bad --no-open").exit(1).says(&["no sequence can be annotated", "path separator"]);
    let marked = Work::after_run(&["S001_005"], "results");
    fs::rename(marked.path("faces"), marked.path("elsewhere")).unwrap();
    marked
        .grimace("annotate --tracks results --no-open")
        .exit(1)
        .says(&["the dataset of this run, `faces`, is neither", "grimace annotate DATASET --tracks"]);
    let server = Server::start(&marked, "elsewhere --tracks results");
    assert_eq!(server.lines[0], "1 track, sorted by lost nodes, worst first");
}

/// Number of times a server is killed during its work; `GRIMACE_KILLS=200` runs the full campaign.
fn kills() -> u64 {
    std::env::var("GRIMACE_KILLS").ok().and_then(|text| text.parse().ok()).unwrap_or(5)
}

#[test]
fn acknowledged_corrections_survive_every_kill() {
    let work = Work::after_run(&["S001_005"], "results");
    let mut saved: std::collections::BTreeMap<(u32, u16), f64> = std::collections::BTreeMap::new();
    let (mut acknowledged, mut lost, mut process) = (0, Vec::new(), 0);
    for kill in 0..kills() {
        let server = Server::start(&work, "faces --tracks results");
        process = server.process();
        // The delay is different every time, from almost nothing to well into the third correction.
        let delay = Duration::from_millis(5 + (kill * 37) % 200);
        let killer = thread::spawn(move || {
            thread::sleep(delay);
            assert!(std::process::Command::new("kill").args(["-9", &process.to_string()]).status().unwrap().success());
        });
        let mut under_way = None;
        for step in 0..1000 {
            let (frame, node) = (2 + step % 4, 31);
            let x = 80.0 + kill as f64 / 16.0 + f64::from(step) / 1024.0;
            let version = {
                let mut stream = match TcpStream::connect(&server.authority) {
                    Ok(stream) => stream,
                    Err(_) => break,
                };
                let head = format!(
                    "GET {}/api/sequences/S001_005 HTTP/1.1\r\nHost: {}\r\nConnection: close\r\n\r\n",
                    server.token, server.authority
                );
                let mut bytes = Vec::new();
                let _ = stream.write_all(head.as_bytes()).and_then(|()| stream.read_to_end(&mut bytes).map(|_| ()));
                let text = String::from_utf8_lossy(&bytes).into_owned();
                let Some(body) = text.split_once("\r\n\r\n").and_then(|(_, body)| serde_json::from_str::<Value>(body).ok())
                else {
                    break;
                };
                body["version"].clone()
            };
            let body = json!({"version": version, "frame": frame, "corrections": [{"node": node, "x": x, "y": 100.0}]});
            under_way = Some(((frame, node), x));
            match server.try_send("PUT", "api/sequences/S001_005/corrections", &body) {
                Some(200) => {
                    acknowledged += 1;
                    saved.insert((frame, node), x);
                    under_way = None;
                }
                _ => break,
            }
        }
        killer.join().unwrap();
        drop(server);
        let rows = if work.path("results/corrections/S001_005.csv").exists() {
            work.rows("results/corrections/S001_005.csv")
        } else {
            Vec::new()
        };
        let number = |row: &std::collections::BTreeMap<String, String>, name: &str| row[name].parse::<f64>().unwrap();
        let found: std::collections::BTreeMap<(u32, u16), f64> =
            rows.iter().map(|r| ((number(r, "frame") as u32, number(r, "node") as u16), number(r, "x"))).collect();
        for (&place, &x) in &saved {
            // The correction that was being saved when the process was killed may be there or not.
            let or = under_way.filter(|(at, _)| *at == place).map(|(_, x)| x);
            if found.get(&place).is_none_or(|&is| (is - x).abs() > 1e-6 && or.is_none_or(|or| (is - or).abs() > 1e-6)) {
                lost.push((kill, place));
            }
        }
        saved = found;
    }
    assert!(lost.is_empty(), "lost after kills: {lost:?}");
    println!("{} kills, {acknowledged} corrections acknowledged, none lost", kills());
    // Whatever state the last kill left, a run applies every correction and leaves no partly written file. Not every kill
    // leaves a temporary file, so one is created as the last server would have left it.
    let machine = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap();
    let machine = &blake3::hash(machine.trim_end().as_bytes()).to_hex()[..8];
    work.write(&format!("results/corrections/.grimace-{machine}-{process}-abcdef.tmp"), "frame,node,x,y\n2,31,80");
    work.grimace("run faces -o results").exit(0);
    let rows = work.rows("results/tracks/S001_005.csv");
    for ((frame, node), x) in saved {
        let row = rows.iter().find(|r| r["frame"] == frame.to_string() && r["node"] == node.to_string()).unwrap();
        assert_eq!(row["state"], "corrected");
        assert!((row["x"].parse::<f64>().unwrap() - x).abs() < 1e-6);
    }
    assert_eq!(crate::common::leftovers(&work.files("results")), Vec::<&String>::new());
}

#[test]
fn a_file_that_the_manifest_no_longer_lists_is_not_written() {
    let work = Work::with_sequences(&["S001_005"]);
    let server = Server::start(&work, "faces --all");
    let opened = open(&server, "S001_005");
    work.write("faces/other.csv", "node,x,y\n20,80,60\n53,120,60\n31,80,100\n");
    work.replace("faces/manifest.csv", "S001/005/correspondences.csv", "other.csv");
    let before = work.bytes("faces/S001/005/correspondences.csv");
    let answer = save(&server, "S001_005", &opened["version"], &true_marks("S001/005")[..4]);
    assert_eq!(answer.status, 409, "{}", answer.text());
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), before);
    let now = open(&server, "S001_005");
    assert_eq!((&now["file"], now["marks"].as_array().unwrap().len()), (&json!("other.csv"), 3));
    save(&server, "S001_005", &now["version"], &true_marks("S001/005")[..4]).ok();
    assert_eq!(work.rows("faces/other.csv").len(), 4);
    assert_eq!(work.bytes("faces/S001/005/correspondences.csv"), before);
    // A sequence that is no longer in the manifest is not saved.
    work.write("faces/manifest.csv", format!("{}\n", work.header("faces/manifest.csv")) + "S009,001,fear,,,,,,,,,,\n");
    assert_ne!(save(&server, "S001_005", &now["version"], &true_marks("S001/005")).status, 200);
}
