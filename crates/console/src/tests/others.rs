//! Other machines: TLS, a token, and the accepted host names.

use std::fs::Permissions;
use std::io;
use std::net::SocketAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;

use rustls_pki_types::pem::PemObject as _;
use rustls_pki_types::{CertificateDer, ServerName};
use tokio_rustls::rustls::{ClientConfig, ClientConnection, RootCertStore, StreamOwned, crypto, version};
use tungstenite::client::IntoClientRequest as _;

use config::bedside::Access;

use super::*;

const CERTIFICATE: &str = include_str!("bedside-3.crt");
const KEY: &str = include_str!("bedside-3.key");
const TOKEN: &str = "c0ffee00c0ffee00c0ffee00c0ffee00";
const METRICS_TOKEN: &str = "decade00decade00decade00decade00";

/// A folder with the files that a configuration names.
fn files() -> (tempfile::TempDir, Access) {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        Some(path)
    };
    let (certificate, key) = (put("console.crt", CERTIFICATE), put("console.key", KEY));
    let token_file = put("console.token", &format!("{TOKEN}\n"));
    let metrics_token_file = put("metrics.token", METRICS_TOKEN);
    let access = Access { certificate, key, token_file, metrics_token_file, names: vec!["ward.example".into()] };
    (folder, access)
}

fn everywhere(access: Access) -> Console {
    let listen = Listen { address: (Ipv4Addr::UNSPECIFIED, 0).into(), access };
    Console::open(&listen, ConsoleSession { latest: session(), ..ConsoleSession::default() }).unwrap()
}

type Tls = StreamOwned<ClientConnection, TcpStream>;

