//! The handlers without a socket, and the socket with misbehaving clients.

mod api;
mod fleet;
mod foreign;
mod others;
mod pick;

use std::collections::BTreeMap;
use std::io::{Read as _, Write as _};
use std::net::{Ipv4Addr, TcpStream};
use std::sync::Arc;
use std::time::{Duration, Instant};

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::http::{Request, StatusCode};
use axum::routing::{get, post};
use hyper::service::Service as _;
use hyper_util::service::TowerToHyperService;
use serde_json::Value;
use tokio::sync::watch;

use config::bedside::Effective;
use guidance::spacing::Spacing;
use guidance::{GuidanceSettings, ScanGuidance};
use mask::MaskSettings;
use pipeline::control::SessionController;
use pipeline::session::{ClockStatus, DeviceStatus, SessionStatus, Unwritten, Written};
use sonoweave_core::ledger::{Queue, Readings};
use sonoweave_core::refusal::{Reason, Refusal};
use sync::clock;

use super::*;
use crate::latest::STALE;
use crate::routes::guarded;

/// A status in which everything has happened.
fn eventful() -> SessionStatus {
    let mut account =
        SessionStatus { stuck_s: Some(1.5), pictures: 4, pictures_skipped: 2, ..SessionStatus::default() };
    for item in 0..10 {
        account.ledger.arrived();
        match item {
            0..5 => account.ledger.used(),
            5 | 6 => account.ledger.refused(&Refusal::new(item, Reason::SamePicture, "frozen")),
            7 => account.ledger.dropped(Queue::Insertion),
            _ => {}
        }
    }
    let refused = BTreeMap::from([("not valid", 2)]);
    account.ledger.readings.push(Readings {
        device: "tracking".into(),
        total: 9,
        used: 6,
        refused,
        dropped: 1,
        lost: 3,
    });
    account.ledger.frames.lost = 11;
    for (name, state) in [("tracking", "silent"), ("grabber", "running")] {
        account.devices.push(DeviceStatus {
            name: name.into(),
            state,
            why: if state == "running" { String::new() } else { "says \"nothing\"".into() },
            bytes: 1000,
            readings: 9,
            lost: 3,
            set_up: 1,
            last_reading_s_ago: Some(0.25),
            clocks: vec![ClockStatus { state: clock::State::Locked, bound_ms: 2.0, drift_ppm: -30.0, published: 7 }],
        });
    }
    account.capture_to_volume.add_ns(17_000_000);
    account.recording = Some(Written {
        path: "/tmp/session.mcap".into(),
        messages: 20,
        stored: 17,
        lost: 3,
        lost_before_writer: Unwritten { frames: 2, others: 0 },
        after_end: Unwritten::default(),
        bytes: 12_345,
        synced_bytes: 0,
        unsynced_s: 0.5,
        unsynced_most_s: 0.75,
        slow_disk: false,
        free_bytes: Some(6_000_000_000),
        minutes_left: Some(90.0),
        trouble: String::new(),
    });
    account
}

/// Settings of a session with this spacing.
fn held(spacing_mm: f64) -> Basis {
    let config = Effective::from([("volume.spacing_mm".to_owned(), serde_json::json!(spacing_mm))]);
    Basis { config, ..Basis::default() }
}

fn session() -> Arc<Latest> {
    let latest = Latest::new(held(0.25));
    latest.adopt(held(0.5));
    latest.publish(&eventful(), &[]);
    Arc::new(latest)
}

fn served(latest: &Arc<Latest>) -> Served {
    // The sender is gone, which only long-lived connections notice.
    let (_, stopped) = watch::channel(());
    Served::new(ConsoleSession { latest: Arc::clone(latest), ..ConsoleSession::default() }, stopped)
}

fn listening(address: std::net::SocketAddr, latest: &Arc<Latest>) -> Result<Console, ConsoleError> {
    Console::new(address, ConsoleSession { latest: Arc::clone(latest), ..ConsoleSession::default() })
}

fn bytes_of(served: Served, request: Request<Body>) -> (StatusCode, axum::http::HeaderMap, Vec<u8>) {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
    runtime.block_on(async {
        let response = TowerToHyperService::new(routes(served)).call(request).await.unwrap();
        let (head, body) = response.into_parts();
        (head.status, head.headers, to_bytes(body, usize::MAX).await.unwrap().to_vec())
    })
}

