//! The page of `grimace annotate` in headless Chromium, operated by clicks, keys and touch.
//!
//! `GRIMACE_SCREENSHOTS=DIR` saves screenshots.

use crate::annotation::Server;
use crate::common::Work;
use crate::driver::{Browser, CONTROL, DELETE, DOWN, END, ENTER, ESCAPE, HOME, LEFT, RIGHT, SHIFT, wait};
use serde_json::{Value, json};
use std::{fs, path::Path, thread::sleep, time::Duration};

/// Makes sequences without correspondences and without a column for them.
pub fn unmarked(ids: &[&str]) -> Work {
    let work = Work::with_sequences(ids);
    let mut manifest = "subject,sequence,emotion\n".to_owned();
    for id in ids {
        fs::remove_file(work.path(&format!("faces/{}/correspondences.csv", id.replace('_', "/")))).unwrap();
        manifest += &format!("{},happiness\n", id.replace('_', ","));
    }
    work.write("faces/manifest.csv", manifest);
    work
}

/// Returns the true position of a node in the neutral frame of a simulated sequence.
pub fn truth(sequence: &str, node: u64) -> (f64, f64) {
    let file = &crate::common::FACES[&format!("truth/{sequence}.csv")];
    let mut reader = csv::Reader::from_reader(file.as_slice());
    let rows = reader.deserialize::<std::collections::BTreeMap<String, String>>().map(Result::unwrap);
    let mut row = rows.filter(|r| r["node"] == node.to_string());
    let row = row.next().unwrap();
    (row["x"].parse().unwrap(), row["y"].parse().unwrap())
}

/// Opens the page at a window size.
pub fn open(browser: &Browser, server: &Server, size: (u32, u32)) {
    browser.size(size.0, size.1);
    browser.go(&server.url);
    wait(
        browser,
        "document.querySelector('#sequence').textContent.includes('_') && document.querySelector('#stage').dataset.frame > 0",
    );
    wait(browser, "document.querySelector('#photo').getBoundingClientRect().width > 50");
}

pub fn text(browser: &Browser, id: &str) -> String {
    browser.text(&format!("return document.getElementById('{id}').textContent"))
}

/// Returns the window position of an image position.
pub fn place(browser: &Browser, (x, y): (f64, f64)) -> (f64, f64) {
    let script = format!("const m = document.getElementById('world').getScreenCTM(); return [m.a * {x} + m.e, m.d * {y} + m.f]");
    let place = browser.run(&script);
    (place[0].as_f64().unwrap(), place[1].as_f64().unwrap())
}

/// Returns the image position of a mark of a kind at a node.
pub fn mark(browser: &Browser, kind: &str, node: u64) -> (f64, f64) {
    let script = format!(
        "return document.querySelector('.pin.{kind}[data-node=\"{node}\"]').getAttribute('transform').match(/-?[0-9.]+/g).map(Number)"
    );
    let numbers = browser.run(&script);
    (numbers[0].as_f64().unwrap(), numbers[1].as_f64().unwrap())
}

/// Returns the node that the page asks for.
pub fn asked(browser: &Browser) -> Option<u64> {
    browser.run("return Number(document.querySelector('.pickable.next')?.dataset.node ?? -1)").as_u64()
}

fn wire(browser: &Browser) -> String {
    browser.text("return document.querySelector('#wire .contour').getAttribute('d')")
}

pub fn saved(browser: &Browser) {
    wait(browser, "document.getElementById('saved').className === 'saved'");
}

pub fn rows(work: &Work, sequence: &str) -> Vec<(u64, f64, f64, String)> {
    let rows = work.rows(&format!("faces/{sequence}/correspondences.csv"));
    rows.iter()
        .map(|r| (r["node"].parse().unwrap(), r["x"].parse().unwrap(), r["y"].parse().unwrap(), r["kind"].clone()))
        .collect()
}

/// Dismisses the proposals, if there are any; most simulated faces are found.
pub fn no_proposals(browser: &Browser) {
    wait(browser, "document.getElementById('proposal-bar').dataset.answered === document.getElementById('sequence').textContent");
    browser.run("document.getElementById('dismiss').click()");
    wait(browser, "document.querySelectorAll('.pin.proposal').length === 0");
}

