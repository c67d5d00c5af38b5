//! Virtual sweeps of known speed and gaps, simulated images with and without contact, and
//! conditions that come and go.

use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DMat3, DQuat, DVec3};

use mask::Clip;
use pipeline::session::InZones;
use sonoweave_core::clock::{MS, SECOND};
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::{Image, Pixels};

use super::advice::How;
use super::holes::{MOST_GAPS, MOST_PLANES, MOST_POINTS, direction};
use super::speed::Verdict;
use super::*;

/// 40 × 30 mm.
const SIZE: [u32; 2] = [80, 60];
const PIXEL: f64 = 0.5;
const SPACING: Spacing = Spacing { gapless_mm: 5.0, even_mm: 2.0 };
/// 25 images a second.
const FRAME: i64 = 40 * MS;

fn guidance_of(mask: MaskSettings) -> ScanGuidance {
    ScanGuidance::new(GuidanceSettings { spacing: SPACING, mask, calibration: None })
}

fn guidance() -> ScanGuidance {
    guidance_of(MaskSettings { clip: Clip::None, ..MaskSettings::default() })
}

/// Returns a pose from the position of the data's middle and a rotation about it.
fn pose(turn: DQuat, middle: DVec3) -> Transform<World, ImageFrame> {
    let centre = DVec3::new(0.5 * f64::from(SIZE[0] - 1), 0.5 * f64::from(SIZE[1] - 1), 0.0);
    let matrix3 = DMat3::from_quat(turn) * DMat3::from_diagonal(DVec3::new(PIXEL, PIXEL, 1.0));
    Transform::from_affine(DAffine3 { matrix3, translation: middle - matrix3 * centre })
}

struct Hand<'a> {
    guidance: &'a ScanGuidance,
    image: Image,
    now_ns: i64,
}

impl<'a> Hand<'a> {
    fn of(guidance: &'a ScanGuidance) -> Self {
        let pixels = vec![0_u8; (SIZE[0] * SIZE[1]) as usize];
        Self { guidance, image: Image::new(SIZE[0], SIZE[1], Pixels::U8(pixels.into())), now_ns: SECOND }
    }

    /// Adds the next slice at this position.
    fn turned(&mut self, turn: DQuat, middle: DVec3) -> GuidanceStatus {
        self.now_ns += FRAME;
        let slice = Slice { image: self.image.clone(), time_ns: self.now_ns, world_from_image: pose(turn, middle) };
        self.guidance.slice("Tracker", 0, &slice);
        self.guidance.status(&SessionStatus::default(), self.now_ns)
    }

    fn at(&mut self, middle: DVec3) -> GuidanceStatus {
        self.turned(DQuat::IDENTITY, middle)
    }

    /// Adds slices at these heights.
    fn sweep(&mut self, heights: impl IntoIterator<Item = f64>) -> GuidanceStatus {
        heights.into_iter().map(|z| self.at(DVec3::new(0.0, 0.0, z))).last().unwrap()
    }

    fn pauses(&mut self, seconds: i64) {
        self.now_ns += seconds * SECOND;
    }
}

fn steps(from: i32, to: i32) -> impl Iterator<Item = f64> {
    (0..=from.abs_diff(to)).map(move |n| f64::from(from) + f64::from(n) * f64::from((to - from).signum()))
}

#[test]
fn sweep_speed_and_density_ignore_tremor() {
    for tremor in [0.0, 0.04] {
        let guidance = guidance();
        let mut hand = Hand::of(&guidance);
        let mut status = None;
        for n in 0..40_i32 {
            let seconds = f64::from(n) * FRAME as f64 / 1e9;
            let shake = tremor * [1.0, -1.0, 0.3, -0.7, 0.4][(n % 5) as usize];
            status = hand.at(DVec3::new(7.0, 0.0, 24.0) * seconds + DVec3::splat(shake)).speed;
        }
        let status = status.unwrap();
        assert!((status.mm_per_s / 25.0 - 1.0).abs() < 0.01, "{status:?}");
        assert!((status.across_mm_per_s / 24.0 - 1.0).abs() < 0.01, "{status:?}");
        assert!((status.slices_per_s - 25.0).abs() < 1e-9);
        let per_cm = status.images_per_cm.unwrap();
        assert!((per_cm - 250.0 / 24.0).abs() < if tremor == 0.0 { 1e-9 } else { 0.1 }, "{status:?}");
        assert_eq!((status.verdict, status.text.as_str()), (Verdict::Good, "good: 24 mm/s"));
        assert_eq!((status.gapless_mm_per_s, status.even_mm_per_s), (125.0, 50.0));
    }
}

