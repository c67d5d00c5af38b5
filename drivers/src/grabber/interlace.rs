//! Interlaced video: the time of each line of a buffer.
//!
//! The fields of a frame are half a frame apart. In 525-line standards (NTSC) the bottom field is
//! the older one, in all others the top field, unless the driver reports otherwise. Buffers that
//! hold one field after the other begin with the older one. A driver's stamp marks the end of the
//! frame, which is the newer field's end, or the start of its exposure, which is the older one's.

use super::pixels::{Field, Rows, Scan, Take};
use super::v4l2::system_calls::number;

/// Treatment of interlaced video.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Interlace {
    /// All lines as one frame, at the time between its fields: moving objects show combs.
    Whole,
    /// One field per frame: half the lines, no combs, half the fields. The default, because a
    /// probe moves.
    #[default]
    OneField,
    /// Both fields, each as a frame of half the lines with its own time. The lines of one field
    /// lie between those of the other: the first line of the bottom field lies half a line (of
    /// the new frame) lower than that of the top field. This offset is not corrected.
    BothFields,
}

/// Interlacing of a buffer: V4L2's `field`, interpreted with the video standard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Order {
    Progressive,
    /// Both fields in one buffer.
    Frame {
        scan: Scan,
        older: Field,
    },
    /// One field per buffer.
    Single(Field),
}

impl Order {
    /// Interprets `field`; `lines_525` marks NTSC and similar standards.
    pub(crate) const fn new(field: u32, lines_525: bool) -> Self {
        let usual = if lines_525 { Field::Bottom } else { Field::Top };
        match field {
            number::FIELD_INTERLACED => Self::Frame { scan: Scan::Interlaced, older: usual },
            number::FIELD_INTERLACED_TB => Self::Frame { scan: Scan::Interlaced, older: Field::Top },
            number::FIELD_INTERLACED_BT => Self::Frame { scan: Scan::Interlaced, older: Field::Bottom },
            number::FIELD_SEQ_TB => Self::Frame { scan: Scan::Sequential { first: Field::Top }, older: Field::Top },
            number::FIELD_SEQ_BT => {
                Self::Frame { scan: Scan::Sequential { first: Field::Bottom }, older: Field::Bottom }
            }
            number::FIELD_TOP | number::FIELD_ALTERNATE => Self::Single(Field::Top),
            number::FIELD_BOTTOM => Self::Single(Field::Bottom),
            _ => Self::Progressive,
        }
    }
}

/// A frame to extract from a buffer: its lines, and its offset from the buffer's stamp in
/// quarters of the frame time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Part {
    pub(crate) rows: Rows,
    pub(crate) quarters: i64,
}

/// Returns the frames of a buffer in the order of their times. `at_start` states which instant of
/// the frame the stamp marks.
pub(crate) fn parts(order: Order, policy: Interlace, at_start: bool) -> ([Part; 2], usize) {
    let whole = Part { rows: Rows::WHOLE, quarters: 0 };
    let Order::Frame { scan, older } = order else {
        // A single field is always a frame of its own, because the other field is in another
        // buffer. `OneField` keeps only the top one.
        let count = match (order, policy) {
            (Order::Single(field), Interlace::OneField) => field == Field::Top,
            _ => true,
        };
        return ([whole; 2], usize::from(count));
    };
    let [older_at, newer_at] = if at_start { [0, 2] } else { [-2, 0] };
    let field = |field, quarters| Part { rows: Rows { scan, take: Take::Field(field) }, quarters };
    match policy {
        Interlace::Whole => {
            let all = Part { rows: Rows { scan, take: Take::All }, quarters: (older_at + newer_at) / 2 };
            ([all; 2], 1)
        }
        // The field whose time needs no frame rate.
        Interlace::OneField if at_start => ([field(older, older_at); 2], 1),
        Interlace::OneField => ([field(older.other(), newer_at); 2], 1),
        Interlace::BothFields => ([field(older, older_at), field(older.other(), newer_at)], 2),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn taken(field: u32, ntsc: bool, policy: Interlace, at_start: bool) -> Vec<(Scan, Take, i64)> {
        let (parts, count) = parts(Order::new(field, ntsc), policy, at_start);
        parts[..count].iter().map(|part| (part.rows.scan, part.rows.take, part.quarters)).collect()
    }

    #[test]
    fn fields_follow_order_and_times_of_standard() {
        use Field::{Bottom, Top};
        use Take::Field as F;
        let seq = |first| Scan::Sequential { first };
        let both = Interlace::BothFields;
        let interlaced = Scan::Interlaced;
        // NTSC: bottom older. All others: top older. Two quarters of a frame are a field.
        assert_eq!(taken(4, true, both, false), [(interlaced, F(Bottom), -2), (interlaced, F(Top), 0)]);
        assert_eq!(taken(4, false, both, false), [(interlaced, F(Top), -2), (interlaced, F(Bottom), 0)]);
        assert_eq!(taken(4, false, both, true), [(interlaced, F(Top), 0), (interlaced, F(Bottom), 2)]);
        // The driver's own order takes precedence over the standard.
        assert_eq!(taken(8, true, both, false), [(interlaced, F(Top), -2), (interlaced, F(Bottom), 0)]);
        assert_eq!(taken(9, false, both, false), [(interlaced, F(Bottom), -2), (interlaced, F(Top), 0)]);
        assert_eq!(taken(5, true, both, false), [(seq(Top), F(Top), -2), (seq(Top), F(Bottom), 0)]);
        assert_eq!(taken(6, false, both, false), [(seq(Bottom), F(Bottom), -2), (seq(Bottom), F(Top), 0)]);
        // One field: the one that the stamp marks. The whole frame: between the two.
        assert_eq!(taken(4, true, Interlace::OneField, false), [(interlaced, F(Top), 0)]);
        assert_eq!(taken(4, true, Interlace::OneField, true), [(interlaced, F(Bottom), 0)]);
        assert_eq!(taken(4, true, Interlace::Whole, false), [(interlaced, Take::All, -1)]);
        assert_eq!(taken(6, true, Interlace::Whole, true), [(seq(Bottom), Take::All, 1)]);
    }

    #[test]
    fn single_fields_and_progressive_frames_stay_whole() {
        let whole = [(Scan::Progressive, Take::All, 0)];
        for policy in [Interlace::Whole, Interlace::OneField, Interlace::BothFields] {
            assert_eq!(taken(1, true, policy, false), whole);
            assert_eq!(taken(2, false, policy, true), whole);
            // An unknown field order counts as progressive.
            assert_eq!(taken(99, false, policy, false), whole);
        }
        assert_eq!(taken(3, false, Interlace::BothFields, false), whole);
        assert!(taken(3, false, Interlace::OneField, false).is_empty());
    }
}
