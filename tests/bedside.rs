//! Tests the virtual bedside from the device's bytes to the slice's pose. The clocks of trackers,
//! arm and grabber drift, and their data are late, early, delayed and jittered. The poses of the
//! frames are compared with the hand's.

#![allow(
    clippy::print_stdout,
    clippy::unwrap_used,
    reason = "figures for who asks with --nocapture; a test that cannot be set up has failed"
)]

use std::sync::{Arc, Mutex};

use glam::{DAffine3, DVec3};

use drivers::arm::{Settings as ArmSettings, ea1};
use drivers::connection::{Connection, Protocol};
use drivers::simulated::grabber::Grabber;
use drivers::simulated::{Faults, Machine, ea1 as virtual_ea1, fastrak as virtual_fastrak, liberty as virtual_liberty};
use drivers::tracker::polhemus::{Settings, fastrak, liberty};
use drivers::transport::{MemoryOpener, Peer};
use phantom::bedside::arm::{BedsideArm, standard_arm};
use phantom::bedside::{PROBE_STATION, REFERENCE_STATION};
use phantom::{Bedside, Motion, Scan, ScanSettings};
use sonoweave_core::clock::{Clock, MS, Manual, SECOND};
use sonoweave_core::named::StaticTransform;
use sonoweave_core::{Device, Next};
use sync::PairingOptions;
use sync::clock::{State, TimeFlags};
use sync::history::{How, Rigid};
use sync::ingest::live::{Gives, Live, LiveIngest};
use sync::pairing::timed::{Answered, FrameTime, Placed, Source, TimedOptions, TimedPairing};

const BEGIN: i64 = 7 * SECOND;
const SIZE: [u32; 2] = [64, 48];
/// Latency of the grabber's frames beyond their acquisition, as a calibration would give it.
const VIDEO_LATENCY: i64 = 40 * MS;
const TRACKER_LATENCY: i64 = 6 * MS;

fn bedside(motion: Motion) -> Arc<Bedside> {
    let settings = ScanSettings {
        motion,
        frames: 120,
        gap_mm: 0.5,
        image_size: SIZE,
        pixel_mm: [0.8, 0.8],
        ..ScanSettings::default()
    };
    Arc::new(Bedside::new(Scan::new(settings).unwrap(), BEGIN))
}

/// The device that carries the probe, as the pairing knows it.
struct Carrier {
    gives: Gives,
    sources: Vec<Source>,
    /// Pixels to mm at the probe, row by row.
    probe_from_image: [f64; 16],
    /// Pixels to world mm at a time.
    truth: Box<dyn Fn(i64) -> DAffine3>,
    /// Error of its positions, mm.
    resolution_mm: f64,
}

impl Carrier {
    fn tracker(bedside: &Arc<Bedside>) -> Self {
        let own = Arc::clone(bedside);
        Self {
            gives: Gives::Stations(vec![PROBE_STATION, REFERENCE_STATION]),
            sources: vec![Source::new("Probe", "Tracker"), Source::new("Reference", "Tracker")],
            probe_from_image: bedside.scan().probe_from_image().to_rows(),
            truth: Box::new(move |at_ns| own.world_from_image(at_ns).affine()),
            // Its records have more digits than matter here.
            resolution_mm: 0.0,
        }
    }

    fn arm(held: &Arc<BedsideArm>) -> Self {
        let (own, arm) = (Arc::clone(held), *held.arm());
        let kinematics = move |counts: &[f64]| {
            let values = std::array::from_fn(|axis| arm.joints()[axis].value(counts[axis]));
            let pose = arm.pose(&values).tracker_from_probe().affine();
            let (_, rotation, position_mm) = pose.to_scale_rotation_translation();
            Some(Rigid { rotation, position_mm })
        };
        Self {
            gives: Gives::Arm { joints: 3, kinematics: Box::new(kinematics), reach: Vec::new() },
            sources: vec![Source::new("Probe", "Tracker")],
            probe_from_image: held.probe_from_image().to_rows(),
            truth: Box::new(move |at_ns| own.tracker_from_image(at_ns).affine()),
            resolution_mm: held.resolution_mm(),
        }
    }
}

/// Outcome of the frames of a run.
struct Run {
    truth: Box<dyn Fn(i64) -> DAffine3>,
    resolution_mm: f64,
    /// Frame number, true acquisition time, and result.
    answered: Vec<(i64, Answered<i64>)>,
    states: [State; 2],
}

