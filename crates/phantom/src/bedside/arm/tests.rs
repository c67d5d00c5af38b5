use std::sync::Mutex;

use glam::DVec2;

use calibration::arm::JOINTS;
use drivers::OpenSettings;
use drivers::arm::{ArmSettings, Model, Settings, ea1, microscribe, qsb};
use drivers::connection::Connection;
use drivers::simulated::grabber::Grabber;
use drivers::simulated::{self, Faults, Pty};
use drivers::transport::{MemoryOpener, Opener, Peer};
use mask::Mask;
use reconstruct::planar::{OnDeparture, PlanarSettings};
use reconstruct::{Path, PathReconstructor};
use sonoweave_core::clock::{Clock, MS, Manual, Monotonic, SECOND};
use sonoweave_core::health::State;
use sonoweave_core::reading::{Counts, Frame, Reading, Status};
use sonoweave_core::slice::{Image, Pixels, Slice};
use sonoweave_core::{Device, Next, Ticks};

use super::*;
use crate::error::Errors;
use crate::{Motion, Scan, ScanSettings};

const BEGIN: i64 = 11 * SECOND;

fn small(motion: Motion) -> ScanSettings {
    ScanSettings {
        motion,
        frames: 60,
        gap_mm: 0.5,
        image_size: [64, 48],
        pixel_mm: [0.8, 0.8],
        ..ScanSettings::default()
    }
}

fn at_bedside(motion: Motion, counts_per_turn: f64, begin_ns: i64) -> Result<Arc<BedsideArm>, PhantomError> {
    let bedside = Arc::new(Bedside::new(Scan::new(small(motion)).unwrap(), begin_ns));
    BedsideArm::new(bedside, standard_arm(counts_per_turn).unwrap()).map(Arc::new)
}

#[test]
fn joints_follow_probe_and_counts_round_to_nearest() {
    for motion in
        [Motion::Arm, Motion::Parallel, Motion::Jittered, Motion::OutAndBack, Motion::Fan { axis_distance_mm: 60.0 }]
    {
        let held = at_bedside(motion, 40_000.0, BEGIN).unwrap();
        assert_eq!(held.joints()(0), [0; AXES], "at rest it is at home");
        let mut before: Option<Values> = None;
        for ms in (-50..4100).step_by(7) {
            let at = BEGIN + ms * MS;
            let (values, truth) = (held.values(at), held.tracker_from_probe(at).affine());
            let found = held.arm().pose(&values).tracker_from_probe().affine();
            let off = (found.translation - truth.translation).length();
            let turned = (found.matrix3 - truth.matrix3).to_cols_array().iter().map(|x| x.abs()).fold(0.0, f64::max);
            assert!(off < 1e-9 && turned < 1e-9, "{motion:?} {ms}: {off} {turned}");
            let (exact, shown) = (held.arm().counts(&values), held.joints()(at));
            assert!((0..JOINTS).all(|i| (exact[i] - shown[i] as f64).abs() <= 0.5));
            if let Some(before) = before.replace(values) {
                assert!((0..JOINTS).all(|i| (values[i] - before[i]).abs() < 0.1), "{motion:?} {ms}: no jump");
            }
            // Image position by the probe's calibration, and by the world's.
            let [by_probe, by_world] =
                [held.tracker_from_probe(at) * held.probe_from_image(), held.tracker_from_image(at)]
                    .map(|t| t.point(DVec3::new(63.0, 47.0, 0.0)));
            assert!((by_probe - by_world).length() < 1e-9);
        }
    }
}

#[test]
fn non_planar_or_unreachable_motion_is_refused() {
    let refusal = |motion| at_bedside(motion, 40_000.0, BEGIN).unwrap_err().to_string();
    let hand = refusal(Motion::Freehand);
    assert!(hand.contains("out of the arm's plane and tilted by") && hand.contains("choose a motion"), "{hand}");
    let crossing = refusal(Motion::Crossing);
    assert!(crossing.starts_with("frame 30 of the sweep") && crossing.contains("90.000°"), "{crossing}");
    let bedside = Arc::new(Bedside::new(Scan::new(small(Motion::Parallel)).unwrap(), BEGIN));
    let short = Arm::new([Joint::revolute(100.0, 1e4); JOINTS]).unwrap();
    let short = BedsideArm::new(bedside, short).unwrap_err().to_string();
    assert!(short.contains("this arm") && short.contains("beyond the arm's reach by"), "{short}");
}

/// Counts of an axis, with their times.
type Track = Vec<(i64, f64)>;

