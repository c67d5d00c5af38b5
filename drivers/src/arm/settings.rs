//! Settings of an arm of any kind.

use crate::Error;

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
    /// [`Error::Setting`].
    pub fn check(&self, most_hz: u32) -> Result<(), Error> {
        let refused = |setting, problem: String| Err(Error::setting("arm", setting, problem));
        let Self { rate_hz, fastest, .. } = self;
        if !(1..=most_hz).contains(rate_hz) {
            return refused("rate_hz", format!("{rate_hz} readings a second are not possible; give 1 to {most_hz}"));
        }
        if *fastest < 100 {
            let example = "a value that no joint reaches, such as 400000";
            return refused("fastest", format!("{fastest} counts a second are too few for a joint; give {example}"));
        }
        match self.baud {
            Some(baud) if baud < 1200 => refused(
                "baud",
                format!("{baud} bits a second are too few for a serial line; give a rate such as 115200"),
            ),
            _ => Ok(()),
        }
    }
}