#[test]
fn tilting_probe_reports_fastest_corner() {
    let guidance = guidance();
    let mut hand = Hand::of(&guidance);
    let per_s = 0.8_f64;
    let mut status = None;
    for n in 0..20 {
        let turn = DQuat::from_rotation_x(per_s * f64::from(n) * FRAME as f64 / 1e9);
        // About the upper edge.
        let half = 0.5 * f64::from(SIZE[1] - 1) * PIXEL;
        status = hand.turned(turn, turn * DVec3::new(0.0, half, 0.0)).speed;
    }
    let status = status.unwrap();
    let deep = per_s * f64::from(SIZE[1] - 1) * PIXEL;
    // Fitted over 0.4 rad, against the newest normal.
    assert!((status.edge_mm_per_s / deep - 1.0).abs() < 0.05, "{status:?} {deep}");
    assert!((status.across_mm_per_s / status.edge_mm_per_s - 0.5).abs() < 1e-6, "{status:?}");
}

#[test]
fn verdicts_have_words_and_do_not_flicker() {
    let at = |velocity: DVec3| {
        let guidance = guidance();
        let mut hand = Hand::of(&guidance);
        (0..20).map(|n| hand.at(velocity * f64::from(n) * 0.04)).last().unwrap().speed.unwrap()
    };
    let still = at(DVec3::ZERO);
    assert_eq!((still.verdict, still.text.as_str(), still.images_per_cm), (Verdict::Still, "still", None));
    let sideways = at(DVec3::new(30.0, 0.0, 0.0));
    assert_eq!(sideways.text, "sideways: 30 mm/s within the picture's plane");
    assert_eq!(at(DVec3::new(0.0, 0.0, 60.0)).text, "fast: 60 mm/s where 50 mm/s makes an even volume");
    assert_eq!(at(DVec3::new(0.0, 0.0, -130.0)).text, "too fast: 130 mm/s where 125 mm/s leaves no gaps");
    // Repeatedly above the limit and slightly below it.
    let guidance = guidance();
    let mut hand = Hand::of(&guidance);
    let (mut z, mut shown) = (0.0, Vec::new());
    for (mm_per_s, frames) in [(100.0, 20), (130.0, 20), (120.0, 20), (130.0, 20), (110.0, 20)] {
        for _ in 0..frames {
            z += mm_per_s * 0.04;
            shown.extend(hand.at(DVec3::new(0.0, 0.0, z)).speed.map(|speed| speed.verdict));
        }
    }
    shown.dedup();
    assert_eq!(shown, [Verdict::Fast, Verdict::TooFast, Verdict::Fast]);
    // There is no report once slices stop.
    assert_eq!(guidance.status(&SessionStatus::default(), hand.now_ns + 3 * SECOND).speed, None);
}

