//! The metrics of a session among many: their labels, and the number of their series.

use sonoweave_core::date::Date;
use sonoweave_core::ledger::Queue;
use statistics::IgtlNumbers;

use super::*;
use crate::latest::Identity;

/// Largest number of a session's time series: 1000 bedsides are one server.
const MOST_SERIES: usize = 300;

/// Labels of all metrics.
const LABELS: [&str; 13] = [
    "version",
    "session",
    "configuration",
    "calibration",
    "owner",
    "fate",
    "reason",
    "device",
    "state",
    "clock",
    "le",
    "queue",
    "kind",
];

/// Names that no metric may have.
const PRIVATE: [&str; 3] = ["doe", "Miller", "/data"];

/// A session of Jane Doe by Dr Miller: everything that can have a series has one, and whatever may
/// be a text holds a name.
fn private() -> Arc<Latest> {
    let mut account = eventful();
    for reason in Reason::ALL {
        account.ledger.arrived();
        account.ledger.refused(&Refusal::new(1, reason, "doe-jane"));
    }
    for queue in Queue::ALL {
        account.ledger.arrived();
        account.ledger.dropped(queue);
    }
    let readings = &mut account.ledger.readings[0];
    readings.refused = ["not valid", "no such station", "out of range", "too late"].map(|why| (why, 1)).into();
    readings.total += 2;
    for device in &mut account.devices {
        device.clocks = vec![device.clocks[0]; 4];
        device.why = "doe-jane".into();
    }
    for text in [&mut account.path_reason, &mut account.world, &mut account.route] {
        *text = "doe-jane".into();
    }
    account.notes = vec!["of Dr Miller".into()];
    account.recording.as_mut().unwrap().path = "/data/doe-jane/SESSION.mcap".into();
    account.recording.as_mut().unwrap().trouble = "/data/doe-jane is full".into();
    let text = |text: &str| serde_json::json!(text);
    let config = [("record.folder", text("/data/doe-jane")), ("calibration.file", text("/data/miller/Miller.toml"))];
    let identity = Identity {
        session: "6f1c7b2a9d04".into(),
        configuration: "0b9e5d1f3c7a".into(),
        calibration: "c4d8e2a6b0f1".into(),
    };
    let latest = Latest::new(Basis {
        config: Effective::from(config.map(|(key, value)| (key.to_owned(), value))),
        about: About { name: "doe-jane.toml".into(), ..About::default() },
        identity,
        calibrated: Date::parse("2026-01-02"),
        ..Basis::default()
    });
    latest.publish(&account, &["capture-doe".into()]);
    latest.publish_igtl(IgtlNumbers::default());
    Arc::new(latest)
}

/// Label names and values of a sample.
fn labels(sample: &str) -> Vec<(&str, &str)> {
    let Some((_, inner)) = sample.strip_suffix("\"}").and_then(|sample| sample.split_once('{')) else {
        return Vec::new();
    };
    inner.split("\",").map(|pair| pair.split_once("=\"").unwrap()).collect()
}

#[test]
fn metrics_name_neither_people_nor_folders() {
    let latest = private();
    let (_, _, status) = get_as(&latest, "localhost", "/status");
    assert!(PRIVATE.iter().all(|name| status.contains(name)), "the planted names are there: {status}");
    let (_, _, text) = get_as(&latest, "localhost", "/metrics");
    let samples = parsed(&text);
    for name in PRIVATE {
        assert!(!text.contains(name), "{name} in\n{text}");
    }
    for (label, value) in samples.keys().flat_map(|sample| labels(sample)) {
        assert!(LABELS.contains(&label), "{label}=\"{value}\" is a new label; enter it if it names nobody");
    }
    let version = env!("CARGO_PKG_VERSION");
    let info = format!(
        "sonoweave_session_info{{session=\"6f1c7b2a9d04\",configuration=\"0b9e5d1f3c7a\",\
         calibration=\"c4d8e2a6b0f1\",version=\"{version}\"}}"
    );
    assert_eq!(samples[&info], 1.0);
}

#[test]
fn session_in_which_all_happened_has_few_series() {
    let (_, _, text) = get_as(&private(), "localhost", "/metrics");
    let count = parsed(&text).len();
    assert!((180..=MOST_SERIES).contains(&count), "{count} series:\n{text}");
}

#[test]
fn alerts_find_age_recording_frames_and_disk() {
    let samples = |latest: &Arc<Latest>| parsed(&get_as(latest, "localhost", "/metrics").2);
    let of = private();
    let found = samples(&of);
    let days = Date::today().days_since(Date::parse("2026-01-02").unwrap());
    assert_eq!(found["sonoweave_calibration_age_seconds"], days as f64 * 86_400.0);
    assert_eq!((found["sonoweave_recording_active"], found["sonoweave_recording_disk_free_bytes"]), (0.0, 6e9));
    // Drops are counted from the begin, so that the first one changes a rate.
    let fresh = samples(&Arc::new(Latest::default()));
    for queue in ["pairing", "insertion"] {
        assert_eq!(fresh[&format!("sonoweave_frames_total{{fate=\"dropped\",reason=\"{queue}\"}}")], 0.0);
    }
    assert!(!fresh.contains_key("sonoweave_calibration_age_seconds"), "its day is unknown");
    let served = served(&of);
    served.session.controller.runs(true, "a recording".into());
    let request = Request::get("/metrics").header("host", "localhost").body(Body::empty()).unwrap();
    assert_eq!(parsed(&answered(served, request).2)["sonoweave_recording_active"], 1.0);
}

#[test]
fn age_of_last_frame_grows_without_reports() {
    let age = |latest: &Arc<Latest>| {
        let (_, _, text) = get_as(latest, "localhost", "/metrics");
        parsed(&text)["sonoweave_frame_age_seconds"]
    };
    let latest = session();
    let status = SessionStatus { last_frame_s_ago: Some(100.0), ..eventful() };
    latest.publish(&status, &[]);
    let before = age(&latest);
    assert!((100.0..160.0).contains(&before), "{before}");
    let half_a_minute = Duration::from_secs(30);
    latest.report.lock().unwrap().at = Instant::now().checked_sub(half_a_minute).expect("a machine that runs longer");
    assert!(age(&latest) >= 130.0, "the session no longer reports");
    latest.publish(&SessionStatus::default(), &[]);
    assert!(age(&latest) < 100.0, "no frame yet: the time since the begin");
}
