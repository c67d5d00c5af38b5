//! Settings of a tracker of any model.

use crate::Error;

/// Set-up of a tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Stations to use, from 1, ascending.
    pub stations: Vec<u8>,
    /// Zenith of the hemisphere that contains all sensors, in the transmitter's frame (x forward,
    /// y right, z down). All zeros make the unit follow the sensors from their positions at
    /// set-up. A sensor in the other hemisphere is reported on its opposite side, without an
    /// error.
    pub hemisphere: [f32; 3],
    /// Whether numbers are sent as singles, which are shorter and more exact than text.
    pub binary: bool,
    /// Station whose stylus has a button.
    pub stylus: Option<u8>,
    /// Maximum number of readings per second of each station. The driver selects the highest rate
    /// up to this that the line carries, or else the unit's lowest. Units with one rate (ISOTRAK,
    /// FASTRAK, PATRIOT) keep it.
    pub rate_hz: f64,
    /// Whether the driver may restart a unit that does not answer. A restart takes 10 to 20 s and
    /// clears manual settings.
    pub may_reset: bool,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            stations: vec![1],
            hemisphere: [1.0, 0.0, 0.0],
            binary: true,
            stylus: None,
            rate_hz: 240.0,
            may_reset: true,
        }
    }
}

impl Settings {
    /// Checks these settings for a unit with `most` stations.
    ///
    /// # Errors
    /// [`Error::Setting`].
    pub fn check(&self, most: u8) -> Result<(), Error> {
        let refused = |setting, problem: String| Err(Error::setting("tracker", setting, problem));
        let Self { stations, hemisphere, rate_hz, .. } = self;
        let ascends = stations.is_sorted_by(|a, b| a < b);
        if stations.is_empty() || !ascends || stations.iter().any(|s| !(1..=most).contains(s)) {
            let problem =
                format!("{stations:?} are not stations of this unit; give some of 1 to {most}, each once, in order");
            return refused("stations", problem);
        }
        if hemisphere.iter().any(|x| !x.is_finite() || x.abs() > 1000.0) {
            let example = "three numbers, such as 1, 0, 0 for all in front of the transmitter";
            return refused("hemisphere", format!("{hemisphere:?} is not a direction; give {example}"));
        }
        if !(1.0..=10_000.0).contains(rate_hz) {
            let problem =
                format!("{rate_hz} readings a second are not possible; give the highest rate to use, such as 240");
            return refused("rate_hz", problem);
        }
        match self.stylus {
            Some(stylus) if !stations.contains(&stylus) => {
                refused("stylus", format!("station {stylus} is not one of tracker.stations {stations:?}; add it there"))
            }
            _ => Ok(()),
        }
    }
}
