//! The annotation page with tracks, and in several windows, in Chromium.

use crate::annotate_page::{asked, no_proposals, open, place, rows, saved, text, truth, unmarked};
use crate::annotation::Server;
use crate::common::Work;
use crate::driver::{Browser, CONTROL, ENTER, ESCAPE, SHIFT, wait};
use serde_json::json;
use std::{thread::sleep, time::Duration};

#[test]
fn a_tab_shows_the_changes_of_another_tab_when_the_user_returns() {
    let work = unmarked(&["S001_005"]);
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    let (first, second) = browser.new_window();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    let node = asked(&browser).unwrap();
    browser.click(place(&browser, truth("S001_005", node)));
    saved(&browser);
    browser.switch(&first);
    browser.run("window.dispatchEvent(new Event('focus'))");
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 1");
    assert!(text(&browser, "notice").contains("Another tab has changed this sequence"));
    // It saves on top of the new state: no question appears, and no change of the other tab is lost.
    let other = asked(&browser).unwrap();
    browser.click(place(&browser, truth("S001_005", other)));
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 2");
    saved(&browser);
    assert_eq!(browser.run("return document.getElementById('ask').open"), json!(false));
    assert_eq!(rows(&work, "S001/005").iter().map(|r| r.0).collect::<Vec<_>>(), [node.min(other), node.max(other)]);
    browser.switch(&second);
    browser.run("window.dispatchEvent(new Event('focus'))");
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 2");
}

#[test]
fn a_conflict_is_decided_by_the_user() {
    let work = unmarked(&["S001_005"]);
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    for (answer, left) in [("ask-no", 2), ("ask-yes", 3)] {
        browser.post("/refresh", &json!({}));
        wait(&browser, "document.querySelector('#stage').dataset.frame > 0");
        no_proposals(&browser);
        let mine = browser.run("return document.querySelectorAll('.pin.mark').length").as_u64().unwrap();
        // Another program changes the file while the page is open.
        work.write("faces/S001/005/correspondences.csv", format!("node,x,y,kind\n10,100.{mine},120,mark\n64,80,100,mark\n"));
        let node = asked(&browser).unwrap();
        browser.click(place(&browser, truth("S001_005", node)));
        wait(&browser, "document.getElementById('ask').open");
        assert_eq!(text(&browser, "ask-title"), "Changed elsewhere");
        assert_eq!(rows(&work, "S001/005").len(), 2, "nothing was overwritten before the answer");
        browser.run(&format!("document.getElementById('{answer}').click()"));
        wait(&browser, "!document.getElementById('ask').open && document.getElementById('saved').className === 'saved'");
        wait(&browser, &format!("document.querySelectorAll('.pin.mark').length === {left}"));
        assert_eq!(rows(&work, "S001/005").len(), left);
    }
}

#[test]
fn no_editing_key_answers_a_conflict_and_discarded_marks_can_be_restored() {
    let work = unmarked(&["S001_005"]);
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    no_proposals(&browser);
    browser.press(" ");
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 1");
    saved(&browser);
    work.write("faces/S001/005/correspondences.csv", "node,x,y,kind\n10,100,120,mark\n");
    browser.press(" ");
    wait(&browser, "document.getElementById('ask').open");
    for key in [" ", "a", &ENTER.to_string()] {
        browser.press(key);
    }
    assert_eq!(browser.run("return document.getElementById('ask').open"), json!(true));
    assert_eq!(rows(&work, "S001/005").len(), 1, "nothing was overwritten before the answer");
    // Closed without an answer, the conflict remains: the next change asks again.
    browser.press(&ESCAPE.to_string());
    wait(&browser, "!document.getElementById('ask').open && document.getElementById('saved').className === 'failed'");
    assert_eq!(rows(&work, "S001/005").len(), 1);
    browser.press(" ");
    wait(&browser, "document.getElementById('ask').open");
    browser.run("document.getElementById('ask-no').click()");
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 1");
    browser.run("document.getElementById('undo').click()");
    wait(&browser, "document.querySelectorAll('.pin.mark').length === 3");
    saved(&browser);
    assert_eq!(rows(&work, "S001/005").len(), 3);
}

