//! A probe that passes through a distorted region of the tracker's field.

use std::sync::Arc;

use glam::DVec3;

use calibration::tracker::zones::{Zone, Zones};
use drivers::replay::Pace;
use formats::session::WriterOptions;
use pipeline::session::{InZones, Watch};

use crate::replay::again;
use crate::script::{begin, frames as all_frames, poses};
use crate::set::{Memory, Set, frames};

/// Zones of 9 mm, at heights of 18 and 45 mm: the probe moves 0.8 mm from frame to frame along
/// z.
fn watch() -> Watch {
    let zone = |z: f64| Zone { low_mm: DVec3::new(0.0, 0.0, z), rms_mm: 3.5 };
    Watch { sensor: "Probe".into(), zones: Arc::new(Zones::new(9.0, 1.0, None, vec![zone(18.0), zone(45.0)])) }
}

#[test]
fn frames_in_zones_are_used_and_counted_also_by_replay() {
    let (begin_ns, disk) = (begin(), Memory::default());
    let set = Set::of(poses(begin_ns, 60), all_frames(begin_ns, 60));
    let set = Set { watch: Some(watch()), ..set }.recorded(disk.clone(), WriterOptions::new("a test"), 0);
    let (finished, _) = set.run();
    let (total, used, _) = frames(&finished);
    assert_eq!((total, used), (60, 60), "{}", finished.status.ledger);
    // Frames 23 to 33 at 18.4 to 26.4 mm, frames 57 to 59 at 45.6 to 47.2 mm: the last one is
    // still inside.
    let found = finished.status.distortion.unwrap();
    assert_eq!(found, InZones { zones: 2, frames: 14, entered: 2, rms_mm: Some(3.5) });
    let again = |watch: Option<Watch>| {
        let (replayed, decisions) =
            again(&disk, 5_000_000_000, Pace::Unpaced, false, |session, _| session.watch = watch);
        assert_eq!(decisions.differences().count, 0, "{:?}", decisions.differences().first);
        replayed.status.distortion
    };
    assert_eq!([again(Some(watch())), again(None)], [Some(found), None]);
}
