//! The frames that a gate leaves out: those at which breathing displaces the body.

use std::collections::BTreeMap;
use std::path::Path;

use glam::DVec3;
use serde_json::{Map, Value, json};

use config::bedside::Bedside;
use config::bedside::devices::REFERENCE_FRAME;
use pipeline::session::RecordedDecisions;
use sonoweave_core::slice::Pixels;
use sync::gating::{DepthShift, Gate, LEAST_SHARE, PhaseGate, Signal};

use super::options::{GateSignal, Settings};
use super::poses::{Poses, transform};
use crate::app::calibrate::recorded::{Tracks, data};
use crate::app::live::stages::Kept;
use crate::app::replay::reel::{Reel, Still};
use crate::failure::Failure;

/// Most frames far from an accepted one, as a share of all.
const MOST_HOLES: f64 = 0.1;
/// Least distance that a kernel bridges, mm.
const BRIDGED_MM: f64 = 1.0;

/// Returns the frames that a gate leaves out, ascending, and the numbers by which it is judged.
pub(super) fn left_out(
    session: &Path,
    settings: &Settings,
    poses: &Poses,
) -> Result<(Vec<u64>, Map<String, Value>), Failure> {
    let no_gate = |why: String| Failure::new(format!("no correction: {why}"));
    if !(LEAST_SHARE..1.0).contains(&settings.share) {
        return Err(no_gate(format!(
            "the gate must use a share of {LEAST_SHARE} to 1 of the frames; give another one"
        )));
    }
    if !(0.0..1.0).contains(&settings.phase) {
        return Err(no_gate("the phase must lie between 0 and 1; give another one".into()));
    }
    let decisions = RecordedDecisions::read(session)?;
    let markers_ns = decisions.markers_ns().map_err(|why| no_gate(format!("a marker cannot be read: {why}")))?;
    let bedside = Kept::bedside(session, &decisions)?;
    let times_ns = decisions.placed_times_ns();
    let frames: Vec<u64> = poses.keys().copied().filter(|frame| times_ns.contains_key(frame)).collect();
    let seconds = |ns: &i64| *ns as f64 * 1e-9;
    let times_s: BTreeMap<u64, f64> = times_ns.iter().map(|(frame, ns)| (*frame, seconds(ns))).collect();
    let frames_s: Vec<f64> = frames.iter().map(|frame| times_s[frame]).collect();
    let signal = settings.signal.or((!markers_ns.is_empty()).then_some(GateSignal::Markers));
    let of_signal = |signal: &Signal| {
        let gate = Gate::new(signal, &frames_s, settings.share).map_err(|why| no_gate(why.to_string()))?;
        Ok::<_, Failure>((json!(gate), gate.accepted, gate.missing_s[1]))
    };
    let reference = || reference(session, &bedside);
    let (name, (evidence, accepted, missing_s)) = match signal {
        Some(GateSignal::Markers) => {
            let markers_s: Vec<f64> = markers_ns.iter().map(seconds).collect();
            let gate = PhaseGate::new(&markers_s, &frames_s, settings.share, settings.phase);
            let gate = gate.map_err(|why| no_gate(why.to_string()))?;
            (GateSignal::Markers, (json!(gate), gate.accepted, gate.missing_s[1]))
        }
        Some(GateSignal::Images) => (GateSignal::Images, of_signal(&images(session, &bedside, poses, &times_s)?)?),
        asked => match (reference()?, asked) {
            (Some(signal), _) => (GateSignal::Reference, of_signal(&signal)?),
            (None, None) => (GateSignal::Images, of_signal(&images(session, &bedside, poses, &times_s)?)?),
            (None, Some(_)) => {
                return Err(no_gate("the session has no Reference sensor; give --signal images".into()));
            }
        },
    };
    let places = places(&frames, poses)?;
    let holes = holes(&places, &accepted);
    let speed_mm_s = BRIDGED_MM / missing_s;
    if holes > MOST_HOLES {
        return Err(no_gate(format!(
            "the gate would leave holes around {:.0} % of the frames, as none is used for up to {missing_s:.1} s; sweep \
             at {speed_mm_s:.1} mm/s or slower, or several times",
            100.0 * holes
        )));
    }
    let left_out: Vec<u64> =
        frames.iter().zip(&accepted).filter(|(_, accepted)| !**accepted).map(|(frame, _)| *frame).collect();
    let mut evidence = evidence.as_object().cloned().unwrap_or_default();
    evidence.insert("signal".to_owned(), json!(name));
    evidence.insert("frames_before".to_owned(), json!(frames.len()));
    evidence.insert("frames".to_owned(), json!(frames.len() - left_out.len()));
    evidence.insert("holes".to_owned(), json!(holes));
    evidence.insert("speed_mm_s".to_owned(), json!(speed_mm_s));
    Ok((left_out, evidence))
}

