use std::sync::Arc;

use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::{Device, Next};

use super::*;
use crate::Error;

#[test]
fn missing_device_is_awaited_within_deadlines() {
    let clock = Manual::at(50 * SECOND);
    let settings = GrabberSettings::new("/dev/no-such-video");
    let mut grabber = Grabber::new(settings, Arc::new(clock.clone())).unwrap();
    assert_eq!(grabber.health().state, State::Stopped);
    assert!(matches!(grabber.next(60 * SECOND), Err(sonoweave_core::Error::Stopped(_))));
    grabber.start().unwrap();
    assert!(matches!(grabber.start(), Err(sonoweave_core::Error::Running(_))));
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
    let refused = |settings| match Grabber::new(settings, Arc::new(Manual::at(0))).err().unwrap() {
        Error::Setting { device: "grabber", setting, .. } => setting,
        other => panic!("{other}"),
    };
    assert_eq!(refused(GrabberSettings::new("")), "device");
    let buffers = |buffers| GrabberSettings { buffers, ..GrabberSettings::new("/dev/video0") };
    assert_eq!([1, 33].map(|count| refused(buffers(count))), ["buffers"; 2]);
}
