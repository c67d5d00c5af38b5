//! Requests and commands of programs.

use std::sync::atomic::Ordering;

use mask::{Mask, MaskFound, MaskShape};
use pipeline::command::{Command, MaskChange};
use pipeline::{CapturedFrame, MaskOrigin, MaskStatus, Observer as _};
use render::camera::View;
use sonoweave_core::slice::{Image, Pixels};

use super::*;

fn say(served: &Served, message: &str) -> (StatusCode, serde_json::Value) {
    let request = Request::post("/v1/do").header("host", "localhost").body(Body::from(message.to_owned())).unwrap();
    let (status, _, body) = answered(served.clone(), request);
    (status, serde_json::from_str(&body).unwrap_or_else(|_| serde_json::json!(body)))
}

#[test]
fn programs_send_same_commands_as_pages() {
    let served = served(&session());
    let controller = Arc::clone(&served.session.controller);
    controller.runs(false, String::new());
    let (status, sentence) = say(&served, "{\"do\":\"freeze\",\"on\":true}");
    assert_eq!((status, controller.status().frozen), (StatusCode::OK, true), "{sentence}");
    assert!(sentence["done"].as_str().unwrap().starts_with("frozen"));
    let (status, sentence) = say(&served, "{\"do\":\"record\"}");
    assert_eq!(status, StatusCode::CONFLICT);
    assert!(sentence["refused"].as_str().unwrap().contains("no folder to save in"));
    for message in ["{\"do\":\"explode\"}", "nonsense", "{\"do\":\"control\"}"] {
        let (status, sentence) = say(&served, message);
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{message}: {sentence}");
        assert!(sentence["refused"].is_string());
    }
    let (status, sentence) = say(&served, "{\"do\":\"look\",\"from\":\"above\"}");
    assert_eq!(status, StatusCode::OK, "{sentence}");
    assert_eq!(served.session.broadcaster.view(View::default()).elevation, 90.0);
    // Another site's page is refused.
    let foreign = Request::post("/v1/do").header("host", "localhost:1").header("origin", "https://example.org");
    let (status, _, _) = answered(served.clone(), foreign.body(Body::from("{\"do\":\"clear\"}")).unwrap());
    assert_eq!((status, controller.commands().len()), (StatusCode::FORBIDDEN, 1), "the freeze, and nothing else");
    let get = |path: &str| {
        answered(served.clone(), Request::get(path).header("host", "localhost").body(Body::empty()).unwrap())
    };
    let (status, _, account) = get("/v1/account");
    let account: serde_json::Value = serde_json::from_str(&account).unwrap();
    assert_eq!(status, StatusCode::OK);
    assert_eq!((&account["slices"], &account["desk"]["frozen"]), (&serde_json::json!(5), &serde_json::json!(true)));
    assert!(account.get("rates").is_none());
    let (_, _, about) = get("/v1/about");
    assert_eq!(serde_json::from_str::<serde_json::Value>(&about).unwrap()["version"], env!("CARGO_PKG_VERSION"));
    let (status, _, sentence) = get("/v1/pictures/view.png");
    assert_eq!(status, StatusCode::NOT_FOUND, "{sentence}");
    let (status, _, sentence) = get("/v1/pictures/passwords.png");
    assert_eq!(status, StatusCode::NOT_FOUND, "{sentence}");
}