#[test]
fn a_whole_session_by_clicks_and_keys() {
    let work = unmarked(&["S001_005", "S002_007"]);
    // An unusual port, so that the server of another test cannot take it while this one is down.
    let server = Server::start(&work, "faces --port 0");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    assert_eq!((text(&browser, "sequence"), text(&browser, "left")), ("S001_005".into(), "2 of 2 left".into()));
    assert_eq!((text(&browser, "step"), text(&browser, "target")), ("Mark 1 of 11".into(), "Left eye: outer corner".into()));

    // Eleven marks by clicks. From the third mark on, the wireframe is shown and moves.
    let mut wires = Vec::new();
    for count in 1..=11 {
        let node = asked(&browser).unwrap();
        browser.click(place(&browser, truth("S001_005", node)));
        wait(&browser, &format!("document.querySelectorAll('.pin.mark').length === {count}"));
        if count >= 3 {
            wait(
                &browser,
                &format!(
                    "document.querySelector('#wire .contour').getAttribute('d') !== {}",
                    json!(wires.last().unwrap_or(&String::new()))
                ),
            );
            wires.push(wire(&browser));
        } else {
            assert_eq!(wire(&browser), "");
        }
    }
    assert_eq!((asked(&browser), text(&browser, "target")), (None, "All marked".into()));
    saved(&browser);
    let file = rows(&work, "S001/005");
    assert_eq!(file.len(), 11);
    for (node, x, y, kind) in &file {
        let (tx, ty) = truth("S001_005", *node);
        // A click hits a pixel of the window, which is less than half a pixel of the image.
        assert!((x - tx).abs() < 0.5 && (y - ty).abs() < 0.5 && kind == "mark", "node {node}: {x} {y}, true {tx} {ty}");
    }
    browser.screenshot("annotate-marked", false);

    // Dragging a mark moves the wireframe before the mark is released.
    let before = wire(&browser);
    let (x, y) = mark(&browser, "mark", 10);
    let start = place(&browser, (x, y));
    browser.press_pointer(&[start, (start.0 + 6.0, start.1 + 6.0), (start.0 + 12.0, start.1 + 20.0)]);
    wait(&browser, &format!("document.querySelector('#wire .contour').getAttribute('d') !== {}", json!(before)));
    assert!(
        browser.run("return document.getElementById('loupe').classList.contains('shown')") == json!(true),
        "the magnifier is shown"
    );
    browser.screenshot("annotate-dragging", false);
    let during = wire(&browser);
    browser.release_pointer();
    saved(&browser);
    let moved = mark(&browser, "mark", 10);
    assert!(moved.0 > x && moved.1 > y);
    wait(&browser, &format!("document.querySelector('#wire .contour').getAttribute('d') !== {}", json!(before)));
    assert!(!during.is_empty());

    // Move by keys, undo, redo.
    browser.press(&RIGHT.to_string());
    assert_eq!(mark(&browser, "mark", 10), ((moved.0 + 1.0) * 100.0 / 100.0, moved.1));
    browser.chord(&[SHIFT], LEFT);
    let nudged = mark(&browser, "mark", 10);
    assert!((nudged.0 - moved.0 - 0.9).abs() < 1e-6 && nudged.1 == moved.1, "{nudged:?}");
    sleep(Duration::from_millis(800));
    browser.chord(&[CONTROL], DOWN);
    assert!((mark(&browser, "mark", 10).1 - moved.1 - 10.0).abs() < 1e-6);
    browser.chord(&[CONTROL], 'z');
    assert_eq!(mark(&browser, "mark", 10), nudged);
    browser.chord(&[CONTROL], 'z');
    assert_eq!(mark(&browser, "mark", 10), moved);
    browser.chord(&[CONTROL], 'z');
    assert_eq!(mark(&browser, "mark", 10), (x, y));
    browser.chord(&[CONTROL, SHIFT], 'z');
    assert_eq!(mark(&browser, "mark", 10), moved);
    browser.chord(&[CONTROL], 'z');
    saved(&browser);
    assert_eq!(rows(&work, "S001/005"), file, "after undo the file is the same, byte for byte");

    // Dragging a fitted node sets a hard position, which can be released.
    let nose = browser.run(
        "const far = ([x, y]) => Math.hypot(x - 100, y - 80);
         const dots = [...document.querySelectorAll('#dots .dot.fitted')].pop().getAttribute('d').match(/M[^h]+/g);
         return dots.map((p) => p.slice(1).split(' ').map(Number)).sort((a, b) => far(a) - far(b))[0]",
    );
    let (x, y) = (nose[0].as_f64().unwrap(), nose[1].as_f64().unwrap());
    let start = place(&browser, (x, y));
    browser.drag("mouse", &[start, (start.0 + 5.0, start.1 + 5.0), (start.0 + 9.0, start.1 + 9.0)]);
    wait(&browser, "document.querySelectorAll('.pin.hard').length === 1");
    saved(&browser);
    assert_eq!(rows(&work, "S001/005").iter().filter(|r| r.3 == "hard").count(), 1);
    assert!(text(&browser, "list").contains("set by hand"));
    browser.press(&DELETE.to_string());
    wait(&browser, "document.querySelectorAll('.pin.hard').length === 0");
    saved(&browser);
    assert_eq!(rows(&work, "S001/005"), file);

    // Everything was loaded from this server.
    let foreign =
        "return performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !n.startsWith(location.origin))";
    assert_eq!(browser.run(foreign), json!([]));
    browser.no_errors();

    // The next sequence with keys only: Space places marks, arrows move them.
    browser.press(&ENTER.to_string());
    wait(&browser, "document.getElementById('sequence').textContent === 'S002_007'");
    assert_eq!(text(&browser, "left"), "1 of 2 left");
    no_proposals(&browser);
    for count in 1..=11 {
        let node = asked(&browser).unwrap();
        let (tx, ty) = truth("S002_007", node);
        browser.press(" ");
        wait(&browser, &format!("document.querySelectorAll('.pin.mark').length === {count}"));
        let (x, y) = mark(&browser, "mark", node);
        for (distance, less, more) in [(tx - x, LEFT, RIGHT), (ty - y, crate::driver::UP, DOWN)] {
            let steps = distance.abs().round() as usize;
            let key = if distance < 0.0 { less } else { more };
            (0..steps / 10).for_each(|_| browser.chord(&[CONTROL], key));
            browser.press(&key.to_string().repeat(steps % 10));
        }
        sleep(Duration::from_millis(30));
    }
    saved(&browser);
    assert_eq!((rows(&work, "S002/007").len(), text(&browser, "left").as_str()), (11, "0 of 2 left"));
    browser.press(&ENTER.to_string());
    wait(&browser, "document.getElementById('ask').open");
    assert_eq!(text(&browser, "ask-title"), "Nothing left to mark");
    browser.press(&ESCAPE.to_string());

    // After a reload the marks are still there.
    let shown = wire(&browser);
    browser.post("/refresh", &json!({}));
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 11");
    wait(&browser, &format!("document.querySelector('#wire .contour').getAttribute('d') === {}", json!(shown)));
    browser.no_errors();

    // After the server is killed, a moved mark is kept in the browser, which says so.
    let port = server.port();
    server.kill();
    browser.run("document.querySelector('[data-pick=\"10\"]').click()");
    browser.run("document.getElementById('stage').focus()");
    browser.press(&RIGHT.to_string());
    wait(&browser, "document.getElementById('saved').className === 'failed'");
    assert!(text(&browser, "saved").starts_with("Not saved"));
    let waiting = mark(&browser, "mark", 10);
    browser.screenshot("annotate-no-server", false);
    let server = Server::start(&work, &format!("faces --all --port {port}"));
    // The old address is no longer valid; the page at the new one finds the change.
    browser.run("window.onbeforeunload = null");
    browser.go("about:blank");
    let _ = browser.try_post("/alert/accept", &json!({}));
    browser.go(&format!("{}#S002_007", server.url));
    wait(&browser, "document.getElementById('ask')?.open");
    assert_eq!(text(&browser, "ask-title"), "Marks that were not saved");
    browser.run("document.getElementById('ask-yes').click()");
    saved(&browser);
    assert_eq!(mark(&browser, "mark", 10), waiting);
    let chin = rows(&work, "S002/007").into_iter().find(|r| r.0 == 10).unwrap();
    assert_eq!((chin.1, chin.2), waiting);
    drop(server);
    work.grimace("run faces -o results -q").exit(0);
    assert!(work.read("results/failures.csv").lines().count() == 1, "{}", work.read("results/failures.csv"));
}

