//! Grabbed frames equal the frames fed into the device.

use std::sync::OnceLock;

use drivers::grabber::pixels::{Colour, Converter, Layout, Matrix, PixelFormat, Range, Rows};
use drivers::grabber::{self, GrabberSettings, Interlace, Standard};
use sonoweave_core::Device;
use sonoweave_core::clock::{Clock, Monotonic, SECOND};
use sonoweave_core::reading::{Frame, Status};

use super::vivid::{CAPTURE_NODE, Feeder, OUTPUT_NODE, Vivid};
use super::{Rig, Test, allocations, hdmi};

pub(crate) const TESTS: &[Test] = &[
    ("what_is_there_is_listed_and_why_it_cannot_be_opened", listing),
    ("own_pictures_come_back_byte_for_byte_in_every_format", every_format),
    ("full_hd_at_30_hz_comes_without_a_lost_frame", full_hd),
    ("a_frame_asks_for_no_memory", no_allocations),
    ("stamps_are_the_kernel_s_and_go_on_evenly", stamps),
    ("fields_of_interlaced_video_are_pictures_with_their_own_times", fields),
    ("size_and_rate_are_chosen_from_offers", camera),
    ("missing_format_is_refused_with_sentence", refusals),
];

fn listing() {
    // A device node without a device.
    let (major, minor) = (81, 99);
    let ghost = "/dev/video9";
    let device = rustix::fs::makedev(major, minor);
    rustix::fs::mknodat(rustix::fs::CWD, ghost, rustix::fs::FileType::CharacterDevice, 0o600.into(), device).unwrap();
    let listed = grabber::list();
    let find = |id: &str| listed.iter().find(|listing| listing.id == id);
    let camera = find(CAPTURE_NODE).unwrap();
    assert_eq!(camera.unavailable, None);
    assert!(camera.description.starts_with("vivid (vivid, platform:vivid-000): up to "), "{}", camera.description);
    assert!(camera.description.contains("inputs Webcam 0, HDMI 0, S-Video 0"), "{}", camera.description);
    assert!(find(OUTPUT_NODE).is_none(), "an output is no source");
    assert_eq!(find(ghost).unwrap().unavailable.as_deref(), Some("is not there any more; plug it in"));
    std::fs::remove_file(ghost).unwrap();
}

/// Returns noise, of which each frame uses a different part. Created once, because the emulated
/// processor is slow.
fn noise() -> &'static [u8] {
    static NOISE: OnceLock<Vec<u8>> = OnceLock::new();
    NOISE.get_or_init(|| {
        let mut state = 0x9e37_79b9_7f4a_7c15_u64;
        let word = |_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            state.to_le_bytes()
        };
        (0..(4 << 20) / 8).flat_map(word).collect()
    })
}

/// Fills a frame with noise at a unique offset, and its number in the first eight samples of
/// luma.
fn paint(format: PixelFormat, number: u64, out: &mut [u8]) {
    let noise = noise();
    let places = (noise.len() - out.len()) as u64;
    let at = usize::try_from(number * 40_009 % places).unwrap();
    out.copy_from_slice(&noise[at..at + out.len()]);
    let [first, step] = luma(format);
    for (n, byte) in number.to_le_bytes().into_iter().enumerate() {
        out[first + n * step..][..if format == PixelFormat::Rgb24 || format == PixelFormat::Bgr24 { 3 } else { 1 }]
            .fill(byte);
    }
}

/// Returns the position of the first significant byte of luma, and the distance to the next.
const fn luma(format: PixelFormat) -> [usize; 2] {
    match format {
        PixelFormat::Yuyv => [0, 2],
        // High byte of a word.
        PixelFormat::Uyvy | PixelFormat::Y16 => [1, 2],
        PixelFormat::Rgb24 | PixelFormat::Bgr24 => [0, 3],
        _ => [0, 1],
    }
}

/// Returns the number that was painted into a frame.
fn number(frame: &Frame) -> u64 {
    let step = frame.channels as usize;
    u64::from_le_bytes(std::array::from_fn(|n| frame.pixels[n * step]))
}

