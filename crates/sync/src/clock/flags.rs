//! Flags of a measurement's time.

use std::fmt;
use std::ops::{BitOr, BitOrAssign};

use serde::{Deserialize, Serialize};

/// Flags of a measurement's time. No flag means that the clock was locked and the sample as
/// expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct TimeFlags(u16);

macro_rules! flags {
    ($($(#[$doc:meta])* $name:ident = $bit:literal, $word:literal;)*) => {
        impl TimeFlags {
            $($(#[$doc])* pub const $name: Self = Self(1 << $bit);)*
            const WORDS: &[(Self, &str)] = &[$((Self::$name, $word)),*];
        }
    };
}

flags! {
    /// Received more than [`super::LATE_NS`] after the expected time: it was delayed on the
    /// way. Its time is the clock's, not the host's.
    LATE = 0, "late";
    /// Received before the clock's measurement time, by more than the clock's bound. Either the
    /// clock was late until now or stepped, or the host's stamp is wrong.
    EARLY = 1, "early";
    /// Its ticks or its host time do not follow from earlier ones; if more like it arrive, they
    /// begin a new epoch.
    STEP = 2, "step";
    /// Same ticks as the sample before, or a duplicate record.
    REPEATED = 3, "repeated";
    /// Its ticks precede those of an earlier sample.
    OUT_OF_ORDER = 4, "out_of_order";
    /// Records before it are missing.
    GAP = 5, "gap";
    /// The device gives no ticks: the measurement's number is inferred from the time of
    /// arrival.
    INFERRED = 6, "inferred";
    /// The clock was being acquired.
    ACQUIRING = 7, "acquiring";
    /// The clock runs on its last rate, since nothing timely was received for a while.
    HOLDOVER = 8, "holdover";
    /// The clock was lost: the bound is meaningless.
    LOST = 9, "lost";
    /// The time is the host's minus the known delays; no clock was used.
    RECEIVED = 10, "received";
}

impl TimeFlags {
    /// No flag.
    pub const NONE: Self = Self(0);

    /// Whether all of the other's flags are set.
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Returns these flags without the other's.
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The flags that are set, by name.
    pub fn words(self) -> impl Iterator<Item = &'static str> {
        Self::WORDS.iter().filter(move |(flag, _)| self.has(*flag)).map(|(_, word)| *word)
    }
}

impl BitOr for TimeFlags {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl BitOrAssign for TimeFlags {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

impl fmt::Display for TimeFlags {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let words: Vec<_> = self.words().collect();
        f.write_str(&words.join(", "))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_flag_has_one_bit_and_one_word() {
        let mut seen = TimeFlags::NONE;
        for (flag, word) in TimeFlags::WORDS {
            assert!(!seen.has(*flag), "{word}");
            assert_eq!(flag.to_string(), *word);
            seen |= *flag;
        }
        assert_eq!((TimeFlags::LATE | TimeFlags::GAP).to_string(), "late, gap");
        assert_eq!((TimeFlags::LATE | TimeFlags::GAP).without(TimeFlags::LATE), TimeFlags::GAP);
        assert_eq!(TimeFlags::NONE.to_string(), "");
    }
}
