//! Which share of each sensor's poses of the last second is valid, by the tracker's own word.

use std::collections::VecDeque;

use drivers::clock::SECOND;
use serde::Serialize;

/// What is looked at, ns.
const WINDOW_NS: i64 = SECOND;
/// Sensors that are told apart, and poses of each.
const MOST_SENSORS: usize = 16;
const MOST_POSES: usize = 1024;
/// Fewer tell no share.
const LEAST: usize = 5;

/// A sensor, as it is told.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SensorTold {
    /// Its frame: `Probe`, `Reference`.
    pub name: String,
    /// Which share of its poses is not valid, 0 to 1.
    pub invalid: f64,
    /// Why the last of them was not.
    pub why: String,
}

#[derive(Debug)]
struct Sensor {
    name: String,
    poses: VecDeque<(i64, bool)>,
    why: String,
}

/// All of them.
#[derive(Debug, Default)]
pub struct Sensors {
    sensors: Vec<Sensor>,
}

impl Sensors {
    /// A pose was measured at a time, ns; and why it is not to be used, if so.
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

    /// What there is to tell at a time, ns. Of a sensor that says nothing any more nothing is told: its device is silent.
    pub fn told(&self, now_ns: i64) -> Vec<SensorTold> {
        let told = |sensor: &Sensor| {
            let recent = sensor.poses.iter().filter(|(at_ns, _)| now_ns - at_ns <= WINDOW_NS);
            let (count, invalid) =
                recent.fold((0, 0), |(count, bad), (_, is_bad)| (count + 1, bad + usize::from(*is_bad)));
            (count >= LEAST).then(|| SensorTold {
                name: sensor.name.clone(),
                invalid: invalid as f64 / count as f64,
                why: if invalid > 0 { sensor.why.clone() } else { String::new() },
            })
        };
        self.sensors.iter().filter_map(told).collect()
    }
}