/// Reads until the frames come from the feeder: the first ones may precede the loop.
fn settled(rig: &mut Rig, feeder: &Feeder) -> Frame {
    for _ in 0..60 {
        let frame = rig.frame();
        if (1..feeder.fed()).contains(&number(&frame)) {
            return frame;
        }
    }
    panic!("none of 60 frames is ours");
}

fn every_format() {
    use PixelFormat as P;
    let size = [640, 480];
    for format in [P::Grey, P::Y16, P::Yuyv, P::Uyvy, P::Nv12, P::I420, P::Yv12, P::Rgb24, P::Bgr24] {
        // Bytes are passed unchanged, in grey, so that the number is readable.
        let feeder = Feeder::start(format.fourcc(), size, 60.0, move |number, out| paint(format, number, out));
        let settings =
            GrabberSettings { format: Some(format), range: Some(Range::Full), matrix: Some(Matrix::Bt601), ..hdmi() };
        let mut rig = Rig::start(settings.clone());
        let layout =
            Layout { format, size, row_bytes: feeder.row_bytes as u32, range: Range::Full, matrix: Matrix::Bt601 };
        let mut converter = Converter::new(layout, Rows::WHOLE, Colour::Grey).unwrap();
        let mut video = vec![0; feeder.frame_bytes];
        let mut picture = vec![0; converter.picture_bytes()];
        let mut before = None;
        let mut frame = settled(&mut rig, &feeder);
        for _ in 0..20 {
            let number = number(&frame);
            paint(format, number, &mut video);
            converter.convert(&video, &mut picture).unwrap();
            assert!(*frame.pixels == *picture, "{format}: picture {number} is not the one that was sent");
            // Input and output have separate clocks: a frame may appear twice, or not at all.
            assert!(before.is_none_or(|before| number >= before), "{format}: {number} after {before:?}");
            assert_eq!((frame.size, frame.channels, &frame.status), (size, 1, &Status::Ok));
            before = Some(number);
            frame = rig.frame();
        }
        // In colour, from the same bytes. The first frame's number is found by comparison with
        // recently sent ones.
        rig.grabber.stop().unwrap();
        let mut rig = Rig::start(GrabberSettings { colour: Colour::Rgb, range: None, matrix: None, ..settings });
        let frame = rig.frames(30).pop().unwrap();
        let stated = |name: &str| {
            rig.grabber.describe().fields.iter().find(|(n, _)| n == name).map(|(_, text)| text.clone()).unwrap()
        };
        let range = if stated("VideoRange") == "full" { Range::Full } else { Range::Limited };
        let matrix = if stated("VideoMatrix") == "bt709" { Matrix::Bt709 } else { Matrix::Bt601 };
        assert_eq!(range == Range::Limited, !format.is_rgb() && !format.is_grey(), "{format}: {range:?}");
        let mut converter = Converter::new(Layout { range, matrix, ..layout }, Rows::WHOLE, Colour::Rgb).unwrap();
        let mut picture = vec![0; converter.picture_bytes()];
        let fed = feeder.fed();
        let found = (fed.saturating_sub(80)..fed).rev().any(|number| {
            paint(format, number, &mut video);
            converter.convert(&video, &mut picture).unwrap();
            *frame.pixels == *picture
        });
        assert!(found, "{format}: a colour picture is none of those sent ({range:?}, {matrix:?})");
    }
}

