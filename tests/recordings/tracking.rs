//! Clocks and poses on real recordings of trackers: the filtering and the interpolation that
//! PLUS tests with the same files.

use std::path::Path;

use libtest_mimic::Failed;

use drivers::OpenSettings;
use drivers::replay::SequenceSettings;
use sonoweave_core::frames::{affine_from_rows, nearest_rigid};
use sonoweave_core::reading::{Frame, Reading, Status};
use sonoweave_core::{Next, Ticks, Timing};
use sync::clock::{Basis, ClockMap, ClockSettings, PUBLISHED_NS, State, TimeFlags, Timed};
use sync::history::{PoseHistory, PoseSample, Rigid, Unavailable};

use crate::Test;

const FILTERING: &str = "tracking/TimestampFilteringTest.igs.mha";
const INTERPOLATION: &str = "tracking/TransformInterpolationTest.igs.mha";

pub(crate) const TESTS: &[Test] = &[
    Test::of_file("filtered_times_are_near_the_raw_ones_and_steadier", FILTERING, filtering),
    Test::of_file("a_record_s_clock_is_that_of_its_device", INTERPOLATION, clock_of_interpolation),
    Test::of_file("poses_between_five_times_as_many_are_near_each_other", INTERPOLATION, interpolation),
];

/// Returns all readings of a file.
fn readings(path: &Path) -> Result<Vec<Reading>, Failed> {
    let settings = SequenceSettings { images: false, ..SequenceSettings::new(path) };
    let mut device = drivers::open(&OpenSettings::Sequence(settings))?;
    device.start()?;
    let mut readings = Vec::new();
    while let Next::Reading(reading) = device.next(sonoweave_core::NO_DEADLINE)? {
        readings.push(reading);
    }
    device.stop()?;
    Ok(readings)
}

/// A frame's number and raw time.
#[derive(Clone, Copy)]
struct Item {
    number: u64,
    raw_s: f64,
}

fn items(path: &Path) -> Result<Vec<Item>, Failed> {
    let item = |frame: &Frame| {
        Some(Item { number: frame.frame_number?, raw_s: frame.stamp.unfiltered_s.or(frame.stamp.source_s)? })
    };
    readings(path)?
        .iter()
        .filter_map(|reading| if let Reading::Frame(frame) = reading { Some(item(frame)) } else { None })
        .map(|item| item.ok_or_else(|| "a frame without number or time".into()))
        .collect()
}

/// Returns the items' clock, for an unknown rate.
fn clocked(items: &[Item]) -> (ClockMap, Vec<Timed>) {
    let timing = Timing { ticks: Ticks::Measurements, ..Timing::default() };
    let mut clock = ClockMap::new(ClockSettings::new(&timing, 0));
    let first = items[0].raw_s;
    let host = |item: &Item| ((item.raw_s - first) * 1e9).round() as i64;
    let timed = items.iter().map(|item| clock.push(host(item), Some(item.number))).collect();
    (clock, timed)
}

fn deviation(values: &[f64]) -> f64 {
    let mean = values.iter().sum::<f64>() / values.len() as f64;
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
}

/// Returns the periods between frames, per counted frame, s.
fn periods(items: &[Item], times_s: &[f64]) -> Vec<f64> {
    let counted = |two: &[Item]| (two[1].number - two[0].number) as f64;
    items.windows(2).zip(times_s.windows(2)).map(|(items, times)| (times[1] - times[0]) / counted(items)).collect()
}

fn filtering(path: &Path) -> Result<(), Failed> {
    let items = items(path)?;
    assert_eq!(items.len(), 500);
    let (_, timed) = clocked(&items);
    let raw: Vec<f64> = items.iter().map(|item| item.raw_s - items[0].raw_s).collect();
    let filtered: Vec<f64> = timed.iter().map(|timed| timed.time_ns as f64 * 1e-9).collect();
    // PLUS's filter keeps the mean delay, ours the smallest. A latency calibration would find
    // the constant difference.
    let latency = raw.iter().zip(&filtered).map(|(raw, filtered)| raw - filtered).sum::<f64>() / raw.len() as f64;
    let apart = raw.iter().zip(&filtered).map(|(raw, filtered)| raw - filtered - latency);
    let furthest = apart.fold(0.0, |most: f64, apart| most.max(apart.abs()));
    let [raw, all] = [&raw, &filtered].map(|times| deviation(&periods(&items, times)));
    println!(
        "period's deviation {:.3} ms, of filtered times {:.3}: {:.1} times less; from the raw times {:.1} ms on average, at most {:.1} ms more",
        raw * 1e3,
        all * 1e3,
        raw / all,
        latency * 1e3,
        furthest * 1e3
    );
    // No measurement is later than its arrival, except for differences below the publication
    // threshold.
    let there = |item: &Item| ((item.raw_s - items[0].raw_s) * 1e9).round() as i64;
    assert!(timed.iter().zip(&items).all(|(timed, item)| timed.time_ns <= there(item) + PUBLISHED_NS));
    assert!(furthest <= 0.08, "{furthest}");
    assert!(raw / all >= 3.0, "{raw} {all}");
    Ok(())
}

