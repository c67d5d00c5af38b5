//! Settings of an arm of any kind.

use sonoweave_core::Error;

/// Set-up and limits of an arm.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Readings per second.
    pub rate_hz: u32,
    /// Counts per second that no joint ever reaches. A faster change between two readings is a
    /// reset or lost steps.
    pub fastest: u32,
    /// Counts per revolution (of a sliding joint: per metre) that the arm must report for its
    /// first three joints; 0 if unknown.
    pub counts_per_turn: [u32; 3],
    /// Bits per second; `None` for the usual rate.
    pub baud: Option<u32>,
}

impl Default for Settings {
    /// Returns settings for encoders of 10000 to 100000 counts per revolution.
    fn default() -> Self {
        Self { rate_hz: 100, fastest: 400_000, counts_per_turn: [0; 3], baud: None }
    }
}

impl Settings {
    /// Returns settings for an arm whose encoders have 14 bits.
    pub fn of_14_bits() -> Self {
        Self { fastest: 20_000, ..Self::default() }
    }

    /// Checks these settings for an arm with at most `most_hz` readings per second.
    ///
    /// # Errors
    /// [`Error::Misuse`] that names the setting and its valid values.
    pub fn check(&self, most_hz: u32) -> Result<(), Error> {
        let refused = |what: String| Err(Error::Misuse(what));
        if !(1..=most_hz).contains(&self.rate_hz) {
            return refused(format!(
                "arm.rate_hz: {} readings a second are not to be had; give 1 to {most_hz}",
                self.rate_hz
            ));
        }
        if self.fastest < 100 {
            return refused(format!(
                "arm.fastest: {} counts a second are less than a joint at rest may need; give what no joint reaches, such as 400000",
                self.fastest
            ));
        }
        match self.baud {
            Some(baud) if baud < 1200 => refused(format!(
                "arm.baud: {baud} bits a second are no rate of a serial line; give one, such as 115200"
            )),
            _ => Ok(()),
        }
    }
}