fn full_hd() {
    let size = [1920, 1080];
    let format = PixelFormat::Grey;
    // Only the number changes: the emulated processor would need longer to paint whole frames
    // than to send them.
    let feeder = Feeder::start(format.fourcc(), size, 30.0, |number, out| {
        if number < 4 {
            paint(PixelFormat::Grey, 7, out);
        }
        out[..8].copy_from_slice(&number.to_le_bytes());
    });
    let mut rig = Rig::start(GrabberSettings { format: Some(format), ..hdmi() });
    let mut before = settled(&mut rig, &feeder);
    let mut expected = vec![0; feeder.frame_bytes];
    paint(format, 7, &mut expected);
    let (frames, most) = (150, 2700);
    let [mut read, mut without_loss, mut lost, mut repeated] = [0_u64; 4];
    // A delayed emulated processor loses frames before they reach the driver. A lossless run of
    // `frames` frames must still occur.
    while without_loss < frames {
        assert!(read < most, "{lost} of {read} frames were lost, and never none of {frames} in a row");
        let frame = rig.frame();
        read += 1;
        let [last, this] = [&before, &frame].map(|frame| frame.frame_number.unwrap());
        lost += this - last - 1;
        without_loss = if this == last + 1 { without_loss + 1 } else { 0 };
        // Input and output have separate clocks: a frame may appear twice, or not at all.
        let numbers = [&before, &frame].map(number);
        assert!(numbers[1] >= numbers[0], "{numbers:?}");
        repeated += u64::from(numbers[1] == numbers[0]);
        assert!(frame.pixels[8..] == expected[8..], "picture {} is not the one that was sent", numbers[1]);
        before = frame;
    }
    assert!(repeated < read / 2, "{repeated} of {read} pictures were seen twice");
    println!("1920×1080 GREY: {frames} frames in a row without a loss; {lost} lost and {repeated} repeated of {read}");
}

fn no_allocations() {
    for (format, colour) in [(PixelFormat::Grey, Colour::Grey), (PixelFormat::Yuyv, Colour::Rgb)] {
        let mut rig = Rig::start(GrabberSettings { format: Some(format), colour, ..hdmi() });
        rig.frames(20);
        let before = allocations::so_far();
        // Long enough for several signal queries.
        for _ in 0..60 {
            drop(rig.frame());
        }
        assert_eq!(allocations::so_far(), before, "{format} to {colour:?}");
        rig.grabber.stop().unwrap();
    }
}

fn stamps() {
    let mut rig = Rig::start(GrabberSettings { format: Some(PixelFormat::Grey), ..hdmi() });
    let frames = rig.frames(60);
    let host = |frame: &Frame| frame.stamp.host_ns.unwrap();
    let number = |frame: &Frame| frame.frame_number.unwrap();
    for pair in frames.windows(2) {
        let [a, b] = pair else { unreachable!() };
        assert!(host(b) > host(a));
        // vivid derives numbers from times and may give one twice.
        let ticks = b.stamp.ticks.unwrap() - a.stamp.ticks.unwrap();
        assert_eq!(ticks.max(1), number(b) - number(a));
        assert_eq!(b.stamp.item, a.stamp.item + 1);
    }
    let (first, last) = (&frames[0], &frames[59]);
    let frame_ns = (host(last) - host(first)) as f64 / (number(last) - number(first)) as f64;
    assert!((frame_ns * 60.0 / 1e9 - 1.0).abs() < 0.03, "{frame_ns} ns a frame at 60 Hz");
    let age = Monotonic.now_ns() - host(last);
    // vivid stamps a frame with its nominal time, which may be one frame in the future.
    assert!((-SECOND / 30..SECOND).contains(&age), "{age}");
    assert_eq!(rig.grabber.doubtful().restamped, 0);
    let rate = rig.grabber.describe().timing.rate_hz.unwrap();
    assert!((rate - 60.0).abs() < 0.1, "{rate}");
    assert_eq!(rig.grabber.describe().image_size, Some([640, 480]));
}

