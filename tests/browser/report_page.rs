//! The report in headless Chromium, driven through chromedriver (WebDriver): it draws without errors, plays, seeks, sorts, filters, and is
//! readable in dark mode and on a phone.
//!
//! `GRIMACE_SCREENSHOTS=DIR` saves the screenshots and the page.

use std::{fs, thread::sleep, time::Duration};

use crate::driver::{Browser, keep, wait};
use crate::report_data::Fixture;
use grimace::internal::{
    model::{DynamicExpressionModel, FrameExpressionModel},
    pipeline::{AnalyzedModel, PipelineOptions, Workbench, analyze, write_analysis},
    report::{Stage, render_html},
    statistics::SequenceModel,
    units::SequenceId,
};
use serde_json::json;

/// Writes a report and opens it.
fn open(browser: &Browser, name: &str, fixture: &Fixture) {
    let path = browser.folder.path().join(format!("{name}.html"));
    let html = render_html(&fixture.data()).unwrap();
    fs::write(&path, &html).unwrap();
    keep(&format!("{name}.html"), html.as_bytes());
    browser.go(&format!("file://{}", path.display()));
}

const CONTOURS: &str = "document.querySelector('#r3 [data-figure=moving] .contours').getAttribute('d')";

#[test]
fn the_representative_plays_scrubs_and_exaggerates() {
    let browser = Browser::start();
    browser.size(1280, 720);
    open(
        &browser,
        "faces",
        &Fixture::new("Cohn-Kanade pilot", [9, 4, 1, 24, 12, 30], &[]).fail(
            "S011",
            "003",
            Stage::Fit,
            "2 marks; mark at least 3",
        ),
    );
    let contours = || browser.text(&format!("return {CONTOURS}"));
    let seek = |time: &str| {
        browser.run(&format!(
            "const s = document.querySelector('#r3 .time'); s.value = {time}; s.dispatchEvent(new Event('input', {{bubbles: true}}))"
        ));
        contours()
    };
    // The page opens at the apex and does not move.
    let apex = contours();
    sleep(Duration::from_millis(150));
    assert_eq!(contours(), apex);
    let (neutral, middle) = (seek("0"), seek("2"));
    assert!(neutral != apex && middle != neutral && middle != apex);
    assert_eq!(seek("4"), apex);
    // At the neutral frame it equals the neutral wireframe beside it.
    assert_eq!(browser.text("return document.querySelector('#r3 [data-figure=neutral] .contours').getAttribute('d')"), neutral);
    // The button of a key frame goes there.
    browser.run("document.querySelector('#r3 .ticks [data-frame=\"2\"]').click()");
    assert_eq!(contours(), middle);
    // Play moves it, pause stops it.
    browser.run("document.querySelector('#r3').scrollIntoView(); document.querySelector('#r3 .play').click()");
    wait(&browser, &format!("{CONTOURS} !== {}", json!(middle)));
    assert_eq!(browser.text("return document.querySelector('#r3 .play').getAttribute('aria-pressed')"), "true");
    browser.run("document.querySelector('#r3 .play').click()");
    let stopped = contours();
    sleep(Duration::from_millis(150));
    assert_eq!(contours(), stopped);
    // Exaggeration moves the apex further. The neutral changes only by the zoom.
    seek("4");
    browser
        .run("const g = document.querySelector('#r3 .gain'); g.value = 3; g.dispatchEvent(new Event('input', {bubbles: true}))");
    assert_ne!(contours(), apex);
    assert_eq!(browser.text("return document.querySelector('#r3 .gain-text').value"), "3.0×");
    assert_eq!(seek("0"), neutral);
    // The neutral shown behind equals the neutral wireframe.
    browser.run("document.querySelector('#r3 .ghost').click()");
    seek("4");
    assert_eq!(browser.text("return document.querySelector('#r3 .ghosted').getAttribute('d')"), neutral);
    browser.screenshot("card", false);
    // Every figure is drawn; the single sequence has no figures of dispersion.
    let count = |selector: &str| browser.run(&format!("return document.querySelectorAll('{selector}').length")).as_u64().unwrap();
    assert_eq!((count(".card"), count("[data-figure=heat] svg"), count("[data-figure=distances] svg")), (6, 5, 5));
    assert_eq!((count("[data-figure=fields] .arrows"), count("[data-figure=fields] svg")), (24, 24));
    assert!(count("[data-figure=faps] .track") > 60);
    let shades = "return new Set([...document.querySelectorAll('#r0 [data-figure=heat] path[fill^=\"#\"]')].map(p => p.getAttribute('fill'))).size";
    assert!(browser.run(shades).as_u64().unwrap() > 50, "a smooth map has many colours");
    browser.no_errors();
}

