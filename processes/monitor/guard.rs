//! Who may see the page and who may command: the name that was asked for, the token, and the origin of a command.
//!
//! A page of another site that is open in the same browser can send requests here. It cannot read answers, but a command needs
//! none: so commands are accepted from the page's own origin only. A name that an attacker points at this machine is refused.

use axum::http::{HeaderMap, HeaderValue, Method, Uri, header};
use std::net::{IpAddr, SocketAddr};

/// Name of the cookie that holds the token.
const COOKIE: &str = "fringecell";

/// What is done with a request.
#[derive(Debug, PartialEq, Eq)]
pub enum Decision {
    /// The request is served.
    Serve,
    /// The browser keeps the token as a cookie and asks again without it.
    KeepToken(String),
    /// It gets this status and reason.
    Refuse(u16, &'static str),
}

/// The rules of one address.
#[derive(Debug, Clone)]
pub struct Guard {
    token: Option<String>,
    /// Whether only this machine can reach the address.
    local: bool,
}

impl Guard {
    /// For an address; with a token, viewers must know it.
    pub fn new(token: Option<String>, address: &SocketAddr) -> Self {
        Self { token, local: address.ip().is_loopback() }
    }

    /// Decides about a request.
    pub fn decide(&self, method: &Method, uri: &Uri, headers: &HeaderMap) -> Decision {
        let text = |name| headers.get(name).and_then(|value| value.to_str().ok());
        let host = text(header::HOST).unwrap_or_default();
        if self.local && !is_local_name(host) {
            return Decision::Refuse(421, "this address is called 127.0.0.1 or localhost");
        }
        let safe = matches!(*method, Method::GET | Method::HEAD);
        if !safe && !is_own_origin(host, text(header::ORIGIN), headers) {
            return Decision::Refuse(403, "commands are accepted from this page only");
        }
        let Some(token) = &self.token else { return Decision::Serve };
        if uri.path() == "/"
            && uri.query().and_then(|query| query.strip_prefix("token=")).is_some_and(|t| same(t, token))
        {
            return Decision::KeepToken(format!("{COOKIE}={token}; Path=/; HttpOnly; SameSite=Strict"));
        }
        let bearer = text(header::AUTHORIZATION).and_then(|value| value.strip_prefix("Bearer "));
        let cookies = text(header::COOKIE).unwrap_or_default().split(';');
        let cookie = cookies.filter_map(|pair| pair.trim().split_once('=')).find(|(name, _)| *name == COOKIE);
        match bearer.or(cookie.map(|(_, value)| value)) {
            Some(given) if same(given, token) => Decision::Serve,
            _ => Decision::Refuse(
                401,
                "this page needs a token: open it as http://ADDRESS/?token=TOKEN, or send Authorization: Bearer TOKEN",
            ),
        }
    }
}

/// Whether a `Host` is a name of this machine that nobody can point elsewhere.
fn is_local_name(host: &str) -> bool {
    let name = match host.rsplit_once(':') {
        Some((name, port)) if port.bytes().all(|b| b.is_ascii_digit()) => name,
        _ => host,
    };
    let bare = name.trim_start_matches('[').trim_end_matches(']');
    name.eq_ignore_ascii_case("localhost") || bare.parse::<IpAddr>().is_ok_and(|ip| ip.is_loopback())
}

/// Whether a command comes from the page itself, or from a program that is no browser.
fn is_own_origin(host: &str, origin: Option<&str>, headers: &HeaderMap) -> bool {
    let site = headers.get("sec-fetch-site").map(HeaderValue::as_bytes);
    if site.is_some_and(|site| site != b"same-origin") {
        return false;
    }
    match origin {
        None => site.is_none() && !headers.contains_key(header::ORIGIN),
        Some(origin) => {
            let rest = origin.strip_prefix("http://").or_else(|| origin.strip_prefix("https://"));
            !host.is_empty() && rest.is_some_and(|rest| rest.eq_ignore_ascii_case(host))
        }
    }
}

/// Compares in a time that does not depend on how much is equal.
fn same(given: &str, token: &str) -> bool {
    let differences = given.bytes().zip(token.bytes()).fold(0, |all, (a, b)| all | (a ^ b));
    given.len() == token.len() && std::hint::black_box(differences) == 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use axum::http::HeaderName;

    fn decide(
        token: Option<&str>,
        address: &str,
        method: &Method,
        uri: &str,
        pairs: &[(&str, &str)],
    ) -> Decision {
        let guard = Guard::new(token.map(str::to_owned), &address.parse().unwrap());
        let headers = pairs.iter().map(|(name, value)| {
            (name.parse::<HeaderName>().unwrap(), HeaderValue::from_str(value).unwrap())
        });
        guard.decide(method, &uri.parse().unwrap(), &headers.collect())
    }

    fn status(decision: &Decision) -> u16 {
        match decision {
            Decision::Serve => 200,
            Decision::KeepToken(_) => 303,
            Decision::Refuse(status, _) => *status,
        }
    }

    #[test]
    fn a_local_page_is_served_under_its_own_names_only() {
        for (host, expected) in [
            ("127.0.0.1:8080", 200),
            ("localhost", 200),
            ("LOCALHOST:1", 200),
            ("[::1]:8080", 200),
            ("127.0.0.1.evil.example:8080", 421),
            ("evil.example", 421),
            ("192.168.1.4:8080", 421),
            ("", 421),
        ] {
            let decided = decide(None, "127.0.0.1:8080", &Method::GET, "/", &[("host", host)]);
            assert_eq!(status(&decided), expected, "{host}");
        }
    }

    #[test]
    fn commands_come_from_the_page_itself_or_from_no_browser() {
        let host = ("host", "127.0.0.1:8080");
        for (more, expected) in [
            (vec![], 200),
            (vec![("origin", "http://127.0.0.1:8080")], 200),
            (vec![("origin", "http://127.0.0.1:8080"), ("sec-fetch-site", "same-origin")], 200),
            (vec![("origin", "http://127.0.0.1:8080"), ("sec-fetch-site", "cross-site")], 403),
            (vec![("sec-fetch-site", "same-site")], 403),
            (vec![("sec-fetch-site", "same-origin")], 403),
            (vec![("origin", "http://127.0.0.1:8081")], 403),
            (vec![("origin", "http://localhost:8080")], 403),
            (vec![("origin", "null")], 403),
            (vec![("origin", "")], 403),
            (vec![("origin", "http://evil.example")], 403),
            (vec![("origin", "file://127.0.0.1:8080")], 403),
        ] {
            let headers = [vec![host], more.clone()].concat();
            let decided = decide(None, "127.0.0.1:8080", &Method::POST, "/api/command", &headers);
            assert_eq!(status(&decided), expected, "{more:?}");
        }
    }

    #[test]
    fn who_does_not_know_the_token_sees_nothing() {
        let token = "0123456789abcdef";
        let ask = |uri: &str, pairs: &[(&str, &str)]| {
            status(&decide(Some(token), "192.168.1.4:80", &Method::GET, uri, pairs))
        };
        assert_eq!(ask("/", &[]), 401);
        assert_eq!(ask("/?token=0123456789abcdef", &[]), 303);
        assert_eq!(ask("/?token=0123456789abcdee", &[]), 401);
        assert_eq!(ask("/?token=", &[]), 401);
        assert_eq!(ask("/api/state?token=0123456789abcdef", &[]), 401);
        assert_eq!(ask("/metrics", &[("authorization", "Bearer 0123456789abcdef")]), 200);
        assert_eq!(ask("/metrics", &[("authorization", "Bearer 0123456789abcde")]), 401);
        assert_eq!(ask("/", &[("cookie", "a=b; fringecell=0123456789abcdef")]), 200);
        assert_eq!(ask("/", &[("cookie", "fringecellx=0123456789abcdef")]), 401);
        assert_eq!(ask("/", &[("cookie", "fringecell=0123456789abcdef0")]), 401);
    }
}