/// Returns the time of each count from stamps alone. Device clock times, if there are any, are
/// aligned to the host clock by the readings with the shortest delay.
fn tracks(counts: &[Counts], timing: &sonoweave_core::Timing) -> [Track; JOINTS] {
    std::array::from_fn(|axis| {
        let own = counts.iter().filter_map(|c| {
            let place = axis.checked_sub(c.first.into()).filter(|place| *place < usize::from(c.axes))?;
            Some((c.stamp, c.counts[place] as f64))
        });
        let own: Vec<_> = own.collect();
        let host =
            |stamp: &sonoweave_core::reading::Stamp| stamp.host_ns.unwrap() - timing.wire_ns - timing.sampling_ns;
        if timing.ticks != Ticks::Time {
            return own.iter().map(|(stamp, count)| (host(stamp), *count)).collect();
        }
        let ticks = |stamp: &sonoweave_core::reading::Stamp| {
            (stamp.ticks.unwrap() as f64 * 1e9 / timing.tick_hz.unwrap()) as i64
        };
        let offset = own.iter().map(|(stamp, _)| host(stamp) - ticks(stamp)).min().unwrap();
        own.iter().map(|(stamp, count)| (ticks(stamp) + offset, *count)).collect()
    })
}

/// Interpolates the joint values at a time between neighbouring counts.
fn values_at(arm: &Arm, tracks: &[Track; JOINTS], at_ns: i64) -> Option<Values> {
    let mut values = [0.0; JOINTS];
    for ((value, track), joint) in values.iter_mut().zip(tracks).zip(arm.joints()) {
        let two = track.windows(2).find(|two| two[0].0 <= at_ns && at_ns < two[1].0)?;
        let share = (at_ns - two[0].0) as f64 / (two[1].0 - two[0].0) as f64;
        *value = joint.value(two[0].1 + share * (two[1].1 - two[0].1));
    }
    Some(values)
}

/// Returns the largest error of the image's corners at these values, and the largest error
/// explained by the counts' rounding, mm.
fn corners_off(held: &BedsideArm, values: &Values, at_ns: i64) -> (f64, f64) {
    let [width, height] = held.bedside().scan().settings().image_size.map(|n| f64::from(n) - 1.0);
    let probe_from_image = held.probe_from_image();
    let found = held.arm().pose(values).tracker_from_probe() * probe_from_image;
    let truth = held.tracker_from_image(at_ns);
    let (mut off, mut bound) = (0.0_f64, 0.0_f64);
    for corner in [[0.0, 0.0], [width, 0.0], [0.0, height], [width, height]] {
        let pixel = DVec3::new(corner[0], corner[1], 0.0);
        off = off.max((found.point(pixel) - truth.point(pixel)).length());
        let at: DVec2 = probe_from_image.point(pixel).truncate();
        bound = bound.max(held.arm().displacement(values, at, 0.5).most_mm);
    }
    assert!(bound <= held.resolution_mm() && bound > 0.5 * held.resolution_mm(), "{bound}");
    (off, bound)
}

/// Error between two readings, mm: the probe changes its speed at every frame, but is assumed
/// to move evenly.
const BETWEEN: f64 = 0.05;

/// Encoder counts of a MicroScribe at home; those of other arms are 0.
const MICROSCRIBE: [i64; JOINTS] = [8192, 12_000, 14_000];

/// Returns the arm as the host knows it, with these counts at home.
fn as_calibrated(held: &BedsideArm, home: [i64; JOINTS]) -> Arm {
    let mut joints = *held.arm().joints();
    joints.iter_mut().zip(home).for_each(|(joint, home)| joint.zero_counts += home as f64);
    Arm::new(joints).unwrap()
}

/// Creates an arm's device in process, with its clock.
fn in_process(kind: &str, held: &Arc<BedsideArm>) -> (Box<dyn Device>, Manual) {
    let clock = Manual::at(BEGIN - 6 * SECOND);
    fn opener<P: Peer + 'static>(twin: P, clock: &Manual) -> Box<dyn Opener> {
        Box::new(MemoryOpener::new(Arc::new(Mutex::new(twin)), clock.clone(), 115_200))
    }
    let shared = || Arc::new(clock.clone());
    let settings = Settings::default();
    let device: Box<dyn Device> = match kind {
        "EA1" => {
            let twin = simulated::ea1::Twin::new(held.joints(), Faults::default());
            let unit = ea1::Unit::new("a line", settings, ea1::SampleFormat::Blocks).unwrap();
            Box::new(Connection::new(opener(twin, &clock), shared(), unit, false))
        }
        "QSB" => {
            let settings = Settings { rate_hz: 128, ..settings };
            let twin = |axis| opener(simulated::qsb::Twin::new(held.joints(), axis, Faults::default()), &clock);
            Box::new(qsb::Arm::new([0, 1, 2].map(twin), shared(), &settings, false).unwrap())
        }
        _ => {
            let twin = simulated::microscribe::Twin::new(held.joints(), Faults::default());
            assert_eq!(twin.home[..JOINTS], MICROSCRIBE);
            let unit =
                microscribe::Unit::new("a line", Settings::of_14_bits(), microscribe::Family::MicroScribe, 5).unwrap();
            Box::new(Connection::new(opener(twin, &clock), shared(), unit, false))
        }
    };
    (device, clock)
}