/// Runs a tracker or arm and a grabber for `seconds`. A frame carries its acquisition time, for the
/// comparison only.
fn run<P: Protocol, T: Peer + 'static>(
    carrier: Carrier,
    twin: T,
    unit: P,
    video: Faults,
    seconds: i64,
    disturb: impl Fn(i64, &Mutex<T>),
) -> Run {
    let clock = Manual::at(BEGIN - SECOND);
    let twin = Arc::new(Mutex::new(twin));
    let opener = MemoryOpener::new(Arc::clone(&twin), clock.clone(), 115_200);
    let mut tracker = Connection::new(Box::new(opener), Arc::new(clock.clone()), unit, false);
    let seen = Box::new(|at_ns: i64, pixels: &mut [u8]| pixels[..8].copy_from_slice(&at_ns.to_le_bytes()));
    let mut grabber = Grabber::new(seen, SIZE, 30.0, video, Arc::new(clock.clone())).unwrap();
    tracker.start().unwrap();
    grabber.start().unwrap();
    let Carrier { gives, sources, probe_from_image, truth, resolution_mm } = carrier;
    let mut gives = Some(gives);
    let mut poses: Option<LiveIngest> = None;
    let mut set_up = 0;
    let mut pictures = LiveIngest::new(Gives::Pictures, grabber.describe().timing, VIDEO_LATENCY);
    let mut region = TimedPairing::new(TimedOptions {
        pairing: PairingOptions {
            statics: vec![StaticTransform::new("Image", "Probe", &probe_from_image).unwrap()],
            ..PairingOptions::default()
        },
        sources,
        ..TimedOptions::default()
    })
    .unwrap();
    let mut answered = Vec::new();
    while clock.now_ns() < BEGIN + seconds * SECOND {
        disturb(clock.now_ns(), &twin);
        let deadline = clock.now_ns() + 2 * MS;
        if let Next::Reading(reading) = tracker.next(deadline).unwrap() {
            let timing = tracker.describe().timing;
            let times = tracker.health().received.set_up;
            let live =
                poses.get_or_insert_with(|| LiveIngest::new(gives.take().expect("once"), timing, TRACKER_LATENCY));
            if std::mem::replace(&mut set_up, times) != times {
                live.set_up(timing);
            }
            if let Live::Pose { source, sample, .. } = live.take(reading) {
                region.pose(source, sample);
            }
        }
        while let Next::Reading(reading) = grabber.next(clock.now_ns()).unwrap() {
            if let Live::Picture { picture, timed } = pictures.take(reading) {
                let sonoweave_core::slice::Pixels::U8(pixels) = picture.image.pixels() else { panic!("8 bits") };
                let seen_ns = i64::from_le_bytes(pixels[..8].try_into().unwrap());
                let crowded = region.frame(FrameTime::new(&timed, SIZE), clock.now_ns(), seen_ns);
                assert!(crowded.is_none(), "the queue is long enough");
            }
        }
        let now = clock.now_ns();
        if let Some(poses) = &mut poses {
            poses.advance(now);
        }
        pictures.advance(now);
        while let Some(ready) = region.next(now) {
            answered.push((ready.payload, ready));
        }
    }
    let states = [poses.as_ref().unwrap().clocks()[0].state(), pictures.clocks()[0].state()];
    Run { truth, resolution_mm, answered, states }
}

impl Run {
    /// Returns the error of the worst corner, mm.
    fn off_mm(&self, seen_ns: i64, placed: &Placed) -> f64 {
        let truth = (self.truth)(seen_ns);
        let [right, bottom] = SIZE.map(|n| f64::from(n) - 1.0);
        [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]]
            .map(|[u, v]| DVec3::new(u, v, 0.0))
            .map(|corner| (placed.world_from_image.point(corner) - truth.transform_point3(corner)).length())
            .into_iter()
            .fold(0.0, f64::max)
    }

    /// Prints and returns p50, p99 and the largest error of frames whose clocks were locked. Checks
    /// that 99 of 100 frames lie within their bound, and the device's resolution.
    fn check(&self, name: &str, from_ns: i64) -> [f64; 3] {
        let placed: Vec<_> =
            self.answered.iter().filter_map(|(seen, ready)| Some((*seen, ready.answer.as_ref().ok()?))).collect();
        let within = placed
            .iter()
            .filter(|(seen, placed)| self.off_mm(*seen, placed) <= placed.error_mm + self.resolution_mm)
            .count();
        assert!(within * 100 >= placed.len() * 99, "{name}: {within} of {} within their bound", placed.len());
        let is_locked = |flags: TimeFlags| {
            ![TimeFlags::ACQUIRING, TimeFlags::HOLDOVER, TimeFlags::LOST].iter().any(|flag| flags.has(*flag))
        };
        let locked = placed.iter().filter(|(seen, placed)| *seen >= from_ns && is_locked(placed.flags));
        let mut figures: Vec<[f64; 2]> =
            locked.map(|(seen, placed)| [self.off_mm(*seen, placed), placed.error_mm]).collect();
        figures.sort_by(|a, b| a[0].total_cmp(&b[0]));
        let at = |share: f64| figures[((figures.len() - 1) as f64 * share) as usize][0];
        let result = [at(0.5), at(0.99), at(1.0)];
        let bound = figures.iter().map(|f| f[1]).sum::<f64>() / figures.len() as f64;
        println!(
            "{name}: {} frames, {} placed, {} locked; error p50 {:.4} p99 {:.4} max {:.4} mm, resolution {:.4} mm, bound {bound:.3} mm on average, {:.2} % within; waited {:.1} ms at most",
            self.answered.len(),
            placed.len(),
            figures.len(),
            result[0],
            result[1],
            result[2],
            self.resolution_mm,
            100.0 * within as f64 / placed.len() as f64,
            self.answered.iter().map(|(_, ready)| ready.waited_ns).max().unwrap_or(0) as f64 * 1e-6,
        );
        result
    }
}

