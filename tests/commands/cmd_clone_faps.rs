//! FAP files on photographs: lids, lips, what cannot be shown.

use crate::cmd_clone::{clone, picture, work};
use grimace::internal::fap::{FapNumber, read_fap};
use image::RgbImage;

pub fn fap_file(mask: &[usize], values: &str) -> String {
    let flags = (1..=68).map(|k| if mask.contains(&k) { "1" } else { "0" }).collect::<Vec<_>>().join(" ");
    let zeros = mask.iter().map(|_| "0").collect::<Vec<_>>().join(" ");
    format!("2.1 test 25 2\n{flags}\n0 {zeros}\n{flags}\n1 {values}\n")
}

#[test]
fn faps_close_the_eyes_and_faps_that_cannot_be_shown_are_reported() {
    let work = work();
    // Upper lids closed by one IRISD (FAP 19, 20); a tongue (44) and a head turned by 0.1 rad (49), which no photograph can
    // show.
    work.write("blink.fap", fap_file(&[19, 20, 44, 49], "1024 1024 500 10000"));
    clone(&work, "--source blink.fap -o blink").exit(0).says(&["FAP 44, 49 cannot be shown"]);
    assert!(work.read("blink/clone.json").contains("44"));
    let rows = work.rows("blink/track/target_blink.csv");
    let gap = |frame: &str| {
        let y = |node: &str| {
            let row = rows.iter().find(|r| r["frame"] == frame && r["node"] == node).unwrap();
            row["y"].parse::<f64>().unwrap()
        };
        y("22") - y("21")
    };
    assert!(gap("2") < 0.25 * gap("1"), "the lids close: {} of {}", gap("2"), gap("1"));
    work.write("tongue.fap", fap_file(&[44], "500"));
    clone(&work, "--source tongue.fap -o tongue").exit(1).says(&["tongue.fap: none of its FAPs (44) can be shown"]);
}

#[test]
fn lids_move_by_the_values_of_a_fap_file_on_any_face() {
    let work = work();
    // The marked lids are wider apart than the iris boxes, which the springs carry: the unit of the lids is their opening.
    let marks = work.read("marks.csv");
    let mark = |node: &str| -> [f64; 2] {
        let line = marks.lines().find(|line| line.starts_with(&format!("{node},"))).unwrap();
        let values: Vec<f64> = line.split(',').skip(1).take(2).map(|value| value.parse().unwrap()).collect();
        [values[0], values[1]]
    };
    let lids: String = [("20", "23", [21, 22]), ("53", "56", [54, 55])]
        .into_iter()
        .flat_map(|(outer, inner, nodes)| {
            let ([ax, ay], [bx, by]) = (mark(outer), mark(inner));
            let half = 0.19 * (ax - bx).hypot(ay - by);
            let (x, y) = (f64::midpoint(ax, bx), f64::midpoint(ay, by));
            [format!("{},{x},{}\n", nodes[0], y - half), format!("{},{x},{}\n", nodes[1], y + 0.8 * half)]
        })
        .collect();
    work.write("marks.csv", format!("{}\n{lids}", marks.trim_end()));
    let values = |name: &str| {
        let sequence = read_fap(&work.path(name)).unwrap().sequence;
        [19, 20, 21, 22, 31].map(|fap| sequence.frames.last().unwrap().value(FapNumber::try_from(fap).unwrap()).unwrap())
    };
    work.write("lids.fap", fap_file(&[19, 20, 21, 22, 31], "300 -200 100 150 300"));
    clone(&work, "--source lids.fap -o once").exit(0);
    clone(&work, "--source once/clone.fap -o twice").exit(0);
    let near = |found: [f64; 5]| found.iter().zip([300.0, -200.0, 100.0, 150.0, 300.0]).all(|(a, b)| (a - b).abs() <= 4.0);
    assert!(
        near(values("once/clone.fap")) && near(values("twice/clone.fap")),
        "{:?} {:?}",
        values("once/clone.fap"),
        values("twice/clone.fap")
    );
    // A track moves the lids in the same way as its own FAP file.
    work.grimace("run faces -o out -q").exit(0);
    clone(&work, "--source out/tracks/S001_005.csv -o track").exit(0);
    clone(&work, "--source out/fap/tracks/S001_005.fap -o fap").exit(0);
    let (track, fap) = (values("track/clone.fap"), values("fap/clone.fap"));
    assert!(track.iter().zip(&fap).take(4).all(|(a, b)| (a - b).abs() < 20.0), "{track:?} {fap:?}");
    // With --head, the turns of the head are those of the track's own FAP file, from its first frame on.
    clone(&work, "--source out/tracks/S001_005.csv --head -o head").exit(0);
    let head = |name: &str| -> Vec<[Option<f64>; 3]> {
        let sequence = read_fap(&work.path(name)).unwrap().sequence;
        sequence.frames.iter().map(|f| [48, 49, 50].map(|fap| f.value(FapNumber::try_from(fap).unwrap()))).collect()
    };
    let (cloned, tracked) = (head("head/clone.fap"), head("out/fap/tracks/S001_005.fap"));
    assert_eq!(cloned.len(), tracked.len());
    for (cloned, tracked_now) in cloned.iter().zip(&tracked) {
        for axis in 0..3 {
            let turn = tracked_now[axis].unwrap() - tracked[0][axis].unwrap();
            assert!((cloned[axis].unwrap() - turn).abs() <= 2.0, "{cloned:?} {tracked_now:?} {:?}", tracked[0]);
        }
    }
    assert_eq!(head("track/clone.fap")[1], [None; 3]);
}

