//! Limits the number of connections to the page, and their waiting times.
//!
//! A browser sends a request at once. A connection that sends nothing, sends a header or a body byte by byte, or does not read the
//! response, is closed, so that the page remains responsive.

use std::{
    io,
    pin::Pin,
    sync::Arc,
    task::{Context, Poll},
    time::Duration,
};

use axum::{
    Json, Router,
    body::{Body, to_bytes},
    extract::{Request, State},
    http::StatusCode,
    middleware::Next,
    response::{IntoResponse, Response},
};
use hyper::{body::Incoming, server::conn::http1, service::service_fn};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::{
    io::{AsyncRead, AsyncWrite, ReadBuf},
    net::{TcpListener, TcpStream},
    sync::Semaphore,
    time::{Sleep, sleep, timeout},
};
use tower_service::Service;

/// Largest body of a request, bytes: more than the marks of all nodes need.
pub const BODY_LIMIT: usize = 64 * 1024;

/// Pause before accepting connections again after the system refused one, as with too many open files.
const AFTER_FAILURE: Duration = Duration::from_millis(500);

/// Limits of connections.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Largest number of concurrent connections; others wait until one ends.
    pub connections: usize,
    /// Time for the head of a request, from the connection or the previous response.
    pub head: Duration,
    /// Time for the body of a request.
    pub body: Duration,
    /// Time within which some of a response must be read.
    pub answer: Duration,
}

impl Default for Limits {
    fn default() -> Self {
        let seconds = Duration::from_secs;
        // A browser opens six connections to one address.
        Self { connections: 64, head: seconds(10), body: seconds(10), answer: seconds(30) }
    }
}

/// Serves connections without end.
pub async fn serve(listener: TcpListener, router: Router, limits: Limits) -> io::Result<()> {
    let places = Arc::new(Semaphore::new(limits.connections));
    loop {
        let place = Arc::clone(&places).acquire_owned().await.map_err(io::Error::other)?;
        let stream = match listener.accept().await {
            Ok((stream, _)) => stream,
            Err(error) => {
                if !is_of_peer(&error) {
                    sleep(AFTER_FAILURE).await;
                }
                continue;
            }
        };
        let router = router.clone();
        tokio::spawn(async move {
            let answer = service_fn(move |request: hyper::Request<Incoming>| router.clone().call(request.map(Body::new)));
            let stream = TokioIo::new(Impatient { stream, limit: limits.answer, stalled: None });
            let mut builder = http1::Builder::new();
            builder.timer(TokioTimer::new()).header_read_timeout(limits.head);
            // A failed connection is ignored; the next one is served.
            let _ = builder.serve_connection(stream, answer).await;
            drop(place);
        });
    }
}

/// Whether a connection was closed before it was accepted.
fn is_of_peer(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionAborted, ConnectionRefused, ConnectionReset};
    matches!(error.kind(), ConnectionAborted | ConnectionRefused | ConnectionReset)
}

/// Reads the whole body of a request before it is processed.
pub async fn whole_body(State(limits): State<Limits>, request: Request, next: Next) -> Response {
    let (parts, body) = request.into_parts();
    let said = |status: StatusCode, reason: &str| (status, Json(serde_json::json!({ "error": reason }))).into_response();
    match timeout(limits.body, to_bytes(body, BODY_LIMIT)).await {
        Ok(Ok(bytes)) => next.run(Request::from_parts(parts, Body::from(bytes))).await,
        Ok(Err(_)) => said(StatusCode::PAYLOAD_TOO_LARGE, "the request is larger than any that the page sends"),
        Err(_) => said(StatusCode::REQUEST_TIMEOUT, "the request did not end in time"),
    }
}

/// A connection that fails when the peer reads nothing for a while.
struct Impatient {
    stream: TcpStream,
    limit: Duration,
    /// Set while a write waits.
    stalled: Option<Pin<Box<Sleep>>>,
}

impl Impatient {
    /// The result of a write, or an error after waiting for too long.
    fn in_time<T>(&mut self, context: &mut Context<'_>, written: Poll<io::Result<T>>) -> Poll<io::Result<T>> {
        if written.is_ready() {
            self.stalled = None;
            return written;
        }
        let limit = self.limit;
        let stalled = self.stalled.get_or_insert_with(|| Box::pin(sleep(limit)));
        stalled.as_mut().poll(context).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }
}

