//! Host names under which this machine may be addressed.
//!
//! A browser sends requests on behalf of the page that it shows. If that page's name is
//! redirected here after loading ("DNS rebinding"), the page could read data meant for this
//! session's users only. Its requests still carry its own host name, and are refused for that.
//! A numeric address cannot be redirected, so the address at which the connection arrived is
//! accepted. tower-http has no check of hosts.

use std::net::IpAddr;
use std::sync::Arc;

use axum::extract::{Request, State};
use axum::http::uri::Authority;
use axum::http::{StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};

use super::access::Gate;
use super::connection_info::ConnectionInfo;

/// Admits requests that name this machine, with any port: a tunnel may use another one.
pub(super) async fn only_own_names(State(gate): State<Arc<Gate>>, request: Request, next: Next) -> Response {
    let sent = request.headers().get(header::HOST).map(|host| host.to_str().unwrap_or_default());
    // A request in proxy form names its host in its first line too; both must be right.
    let named = request.uri().host();
    let at = request.extensions().get::<ConnectionInfo>().map(|line| line.local.ip().to_canonical());
    let is_own = |host: &str| is_own(host, at, &gate.names);
    match (sent, named) {
        (None, None) => (StatusCode::BAD_REQUEST, "the request has no host; send the header Host\n").into_response(),
        (sent, named) if sent.is_none_or(is_own) && named.is_none_or(is_own) => next.run(request).await,
        _ if at.is_none_or(|at| at.is_loopback()) => {
            let sentence = "this host name is not accepted; use localhost, 127.0.0.1 or [::1]\n";
            (StatusCode::FORBIDDEN, sentence).into_response()
        }
        _ => {
            let sentence = "this host name is not accepted; use this machine's address, a name of its certificate or \
                one of [status] names\n";
            (StatusCode::FORBIDDEN, sentence).into_response()
        }
    }
}

/// Whether a host, perhaps with a port, is this machine. Accepted are: the very address at
/// which the connection arrived; a loopback name, if it arrived at a loopback address or at an
/// unknown one; one of `names`, in which `*.` stands for one label at the beginning.
pub fn is_own(host: &str, at: Option<IpAddr>, names: &[String]) -> bool {
    let Ok(authority) = host.parse::<Authority>() else { return false };
    let name = authority.host();
    let port_is_fine = authority.as_str().len() == name.len() || authority.port_u16().is_some();
    if !port_is_fine || host.contains('@') {
        return false;
    }
    let literal = name.strip_prefix('[').and_then(|rest| rest.strip_suffix(']')).unwrap_or(name);
    let is_named = names.iter().any(|own| matches(own, literal));
    match literal.parse::<IpAddr>().map(|address| address.to_canonical()) {
        Ok(address) => is_named || at.map_or(address.is_loopback(), |at| address == at || both_loop(address, at)),
        Err(_) => is_named || at.is_none_or(|at| at.is_loopback()) && name.eq_ignore_ascii_case("localhost"),
    }
}

fn both_loop(one: IpAddr, other: IpAddr) -> bool {
    one.is_loopback() && other.is_loopback()
}

fn matches(own: &str, name: &str) -> bool {
    match own.strip_prefix("*.") {
        Some(rest) => {
            name.split_once('.').is_some_and(|(first, own)| !first.is_empty() && own.eq_ignore_ascii_case(rest))
        }
        None => own.eq_ignore_ascii_case(name),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_loopback(host: &str) -> bool {
        let at = [None, Some([127, 0, 0, 1].into())].map(|at| is_own(host, at, &[]));
        assert_eq!(at[0], at[1], "{host}");
        at[0]
    }

    #[test]
    fn loopback_host_names_only_are_own() {
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

    #[test]
    fn remote_listener_accepts_own_address_and_names() {
        let at = |address: &str| Some(address.parse().unwrap());
        let names = ["bedside-3.local".to_owned(), "*.ward.example".into(), "10.0.0.9".into()];
        let own = |host: &str| is_own(host, at("192.168.0.7"), &names);
        for host in [
            "192.168.0.7",
            "192.168.0.7:9110",
            "[::ffff:192.168.0.7]:1",
            "Bedside-3.LOCAL:9110",
            "a.ward.example",
            "10.0.0.9:80",
        ] {
            assert!(own(host), "{host}");
        }
        for host in [
            "localhost",
            "127.0.0.1:9110",
            "192.168.0.8",
            "ward.example",
            "a.b.ward.example",
            ".ward.example",
            "bedside-3.local.example.org",
            "bedside-3.local@example.org",
            "bedside-3.local:x",
        ] {
            assert!(!own(host), "{host}");
        }
        assert!(is_own("[fe80::1]:9110", at("fe80::1"), &[]) && !is_own("fe80::1", at("fe80::2"), &[]));
        assert!(is_own("bedside-3.local", None, &names));
    }
}
