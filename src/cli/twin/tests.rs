use clap::Parser;

use drivers::OpenSettings;
use drivers::arm::{ArmSettings, Model as ArmModel, Settings as ArmSetup, ea1::SampleFormat};
use drivers::simulated::Placed;
use drivers::tracker::polhemus::{Model, Port as TrackerPort, Settings, TrackerSettings};
use sonoweave_core::reading::Reading;
use sonoweave_core::{Device, Next};

use super::*;

#[derive(Debug, Parser)]
struct Line {
    #[command(flatten)]
    arguments: Arguments,
}

fn arguments(flags: &str) -> Arguments {
    Line::try_parse_from(std::iter::once("twin").chain(flags.split_whitespace())).unwrap().arguments
}

fn refusal(flags: &str) -> String {
    play(&arguments(flags), 0, &AtomicBool::new(true), &mut Vec::new())
        .err()
        .map_or(String::new(), |failure| failure.0.sentence)
}

/// Simulates with a link in a temporary folder while `action` uses it. Returns the output.
fn playing(flags: &str, action: impl FnOnce(&Path, &Arguments, i64)) -> String {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("line");
    let arguments = Arguments { link: Some(link.clone()), ..arguments(flags) };
    let begin_ns = Monotonic.now_ns();
    let ends = AtomicBool::new(false);
    let said = std::thread::scope(|scope| {
        let player = scope.spawn(|| {
            let mut said = Vec::new();
            play(&arguments, begin_ns, &ends, &mut said).map(|()| said)
        });
        // A panic in `action` must not leave the simulation running.
        let done = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| action(&link, &arguments, begin_ns)));
        ends.store(true, Ordering::Relaxed);
        let said = player.join().unwrap().unwrap_or_else(|failure| panic!("{}", failure.0.sentence));
        if let Err(panic) = done {
            std::panic::resume_unwind(panic);
        }
        said
    });
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "no link is left");
    String::from_utf8(said).unwrap()
}

/// Reads `wanted` readings of a device that exists, or appears soon.
fn readings(settings: &OpenSettings, wanted: usize) -> Vec<Reading> {
    let mut device: Box<dyn Device> = drivers::open(settings).unwrap();
    device.start().unwrap();
    let end = Monotonic.now_ns() + 30 * SECOND;
    let mut found = Vec::new();
    while found.len() < wanted {
        assert!(Monotonic.now_ns() < end, "{:?}", device.health());
        if let Next::Reading(reading) = device.next(Monotonic.now_ns() + 50 * MS).unwrap() {
            found.push(reading);
        }
    }
    device.stop().unwrap();
    found
}

#[test]
fn drivers_open_twins_and_read_exact_poses() {
    let cases = [
        ("fastrak --found inches", Model::Fastrak, 60.0),
        ("fastrak --found mid-record --trajectory parallel", Model::Fastrak, 60.0),
        ("liberty --found wrong-mode --seed 3", Model::Liberty, 240.0),
        ("viper --found streaming --rate 120", Model::Viper, 240.0),
    ];
    for (flags, model, hz) in cases {
        let said = playing(flags, |link, arguments, begin_ns| {
            let port = TrackerPort::Serial { path: link.into(), baud: Some(115_200) };
            let settings = Settings { stations: vec![1, 2], ..Settings::default() };
            let settings = OpenSettings::Tracker(TrackerSettings { model, port, settings, keeps_raw: false });
            let motion = arguments.motion(begin_ns).unwrap();
            for reading in readings(&settings, 40) {
                let Reading::Pose(pose) = reading else { panic!("{reading:?}") };
                // The unit measures at multiples of its cycle; the position identifies the
                // cycle.
                let last = (pose.stamp.host_ns.unwrap() as f64 * 1e-9 * hz) as i64;
                let is_that_of = |cycle: i64| {
                    let at_ns = (cycle as f64 / hz * 1e9) as i64;
                    let Placed { position_cm, quaternion_wxyz } = motion(pose.station, at_ns);
                    let off = (0..3).map(|i| (pose.position_cm[i] - position_cm[i]).abs()).fold(0.0, f64::max);
                    let dot: f64 = (0..4).map(|i| pose.quaternion_wxyz[i] * quaternion_wxyz[i]).sum();
                    off < 1e-5 && (1.0 - dot.abs()) < 1e-6
                };
                let exact = (last - 2 * hz as i64..=last).rev().any(is_that_of);
                assert!(exact, "{flags}: {pose:?}");
            }
        });
        assert!(said.contains(", linked from ") && said.contains("to and fro"), "{said}");
        assert!(said.contains("obeyed: ") && said.contains("bytes sent, 0 of them lost"), "{said}");
    }
}