fn answered(served: Served, request: Request<Body>) -> (StatusCode, axum::http::HeaderMap, String) {
    let (status, headers, body) = bytes_of(served, request);
    (status, headers, String::from_utf8(body).unwrap())
}

fn requested(latest: &Arc<Latest>, request: Request<Body>) -> (StatusCode, axum::http::HeaderMap, String) {
    answered(served(latest), request)
}

fn get_as(latest: &Arc<Latest>, host: &str, path: &str) -> (StatusCode, axum::http::HeaderMap, String) {
    requested(latest, Request::get(path).header("host", host).body(Body::empty()).unwrap())
}

#[test]
fn status_returns_current_statistics() {
    let (code, headers, body) = get_as(&session(), "localhost:9110", "/status");
    assert_eq!(
        (code, &headers["content-type"], &headers["cache-control"]),
        (StatusCode::OK, &"application/json".parse().unwrap(), &"no-store".parse().unwrap())
    );
    let reported: Value = serde_json::from_str(&body).unwrap();
    assert_eq!(reported["version"], env!("CARGO_PKG_VERSION"));
    let frames = &reported["frames"];
    assert_eq!(
        (&frames["total"], &frames["used"], &frames["waiting"], &frames["lost"]),
        (&10.into(), &5.into(), &2.into(), &11.into())
    );
    assert_eq!((&frames["refused"]["same_picture"], &frames["dropped"]["insertion"]), (&2.into(), &1.into()));
    let tracking = &reported["devices"][0];
    assert_eq!(
        (&tracking["state"], &tracking["why"], &tracking["last_reading_s_ago"]),
        (&"silent".into(), &"says \"nothing\"".into(), &0.25.into())
    );
    assert_eq!(tracking["clocks"][0]["state"], "locked");
    assert_eq!(
        (&reported["pictures"], &reported["frozen_s"], &reported["recording"]["minutes_left"]),
        (&4.into(), &1.5.into(), &90.0.into())
    );
    assert_eq!((&reported["capture_to_volume"]["count"], &reported["capture_to_picture"]), (&1.into(), &Value::Null));
    assert!(reported["wall_s"].as_f64().unwrap() >= 0.0 && reported["process"]["resident_bytes"].as_u64().unwrap() > 0);
    assert_eq!(reported["config"]["volume.spacing_mm"], 0.5);
    assert!(reported.get("coach").is_none(), "nobody looks on");
    let spacing = Spacing { gapless_mm: 4.0, even_mm: 2.0 };
    let settings = GuidanceSettings { spacing, mask: MaskSettings::default(), calibration: Some("It is old.".into()) };
    let (latest, guidance) = (session(), ScanGuidance::new(settings));
    for at_ns in [0, 1_000_000_000] {
        latest.publish_guidance(guidance.status(&eventful(), at_ns));
    }
    let (_, _, body) = get_as(&latest, "localhost:9110", "/status");
    let reported: Value = serde_json::from_str(&body).unwrap();
    assert_eq!((&reported["coach"]["speed"], &reported["coach"]["spacing"]["gapless_mm"]), (&Value::Null, &4.0.into()));
    let keys = reported["coach"]["advice"].as_array().unwrap().iter().map(|advice| advice["key"].as_str().unwrap());
    assert_eq!(keys.collect::<Vec<_>>(), ["frozen", "calibration"]);
}

/// Returns samples by name and labels. Checks that every family is contiguous and described
/// before its samples.
fn parsed(text: &str) -> BTreeMap<String, f64> {
    let (mut samples, mut kinds) = (BTreeMap::new(), BTreeMap::new());
    let mut family = String::new();
    assert!(text.ends_with('\n'));
    for line in text.lines() {
        if let Some(rest) = line.strip_prefix("# HELP ") {
            let (name, help) = rest.split_once(' ').unwrap();
            assert!(!help.is_empty());
            family = name.to_owned();
            continue;
        }
        if let Some(rest) = line.strip_prefix("# TYPE ") {
            let (name, kind) = rest.split_once(' ').unwrap();
            assert_eq!(name, family);
            assert!(kinds.insert(name.to_owned(), kind.to_owned()).is_none(), "{name} twice");
            continue;
        }
        let (sample, value) = line.rsplit_once(' ').unwrap();
        let name = sample.split('{').next().unwrap();
        assert!(name.bytes().all(|b| b.is_ascii_alphanumeric() || b == b'_'), "{line}");
        let own = name.strip_prefix(&family).unwrap_or_else(|| panic!("{line} stands under {family}"));
        let suffixes: &[&str] = if kinds[&family] == "histogram" { &["_bucket", "_sum", "_count"] } else { &[""] };
        assert!(suffixes.contains(&own), "{line}");
        assert_eq!(kinds[&family] == "counter", family.ends_with("_total"), "{family}");
        assert!(samples.insert(sample.to_owned(), value.parse().unwrap()).is_none(), "{line} twice");
    }
    samples
}

