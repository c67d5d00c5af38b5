//! By which name this machine may be called.
//!
//! A browser asks in the name of the page that it shows. If that page's name is made to lead to 127.0.0.1 after it was loaded ("DNS rebinding"), the page could read what is
//! meant for this machine's users only. Its requests still carry its own name, and are refused for that.

use axum::extract::Request;
use axum::http::uri::Authority;
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

/// Lets those pass that call this machine by a loopback name, with any port: a tunnel may have another.
pub(super) async fn only_loopback(request: Request, next: Next) -> Response {
    let told = request.headers().get(header::HOST).map(|host| host.to_str().unwrap_or_default());
    // A request in a proxy's form names its host in its first line too; both must be right.
    let named = request.uri().host();
    match (told, named) {
        (None, None) => (StatusCode::BAD_REQUEST, "the request does not say which host it asks for\n").into_response(),
        (told, named) if told.is_none_or(is_loopback) && named.is_none_or(is_loopback) => next.run(request).await,
        _ => {
            let sentence = "only requests to localhost, 127.0.0.1 or [::1] are answered\n";
            (StatusCode::FORBIDDEN, sentence).into_response()
        }
    }
}

/// Whether a host, perhaps with a port, is a loopback name.
fn is_loopback(host: &str) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let name = authority.host();
    let port_is_fine = authority.as_str().len() == name.len() || authority.port_u16().is_some();
    let literal = name.trim_start_matches('[').trim_end_matches(']');
    let is_address = literal.parse::<std::net::IpAddr>().is_ok_and(|address| address.is_loopback());
    port_is_fine && !host.contains('@') && (name.eq_ignore_ascii_case("localhost") || is_address)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loopback_names_are_told_from_all_others() {
        for host in ["localhost", "LocalHost:9110", "127.0.0.1", "127.0.0.1:80", "[::1]", "[::1]:9110", "127.1.2.3:1"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in [
            "",
            "example.org",
            "localhost.example.org",
            "127.0.0.1.example.org",
            "example.org:9110",
            "192.168.0.1",
            "0.0.0.0",
            "[::]",
            "localhost@example.org",
            "example.org@localhost",
            "localhost:9110:1",
            "localhost:x",
            "http://localhost/",
            "/localhost",
            "local host",
        ] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
