//! Parses requests and decides whether they are allowed.

use std::io::{self, BufRead};
use std::net::IpAddr;

/// Maximum length of a request.
const MOST_BYTES: u64 = 16_384;
const MOST_HEADERS: usize = 64;

/// What a request wants.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Method {
    Get,
    Post,
    Other,
}

/// The parts of a request that are used.
#[derive(Debug, PartialEq)]
pub(super) struct Request {
    pub(crate) method: Method,
    pub(crate) path: String,
    pub(crate) token: Option<String>,
    pub(crate) host: Option<String>,
}

/// Reads a request; returns `None` if the input is not one.
pub(super) fn read(from: impl BufRead) -> io::Result<Option<Request>> {
    let mut from = from.take(MOST_BYTES);
    let mut bytes = Vec::new();
    while !bytes.ends_with(b"\r\n\r\n") {
        if from.read_until(b'\n', &mut bytes)? == 0 {
            return Ok(None);
        }
    }
    let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
    let mut parsed = httparse::Request::new(&mut headers);
    if !parsed.parse(&bytes).is_ok_and(|status| status.is_complete()) {
        return Ok(None);
    }
    let (path, query) =
        parsed.path.unwrap_or("").split_once('?').unwrap_or((parsed.path.unwrap_or(""), ""));
    let token = query.split('&').find_map(|part| part.strip_prefix("token="));
    let host = parsed.headers.iter().find(|header| header.name.eq_ignore_ascii_case("host"));
    let method = match parsed.method {
        Some("GET") => Method::Get,
        Some("POST") => Method::Post,
        _ => Method::Other,
    };
    Ok(Some(Request {
        method,
        path: path.to_owned(),
        token: token.map(str::to_owned),
        host: host.and_then(|header| std::str::from_utf8(header.value).ok()).map(str::to_owned),
    }))
}

/// Who may open the page.
#[derive(Debug)]
pub(super) enum Access {
    /// Programs on this computer. A foreign page whose host name was made to resolve here (DNS rebinding) is rejected,
    /// because its request names another host.
    Loopback,
    /// Clients that know the token.
    Token(String),
}

impl Access {
    pub(super) fn allows(&self, request: &Request) -> bool {
        match self {
            Self::Loopback => request.host.as_deref().is_some_and(is_loopback),
            Self::Token(token) => request.has_token(token),
        }
    }
}

impl Request {
    /// Returns whether the request carries the token, in a time that does not depend on how much of a wrong
    /// token is right.
    pub(super) fn has_token(&self, token: &str) -> bool {
        let given = self.token.as_deref().unwrap_or("").as_bytes();
        let differ = given.iter().zip(token.as_bytes()).fold(0, |all, (a, b)| all | (a ^ b));
        given.len() == token.len() && differ == 0
    }
}

fn is_loopback(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(six) => six.split(']').next().unwrap_or(""),
        None => host.split(':').next().unwrap_or(""),
    };
    name.eq_ignore_ascii_case("localhost")
        || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(text: &str) -> Option<Request> {
        read(text.as_bytes()).unwrap_or_default()
    }

    #[test]
    fn requests_are_read_and_garbage_is_none() {
        let found = request("GET /events?a=1&token=xyz HTTP/1.1\r\nHOST: localhost:80\r\n\r\n");
        let wanted = Request {
            method: Method::Get,
            path: "/events".into(),
            token: Some("xyz".into()),
            host: Some("localhost:80".into()),
        };
        assert_eq!(found, Some(wanted));
        let long = format!("GET / HTTP/1.1\r\nA: {}\r\n\r\n", "x".repeat(20_000));
        for bad in ["", "GET /", "\r\n\r\n", "\u{0}\u{1}\r\n\r\n", &long] {
            assert_eq!(request(bad), None, "{:?}", &bad[..bad.len().min(20)]);
        }
    }

    #[test]
    fn a_foreign_name_or_a_wrong_token_is_refused() {
        let of = |host: &str, token: &str| {
            request(&format!("GET /?token={token} HTTP/1.1\r\nHost: {host}\r\n\r\n"))
        };
        let loopback = |host| of(host, "").is_some_and(|r| Access::Loopback.allows(&r));
        for host in ["localhost", "LOCALHOST:8", "127.0.0.1:80", "[::1]:80", "127.9.9.9"] {
            assert!(loopback(host), "{host}");
        }
        for host in ["evil.example", "127.0.0.1.evil.example", "192.168.0.1", "[::2]", ""] {
            assert!(!loopback(host), "{host}");
        }
        let access = Access::Token("abcd".into());
        for (token, is_right) in [("abcd", true), ("abce", false), ("abc", false), ("abcde", false)]
        {
            assert_eq!(of("x", token).is_some_and(|r| access.allows(&r)), is_right, "{token}");
        }
    }
}
