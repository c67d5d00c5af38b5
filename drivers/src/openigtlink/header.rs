//! The header of every message.

use crc::{CRC_64_ECMA_182, Crc, Table};

use super::cursor::{Cursor, Fault, Trouble};
use super::fixed::Fixed;

/// Remedy for bytes that are not a message.
pub(super) const CHECK_SENDER: &str = "check that the sender speaks OpenIGTLink";

/// Bytes of a header.
pub const HEADER: usize = 58;

/// CRC of the body. The table of sixteen rows takes 32 KiB, and checks a volume of 10 MB in a few
/// milliseconds.
static BODY: Crc<u64, Table<16>> = Crc::<u64, Table<16>>::new(&CRC_64_ECMA_182);

/// Returns the checksum of a body.
pub fn checksum(body: &[u8]) -> u64 {
    BODY.checksum(body)
}

/// The header version, which is not the protocol version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Version {
    /// Header of protocol versions 1 and 2.
    One = 1,
    /// Header of protocol version 3: the body has an extended header and metadata.
    Two = 2,
}

/// Seconds since 1970-01-01 UTC in 32 bits, and their fraction in 32 more; 0 for none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct TimeStamp(
    /// Value on the wire.
    pub u64,
);

const NS: u64 = 1_000_000_000;

impl TimeStamp {
    /// Converts nanoseconds since 1970-01-01 UTC; wraps in 2106, as the protocol specifies.
    pub const fn of_unix_ns(ns: u64) -> Self {
        let fraction = (((ns % NS) << 32) + NS / 2) / NS;
        // The last half step of 2⁻³² s rounds up to the next second.
        Self(((ns / NS) << 32).wrapping_add(fraction))
    }

    /// Returns nanoseconds since 1970-01-01 UTC; `None` if there is no time.
    pub const fn unix_ns(self) -> Option<u64> {
        if self.0 == 0 {
            return None;
        }
        Some((self.0 >> 32) * NS + (((self.0 & 0xffff_ffff) * NS + (1 << 31)) >> 32))
    }
}

/// Header of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Header {
    /// Header version.
    pub version: Version,
    /// Type of the body.
    pub kind: Fixed<12>,
    /// Device name of the sender.
    pub device: Fixed<20>,
    /// Time of creation.
    pub time: TimeStamp,
    /// Bytes of the body.
    pub body: u64,
    /// Checksum of the body.
    pub checksum: u64,
}

impl Header {
    /// Reads a header, if these bytes can begin a message.
    pub(super) fn read(bytes: &[u8; HEADER]) -> Result<Self, Trouble> {
        let mut fields = Cursor::new(bytes, 0);
        let version = match fields.u16("the header's version")? {
            1 => Version::One,
            2 => Version::Two,
            other => {
                let problem = format!("the header's version is {other}, not 1 or 2; {CHECK_SENDER}");
                return Err(Trouble { fault: Fault::Header, offset: 0, problem });
            }
        };
        let name = fields.array::<12>("the type")?;
        let letters = name.iter().position(|byte| *byte == 0).unwrap_or(12);
        let wrong = name[..letters]
            .iter()
            .position(|byte| !byte.is_ascii_graphic())
            .or_else(|| (letters == 0).then_some(0))
            .or_else(|| name[letters..].iter().position(|byte| *byte != 0).map(|at| at + letters));
        let (kind, None) = (Fixed::read(&name).unwrap_or(Fixed::EMPTY), wrong) else {
            let problem = format!("the type is not a name in ASCII; {CHECK_SENDER}");
            return Err(Trouble { fault: Fault::Header, offset: 2 + wrong.unwrap_or(0), problem });
        };
        let device = fields.name("the device's name").map_err(|trouble| Trouble { fault: Fault::Header, ..trouble })?;
        let time = TimeStamp(fields.array("the time").map(u64::from_be_bytes)?);
        let body = fields.array("the body's size").map(u64::from_be_bytes)?;
        let checksum = fields.array("the checksum").map(u64::from_be_bytes)?;
        Ok(Self { version, kind, device, time, body, checksum })
    }

    /// Returns the header as bytes.
    pub fn bytes(&self) -> [u8; HEADER] {
        let mut bytes = [0; HEADER];
        bytes[..2].copy_from_slice(&(self.version as u16).to_be_bytes());
        bytes[2..14].copy_from_slice(self.kind.bytes());
        bytes[14..34].copy_from_slice(self.device.bytes());
        bytes[34..42].copy_from_slice(&self.time.0.to_be_bytes());
        bytes[42..50].copy_from_slice(&self.body.to_be_bytes());
        bytes[50..].copy_from_slice(&self.checksum.to_be_bytes());
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_round_trip_to_the_nanosecond() {
        assert_eq!(TimeStamp::default().unix_ns(), None);
        assert_eq!(TimeStamp::of_unix_ns(1_500_000_000).0, 0x1_8000_0000);
        for ns in [1, 999_999_999, 1_234_567_890_500_000_000, 1_763_829_000_123_456_789, u64::from(u32::MAX) * NS] {
            assert_eq!(TimeStamp::of_unix_ns(ns).unix_ns(), Some(ns));
        }
        // The reference library's half second lacks the last bit.
        assert_eq!(TimeStamp(0x4996_02d2_7fff_ffff).unix_ns(), Some(1_234_567_890_500_000_000));
    }
}
