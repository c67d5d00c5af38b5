//! Pages that view planes, move them, and choose the volume's style.

use glam::{DAffine3, DVec3};

use pipeline::session::{Extent, PlaneImage, PlaneRequest, PlaneViewer as _, PlaneWork};
use render::RenderSettings;
use render::classify::transfer::Transfer;
use render::section::{Box3, Sampled};
use sonoweave_core::frames::Transform;

use super::*;
use crate::style::ConfiguredStyle;

const RANGE: [f32; 2] = [0.0, 255.0];

fn extent() -> Extent {
    let affine =
        DAffine3::from_scale_rotation_translation(DVec3::splat(0.5), Default::default(), DVec3::new(3.0, -5.0, 7.0));
    let place = Box3::new(Transform::from_affine(affine), [[0; 3], [31, 23, 15]]);
    Extent { place, voxel_mm: 0.5, grey_levels: RANGE }
}

fn ground() -> ConfiguredStyle {
    let transfer = Transfer::preset("tissue", [0.0, 255.0]).unwrap();
    ConfiguredStyle { transfer, name: "tissue".into(), range: RANGE, uses_opacities: true }
}

/// Opens a page that views planes.
fn viewing(session: &Session) -> Client {
    let mut page = session.page();
    page.say(&json!({ "do": "show", "slice": false, "view": false, "planes": true }));
    until("planes are looked at", || session.broadcaster.is_watched_in_planes());
    page
}

impl FrameBroadcaster {
    fn is_watched_in_planes(&self) -> bool {
        pipeline::session::PlaneViewer::is_watched(self)
    }
}

/// Publishes the requested planes; half of each is seen.
fn cut(session: &Session, slices: u64) -> Vec<PlaneRequest> {
    let extent = extent();
    let requested = session.broadcaster.requested(&extent);
    for requested in &requested {
        let seen = Sampled { value: 100.0, weight: 1.0, share: 1.0 };
        let pixels = requested.section.pixels();
        let sampled: Vec<Sampled> = (0..pixels).map(|n| if n < pixels / 2 { seen } else { Sampled::UNSEEN }).collect();
        let (requested, work) = (*requested, PlaneWork::default());
        session.broadcaster.show_plane(&PlaneImage {
            request: requested,
            extent,
            sampled: &sampled,
            errors: &[],
            keeps_errors: false,
            weighs_shadows: false,
            weak: 0.0,
            readout: None,
            slices,
            item: 4,
            captured_ns: Some(0),
            work,
        });
    }
    requested
}

#[test]
fn planes_are_made_for_subscribers_and_sent_with_position() {
    let session = Session::new();
    let mut page = session.page();
    // The command without the field for planes, as older pages send it.
    page.say(&json!({ "do": "show", "slice": true, "view": true }));
    until("somebody looks", || session.broadcaster.is_watched());
    assert!(!session.broadcaster.is_watched_in_planes() && cut(&session, 1).is_empty());
    page.say(&json!({ "do": "show", "slice": true, "view": true, "planes": true }));
    // Kinds are subscribed one by one, the free plane last.
    until("planes are looked at", || session.broadcaster.is_viewed(Kind::Free));
    let requested = cut(&session, 7);
    assert_eq!(requested.len(), 4);
    let mut arrived = Vec::new();
    for _ in 0..4 {
        // They arrive in any order, each after its description.
        let reported = page.word("plane");
        let picture = page.picture();
        let kind = picture[0];
        arrived.push(kind);
        let requested = &requested[usize::from(kind) - 3];
        assert_eq!(requested.number, usize::from(kind) - 3);
        assert_eq!((picture[0], picture[1], sequence(&picture), item(&picture)), (kind, 1, 1, 4));
        assert_eq!(
            (&reported["kind"], &reported["sequence"], &reported["slices"]),
            (&json!(kind), &json!(1), &json!(7))
        );
        assert_eq!(reported["origin"], json!(requested.section.first.to_array()));
        assert_eq!(reported["right"], json!(requested.section.right.to_array()));
        assert_eq!(reported["down"], json!(requested.section.down.to_array()));
        assert_eq!(reported["size"], json!(requested.section.size));
        assert_eq!(reported["histogram"].as_array().unwrap()[25], json!(requested.section.pixels() / 2));
        let pixels = &picture[40..];
        assert_eq!(pixels.len(), 3 * requested.section.pixels());
        assert_eq!(pixels[..3], [100; 3]);
        let last = &pixels[pixels.len() - 3..];
        assert!(last[2] > last[0], "not seen: {last:?}");
        page.say(&json!({ "do": "shown", "kind": kind, "sequence": 1 }));
    }
    arrived.sort_unstable();
    assert_eq!(arrived, [3, 4, 5, 6]);
    // The volume is replaced by one in which nothing was seen.
    session.broadcaster.nothing("no voxel was seen yet; wait for the first slices");
    let reported = page.word("plane");
    assert_eq!(
        (&reported["none"], &reported["sequence"]),
        (&json!("no voxel was seen yet; wait for the first slices"), &json!(2))
    );
    (0..4).for_each(|_| assert_eq!(page.picture().len(), 43));
    page.say(&json!({ "do": "show", "slice": true, "view": true, "planes": false }));
    until("nobody looks at planes any more", || !session.broadcaster.is_watched_in_planes());
    let made = session.broadcaster.made(Kind::Free);
    session.broadcaster.nothing("no voxel was seen yet; wait for the first slices");
    assert_eq!((cut(&session, 8).len(), session.broadcaster.made(Kind::Free)), (0, made));
    // A page that subscribes again gets no outdated picture.
    page.say(&json!({ "do": "show", "slice": true, "view": true, "planes": true }));
    until("planes are looked at again", || session.broadcaster.is_watched_in_planes());
    assert_eq!(page.for_a_while(), 0);
}