#[test]
fn mask_command_is_refused_with_sentence_or_accepted() {
    let served = served(&session());
    let controller = Arc::clone(&served.session.controller);
    controller.runs(false, String::new());
    let fan = |radii: &str| {
        let fan = format!("{{\"origin_px\":[32,-9],\"radii_px\":{radii},\"angles_deg\":[-30,30]}}");
        say(&served, &format!("{{\"do\":\"mask\",\"as\":{{\"fan\":{fan}}}}}"))
    };
    let (status, sentence) = fan("[9,50]");
    assert_eq!(status, StatusCode::CONFLICT);
    assert!(sentence["refused"].as_str().unwrap().contains("still being searched for"), "{sentence}");
    let found = MaskFound::certain(Mask::full(64, 48), MaskShape::Whole);
    let mask = Some(MaskStatus::new(found, MaskOrigin::Found, None));
    controller.update(&SessionStatus { mask, ..SessionStatus::default() });
    for (radii, expected) in [("[50,9]", "radii must grow"), ("[900,901]", "leaves nothing of the 64×48 picture")] {
        let (status, sentence) = fan(radii);
        assert_eq!(status, StatusCode::CONFLICT, "{sentence}");
        assert!(sentence["refused"].as_str().unwrap().contains(expected), "{sentence}");
    }
    let (status, _) = fan("[1e999,50]");
    assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "no number");
    assert!(controller.commands().is_empty());
    let (status, sentence) = fan("[9,50]");
    assert_eq!(status, StatusCode::OK, "{sentence}");
    assert!(matches!(controller.commands()[..], [Command::Mask(MaskChange::Fan(_))]));
}