/// Returns the displacement of the Reference sensor, if the session has one.
fn reference(session: &Path, bedside: &Bedside) -> Result<Option<Signal>, Failure> {
    let tracks = Tracks::read(session, bedside)?;
    let Some(samples) = tracks.of(REFERENCE_FRAME).filter(|samples| !samples.is_empty()) else { return Ok(None) };
    let latency_ns = bedside.tracking.latency_ns();
    let valid = samples.iter().filter(|sample| sample.invalid.is_none());
    let positions = valid.map(|sample| ((sample.time_ns - latency_ns) as f64 * 1e-9, sample.pose.position_mm));
    Ok(Some(Signal::of_positions(&positions.collect::<Vec<_>>())))
}

/// Returns the shifts of the tissue in depth, of the images' part with data.
fn images(session: &Path, bedside: &Bedside, poses: &Poses, times_s: &BTreeMap<u64, f64>) -> Result<Signal, Failure> {
    let unread = |why: String| Failure::new(format!("{}: {why}", session.display()));
    let mut reel = Reel::open(session)?;
    let mut shifts: Option<DepthShift> = None;
    let mut found = Vec::new();
    for place in 0..reel.count() {
        let Still { item, image, .. } = reel.still(place).map_err(unread)?;
        let (Some(rows), Some(time_s)) = (poses.get(&item), times_s.get(&item)) else { continue };
        let Pixels::U8(pixels) = image.pixels() else {
            fail!("{}: its images have more than 8 bits; give --signal reference", session.display())
        };
        let size = [image.width(), image.height()];
        let mask = data(&bedside.mask, size)?;
        let area = area(size, |u, v| mask.as_ref().is_none_or(|mask| mask.contains(u, v)));
        let cropped: Vec<u8> = area[1]
            .clone()
            .flat_map(|v| &pixels[(v * size[0] + area[0].start) as usize..(v * size[0] + area[0].end) as usize])
            .copied()
            .collect();
        let shifts = shifts.get_or_insert_with(|| {
            let columns = [0, 1].map(|column| DVec3::from_array([0, 4, 8].map(|row| rows[row + column])).length());
            DepthShift::new(columns)
        });
        found.push((*time_s, shifts.add(&cropped, area[0].len())));
    }
    Ok(Signal::of_shifts(&found))
}

/// Returns the smallest rectangle of an image with all its data: ranges of u and v.
fn area([width, height]: [u32; 2], is_data: impl Fn(u32, u32) -> bool) -> [std::ops::Range<u32>; 2] {
    let has_column = |u: &u32| (0..height).any(|v| is_data(*u, v));
    let has_row = |v: &u32| (0..width).any(|u| is_data(u, *v));
    let ends = |first: Option<u32>, last: Option<u32>| first.unwrap_or(0)..last.map_or(0, |last| last + 1);
    [
        ends((0..width).find(has_column), (0..width).rev().find(has_column)),
        ends((0..height).find(has_row), (0..height).rev().find(has_row)),
    ]
}

/// Returns the place of each frame's first pixel, mm.
fn places(frames: &[u64], poses: &Poses) -> Result<Vec<DVec3>, Failure> {
    frames.iter().map(|frame| Ok(transform(*frame, &poses[frame])?.point(DVec3::ZERO))).collect()
}

/// Returns the share of the frames that lie farther from an accepted one than a kernel bridges, or
/// than twice the distance of successive frames.
fn holes(places: &[DVec3], accepted: &[bool]) -> f64 {
    let mut steps: Vec<f64> = places.windows(2).map(|two| two[0].distance(two[1])).collect();
    steps.sort_unstable_by(f64::total_cmp);
    let bridged = BRIDGED_MM.max(2.0 * steps.get(steps.len() / 2).copied().unwrap_or(0.0));
    let used: Vec<&DVec3> = places.iter().zip(accepted).filter(|(_, accepted)| **accepted).map(|(at, _)| at).collect();
    let is_far = |place: &&DVec3| !used.iter().any(|other| other.distance(**place) <= bridged);
    places.iter().filter(is_far).count() as f64 / places.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn holes_are_places_farther_than_bridged() {
        // A sweep of 100 frames, 0.1 mm apart: frames 30 to 69 are left out.
        let places: Vec<DVec3> = (0..100).map(|at| DVec3::X * 0.1 * f64::from(at)).collect();
        let mut accepted: Vec<bool> = (0..100).map(|at| !(30..70).contains(&at)).collect();
        // The first and the last nine are nearer than 1 mm to an accepted one; rounding is allowed.
        let share = holes(&places, &accepted);
        assert!((0.19..=0.23).contains(&share), "{share}");
        // A second pass fills them.
        let places = [&places[..], &places[..]].concat();
        accepted.extend([true; 100]);
        assert_eq!(holes(&places, &accepted), 0.0);
        // Frames 2 mm apart bridge more.
        let places: Vec<DVec3> = (0..100).map(|at| DVec3::X * 2.0 * f64::from(at)).collect();
        let accepted: Vec<bool> = (0..100).map(|at| !(30..34).contains(&at)).collect();
        assert_eq!(holes(&places, &accepted), 0.0);
    }
}