#[test]
fn metrics_are_well_formed_and_match_status() {
    let (code, headers, body) = get_as(&session(), "127.0.0.1:9110", "/metrics");
    assert_eq!(
        (code, &headers["content-type"]),
        (StatusCode::OK, &"text/plain; version=0.0.4; charset=utf-8".parse().unwrap())
    );
    let samples = parsed(&body);
    let sum =
        |prefix: &str| samples.iter().filter(|(name, _)| name.starts_with(prefix)).map(|(_, value)| value).sum::<f64>();
    let outcomes = sum("sonoweave_frames_total{");
    assert_eq!(outcomes + samples["sonoweave_frames_waiting"], samples["sonoweave_frames_arrived_total"]);
    let device = "device=\"tracking\"";
    let of_device = sum(&format!("sonoweave_readings_total{{{device}"));
    assert_eq!(of_device + samples[&format!("sonoweave_readings_waiting{{{device}}}")], 9.0);
    for (name, value) in [
        ("sonoweave_frames_total{fate=\"refused\",reason=\"same_picture\"}", 2.0),
        ("sonoweave_frames_total{fate=\"dropped\",reason=\"insertion\"}", 1.0),
        ("sonoweave_frames_lost_total", 11.0),
        ("sonoweave_readings_total{device=\"tracking\",fate=\"refused\",reason=\"not valid\"}", 2.0),
        ("sonoweave_device_up{device=\"tracking\"}", 0.0),
        ("sonoweave_device_state{device=\"tracking\",state=\"silent\"}", 1.0),
        ("sonoweave_device_up{device=\"grabber\"}", 1.0),
        ("sonoweave_device_last_reading_age_seconds{device=\"grabber\"}", 0.25),
        ("sonoweave_clock_bound_seconds{device=\"tracking\",clock=\"0\"}", 0.002),
        ("sonoweave_capture_to_volume_seconds_bucket{le=\"0.02\"}", 1.0),
        ("sonoweave_capture_to_volume_seconds_bucket{le=\"0.015\"}", 0.0),
        ("sonoweave_recording_disk_left_seconds", 5400.0),
        ("sonoweave_recording_unsynced_seconds", 0.5),
        ("sonoweave_recording_unsynced_max_seconds", 0.75),
        ("sonoweave_recording_lost_messages_total{queue=\"before_writer\",kind=\"frame\"}", 2.0),
        ("sonoweave_scanner_frozen_seconds", 1.5),
    ] {
        assert_eq!(samples.get(name), Some(&value), "{name} in\n{body}");
    }
    assert!(samples["process_cpu_seconds_total"] > 0.0 && samples["process_resident_memory_bytes"] > 1e6);
}

#[test]
fn health_is_ok_while_session_progresses() {
    let latest = session();
    assert_eq!(get_as(&latest, "[::1]:9110", "/healthz").0, StatusCode::OK);
    latest.publish(&eventful(), &["capture-grabber".into()]);
    let (code, _, body) = get_as(&latest, "[::1]:9110", "/healthz");
    assert_eq!((code, body.as_str()), (StatusCode::SERVICE_UNAVAILABLE, "stands still: capture-grabber\n"));
    latest.publish(&eventful(), &[]);
    if let Some(long_ago) = Instant::now().checked_sub(STALE) {
        latest.report.lock().unwrap().at = long_ago;
        assert_eq!(get_as(&latest, "[::1]:9110", "/healthz").0, StatusCode::SERVICE_UNAVAILABLE);
    }
}

