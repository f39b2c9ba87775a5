//! Access control: only the page sent by this server, in a browser on this machine, may make requests.
//!
//! The address contains a random token that other pages and programs do not know. The server rejects a request whose `Host` is not its own
//! address (another site's name may resolve to this machine), and one whose `Origin` or `Sec-Fetch-Site` names another page. Every response
//! forbids the browser to load anything from elsewhere.

use std::net::{IpAddr, SocketAddr};

use axum::{
    extract::{Request, State},
    http::{
        HeaderMap, HeaderName, HeaderValue, StatusCode, Uri,
        header::{HOST, ORIGIN},
    },
    middleware::Next,
    response::{IntoResponse, Response},
};

use super::Shared;

/// Bytes of randomness in the token.
const TOKEN_BYTES: usize = 16;

/// Headers of every answer.
const HEADERS: [(&str, &str); 7] = [
    (
        "content-security-policy",
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; base-uri 'none'; \
         form-action 'none'; frame-ancestors 'none'",
    ),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("referrer-policy", "no-referrer"),
    ("cross-origin-resource-policy", "same-origin"),
    ("cross-origin-opener-policy", "same-origin"),
    ("permissions-policy", "camera=(), microphone=(), geolocation=()"),
];

/// Requirements for a request to be answered.
#[derive(Clone, Debug)]
pub struct Guard {
    token: String,
    address: SocketAddr,
}

impl Guard {
    /// Creates a guard with a new token for a server at an address.
    ///
    /// # Errors
    /// When the system provides no random numbers.
    pub fn new(address: SocketAddr) -> Result<Self, getrandom::Error> {
        let mut bytes = [0; TOKEN_BYTES];
        getrandom::fill(&mut bytes)?;
        Ok(Self { token: format!("{:032x}", u128::from_be_bytes(bytes)), address })
    }

    /// The address to open.
    pub fn url(&self) -> String {
        let mut address = self.address;
        if address.ip().is_unspecified() {
            // `0.0.0.0` is not an address that a browser can open.
            address.set_ip(IpAddr::from([127, 0, 0, 1]));
        }
        format!("http://{address}/{}/", self.token)
    }

    /// Whether a path starts with `/TOKEN/`, compared in constant time.
    fn has_token(&self, path: &str) -> bool {
        let (given, known) = (path.as_bytes(), self.token.as_bytes());
        let end = known.len() + 1;
        let (Some(b'/'), Some(token), Some(b'/')) = (given.first(), given.get(1..end), given.get(end)) else { return false };
        token.iter().zip(known).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
    }

    /// Whether `name:port` is this server: a name of this machine, or the address it listens on.
    fn is_own(&self, authority: &str) -> bool {
        const HTTP_PORT: u16 = 80;
        let after_bracket = authority.rfind(']').unwrap_or(0);
        let (name, port) = match authority[after_bracket..].rfind(':') {
            Some(colon) => {
                let (name, port) = authority.split_at(after_bracket + colon);
                (name, port[1..].parse().ok())
            }
            None => (authority, Some(HTTP_PORT)),
        };
        let here = self.address.ip();
        let address: Option<IpAddr> = name.trim_start_matches('[').trim_end_matches(']').parse().ok();
        let named = match address {
            // A numeric address cannot come from another site's name.
            Some(ip) => ip == here || here.is_unspecified() || (ip.is_loopback() && here.is_loopback()),
            None => name.eq_ignore_ascii_case("localhost") && (here.is_loopback() || here.is_unspecified()),
        };
        named && port == Some(self.address.port())
    }

    /// Why a request is refused; `None` if it is accepted.
    fn refusal(&self, uri: &Uri, headers: &HeaderMap) -> Option<(StatusCode, &'static str)> {
        let text = |name: HeaderName| headers.get_all(name).iter().map(|v| v.to_str().unwrap_or("?")).collect::<Vec<_>>();
        let hosts = text(HOST);
        let authority = uri.authority().map(axum::http::uri::Authority::as_str);
        if hosts.len() != 1 || !hosts.into_iter().chain(authority).all(|host| self.is_own(host)) {
            return Some((StatusCode::FORBIDDEN, "the request names another host than this server"));
        }
        let own_origin = |origin: &str| origin.strip_prefix("http://").is_some_and(|authority| self.is_own(authority));
        let says = |name, values: &[&str]| text(HeaderName::from_static(name)).into_iter().all(|v| values.contains(&v));
        // A link on another page, such as a terminal in the browser, may open the page. This neither changes nor reveals anything.
        let opens_page = uri.path().len() == self.token.len() + 2
            && headers.contains_key("sec-fetch-mode")
            && says("sec-fetch-mode", &["navigate"])
            && says("sec-fetch-dest", &["document"]);
        let from_elsewhere = !says("sec-fetch-site", &["same-origin", "none"]) && !opens_page;
        if from_elsewhere || !text(ORIGIN).into_iter().all(own_origin) {
            return Some((StatusCode::FORBIDDEN, "the request comes from another page"));
        }
        if !self.has_token(uri.path()) {
            return Some((
                StatusCode::NOT_FOUND,
                "nothing here; open the whole address that grimace annotate printed when it was started",
            ));
        }
        None
    }
}

