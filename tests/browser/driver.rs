//! Drives headless Chromium through chromedriver (WebDriver). `GRIMACE_SCREENSHOTS=DIR` saves screenshots.

// Each test program uses only a part of this module.
#![allow(dead_code)]

use std::{
    env, fs,
    io::{BufRead, BufReader},
    path::Path,
    process::{Child, Command, Stdio},
    thread::sleep,
    time::{Duration, Instant},
};

use serde_json::{Value, json};
use tempfile::TempDir;

/// WebDriver codes of keys.
pub const ENTER: char = '\u{e007}';
pub const ESCAPE: char = '\u{e00c}';
pub const SHIFT: char = '\u{e008}';
pub const CONTROL: char = '\u{e009}';
pub const END: char = '\u{e010}';
pub const HOME: char = '\u{e011}';
pub const LEFT: char = '\u{e012}';
pub const UP: char = '\u{e013}';
pub const RIGHT: char = '\u{e014}';
pub const DOWN: char = '\u{e015}';
pub const DELETE: char = '\u{e017}';

/// Starts chromedriver and returns it with its port; `None` when it ends without printing one.
fn start_driver(install: &str) -> Option<(Child, u16)> {
    let mut driver = Command::new("chromedriver")
        .arg("--port=0")
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap_or_else(|error| panic!("chromedriver cannot be started ({error}); {install}"));
    let lines = driver.stdout.take().map(|out| BufReader::new(out).lines());
    let port = lines.into_iter().flatten().map_while(Result::ok).find_map(|line| {
        let (_, port) = line.split_once("started successfully on port ")?;
        port.trim_end_matches('.').parse::<u16>().ok()
    });
    let Some(port) = port else {
        let _ = driver.wait();
        return None;
    };
    Some((driver, port))
}

/// A browser session, which ends chromedriver and the browser when it is dropped.
pub struct Browser {
    driver: Child,
    session: String,
    pub folder: TempDir,
}

