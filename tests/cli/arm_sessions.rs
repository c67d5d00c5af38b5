//! Sessions of an arm: the insertion path follows from its joints and the calibration, live and
//! replayed alike, for each way of compounding. Counts and poses are those of the true motion.

use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DVec3};
use serde_json::Value;

use config::bedside::{Bedside, VirtualBedside};
use drivers::replay::{SessionReplay, SessionSettings};
use phantom::bedside::arm::BedsideArm;
use sonoweave_core::clock::MS;
use sonoweave_core::frames::affine_from_rows;
use sonoweave_core::reading::{Counts, Reading, Status};
use sonoweave_core::{Device, NO_DEADLINE, Next};

use super::place::Place;

/// A virtual arm whose image is perpendicular to the plane in which it moves. Its linear probe
/// gives a rectangle.
const ARM: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[arm]\nkind = \"ea1\"\nport = \"virtual\"\n\
    [grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\nrate_hz = 20\n\
    [picture]\nimage_size = \"64x64\"\ntransfer = \"phantom\"\n[virtual]\nframes = 40\n\
    [volume]\nspacing_mm = 1.0\n";

/// Records a session with this way of compounding, and replays it with a picture after each slice.
/// Returns the statistics of the session and of the replay.
fn session(compounding: &str) -> [Value; 2] {
    let place = Place::new();
    place.put("arm.toml", format!("{ARM}compound = \"{compounding}\"\n"));
    // The virtual arm passes its index marks within 3 s.
    let live = place.run("live --config arm.toml --duration 5 --record s -o v.mha --picture p.png --json=live.json");
    assert_eq!(live.code, 0, "{}", live.stderr);
    let recorded = std::fs::read_dir(place.path("s")).unwrap().next().unwrap().unwrap().path();
    std::fs::create_dir(place.path("p")).unwrap();
    let again = place.run(&format!("replay {} -o again.mha --pictures p --json=again.json", recorded.display()));
    assert_eq!(again.code, 0, "{}", again.stderr);
    assert!(again.stderr.contains("the same as in the live session, bit by bit"), "{}", again.stderr);
    assert!(place.get("v.mha") == place.get("again.mha"), "{compounding}");
    ["live.json", "again.json"].map(|file| place.json(file))
}

/// Runs both sessions at once: they mostly wait for their devices.
fn sessions(compoundings: [&str; 2]) -> [[Value; 2]; 2] {
    std::thread::scope(|scope| {
        let begun = compoundings.map(|compounding| scope.spawn(move || session(compounding)));
        begun.map(|session| session.join().unwrap())
    })
}

#[test]
fn arm_takes_planar_path_by_itself_for_mean_and_decay() {
    let both = sessions(["mean", "decay"]);
    for [live, _] in &both {
        let faults = &live["page_faults"];
        assert!(["insertion", "rendering"].iter().all(|stage| faults[stage].is_u64()), "{live}");
    }
    for statistics in both.iter().flatten() {
        assert_eq!(statistics["path"], "planar", "{statistics}");
        assert_eq!(statistics["path_reason"], "all poses are perpendicular to one plane, to 0.000 voxel");
    }
    // The first picture of a box shows all of the volume; the box grows seldom. Decay changes what
    // lies outside the slab, too.
    let count = |at: usize, key: &str| both.each_ref().map(|it| it[at][key].as_u64().unwrap());
    let [live, replayed] = [0, 1].map(|at| (count(at, "pictures"), count(at, "pictures_by_slab")));
    let (pictures, by_slab) = replayed;
    assert!(pictures[0] > 5 && 2 * by_slab[0] > pictures[0], "{replayed:?}");
    // A live picture is of one slab where no slice came meanwhile: 44 of 47 beside a build on
    // two processors. On a busier machine it may be none, as several slices come between pictures.
    let slices = both[0][0]["frames"]["used"].as_u64().unwrap();
    assert!(live.1[0] > 0 || 2 * live.0[0] < slices, "{live:?} of {slices} slices");
    assert_eq!([live.1[1], by_slab[1]], [0, 0]);
}

#[test]
fn arm_takes_general_path_for_maximum_and_latest() {
    let compoundings = ["maximum", "latest"];
    for (compounding, both) in compoundings.iter().zip(sessions(compoundings)) {
        for statistics in both {
            assert_eq!(statistics["path"], "general", "{statistics}");
            let why = format!("the planar path has no way for the compounding {compounding}");
            assert_eq!(statistics["path_reason"], why);
        }
    }
}