#[test]
fn missing_part_is_one_hole_until_swept() {
    let guidance = guidance();
    let mut hand = Hand::of(&guidance);
    let status = hand.sweep(steps(0, 15).chain(steps(27, 45)));
    assert_eq!((status.holes.open, status.holes.closed), (1, 0));
    assert_eq!(status.holes.widest_mm, Some(12.0));
    assert_eq!(status.holes.nearest.as_deref(), Some("go back 24 mm"));
    let outlines = guidance.outlines(hand.now_ns);
    let [hole] = outlines.quads().collect::<Vec<_>>()[..] else { panic!("{outlines:?}") };
    for (corner, [x, y]) in hole.iter().zip([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) {
        let expected = DVec3::new(x * 19.75, y * 14.75, 21.0);
        assert!(corner.distance(expected) < 1e-9, "{hole:?}");
    }
    assert!(outlines.present.is_some_and(|corners| corners.iter().all(|corner| corner.z == 45.0)));
    // Back over half of it: still open, and nearer. Back over all of it: closed, without a new
    // one.
    let status = hand.sweep(steps(44, 24));
    assert_eq!(status.holes.open, 1, "{status:?}");
    let status = hand.sweep(steps(23, 12));
    assert_eq!((status.holes.open, status.holes.closed, status.holes.nearest), (0, 1, None));
    // Any speed is allowed over scanned tissue.
    let status = hand.sweep([24.0, 38.0, 20.0, 2.0, 30.0]);
    assert_eq!((status.holes.open, status.holes.closed), (0, 1));
}

#[test]
fn fast_sweep_leaves_hole_and_gapless_one_none() {
    let guidance = guidance();
    let mut hand = Hand::of(&guidance);
    let status = hand.sweep((0..30).map(|n| f64::from(n) * 5.0));
    assert_eq!(status.holes.open, 0);
    let status = hand.sweep((30..50).map(|n| 145.0 + f64::from(n - 29) * 8.0).chain([306.0, 307.0]));
    assert_eq!(status.holes.open, 1, "gaps that touch are one");
    assert_eq!(guidance.outlines(hand.now_ns).holes.len(), 20);
    // A tilting sweep leaves a gap where its deep end was too fast.
    let other = super::tests::guidance();
    let mut hand = Hand::of(&other);
    for n in 0..6 {
        let turn = DQuat::from_rotation_x(0.25 * f64::from(n));
        hand.turned(turn, turn * DVec3::new(0.0, 14.75, 0.0));
    }
    let prism = other.outlines(hand.now_ns).holes[0];
    let [shallow, deep] = [prism[0][0].length(), prism[0][3].length()];
    assert!(shallow > 18.0 && deep > shallow + 5.0, "{prism:?}");
    let depth = |corner: DVec3| corner.y.hypot(corner.z);
    assert!(depth(prism[0][0]) > 14.0, "above nothing is missing: {prism:?}");
}

#[test]
fn gap_is_only_where_both_slices_have_data() {
    let rect = ClipRect::new(40, 0, 20, 60).unwrap();
    let guidance = guidance_of(MaskSettings { clip: Clip::Rect(rect), ..MaskSettings::default() });
    let mut hand = Hand::of(&guidance);
    hand.sweep([0.0, 1.0]);
    // Both see 6 of 10 mm.
    hand.at(DVec3::new(4.0, 0.0, 9.0));
    let outlines = guidance.outlines(hand.now_ns);
    let [near, far] = outlines.holes[0];
    let xs: Vec<f64> = near.iter().chain(&far).map(|corner| corner.x).collect();
    let (low, high) = xs.iter().fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(*x), high.max(*x)));
    // From the first pixel of the second slice to the last of the first, at the spacing of the
    // lines.
    let expected = [20.0 - 19.75 + 4.0, 29.5 - 19.75];
    assert!((low - expected[0]).abs() < 1.7 && (high - expected[1]).abs() < 1e-9, "{low} {high} {expected:?}");
}

#[test]
fn new_sweep_is_no_hole_but_continued_sweep_is() {
    // Next to the first.
    let scanned = |then: &mut dyn FnMut(&mut Hand<'_>)| {
        let guidance = guidance();
        let mut hand = Hand::of(&guidance);
        hand.sweep(steps(0, 20));
        then(&mut hand);
        guidance.status(&SessionStatus::default(), hand.now_ns).holes
    };
    let beside = scanned(&mut |hand| {
        hand.at(DVec3::new(50.0, 0.0, 30.0));
        hand.at(DVec3::new(50.0, 0.0, 31.0));
    });
    assert_eq!(beside.open, 0);
    let far = scanned(&mut |hand| {
        hand.sweep(steps(80, 90));
    });
    assert_eq!(far.open, 0);
    let turned = scanned(&mut |hand| {
        hand.turned(DQuat::from_rotation_y(1.3), DVec3::new(0.0, 0.0, 30.0));
    });
    assert_eq!(turned.open, 0);
    // A tracker that jumps within a frame is not a sweep by hand.
    let jumped = scanned(&mut |hand| {
        hand.sweep([48.0]);
    });
    assert_eq!(jumped.open, 0);
    let lifted_and_back = scanned(&mut |hand| {
        hand.pauses(3);
        hand.sweep(steps(35, 15));
    });
    assert_eq!(lifted_and_back.open, 0);
    let not_known_yet = scanned(&mut |hand| {
        hand.pauses(3);
        hand.sweep([35.0, 36.0]);
    });
    assert_eq!(not_known_yet.open, 0);
    let gone_on = scanned(&mut |hand| {
        hand.pauses(3);
        hand.sweep(steps(35, 45));
    });
    assert_eq!((gone_on.open, gone_on.widest_mm), (1, Some(15.0)));
    let gone_back_to_it = scanned(&mut |hand| {
        hand.pauses(3);
        hand.sweep(steps(35, 45).chain(steps(44, 18)));
    });
    assert_eq!((gone_back_to_it.open, gone_back_to_it.closed), (0, 1));
}