fn connected(console: &Console) -> Tls {
    let mut roots = RootCertStore::empty();
    roots.add(CertificateDer::from_pem_slice(CERTIFICATE.as_bytes()).unwrap()).unwrap();
    let config = ClientConfig::builder_with_provider(Arc::new(crypto::ring::default_provider()))
        .with_protocol_versions(&[&version::TLS12, &version::TLS13])
        .unwrap()
        .with_root_certificates(roots)
        .with_no_client_auth();
    let name = ServerName::try_from("bedside-3.local").unwrap();
    let stream = TcpStream::connect(local(console)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    StreamOwned::new(ClientConnection::new(Arc::new(config), name).unwrap(), stream)
}

fn local(console: &Console) -> SocketAddr {
    (Ipv4Addr::LOCALHOST, console.address().port()).into()
}

/// Sends a request; returns the answer's code, head and body.
fn answer(mut stream: impl io::Read + io::Write, request: &str) -> (u16, String, String) {
    stream.write_all(request.as_bytes()).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let (head, body) = text.split_once("\r\n\r\n").unwrap();
    (head.split(' ').nth(1).unwrap().parse().unwrap(), head.to_lowercase(), body.to_owned())
}

fn get(console: &Console, path: &str, more: &str) -> (u16, String, String) {
    let request = format!("GET {path} HTTP/1.1\r\nhost: bedside-3.local\r\nconnection: close\r\n{more}\r\n");
    answer(connected(console), &request)
}

fn login(console: &Console, token: &str) -> (u16, String, String) {
    let body = serde_json::json!({ "token": token }).to_string();
    let length = body.len();
    let request = format!(
        "POST /v1/login HTTP/1.1\r\nhost: bedside-3.local\r\norigin: https://bedside-3.local\r\nconnection: close\r\ncontent-type: application/json\r\ncontent-length: {length}\r\n\r\n{body}"
    );
    answer(connected(console), &request)
}

/// Logs in and returns the cookie, in its original case.
fn cookie_of(console: &Console) -> String {
    let mut stream = connected(console);
    let body = serde_json::json!({ "token": TOKEN }).to_string();
    let head =
        "POST /v1/login HTTP/1.1\r\nhost: bedside-3.local\r\nconnection: close\r\ncontent-type: application/json";
    write!(stream, "{head}\r\ncontent-length: {}\r\n\r\n{body}", body.len()).unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    let cookie = text.lines().find(|line| line.to_lowercase().starts_with("set-cookie: ")).unwrap();
    cookie[12..].split(';').next().unwrap().to_owned()
}

#[test]
fn remote_address_requires_valid_certificate_key_and_token() {
    let (folder, good) = files();
    let refused = |address: &str, access: &Access| {
        let listen = Listen { address: address.parse().unwrap(), access: access.clone() };
        let sentence = listen.check().unwrap_err().to_string();
        let begun = Console::open(&listen, ConsoleSession { latest: session(), ..ConsoleSession::default() });
        assert_eq!(begun.unwrap_err().to_string(), sentence, "it does not begin, either");
        sentence
    };
    for address in ["0.0.0.0:0", "[::]:0", "192.0.2.1:9110"] {
        let sentence = refused(address, &Access::default());
        assert!(
            sentence.contains("other machines can reach ")
                && sentence.contains("no certificate, no key and no token_file"),
            "{sentence}"
        );
        let sentence = refused(address, &Access { token_file: None, ..good.clone() });
        assert!(sentence.contains("[status] has no token_file: give it"), "{sentence}");
    }
    let other = |key: &str, text: &str, mode: u32| {
        let path = folder.path().join("other");
        let _ = std::fs::remove_file(&path);
        std::fs::write(&path, text).unwrap();
        std::fs::set_permissions(&path, Permissions::from_mode(mode)).unwrap();
        let path = Some(path);
        match key {
            "certificate" => Access { certificate: path, ..good.clone() },
            "key" => Access { key: path, ..good.clone() },
            "metrics_token_file" => Access { metrics_token_file: path, ..good.clone() },
            _ => Access { token_file: path, ..good.clone() },
        }
    };
    // Another key in the same form, which does not fit the certificate.
    let stranger = KEY.replacen(&KEY[60..64], "AAAA", 1);
    for (key, text, mode, expected) in [
        ("certificate", "", 0o644, "holds no certificate in PEM"),
        ("certificate", KEY, 0o600, "holds no certificate in PEM"),
        ("certificate", "-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n", 0o644, "cannot be read"),
        ("certificate", "-----BEGIN CERTIFICATE-----\n!\n-----END CERTIFICATE-----\n", 0o644, "is not PEM"),
        ("key", "", 0o600, "holds no private key"),
        ("key", CERTIFICATE, 0o600, "holds no private key"),
        ("key", KEY, 0o644, "all users may read or write it (mode 644); run chmod o="),
        ("key", &stranger, 0o600, "key"),
        ("token_file", TOKEN, 0o640, "(mode 640); run chmod 600"),
        ("token_file", "secret", 0o600, "of 6 characters, but 32 or more are needed"),
        ("metrics_token_file", METRICS_TOKEN, 0o644, "(mode 644); run chmod 600"),
        ("metrics_token_file", TOKEN, 0o600, "holds the token of token_file, which gives everything; make another"),
    ] {
        let sentence = refused("127.0.0.1:0", &other(key, text, mode));
        assert!(sentence.starts_with(&format!("status.{key}: ")) && sentence.contains(expected), "{sentence}");
        assert!(!sentence.contains("secret"), "{sentence}");
    }
    let gone = Access { key: Some(Path::new("/nowhere/console.key").into()), ..good.clone() };
    assert!(refused("127.0.0.1:0", &gone).starts_with("status.key: /nowhere/console.key: cannot be read: "));
    let half = Access { key: None, ..good.clone() };
    assert_eq!(refused("127.0.0.1:0", &half), "status.certificate: has no effect without key; give both, or neither");
    let metrics_only = Access { token_file: None, ..good };
    let expected = "status.metrics_token_file: has no effect without token_file; give both, or neither";
    assert_eq!(refused("127.0.0.1:0", &metrics_only), expected);
}

#[test]
fn remote_clients_need_tls_and_token() {
    let (_folder, access) = files();
    let console = everywhere(access);
    assert_eq!(console.url(), format!("https://ward.example:{}/", console.address().port()));
    let bearer = format!("authorization: Bearer {TOKEN}\r\n");
    let (code, _, body) = get(&console, "/healthz", &bearer);
    assert_eq!((code, body.as_str()), (200, "moves\n"));
    for path in ["/status", "/metrics", "/healthz", "/v1/stream", "/page/main.js", "/page/index.html", "/nothing"] {
        let (code, head, body) = get(&console, path, "");
        assert!(code == 401 && head.contains("www-authenticate: bearer"), "{path}: {head}");
        assert!(!body.contains("version") && !body.contains(TOKEN), "{body}");
    }
    for wrong in ["Bearer ", "Basic Y29mZmVl", "Bearer", "bearer  "] {
        assert_eq!(get(&console, "/status", &format!("authorization: {wrong}\r\n")).0, 401, "{wrong}");
    }
    assert_eq!(Counts::of(&console.counts().tokens_wrong), 0, "none of these was a token");
    // Clients without TLS get nothing, and an unfinished handshake is closed.
    for plain in [&b"GET /healthz HTTP/1.1\r\nhost: localhost\r\n\r\n"[..], &[0xff; 600], &[0x16, 3, 1]] {
        let mut stream = TcpStream::connect(local(&console)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
        stream.write_all(plain).unwrap();
        let mut sentence = Vec::new();
        // A reset ends the connection, too.
        let _ = stream.read_to_end(&mut sentence);
        assert!(!sentence.starts_with(b"HTTP"), "{sentence:?}");
    }
    let begun = Instant::now();
    while Counts::of(&console.counts().no_tls) < 3 {
        assert!(begun.elapsed() < Duration::from_secs(10), "{:?}", console.counts());
        std::thread::sleep(Duration::from_millis(5));
    }
    // The token does not bypass the check of host names.
    for (host, code) in
        [("ward.example", 200), ("localhost:1", 200), ("127.0.0.1", 200), ("example.org", 403), ("192.0.2.1", 403)]
    {
        let request = format!("GET /status HTTP/1.1\r\nhost: {host}\r\nconnection: close\r\n{bearer}\r\n");
        assert_eq!(answer(connected(&console), &request).0, code, "{host}");
    }
    // A program opens the stream.
    let mut request =
        format!("wss://bedside-3.local:{}/v1/stream", console.address().port()).into_client_request().unwrap();
    assert!(tungstenite::client(request.clone(), connected(&console)).unwrap_err().to_string().contains("401"));
    request.headers_mut().insert("authorization", format!("Bearer {TOKEN}").parse().unwrap());
    let (mut socket, _) = tungstenite::client(request, connected(&console)).unwrap();
    assert!(socket.read().unwrap().into_text().unwrap().contains("\"about\""));
}

#[test]
fn token_of_metrics_gives_metrics_only() {
    let (_folder, access) = files();
    let console = everywhere(access);
    let bearer = format!("authorization: Bearer {METRICS_TOKEN}\r\n");
    for _ in 0..10 {
        let (code, _, body) = get(&console, "/metrics", &bearer);
        assert!(code == 200 && body.contains("# HELP"), "{body}");
    }
    assert_eq!(Counts::of(&console.counts().tokens_wrong), 0);
    for path in ["/status", "/v1/stream", "/"] {
        assert_eq!(get(&console, path, &bearer).0, 401, "{path}");
    }
    assert_eq!(login(&console, METRICS_TOKEN).0, 401);
    assert_eq!(Counts::of(&console.counts().tokens_wrong), 4);
    assert_eq!(get(&console, "/metrics", &format!("authorization: Bearer {TOKEN}\r\n")).0, 200);
}

#[test]
fn browser_login_sets_http_only_cookie() {
    let (_folder, access) = files();
    let console = everywhere(access.clone());
    let (code, head, page) = get(&console, "/", "");
    assert!(code == 401 && head.contains("text/html") && head.contains("script-src 'self'"), "{head}");
    assert!(page.contains("type=\"password\"") && page.contains("/page/login.js"), "{page}");
    for needed in ["/page/login.js", "/page/style.css", "/page/favicon.svg"] {
        assert_eq!(get(&console, needed, "").0, 200, "{needed}");
    }
    let (code, head, _) = login(&console, TOKEN);
    assert_eq!(code, 204, "{head}");
    let cookie = head.lines().find_map(|line| line.strip_prefix("set-cookie: ")).unwrap();
    for part in ["; path=/", "; httponly", "; samesite=strict", "; secure"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    assert!(cookie.starts_with(&format!("__host-sonoweave-{}=", console.address().port())) && !cookie.contains(TOKEN));
    let cookie = cookie_of(&console);
    let (code, _, page) = get(&console, "/", &format!("cookie: other=1; {cookie}\r\n"));
    assert!(code == 200 && page.contains("id=\"view\""), "{page}");
    assert_eq!(get(&console, "/status", &format!("cookie: {cookie}\r\n")).0, 200);
    assert_eq!(get(&console, "/status", &format!("cookie: {}x\r\n", cookie)).0, 401);
    // Another session does not accept the cookie.
    let later = everywhere(access);
    let renamed = cookie.replace(&console.address().port().to_string(), &later.address().port().to_string());
    assert_eq!(get(&later, "/status", &format!("cookie: {renamed}\r\n")).0, 401);
    // Another site's page cannot log in, even with the token.
    let request = format!(
        "POST /v1/login HTTP/1.1\r\nhost: bedside-3.local\r\norigin: https://example.org\r\nconnection: close\r\ncontent-type: application/json\r\ncontent-length: {}\r\n\r\n{{\"token\":\"{TOKEN}\"}}",
        TOKEN.len() + 12
    );
    assert_eq!(answer(connected(&console), &request).0, 403);
}

#[test]
fn five_wrong_tokens_block_login_but_not_known_browsers() {
    let (_folder, access) = files();
    let access = Access { certificate: None, key: None, ..access };
    let listen = Listen { address: (Ipv4Addr::LOCALHOST, 0).into(), access };
    let console = Console::open(&listen, ConsoleSession { latest: session(), ..ConsoleSession::default() }).unwrap();
    assert!(console.url().starts_with("http://127.0.0.1:"), "this machine needs no TLS");
    let ask = |path: &str, more: &str| {
        let stream = TcpStream::connect(console.address()).unwrap();
        answer(stream, &format!("{path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n{more}"))
    };
    let shown = |token: &str| {
        let body = format!("{{\"token\":\"{token}\"}}");
        ask(
            "POST /v1/login",
            &format!("content-type: application/json\r\ncontent-length: {}\r\n\r\n{body}", body.len()),
        )
    };
    let (code, head, _) = shown(TOKEN);
    assert!(code == 204 && !head.contains("secure"), "{head}");
    let bad = ask("POST /v1/login", "content-type: application/json\r\ncontent-length: 2\r\n\r\n{}");
    assert!(bad.0 == 400 && bad.2.contains("{\"token\": \"…\"}"), "{bad:?}");
    assert_eq!(shown("wrong").0, 401);
    for _ in 0..2 {
        assert_eq!(ask("GET /status", "authorization: Bearer wrong\r\n\r\n").0, 401);
        assert_eq!(shown("wrong too").0, 401);
    }
    // The right token does not help any more: it might be a lucky guess.
    for _ in 0..3 {
        let (code, head, body) = shown(TOKEN);
        assert!(code == 429 && head.contains("retry-after: ") && body.contains("too many wrong tokens"), "{head}");
        assert_eq!(ask("GET /status", &format!("authorization: Bearer {TOKEN}\r\n\r\n")).0, 429);
    }
    let counts = console.counts();
    assert_eq!((Counts::of(&counts.tokens_wrong), Counts::of(&counts.tokens_unchecked)), (5, 6));
}