#[test]
fn tracks_are_stepped_corrected_and_tracked_again() {
    let work = Work::with_sequences(&["S001_005"]);
    work.grimace("run faces -o results -q").exit(0);
    let marks_from = |from: &str| {
        let info = work.read("results/tracks/S001_005.json");
        let (before, behind) = info.split_once("\"marks_from\": \"").unwrap();
        work.write(
            "results/tracks/S001_005.json",
            format!("{before}\"marks_from\": \"{from}{}", &behind[behind.find('"').unwrap()..]),
        );
    };
    let server = Server::start(&work, "--tracks results");
    let browser = Browser::start();
    // The legend names the source of points in the neutral frame that were not marked by hand.
    for (from, said) in [("found", "found"), ("landmarks", "from landmarks"), ("file", "marked")] {
        marks_from(from);
        open(&browser, &server, (1280, 720));
        wait(&browser, &format!("document.querySelector('#legend dt').textContent === '{said}'"));
    }
    assert_eq!(text(&browser, "track-title"), "Neutral frame");
    // Show the whole image: nodes at the top of the skull may be outside the part shown first.
    browser.press("0..");
    wait(&browser, "document.getElementById('track-step').textContent === 'Frame 3 of 6'");
    wait(&browser, "document.querySelector('#legend dt').textContent === 'tracked'");
    // The dots have the colours of the states.
    let colour = browser.text("return getComputedStyle(document.querySelector('#dots .dot.tracked:not(.casing)')).stroke");
    assert_eq!(colour, "rgb(0, 178, 130)");
    let point = browser
        .run("return document.querySelector('#dots .dot.tracked').getAttribute('d').match(/M([^h]+)/)[1].split(' ').map(Number)");
    let start = place(&browser, (point[0].as_f64().unwrap(), point[1].as_f64().unwrap()));
    browser.drag("mouse", &[start, (start.0 + 6.0, start.1), (start.0 + 25.0, start.1 + 10.0)]);
    wait(&browser, "document.querySelectorAll('.pin.hard').length === 1");
    saved(&browser);
    wait(&browser, "document.getElementById('track-hint').textContent.startsWith('Corrected.')");
    browser.screenshot("tracks-corrected", false);
    let corrected = |work: &Work| work.rows("results/tracks/S001_005.csv").iter().filter(|r| r["state"] == "corrected").count();
    assert_eq!(corrected(&work), 1);
    let behind = |work: &Work| {
        work.read("results/tracks/S001_005.csv").lines().filter(|l| l.starts_with("4,")).map(str::to_owned).collect::<Vec<_>>()
    };
    let before = behind(&work);
    browser.press("r");
    wait(&browser, "document.getElementById('saved').textContent === 'Tracked again and saved'");
    assert_ne!(behind(&work), before);
    assert_eq!(corrected(&work), 1);
    // Undo, release, and again.
    browser.chord(&[CONTROL], 'z');
    wait(&browser, "document.querySelectorAll('.pin.hard').length === 0");
    browser.chord(&[CONTROL, SHIFT], 'z');
    wait(&browser, "document.querySelectorAll('.pin.hard').length === 1");
    browser.run("document.querySelector('#list .drop').click()");
    wait(&browser, "document.querySelectorAll('.pin.hard').length === 0");
    saved(&browser);
    assert_eq!(corrected(&work), 0);
    browser.no_errors();
}

#[test]
fn a_track_is_found_right_or_left_out_with_one_key() {
    let work = Work::with_sequences(&["S001_005", "S002_005"]);
    work.write(
        "faces/manifest.csv",
        "subject,sequence,emotion,first_frame,last_frame\nS001,005,happiness,6,1\nS002,005,happiness,1,4\n",
    );
    work.grimace("run faces -o results -q").exit(0);
    let server = Server::start(&work, "--tracks results");
    let browser = Browser::start();
    // The first to be shown is the one to look at, with the reason.
    open(&browser, &server, (1280, 720));
    wait(&browser, "document.getElementById('sequence').textContent === 'S001_005'");
    assert!(text(&browser, "left").ends_with(" of 2 tracks, 1 to look at"), "{}", text(&browser, "left"));
    let reasons = text(&browser, "track-reasons");
    assert!(reasons.starts_with("To look at: the marks lie"), "{reasons}");
    browser.screenshot("tracks-look", false);
    browser.press("y");
    wait(&browser, "document.getElementById('saved').textContent === 'Saved: looks right'");
    wait(&browser, "document.getElementById('look-right').getAttribute('aria-pressed') === 'true'");
    assert!(!text(&browser, "left").contains("to look at") && text(&browser, "track-reasons").is_empty());
    assert!(work.read("results/looked_at.csv").contains("\nS001_005,right,b3-"));
    // The other button changes it, the same one takes it back.
    browser.run("document.getElementById('look-out').click()");
    wait(&browser, "document.getElementById('saved').textContent === 'Saved: left out'");
    assert!(work.read("results/looked_at.csv").contains("\nS001_005,leave out,b3-"));
    browser.press("x");
    wait(&browser, "document.getElementById('saved').textContent === 'Taken back'");
    assert!(text(&browser, "left").ends_with("1 to look at"));
    browser.no_errors();
}

#[test]
fn names_are_shown_unchanged_and_execute_nothing() {
    let work = unmarked(&["S001_005"]);
    let name = "<img src=x onerror=\"document.title='run'\">";
    work.write(
        "faces/manifest.csv",
        format!("subject,sequence,emotion,frames\n\"{}\",1,<b>joy,S001/005\n", name.replace('"', "\"\"")),
    );
    let server = Server::start(&work, "faces");
    let browser = Browser::start();
    open(&browser, &server, (1280, 720));
    assert_eq!(text(&browser, "sequence"), format!("{name}_1"));
    browser.press("q");
    wait(&browser, "document.getElementById('sequences').open");
    assert!(text(&browser, "sequence-list").contains(name) && text(&browser, "sequence-list").contains("<b>joy"));
    sleep(Duration::from_millis(200));
    assert_eq!(browser.run("return document.querySelectorAll('[onerror], b').length"), json!(0));
    assert!(!browser.text("return document.title").contains("run"));
    browser.no_errors();
}
