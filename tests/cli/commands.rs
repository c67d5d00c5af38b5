//! HTTP commands to a session, as sent by its page: freeze, clear, save, stop, view and record
//! again.

use serde_json::{Value, json};

use super::daemon::{Session, ask, request};

pub(super) fn post_command(address: &str, command: &Value) -> (u16, Value) {
    let body = command.to_string();
    let head = format!("POST /v1/do HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n");
    let head = format!("{head}Content-Type: application/json\r\nContent-Length: {}\r\n\r\n", body.len());
    let (code, answer) = request(address, &(head + &body));
    (code, serde_json::from_str(&answer).unwrap_or_else(|_| json!(answer)))
}

pub(super) fn done(address: &str, what: &Value) {
    let (code, answer) = post_command(address, what);
    assert_eq!(code, 200, "{what}: {answer}");
}

pub(super) fn account(address: &str) -> Value {
    let (code, body) = ask(address, address, "/v1/account");
    assert_eq!(code, 200, "{body}");
    serde_json::from_str(&body).unwrap()
}

/// Waits until the status meets a condition.
pub(super) fn until(session: &Session, address: &str, what: &str, is: impl Fn(&Value) -> bool) -> Value {
    session.waits_for(what, || Some(account(address)).filter(&is))
}

fn slices(account: &Value) -> u64 {
    account["volume"]["slices"].as_u64().unwrap_or(0)
}

#[test]
fn session_is_stopped_viewed_recorded_again_and_replayed() {
    let mut session = Session::begin("--keep kept -o v.mha --picture p.png", &[]);
    let address = session.address();
    until(&session, &address, "slices", |account| slices(account) > 10);
    done(&address, &json!({ "do": "freeze", "on": true }));
    let frozen = until(&session, &address, "frozen frames", |a| a["refused"]["frozen"].as_u64() > Some(3));
    assert_eq!((&frozen["frozen"], &frozen["desk"]["frozen"]), (&true.into(), &true.into()));
    let held = slices(&account(&address));
    done(&address, &json!({ "do": "clear" }));
    until(&session, &address, "an empty volume", |account| account["volume"].is_null());
    assert!(held > 10);
    done(&address, &json!({ "do": "freeze", "on": false }));
    until(&session, &address, "slices again", |account| slices(account) > 5);
    // It is not recorded: it ends, and its volume is viewed and saved.
    done(&address, &json!({ "do": "stop" }));
    let over = until(&session, &address, "the end", |account| account["desk"]["phase"] == "over");
    let (count, had) = (slices(&over), over["recording"].clone());
    assert!(count > 5 && had.is_null(), "{over}");
    assert_eq!(post_command(&address, &json!({ "do": "clear" })).0, 409);
    done(&address, &json!({ "do": "save" }));
    let saved = until(&session, &address, "a saved volume", |account| {
        account["desk"]["events"].as_array().unwrap().iter().any(|event| event["how"] == "done")
    });
    assert!(saved["desk"]["saving"].is_null() && slices(&saved) == count);
    let first = std::fs::read(session.place.path("kept/volume-001.mha")).unwrap();
    let head = String::from_utf8_lossy(&first[..1000]).into_owned();
    assert!(head.contains(&format!("SonoweaveFrames = {count} so far")), "{head}");
    session
        .place
        .does("render kept/volume-001.mha --weights kept/volume-001-weights.mha -o again.png --image-size 64x64");
    // The next session is recorded from its first slice on.
    done(&address, &json!({ "do": "record" }));
    until(&session, &address, "a recording", |a| a["desk"]["records"] == true && slices(a) > 10);
    assert_eq!(post_command(&address, &json!({ "do": "record" })).0, 409);
    done(&address, &json!({ "do": "clear" }));
    done(&address, &json!({ "do": "stop" }));
    until(&session, &address, "the end of the recording", |account| account["desk"]["phase"] == "over");
    let recorded: Vec<_> = std::fs::read_dir(session.place.path("kept"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| name.ends_with(".mcap"))
        .collect();
    let [recording] = &recorded[..] else { panic!("{recorded:?}") };
    assert_eq!(session.ends("-TERM"), 0, "{}", session.log());
    // The replay gives the same result, with the same clearing in the middle.
    let ran = session.place.run(&format!("replay kept/{recording} --picture q.png"));
    assert_eq!(ran.code, 0, "{}", ran.stderr);
    assert!(ran.stderr.contains("the volume is the same as in the live session, bit by bit"), "{}", ran.stderr);
}

#[test]
fn save_commands_without_folder_are_refused_harmlessly() {
    let mut session = Session::begin("", &[]);
    let address = session.address();
    until(&session, &address, "slices", |account| slices(account) > 3);
    for command in ["record", "save", "snapshot"] {
        let (code, answer) = post_command(&address, &json!({ "do": command }));
        assert_eq!(code, 409, "{answer}");
        assert!(answer["refused"].as_str().unwrap().contains("no folder to save in"), "{answer}");
    }
    let (code, answer) = post_command(&address, &json!({ "do": "save", "to": "/etc/passwd" }));
    assert_eq!(code, 422, "{answer}");
    let before = slices(&account(&address));
    until(&session, &address, "more slices", |account| slices(account) > before);
    assert_eq!(session.ends("-TERM"), 0, "{}", session.log());
}