#[test]
fn expressions_at_a_low_and_a_high_value_of_a_covariate_are_shown() {
    let options = PipelineOptions { covariates: vec!["age".to_owned()], no_faces: true, ..PipelineOptions::default() };
    let bench = Workbench::new(None, options).unwrap();
    let neutral = bench.normalizer().unwrap().canonical().neutral.clone();
    // The corners of the mouth rise in proportion to age.
    let model = |age: u32| {
        let frame = |m: u32| {
            let mut nodes = neutral.nodes().to_vec();
            for corner in [31_usize, 64] {
                nodes[corner].y += f64::from(age * m) / 4.0 + f64::from(age % 3);
            }
            FrameExpressionModel::new(nodes)
        };
        let id = SequenceId { subject: format!("P{age}"), sequence: "1".to_owned() };
        let model = DynamicExpressionModel::new([neutral.clone()].into_iter().chain((1..5).map(frame)).collect()).unwrap();
        let metadata = [("age".to_owned(), age.to_string())].into();
        AnalyzedModel {
            model: SequenceModel { id, model },
            emotion: "happiness".to_owned(),
            metadata,
            quality: None,
            course: None,
            pictures: None,
            marks_from: None,
        }
    };
    let analysis = analyze([20, 31, 42, 50, 61, 70].map(model).into(), Vec::new(), &bench).unwrap();
    let browser = Browser::start();
    browser.size(1280, 900);
    write_analysis(&analysis, browser.folder.path(), "ages", &bench, |_, _| Ok(())).unwrap();
    browser.go(&format!("file://{}", browser.folder.path().join("report.html").display()));
    let titles = || browser.text("return [...document.querySelectorAll('.variation h4')].map(h => h.textContent).join('; ')");
    let faces =
        || browser.text("return [...document.querySelectorAll('.variation .contours')].map(p => p.getAttribute('d')).join(';')");
    assert_eq!(titles(), "−2 standard deviations; Mean; +2 standard deviations");
    let components = faces();
    browser.run("const q = document.querySelector('.variation .component'); q.value = q.options.length - 1; q.dispatchEvent(new Event('change'))");
    assert_eq!(titles(), "age 20; Mean; age 70");
    assert_ne!(faces(), components);
    let row = browser.text("return document.querySelector('#numbers tbody tr').textContent");
    assert!(row.starts_with("happinessage645.67") && row.contains("changes"), "{row}");
    browser.screenshot("numbers", false);
    browser.no_errors();
}

#[test]
fn with_reduced_motion_the_animation_runs_once() {
    let browser = Browser::start();
    browser.size(1280, 720);
    browser.media("", "prefers-reduced-motion", "reduce");
    open(&browser, "calm", &Fixture::new("Calm", [5; 6], &[]));
    browser.run(
        "document.querySelector('#r3 .speed').value = 2; document.querySelector('#r3 .speed').dispatchEvent(new Event('change'))",
    );
    browser.run("document.querySelector('#r3').scrollIntoView(); document.querySelector('#r3 .play').click()");
    // 1.4 s at double speed; then it stops at the apex.
    wait(&browser, "document.querySelector('#r3 .play').getAttribute('aria-pressed') === 'false'");
    assert_eq!(browser.text("return document.querySelector('#r3 .time').value"), "4");
    browser.no_errors();
}