/// Reads arm and grabber for one sweep; the arm is homed before it, at rest.
fn read(device: &mut dyn Device, clock: &Manual, held: &Arc<BedsideArm>, latency_ns: i64) -> (Vec<Counts>, Vec<Frame>) {
    let faults = Faults { latency_ns, ..Faults::default() };
    let size = held.bedside().scan().settings().image_size;
    let mut grabber = Grabber::new(held.bedside().pictures(), size, 30.0, faults, Arc::new(clock.clone())).unwrap();
    device.start().unwrap();
    while device.health().state != State::Running {
        assert!(clock.now_ns() < BEGIN - 2 * SECOND, "{:?}", device.health());
        device.next(clock.now_ns() + MS).unwrap();
    }
    device.home(7).unwrap();
    let (mut counts, mut frames) = (Vec::new(), Vec::new());
    grabber.start().unwrap();
    while clock.now_ns() < BEGIN + 5 * SECOND / 2 {
        // A QSB's line is read for a quarter of a ms; the deadline is shorter than any pause
        // between readings.
        if let Next::Reading(Reading::Counts(read)) = device.next(clock.now_ns() + MS).unwrap()
            && read.status == Status::Ok
        {
            counts.push(read);
        }
        if let Next::Reading(Reading::Frame(frame)) = grabber.next(clock.now_ns()).unwrap() {
            frames.push(frame);
        }
    }
    (counts, frames)
}

#[test]
fn arms_and_grabber_observe_same_motion_at_stamped_times() {
    let latency = 40 * MS;
    let kinds =
        [("EA1", 100_000.0, [0; JOINTS]), ("QSB", 40_000.0, [0; JOINTS]), ("MicroScribe", 16_384.0, MICROSCRIBE)];
    for (kind, counts_per_turn, home) in kinds {
        let held = at_bedside(Motion::Arm, counts_per_turn, BEGIN).unwrap();
        let (mut device, clock) = in_process(kind, &held);
        let (counts, frames) = read(&mut *device, &clock, &held, latency);
        let tracks = tracks(&counts, &device.describe().timing);
        let arm = as_calibrated(&held, home);
        let (mut compared, mut worst, mut beyond) = (0, 0.0_f64, f64::MIN);
        for frame in &frames {
            let seen_ns = frame.stamp.host_ns.unwrap() - latency;
            let Some(values) = values_at(&arm, &tracks, seen_ns) else { continue };
            let (off, bound) = corners_off(&held, &values, seen_ns);
            (worst, beyond) = (worst.max(off), beyond.max(off - bound));
            compared += u32::from(seen_ns > BEGIN);
        }
        assert!(compared > 60, "{kind}: {compared}");
        assert!(beyond < BETWEEN, "{kind}: {worst} mm, {beyond} mm beyond what rounded counts explain");
    }
}

#[test]
fn driver_reads_arm_on_terminal_and_finds_probe() {
    let begin = Monotonic.now_ns();
    let held = at_bedside(Motion::Arm, 100_000.0, begin).unwrap();
    let mut left = simulated::ea1::Twin::new(held.joints(), Faults::default());
    (left.rate_hz, left.homed) = (100, 7);
    left.set_clock(begin, 0);
    let pty = Pty::run(Arc::new(Mutex::new(left))).unwrap();
    let model = Model::Ea1 { path: pty.path().into(), format: ea1::SampleFormat::Blocks };
    let settings = OpenSettings::Arm(ArmSettings { model, settings: Settings::default(), keeps_raw: false });
    let mut device = drivers::open(&settings).unwrap();
    device.start().unwrap();
    let end = begin + 30 * SECOND;
    let mut counts = Vec::new();
    while counts.len() < 150 {
        assert!(Monotonic.now_ns() < end, "{:?}", device.health());
        if let Next::Reading(Reading::Counts(read)) = device.next(Monotonic.now_ns() + 50 * MS).unwrap() {
            assert_eq!((&read.status, read.homed), (&Status::Ok, 7));
            counts.push(read);
        }
    }
    let tracks = tracks(&counts, &device.describe().timing);
    let mut beyond = f64::MIN;
    for (n, (at_ns, _)) in tracks[0].iter().enumerate() {
        let values = std::array::from_fn(|axis| held.arm().joints()[axis].value(tracks[axis][n].1));
        let (off, bound) = corners_off(&held, &values, *at_ns);
        beyond = beyond.max(off - bound);
    }
    // Even the reading with the shortest delay comes a little late.
    assert!(beyond < BETWEEN, "{beyond} mm beyond what rounded counts explain");
}

