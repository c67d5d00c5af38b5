//! Picking in the volume's picture: hits, misses, and cost.

use std::sync::atomic::AtomicBool;

use glam::{DAffine3, DVec3};

use render::classify::transfer::Transfer;
use render::{Mode, RenderRegion, RenderSettings, Renderer};
use sonoweave_core::frames::Transform;
use volume::Values;
use volume::brick::BrickIndex;

use super::*;

/// A block of 20 voxels a side, from voxel 10 on.
struct Block;

impl Values for Block {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (x, (value, weight)) in (start[0]..).zip(value.iter_mut().zip(weight)) {
            let inside = [x, start[1], start[2]].iter().all(|at| (10..30).contains(at));
            (*value, *weight) = (if inside { 200.0 } else { 0.0 }, 1.0);
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new((0..125).map(|n| [n % 5, n / 5 % 5, n / 25]))
    }
}

fn renderer() -> Renderer {
    let stage = RenderRegion::new(Transform::from_affine(DAffine3::IDENTITY), [0; 3], [39; 3]).unwrap();
    let transfer = Transfer::preset("tissue", [0.0, 255.0]).unwrap();
    let settings = RenderSettings { mode: Mode::Isosurface(100.0), ..RenderSettings::new([80, 60], transfer) };
    let mut renderer = Renderer::new(&settings, stage).unwrap();
    renderer.update_all(&Block);
    renderer
}

/// Returns the answer to a pick, while a thread renders, if `draws` is given.
fn pick(served: &Served, body: &str, draws: Option<Option<&Renderer>>) -> (StatusCode, Value) {
    let ends = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let (broadcaster, ends) = (&served.session.broadcaster, &ends);
        if let Some(shown) = draws {
            scope.spawn(move || {
                while !ends.load(std::sync::atomic::Ordering::Relaxed) {
                    broadcaster.answer(shown);
                    std::thread::sleep(Duration::from_millis(1));
                }
            });
        }
        let request = Request::post("/v1/pick").header("host", "localhost").body(Body::from(body.to_owned())).unwrap();
        let (status, _, text) = answered(served.clone(), request);
        ends.store(true, std::sync::atomic::Ordering::Relaxed);
        (status, serde_json::from_str(&text).unwrap())
    })
}

#[test]
fn pick_returns_visible_place_with_depth_axis() {
    let served = served(&session());
    let renderer = renderer();
    (0..1000).for_each(|_| served.session.broadcaster.answer(Some(&renderer)));
    assert_eq!(served.session.broadcaster.picked(), 0, "nobody has asked");
    let camera = renderer.camera();
    let at = |place: DVec3| {
        let [i, j] = camera.project_world(place).unwrap();
        serde_json::json!({ "at": [(i + 0.5) / 80.0, (j + 0.5) / 60.0] }).to_string()
    };
    // Seen from the front, along +y: the block's face lies half a voxel before its first
    // voxels.
    let ends = [DVec3::new(13.0, 9.5, 14.0), DVec3::new(25.0, 9.5, 19.0)];
    let picked = ends.map(|end| {
        let (status, reported) = pick(&served, &at(end), Some(Some(&renderer)));
        assert_eq!(status, StatusCode::OK, "{reported}");
        let point: [f64; 3] = serde_json::from_value(reported["point"].clone()).unwrap();
        assert!((DVec3::from_array(point) - end).length() < 0.05, "{point:?}");
        assert_eq!(reported["along"], serde_json::json!([0.0, 1.0, 0.0]));
        reported
    });
    assert_eq!(served.session.broadcaster.picked(), 2, "a ray each");
    assert!(!served.session.broadcaster.is_watched(), "who asked looks no longer");
    let body = serde_json::json!({ "kind": "distance", "points": picked }).to_string();
    let request = Request::post("/v1/measure").header("host", "localhost").body(Body::from(body)).unwrap();
    let (status, _, text) = answered(served.clone(), request);
    let reported: Value = serde_json::from_str(&text).unwrap();
    assert!((status, (reported["value"].as_f64().unwrap() - 13.0).abs() < 0.1) == (StatusCode::OK, true), "{reported}");
}

#[test]
fn pick_without_surface_or_renderer_reports_reason() {
    let served = served(&session());
    let renderer = renderer();
    for (body, draws, status, expected) in [
        (
            "{\"at\":[0.01,0.01]}",
            Some(Some(&renderer)),
            StatusCode::UNPROCESSABLE_ENTITY,
            "nothing opaque is visible there",
        ),
        ("{\"at\":[0.5,0.5]}", Some(None), StatusCode::UNPROCESSABLE_ENTITY, "no volume yet"),
        ("{\"at\":[0.5,1.5]}", None, StatusCode::UNPROCESSABLE_ENTITY, "from 0 to 1"),
        ("{\"at\":[0.5]}", None, StatusCode::UNPROCESSABLE_ENTITY, "not a point of the picture"),
        ("{\"at\":[0.5,0.5]}", None, StatusCode::SERVICE_UNAVAILABLE, "still being drawn"),
    ] {
        let began = Instant::now();
        let (found, reported) = pick(&served, body, draws);
        assert_eq!(found, status, "{body}: {reported}");
        assert!(reported["refused"].as_str().unwrap().contains(expected), "{reported}");
        assert!(began.elapsed() < Duration::from_secs(5), "nobody waits for long");
    }
}
