//! Tracks in `grimace annotate`: corrections, and looks.

use crate::annotation::Server;
use crate::cmd_annotate::open;
use crate::common::Work;
use serde_json::{Value, json};
use std::{
    fs,
    io::{Read, Write},
    net::TcpStream,
    thread,
    time::Duration,
};

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