#[test]
fn arm_counts_are_read_exactly() {
    let said = playing("ea1 --found wrong-mode --counts-per-turn 100000", |link, arguments, begin_ns| {
        let model = ArmModel::Ea1 { path: link.into(), format: SampleFormat::Lines };
        let settings = OpenSettings::Arm(ArmSettings { model, settings: ArmSetup::default(), keeps_raw: false });
        let joints = arguments.joints(begin_ns).unwrap();
        for reading in readings(&settings, 60) {
            let Reading::Counts(counts) = reading else { panic!("{reading:?}") };
            // Its clock shows whole µs since the beginning.
            let at_ns = begin_ns + i64::try_from(counts.stamp.ticks.unwrap()).unwrap() * 1000;
            let [from, to] = [joints(at_ns), joints(at_ns + 1000)];
            let shown = counts.as_slice();
            assert!((0..3).all(|i| shown[i] == from[i] || shown[i] == to[i]), "{counts:?} {from:?}");
            assert_eq!(counts.homed, 7);
        }
    });
    assert!(said.contains("ea1, arm of 3 joints, 100000 counts a turn, found wrong-mode: arm sweep"), "{said}");
}

#[test]
fn three_axes_three_terminals_replugged_under_same_name() {
    let said = playing("qsb --unplug-every 0.3", |link, _, _| {
        let axis = |n: u8| link.with_file_name(format!("line{n}"));
        let end = Monotonic.now_ns() + 20 * SECOND;
        let mut seen: Vec<PathBuf> = Vec::new();
        while seen.len() < 2 {
            assert!(Monotonic.now_ns() < end, "{seen:?}");
            // It points to a former terminal, or to a present one.
            if let Ok(target) = std::fs::read_link(axis(3))
                && target.exists()
                && !seen.contains(&target)
            {
                seen.push(target);
            }
            // The kernel reuses numbers. A target that was gone in between counts again.
            if let Some(target) = seen.last()
                && !target.exists()
            {
                while !std::fs::read_link(axis(3)).is_ok_and(|target| target.exists()) {
                    assert!(Monotonic.now_ns() < end);
                    std::thread::sleep(TURN);
                }
                break;
            }
            std::thread::sleep(TURN / 4);
        }
        assert!(axis(1).is_symlink() && axis(2).is_symlink());
    });
    let lines = |of: &str| said.lines().filter(|line| line.contains(of)).count();
    assert!(lines("qsb axis 3, linked from") >= 2 && lines("unplugged for 2 s") >= 1, "{said}");
    assert!(said.contains("no program sent a command"), "{said}");
}

