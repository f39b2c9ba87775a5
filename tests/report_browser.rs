//! The report in headless Chromium, driven through chromedriver (WebDriver): it draws without errors, plays, scrubs, sorts, filters,
//! and is readable in the dark and on a phone.
//!
//! `GRIMACE_SCREENSHOTS=DIR` keeps the pictures and the page.

mod report_data;

use std::{
    env, fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use grimace::{pipeline::Stage, report::render_html};
use report_data::Fixture;
use serde_json::{Value, json};
use tempfile::TempDir;

/// A browser session; chromedriver and the browser end with it.
struct Browser {
    driver: Child,
    session: String,
    folder: TempDir,
}

impl Browser {
    fn start() -> Self {
        const INSTALL: &str =
            "this test needs Chromium and chromedriver: `apt-get install chromium chromium-driver` (Debian), or run scripts/test";
        let mut driver = Command::new("chromedriver")
            .arg("--port=0")
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap_or_else(|error| panic!("chromedriver does not start ({error}); {INSTALL}"));
        let lines = BufReader::new(driver.stdout.take().unwrap()).lines();
        let port = lines.map_while(Result::ok).find_map(|line| {
            let (_, port) = line.split_once("started successfully on port ")?;
            port.trim_end_matches('.').parse::<u16>().ok()
        });
        let port = port.unwrap_or_else(|| panic!("chromedriver named no port; {INSTALL}"));
        let folder = tempfile::tempdir().unwrap();
        let profile = format!("--user-data-dir={}", folder.path().join("profile").display());
        let arguments = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"];
        let arguments = arguments.into_iter().chain(["--disable-background-networking", "--disable-component-update", &profile]);
        let mut browser = Self { driver, session: format!("http://127.0.0.1:{port}/session"), folder };
        let capabilities = json!({"alwaysMatch": {
            "goog:chromeOptions": {"args": arguments.collect::<Vec<_>>()},
            "goog:loggingPrefs": {"browser": "ALL"},
        }});
        let answer = browser.try_post("", &json!({"capabilities": capabilities})).unwrap_or_else(|e| panic!("{e}; {INSTALL}"));
        let id = answer["sessionId"].as_str().unwrap().to_owned();
        browser.session = format!("{}/{id}", browser.session);
        browser
    }

    fn try_post(&self, path: &str, body: &Value) -> Result<Value, String> {
        let agent =
            ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(Duration::from_secs(60))).build();
        let request = ureq::Agent::from(agent).post(format!("{}{path}", self.session)).content_type("application/json");
        let text = request
            .send(body.to_string())
            .and_then(|mut r| r.body_mut().with_config().limit(100_000_000).read_to_string())
            .map_err(|e| e.to_string())?;
        let answer: Value = serde_json::from_str(&text).map_err(|e| e.to_string())?;
        let value = &answer["value"];
        match value.get("error") {
            Some(error) => Err(format!("{error}: {}", value["message"])),
            None => Ok(value.clone()),
        }
    }

    fn post(&self, path: &str, body: &Value) -> Value {
        self.try_post(path, body).unwrap_or_else(|error| panic!("{path}: {error}"))
    }

    /// The value of a script's `return`.
    fn run(&self, script: &str) -> Value {
        self.post("/execute/sync", &json!({"script": script, "args": []}))
    }

    fn text(&self, script: &str) -> String {
        self.run(script).as_str().unwrap_or_else(|| panic!("no text from {script}")).to_owned()
    }

    fn devtools(&self, command: &str, parameters: &Value) -> Value {
        self.post("/goog/cdp/execute", &json!({"cmd": command, "params": parameters}))
    }

    fn size(&self, width: u32, height: u32) {
        let metrics = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600});
        self.devtools("Emulation.setDeviceMetricsOverride", &metrics);
    }

    fn media(&self, media: &str, feature: &str, value: &str) {
        self.devtools("Emulation.setEmulatedMedia", &json!({"media": media, "features": [{"name": feature, "value": value}]}));
    }

    fn open(&self, name: &str, fixture: &Fixture) {
        let path = self.folder.path().join(format!("{name}.html"));
        let html = render_html(&fixture.data()).unwrap();
        fs::write(&path, &html).unwrap();
        keep(&format!("{name}.html"), html.as_bytes());
        self.post("/url", &json!({"url": format!("file://{}", path.display())}));
    }

    fn no_errors(&self) {
        let log = self.post("/se/log", &json!({"type": "browser"}));
        assert_eq!(log, json!([]), "the browser's console");
    }

    /// Keeps a picture of the window, or of the whole page in pieces.
    fn screenshot(&self, name: &str, whole: bool) {
        const PIECE: f64 = 1300.0;
        if env::var_os("GRIMACE_SCREENSHOTS").is_none() {
            return;
        }
        let capture = |name: &str, parameters: Value| {
            let picture = self.devtools("Page.captureScreenshot", &parameters);
            keep(&format!("{name}.png"), &decode_base64(picture["data"].as_str().unwrap()));
        };
        if !whole {
            return capture(name, json!({"format": "png"}));
        }
        let size = |what: &str| self.run(&format!("return document.documentElement.{what}")).as_f64().unwrap();
        let (width, height) = (size("scrollWidth"), size("scrollHeight"));
        for piece in 0..(height / PIECE).ceil() as usize {
            let y = piece as f64 * PIECE;
            let clip = json!({"x": 0, "y": y, "width": width, "height": PIECE.min(height - y), "scale": 1});
            capture(&format!("{name}-{piece:02}"), json!({"format": "png", "captureBeyondViewport": true, "clip": clip}));
        }
    }
}

