//! Ground truth: the sensors' poses at each time that the virtual unit measured them.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};

use drivers::simulated::{Motion, Placed};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::reading::{Pose, Status};

/// A path of sensors, and the part of it that the unit has measured.
#[derive(Clone)]
pub(crate) struct Truth {
    seen: Arc<Mutex<Vec<(u8, i64, Placed)>>>,
    begin_ns: i64,
}

impl Truth {
    /// Creates sensors that never return to the same position within minutes.
    pub(crate) fn new() -> Self {
        Self { seen: Arc::default(), begin_ns: Monotonic.now_ns() }
    }

    /// Returns the motion that the unit measures.
    pub(crate) fn motion(&self) -> Motion {
        let Self { seen, begin_ns } = self.clone();
        Arc::new(move |station, ns| {
            let s = (ns - begin_ns) as f64 / SECOND as f64;
            let [a, b, c] = [0.37, 0.83, 1.29].map(|hz| (s * hz * std::f64::consts::TAU + f64::from(station)).sin());
            let q = [1.0, 0.5 * b, 0.7 * c, 0.3 * a];
            let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            let placed = Placed {
                position_cm: [30.0 + 8.0 * a + 0.01 * s, 12.0 * b, -20.0 + 5.0 * c],
                quaternion_wxyz: q.map(|x| x / length),
            };
            seen.lock().unwrap().push((station, ns, placed));
            placed
        })
    }

    /// Checks that each pose equals a measured one, to the last bit of the wire's single
    /// precision. Checks also that no station has gaps between its first and last pose. Returns
    /// the longest time from a measurement to its pose, ns.
    pub(crate) fn assert_exact(&self, poses: &[Pose]) -> i64 {
        let seen = self.seen.lock().unwrap();
        let single = |x: f64| f64::from(x as f32);
        let mut by_station: BTreeMap<u8, Vec<&Pose>> = BTreeMap::new();
        for pose in poses {
            by_station.entry(pose.station).or_default().push(pose);
        }
        let mut latest = 0;
        for (station, poses) in by_station {
            let truth: Vec<_> = seen.iter().filter(|(of, ..)| *of == station).collect();
            let is = |pose: &Pose, (_, _, placed): &(u8, i64, Placed)| {
                placed.position_cm.map(single) == pose.position_cm
                    && placed.quaternion_wxyz.map(single) == pose.quaternion_wxyz
            };
            let first = truth.iter().position(|t| is(poses[0], t));
            let first = first.unwrap_or_else(|| panic!("the unit was never there: {:?}", poses[0]));
            for (n, pose) in poses.iter().enumerate() {
                let at = truth[first + n];
                assert!(
                    is(pose, at),
                    "the {n}th of {} poses of station {station}: {pose:?} is not {at:?}",
                    poses.len()
                );
                assert_eq!(pose.status, Status::Ok, "{pose:?}");
                if let (Some(ticks), Some(zero)) = (pose.stamp.ticks, poses[0].stamp.ticks) {
                    assert_eq!(ticks, zero + n as u64);
                }
                let age = pose.stamp.host_ns.unwrap() - at.1;
                assert!((0..3 * SECOND).contains(&age), "measured {} ms before it was here", age / MS);
                latest = latest.max(age);
            }
        }
        latest
    }
}