#[test]
fn proposals_count_only_once_accepted() {
    let work = unmarked(&["S001_005"]);
    let header: String = (0..68).map(|k| format!(",x{k},y{k}")).collect();
    // Only some landmarks are proposed, as their nodes: eye corners, mouth corners, chin, ends of the brows.
    let nodes = [(45, 20), (42, 23), (36, 53), (39, 56), (54, 31), (48, 64), (8, 10), (26, 15), (22, 17), (17, 48), (21, 50)];
    let point = |k: u64| nodes.iter().find(|(l, _)| *l == k).map_or((1.0, 1.0), |&(_, node)| truth("S001_005", node));
    let points: String = (0..68).map(|k| format!(",{},{}", point(k).0, point(k).1)).collect();
    work.write("faces/S001/005/landmarks.csv", format!("frame{header}\n1{points}\n"));
    work.write("faces/manifest.csv", "subject,sequence,emotion,landmarks\nS001,005,happiness,landmarks.csv\n");
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    wait(&browser, "document.querySelectorAll('.pin.proposal').length === 11");
    assert!(text(&browser, "proposal-text").starts_with("11 points proposed from the dataset’s landmarks"));
    wait(&browser, "document.querySelector('#wire').classList.contains('faint')");
    assert_eq!(text(&browser, "left"), "1 of 1 left");
    browser.screenshot("annotate-proposed", false);
    assert!(!work.path("faces/S001/005/correspondences.csv").exists());
    // A click accepts one of them, a key all others.
    browser.click(place(&browser, mark(&browser, "proposal", 10)));
    wait(&browser, "document.querySelectorAll('.pin.proposal').length === 10");
    saved(&browser);
    assert_eq!(rows(&work, "S001/005").len(), 1);
    browser.press("a");
    wait(&browser, "document.querySelectorAll('.pin.proposal').length === 0");
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 11");
    saved(&browser);
    assert_eq!(rows(&work, "S001/005").len(), 11);
    browser.no_errors();
}

