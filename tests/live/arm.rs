//! An arm with unknown position: its readings are refused with a reason until it is homed, by
//! its index marks or by the user's confirmation.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use glam::{DQuat, DVec3};
use sonoweave::app::devices::{self, Devices};

use config::bedside::Bedside;
use drivers::simulated::{Faults, Joints, ea1};
use pipeline::session::SessionStatus;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::reading::AXES;
use sonoweave_core::refusal::Reason;
use sync::history::Rigid;
use sync::ingest::live::Gives;

use crate::plugs::{Line, grabber};
use crate::script::poses;
use crate::set::{Set, frames};

/// Message about an arm that is not homed.
const NOT_HOMED: &str = "not homed: move the arm to its home position and home it";

/// Joints that move to and fro between 0 and 4000 counts, 1000 per second.
fn joints() -> Joints {
    let begin_ns = Monotonic.now_ns();
    Arc::new(move |at_ns| {
        let gone = (at_ns - begin_ns).rem_euclid(8 * SECOND) / MS;
        let count = gone.min(8000 - gone);
        let mut all = [0; AXES];
        all[..3].fill(count);
        all
    })
}

/// Opens the arm from a session configuration; includes the flag to set when it is at home.
fn opened(line: &Line<ea1::Twin>) -> Devices {
    let text = format!(
        "format = \"sonoweave-bedside\"\nversion = 1\n[arm]\nkind = \"ea1\"\nport = \"{}\"\n[grabber]\ndevice = \"virtual\"\nsize = \"64x64\"\n[virtual]\nscene = \"blobs\"\n",
        line.path().display()
    );
    let bedside = Bedside::parse("bedside.toml".as_ref(), &text).unwrap();
    devices::open(&bedside, 0, false).unwrap()
}

/// Returns a session with the arm, and frames that differ.
fn set(arm: Box<dyn sonoweave_core::Device>) -> Set {
    let kinematics = |counts: &[f64]| {
        let position_mm = DVec3::new(0.0, 0.0, counts[0] * 0.01);
        Some(Rigid { rotation: DQuat::IDENTITY, position_mm })
    };
    let gives = Gives::Arm { joints: 3, kinematics: Box::new(kinematics), reach: Vec::new() };
    Set { tracking: arm, gives, ..Set::of(poses(0, 0), grabber(50.0)).waits(500 * MS) }
}

fn refused(status: &SessionStatus, reason: Reason) -> u64 {
    status.ledger.frames.refused.get(&reason).copied().unwrap_or(0)
}

#[test]
fn arm_is_unused_until_its_index_marks_are_passed() {
    // It rests at 1000 counts until it is moved past its marks, one count per ms.
    let moved_ns = Arc::new(AtomicI64::new(i64::MAX));
    let since = Arc::clone(&moved_ns);
    let mut twin = ea1::Twin::new(
        Arc::new(move |at_ns| {
            let gone = (at_ns.saturating_sub(since.load(Ordering::Relaxed)) / MS).clamp(0, 6000);
            let mut all = [0; AXES];
            all[..3].fill(1000 + gone.min(12_000 - gone));
            all
        }),
        Faults::default(),
    );
    twin.marks = [Some(2000); 3];
    let line = Line::new(twin);
    let opened = opened(&line);
    let (finished, seen) = set(opened.tracking).until(|status, _| {
        if moved_ns.load(Ordering::Relaxed) == i64::MAX && refused(status, Reason::PoseInvalid) >= 10 {
            assert_eq!(status.ledger.frames.used, 0);
            moved_ns.store(Monotonic.now_ns(), Ordering::Relaxed);
        }
        status.ledger.frames.used >= 30
    });
    let (total, used, reasons) = frames(&finished);
    assert!(
        reasons.iter().all(|(reason, _)| matches!(reason, Reason::PoseInvalid | Reason::PoseMissing)),
        "{reasons:?}"
    );
    assert_eq!(total, used + reasons.iter().map(|(_, count)| count).sum::<u64>());
    let first = &finished.status.ledger.first_refusals[&Reason::PoseInvalid];
    assert!(first.detail.starts_with("ProbeToTracker: ") && first.detail.contains(NOT_HOMED), "{first:?}");
    assert!(seen.said(0, "running", NOT_HOMED), "{:?}", seen.devices[0]);
    assert_eq!(seen.devices[0].iter().rev().find(|(state, _)| *state == "running").unwrap().1, "", "then all is well");
    let readings = &finished.status.ledger.readings[0];
    let not_homed: u64 = readings.refused.values().sum();
    assert!(not_homed > 0 && readings.used > 0 && readings.total == readings.used + not_homed, "{readings:?}");
}

#[test]
fn replugged_arm_must_be_homed_again_by_the_user() {
    let mut twin = ea1::Twin::new(joints(), Faults::default());
    twin.homed = 7;
    let mut line = Line::new(twin);
    let Devices { tracking, at_home, protocol, .. } = opened(&line);
    assert_eq!(protocol.unwrap().protocol, "ea1");
    let at_home = at_home.unwrap();
    let mut phase = 0;
    let mut mark = 0;
    let (finished, seen) = set(tracking).until(|status, _| {
        let used = status.ledger.frames.used;
        match phase {
            0 if used >= 20 => {
                line.pull();
                phase = 1;
            }
            1 if status.devices[0].state == "absent" => {
                line.plug_in();
                (phase, mark) = (2, refused(status, Reason::PoseInvalid));
            }
            2 if refused(status, Reason::PoseInvalid) >= mark + 10 => {
                at_home.store(true, Ordering::Relaxed);
                (phase, mark) = (3, used);
            }
            3 => return used >= mark + 20,
            _ => {}
        }
        false
    });
    let (total, used, reasons) = frames(&finished);
    assert!(used >= 40 && total == used + reasons.iter().map(|(_, count)| count).sum::<u64>());
    assert!(
        reasons.iter().all(|(reason, _)| matches!(reason, Reason::PoseInvalid | Reason::PoseMissing)),
        "{reasons:?}"
    );
    assert!(reasons.iter().any(|(reason, count)| *reason == Reason::PoseInvalid && *count >= 10), "{reasons:?}");
    assert!(seen.said(0, "running", NOT_HOMED), "{:?}", seen.devices[0]);
    assert!(seen.states(0).contains(&"absent"));
    assert_eq!(seen.devices[0].iter().rev().find(|(state, _)| *state == "running").unwrap().1, "", "homed again");
    assert_eq!(line.twin.lock().unwrap().homed, 7, "by the arm's own word");
}
