use proptest::prelude::*;

use sonoweave_core::reading::{Counts, Pose, Recorded};

use super::*;

/// Returns an 8-bit frame of 3×2 stored pixels, 1 to 6 in stored order.
fn frame() -> Frame {
    Frame {
        stamp: Stamp { item: 7, source_s: Some(12.5), ..Stamp::default() },
        frame_number: None,
        status: Status::Ok,
        size: [3, 2],
        channels: 1,
        pixel: PixelType::U8,
        orientation: "MFA".into(),
        image_type: "BRIGHTNESS".into(),
        pixels: Arc::from([1, 2, 3, 4, 5, 6].as_slice()),
        fields: Vec::new(),
    }
}

fn u8s(image: &Image) -> &[u8] {
    match image.pixels() {
        Pixels::U8(p) => p,
        other => panic!("{other:?}"),
    }
}

fn reason(frame: &Frame) -> Reason {
    let mut ingest = Ingest::new();
    match ingest.take(Reading::Frame(frame.clone())) {
        Sample::Refused(refusal) => {
            assert_eq!(refusal.item, 7);
            assert!(ingest.notes().is_empty(), "a refusal leaves no trace");
            refusal.reason
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn eight_orientations_give_same_mf_image() {
    // MF stores the rows 1 2 3 / 4 5 6: digits grow towards the marked side, and the probe lies
    // above 1 2 3.
    let stored: [(&str, [u32; 2], [u8; 6]); 8] = [
        ("MF", [3, 2], [1, 2, 3, 4, 5, 6]),
        ("UF", [3, 2], [3, 2, 1, 6, 5, 4]),
        ("MN", [3, 2], [4, 5, 6, 1, 2, 3]),
        ("UN", [3, 2], [6, 5, 4, 3, 2, 1]),
        ("FM", [2, 3], [1, 4, 2, 5, 3, 6]),
        ("FU", [2, 3], [3, 6, 2, 5, 1, 4]),
        ("NM", [2, 3], [4, 1, 5, 2, 6, 3]),
        ("NU", [2, 3], [6, 3, 5, 2, 4, 1]),
    ];
    for (code, size, pixels) in stored {
        for suffix in ["", "A", "D"] {
            let mut given = frame();
            given.orientation = format!(" {code}{suffix} ").into();
            given.size = size;
            given.pixels = Arc::from(pixels.as_slice());
            let picture = Ingest::new().picture(&given).unwrap();
            assert_eq!((picture.image.width(), picture.image.height()), (3, 2), "{code}");
            assert_eq!(u8s(&picture.image), [1, 2, 3, 4, 5, 6], "{code}");
            assert_eq!(picture.head.size, [3, 2]);
            assert_eq!(super::stored(&[1, 2, 3, 4, 5, 6], [3, 2], code), pixels, "{code} and back");

            let wide: Vec<u8> = pixels.iter().flat_map(|&p| (u16::from(p) * 300).to_ne_bytes()).collect();
            given.pixel = PixelType::U16;
            given.pixels = wide.into();
            let picture = Ingest::new().picture(&given).unwrap();
            assert!(matches!(picture.image.pixels(), Pixels::U16(p) if p[..] == [300, 600, 900, 1200, 1500, 1800]));
        }
    }
}

#[test]
fn mf_8_bit_image_not_copied() {
    let given = frame();
    let picture = Ingest::new().picture(&given).unwrap();
    assert!(matches!(picture.image.pixels(), Pixels::U8(p) if Arc::ptr_eq(p, &given.pixels)));
}

#[test]
fn other_pixel_types_become_f32() {
    let types: [(PixelType, Vec<u8>, f32); 8] = [
        (PixelType::I8, (-100_i8).to_ne_bytes().to_vec(), -100.0),
        (PixelType::I16, (-30_000_i16).to_ne_bytes().to_vec(), -30_000.0),
        (PixelType::U32, 4_000_000_000_u32.to_ne_bytes().to_vec(), 4e9),
        (PixelType::I32, (-2_000_000_000_i32).to_ne_bytes().to_vec(), -2e9),
        (PixelType::U64, (1_u64 << 40).to_ne_bytes().to_vec(), 1_099_511_627_776.0),
        (PixelType::I64, (-(1_i64 << 40)).to_ne_bytes().to_vec(), -1_099_511_627_776.0),
        (PixelType::F32, 0.25_f32.to_ne_bytes().to_vec(), 0.25),
        (PixelType::F64, (-0.5_f64).to_ne_bytes().to_vec(), -0.5),
    ];
    for (pixel, one, value) in types {
        let mut given = frame();
        given.pixel = pixel;
        given.pixels = one.repeat(6).into();
        let mut ingest = Ingest::new();
        let picture = ingest.picture(&given).unwrap();
        assert!(matches!(picture.image.pixels(), Pixels::F32(p) if p[..] == [value; 6]), "{pixel:?}");
        ingest.picture(&given).unwrap();
        assert_eq!(ingest.notes().len(), usize::from(pixel.bytes() >= 4 && pixel != PixelType::F32), "{pixel:?}");
    }
}

#[test]
fn refusals_name_reason() {
    let with = |change: fn(&mut Frame)| {
        let mut given = frame();
        change(&mut given);
        reason(&given)
    };
    assert_eq!(with(|f| f.status = Status::Other("INVALID".into())), Reason::ImageStatus);
    assert_eq!(with(|f| f.size = [0, 2]), Reason::ImageMissing);
    assert_eq!(with(|f| f.pixels = Arc::from([].as_slice())), Reason::ImageMissing);
    assert_eq!(with(|f| f.size = [4, 2]), Reason::ImageMissing);
    assert_eq!(with(|f| f.orientation = "XX".into()), Reason::ImageOrientation);
    assert_eq!(with(|f| f.orientation = "MU".into()), Reason::ImageOrientation);
    assert_eq!(with(|f| f.orientation = "AMF".into()), Reason::ImageOrientation);
    assert_eq!(with(|f| f.image_type = "RF_I_LINE_Q_LINE".into()), Reason::ImageType);
    assert_eq!(with(|f| f.image_type = "XX".into()), Reason::ImageType);
    assert_eq!(with(|f| f.channels = 5), Reason::Colour);
    assert_eq!(with(|f| f.channels = 3), Reason::ImageMissing, "there are pixels of one channel");
    assert_eq!(with(|f| f.image_type = "RGB_COLOR".into()), Reason::ImageType);
    assert_eq!(with(|f| f.stamp.source_s = Some(1e300)), Reason::TimeInvalid);
    assert_eq!(with(|f| f.stamp.source_s = Some(f64::NAN)), Reason::TimeInvalid);
    for bad in [f32::NAN, f32::INFINITY] {
        let mut given = frame();
        given.pixel = PixelType::F32;
        let pixels = [0.0, 1.0, 2.0, 3.0, bad, 5.0];
        given.pixels = pixels.iter().flat_map(|p: &f32| p.to_ne_bytes()).collect();
        let refusal = Ingest::new().picture(&given).unwrap_err();
        assert_eq!(refusal.reason, Reason::PixelNotFinite);
        assert!(refusal.detail.contains("pixel (1, 1)"), "{refusal}");
    }
    let mut given = frame();
    given.pixel = PixelType::F64;
    given.pixels = 1e300_f64.to_ne_bytes().repeat(6).into();
    assert_eq!(Ingest::new().picture(&given).unwrap_err().reason, Reason::PixelNotFinite);
}

#[test]
fn absent_orientation_means_mf_noted_once() {
    let mut given = frame();
    given.orientation = "".into();
    given.image_type = String::new();
    let mut ingest = Ingest::new();
    for _ in 0..3 {
        assert_eq!(u8s(&ingest.picture(&given).unwrap().image), [1, 2, 3, 4, 5, 6]);
    }
    assert_eq!(ingest.notes().len(), 1);
    assert!(ingest.notes()[0].contains("MF is assumed"));
}

#[test]
fn time_from_host_else_source_else_number() {
    let mut given = frame();
    let head = |frame: &Frame| Ingest::new().head(frame).unwrap();
    assert_eq!((head(&given).time_ns, head(&given).untimed), (12_500_000_000, false));
    given.stamp.host_ns = Some(42);
    assert_eq!(head(&given).time_ns, 42);
    given.stamp = Stamp { item: 9, ..Stamp::default() };
    assert_eq!((head(&given).time_ns, head(&given).untimed), (9, true));
    // In 2023 the nearest f64 is 1700000000.123456716… s; its nanoseconds are kept.
    given.stamp.source_s = Some(1_700_000_000.123_456_7);
    assert_eq!(head(&given).time_ns, 1_700_000_000_123_456_717);
    given.stamp.source_s = Some(-1.5);
    assert_eq!(head(&given).time_ns, -1_500_000_000);
}

#[test]
fn transforms_pass_other_readings_unused_by_kind() {
    let transform = NamedTransform {
        stamp: Stamp::default(),
        from: "Probe".into(),
        to: "Tracker".into(),
        matrix: [f64::NAN; 16],
        status: Status::Ok,
    };
    let mut ingest = Ingest::new();
    assert!(matches!(ingest.take(Reading::NamedTransform(transform)), Sample::Transform(t) if t.from == "Probe"));
    let counts = Counts {
        stamp: Stamp::default(),
        first: 0,
        axes: 1,
        counts: [1, 0, 0, 0, 0, 0],
        homed: 1,
        buttons: 0,
        status: Status::Ok,
    };
    assert!(matches!(ingest.take(Reading::Counts(counts)), Sample::Unused("counts")));
    let pose = Pose {
        stamp: Stamp::default(),
        station: 1,
        position_cm: [0.0; 3],
        quaternion_wxyz: [1.0, 0.0, 0.0, 0.0],
        buttons: 0,
        distortion: None,
        code: None,
        status: Status::Ok,
    };
    assert!(matches!(ingest.take(Reading::Pose(pose)), Sample::Unused("pose")));
    let recorded = Recorded { stamp: Stamp::default(), topic: String::new(), text: String::new() };
    assert!(matches!(ingest.take(Reading::Recorded(recorded)), Sample::Unused("recorded")));
}

proptest! {
    #[test]
    fn nanoseconds_are_nearest_to_seconds(ns in -9_000_000_000_000_000_000_i64..9_000_000_000_000_000_000) {
        let seconds = ns as f64 / 1e9;
        let back = nanoseconds(seconds).unwrap();
        // An f64 below 2^34 s has steps of at most 2^-18 s.
        prop_assert!(back.abs_diff(ns) <= 4_000, "{}", back.abs_diff(ns));
        // The same f64 in exact arithmetic: whole seconds, and the rest in units of 2^-52.
        let whole = seconds.trunc();
        let exact = i128::from(whole as i64) * 1_000_000_000 * (1 << 52)
            + i128::from(((seconds - whole) * 4_503_599_627_370_496.0) as i64) * 1_000_000_000;
        let error = (i128::from(back) * (1 << 52) - exact).abs();
        prop_assert!(error <= (1 << 51) + (1 << 32), "{}", error);
    }

    #[test]
    fn orientation_rearranges_pixels(first in 1_u32..7, second in 1_u32..7, code in 0_usize..8) {
        let code = ["MF", "UF", "MN", "UN", "FM", "FU", "NM", "NU"][code];
        let stored: Vec<u32> = (0..first * second).collect();
        let mut arranged = Orientation::from_code(code).unwrap().arrange(stored.clone(), [first, second]);
        arranged.sort_unstable();
        prop_assert_eq!(arranged, stored);
    }
}

#[test]
fn stored_rect_matches_mf_rect_in_all_orientations() {
    // Stored as 5×3 or 3×5, each pixel with its own number; the stored rectangle holds the same
    // pixels as that of the MF image.
    let rect = ClipRect { x: 1, y: 0, width: 2, height: 2 };
    for code in ["", "MF", "MN", "UF", "UN", "FM", "NM", "FU", "NU"] {
        let transposed = code.starts_with(['F', 'N']);
        let size: [u32; 2] = if transposed { [3, 5] } else { [5, 3] };
        let stored: Vec<u8> = (0..15).collect();
        let place = if code.is_empty() { Orientation::MF } else { Orientation::from_code(code).unwrap() };
        let picture = place.arrange(stored.clone(), size);
        let cut = |pixels: &[u8], width: u32, r: ClipRect| -> std::collections::BTreeSet<u8> {
            let rows = r.y..r.y + r.height;
            rows.flat_map(|v| (r.x..r.x + r.width).map(move |u| v * width + u)).map(|at| pixels[at as usize]).collect()
        };
        let found = stored_rect(size, code, |of| {
            assert_eq!(of, [5, 3], "{code}");
            rect
        });
        assert_eq!(cut(&stored, size[0], found.unwrap()), cut(&picture, 5, rect), "{code}");
    }
    assert_eq!(stored_rect([5, 3], "XX", |_| rect), None);
}

#[test]
fn colour_becomes_luma_noted_once() {
    let mut given = frame();
    given.channels = 3;
    given.image_type = "RGB_COLOR".into();
    given.orientation = "UF".into();
    given.size = [2, 1];
    given.pixels = Arc::from([255, 0, 0, 9, 9, 9].as_slice());
    let mut ingest = Ingest::new();
    for _ in 0..2 {
        assert_eq!(u8s(&ingest.picture(&given).unwrap().image), [9, 76]);
    }
    assert!(matches!(ingest.notes(), [note] if note.contains("luma") && note.contains("BT.601")));
    given.pixel = PixelType::U16;
    given.pixels = [65_535_u16, 0, 0, 9, 9, 9].iter().flat_map(|p| p.to_ne_bytes()).collect();
    let picture = ingest.picture(&given).unwrap();
    assert!(matches!(picture.image.pixels(), Pixels::U16(p) if **p == [9, 19_595]), "{:?}", picture.image.pixels());
}