#[test]
fn a_sequence_that_cannot_be_opened_accepts_no_marks() {
    let work = unmarked(&["S001_005", "S002_007"]);
    for name in crate::common::files_in(&work.path("faces/S002/007")).keys().filter(|name| name.ends_with(".png")) {
        work.write(&format!("faces/S002/007/{name}"), "no picture");
    }
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    browser.run("document.getElementById('next').click()");
    wait(&browser, "document.getElementById('sequence').textContent === 'S002_007'");
    assert!(text(&browser, "notice").starts_with("S002_007: "), "{}", text(&browser, "notice"));
    assert_eq!(browser.run("return document.getElementById('photo').hasAttribute('href')"), json!(false));
    for key in [" ", "a", "f", "z", "]"] {
        browser.press(key);
    }
    browser.click((500.0, 400.0));
    assert!(
        !work.path("faces/S001/005/correspondences.csv").exists() && !work.path("faces/S002/007/correspondences.csv").exists()
    );
    browser.run("document.getElementById('previous').click()");
    wait(&browser, "document.getElementById('sequence').textContent === 'S001_005'");
    no_proposals(&browser);
    browser.press(" ");
    saved(&browser);
    assert_eq!(rows(&work, "S001/005").len(), 1);
    // The page reports that the frames cannot be loaded; there are no other errors.
}

#[test]
fn frames_are_stepped_through_and_chosen() {
    let work = unmarked(&["S001_005"]);
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    browser.press("..");
    wait(&browser, "document.getElementById('frame-text').textContent.startsWith('Frame 3')");
    // A tap on another frame sets no mark and gives the reason.
    browser.click(place(&browser, (100.0, 80.0)));
    wait(&browser, "!document.getElementById('notice').hidden");
    assert!(text(&browser, "notice").contains("Marks belong to the neutral frame, 1"));
    browser.press("f");
    wait(&browser, "document.getElementById('frame-text').textContent === 'Frame 3 · neutral'");
    browser.press(&END.to_string());
    browser.press(",");
    browser.press("l");
    wait(&browser, "document.getElementById('frame-text').textContent === 'Frame 5 · apex'");
    browser.press(&HOME.to_string());
    wait(&browser, "document.getElementById('frame-text').textContent === 'Frame 3 · neutral'");
    assert_eq!(work.read("faces/manifest.csv"), "subject,sequence,emotion,first_frame,last_frame\nS001,005,happiness,3,5\n");
    browser.no_errors();
}

