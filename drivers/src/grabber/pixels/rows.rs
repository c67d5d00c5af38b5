//! The rows of a buffer that form a frame.
//!
//! Interlaced video holds two instants: the even rows (the top field, from row 0) and the odd
//! ones (the bottom field), half a frame apart. A moving probe then shows combs at edges, so it
//! is better to take each field alone, with its own time.

/// One of the two halves of an interlaced frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Field {
    /// Rows 0, 2, 4, …
    Top,
    /// Rows 1, 3, 5, …
    Bottom,
}

impl Field {
    /// Returns the other field.
    pub const fn other(self) -> Self {
        match self {
            Self::Top => Self::Bottom,
            Self::Bottom => Self::Top,
        }
    }

    const fn parity(self) -> usize {
        match self {
            Self::Top => 0,
            Self::Bottom => 1,
        }
    }
}

/// Order of a buffer's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Scan {
    /// Row after row, of one instant; or a single field.
    Progressive,
    /// The rows of the two fields alternate, the top field above.
    Interlaced,
    /// One field, then the other.
    Sequential {
        /// The field whose rows come first.
        first: Field,
    },
}

/// Rows of a buffer that form the frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Take {
    /// All rows.
    All,
    /// Every other row.
    Field(Field),
}

/// Positions of a frame's rows in a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Rows {
    /// Row order of the buffer.
    pub scan: Scan,
    /// Selected rows.
    pub take: Take,
}

impl Rows {
    /// All rows in order.
    pub const WHOLE: Self = Self { scan: Scan::Progressive, take: Take::All };

    /// Returns the rows of the frame, for a buffer of `height` rows. Both fields of a frame have
    /// the same number.
    pub const fn lines(self, height: usize) -> usize {
        match self.take {
            Take::All => height,
            Take::Field(_) => height / 2,
        }
    }

    /// Returns the buffer's row that is row `i` of the frame.
    pub fn line(self, i: usize, height: usize) -> usize {
        let [k, parity] = self.in_field(i);
        match self.scan {
            // The row at its place in the frame.
            Scan::Progressive | Scan::Interlaced => 2 * k + parity,
            Scan::Sequential { first } if parity == first.parity() => k,
            Scan::Sequential { first } => k + Self::first_field(first, height),
        }
    }

    /// Returns the same for planes with one row for two (4:2:0). In interlaced video these rows
    /// also belong to fields: two rows of the same field share one.
    pub fn colour_line(self, i: usize, height: usize) -> usize {
        let [k, parity] = self.in_field(i);
        let lines = height.div_ceil(2);
        let line = match self.scan {
            Scan::Progressive => (2 * k + parity) / 2,
            Scan::Interlaced => 2 * (k / 2) + parity,
            Scan::Sequential { first } if parity == first.parity() => k / 2,
            Scan::Sequential { first } => k / 2 + Self::first_field(first, lines),
        };
        line.min(lines - 1)
    }

    /// Returns row `i` of the frame as a row of its field, and the field's parity.
    const fn in_field(self, i: usize) -> [usize; 2] {
        match self.take {
            Take::All => [i / 2, i % 2],
            Take::Field(field) => [i, field.parity()],
        }
    }

    /// Returns the rows of the field that comes first; for an odd height the top field has one
    /// more.
    fn first_field(first: Field, height: usize) -> usize {
        match first {
            Field::Top => height.div_ceil(2),
            Field::Bottom => height / 2,
        }
    }
}
