//! A server of `grimace annotate` that ends with the test, and plain HTTP requests to it, valid and invalid.

// Every test program uses only a part of this module.
#![allow(dead_code)]

use std::{
    io::{BufRead, BufReader, Read, Write},
    net::TcpStream,
    process::{Child, Stdio},
    time::Duration,
};

use serde_json::Value;

use crate::common::Work;

/// A running server.
pub struct Server {
    process: Child,
    pub lines: Vec<String>,
    /// `http://127.0.0.1:PORT/TOKEN/`.
    pub url: String,
    /// `127.0.0.1:PORT`.
    pub authority: String,
    /// `/TOKEN`.
    pub token: String,
}

/// An HTTP response.
#[derive(Debug)]
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }

    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_else(|e| panic!("{e}: {}", self.text()))
    }

    #[track_caller]
    pub fn ok(self) -> Value {
        assert_eq!(self.status, 200, "{}", self.text());
        self.json()
    }
}

impl Server {
    /// Starts `grimace annotate ARGS --no-open` in the folder and waits until it has printed its address.
    #[track_caller]
    pub fn start(work: &Work, args: &str) -> Self {
        let mut command = work.command();
        command.arg("annotate").args(args.split_whitespace()).arg("--no-open");
        let mut process = command.stdout(Stdio::piped()).stderr(Stdio::inherit()).spawn().unwrap();
        let mut lines = Vec::new();
        for line in BufReader::new(process.stdout.take().unwrap()).lines().map_while(Result::ok) {
            lines.push(line);
            if let Some(url) = lines.last().unwrap().strip_prefix("open ") {
                let url = url.to_owned();
                let (authority, token) = url.strip_prefix("http://").unwrap().trim_end_matches('/').split_once('/').unwrap();
                let (authority, token) = (authority.to_owned(), format!("/{token}"));
                return Self { process, lines, url, authority, token };
            }
        }
        let _ = process.wait();
        panic!("the server printed no address: {lines:?}");
    }

    /// Kills the server, as a power failure would.
    pub fn kill(mut self) {
        self.process.kill().unwrap();
        self.process.wait().unwrap();
    }

    /// Returns the process id of the server.
    pub fn process(&self) -> u32 {
        self.process.id()
    }

    /// Like [`Server::send`], for a server that may be killed meanwhile. Returns the status, if a response came.
    pub fn try_send(&self, method: &str, path: &str, body: &Value) -> Option<u16> {
        let body = body.to_string();
        let head = format!(
            "{method} {}/{path} HTTP/1.1\r\nHost: {}\r\nContent-Type: application/json\r\nConnection: close\r\nContent-Length: {}\r\n\r\n",
            self.token,
            self.authority,
            body.len()
        );
        let mut stream = TcpStream::connect(&self.authority).ok()?;
        stream.set_read_timeout(Some(Duration::from_secs(60))).ok()?;
        stream.write_all((head + &body).as_bytes()).ok()?;
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).split(' ').nth(1)?.parse().ok()
    }

    pub fn port(&self) -> u16 {
        self.authority.rsplit_once(':').unwrap().1.parse().unwrap()
    }

    /// Sends bytes on a new connection and reads the response to the end.
    pub fn raw(&self, request: &[u8]) -> Answer {
        let mut stream = TcpStream::connect(&self.authority).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(300))).unwrap();
        // A server that refuses a long body may close before all of it is sent.
        let _ = stream.write_all(request);
        let mut bytes = Vec::new();
        let _ = stream.read_to_end(&mut bytes);
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n").unwrap_or_else(|| panic!("no answer: {bytes:?}"));
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap().to_lowercase();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Answer { status, head, body: bytes[end + 4..].to_vec() }
    }

    /// Sends a request with the given headers; `Host` is that of the server unless it is given.
    pub fn request(&self, method: &str, target: &str, headers: &[(&str, &str)], body: &[u8]) -> Answer {
        let mut head = format!("{method} {target} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n", body.len());
        if !headers.iter().any(|(name, _)| name.eq_ignore_ascii_case("host")) {
            head += &format!("Host: {}\r\n", self.authority);
        }
        for (name, value) in headers {
            head += &format!("{name}: {value}\r\n");
        }
        let mut bytes = (head + "\r\n").into_bytes();
        bytes.extend_from_slice(body);
        self.raw(&bytes)
    }

    /// Sends a GET request for a path after the token.
    pub fn get(&self, path: &str) -> Answer {
        self.request("GET", &format!("{}/{path}", self.token), &[], b"")
    }

    /// Sends JSON to a path after the token.
    pub fn send(&self, method: &str, path: &str, body: &Value) -> Answer {
        let json = [("Content-Type", "application/json")];
        self.request(method, &format!("{}/{path}", self.token), &json, body.to_string().as_bytes())
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}