#[test]
#[allow(clippy::print_stdout, reason = "figures for who asks with --nocapture")]
fn excess_is_counted_and_slice_work_is_bounded() {
    let guidance = guidance();
    let mut hand = Hand::of(&guidance);
    // Separate gaps, each with the largest number of points.
    let many = MOST_GAPS + 20;
    let mut z = 0.0;
    for _ in 0..many {
        for step in [1.0, 1.0, 18.0] {
            z += step;
            hand.sweep([z]);
        }
    }
    let status = guidance.status(&SessionStatus::default(), hand.now_ns);
    assert_eq!((status.holes.open, status.holes.beyond), (MOST_GAPS, 20));
    let shown = status.advice.iter().find(|advice| advice.key == "holes").unwrap();
    assert!(shown.sentence.starts_with("96 parts were left out: go back ") && shown.more.starts_with("20 further"));
    // Worst case: all gaps in one place, and slices in their planes, far apart each time, none
    // of which closes a gap.
    let rect = ClipRect::new(0, 0, 80, 30).unwrap();
    let worst = guidance_of(MaskSettings { clip: Clip::Rect(rect), ..MaskSettings::default() });
    let mut hand = Hand::of(&worst);
    for n in 0..MOST_GAPS {
        hand.at(DVec3::new(0.01 * n as f64, 0.0, 0.0));
        hand.at(DVec3::new(0.01 * n as f64, 0.0, 19.0));
        hand.pauses(2);
    }
    let slices: Vec<Slice> = (0..2 * MOST_PLANES)
        .map(|n| Slice {
            image: hand.image.clone(),
            time_ns: hand.now_ns + n as i64 * FRAME,
            world_from_image: pose(
                DQuat::IDENTITY,
                DVec3::new(-30.0 + 4.5 * (n / 2 % 14) as f64, 15.5 + 0.001 * n as f64, 19.0 * (n % 2) as f64),
            ),
        })
        .collect();
    let points = || worst.lock().holes.status(None, None).points;
    let (mut most, mut longest) = (0, 0.0_f64);
    let begun = Instant::now();
    for slice in &slices {
        let (before, begun) = (points(), Instant::now());
        worst.slice("Tracker", 0, slice);
        longest = longest.max(begun.elapsed().as_secs_f64() * 1e6);
        most = most.max(points() - before);
    }
    let micros = begun.elapsed().as_secs_f64() * 1e6 / slices.len() as f64;
    let status = worst.lock().holes.status(None, None);
    println!("{micros:.1} µs a slice, {longest:.1} at most; {most} points at most; {status:?}");
    assert!(most > 1000, "there is work: {status:?}");
    assert!(most <= MOST_POINTS + (MOST_GAPS as u64 + 2) * 216, "{most}");
    // More planes than are stored.
    let long = super::tests::guidance();
    let mut hand = Hand::of(&long);
    let status = hand.sweep((0..MOST_PLANES + 50).map(|n| 2.0 * n as f64));
    assert_eq!((status.holes.forgotten, status.holes.open), (50, 0));
}

#[test]
fn hole_directions_use_image_terms() {
    let mask = Mask::full(SIZE[0], SIZE[1]);
    let plane = SlicePlane::new(pose(DQuat::IDENTITY, DVec3::ZERO), &mask).unwrap();
    for (place, travel, text) in [
        ([0.0, 0.0, -14.0], Some(DVec3::Z), "go back 14 mm"),
        ([0.0, 0.0, -14.0], Some(-DVec3::Z), "go on 14 mm"),
        ([5.0, 9.0, 14.0], None, "it is 14 mm off the picture's plane"),
        ([-30.0, 0.0, -14.0], Some(DVec3::Z), "go back 14 mm and 10 mm to the marker's side"),
        ([28.0, 0.0, 0.0], Some(DVec3::Z), "move 8 mm away from the marker"),
        ([3.0, 1.0, 0.5], Some(DVec3::Z), "it is here: sweep slowly over it"),
    ] {
        assert_eq!(direction(&plane, DVec3::from_array(place), travel), text);
    }
}