#[test]
fn it_fits_desks_tablets_and_phones_in_light_and_dark() {
    let work = unmarked(&["S001_005", "S002_007"]);
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    for _ in 0..4 {
        let node = asked(&browser).unwrap();
        browser.click(place(&browser, truth("S001_005", node)));
        saved(&browser);
    }
    let luminance = |property: &str| {
        let script = format!("return getComputedStyle(document.body).{property}.match(/[0-9.]+/g).slice(0, 3).map(Number)");
        let rgb: Vec<f64> = browser.run(&script).as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        0.21 * rgb[0] + 0.72 * rgb[1] + 0.07 * rgb[2]
    };
    for (name, width, height) in
        [("desk", 1280, 720), ("landscape", 1024, 768), ("upright", 768, 1024), ("window", 520, 900), ("phone", 360, 780)]
    {
        browser.size(width, height);
        wait(&browser, &format!("innerWidth === {width}"));
        for scheme in ["light", "dark"] {
            browser.media("", "prefers-color-scheme", scheme);
            let (ground, ink) = (luminance("backgroundColor"), luminance("color"));
            assert!(
                if scheme == "light" { ground > 220.0 && ink < 60.0 } else { ground < 40.0 && ink > 200.0 },
                "{scheme}: {ground} {ink}"
            );
            sleep(Duration::from_millis(100));
            browser.screenshot(&format!("annotate-{name}-{scheme}"), false);
        }
        // No control overflows the window or is covered; every control can be pressed.
        assert_eq!(
            browser.run("return [document.documentElement.scrollWidth, document.documentElement.scrollHeight]"),
            json!([width, height])
        );
        let covered = "return ['previous', 'pick', 'next', 'theme', 'help-open', 'zoom-in', 'wire-toggle', 'node', 'undo', 'frame-back', 'set-apex', 'list-title', 'target'].filter((id) => {
            const r = document.getElementById(id).getBoundingClientRect();
            const at = document.elementFromPoint(r.x + r.width / 2, r.y + r.height / 2);
            return !at || !(at.id === id || at.closest('#' + id)); })";
        assert_eq!(browser.run(covered), json!([]), "{name}");
        let sizes = "return ['diagram', 'strip-box', 'stage'].map((id) => document.getElementById(id).getBoundingClientRect()).flatMap((r) => [r.width, r.height])";
        let sizes: Vec<f64> = browser.run(sizes).as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        let least = [100.0, 100.0, 200.0, 40.0, 340.0, 250.0];
        assert!(sizes.iter().zip(least).all(|(size, least)| *size >= least), "{name}: {sizes:?}");
        let outside = "return [...document.querySelectorAll('#panel *, #bar *, #scrubber *')].filter((e) => e.checkVisibility() && e.getBoundingClientRect().right > innerWidth + 0.5).map((e) => e.id || e.tagName)";
        assert_eq!(browser.run(outside), json!([]), "{name}");
    }
    browser.size(768, 1024);
    // Every control has a name, and the focus is visible.
    let nameless = "return [...document.querySelectorAll('button, select, input, [role=button], progress')].filter((e) =>
        e.getBoundingClientRect().width && !(e.getAttribute('aria-label') || e.textContent.trim() || e.closest('label') || e.title)).map((e) => e.outerHTML)";
    assert_eq!(browser.run(nameless), json!([]));
    browser.press("\u{e004}");
    assert_ne!(browser.text("return getComputedStyle(document.activeElement).outlineStyle"), "none");
    // A finger sets a mark and drags it.
    browser.devtools("Emulation.setTouchEmulationEnabled", &json!({"enabled": true}));
    let node = asked(&browser).unwrap();
    browser.drag("touch", &[place(&browser, truth("S001_005", node))]);
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 5");
    saved(&browser);
    let start = place(&browser, mark(&browser, "mark", node));
    let before = mark(&browser, "mark", node);
    // A touch ten pixels beside the mark takes it, and the mark does not jump to the finger.
    browser.drag("touch", &[(start.0 + 10.0, start.1), (start.0 + 30.0, start.1), (start.0 + 50.0, start.1)]);
    saved(&browser);
    let zoom = browser.run("return document.getElementById('world').getScreenCTM().a").as_f64().unwrap();
    let moved = mark(&browser, "mark", node).0 - before.0;
    assert!((moved - 40.0 / zoom).abs() < 1.0 / zoom, "moved by {moved} px at zoom {zoom}");
    // Two fingers that move from 80 to 240 px apart zoom in by three; the point between them stays in place.
    let zoom_now = || browser.run("return document.getElementById('world').getScreenCTM().a").as_f64().unwrap();
    let middle = browser.run(
        "const r = document.getElementById('stage').getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]",
    );
    let (x, y) = (middle[0].as_f64().unwrap().round(), middle[1].as_f64().unwrap().round());
    let (zoom, marks) = (zoom_now(), browser.run("return document.querySelectorAll('.pin.mark').length"));
    let script =
        format!("const m = document.getElementById('world').getScreenCTM(); return [({x} - m.e) / m.a, ({y} - m.f) / m.d]");
    let before = browser.run(&script);
    browser.pinch([[(x - 40.0, y), (x - 120.0, y)], [(x + 40.0, y), (x + 120.0, y)]]);
    wait(&browser, &format!("Math.abs(document.getElementById('world').getScreenCTM().a / {zoom} - 3) < 0.1"));
    let after = browser.run(&script);
    for axis in 0..2 {
        let off = (before[axis].as_f64().unwrap() - after[axis].as_f64().unwrap()).abs() * zoom_now();
        assert!(off < 6.0, "the point between the fingers moved by {off} px");
    }
    assert_eq!(browser.run("return document.querySelectorAll('.pin.mark').length"), marks, "a pinch set a mark");
    // The help shows all keys, scrolled to the first.
    browser.press("?");
    wait(&browser, "document.getElementById('help').open");
    assert_eq!(browser.run("return document.getElementById('help').scrollTop"), json!(0));
    browser.screenshot("annotate-help", false);
    browser.press(&ESCAPE.to_string());
    browser.no_errors();
}