/// Passes accepted requests on, and adds the headers to every response.
pub async fn check(State(app): State<Shared>, request: Request, next: Next) -> Response {
    let mut response = match app.guard.refusal(request.uri(), request.headers()) {
        Some(refusal) => refusal.into_response(),
        None => next.run(request).await,
    };
    for (name, value) in HEADERS {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guard(address: &str) -> Guard {
        Guard::new(address.parse().unwrap()).unwrap()
    }

    fn refused(guard: &Guard, path: &str, headers: &[(&'static str, &str)]) -> Option<u16> {
        let mut map = HeaderMap::new();
        for (name, value) in headers {
            map.append(*name, value.parse().unwrap());
        }
        guard.refusal(&path.parse().unwrap(), &map).map(|(status, _)| status.as_u16())
    }

    #[test]
    fn tokens_are_random_and_checked_whole() {
        let (a, b) = (guard("127.0.0.1:7113"), guard("127.0.0.1:7113"));
        assert_ne!(a.token, b.token);
        assert_eq!(a.token.len(), 2 * TOKEN_BYTES);
        let host = [("host", "127.0.0.1:7113")];
        assert_eq!(refused(&a, &format!("/{}/", a.token), &host), None);
        assert_eq!(refused(&a, &format!("/{}/api/x", a.token), &host), None);
        for path in ["/".to_owned(), format!("/{}", a.token), format!("/{}/", b.token), format!("/{}x/", a.token), "/api".into()]
        {
            assert_eq!(refused(&a, &path, &host), Some(404), "{path}");
        }
    }

    #[test]
    fn only_names_of_this_machine_are_its_hosts() {
        let g = guard("127.0.0.1:7113");
        let own = ["127.0.0.1:7113", "localhost:7113", "LOCALHOST:7113", "[::1]:7113"];
        assert!(own.iter().all(|host| g.is_own(host)));
        let foreign = [
            "evil.example:7113",
            "127.0.0.1",
            "127.0.0.1:80",
            "localhost:7114",
            "localhost.evil:7113",
            "",
            ":7113",
            "192.168.0.7:7113",
            "é]",
        ];
        assert!(!foreign.iter().any(|host| g.is_own(host)), "{foreign:?}");
        // A server on a network accepts its own numeric address as host, but no name.
        let g = guard("192.168.0.7:80");
        assert!(g.is_own("192.168.0.7:80") && g.is_own("192.168.0.7"));
        assert!(!g.is_own("localhost:80") && !g.is_own("evil.example") && !g.is_own("127.0.0.1"));
        assert!(guard("0.0.0.0:7113").is_own("10.0.0.3:7113") && !guard("0.0.0.0:7113").is_own("evil.example:7113"));
    }

    #[test]
    fn requests_of_other_pages_are_refused() {
        let g = guard("127.0.0.1:7113");
        let path = format!("/{}/api/fit", g.token);
        let with = |name, value| refused(&g, &path, &[("host", "127.0.0.1:7113"), (name, value)]);
        assert_eq!(with("origin", "http://127.0.0.1:7113"), None);
        assert_eq!(with("origin", "http://localhost:7113"), None);
        for origin in [
            "http://evil.example",
            "https://127.0.0.1:7113",
            "http://127.0.0.1:8000",
            "null",
            "http://127.0.0.1:7113.evil.example",
        ] {
            assert_eq!(with("origin", origin), Some(403), "{origin}");
        }
        assert_eq!(with("sec-fetch-site", "none"), None);
        assert_eq!(with("sec-fetch-site", "same-site"), Some(403));
        assert_eq!(with("sec-fetch-site", "cross-site"), Some(403));
        // A link elsewhere may open only the page itself, in its own window.
        let opened = |path: &str, dest| {
            let headers = [("host", "127.0.0.1:7113"), ("sec-fetch-site", "cross-site"), ("sec-fetch-mode", "navigate")];
            refused(&g, path, &[&headers[..], &[("sec-fetch-dest", dest)]].concat())
        };
        assert_eq!(opened(&format!("/{}/", g.token), "document"), None);
        assert_eq!(opened(&format!("/{}/", g.token), "iframe"), Some(403));
        assert_eq!(opened(&path, "document"), Some(403));
        assert_eq!(with("host", "evil.example"), Some(403), "two hosts");
        assert_eq!(refused(&g, &path, &[]), Some(403), "no host");
        let absolute = format!("http://evil.example{path}");
        assert_eq!(refused(&g, &absolute, &[("host", "127.0.0.1:7113")]), Some(403));
    }

    #[test]
    fn the_address_can_be_opened() {
        assert!(guard("127.0.0.1:7113").url().starts_with("http://127.0.0.1:7113/"));
        assert!(guard("0.0.0.0:9").url().starts_with("http://127.0.0.1:9/"));
        assert!(guard("[::1]:9").url().starts_with("http://[::1]:9/"));
    }
}