/// Inputs without any problem.
fn well<'a>(account: &'a SessionStatus, holes: &'a HolesStatus) -> Signs<'a> {
    Signs { speed: None, holes, contact: Contact::There, sensors: &[], breathing: None, account, calibration: None }
}

#[test]
fn advice_is_sorted_and_does_not_flicker() {
    let account = SessionStatus {
        stuck_s: Some(3.0),
        distortion: Some(InZones { zones: 1, frames: 1, entered: 1, rms_mm: Some(2.0) }),
        ..SessionStatus::default()
    };
    let holes = HolesStatus { open: 2, nearest: Some("go back 14 mm".into()), ..HolesStatus::default() };
    let sensor = |name: &str, invalid: f64| SensorStatus { name: name.into(), invalid, why: "out of sight".into() };
    let sensors = [sensor("Reference", 0.2), sensor("Probe", 0.9)];
    let signs = Signs { sensors: &sensors, calibration: Some("It is old."), ..well(&account, &holes) };
    let mut debouncer = AdviceDebouncer::default();
    assert!(debouncer.of(&signs, 0).is_empty(), "not believed yet");
    let shown = debouncer.of(&signs, 400 * MS);
    let keys: Vec<&str> = shown.iter().map(|advice| &*advice.key).collect();
    assert_eq!(keys, ["tracker-lost Probe", "frozen", "bent", "tracker-weak Reference", "holes", "calibration"]);
    assert_eq!(shown[0].how, How::Bad);
    assert_eq!(
        shown[0].sentence,
        "The probe's sensor is out of the tracker's range: bring it back, and see to its cable."
    );
    assert!(shown[0].more.contains("90 %") && shown[0].more.contains("out of sight"), "{shown:?}");
    assert_eq!(shown[3].sentence, "The tracker sees the patient's sensor badly: bring it nearer.");
    assert_eq!(shown[4].sentence, "2 parts were left out: go back 14 mm.");
    // Advice survives a short absence of its condition but not a long one; an alternating
    // condition never appears.
    let (quiet, none) = (SessionStatus::default(), HolesStatus::default());
    let well = well(&quiet, &none);
    assert_eq!(debouncer.of(&well, 900 * MS).len(), 6);
    assert!(debouncer.of(&well, 2500 * MS).is_empty());
    let lost = Signs { contact: Contact::Lost, ..well };
    for n in 0..20 {
        let signs = if n % 2 == 0 { &lost } else { &well };
        assert!(debouncer.of(signs, 3 * SECOND + n * 200 * MS).is_empty(), "{n}");
    }
    for n in 0..3 {
        debouncer.of(&lost, 10 * SECOND + n * 200 * MS);
    }
    let shown = debouncer.of(&lost, 11 * SECOND);
    assert_eq!(shown[0].sentence, "No contact: add gel and press the probe on.");
    // Once shown, it stays while the condition alternates.
    for n in 0..20 {
        let signs = if n % 2 == 0 { &lost } else { &well };
        assert_eq!(debouncer.of(signs, 12 * SECOND + n * 200 * MS).len(), 1, "{n}");
    }
}

#[test]
fn sensor_invalid_share_covers_last_second() {
    let mut sensors = Sensors::default();
    for n in 0..50 {
        sensors.add("Probe", n * 20 * MS, (n % 4 == 0).then_some("too far"));
        sensors.add("Reference", n * 20 * MS, None);
    }
    let status = sensors.status(SECOND);
    assert_eq!((status[0].name.as_str(), status[0].why.as_str(), status[1].invalid), ("Probe", "too far", 0.0));
    assert!((status[0].invalid - 0.26).abs() < 0.011, "{status:?}");
    for n in 50..101 {
        sensors.add("Probe", n * 20 * MS, None);
    }
    let status = sensors.status(2 * SECOND);
    assert_eq!(
        status,
        [SensorStatus { name: "Probe".into(), invalid: 0.0, why: String::new() }],
        "the other is silent"
    );
}

mod painted {
    //! Simulated B-mode images.

    use super::*;
    use contact::Depth;
    use phantom::bmode::{BMode, Layout, Scanner};
    use phantom::body::{Body, Material, doll, thigh};
    use phantom::trajectory::PictureMm;