/// vivid's S-Video input is interlaced, in both standards.
fn fields() {
    for (standard, lines, frame_hz) in [(Standard::Ntsc, 480, 30000.0 / 1001.0), (Standard::Pal, 576, 25.0)] {
        let settings = |interlace| GrabberSettings {
            input: Some("S-Video 0".into()),
            standard: Some(standard),
            format: Some(PixelFormat::Yuyv),
            interlace,
            ..GrabberSettings::new(CAPTURE_NODE)
        };
        let field_ns = 1e9 / frame_hz / 2.0;

        let mut rig = Rig::start(settings(Interlace::BothFields));
        let first = rig.frame();
        assert_eq!(first.size, [720, lines / 2], "{standard:?}: {:?}", rig.grabber.describe());
        let mut frames = vec![first];
        frames.extend(rig.frames(29));
        for (older, newer) in frames.iter().zip(&frames[1..]).step_by(2) {
            let numbers = [older, newer].map(|frame| frame.frame_number.unwrap());
            assert_eq!((numbers[0] % 2, numbers[1]), (0, numbers[0] + 1));
            let apart = (newer.stamp.host_ns.unwrap() - older.stamp.host_ns.unwrap()) as f64;
            assert!((apart - field_ns).abs() < 3.0, "{standard:?}: fields are {apart} ns apart");
        }
        let rate = rig.grabber.describe().timing.rate_hz.unwrap();
        assert!((rate - 2.0 * frame_hz).abs() < 0.01, "{rate}");
        rig.grabber.stop().unwrap();

        let mut rig = Rig::start(settings(Interlace::OneField));
        assert_eq!(rig.frame().size, [720, lines / 2]);
        let frames = rig.frames(10);
        assert!(frames.windows(2).all(|pair| pair[1].frame_number > pair[0].frame_number));
        rig.grabber.stop().unwrap();

        let mut rig = Rig::start(settings(Interlace::Whole));
        assert_eq!(rig.frame().size, [720, lines]);
        rig.grabber.stop().unwrap();
    }
}

/// vivid's camera is slower for larger frames: 25 Hz at 640×480, 12.5 at 1280×720, 60 at
/// 320×180.
fn camera() {
    let settings = GrabberSettings { input: Some("0".into()), ..GrabberSettings::new(CAPTURE_NODE) };
    for (rate_hz, size, gives, at) in [
        (None, None, [640, 480], 25.0),
        (Some(50.0), None, [320, 180], 50.0),
        (None, Some([1280, 720]), [1280, 720], 12.5),
        (Some(5.0), Some([320, 180]), [320, 180], 5.0),
    ] {
        let mut rig = Rig::start(GrabberSettings { rate_hz, size, ..settings.clone() });
        let frames = rig.frames(6);
        assert_eq!(frames[0].size, gives, "{rate_hz:?} {size:?}");
        let rate = rig.grabber.describe().timing.rate_hz.unwrap();
        assert!((rate - at).abs() < 0.01, "{rate_hz:?} {size:?}: {rate}");
        rig.grabber.stop().unwrap();
    }
}

fn refusals() {
    let sentence = |settings: GrabberSettings, text: &str| {
        let mut rig = Rig::start(settings);
        let deadline = Monotonic.now_ns() + SECOND / 10;
        assert!(matches!(rig.grabber.next(deadline).unwrap(), sonoweave_core::Next::Pending));
        let why = &rig.grabber.health().why;
        assert!(why.contains(text), "{why}");
        assert_eq!(rig.grabber.health().state, sonoweave_core::health::State::Absent);
    };
    sentence(
        GrabberSettings { input: Some("SCART".into()), ..hdmi() },
        "/dev/video0 cannot be set up: it has no input SCART; its inputs are Webcam",
    );
    sentence(
        GrabberSettings { format: Some(PixelFormat::Mjpg), ..hdmi() },
        "it does not offer MJPG at any size; it offers ",
    );
    sentence(
        GrabberSettings { input: Some("0".into()), size: Some([641, 480]), ..hdmi() },
        "it does not offer any format at 641×480",
    );
    sentence(GrabberSettings::new(OUTPUT_NODE), "/dev/video1 cannot be used: it captures no video");
    sentence(GrabberSettings::new("/dev/video7"), "/dev/video7 is not there; plug it in");
    sentence(GrabberSettings::new("Epiphan"), "Epiphan is not there; plug it in");
    // Another program is streaming.
    let mut other = Rig::start(hdmi());
    other.frame();
    sentence(hdmi(), "is in use by another program; close that program");
    // By name instead of by node, for the case that the number changes.
    other.grabber.stop().unwrap();
    let mut named = Rig::start(GrabberSettings { device: "platform:vivid-000".into(), ..hdmi() });
    named.frame();
    drop(named);
    drop(Vivid::open(CAPTURE_NODE));
}
