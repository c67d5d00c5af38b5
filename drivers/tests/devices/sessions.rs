//! Records every device as a session and replays it: the readings equal those delivered live,
//! including stamps; from the readings and from the bytes.

use std::sync::{Arc, Mutex};

use drivers::arm::ea1::{self, SampleFormat};
use drivers::arm::microscribe::{self, Family};
use drivers::arm::{self, qsb};
use drivers::connection::{Connection, Protocol};
use drivers::replay::{Pace, SessionReplay, SessionSettings, arm_protocol, tracker_protocol};
use drivers::simulated::{self, Faults, Joints, Machine};
use drivers::tracker::polhemus::{self, Line, fastrak, isotrak, liberty, viper};
use drivers::transport::{MemoryOpener, Opener, Peer};
use formats::session::{LineProtocol, RecordedDevice, SessionWriter, WriterOptions};
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::reading::{Frame, Reading};
use sonoweave_core::{Device, Next};

use crate::bench::{BEGIN, Rig, ticking};
use crate::joints::moving;

/// Records a device's readings for `ns`. The session's clock is that of the readings.
fn record(
    device: &mut dyn Device,
    clock: &Manual,
    ns: i64,
    speech: Option<LineProtocol>,
    mut meanwhile: impl FnMut(&mut dyn Device, i64),
) -> (tempfile::TempDir, SessionSettings, Vec<String>, RecordedDevice) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let file = std::fs::File::create_new(&path).unwrap();
    let about = formats::session::About { monotonic_ns: clock.now_ns(), ..Default::default() };
    let mut session = SessionWriter::on(Box::new(file), &path, about, WriterOptions::new("a test")).unwrap();
    let source = session.device("it", speech.clone(), device.describe(), None).unwrap();
    let (end, mut live) = (clock.now_ns() + ns, Vec::new());
    device.start().unwrap();
    while clock.now_ns() < end {
        let now = clock.now_ns();
        meanwhile(device, now - (end - ns));
        match device.next((now + 10 * MS).min(end)).unwrap() {
            Next::Reading(reading) => {
                session.write(source, &reading, clock.now_ns()).unwrap();
                live.push(format!("{reading:?}"));
            }
            Next::Pending => session.tick(clock.now_ns()).unwrap(),
            Next::End => panic!("hardware does not end"),
        }
        session.describe(source, device.describe()).unwrap();
    }
    let recorded = RecordedDevice { name: "it".into(), line_protocol: speech, description: device.describe().clone() };
    assert_eq!(session.finish(clock.now_ns()).unwrap().lost, 0);
    (folder, SessionSettings::new(path), live, recorded)
}

/// Replays at several paces and checks that every reading comes again; returns their number.
fn replayed(settings: &SessionSettings, live: &[String], recorded: &RecordedDevice) -> usize {
    for (pace, device) in [(Pace::Unpaced, None), (Pace::Factor(1.0), Some("it".into())), (Pace::Factor(5.0), None)] {
        let settings = SessionSettings { pace, device, ..settings.clone() };
        let mut replay = SessionReplay::open(&settings).unwrap();
        let clock = Manual::at(3);
        replay.set_clock(Arc::new(clock.clone()));
        replay.start().unwrap();
        let mut live = live.iter();
        loop {
            match replay.next(clock.now_ns() + 7 * MS).unwrap() {
                Next::Reading(reading) => assert_eq!(Some(&format!("{reading:?}")), live.next(), "{settings:?}"),
                Next::Pending => assert_ne!(pace, Pace::Unpaced),
                Next::End => break,
            }
        }
        assert_eq!(live.next(), None, "{settings:?}");
        assert_eq!(replay.devices(), std::slice::from_ref(recorded));
    }
    live.len()
}

/// Records a unit on a line from the beginning, and replays its readings and its bytes.
fn unit<T: Peer + 'static, P: Protocol>(twin: T, protocol: P, speech: LineProtocol) {
    let mut rig = Rig::new(twin, protocol, true);
    let clock = rig.clock.clone();
    let (_folder, settings, live, recorded) = record(&mut rig.device, &clock, 4 * SECOND, Some(speech), |_, _| {});
    let found = replayed(&settings, &live, &recorded);
    assert!(found > 150, "{found}");
    replayed(&SessionSettings { decode: true, ..settings }, &live, &recorded);
}

#[test]
fn fastrak_session_replays_exactly() {
    let speech = tracker_protocol("fastrak", &polhemus::Settings::default(), Line::Serial(None));
    let twin = simulated::fastrak::Twin::new(ticking(), Faults { drop: 0.001, ..Faults::default() });
    unit(twin, fastrak::Unit::new("it", polhemus::Settings::default(), None).unwrap(), speech);
}

#[test]
fn isotrak_session_replays_exactly() {
    for binary in [true, false] {
        let settings = polhemus::Settings { binary, ..polhemus::Settings::default() };
        let speech = tracker_protocol("isotrak", &settings, Line::Serial(None));
        let twin = simulated::isotrak::Twin::new(ticking(), Faults::slow_adapter());
        unit(twin, isotrak::Unit::new("it", settings, None).unwrap(), speech);
    }
}

#[test]
fn liberty_session_replays_exactly() {
    let speech = tracker_protocol("liberty", &polhemus::Settings::default(), Line::Serial(None));
    let twin = simulated::liberty::Twin::new(ticking(), Faults { drop: 0.0005, ..Faults::default() });
    unit(twin, liberty::Unit::new("it", polhemus::Settings::default(), None).unwrap(), speech);
}