#[test]
fn other_hosts_paths_and_methods_are_refused() {
    let latest = session();
    for host in ["example.org", "127.0.0.1.example.org:9110", "192.168.1.7:9110", "0.0.0.0:9110", ""] {
        for path in ["/status", "/metrics", "/healthz", "/other"] {
            let (code, _, body) = get_as(&latest, host, path);
            assert_eq!(code, StatusCode::FORBIDDEN, "{host} {path}");
            assert!(!body.contains("version"), "{body}");
        }
    }
    let plain = |method: &str, uri: &str| Request::builder().method(method).uri(uri);
    let (code, ..) = requested(&latest, plain("GET", "/status").body(Body::empty()).unwrap());
    assert_eq!(code, StatusCode::BAD_REQUEST, "no host at all");
    let proxied = plain("GET", "http://example.org/status").header("host", "localhost").body(Body::empty()).unwrap();
    assert_eq!(requested(&latest, proxied).0, StatusCode::FORBIDDEN);
    let (code, _, body) = get_as(&latest, "localhost", "/elsewhere");
    assert_eq!(code, StatusCode::NOT_FOUND);
    assert!(body.contains("/status"), "{body}");
    for method in ["POST", "PUT", "DELETE", "OPTIONS"] {
        let (code, headers, _) =
            requested(&latest, plain(method, "/status").header("host", "localhost").body(Body::empty()).unwrap());
        assert_eq!(
            (code, &headers["allow"]),
            (StatusCode::METHOD_NOT_ALLOWED, &"GET,HEAD".parse().unwrap()),
            "{method}"
        );
        assert!(!headers.contains_key("access-control-allow-origin"));
    }
}

#[test]
fn page_is_complete_and_restricted_by_policy() {
    let latest = session();
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/page");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap().to_owned();
        if name == "login.html" {
            // It replaces the page if a token is configured.
            continue;
        }
        let place = if name == "index.html" { "/".into() } else { format!("/page/{name}") };
        let (code, headers, body) = get_as(&latest, "127.0.0.1:9110", &place);
        assert_eq!((code, body), (StatusCode::OK, std::fs::read_to_string(&path).unwrap()), "{name}");
        let policy = headers["content-security-policy"].to_str().unwrap();
        assert!(policy.starts_with("default-src 'none'; script-src 'self'; ") && !policy.contains("unsafe"));
        assert_eq!(headers["x-content-type-options"], "nosniff");
        let kind = headers["content-type"].to_str().unwrap();
        let expected = match path.extension().unwrap().to_str().unwrap() {
            "html" => "text/html; charset=utf-8",
            "css" => "text/css; charset=utf-8",
            "js" => "text/javascript; charset=utf-8",
            "svg" => "image/svg+xml",
            other => panic!("{other}"),
        };
        assert_eq!(kind, expected, "{name}");
        count += 1;
    }
    assert!(count >= 4);
    for nothing in ["/page/", "/page/../mod.rs", "/page/%2e%2e%2fmod.rs", "/page/x.js"] {
        assert_eq!(get_as(&latest, "localhost", nothing).0, StatusCode::NOT_FOUND, "{nothing}");
    }
}

#[test]
fn both_documents_state_the_purpose() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/page");
    for name in ["index.html", "login.html"] {
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        assert!(text.contains(&format!(">{}</p>", sonoweave_core::NOTICE)), "{name}");
    }
}

#[test]
fn silent_clients_block_neither_others_nor_shutdown() {
    let latest = session();
    let console = listening((Ipv4Addr::LOCALHOST, 0).into(), &latest).unwrap();
    let address = console.address();
    let again = listening(address, &latest).unwrap_err().to_string();
    assert!(again.contains(&address.to_string()) && again.contains("give another port"), "{again}");
    // One sends nothing, one half a request, one requests and does not read.
    let mut stuck: Vec<TcpStream> = (0..3).map(|_| TcpStream::connect(address).unwrap()).collect();
    stuck[1].write_all(b"GET /status HT").unwrap();
    stuck[2].write_all(b"GET /status HTTP/1.1\r\nhost: localhost\r\n\r\n").unwrap();
    let ask = || {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.write_all(b"GET /healthz HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").unwrap();
        let mut answer = String::new();
        stream.read_to_string(&mut answer).unwrap();
        answer
    };
    for _ in 0..20 {
        let answer = ask();
        assert!(answer.starts_with("HTTP/1.1 200 OK\r\n") && answer.ends_with("\r\n\r\nmoves\n"), "{answer}");
    }
    drop(console);
    assert!(TcpStream::connect(address).is_err(), "nobody listens any more");
}