impl Browser {
    pub fn start() -> Self {
        const INSTALL: &str =
            "this test needs Chromium and chromedriver: `apt-get install chromium chromium-driver` (Debian), or run scripts/test";
        // Chromedriver takes a port that is free for IPv4 and ends if another process has it for IPv6 or took it meanwhile;
        // then try again.
        let started = (0..5).find_map(|_| start_driver(INSTALL));
        let (driver, port) = started.unwrap_or_else(|| panic!("chromedriver printed no port in five attempts; {INSTALL}"));
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

    pub fn try_post(&self, path: &str, body: &Value) -> Result<Value, String> {
        let agent =
            ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(Duration::from_secs(300))).build();
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

    pub fn post(&self, path: &str, body: &Value) -> Value {
        self.try_post(path, body).unwrap_or_else(|error| panic!("{path}: {error}"))
    }

    /// Runs a script and returns the value of its `return` statement.
    pub fn run(&self, script: &str) -> Value {
        self.post("/execute/sync", &json!({"script": script, "args": []}))
    }

    pub fn text(&self, script: &str) -> String {
        self.run(script).as_str().unwrap_or_else(|| panic!("no text from {script}")).to_owned()
    }

    pub fn devtools(&self, command: &str, parameters: &Value) -> Value {
        self.post("/goog/cdp/execute", &json!({"cmd": command, "params": parameters}))
    }

    pub fn size(&self, width: u32, height: u32) {
        let metrics = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600});
        self.devtools("Emulation.setDeviceMetricsOverride", &metrics);
    }

    pub fn media(&self, media: &str, feature: &str, value: &str) {
        self.devtools("Emulation.setEmulatedMedia", &json!({"media": media, "features": [{"name": feature, "value": value}]}));
    }

    pub fn go(&self, url: &str) {
        self.post("/url", &json!({ "url": url }));
    }

    /// Presses keys one after another: characters, or WebDriver codes such as [`ENTER`].
    pub fn press(&self, keys: &str) {
        let presses =
            keys.chars().flat_map(|key| [json!({"type": "keyDown", "value": key}), json!({"type": "keyUp", "value": key})]);
        self.act(&json!({"type": "key", "id": "keys", "actions": presses.collect::<Vec<_>>()}));
    }

    /// Presses a key while others are held down.
    pub fn chord(&self, held: &[char], key: char) {
        let act = |what: &str, key: char| json!({"type": what, "value": key});
        let down = held.iter().map(|&k| act("keyDown", k));
        let up = held.iter().rev().map(|&k| act("keyUp", k));
        let actions: Vec<_> = down.chain([act("keyDown", key), act("keyUp", key)]).chain(up).collect();
        self.act(&json!({"type": "key", "id": "keys", "actions": actions}));
    }

    /// Presses the pointer at the first position in the window, moves it through the others and releases it.
    pub fn drag(&self, pointer: &str, places: &[(f64, f64)]) {
        let to = |&(x, y): &(f64, f64), duration: u32| json!({"type": "pointerMove", "duration": duration, "x": x.round() as i64, "y": y.round() as i64});
        let mut actions = vec![to(&places[0], 0), json!({"type": "pointerDown", "button": 0})];
        actions.extend(places[1..].iter().map(|place| to(place, 20)));
        actions.push(json!({"type": "pointerUp", "button": 0}));
        self.act(&json!({"type": "pointer", "id": pointer, "parameters": {"pointerType": pointer}, "actions": actions}));
    }

    /// Presses the pointer at the first position and moves it through the others without releasing it.
    pub fn press_pointer(&self, places: &[(f64, f64)]) {
        let to =
            |&(x, y): &(f64, f64)| json!({"type": "pointerMove", "duration": 30, "x": x.round() as i64, "y": y.round() as i64});
        let mut actions = vec![to(&places[0]), json!({"type": "pointerDown", "button": 0})];
        actions.extend(places[1..].iter().map(to));
        self.act(&json!({"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions}));
    }

    /// Releases the pointer of [`Browser::press_pointer`].
    pub fn release_pointer(&self) {
        let actions = [json!({"type": "pointerUp", "button": 0})];
        self.act(&json!({"type": "pointer", "id": "mouse", "parameters": {"pointerType": "mouse"}, "actions": actions}));
    }

    pub fn click(&self, place: (f64, f64)) {
        self.drag("mouse", &[place]);
    }

    /// Moves two fingers from their positions to others at the same time.
    pub fn pinch(&self, fingers: [[(f64, f64); 2]; 2]) {
        let to = |(x, y): (f64, f64), duration: u32| json!({"type": "pointerMove", "duration": duration, "x": x.round() as i64, "y": y.round() as i64});
        let finger = |k: usize| {
            let [from, until] = fingers[k];
            let middle = (f64::midpoint(from.0, until.0), f64::midpoint(from.1, until.1));
            let actions = [
                to(from, 0),
                json!({"type": "pointerDown", "button": 0}),
                to(middle, 60),
                to(until, 60),
                json!({"type": "pointerUp", "button": 0}),
            ];
            json!({"type": "pointer", "id": format!("finger{k}"), "parameters": {"pointerType": "touch"}, "actions": actions})
        };
        self.post("/actions", &json!({ "actions": [finger(0), finger(1)] }));
    }

    fn act(&self, source: &Value) {
        self.post("/actions", &json!({ "actions": [source] }));
    }

    /// Opens and selects a second window of the browser; returns both handles.
    pub fn new_window(&self) -> (String, String) {
        let handle = |path: &str| self.get(path).as_str().unwrap().to_owned();
        let first = handle("/window");
        let second = self.post("/window/new", &json!({"type": "tab"}))["handle"].as_str().unwrap().to_owned();
        self.switch(&second);
        (first, second)
    }

    pub fn switch(&self, window: &str) {
        self.post("/window", &json!({ "handle": window }));
    }

    fn get(&self, path: &str) -> Value {
        let agent = ureq::Agent::config_builder().timeout_global(Some(Duration::from_secs(300))).build();
        let mut response = ureq::Agent::from(agent).get(format!("{}{path}", self.session)).call().unwrap();
        let answer: Value = serde_json::from_str(&response.body_mut().read_to_string().unwrap()).unwrap();
        answer["value"].clone()
    }

    pub fn no_errors(&self) {
        let log = self.post("/se/log", &json!({"type": "browser"}));
        assert_eq!(log, json!([]), "the browser's console");
    }

    /// Saves a screenshot of the window, or of the whole page in pieces.
    pub fn screenshot(&self, name: &str, whole: bool) {
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
        // The session may not have been created; killing the driver also ends the browser.
        let _ = ureq::Agent::from(agent).delete(&self.session).call();
        let _ = self.driver.kill();
        let _ = self.driver.wait();
    }
}

/// Saves a file in the folder of `GRIMACE_SCREENSHOTS`.
pub fn keep(name: &str, bytes: &[u8]) {
    if let Some(folder) = env::var_os("GRIMACE_SCREENSHOTS") {
        fs::create_dir_all(&folder).unwrap();
        fs::write(Path::new(&folder).join(name), bytes).unwrap();
    }
}

pub fn decode_base64(text: &str) -> Vec<u8> {
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

/// Waits for a condition in the page, long enough for a busy machine.
pub fn wait(browser: &Browser, condition: &str) {
    let start = Instant::now();
    while browser.run(&format!("return {condition}")) != json!(true) {
        assert!(start.elapsed() < Duration::from_secs(120), "timed out waiting for {condition}");
        sleep(Duration::from_millis(20));
    }
}
