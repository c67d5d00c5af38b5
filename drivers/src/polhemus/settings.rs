//! What is asked of a tracker, whatever its model.

use crate::Error;

/// How a tracker is to be set up.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// Stations to use, from 1, ascending.
    pub stations: Vec<u8>,
    /// Zenith of the hemisphere that all sensors stay in, in the transmitter's frame (x forward, y right, z down); all zeros let the unit follow the sensors from where
    /// they are when it is set up. A sensor in the other hemisphere is reported on its opposite side, without an error.
    pub hemisphere: [f32; 3],
    /// Numbers as singles, which is shorter on the wire and more exact, or as text.
    pub binary: bool,
    /// Station whose stylus has a button.
    pub stylus: Option<u8>,
    /// Readings a second of each station, at most: the unit is told the highest of its rates that is no higher and that its line carries, or else its lowest. Units
    /// with one rate (ISOTRAK, FASTRAK, PATRIOT) keep that.
    pub rate_hz: f64,
    /// Whether a unit that does not answer may be started anew, which takes 10 to 20 s and forgets what was set by hand.
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
    /// Refuses what no unit of so many stations can do.
    ///
    /// # Errors
    /// [`Error::Misuse`] that names the setting and what it may be.
    pub fn check(&self, most: u8) -> Result<(), Error> {
        let ascends = self.stations.is_sorted_by(|a, b| a < b);
        if self.stations.is_empty() || !ascends || self.stations.iter().any(|s| !(1..=most).contains(s)) {
            return Err(Error::Misuse(format!(
                "tracker.stations: {:?} are not stations of this unit; give some of 1 to {most}, each once, in order",
                self.stations
            )));
        }
        if self.hemisphere.iter().any(|x| !x.is_finite() || x.abs() > 1000.0) {
            return Err(Error::Misuse(format!(
                "tracker.hemisphere: {:?} is no direction; give three numbers, such as 1, 0, 0 for all in front of the transmitter",
                self.hemisphere
            )));
        }
        if !(1.0..=10_000.0).contains(&self.rate_hz) {
            return Err(Error::Misuse(format!(
                "tracker.rate_hz: {} readings a second are no rate of a tracker; give the most that you want, such as 240",
                self.rate_hz
            )));
        }
        match self.stylus {
            Some(stylus) if !self.stations.contains(&stylus) => Err(Error::Misuse(format!(
                "tracker.stylus: station {stylus} is not one of tracker.stations {:?}; add it there",
                self.stations
            ))),
            _ => Ok(()),
        }
    }
}