#[test]
fn unsupported_setting_refused_with_choices() {
    let cases = [
        (
            "fastrak --found unhomed",
            "is not possible for fastrak; give one of quiet, streaming, wrong-mode, inches, mid-record, deaf",
        ),
        ("qsb --found inches", "give one of quiet, streaming, wrong-mode"),
        ("fastrak --rate 60", "has a fixed rate"),
        ("liberty --rate 100", "supports [60, 120, 240] readings a second"),
        ("isotrak --stations 2", "give 1 to 1"),
        ("ea1 --stations 1", "is an arm and has no stations"),
        ("ea1 --noise 1,1", "counts have no noise"),
        ("viper --counts-per-turn 5", "is a tracker and has no counts"),
        ("ea1 --trajectory freehand", "choose a motion in a plane"),
        ("ea1 --gap 50", "beyond the arm's reach by"),
        ("viper --latency 2000000", "must lie between 0 and 1000000"),
        ("viper --unplug-every 0.01", "must be 0.1 s or more"),
        ("viper --frames 0", "a scan of 0 frames"),
    ];
    for (flags, expected) in cases {
        let why = refusal(flags);
        assert!(why.contains(expected), "{flags}: {why}");
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("notes");
    std::fs::write(&file, "mine").unwrap();
    let why = refusal(&format!("viper --link {}", file.display()));
    assert!(why.contains("is not a link; give another name"), "{why}");
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "mine");
    assert!(
        Line::try_parse_from(["twin", "viper", "--drop", "1.5"])
            .unwrap_err()
            .to_string()
            .contains("fraction from 0 to 1")
    );
}

#[test]
fn words_formats_commands() {
    assert_eq!(words(b"O2,11,1\r"), "O2,11,1");
    assert_eq!(words(b"\x19"), "^Y");
    assert_eq!(words(b"\r"), "end of line");
    assert_eq!(words(&[0xc2]), "c2");
    assert_eq!(words(&drivers::tracker::polhemus::viper::Command::WhoAmI.bytes()), "get 20");
    let mut asked = BTreeMap::from([("P".to_owned(), 3)]);
    asked.insert("c".into(), 1);
    let tally = Tally { bytes: 1000, dropped: 5, garbled: 2, withheld: 1 };
    assert_eq!(
        summary(12.34, tally, &asked),
        "12.3 s: 1000 bytes sent, 5 of them lost and 2 garbled; 1 records not sent\nobeyed: P ×3; c ×1\n"
    );
    let said =
        arguments("liberty --noise 0.3,0.1 --garble 0.001 --dropout 0.01 --drift -40 --jitter 2").describe().unwrap();
    assert!(said.starts_with("liberty, 2 sensors, found quiet: freehand sweep of 120 poses"), "{said}");
    assert!(
        said.ends_with(
            "faults: noise of 0.3 mm and 0.1°, 0.1 % garbled, 1 % of records not sent, clock off by -40 parts in a million, up to 2 ms of jitter"
        ),
        "{said}"
    );
}

#[test]
fn packets_of_bytes_arrive_together() {
    let arrivals = |flags: &str| {
        let mut apart = Vec::new();
        let said = playing(flags, |link, _, _| {
            let port = TrackerPort::Serial { path: link.into(), baud: Some(115_200) };
            let settings = Settings { stations: vec![1], ..Settings::default() };
            let settings =
                OpenSettings::Tracker(TrackerSettings { model: Model::Liberty, port, settings, keeps_raw: false });
            let times = readings(&settings, 120).into_iter().map(|reading| match reading {
                Reading::Pose(pose) => pose.stamp.host_ns.unwrap(),
                other => panic!("{other:?}"),
            });
            let times: Vec<i64> = times.collect();
            apart = times.windows(2).map(|two| two[1] - two[0]).collect();
        });
        (apart, said)
    };
    // At 240 a second, fifty of them arrive within 208 ms, and with one packet in 100 ms most of
    // them with another one.
    let (apart, said) = arrivals("liberty --packets 100");
    let together = apart.iter().filter(|ns| **ns < MS).count();
    assert!(together * 4 > apart.len() * 3, "{together} of {}", apart.len());
    assert!(said.contains("packets every 100 ms"), "{said}");
    for flag in ["--packets=-1", "--packets nan"] {
        let why = refusal(&format!("liberty {flag}"));
        assert!(why.contains("packets"), "{why}");
    }
}