impl Drop for Browser {
    fn drop(&mut self) {
        let agent = ureq::Agent::config_builder().timeout_global(Some(Duration::from_secs(10))).build();
        // The session may never have begun; what is left to end is the driver, and with it the browser.
        let _ = ureq::Agent::from(agent).delete(&self.session).call();
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

fn keep(name: &str, bytes: &[u8]) {
    if let Some(folder) = env::var_os("GRIMACE_SCREENSHOTS") {
        fs::create_dir_all(&folder).unwrap();
        fs::write(Path::new(&folder).join(name), bytes).unwrap();
    }
}

fn decode_base64(text: &str) -> Vec<u8> {
    const ALPHABET: &[u8] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let (mut bytes, mut bits, mut count) = (Vec::new(), 0_u32, 0);
    for symbol in text.bytes().take_while(|&b| b != b'=') {
        bits = bits << 6 | ALPHABET.iter().position(|&a| a == symbol).unwrap() as u32;
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    bytes
}

/// Waits for a condition in the page, at most five seconds.
fn wait(browser: &Browser, condition: &str) {
    let start = Instant::now();
    while browser.run(&format!("return {condition}")) != json!(true) {
        assert!(start.elapsed() < Duration::from_secs(5), "waited in vain for {condition}");
        sleep(Duration::from_millis(20));
    }
}

const CONTOURS: &str = "document.querySelector('#r3 [data-figure=moving] .contours').getAttribute('d')";

#[test]
fn the_representative_plays_scrubs_and_exaggerates() {
    let browser = Browser::start();
    browser.size(1280, 720);
    browser.open(
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
    // The page opens at the apex, at rest.
    let apex = contours();
    sleep(Duration::from_millis(150));
    assert_eq!(contours(), apex);
    let (neutral, middle) = (seek("0"), seek("2"));
    assert!(neutral != apex && middle != neutral && middle != apex);
    assert_eq!(seek("4"), apex);
    // At the neutral frame it is the neutral wireframe beside it.
    assert_eq!(browser.text("return document.querySelector('#r3 [data-figure=neutral] .contours').getAttribute('d')"), neutral);
    // A key frame's mark leads there.
    browser.run("document.querySelector('#r3 .ticks [data-frame=\"2\"]').click()");
    assert_eq!(contours(), middle);
    // Playing moves it, pausing stops it.
    browser.run("document.querySelector('#r3').scrollIntoView(); document.querySelector('#r3 .play').click()");
    wait(&browser, &format!("{CONTOURS} !== {}", json!(middle)));
    assert_eq!(browser.text("return document.querySelector('#r3 .play').getAttribute('aria-pressed')"), "true");
    browser.run("document.querySelector('#r3 .play').click()");
    let stopped = contours();
    sleep(Duration::from_millis(150));
    assert_eq!(contours(), stopped);
    // Exaggeration moves the apex further, and leaves the neutral as it is but for the zoom.
    seek("4");
    browser
        .run("const g = document.querySelector('#r3 .gain'); g.value = 3; g.dispatchEvent(new Event('input', {bubbles: true}))");
    assert_ne!(contours(), apex);
    assert_eq!(browser.text("return document.querySelector('#r3 .gain-text').value"), "3.0×");
    assert_eq!(seek("0"), neutral);
    // The ghost is the neutral.
    browser.run("document.querySelector('#r3 .ghost').click()");
    seek("4");
    assert_eq!(browser.text("return document.querySelector('#r3 .ghosted').getAttribute('d')"), neutral);
    browser.screenshot("card", false);
    // Every figure was drawn, and the single sequence has none of dispersion.
    let count = |selector: &str| browser.run(&format!("return document.querySelectorAll('{selector}').length")).as_u64().unwrap();
    assert_eq!((count(".card"), count("[data-figure=heat] canvas"), count("[data-figure=distances] svg")), (6, 5, 5));
    assert_eq!((count("[data-figure=fields] .arrows"), count("[data-figure=fields] svg")), (24, 24));
    assert!(count("[data-figure=faps] .track") > 60);
    let painted = "const c = document.querySelector('#r0 canvas'); const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
        const seen = new Set(); for (let k = 0; k < d.length; k += 4) if (d[k + 3] === 255) seen.add((d[k] << 16) + (d[k + 1] << 8) + d[k + 2]);
        return seen.size";
    assert!(browser.run(painted).as_u64().unwrap() > 50, "a smooth heat map has many colours");
    browser.no_errors();
}

#[test]
fn less_motion_means_one_pass_and_no_loop() {
    let browser = Browser::start();
    browser.size(1280, 720);
    browser.media("", "prefers-reduced-motion", "reduce");
    browser.open("calm", &Fixture::new("Calm", [5; 6], &[]));
    browser.run(
        "document.querySelector('#r3 .speed').value = 2; document.querySelector('#r3 .speed').dispatchEvent(new Event('change'))",
    );
    browser.run("document.querySelector('#r3').scrollIntoView(); document.querySelector('#r3 .play').click()");
    // 1.4 s at twice the speed; then it rests at the apex.
    wait(&browser, "document.querySelector('#r3 .play').getAttribute('aria-pressed') === 'false'");
    assert_eq!(browser.text("return document.querySelector('#r3 .time').value"), "4");
    browser.no_errors();
}

#[test]
fn the_tracking_table_sorts_filters_and_stays_fast() {
    let browser = Browser::start();
    browser.size(1280, 720);
    // 6 * 334 = 2004 sequences.
    browser.open("many", &Fixture::new("Two thousand sequences", [334; 6], &[]));
    let column = |k: usize| -> Vec<String> {
        let script = format!("return [...document.querySelectorAll('#tracks tbody tr')].map(r => r.cells[{k}].textContent)");
        browser.run(&script).as_array().unwrap().iter().map(|v| v.as_str().unwrap().to_owned()).collect()
    };
    let numbers = |k: usize| column(k).iter().map(|t| t.parse::<f64>().unwrap()).collect::<Vec<_>>();
    let click = |k: usize| browser.run(&format!("document.querySelectorAll('#tracks thead button')[{k}].click()"));
    // Worst first, fifty of them.
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
    assert!(loading < 10_000.0, "loading took {loading} ms");
    let milliseconds = browser.run(sorting).as_f64().unwrap();
    assert!(milliseconds < 500.0, "sorting 2004 rows took {milliseconds} ms");
    browser.run("document.querySelector('#tracking').scrollIntoView()");
    browser.screenshot("tracking", false);
    browser.no_errors();
}

#[test]
fn it_is_readable_in_the_dark_on_a_phone_and_on_paper() {
    let browser = Browser::start();
    browser.size(1280, 720);
    browser.open(
        "report",
        &Fixture::new("Cohn-Kanade pilot", [9, 4, 1, 24, 12, 30], &[]).fail(
            "S011",
            "003",
            Stage::Fit,
            "2 marks; mark at least 3",
        ),
    );
    // Relative luminance of the page and of its text, 0 to 255, near enough.
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
    // Nothing sticks out: wide tables scroll in their own box.
    assert_eq!(browser.run("return document.documentElement.scrollWidth"), json!(400));
    browser.screenshot("phone", true);
    browser.size(1280, 720);
    browser.open("groups", &Fixture::new("Grouped by sex", [9, 8, 7, 12, 6, 10], &["f", "m"]));
    browser.screenshot("groups", true);
    browser.no_errors();
}