    const SIZE: [u32; 2] = [320, 240];

    /// Only air in front of the probe's face.
    fn air() -> Body {
        let air = Material { impedance: 0.0004, attenuation: 12.0, ..Material::water("air") };
        Body { materials: vec![air], solids: Vec::new(), wires: Vec::new(), landmarks: Vec::new(), ..doll::doll() }
    }

    /// Only a tissue without any structure.
    fn speckle() -> Body {
        let tissue = Material { backscatter_db: Some(0.0), attenuation: 0.5, ..Material::water("tissue") };
        Body { materials: vec![tissue], ..air() }
    }

    /// Returns a simulator of images of a body at the scanner's face, `n` times 20 mm along it.
    fn painter(scanner: &Scanner, body: Body) -> (BMode, impl FnMut(u32) -> Image) {
        let pixel = scanner.pixel_mm(SIZE);
        let layout = Layout::new(scanner, SIZE, [pixel; 2]).unwrap();
        let body = Arc::new(body.placed_at(layout.face_below_middle_mm()));
        let bmode = BMode::new(*scanner, body, SIZE, [pixel; 2]).unwrap();
        let (painter, mut room) = (bmode.clone(), bmode.workspace());
        let paint = move |n: u32| {
            let at = DVec3::new(0.0, 0.0, 20.0 * f64::from(n) - 40.0);
            let pose: Transform<World, PictureMm> = Transform::from_affine(DAffine3::from_translation(at));
            let mut pixels = vec![0; (SIZE[0] * SIZE[1]) as usize];
            painter.paint(&pose, n, &mut room, &mut pixels);
            Image::new(SIZE[0], SIZE[1], Pixels::U8(pixels.into()))
        };
        (bmode, paint)
    }

    fn depths(scanner: &Scanner, body: Body) -> Vec<Depth> {
        let (bmode, mut paint) = painter(scanner, body);
        (0..5).map(|n| Depth::of(&paint(n), bmode.mask())).collect()
    }

    #[test]
    fn body_echoes_and_air_does_not_at_any_gain() {
        for gain_db in [-12.0, -6.0, 0.0, 6.0, 12.0] {
            for (scanner, radius) in [(Scanner::abdominal(105.0), 60.0), (Scanner::small_parts(50.0), 1000.0)] {
                let scanner = Scanner { white_db: scanner.white_db - gain_db, ..scanner };
                let on = depths(&scanner, thigh::thigh(radius));
                assert!(on.iter().all(Depth::answers), "{gain_db} dB: {on:?}");
                let even = depths(&scanner, speckle());
                assert!(even.iter().all(Depth::answers), "{gain_db} dB: {even:?}");
                let off = depths(&scanner, air());
                assert!(!off.iter().any(Depth::answers), "{gain_db} dB: {off:?}");
            }
        }
        // In a tank, where most of the image is black.
        let scanner = Scanner::abdominal(105.0).in_water();
        let doll = depths(&scanner, doll::doll());
        assert!(doll.iter().all(Depth::answers), "{doll:?}");
    }

    #[test]
    fn lost_contact_is_reported_after_delay() {
        let scanner = Scanner::small_parts(50.0);
        let picture = |body: Body| painter(&scanner, body).1(2);
        let (on, off) = (picture(thigh::thigh(1000.0)), picture(air()));
        let guidance = guidance();
        let status = |image: &Image, from_ms: i64, to_ms: i64| {
            let mut status = None;
            for ms in (from_ms..to_ms).step_by(20) {
                guidance.captured(&CapturedFrame { item: 0, captured_ns: ms * MS, image });
                status = Some(guidance.status(&SessionStatus::default(), ms * MS));
            }
            status.unwrap()
        };
        let there = status(&on, 0, 2000);
        assert_eq!((there.contact, there.pictures), (Contact::There, 20));
        assert_eq!(status(&off, 2000, 2600).contact, Contact::There, "a moment");
        let lost = status(&off, 2600, 4000);
        assert_eq!((lost.contact, &*lost.advice[0].key), (Contact::Lost, "contact"));
        assert_eq!(status(&on, 4000, 4200).contact, Contact::There);
        assert_eq!(guidance.status(&SessionStatus::default(), 9 * SECOND).contact, Contact::Unknown);
    }
}
