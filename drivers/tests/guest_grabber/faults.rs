//! Device faults, produced with vivid's own controls.

use drivers::grabber::GrabberSettings;
use drivers::grabber::pixels::PixelFormat;
use sonoweave_core::clock::{Clock, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::Status;
use sonoweave_core::{Device, Next};

use super::vivid::{CAPTURE_NODE, Vivid, control};
use super::{Rig, Test, hdmi};

pub(crate) const TESTS: &[Test] = &[
    ("dropped_frames_are_counted_as_lost", dropped),
    ("a_silent_device_is_set_up_anew_until_it_speaks", silent),
    ("frames_flagged_as_damaged_say_so", damaged),
    ("calls_that_fail_once_are_made_again", refused_once),
    ("a_broken_stream_is_begun_anew", broken),
    ("an_unplugged_device_is_opened_when_it_is_back", unplugged),
    ("noise_without_a_signal_is_no_picture", no_signal),
    ("numbers_go_on_when_the_kernel_s_begin_again", wrap),
    ("another_source_is_taken_over", another_source),
    ("a_consumer_that_sleeps_loses_frames_and_counts_them", sleeping),
];

fn grey() -> GrabberSettings {
    GrabberSettings { format: Some(PixelFormat::Grey), ..hdmi() }
}

fn running() -> Rig {
    let mut rig = Rig::start(grey());
    rig.frames(5);
    rig
}

fn dropped() {
    let mut rig = running();
    Vivid::open(CAPTURE_NODE).set(control::PERCENT_DROPPED, 50);
    let before = (rig.frame(), rig.grabber.health().received.lost);
    let last = rig.frames(100).pop().unwrap();
    let numbers = [&before.0, &last].map(|frame| frame.frame_number.unwrap());
    let lost = rig.grabber.health().received.lost - before.1;
    assert_eq!(numbers[1] - numbers[0], 100 + lost, "every number is a frame or a loss");
    assert!((40..260).contains(&lost), "half are dropped, and {lost} were lost beside 100");
    assert_eq!(rig.grabber.health().state, State::Running);
}

fn silent() {
    let mut rig = running();
    let vivid = Vivid::open(CAPTURE_NODE);
    vivid.set(control::PERCENT_DROPPED, 100);
    rig.until(State::Silent);
    assert_eq!(rig.grabber.health().why, "/dev/video0 delivers no frames; it is set up again");
    // The deadline is kept during every fault.
    let deadline = Monotonic.now_ns() + SECOND / 5;
    assert!(matches!(rig.grabber.next(deadline).unwrap(), Next::Pending));
    vivid.set(control::PERCENT_DROPPED, 0);
    rig.frame();
    assert_eq!((rig.grabber.health().state, rig.grabber.health().why.as_str()), (State::Running, ""));
    assert!(rig.grabber.health().received.set_up >= 2, "{:?}", rig.grabber.health());
}

fn damaged() {
    let mut rig = running();
    Vivid::open(CAPTURE_NODE).set(control::ERROR_FLAG, 1);
    let frames = rig.frames(20);
    let flagged = frames.iter().filter(|frame| frame.status == Status::Other("ERROR".into())).count();
    assert_eq!((flagged, rig.grabber.doubtful().damaged), (1, 1));
    assert!(frames.iter().filter(|frame| frame.status == Status::Ok).count() == 19);
}

fn refused_once() {
    for name in [control::REFUSE_BUFFERS, control::REFUSE_QUEUE, control::REFUSE_START] {
        Vivid::open(CAPTURE_NODE).set(name, 1);
        let mut rig = Rig::start(grey());
        rig.frame_within(2);
        let received = rig.grabber.health().received;
        assert_eq!((received.opened, received.set_up), (2, 1), "{name}");
        assert_eq!(rig.grabber.health().state, State::Running);
    }
    // While streaming: a buffer that the kernel refuses is queued again, and all buffers stay
    // in use.
    let mut rig = running();
    for _ in 0..12 {
        Vivid::open(CAPTURE_NODE).set(control::REFUSE_QUEUE, 1);
        rig.frames(3);
    }
    rig.frames(30);
    let received = rig.grabber.health().received;
    assert_eq!((received.opened, received.set_up), (1, 1), "the stream was never begun anew");
}

fn broken() {
    let mut rig = running();
    for round in 2..5 {
        Vivid::open(CAPTURE_NODE).set(control::BREAK, 1);
        // Frames filled before may still come.
        let mut frames = 0;
        while rig.grabber.health().received.set_up < round {
            rig.frame_within(2);
            frames += 1;
            assert!(frames < 100, "it was not begun anew: {:?}", rig.grabber.health());
        }
        rig.frames(10);
        assert_eq!(rig.grabber.health().state, State::Running);
    }
}

fn unplugged() {
    let mut rig = running();
    let last = rig.frame().frame_number.unwrap();
    Vivid::open(CAPTURE_NODE).set(control::DISCONNECT, 1);
    rig.until(State::Absent);
    assert_eq!(rig.grabber.health().why, "/dev/video0 was unplugged; plug it in");
    let gone = Monotonic.now_ns();
    // vivid returns when all have closed it, like a device that is plugged in again.
    let frame = rig.frame_within(2);
    assert!(frame.frame_number.unwrap() > last, "numbers go on");
    assert!(frame.stamp.host_ns.unwrap() > gone);
    assert_eq!((rig.grabber.health().state, rig.grabber.health().why.as_str()), (State::Running, ""));
    assert_eq!(rig.grabber.health().received.opened, 2);
}

fn no_signal() {
    let mut rig = running();
    assert_eq!(rig.grabber.doubtful().without_signal, 0);
    let vivid = Vivid::open(CAPTURE_NODE);
    vivid.set(control::DV_SIGNAL, 1);
    let doubtful = |frame: &sonoweave_core::reading::Frame| frame.status == Status::Other("NO SIGNAL".into());
    // The driver queries the signal four times a second.
    assert!(rig.frames(40).iter().any(doubtful), "noise went for pictures");
    assert!(doubtful(&rig.frame()));
    assert_eq!(
        rig.grabber.health().why,
        "/dev/video0 has no signal at its input; check the cable and that the scanner's output is on"
    );
    vivid.set(control::DV_SIGNAL, 0);
    for _ in 0..60 {
        if rig.frame().status == Status::Ok {
            break;
        }
    }
    assert!(rig.frames(5).iter().all(|frame| frame.status == Status::Ok));
    assert_eq!(rig.grabber.health().why, "");
}

fn wrap() {
    Vivid::open(CAPTURE_NODE).set(control::SEQUENCE_WRAP, 1);
    let mut rig = Rig::start(grey());
    let mut wrapped = false;
    let mut before = rig.frame();
    for _ in 0..200 {
        let frame = rig.frame();
        let ticks = [&before, &frame].map(|frame| frame.stamp.ticks.unwrap());
        wrapped |= ticks[1] < ticks[0];
        let step = frame.frame_number.unwrap() - before.frame_number.unwrap();
        assert_eq!(step, ((ticks[1] + (1 << 32) - ticks[0]) % (1 << 32)).max(1));
        before = frame;
        if wrapped {
            break;
        }
    }
    assert!(wrapped, "vivid's counter did not begin again within 200 frames: {:?}", before.stamp.ticks);
    assert!(rig.grabber.health().received.lost < 100, "{:?}", rig.grabber.health());
}

fn another_source() {
    let mut rig = running();
    let vivid = Vivid::open(CAPTURE_NODE);
    let before = rig.frame().size;
    assert_eq!(before, [640, 480]);
    // The source now sends other timings than those in force, selected by their index in the
    // kernel's list.
    vivid.set(control::DV_TIMINGS, 6);
    vivid.set(control::DV_SIGNAL, 4);
    let mut frames = 0;
    while rig.frame_within(5).size == before {
        frames += 1;
        assert!(frames < 300, "the new source was not noticed: {:?}", rig.grabber.health());
    }
    assert!(rig.grabber.health().received.set_up >= 2);
    let now = rig.frame().size;
    assert_eq!(rig.grabber.describe().image_size, Some(now));
    println!("the source went from {before:?} to {now:?}");
}

fn sleeping() {
    let mut rig = running();
    let before = (rig.frame().frame_number.unwrap(), rig.grabber.health().received);
    std::thread::sleep(std::time::Duration::from_secs(1));
    let last = rig.frames(40).pop().unwrap().frame_number.unwrap();
    let received = rig.grabber.health().received;
    let lost = received.lost - before.1.lost;
    assert!(lost > 20, "60 came within that second, and there are buffers for six: {lost} lost");
    assert_eq!(last - before.0, 40 + lost);
}