/// The example with small frames, and a sweep of three seconds.
fn example() -> String {
    let text = include_str!("../../docs/examples/virtual-arm.toml");
    let shorter = [
        ("size = \"640x480\"", "size = \"96x80\""),
        ("clip_px = [242, 48, 156, 300]", "clip_px = [37, 8, 22, 60]"),
        ("spacing_mm = 0.5", "spacing_mm = 1.0"),
        ("image_size = \"512x512\"", "image_size = \"64x64\""),
        ("frames = 300", "frames = 90"),
    ];
    shorter.into_iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

/// A frame's pose as the session inserted it.
struct Posed {
    at_ns: i64,
    world_from_image: DAffine3,
    /// Time between the two readings that it lies between, ns.
    gap_ns: i64,
    /// Stated bound on the corners' error by their times, mm.
    error_mm: f64,
}

/// Longest time between readings at which the probe's way between them is straight enough: the
/// arm sends one every 10 ms.
const MOST_GAP: i64 = 15 * MS;

/// Reads an arm's counts, their known delay (ns) and the poses of frames from a session.
fn read(session: &Path) -> (Vec<Counts>, i64, Vec<Posed>) {
    let mut replay = SessionReplay::open(&SessionSettings { images: false, ..SessionSettings::new(session) }).unwrap();
    replay.start().unwrap();
    let (mut counts, mut placed) = (Vec::new(), Vec::new());
    loop {
        match replay.next(NO_DEADLINE).unwrap() {
            Next::Reading(Reading::Counts(read)) => counts.push(read),
            Next::Reading(Reading::Recorded(note)) if note.topic == "placed" => {
                let note: Value = serde_json::from_str(&note.text).unwrap();
                let rows = note["world_from_image"].as_array().unwrap().iter().map(|x| x.as_f64().unwrap());
                let rows: Vec<f64> = rows.chain([0.0, 0.0, 0.0, 1.0]).collect();
                placed.push(Posed {
                    at_ns: note["time_ns"].as_i64().unwrap(),
                    world_from_image: affine_from_rows(rows.as_slice().try_into().unwrap()).unwrap(),
                    gap_ns: note["gap_ns"].as_i64().unwrap(),
                    error_mm: note["error_mm"].as_f64().unwrap_or(f64::INFINITY),
                });
            }
            Next::End => break,
            _ => {}
        }
    }
    let timing = replay.devices().iter().find(|device| device.name == "tracking").unwrap().description.timing;
    (counts, timing.wire_ns + timing.sampling_ns, placed)
}

/// The virtual arm of a configuration, whose sweep begins at a time.
struct Truth {
    held: BedsideArm,
    corners: [DVec3; 4],
}

impl Truth {
    fn new(config: &Path, begin_ns: i64) -> Self {
        let bedside = Bedside::read(config).unwrap();
        let scan = &bedside.virtual_bedside.as_ref().unwrap().scan;
        let hand = Arc::new(phantom::Bedside::new(phantom::Scan::clone(scan), begin_ns));
        let [right, bottom] = scan.settings().image_size.map(|n| f64::from(n) - 1.0);
        Self {
            held: VirtualBedside::carried(hand, 40_000).unwrap(),
            corners: [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]].map(|[u, v]| DVec3::new(u, v, 0.0)),
        }
    }

    /// Returns the error of a pose's worst corner at a time, mm.
    fn off_mm(&self, pose: &DAffine3, at_ns: i64) -> f64 {
        let truth = self.held.tracker_from_image(at_ns);
        let off = |corner: DVec3| (pose.transform_point3(corner) - truth.point(corner)).length();
        self.corners.map(off).into_iter().fold(0.0, f64::max)
    }

    /// Returns how far the path of the worst corner bends between two readings, mm: a pose between
    /// them is interpolated. It is 0.003 mm at most on an idle machine, whose readings lie close.
    fn bend_mm(&self, at_ns: i64, gap_ns: i64) -> f64 {
        let [before, truth, after] = [-gap_ns / 2, 0, gap_ns / 2].map(|ns| self.held.tracker_from_image(at_ns + ns));
        let bend = |corner: DVec3| (0.5 * (before.point(corner) + after.point(corner)) - truth.point(corner)).length();
        self.corners.map(bend).into_iter().fold(0.0, f64::max)
    }
}

