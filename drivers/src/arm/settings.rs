//! What is asked of an arm, whatever its kind.

use crate::Error;

/// How an arm is to be set up, and what it can do.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// Readings a second.
    pub rate_hz: u32,
    /// Counts a second that no joint ever reaches. What moved farther between two readings did not move: it was reset or lost steps.
    pub fastest: u32,
    /// Counts a revolution (of a sliding joint: a metre) that the arm has to say of its first three joints; 0 where it is not known.
    pub counts_per_turn: [u32; 3],
    /// Bits a second; `None` for what is usual.
    pub baud: Option<u32>,
}

impl Default for Settings {
    /// Encoders of 10000 to 100000 counts a revolution.
    fn default() -> Self {
        Self { rate_hz: 100, fastest: 400_000, counts_per_turn: [0; 3], baud: None }
    }
}

impl Settings {
    /// Of an arm whose encoders have 14 bits.
    pub fn of_14_bits() -> Self {
        Self { fastest: 20_000, ..Self::default() }
    }

    /// Refuses what no arm can do.
    ///
    /// # Errors
    /// [`Error::Misuse`] that names the setting and what it may be.
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