#[test]
fn viper_session_replays_exactly() {
    let speech = tracker_protocol("viper", &polhemus::Settings::default(), Line::Serial(None));
    let twin = simulated::viper::Twin::new(ticking(), Faults { drop: 0.0005, ..Faults::default() });
    unit(twin, viper::Unit::new("it", polhemus::Settings::default(), None).unwrap(), speech);
}

#[test]
fn ea1_session_replays_exactly() {
    for format in [SampleFormat::Lines, SampleFormat::Blocks] {
        let model = arm::Model::Ea1 { path: "/dev/x".into(), format };
        let text = arm_protocol(&model, &arm::Settings::default());
        let twin = simulated::ea1::Twin::new(moving(), Faults { drop: 0.001, ..Faults::default() });
        unit(twin, ea1::Unit::new("it", arm::Settings::default(), format).unwrap(), text);
    }
}

#[test]
fn microscribe_session_replays_exactly() {
    let model = arm::Model::MicroScribe { path: "/dev/x".into(), family: Family::MicroScribe, encoders: 6 };
    let text = arm_protocol(&model, &arm::Settings::of_14_bits());
    let protocol = microscribe::Unit::new("it", arm::Settings::of_14_bits(), Family::MicroScribe, 6).unwrap();
    unit(simulated::microscribe::Twin::new(moving(), Faults::default()), protocol, text);
}

/// Three lines, and a fact that is not in the bytes: the position that the host was told is
/// home.
#[test]
fn three_qsbs_session_replays_by_line() {
    let clock = Manual::at(BEGIN);
    let openers = [0, 1, 2].map(|axis| -> Box<dyn Opener> {
        let twin = simulated::qsb::Twin::new(moving(), axis, Faults::default());
        Box::new(MemoryOpener::new(Arc::new(Mutex::new(twin)), clock.clone(), 9600))
    });
    let mut device = qsb::Arm::new(openers, Arc::new(clock.clone()), &arm::Settings::default(), true).unwrap();
    let path = || std::path::PathBuf::from("/dev/x");
    let speech = arm_protocol(&arm::Model::Qsb { paths: [path(), path(), path()] }, &arm::Settings::default());
    let mut is_home = false;
    let (_folder, settings, live, recorded) = record(&mut device, &clock, 4 * SECOND, Some(speech), |device, at| {
        if at > 2 * SECOND && !std::mem::replace(&mut is_home, true) {
            device.home(7).unwrap();
        }
    });
    assert!(is_home && replayed(&settings, &live, &recorded) > 1000);
    // From its bytes, the same readings come until the arm was homed.
    let mut replay = SessionReplay::open(&SessionSettings { decode: true, ..settings }).unwrap();
    replay.start().unwrap();
    let (mut same, mut all) = (0, 0);
    while let Next::Reading(reading) = replay.next(sonoweave_core::NO_DEADLINE).unwrap() {
        // Each count occurs once, in the order of the bytes.
        same += usize::from(live.contains(&format!("{reading:?}")));
        all += 1;
    }
    assert_eq!(all, live.len());
    assert!(same * 2 > all && same < all, "{same} of {all}");
}

/// Losses, reopening and homing are in the readings, although not in the bytes.
#[test]
fn reconnected_device_session_replays_exactly() {
    let joints: Joints = moving();
    let twin = Arc::new(Mutex::new(simulated::microscribe::Twin::new(joints, Faults::default())));
    let clock = Manual::at(BEGIN);
    let opener = MemoryOpener::new(Arc::clone(&twin), clock.clone(), 9600);
    let protocol = microscribe::Unit::new("it", arm::Settings::of_14_bits(), Family::MicroScribe, 6).unwrap();
    let mut device = Connection::new(Box::new(opener), Arc::new(clock.clone()), protocol, true);
    let mut is_home = false;
    let (_folder, settings, live, recorded) = record(&mut device, &clock, 8 * SECOND, None, |device, at| {
        let mut twin = twin.lock().unwrap();
        let away = (3 * SECOND..4 * SECOND).contains(&at);
        if twin.wire.plugged == away {
            if away { twin.unplug() } else { twin.wire.plugged = true }
        }
        if at > 7 * SECOND && !std::mem::replace(&mut is_home, true) {
            device.home(63).unwrap();
        }
    });
    assert!(is_home && device.health().received.set_up == 2, "{:?}", device.health());
    assert!(replayed(&settings, &live, &recorded) > 500);
}

#[test]
fn virtual_grabber_session_replays_exactly() {
    let clock = Manual::at(BEGIN);
    let pictures: simulated::grabber::Pictures = Box::new(|ns, pixels| {
        let at = (ns / MS) as usize;
        pixels.iter_mut().enumerate().for_each(|(n, pixel)| *pixel = ((n * n / 90 + at) % 251) as u8);
    });
    let faults = Faults { dropout: 0.02, noise: 0.02, latency_ns: 20 * MS, jitter_ns: 3 * MS, ..Faults::default() };
    let mut device =
        simulated::grabber::Grabber::new(pictures, [96, 64], 30.0, faults, Arc::new(clock.clone())).unwrap();
    let controls = device.controls();
    let (_folder, settings, live, recorded) = record(&mut device, &clock, 5 * SECOND, None, |_, at| {
        controls.lock().unwrap().signal = !(2 * SECOND..3 * SECOND).contains(&at);
    });
    assert!(replayed(&settings, &live, &recorded) > 130);
    // Without images everything else is present.
    let mut replay = SessionReplay::open(&SessionSettings { images: false, ..settings }).unwrap();
    replay.start().unwrap();
    let Next::Reading(Reading::Frame(Frame { size, pixels, .. })) = replay.next(0).unwrap() else { panic!("no frame") };
    assert_eq!((size, pixels.len()), ([96, 64], 0));
    assert_eq!(replay.describe().image_size, Some([96, 64]));
}