fn video() -> Faults {
    Faults {
        seed: 5,
        latency_ns: VIDEO_LATENCY,
        jitter_ns: 3 * MS,
        drift_ppm: -60.0,
        dropout: 0.005,
        ..Faults::default()
    }
}

fn tracking() -> Faults {
    Faults {
        seed: 9,
        latency_ns: TRACKER_LATENCY,
        jitter_ns: 4 * MS,
        drift_ppm: 90.0,
        dropout: 0.002,
        ..Faults::default()
    }
}

fn settings() -> Settings {
    Settings { stations: vec![PROBE_STATION, REFERENCE_STATION], ..Settings::default() }
}

fn fastrak_run(
    faults: Faults,
    video: Faults,
    seconds: i64,
    disturb: impl Fn(i64, &Mutex<virtual_fastrak::Twin>),
) -> Run {
    let bedside = bedside(Motion::Freehand);
    let twin = virtual_fastrak::Twin::new(bedside.motion(), faults);
    let unit = fastrak::Unit::new("a line", settings(), None).unwrap();
    run(Carrier::tracker(&bedside), twin, unit, video, seconds, disturb)
}

/// Runs an arm with encoders of 40000 counts a turn. It was homed before the run.
fn arm_run(faults: Faults, video: Faults, seconds: i64, disturb: impl Fn(i64, &Mutex<virtual_ea1::Twin>)) -> Run {
    let held = Arc::new(BedsideArm::new(bedside(Motion::Arm), standard_arm(40_000.0).unwrap()).unwrap());
    let mut twin = virtual_ea1::Twin::new(held.joints(), faults);
    (twin.starts_when_opened, twin.homed) = (false, 7);
    let unit = ea1::Unit::new("a line", ArmSettings::default(), ea1::SampleFormat::Lines).unwrap();
    run(Carrier::arm(&held), twin, unit, video, seconds, disturb)
}

#[test]
fn fastrak_and_grabber_give_correct_frame_poses() {
    let run = fastrak_run(tracking(), video(), 40, |_, _| {});
    let [p50, p99, most] = run.check("FASTRAK, 4 ms of jitter, 90 ppm", BEGIN + 15 * SECOND);
    assert!(p50 < 0.02 && p99 < 0.1 && most < 0.2, "{p50} {p99} {most}");
    assert_eq!(run.states, [State::Locked; 2]);
}

#[test]
fn liberty_and_grabber_give_correct_frame_poses() {
    let bedside = bedside(Motion::Freehand);
    let mut twin = virtual_liberty::Twin::new(bedside.motion(), tracking());
    twin.active = 3;
    let unit = liberty::Unit::new("a line", settings(), None).unwrap();
    let run = run(Carrier::tracker(&bedside), twin, unit, video(), 40, |_, _| {});
    let [p50, p99, most] = run.check("LIBERTY, 4 ms of jitter, 90 ppm", BEGIN + 15 * SECOND);
    assert!(p50 < 0.02 && p99 < 0.1 && most < 0.2, "{p50} {p99} {most}");
}

#[test]
fn packets_and_bursts_do_not_change_poses() {
    let slow = Faults { packet_ns: 16 * MS, ..tracking() };
    fastrak_run(slow, video(), 40, |_, _| {}).check("FASTRAK, packets of 16 ms", BEGIN + 15 * SECOND);
    // Occasionally delayed by 200 ms, then delivered at once.
    let run = fastrak_run(tracking(), video(), 40, |now, twin| {
        let is_held = now > BEGIN + 10 * SECOND && now % (5 * SECOND) < 30 * MS;
        let packet_ns = if is_held { 200 * MS } else { 0 };
        let mut twin = twin.lock().unwrap();
        twin.wire.set_faults(Faults { packet_ns, seed: now.unsigned_abs(), ..tracking() });
    });
    let [_, p99, _] = run.check("FASTRAK, 200 ms late in bursts", BEGIN + 15 * SECOND);
    assert!(p99 < 1.0, "{p99}");
}