#[test]
fn only_faps_that_the_file_sets_are_reported_as_clamped() {
    let work = work();
    // A jaw that falls by nine times the distance from nose to mouth takes the lips along, as far as skin stretches.
    work.write("jaw.fap", fap_file(&[3], "9000"));
    clone(&work, "--source jaw.fap -o jaw").exit(0).says(&["open_jaw is 9000; the standard allows ", "reduced FAP 3 open_jaw ("]);
    let info: serde_json::Value = serde_json::from_str(&work.read("jaw/clone.json")).unwrap();
    let cut: Vec<_> = info["faps_cut"].as_array().unwrap().iter().map(|cut| cut["fap"].as_u64().unwrap()).collect();
    assert_eq!(cut, [3], "{info}");
    let changed = info["faps_changed"].as_array().unwrap();
    assert!(changed.iter().all(|changed| changed["fap"] == 3), "{info}");
}

#[test]
fn puffed_cheeks_leave_the_mouth_where_it_is() {
    let work = work();
    work.write("puff.fap", fap_file(&[39, 40], "400 400"));
    clone(&work, "--source puff.fap -o puff").exit(0);
    let rows = work.rows("puff/track/target_puff.csv");
    let aside = |node: &str| {
        let x =
            |frame: &str| rows.iter().find(|r| r["frame"] == frame && r["node"] == node).unwrap()["x"].parse::<f64>().unwrap();
        (x("2") - x("1")).abs()
    };
    // Cheek and corner of the mouth, left and right.
    for (cheek, corner) in [("90", "31"), ("91", "64")] {
        assert!(aside(cheek) > 10.0 && aside(corner) < 0.1 * aside(cheek), "{} px, {} px", aside(cheek), aside(corner));
    }
}

#[test]
fn an_open_mouth_has_teeth_unless_dark_is_requested() {
    let work = work();
    // The upper lip moves up, the lower lip down.
    work.write("open.fap", fap_file(&[4, 5, 8, 9, 10, 11], "-250 -400 -200 -200 -350 -350"));
    for teeth in ["auto", "drawn", "dark"] {
        clone(&work, &format!("--source open.fap -o {teeth} --teeth {teeth}")).exit(0);
    }
    let apex = |teeth: &str| picture(&work, &format!("{teeth}/frames/target_00000002.png"));
    assert_eq!(apex("auto"), apex("drawn"), "a FAP file has no pictures of teeth");
    let brightness = |p: &RgbImage| p.pixels().map(|p| u64::from(p.0[1])).sum::<u64>();
    assert!(brightness(&apex("drawn")) > brightness(&apex("dark")));
}