#[test]
fn a_new_user_marks_three_real_sequences_in_two_minutes() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/data/sequences");
    if !data.is_dir() {
        eprintln!("SKIPPED: {} does not exist", data.display());
        return;
    }
    let work = Work::new();
    let ids = ["L004/001", "L022/001", "P001/001"];
    for id in ids {
        for (name, bytes) in crate::common::files_in(&data.join(id)) {
            work.write(&format!("real/{id}/{name}"), bytes);
        }
    }
    let manifest = fs::read_to_string(data.join("manifest.csv")).unwrap();
    let wanted = |line: &&str| ids.iter().any(|id| line.starts_with(&id.replace('/', ",")));
    // Without landmarks every point must be marked by hand.
    let header = manifest.lines().next().unwrap().replace(",landmarks", ",landmark_file");
    let lines: Vec<&str> = manifest.lines().filter(wanted).collect();
    work.write("real/manifest.csv", format!("{header}\n{}\n", lines.join("\n")));
    let start = std::time::Instant::now();
    let server = Server::start(&work, "real");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    for id in ids {
        wait(&browser, &format!("document.getElementById('sequence').textContent === '{}'", id.replace('/', "_")));
        // A person sees the proposals, checks that they are about right, and presses the key.
        sleep(Duration::from_millis(2500));
        let proposed = browser.run("return document.querySelectorAll('.pin.proposal').length").as_u64().unwrap();
        browser.screenshot(&format!("real-{}", id.replace('/', "_")), false);
        // The whole face is found, with discs of uncertainty. A point accepted by a key keeps its expected error, as do all.
        assert!(proposed > 40, "{id}: {proposed}");
        assert_eq!(browser.run("return document.querySelectorAll('.pin.proposal .doubt').length"), json!(proposed));
        browser.press(" ");
        wait(&browser, "document.querySelectorAll('.pin.mark .doubt').length === 1");
        browser.press("a");
        wait(&browser, "document.querySelectorAll('.pin.proposal').length === 0");
        // The remaining points are marked by hand: look, then click where the wireframe expects the point, or in the middle of
        // the face.
        while let Some(node) = asked(&browser) {
            sleep(Duration::from_millis(2500));
            browser.press(" ");
            wait(&browser, &format!("document.querySelector('.pin.mark[data-node=\"{node}\"]') !== null"));
            sleep(Duration::from_millis(500));
            browser.press(&RIGHT.to_string());
            browser.press(&LEFT.to_string());
        }
        saved(&browser);
        browser.screenshot(&format!("real-{}-marked", id.replace('/', "_")), false);
        browser.press(&ENTER.to_string());
    }
    let seconds = start.elapsed().as_secs_f64();
    eprintln!("three sequences marked in {seconds:.0} s, waiting like a person");
    assert!(seconds < 120.0, "{seconds} s");
    for id in ids {
        assert!(work.rows(&format!("real/{id}/correspondences.csv")).len() >= 7);
    }
    browser.no_errors();
    drop(server);
    work.grimace("run real -o results -q").exit(0);
    let quality: Value = serde_json::from_slice(&work.bytes("results/tracks/L004_001.json")).unwrap();
    assert!(quality["summary"]["tracked_share"].as_f64().unwrap() > 0.8, "{quality}");
}