#[test]
fn unplugged_tracker_is_reported_without_invented_poses() {
    let run = fastrak_run(tracking(), video(), 30, |now, twin| {
        let mut twin = twin.lock().unwrap();
        let is_out = (BEGIN + 10 * SECOND..BEGIN + 14 * SECOND).contains(&now);
        match (is_out, twin.wire.plugged) {
            (true, true) => twin.unplug(),
            (false, false) => twin.wire.plugged = true,
            _ => {}
        }
    });
    run.check("FASTRAK, unplugged for 4 s", BEGIN + 20 * SECOND);
    let during = run.answered.iter().filter(|(seen, _)| (BEGIN + 10_300 * MS..BEGIN + 13_700 * MS).contains(seen));
    let sentences: Vec<String> = during.map(|(_, ready)| ready.answer.as_ref().unwrap_err().to_string()).collect();
    assert!(sentences.len() > 95, "{}", sentences.len());
    assert!(
        sentences
            .iter()
            .all(|s| s.contains("no pose came after the time") || s.contains("the poses about the time lie")),
        "{:?}",
        sentences.first()
    );
    let after = run.answered.iter().filter(|(seen, _)| *seen > BEGIN + 20 * SECOND);
    assert!(after.clone().all(|(_, ready)| ready.answer.is_ok()) && after.count() > 250);
    for (_, ready) in &run.answered {
        if let Ok(Placed { how: How::Interpolated { gap_ns }, .. }) = ready.answer {
            assert!(gap_ns <= 100 * MS, "{gap_ns}");
        }
    }
}

#[test]
fn arm_without_delays_lies_within_encoder_resolution() {
    let of = |latency_ns| Faults { latency_ns, ..Faults::default() };
    let run = arm_run(of(TRACKER_LATENCY), of(VIDEO_LATENCY), 40, |_, _| {});
    let [p50, p99, most] = run.check("EA1, nothing late", BEGIN + 15 * SECOND);
    let resolution = run.resolution_mm;
    assert!(p50 < 0.5 * resolution && p99 < resolution && most < resolution, "{p50} {p99} {most} of {resolution}");
}

#[test]
fn arm_and_grabber_give_correct_frame_poses() {
    let run = arm_run(tracking(), video(), 40, |_, _| {});
    let [p50, p99, most] = run.check("EA1, 4 ms of jitter, 90 ppm", BEGIN + 15 * SECOND);
    let resolution = run.resolution_mm;
    assert!(p50 < 0.5 * resolution && p99 < resolution && most < resolution, "{p50} {p99} {most} of {resolution}");
    assert_eq!(run.states, [State::Locked; 2]);
    let slow = Faults { packet_ns: 16 * MS, ..tracking() };
    arm_run(slow, video(), 40, |_, _| {}).check("EA1, packets of 16 ms", BEGIN + 15 * SECOND);
}

#[test]
fn replugged_arm_gives_no_poses_until_homed() {
    let run = arm_run(tracking(), video(), 30, |now, twin| {
        let mut twin = twin.lock().unwrap();
        let is_out = (BEGIN + 10 * SECOND..BEGIN + 14 * SECOND).contains(&now);
        match (is_out, twin.wire.plugged) {
            (true, true) => twin.unplug(),
            (false, false) => (twin.wire.plugged, twin.homed) = (true, 0),
            _ => {}
        }
        if now > BEGIN + 17 * SECOND {
            twin.homed = 7;
        }
    });
    run.check("EA1, unplugged for 4 s", BEGIN + 20 * SECOND);
    let between = |from_ms: i64, to_ms: i64| {
        run.answered.iter().filter(move |(seen, _)| (BEGIN + from_ms * MS..BEGIN + to_ms * MS).contains(seen))
    };
    assert!(between(10_300, 16_700).count() > 180);
    assert!(between(10_300, 16_700).all(|(_, ready)| ready.answer.is_err()));
    let why = |(_, ready): &(i64, Answered<i64>)| ready.answer.as_ref().unwrap_err().to_string();
    let unhomed = between(16_000, 16_700).map(why).filter(|sentence| sentence.contains("not homed"));
    assert!(unhomed.count() > 15, "{:?}", between(16_000, 16_700).map(why).next());
    assert!(between(20_000, 29_000).count() > 250 && between(20_000, 29_000).all(|(_, ready)| ready.answer.is_ok()));
}
