//! The server of `grimace annotate`: addresses, hosts, bodies, connections.

use crate::annotation::Server;
use crate::cmd_annotate::{open, save, true_marks, unmarked};
use crate::common::{Work, root};
use serde_json::{Value, json};
use std::{
    fs,
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    thread,
    time::{Duration, Instant},
};

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
