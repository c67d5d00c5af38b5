use std::sync::Arc;

use sonoweave_core::Next;
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::health::State;

use super::*;

#[test]
fn missing_device_is_awaited_within_deadlines() {
    let clock = Manual::at(50 * SECOND);
    let settings = GrabberSettings::new("/dev/no-such-video");
    let mut grabber = Grabber::new(settings, Arc::new(clock.clone())).unwrap();
    assert_eq!(grabber.health().state, State::Stopped);
    assert!(grabber.next(60 * SECOND).unwrap_err().to_string().contains("is stopped; start it first"));
    grabber.start().unwrap();
    assert!(grabber.start().unwrap_err().to_string().contains("runs already; stop it first"));
    for deadline_ns in [50 * SECOND + 30 * MS, 51 * SECOND, 52 * SECOND] {
        assert!(matches!(grabber.next(deadline_ns).unwrap(), Next::Pending));
        assert_eq!(clock.now_ns(), deadline_ns, "it waits until the deadline and no longer");
    }
    let health = grabber.health();
    assert_eq!((health.state, health.since_ns), (State::Absent, 50 * SECOND));
    assert_eq!(health.why, "/dev/no-such-video is not there; plug it in");
    assert_eq!(health.received.opened, 0);
    grabber.stop().unwrap();
    assert_eq!(grabber.health().state, State::Stopped);
}

#[test]
fn other_device_is_reported_as_no_video_device() {
    let mut grabber = Grabber::new(GrabberSettings::new("/dev/null"), Arc::new(Manual::at(SECOND))).unwrap();
    grabber.start().unwrap();
    assert!(matches!(grabber.next(2 * SECOND).unwrap(), Next::Pending));
    let health = grabber.health();
    assert_eq!(health.state, State::Absent);
    assert!(health.why.starts_with("/dev/null cannot be opened: "), "{}", health.why);
    assert!(health.received.opened > 1, "it is tried again");
}

#[test]
fn impossible_settings_are_refused_before_opening() {
    let refused = |settings| Grabber::new(settings, Arc::new(Manual::at(0))).err().unwrap().to_string();
    assert!(refused(GrabberSettings::new("")).contains("needs the name of its device"));
    let buffers = |buffers| GrabberSettings { buffers, ..GrabberSettings::new("/dev/video0") };
    assert_eq!(refused(buffers(1)), "/dev/video0: 1 buffers; a stream needs 2 to 32");
    assert_eq!(refused(buffers(33)), "/dev/video0: 33 buffers; a stream needs 2 to 32");
    let wrong = GrabberDriver.open(&OpenSettings::sequence("sweep.mha")).err().unwrap();
    assert!(wrong.to_string().contains("opens video devices"), "{wrong}");
}