#[test]
fn only_page_in_control_moves_planes_and_window() {
    let session = Session::new();
    let mut first = viewing(&session);
    let mut second = session.page();
    let before = cut(&session, 1);
    let middle = extent().place.middle();
    let cross = json!({ "do": "cross", "at": [middle.x, middle.y, middle.z + 2.0] });
    for message in [
        cross.clone(),
        json!({ "do": "tilt", "right": 5.0, "up": 0.0, "clockwise": 0.0 }),
        json!({ "do": "window", "black": 10.0, "white": 20.0 }),
        json!({ "do": "transfer", "preset": "bone" }),
        json!({ "do": "reset", "of": "planes" }),
    ] {
        second.say(&message);
        assert!(second.word("refused").as_str().unwrap().contains("take over control"), "{message}");
    }
    assert_eq!(session.broadcaster.requested(&extent()), before);
    for (message, expected) in [
        (json!({ "do": "cross", "at": [1e9, 0.0, 0.0] }), "outside the volume"),
        (json!({ "do": "cross", "at": [1.0, 2.0] }), "not a valid command"),
        (json!({ "do": "tilt", "right": 1e4, "up": 0.0, "clockwise": 0.0 }), "360°"),
        (json!({ "do": "window", "black": 20.0, "white": 10.0 }), "larger one"),
        (json!({ "do": "reset", "of": "patient" }), "unknown variant `patient`"),
        (json!({ "do": "transfer", "preset": "bone" }), "no volume is drawn"),
    ] {
        first.say(&message);
        let refused = first.word("refused");
        assert!(refused.as_str().unwrap().contains(expected), "{message}: {refused}");
        assert_eq!(session.broadcaster.requested(&extent()), before, "{message}");
    }
    first.say(&cross);
    until("the plane across z moves", || session.broadcaster.requested(&extent())[0] != before[0]);
    let after = session.broadcaster.requested(&extent());
    assert_eq!(after[1..], before[1..], "the others hold the way that it went");
    first.say(&json!({ "do": "tilt", "right": 30.0, "up": 0.0, "clockwise": 0.0 }));
    until("the free one turns", || session.broadcaster.requested(&extent())[3] != after[3]);
    first.say(&json!({ "do": "reset", "of": "planes" }));
    until("all are as they were", || session.broadcaster.requested(&extent()) == before);
    first.say(&json!({ "do": "window", "black": 50.0, "white": 150.0 }));
    until("they look otherwise", || session.broadcaster.requested(&extent())[0].style != before[0].style);
    first.pictures.clear();
    cut(&session, 2);
    // The grey values of the window, and the window itself.
    let begun = Instant::now();
    while first.word("plane")["window"] != json!([50.0, 150.0]) {
        assert!(begun.elapsed() < Duration::from_secs(10));
    }
    until("its picture comes", || first.picture()[40..43] == [128; 3]);
    first.say(&json!({ "do": "reset", "of": "window" }));
    until("as configured", || session.broadcaster.requested(&extent())[0].style > before[0].style + 1);
}

#[test]
fn page_in_control_sets_style_and_all_pages_receive_it() {
    let session = Session::new();
    session.broadcaster.configure(ground());
    let mut first = session.page();
    let mut second = session.page();
    let worn = || {
        let mut settings = RenderSettings::new([8, 8], ground().transfer);
        session.broadcaster.apply_style(&mut settings);
        settings.transfer
    };
    for page in [&mut first, &mut second] {
        let reported = page.word("dress");
        assert_eq!((&reported["preset"], &reported["configured"]), (&Value::Null, &json!("tissue")));
        assert_eq!(reported["presets"].as_array().unwrap().len(), Transfer::PRESETS.len());
    }
    assert_eq!(session.broadcaster.style_number(), 0);
    first.say(&json!({ "do": "transfer", "preset": "bone" }));
    for page in [&mut first, &mut second] {
        assert_eq!(page.word("dress")["preset"], "bone");
    }
    assert_eq!(worn(), Transfer::preset("bone", [0.0, 255.0]).unwrap());
    let number = session.broadcaster.style_number();
    assert_ne!(number, 0);
    for (message, expected) in [
        (json!({ "do": "transfer", "preset": "velvet" }), "velvet"),
        (json!({ "do": "transfer", "points": [[20.0, 0.5], [10.0, 0.5]] }), "after a point at 20"),
        (json!({ "do": "transfer", "points": [[20.0, 2.0]] }), "from 0 to 1"),
        (json!({ "do": "transfer", "points": [[20.0]] }), "not a valid command"),
    ] {
        first.say(&message);
        let refused = first.word("refused");
        assert!(refused.as_str().unwrap().contains(expected), "{message}: {refused}");
        assert_eq!(session.broadcaster.style_number(), number, "{message}");
    }
    first.say(&json!({ "do": "transfer", "preset": "bone", "points": [[20.0, 0.0], [200.0, 0.9]] }));
    assert_eq!(second.word("dress")["points"], json!([[20.0, 0.0], [200.0, 0.9]]));
    assert_ne!(session.broadcaster.style_number(), number);
    first.say(&json!({ "do": "transfer" }));
    assert_eq!(second.word("dress")["preset"], Value::Null);
    assert_eq!((session.broadcaster.style_number(), worn()), (0, ground().transfer));
}