#[test]
fn the_tracking_table_sorts_filters_and_stays_fast() {
    let browser = Browser::start();
    browser.size(1280, 720);
    // 6 * 334 = 2004 sequences.
    open(&browser, "many", &Fixture::new("Two thousand sequences", [334; 6], &[]));
    let column = |k: usize| -> Vec<String> {
        let script = format!("return [...document.querySelectorAll('#tracks tbody tr')].map(r => r.cells[{k}].textContent)");
        browser.run(&script).as_array().unwrap().iter().map(|v| v.as_str().unwrap().to_owned()).collect()
    };
    let numbers = |k: usize| column(k).iter().map(|t| t.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let click = |k: usize| browser.run(&format!("document.querySelectorAll('#tracks thead button')[{k}].click()"));
    // The worst first, fifty rows.
    let shown = numbers(5);
    assert_eq!(shown.len(), 50);
    assert!(shown.is_sorted());
    click(5);
    assert!(numbers(5).is_sorted_by(|a, b| a >= b) && numbers(5)[0] > shown[49]);
    click(0);
    assert!(column(0).is_sorted() && column(0)[0] == "S001");
    click(0);
    assert_eq!(column(0)[0], "S334");
    assert_eq!(browser.text("return document.querySelector('#tracks th').getAttribute('aria-sort')"), "descending");
    browser.run("document.querySelector('#track-next').click()");
    assert_eq!(browser.text("return document.querySelector('#track-page').textContent"), "51–100");
    let filter = |text: &str| {
        let script = "const f = document.querySelector('#track-filter'); f.value = TEXT; f.dispatchEvent(new Event('input'))";
        browser.run(&script.replace("TEXT", &json!(text).to_string()));
        browser.text("return document.querySelector('#track-count').textContent")
    };
    // Six sequences of subject 17.
    assert_eq!(filter("s017"), "6 of 2004 sequences");
    assert_eq!(filter("s017 Fear"), "1 of 2004 sequences");
    assert_eq!(filter("nobody"), "0 of 2004 sequences");
    assert_eq!(filter(""), "2004 sequences");
    let sorting = "const t = performance.now(); document.querySelectorAll('#tracks thead button')[7].click();
        document.body.getBoundingClientRect(); return performance.now() - t";
    let drawn = "return performance.getEntriesByType('navigation')[0].domContentLoadedEventEnd";
    let loading = browser.run(drawn).as_f64().unwrap();
    eprintln!("2004 sequences: the page was drawn after {loading:.0} ms");
    let milliseconds = browser.run(sorting).as_f64().unwrap();
    eprintln!("sorting 2004 rows took {milliseconds:.0} ms");
    browser.run("document.querySelector('#tracking').scrollIntoView()");
    browser.screenshot("tracking", false);
    browser.no_errors();
}

#[test]
fn quality_cards_come_worst_first_and_filter_and_sections_fold() {
    let browser = Browser::start();
    browser.size(1280, 720);
    // 6 * 60 = 360 sequences.
    open(&browser, "quality", &Fixture::new("Quality", [60; 6], &[]));
    let cards = || browser.run("return document.querySelectorAll('.qc').length").as_u64().unwrap();
    assert_eq!(cards(), 24);
    let again = browser.run("return [...document.querySelectorAll('.qc')].map(c => c.classList.contains('again'))");
    let again: Vec<bool> = again.as_array().unwrap().iter().map(|v| v.as_bool().unwrap()).collect();
    assert!(again[0] && again.is_sorted_by(|a, b| a >= b), "sequences to look at again are first: {again:?}");
    browser.run("document.querySelector('#quality-more').click()");
    // 96 more.
    assert_eq!(cards(), 120);
    let filter =
        "const f = document.querySelector('#quality-filter'); f.value = 's001 anger'; f.dispatchEvent(new Event('input'))";
    browser.run(filter);
    assert_eq!(cards(), 1);
    assert_eq!(browser.text("return document.querySelector('.qc-files a').getAttribute('href')"), "tracks/S001_anger.csv");
    // Collapsed, the page is short; a link opens its target.
    browser.run("document.querySelector('#fold-all').click()");
    let height = || browser.run("return document.documentElement.scrollHeight").as_u64().unwrap();
    assert!(height() < 8000, "{}", height());
    browser.run("location.hash = '#r3'");
    wait(&browser, "!document.querySelector('#r3').classList.contains('folded')");
    assert!(height() > 1000);
    browser.no_errors();
}

#[test]
fn it_is_readable_in_the_dark_on_a_phone_and_on_paper() {
    let browser = Browser::start();
    browser.size(1280, 720);
    open(
        &browser,
        "report",
        &Fixture::new("Cohn-Kanade pilot", [9, 4, 1, 24, 12, 30], &[]).fail(
            "S011",
            "003",
            Stage::Fit,
            "2 marks; mark at least 3",
        ),
    );
    // Approximate relative luminance of the page and of its text, 0 to 255.
    let luminance = |property: &str| {
        let script = format!("return getComputedStyle(document.body).{property}.match(/[0-9]+/g).slice(0, 3).map(Number)");
        let rgb: Vec<f64> = browser.run(&script).as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
        0.21 * rgb[0] + 0.72 * rgb[1] + 0.07 * rgb[2]
    };
    browser.media("", "prefers-color-scheme", "light");
    assert!(luminance("backgroundColor") > 230.0 && luminance("color") < 60.0);
    browser.screenshot("light-1280x720", false);
    browser.screenshot("light", true);
    browser.media("print", "prefers-color-scheme", "light");
    browser.size(800, 1100);
    wait(&browser, "innerWidth === 800");
    assert_eq!(browser.run("return document.documentElement.scrollWidth <= innerWidth"), json!(true), "fits on paper");
    browser.screenshot("print", true);
    browser.size(1280, 720);
    browser.media("", "prefers-color-scheme", "dark");
    assert!(luminance("backgroundColor") < 40.0 && luminance("color") > 200.0);
    browser.screenshot("dark", true);
    browser.media("", "prefers-color-scheme", "light");
    browser.size(400, 800);
    wait(&browser, "innerWidth === 400");
    sleep(Duration::from_millis(100));
    // Nothing overflows: wide tables scroll in their own box.
    assert_eq!(browser.run("return document.documentElement.scrollWidth"), json!(400));
    browser.screenshot("phone", true);
    browser.size(1280, 720);
    open(&browser, "groups", &Fixture::new("Grouped by sex", [9, 8, 7, 12, 6, 10], &["f", "m"]));
    browser.screenshot("groups", true);
    browser.no_errors();
}
