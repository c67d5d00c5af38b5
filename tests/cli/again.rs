//! A recorded session that is shown: replayed with other settings over HTTP, frame by frame, and
//! its outputs.

use serde_json::{Value, json};

use super::commands::{account, done, post_command, until};
use super::daemon::{SMALL, Session, ask};
use super::place::Place;

/// File of a session of some seconds.
const RECORDING: &str = "s.mcap";

fn recorded(place: &Place) {
    place.put("b.toml", SMALL);
    let run = place.run("live --config b.toml --record rec --duration 4 -o live.mha --headless");
    assert_eq!(run.code, 0, "{}", run.stderr);
    let mut names = std::fs::read_dir(place.path("rec")).unwrap().map(|entry| entry.unwrap().path());
    std::fs::rename(names.next().unwrap(), place.path(RECORDING)).unwrap();
    std::fs::remove_dir(place.path("rec")).unwrap();
}

/// Returns the session configuration with coarser voxels and another latency.
fn other() -> String {
    SMALL.replace("spacing_mm = 1.0", "spacing_mm = 3.0").replace("[volume]", "latency_ms = 120\n[volume]")
}

/// Waits for the end of a replay with these settings.
fn over(session: &Session, address: &str, tried: &Value) -> Value {
    until(session, address, "the end of a run", |account| {
        account["desk"]["phase"] == "over" && account["desk"]["replayed"]["tried"] == *tried
    })
}

#[test]
fn replay_with_other_settings_equals_their_result() {
    let place = Place::new();
    recorded(&place);
    // Other settings, in a separate file.
    place.put("coarse.toml", other());
    assert_ne!(place.get("coarse.toml"), place.get("b.toml"));
    place.does(&format!("replay {RECORDING} --config coarse.toml -o coarse.mha"));
    place.put("prompt.toml", other().replace("latency_ms = 120\n", ""));
    place.does(&format!("replay {RECORDING} --config prompt.toml -o prompt.mha"));
    assert!(place.volume("prompt.mha").values != place.volume("coarse.mha").values, "a latency is seen");
    let mut session = Session::at(place, &format!("replay {RECORDING} -o last.mha --console 127.0.0.1:0"), &[]);
    let address = session.address();
    let first = over(&session, &address, &json!({}));
    let events = first["desk"]["events"].as_array().unwrap();
    assert!(events[0]["says"].as_str().unwrap().contains("with the same outcome"), "{first}");
    let (code, settings) = ask(&address, &address, "/v1/settings");
    assert!(code == 200 && settings.contains("\"volume.spacing_mm\""), "{settings}");
    // Frames in any order; none outside the recording.
    let frames = first["desk"]["replayed"]["frames"].as_u64().unwrap();
    assert_eq!(frames, first["frames"].as_u64().unwrap());
    for number in [frames, 1, frames / 2] {
        done(&address, &json!({ "do": "frame", "number": number }));
        let seen = until(&session, &address, "a frame", |a| a["desk"]["replayed"]["seen"]["number"] == number);
        assert!(seen["desk"]["replayed"]["seen"]["time_s"].as_f64().unwrap() < 10.0);
    }
    for (what, says) in [
        (json!({ "do": "frame", "number": 0 }), "there is no frame 0; give one from 1 to"),
        (json!({ "do": "frame", "number": frames + 1 }), "there is no frame"),
        (json!({ "do": "again", "settings": { "volume.spacing_mm": 0 } }), "volume.spacing_mm: must be positive"),
        (json!({ "do": "again", "settings": { "record.folder": "/tmp" } }), "record.folder: cannot be changed"),
        (
            json!({ "do": "again", "settings": { "calibration.file": "/etc/passwd" } }),
            "there is no file \"/etc/passwd\"",
        ),
        (json!({ "do": "record" }), "this session is a recording"),
        (json!({ "do": "clear" }), "this session is a recording"),
        (json!({ "do": "save" }), "no folder to save in"),
    ] {
        let (code, answer) = post_command(&address, &what);
        assert!(code == 409 && answer["refused"].as_str().unwrap().contains(says), "{what}: {code} {answer}");
    }
    assert_eq!(account(&address)["desk"]["replayed"]["tried"], json!({}), "nothing has changed");
    // Settings that permit no insertion are reported, and the recording is unchanged.
    done(&address, &json!({ "do": "again", "settings": { "volume.spacing_mm": 3 } }));
    let coarse = over(&session, &address, &json!({ "volume.spacing_mm": 3 }));
    assert_eq!(coarse["slices"], first["slices"]);
    done(&address, &json!({ "do": "again" }));
    assert_eq!(over(&session, &address, &json!({}))["volume"], first["volume"]);
    done(&address, &json!({ "do": "again", "settings": { "volume.spacing_mm": 3.0, "grabber.latency_ms": 120 } }));
    over(&session, &address, &json!({ "volume.spacing_mm": 3.0, "grabber.latency_ms": 120 }));
    assert_eq!(session.ends("-INT"), 0, "{}", session.log());
    let log = session.log();
    assert!(!log.contains("stands still"), "{log}");
    // The last result is saved, and equals that of its settings.
    let [last, coarse] = ["last.mha", "coarse.mha"].map(|name| session.place.volume(name));
    assert!(last.values == coarse.values && last.header.origin == coarse.header.origin);
    assert_ne!(last.header.size, session.place.volume("live.mha").header.size);
}

#[test]
fn live_session_refuses_replay_and_frame_commands() {
    let mut session = Session::begin("", &[]);
    let address = session.address();
    for what in [json!({ "do": "again" }), json!({ "do": "frame", "number": 1 })] {
        let (code, answer) = post_command(&address, &what);
        assert!(code == 409 && answer["refused"].as_str().unwrap().contains("this session is live"), "{answer}");
    }
    assert_eq!(ask(&address, &address, "/v1/settings").0, 404);
    assert_eq!(session.ends("-TERM"), 0, "{}", session.log());
}

#[test]
fn unsuitable_input_is_refused() {
    let place = Place::new();
    recorded(&place);
    place.does("phantom -o s.mha --frames 6 --image-size 40x30 --pixel 0.5 --gap 0.6");
    place.refuses("replay s.mha --console 127.0.0.1:0", &["s.mha: is not a session", "`sonoweave animate`"]);
    place.refuses(&format!("animate {RECORDING} --picture p.png"), &["is a session", "`sonoweave replay`"]);
    place.refuses(
        &format!("replay {RECORDING} --pictures . --console 127.0.0.1:0"),
        &["--pictures: cannot be combined with --console", "leave one of them out"],
    );
    place.refuses(&format!("replay {RECORDING} --console 0.0.0.0:0"), &["certificate", "token_file"]);
    let run = place.run(&format!("replay {RECORDING} --keep kept"));
    assert!(run.code == 2 && run.stderr.contains("--console"), "{}", run.stderr);
}
