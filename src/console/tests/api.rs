//! What programs ask for and wish.

use std::sync::atomic::Ordering;

use super::*;
use crate::pipeline::live::{Glimpsed, Witness as _};
use crate::render::camera::View;
use crate::slice::{Image, Pixels};

fn say(served: &Served, wish: &str) -> (StatusCode, serde_json::Value) {
    let request = Request::post("/v1/do").header("host", "localhost").body(Body::from(wish.to_owned())).unwrap();
    let (status, _, body) = answered(served.clone(), request);
    (status, serde_json::from_str(&body).unwrap_or_else(|_| serde_json::json!(body)))
}

#[test]
fn programs_may_wish_what_pages_may_and_are_told_the_same() {
    let served = served(&session());
    let desk = Arc::clone(&served.shown.desk);
    desk.runs(false, String::new());
    let (status, said) = say(&served, "{\"do\":\"freeze\",\"on\":true}");
    assert_eq!((status, desk.told().frozen), (StatusCode::OK, true), "{said}");
    assert!(said["done"].as_str().unwrap().starts_with("frozen"));
    let (status, said) = say(&served, "{\"do\":\"record\"}");
    assert_eq!(status, StatusCode::CONFLICT);
    assert!(said["refused"].as_str().unwrap().contains("--keep DIR"));
    for wish in ["{\"do\":\"explode\"}", "nonsense", "{\"do\":\"control\"}"] {
        let (status, said) = say(&served, wish);
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{wish}: {said}");
        assert!(said["refused"].is_string());
    }
    let (status, said) = say(&served, "{\"do\":\"look\",\"from\":\"above\"}");
    assert_eq!(status, StatusCode::OK, "{said}");
    assert_eq!(served.shown.screen.view(View::default()).elevation, 90.0);
    // Another site's page may not even ask.
    let foreign = Request::post("/v1/do").header("host", "localhost:1").header("origin", "https://example.org");
    let (status, _, _) = answered(served.clone(), foreign.body(Body::from("{\"do\":\"clear\"}")).unwrap());
    assert_eq!((status, desk.orders().len()), (StatusCode::FORBIDDEN, 1), "the freeze, and nothing else");
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
    let (status, _, said) = get("/v1/pictures/view.png");
    assert_eq!(status, StatusCode::NOT_FOUND, "{said}");
    let (status, _, said) = get("/v1/pictures/passwords.png");
    assert_eq!(status, StatusCode::NOT_FOUND, "{said}");
}

