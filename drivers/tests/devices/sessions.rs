//! Every device recorded as a session and replayed: the readings that it delivered live, stamps included; by the readings and by the bytes.

use std::sync::{Arc, Mutex};

use drivers::arm::ea1::Speech as Ea1Speech;
use drivers::arm::microscribe::Family;
use drivers::arm::{self, ea1, microscribe, qsb};
use drivers::clock::{Clock, MS, Manual, SECOND};
use drivers::connection::{Connection, Protocol};
use drivers::polhemus::{self, Line, fastrak, isotrak, liberty, viper};
use drivers::reading::{Frame, Reading};
use drivers::recording::session::{RecordedDevice, SessionReplay, SessionWriter, Speech, WriterOptions};
use drivers::recording::{Pace, SessionSettings};
use drivers::simulated::{self, Faults, Joints};
use drivers::transport::{MemoryOpener, Opener, Peer};
use drivers::{Device, Next};

use crate::bench::{BEGIN, Rig, ticking};
use crate::joints::moving;

/// What a device delivers in so long a time, and what it is recorded as: the clock of its readings is that of the session.
fn record(
    device: &mut dyn Device,
    clock: &Manual,
    ns: i64,
    speech: Option<Speech>,
    mut meanwhile: impl FnMut(&mut dyn Device, i64),
) -> (tempfile::TempDir, SessionSettings, Vec<String>, RecordedDevice) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("session.mcap");
    let file = std::fs::File::create_new(&path).unwrap();
    let about = drivers::recording::session::About { monotonic_ns: clock.now_ns(), ..Default::default() };
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
    let recorded = RecordedDevice { name: "it".into(), speech, description: device.describe().clone() };
    assert_eq!(session.finish(clock.now_ns()).unwrap().lost, 0);
    (folder, SessionSettings::new(path), live, recorded)
}

/// Replays at several paces; everything has to come again. How many readings that is.
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

/// A unit on a line: recorded from the beginning on, replayed by its readings and by its bytes.
fn unit<T: Peer + 'static, P: Protocol>(twin: T, protocol: P, speech: Speech) {
    let mut rig = Rig::new(twin, protocol, true);
    let clock = rig.clock.clone();
    let (_folder, settings, live, recorded) = record(&mut rig.device, &clock, 4 * SECOND, Some(speech), |_, _| {});
    let found = replayed(&settings, &live, &recorded);
    assert!(found > 150, "{found}");
    replayed(&SessionSettings { decode: true, ..settings }, &live, &recorded);
}

#[test]
fn a_fastrak_comes_again() {
    let speech = Speech::of_tracker("fastrak", &polhemus::Settings::default(), Line::Serial(None));
    let twin = simulated::fastrak::Twin::new(ticking(), Faults { drop: 0.001, ..Faults::default() });
    unit(twin, fastrak::Unit::new("it", polhemus::Settings::default(), None).unwrap(), speech);
}

#[test]
fn an_isotrak_comes_again() {
    for binary in [true, false] {
        let settings = polhemus::Settings { binary, ..polhemus::Settings::default() };
        let speech = Speech::of_tracker("isotrak", &settings, Line::Serial(None));
        let twin = simulated::isotrak::Twin::new(ticking(), Faults::slow_adapter());
        unit(twin, isotrak::Unit::new("it", settings, None).unwrap(), speech);
    }
}

#[test]
fn a_liberty_comes_again() {
    let speech = Speech::of_tracker("liberty", &polhemus::Settings::default(), Line::Serial(None));
    let twin = simulated::liberty::Twin::new(ticking(), Faults { drop: 0.0005, ..Faults::default() });
    unit(twin, liberty::Unit::new("it", polhemus::Settings::default(), None).unwrap(), speech);
}

#[test]
fn a_viper_comes_again() {
    let speech = Speech::of_tracker("viper", &polhemus::Settings::default(), Line::Serial(None));
    let twin = simulated::viper::Twin::new(ticking(), Faults { drop: 0.0005, ..Faults::default() });
    unit(twin, viper::Unit::new("it", polhemus::Settings::default(), None).unwrap(), speech);
}