#[test]
fn picture_request_renders_and_returns_png() {
    let served = served(&session());
    let broadcaster = Arc::clone(&served.session.broadcaster);
    let image = Image::new(3, 2, Pixels::U8(vec![0, 50, 100, 150, 200, 250].into()));
    let glimpsed = CapturedFrame { item: 7, captured_ns: 0, image: &image };
    broadcaster.captured(&glimpsed);
    assert_eq!(broadcaster.made(Kind::Slice), 0, "nobody looks");
    let shows = std::thread::spawn({
        let broadcaster = Arc::clone(&broadcaster);
        move || {
            while broadcaster.made(Kind::Slice) == 0 {
                broadcaster.captured(&CapturedFrame { item: 7, captured_ns: 0, image: &image });
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    });
    let requested = Request::get("/v1/pictures/slice.png").header("host", "localhost").body(Body::empty()).unwrap();
    let (status, headers, bytes) = bytes_of(served.clone(), requested);
    shows.join().unwrap();
    assert_eq!((status, &headers["content-type"]), (StatusCode::OK, &"image/png".parse().unwrap()));
    let picture = image::load_from_memory(&bytes).unwrap().into_luma8();
    assert_eq!((picture.dimensions(), picture.get_pixel(1, 1).0), ((3, 2), [200]));
    let made = broadcaster.made(Kind::Slice);
    broadcaster.captured(&CapturedFrame {
        item: 8,
        captured_ns: 0,
        image: &Image::new(1, 1, Pixels::U8(vec![1].into())),
    });
    assert_eq!(broadcaster.made(Kind::Slice), made, "who asked looks no longer");
}

#[test]
fn snapshot_writes_files_with_next_free_number() {
    let place = tempfile::tempdir().unwrap();
    let mut served = served(&session());
    served.session.controller = Arc::new(SessionController::new(Some(place.path().to_owned())));
    served.session.controller.runs(false, String::new());
    let (status, sentence) = say(&served, "{\"do\":\"snapshot\"}");
    assert_eq!(status, StatusCode::CONFLICT, "{sentence}");
    let broadcaster = &served.session.broadcaster;
    let subscribe_briefly = broadcaster.subscribe_briefly(Kind::Slice);
    broadcaster.captured(&CapturedFrame {
        item: 7,
        captured_ns: 0,
        image: &Image::new(2, 1, Pixels::U8(vec![9, 99].into())),
    });
    drop(subscribe_briefly);
    for number in 1..=2 {
        let (status, sentence) = say(&served, "{\"do\":\"snapshot\"}");
        assert_eq!(status, StatusCode::OK, "{sentence}");
        let began = Instant::now();
        while served.session.controller.status().events.len() < number {
            assert!(began.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(1));
        }
        let path = place.path().join(format!("snapshot-{number:03}-scanner.png"));
        assert_eq!(image::open(path).unwrap().into_rgb8().get_pixel(1, 0).0, [99; 3]);
        // The next snapshot starts only after this one is written.
        while served.snapping.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

#[test]
fn openapi_describes_every_path_and_command() {
    let served = served(&session());
    let requested = Request::get("/v1/openapi.json").header("host", "localhost").body(Body::empty()).unwrap();
    let (_, _, text) = answered(served.clone(), requested);
    let described: serde_json::Value = serde_json::from_str(&text).unwrap();
    let routes = include_str!("../lib.rs").split(".route(\"").skip(1).filter_map(|rest| rest.split('"').next());
    for path in routes.filter(|path| !path.starts_with("/page/") && *path != "/") {
        let listed = match path.split_once("{name}") {
            Some((before, _)) => described["paths"].as_object().unwrap().keys().any(|key| key.starts_with(before)),
            None => described["paths"][path].is_object(),
        };
        assert!(listed, "{path}");
    }
    let messages = described["components"]["schemas"]["Message"]["oneOf"].as_array().unwrap();
    let mut words: Vec<&str> =
        messages.iter().map(|message| message["properties"]["do"]["const"].as_str().unwrap()).collect();
    words.sort_unstable();
    let why = message::ClientMessage::parse("{\"do\":\"?\"}").unwrap_err().to_string();
    let mut known: Vec<&str> = why.split('`').skip(3).step_by(2).collect();
    known.retain(|word| !["show", "shown", "control"].contains(word));
    known.sort_unstable();
    assert_eq!(words, known, "{why}");
    // The server accepts each described command, with an example of each of its values.
    for described in messages {
        let value = |(key, what): (&String, &serde_json::Value)| {
            let value = match key.as_str() {
                "at" => serde_json::json!(vec![0.5; what["maxItems"].as_u64().unwrap() as usize]),
                "points" => serde_json::json!([[0, 0], [255, 1]]),
                "as" | "by" if what["oneOf"].is_array() => what["oneOf"][0]["enum"][0].clone(),
                "preset" => serde_json::json!("tissue"),
                "settings" => serde_json::json!({ "volume.spacing_mm": 1 }),
                "number" | "correction" => serde_json::json!(1),
                _ => what.get("const").or_else(|| what["enum"].get(0)).cloned().unwrap_or_else(|| {
                    if what["type"] == "boolean" { serde_json::json!(true) } else { serde_json::json!(0.5) }
                }),
            };
            (key.clone(), value)
        };
        let example: serde_json::Map<_, _> = described["properties"].as_object().unwrap().iter().map(value).collect();
        let text = serde_json::Value::Object(example).to_string();
        assert!(message::ClientMessage::parse(&text).is_ok(), "{text}");
    }
}

#[test]
fn http_returns_measurements_and_slices_of_a_place() {
    let served = served(&session());
    let post = |path: &str, body: &str| {
        let request = Request::post(path).header("host", "localhost").body(Body::from(body.to_owned())).unwrap();
        let (status, _, text) = answered(served.clone(), request);
        (status, serde_json::from_str::<serde_json::Value>(&text).unwrap())
    };
    let (status, sentence) =
        post("/v1/measure", "{\"kind\":\"distance\",\"points\":[[0,0,0],[3,4,0]],\"pixel_mm\":0.3}");
    assert_eq!(
        (status, &sentence["value"], &sentence["unit"]),
        (StatusCode::OK, &5.0.into(), &"mm".into()),
        "{sentence}"
    );
    for (path, body, expected) in [
        ("/v1/measure", "{\"kind\":\"weight\"}", "this measurement is invalid"),
        ("/v1/measure", "{\"kind\":\"distance\",\"points\":[[0,0,0]]}", "two points"),
        ("/v1/slices", "{\"at\":[0,0]}", "not a point of the world"),
        ("/v1/slices", "{\"at\":[0,0,0]}", "no pixel size"),
    ] {
        let (status, sentence) = post(path, body);
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{sentence}");
        assert!(sentence["refused"].as_str().unwrap().contains(expected), "{sentence}");
    }
}