fn clock_of_interpolation(path: &Path) -> Result<(), Failed> {
    let items = items(path)?;
    assert_eq!(items.len(), 500);
    let (clock, timed) = clocked(&items);
    // 100 Hz, of which every second frame was kept.
    let period_ms = clock.mapping().ns_per_tick_q32 as f64 / 4_294_967_296.0 * 1e-6;
    assert!((period_ms - 10.0).abs() < 0.05, "{period_ms}");
    // Its raw times are rounded to ms and come in steps: occasionally no sample is timely for a
    // second.
    assert!(matches!(clock.state(), State::Locked | State::Holdover), "{}", clock.state().word());
    assert_eq!(clock.mapping().epoch, 0);
    // The rate is unknown: it is accepted after half a second, by the second sixteen records.
    assert!(timed.iter().skip(32).all(|timed| matches!(timed.basis, Basis::Ticks(_))));
    Ok(())
}

/// Interpolated at five times the rate, neighbouring poses differ by 1° and 0.5 mm at most; next
/// to the invalid sample there is none.
fn interpolation(path: &Path) -> Result<(), Failed> {
    let mut history = PoseHistory::new(1000, 100_000_000);
    let (mut first, mut last, mut invalid) = (None, 0, Vec::new());
    for reading in readings(path)? {
        let Reading::NamedTransform(t) = reading else { continue };
        if t.from != "Probe" {
            continue;
        }
        let seconds = t.stamp.source_s.ok_or("no time")?;
        let time_ns = ((seconds - *first.get_or_insert(seconds)) * 1e9).round() as i64;
        let affine = affine_from_rows(&t.matrix)?;
        let (rigid, _) = nearest_rigid(&affine, 1e-2)?;
        let rotation = glam::DQuat::from_mat3(&rigid.matrix3).normalize();
        let pose = Rigid { rotation, position_mm: rigid.translation };
        let word = match t.status {
            Status::Ok => None,
            Status::Other(word) => Some(word),
        };
        invalid.extend(word.is_some().then_some(time_ns));
        history.insert(PoseSample { time_ns, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: word });
        last = time_ns;
    }
    assert_eq!((history.len(), invalid.len()), (500, 1));
    let step = last / (5 * 499);
    let (mut before, mut refused, mut found): (Option<Rigid>, Vec<i64>, u32) = (None, Vec::new(), 0);
    let (mut farthest_mm, mut farthest_deg) = (0.0_f64, 0.0_f64);
    for at in (0..=last).step_by(usize::try_from(step)?) {
        let pose = match history.at(at) {
            Ok(between) => between.pose(),
            Err(Unavailable::Invalid { .. }) => {
                refused.push(at);
                before = None;
                continue;
            }
            Err(other) => return Err(other.to_string().into()),
        };
        if let Some(before) = before.replace(pose) {
            farthest_mm = farthest_mm.max((before.position_mm - pose.position_mm).length());
            farthest_deg = farthest_deg.max(before.rotation.angle_between(pose.rotation).to_degrees());
        }
        found += 1;
    }
    println!(
        "{found} poses, {} refused beside the invalid sample; neighbours {farthest_mm:.3} mm, {farthest_deg:.3}° apart at most",
        refused.len()
    );
    assert!(farthest_mm <= 0.5 && farthest_deg <= 1.0, "{farthest_mm} mm, {farthest_deg}°");
    assert!(
        refused.iter().all(|at| (at - invalid[0]).abs() < 40_000_000) && (8..=11).contains(&refused.len()),
        "{refused:?}"
    );
    assert!(found > 2450, "{found}");
    Ok(())
}