#[test]
fn an_ea1_comes_again() {
    for speech in [Ea1Speech::Lines, Ea1Speech::Blocks] {
        let model = arm::Model::Ea1 { path: "/dev/x".into(), speech };
        let said = Speech::of_arm(&model, &arm::Settings::default());
        let twin = simulated::ea1::Twin::new(moving(), Faults { drop: 0.001, ..Faults::default() });
        unit(twin, ea1::Unit::new("it", arm::Settings::default(), speech).unwrap(), said);
    }
}

#[test]
fn a_microscribe_comes_again() {
    let model = arm::Model::MicroScribe { path: "/dev/x".into(), family: Family::MicroScribe, encoders: 6 };
    let said = Speech::of_arm(&model, &arm::Settings::of_14_bits());
    let protocol = microscribe::Unit::new("it", arm::Settings::of_14_bits(), Family::MicroScribe, 6).unwrap();
    unit(simulated::microscribe::Twin::new(moving(), Faults::default()), protocol, said);
}

/// Three lines; and what no bytes tell: which position the host was told is home.
#[test]
fn three_qsbs_come_again_line_by_line() {
    let clock = Manual::at(BEGIN);
    let openers = [0, 1, 2].map(|axis| -> Box<dyn Opener> {
        let twin = simulated::qsb::Twin::new(moving(), axis, Faults::default());
        Box::new(MemoryOpener::new(Arc::new(Mutex::new(twin)), clock.clone(), 9600))
    });
    let mut device = qsb::Arm::new(openers, Arc::new(clock.clone()), &arm::Settings::default(), true).unwrap();
    let path = || std::path::PathBuf::from("/dev/x");
    let speech = Speech::of_arm(&arm::Model::Qsb { paths: [path(), path(), path()] }, &arm::Settings::default());
    let mut is_home = false;
    let (_folder, settings, live, recorded) = record(&mut device, &clock, 4 * SECOND, Some(speech), |device, at| {
        if at > 2 * SECOND && !std::mem::replace(&mut is_home, true) {
            device.home(7).unwrap();
        }
    });
    assert!(is_home && replayed(&settings, &live, &recorded) > 1000);
    // By its bytes the same comes until it was told to be at home.
    let mut replay = SessionReplay::open(&SessionSettings { decode: true, ..settings }).unwrap();
    replay.start().unwrap();
    let (mut same, mut all) = (0, 0);
    while let Next::Reading(reading) = replay.next(drivers::NO_DEADLINE).unwrap() {
        // Of each count there is one, in the order in which the bytes came.
        same += usize::from(live.contains(&format!("{reading:?}")));
        all += 1;
    }
    assert_eq!(all, live.len());
    assert!(same * 2 > all && same < all, "{same} of {all}");
}

/// What was lost, opened again and homed between is in the readings, whatever the bytes say of it.
#[test]
fn a_device_that_went_away_meanwhile_comes_again() {
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
        if twin.plugged == away {
            if away { twin.unplug() } else { twin.plugged = true }
        }
        if at > 7 * SECOND && !std::mem::replace(&mut is_home, true) {
            device.home(63).unwrap();
        }
    });
    assert!(is_home && device.health().received.set_up == 2, "{:?}", device.health());
    assert!(replayed(&settings, &live, &recorded) > 500);
}

#[test]
fn the_virtual_grabber_comes_again() {
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
    // Without pictures everything else is there.
    let mut replay = SessionReplay::open(&SessionSettings { images: false, ..settings }).unwrap();
    replay.start().unwrap();
    let Next::Reading(Reading::Frame(Frame { size, pixels, .. })) = replay.next(0).unwrap() else { panic!("no frame") };
    assert_eq!((size, pixels.len()), ([96, 64], 0));
    assert_eq!(replay.describe().image_size, Some([96, 64]));
}