#[test]
fn example_of_arm_replays_and_matches_truth() {
    let place = Place::new();
    place.put("arm.toml", example());
    let live = place.run(
        "live --config arm.toml --duration 7 --record s -o v.mha --weights w.mha --picture p.png --json=live.json",
    );
    assert_eq!(live.code, 0, "{}", live.stderr);
    let session = std::fs::read_dir(place.path("s")).unwrap().next().unwrap().unwrap().path();
    let again = place
        .run(&format!("replay {} -o v2.mha --weights w2.mha --picture p2.png --json=again.json", session.display()));
    assert_eq!(again.code, 0, "{}", again.stderr);
    for (one, other) in [("v.mha", "v2.mha"), ("w.mha", "w2.mha"), ("p.png", "p2.png")] {
        assert!(place.get(one) == place.get(other), "{one}");
    }
    let [live, again] = ["live.json", "again.json"].map(|file| place.json(file));
    assert_eq!((&live["path"], &again["path"]), (&"planar".into(), &"planar".into()), "{live}");
    assert_eq!((&again["differences"], &again["first_difference"]), (&0.into(), &Value::Null));
    let seen = |stats: &Value| [&stats["digest"], &stats["frames"]["used"]].map(Value::clone);
    assert_eq!(seen(&live), seen(&again));

    // The arm's clock shows 0 when the sweep begins, and counts are latched at its times.
    let (counts, known_delay_ns, placed) = read(&session);
    let by_own_clock = Truth::new(&place.path("arm.toml"), 0);
    let homed = counts.iter().filter(|read| read.status == Status::Ok);
    let latched: Vec<(i64, &Counts)> =
        homed.map(|read| (i64::try_from(read.stamp.ticks.unwrap()).unwrap() * 1000, read)).collect();
    assert!(latched.len() > 100, "{}", latched.len());
    for (at_ns, read) in &latched {
        let counts = |at_ns: i64| by_own_clock.held.arm().counts(&by_own_clock.held.values(at_ns));
        // The clock has steps of 1 µs, in which a joint moves by hundredths of a count.
        let [before, exact, after] = [-1000, 0, 1000].map(|off_ns| counts(at_ns + off_ns));
        for axis in 0..exact.len() {
            let off = (exact[axis] - read.as_slice()[axis] as f64).abs();
            assert!(off < 0.501 + (after[axis] - before[axis]).abs(), "{exact:?} {read:?}");
        }
    }

    // The reading with the shortest delay waited for its line only.
    let delays = latched.iter().map(|(at_ns, read)| read.stamp.host_ns.unwrap() - at_ns);
    let begin_ns = delays.min().unwrap() - known_delay_ns;
    let truth = Truth::new(&place.path("arm.toml"), begin_ns);
    let resolution = truth.held.resolution_mm();
    let moving = placed.iter().filter(|posed| posed.at_ns > begin_ns && posed.gap_ns < MOST_GAP);
    let moving: Vec<&Posed> = moving.collect();
    assert!(moving.len() > 10 && 5 * moving.len() > 4 * placed.len(), "{} of {}", moving.len(), placed.len());
    let (mut farthest, mut beyond) = (0.0_f64, f64::MIN);
    for posed in moving {
        assert!(posed.error_mm.is_finite(), "a pose states no error of its time");
        // The true pose that is nearest within 200 ms: the pose lies on the true path, whatever its
        // time is.
        let off = |at_ns: i64| truth.off_mm(&posed.world_from_image, at_ns);
        let near = (-200..=200).map(|step| posed.at_ns + step * MS);
        let near = near.min_by(|one, other| off(*one).total_cmp(&off(*other))).unwrap();
        let nearest = (-10..=10).map(|step| off(near + step * MS / 10)).fold(f64::INFINITY, f64::min);
        let bend = truth.bend_mm(near, posed.gap_ns);
        farthest = farthest.max(nearest - bend);
        beyond = beyond.max(truth.off_mm(&posed.world_from_image, posed.at_ns) - posed.error_mm - bend);
    }
    assert!(farthest < resolution && beyond < resolution, "{farthest} {beyond} {resolution}");
}
