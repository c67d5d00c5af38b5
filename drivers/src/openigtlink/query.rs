//! GET_, STT_, STP_ and RTS_: requests for one message or for a stream, and their
//! acknowledgement.

use super::cursor::{Cursor, Trouble};
use super::fixed::Fixed;

/// Subject of a request: the part of its type behind `GET_`, `STT_`, `STP_` or `RTS_`, truncated
/// at the end of the field (`GET_CAPABIL`, `GET_TRANS`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Subject(
    /// Name on the wire.
    pub Fixed<8>,
);

impl Subject {
    /// Returns the subject for the full name of a type.
    pub fn of(kind: &str) -> Self {
        // The reference library truncates these two, at these places.
        let name = match kind {
            "TRANSFORM" => "TRANS",
            "CAPABILITY" => "CAPABIL",
            other => other.get(..8).unwrap_or(other),
        };
        Self(Fixed::new(name).unwrap_or(Fixed::EMPTY))
    }

    /// Returns whether the subject is this type: its name, or at least its first five letters.
    pub fn is(&self, kind: &str) -> bool {
        let name = self.0.as_str();
        name == kind || (name.len() >= 5 && kind.starts_with(name))
    }
}

/// Parameters of a TDATA stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pace {
    /// Minimum time between two messages, ms; 0 for the highest rate.
    pub interval_ms: u32,
    /// Name of the coordinate system; empty for the default.
    pub frame: Fixed<32>,
}

impl Pace {
    pub(super) fn read(mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let interval_ms = fields.u32("the interval")?;
        let frame = fields.name("the coordinate system's name")?;
        fields.end("the coordinate system's name")?;
        Ok(Self { interval_ms, frame })
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.interval_ms.to_be_bytes());
        out.extend_from_slice(self.frame.bytes());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn subject_matches_full_and_truncated_names() {
        for (kind, short) in [("IMAGE", "IMAGE"), ("TRANSFORM", "TRANS"), ("CAPABILITY", "CAPABIL"), ("TDATA", "TDATA")]
        {
            let subject = Subject::of(kind);
            assert_eq!(subject.0.as_str(), short);
            assert!(subject.is(kind));
        }
        assert!(Subject(Fixed::new("TRANSFOR").unwrap()).is("TRANSFORM"));
        assert!(!Subject(Fixed::new("TRAN").unwrap()).is("TRANSFORM"));
        assert!(!Subject::of("IMAGE").is("IMGMETA"));
        assert!(!Subject(Fixed::EMPTY).is("IMAGE"));
    }
}