/// Inserts frames by the planar path on the base's axes.
fn inserted(slices: impl Iterator<Item = Slice>) -> PathReconstructor {
    let settings = reconstruct::Settings::new(DVec3::splat(0.5));
    let planar = PlanarSettings {
        direction: Some(DMat3::IDENTITY),
        on_departure: OnDeparture::Refuse,
        ..PlanarSettings::default()
    };
    let mut reconstructor = PathReconstructor::planar(settings, planar, Mask::full(64, 48)).unwrap();
    for slice in slices {
        reconstructor.insert(&slice).unwrap();
    }
    assert_eq!((reconstructor.path(), reconstructor.upgraded()), (Path::Planar, None));
    reconstructor
}

/// Compares a volume with another one, at voxels seen in both, in grey levels.
fn differ(a: &PathReconstructor, b: &PathReconstructor) -> Errors {
    let bounds = |reconstructor: &PathReconstructor| reconstructor.volume().seen_bounds().unwrap();
    let (low, high) = bounds(b);
    let all: Vec<[i64; 3]> = (low[2]..=high[2])
        .flat_map(|z| (low[1]..=high[1]).flat_map(move |y| (low[0]..=high[0]).map(move |x| [x, y, z])))
        .collect();
    let value = |reconstructor: &PathReconstructor, voxel: [i64; 3]| {
        let (r, w) = reconstructor.volume().voxel(voxel);
        (w > 0.0).then(|| r / w)
    };
    let reference: Vec<f32> = all.iter().map(|voxel| value(b, *voxel).unwrap_or(f32::NAN)).collect();
    Errors::over(&reference, |i| value(a, all[i]), |i| !reference[i].is_nan())
}

#[test]
fn sweep_by_counts_matches_volume_of_true_poses() {
    let latency = 40 * MS;
    let held = at_bedside(Motion::Arm, 40_000.0, BEGIN).unwrap();
    let (mut device, clock) = in_process("EA1", &held);
    let (counts, frames) = read(&mut *device, &clock, &held, latency);
    let tracks = tracks(&counts, &device.describe().timing);
    // One way of the sweep.
    let sweep: Vec<(i64, &Frame)> = frames
        .iter()
        .map(|frame| (frame.stamp.host_ns.unwrap() - latency, frame))
        .filter(|(seen_ns, _)| (BEGIN..BEGIN + 59 * 33_333_333).contains(seen_ns))
        .collect();
    assert!(sweep.len() > 55, "{}", sweep.len());
    let slices = |place: &dyn Fn(i64) -> Transform<Tracker, ImageFrame>| {
        let slice = |(seen_ns, frame): &(i64, &Frame)| Slice {
            image: Image::new(64, 48, Pixels::U8(Arc::clone(&frame.pixels))),
            time_ns: *seen_ns,
            // The base is the world here.
            world_from_image: Transform::from_affine(place(*seen_ns).affine()),
        };
        inserted(sweep.iter().map(slice))
    };
    let by_arm = |arm: &Arm| {
        slices(&|at| arm.pose(&values_at(arm, &tracks, at).unwrap()).tracker_from_probe() * held.probe_from_image())
    };
    let truth = slices(&|at| held.tracker_from_image(at));
    let errors = differ(&by_arm(held.arm()), &truth);
    assert!(errors.voxels > 50_000 && errors.unseen < errors.voxels / 200, "{errors:?}");
    // Measured: 0.035.
    assert!(errors.rmse < 0.1, "{errors:?}");
    // The same counts with an arm whose elbow zero is off by 1°.
    let mut joints = *held.arm().joints();
    joints[1].zero_counts += 40_000.0 / 360.0;
    let wrong = differ(&by_arm(&Arm::new(joints).unwrap()), &truth);
    assert!(wrong.rmse > 10.0 * errors.rmse, "{wrong:?}");
}