impl AsyncRead for Impatient {
    fn poll_read(mut self: Pin<&mut Self>, context: &mut Context<'_>, buffer: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(context, buffer)
    }
}

impl AsyncWrite for Impatient {
    fn poll_write(mut self: Pin<&mut Self>, context: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let written = Pin::new(&mut self.stream).poll_write(context, bytes);
        self.in_time(context, written)
    }

    fn poll_flush(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let flushed = Pin::new(&mut self.stream).poll_flush(context);
        self.in_time(context, flushed)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, context: &mut Context<'_>) -> Poll<io::Result<()>> {
        let shut = Pin::new(&mut self.stream).poll_shutdown(context);
        self.in_time(context, shut)
    }
}

#[cfg(test)]
mod tests {
    use std::{
        io::{Read, Write},
        net::{SocketAddr, TcpStream as Client},
    };

    use axum::{middleware, routing::post};

    use super::*;

    const SHORT: Duration = Duration::from_millis(150);
    const LONG: Duration = Duration::from_secs(20);

    /// Starts a server on its own thread: `POST /` returns its body, `/large` is more than a connection buffers.
    fn started(limits: Limits) -> SocketAddr {
        let (sender, receiver) = std::sync::mpsc::channel();
        std::thread::spawn(move || {
            let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
            runtime.block_on(async move {
                let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
                sender.send(listener.local_addr().unwrap()).unwrap();
                let router = Router::new()
                    .route("/", post(|body: String| async { body }))
                    .route("/large", post(|| async { vec![b'x'; 64 << 20] }))
                    .layer(middleware::from_fn_with_state(limits, whole_body));
                serve(listener, router, limits).await
            })
        });
        receiver.recv().unwrap()
    }

    fn client(address: SocketAddr) -> Client {
        let client = Client::connect(address).unwrap();
        client.set_read_timeout(Some(LONG)).unwrap();
        client
    }

    /// Sends a text and returns everything received until the connection ends.
    fn answer(mut client: Client, text: &str) -> String {
        client.write_all(text.as_bytes()).unwrap();
        let mut answer = Vec::new();
        // A closed connection may end with a reset.
        let _ = client.read_to_end(&mut answer);
        String::from_utf8_lossy(&answer).into_owned()
    }

    const WHOLE: &str = "POST / HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: 5\r\n\r\nhello";

    #[test]
    fn connections_that_say_nothing_are_ended_and_others_are_answered() {
        let limits = Limits { connections: 2, head: SHORT, body: SHORT, answer: LONG };
        let address = started(limits);
        // The largest allowed number, half open; one has started a head.
        let silent = client(address);
        let mut slow = client(address);
        slow.write_all(b"POST / HTTP/1.1\r\nhost:").unwrap();
        assert!(answer(client(address), WHOLE).ends_with("\r\n\r\nhello"), "answered after the other connections were closed");
        assert_eq!(answer(silent, ""), "");
        assert_eq!(answer(slow, ""), "");
    }

    #[test]
    fn bodies_that_do_not_come_or_do_not_end_are_refused() {
        let limits = Limits { head: LONG, body: SHORT, answer: LONG, ..Limits::default() };
        let address = started(limits);
        let waiting = answer(client(address), "POST / HTTP/1.1\r\nhost: a\r\ncontent-length: 5\r\n\r\nhe");
        assert!(waiting.starts_with("HTTP/1.1 408 "), "{waiting}");
        let large = format!("POST / HTTP/1.1\r\nhost: a\r\nconnection: close\r\ncontent-length: {}\r\n\r\n", BODY_LIMIT + 1);
        let large = answer(client(address), &(large + &"x".repeat(BODY_LIMIT + 1)));
        assert!(large.starts_with("HTTP/1.1 413 "), "{large}");
        assert!(answer(client(address), WHOLE).ends_with("hello"));
    }

    #[test]
    fn clients_that_do_not_read_answers_are_disconnected() {
        let limits = Limits { connections: 1, head: LONG, body: LONG, answer: SHORT };
        let address = started(limits);
        let mut deaf = client(address);
        deaf.write_all(b"POST /large HTTP/1.1\r\nhost: a\r\ncontent-length: 0\r\n\r\n").unwrap();
        // The only slot becomes free although `deaf` stays open and reads nothing.
        assert!(answer(client(address), WHOLE).ends_with("hello"));
        drop(deaf);
    }
}
