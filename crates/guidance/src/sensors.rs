//! Share of each sensor's poses of the last second that the tracker reports as valid.

use std::collections::VecDeque;

use serde::Serialize;

use sonoweave_core::clock::SECOND;

/// Evaluated time window, ns.
const WINDOW_NS: i64 = SECOND;
/// Largest number of sensors, and of poses of each.
const MOST_SENSORS: usize = 16;
const MOST_POSES: usize = 1024;
/// Smallest number of poses for which a share is reported.
const LEAST: usize = 5;

/// Frame of the sensor on the body.
pub(super) const REFERENCE: &str = "Reference";

/// Report of a sensor.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SensorStatus {
    /// Its frame: `Probe`, `Reference`.
    pub name: String,
    /// Share of its poses that is invalid, 0 to 1.
    pub invalid: f64,
    /// Reason of the last invalid pose.
    pub why: String,
}

#[derive(Debug)]
struct Sensor {
    name: String,
    poses: VecDeque<(i64, bool)>,
    why: String,
}

/// All sensors.
#[derive(Debug, Default)]
pub struct Sensors {
    sensors: Vec<Sensor>,
}

impl Sensors {
    /// Adds a pose measured at a time, ns; and the reason why it is invalid, if so.
    pub fn add(&mut self, name: &str, time_ns: i64, invalid: Option<&str>) {
        let known = self.sensors.iter().position(|sensor| sensor.name == name);
        let at = match known {
            Some(at) => at,
            None if self.sensors.len() < MOST_SENSORS => {
                self.sensors.push(Sensor { name: name.into(), poses: VecDeque::new(), why: String::new() });
                self.sensors.len() - 1
            }
            None => return,
        };
        let sensor = &mut self.sensors[at];
        sensor.poses.push_back((time_ns, invalid.is_some()));
        if let Some(why) = invalid.filter(|why| **why != *sensor.why) {
            why.clone_into(&mut sensor.why);
        }
        let is_old = |(at_ns, _): &(i64, bool)| time_ns - at_ns > WINDOW_NS;
        while sensor.poses.len() > MOST_POSES || sensor.poses.front().is_some_and(is_old) {
            sensor.poses.pop_front();
        }
    }

    /// Returns the reports at a time, ns. A sensor without recent poses is left out, because its
    /// device is silent.
    pub fn status(&self, now_ns: i64) -> Vec<SensorStatus> {
        let status = |sensor: &Sensor| {
            let recent = sensor.poses.iter().filter(|(at_ns, _)| now_ns - at_ns <= WINDOW_NS);
            let (count, invalid) =
                recent.fold((0, 0), |(count, bad), (_, is_bad)| (count + 1, bad + usize::from(*is_bad)));
            (count >= LEAST).then(|| SensorStatus {
                name: sensor.name.clone(),
                invalid: invalid as f64 / count as f64,
                why: if invalid > 0 { sensor.why.clone() } else { String::new() },
            })
        };
        self.sensors.iter().filter_map(status).collect()
    }
}