#[test]
fn a_picture_is_had_as_png_and_was_made_for_who_asked() {
    let served = served(&session());
    let screen = Arc::clone(&served.shown.screen);
    let image = Image::new(3, 2, Pixels::U8(vec![0, 50, 100, 150, 200, 250].into()));
    let glimpsed = Glimpsed { item: 7, captured_ns: 0, image: &image };
    screen.glimpsed(&glimpsed);
    assert_eq!(screen.made(screen::Kind::Slice), 0, "nobody looks");
    let shows = std::thread::spawn({
        let screen = Arc::clone(&screen);
        move || {
            while screen.made(screen::Kind::Slice) == 0 {
                screen.glimpsed(&Glimpsed { item: 7, captured_ns: 0, image: &image });
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    });
    let asked = Request::get("/v1/pictures/slice.png").header("host", "localhost").body(Body::empty()).unwrap();
    let (status, headers, bytes) = bytes_of(served.clone(), asked);
    shows.join().unwrap();
    assert_eq!((status, &headers["content-type"]), (StatusCode::OK, &"image/png".parse().unwrap()));
    let picture = image::load_from_memory(&bytes).unwrap().into_luma8();
    assert_eq!((picture.dimensions(), picture.get_pixel(1, 1).0), ((3, 2), [200]));
    let made = screen.made(screen::Kind::Slice);
    screen.glimpsed(&Glimpsed { item: 8, captured_ns: 0, image: &Image::new(1, 1, Pixels::U8(vec![1].into())) });
    assert_eq!(screen.made(screen::Kind::Slice), made, "who asked looks no longer");
}

#[test]
fn what_is_seen_is_kept_in_files_of_the_next_free_number() {
    let place = tempfile::tempdir().unwrap();
    let mut served = served(&session());
    served.shown.desk = Arc::new(Desk::new(Some(place.path().to_owned())));
    served.shown.desk.runs(false, String::new());
    let (status, said) = say(&served, "{\"do\":\"snapshot\"}");
    assert_eq!(status, StatusCode::CONFLICT, "{said}");
    let screen = &served.shown.screen;
    let glance = screen.glance(screen::Kind::Slice);
    screen.glimpsed(&Glimpsed { item: 7, captured_ns: 0, image: &Image::new(2, 1, Pixels::U8(vec![9, 99].into())) });
    drop(glance);
    for number in 1..=2 {
        let (status, said) = say(&served, "{\"do\":\"snapshot\"}");
        assert_eq!(status, StatusCode::OK, "{said}");
        let began = Instant::now();
        while served.shown.desk.told().events.len() < number {
            assert!(began.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(1));
        }
        let path = place.path().join(format!("snapshot-{number:03}-scanner.png"));
        assert_eq!(image::open(path).unwrap().into_rgb8().get_pixel(1, 0).0, [99; 3]);
        // The next is taken as soon as this one is written.
        while served.snapping.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
    }
}

#[test]
fn the_description_has_every_path_and_every_wish() {
    let served = served(&session());
    let asked = Request::get("/v1/openapi.json").header("host", "localhost").body(Body::empty()).unwrap();
    let (_, _, text) = answered(served.clone(), asked);
    let described: serde_json::Value = serde_json::from_str(&text).unwrap();
    let routes = include_str!("../mod.rs").split(".route(\"").skip(1).filter_map(|rest| rest.split('"').next());
    for path in routes.filter(|path| !path.starts_with("/page/") && *path != "/") {
        let listed = match path.split_once("{name}") {
            Some((before, _)) => described["paths"].as_object().unwrap().keys().any(|key| key.starts_with(before)),
            None => described["paths"][path].is_object(),
        };
        assert!(listed, "{path}");
    }
    let wishes = described["components"]["schemas"]["Wish"]["oneOf"].as_array().unwrap();
    let mut words: Vec<&str> = wishes.iter().map(|wish| wish["properties"]["do"]["const"].as_str().unwrap()).collect();
    words.sort_unstable();
    let why = wish::Wish::parse("{\"do\":\"?\"}").unwrap_err();
    let mut known: Vec<&str> = why.split('`').skip(3).step_by(2).collect();
    known.retain(|word| !["show", "shown", "control"].contains(word));
    known.sort_unstable();
    assert_eq!(words, known, "{why}");
    // What is described is understood: each wish, with an example of each of its values.
    for wish in wishes {
        let value = |(key, what): (&String, &serde_json::Value)| {
            let value = match key.as_str() {
                "at" => serde_json::json!(vec![0.5; what["maxItems"].as_u64().unwrap() as usize]),
                "points" => serde_json::json!([[0, 0], [255, 1]]),
                "preset" => serde_json::json!("tissue"),
                "settings" => serde_json::json!({ "volume.spacing_mm": 1 }),
                "number" => serde_json::json!(1),
                _ => what.get("const").or_else(|| what["enum"].get(0)).cloned().unwrap_or_else(|| {
                    if what["type"] == "boolean" { serde_json::json!(true) } else { serde_json::json!(0.5) }
                }),
            };
            (key.clone(), value)
        };
        let example: serde_json::Map<_, _> = wish["properties"].as_object().unwrap().iter().map(value).collect();
        let text = serde_json::Value::Object(example).to_string();
        assert!(wish::Wish::parse(&text).is_ok(), "{text}");
    }
}

#[test]
fn lengths_and_the_slices_of_a_place_are_had_over_http() {
    let served = served(&session());
    let post = |path: &str, body: &str| {
        let request = Request::post(path).header("host", "localhost").body(Body::from(body.to_owned())).unwrap();
        let (status, _, text) = answered(served.clone(), request);
        (status, serde_json::from_str::<serde_json::Value>(&text).unwrap())
    };
    let (status, said) = post("/v1/measure", "{\"kind\":\"distance\",\"points\":[[0,0,0],[3,4,0]],\"pixel_mm\":0.3}");
    assert_eq!((status, &said["value"], &said["unit"]), (StatusCode::OK, &5.0.into(), &"mm".into()), "{said}");
    for (path, body, says) in [
        ("/v1/measure", "{\"kind\":\"weight\"}", "nothing to be measured"),
        ("/v1/measure", "{\"kind\":\"distance\",\"points\":[[0,0,0]]}", "two points"),
        ("/v1/slices", "{\"at\":[0,0]}", "no place of the world"),
        ("/v1/slices", "{\"at\":[0,0,0]}", "pixels' size"),
    ] {
        let (status, said) = post(path, body);
        assert_eq!(status, StatusCode::UNPROCESSABLE_ENTITY, "{said}");
        assert!(said["refused"].as_str().unwrap().contains(says), "{said}");
    }
}
