//! GET_, STT_, STP_ and RTS_: asking for messages, once or again and again, and the answer that it was heard.

use super::cursor::{Cursor, Trouble};
use super::fixed::Fixed;

/// What a question is about: the part of its type behind `GET_`, `STT_`, `STP_` or `RTS_`, which is cut where the field ends (`GET_CAPABIL`, `GET_TRANS`).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Subject(
    /// As on the wire.
    pub Fixed<8>,
);

impl Subject {
    /// Of a type by its whole name.
    pub fn of(kind: &str) -> Self {
        // The two that the reference library cuts, and where.
        let name = match kind {
            "TRANSFORM" => "TRANS",
            "CAPABILITY" => "CAPABIL",
            other => other.get(..8).unwrap_or(other),
        };
        Self(Fixed::new(name).unwrap_or(Fixed::EMPTY))
    }

    /// Whether it is about messages of this type: its name, or at least five letters of its beginning.
    pub fn is(&self, kind: &str) -> bool {
        let name = self.0.as_str();
        name == kind || (name.len() >= 5 && kind.starts_with(name))
    }
}

/// How a stream of TDATA is to be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pace {
    /// Least time between two messages, ms; 0 for as fast as it goes.
    pub interval_ms: u32,
    /// The coordinate system to be used; empty for the usual one.
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
    fn a_question_s_subject_is_known_by_its_beginning() {
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
