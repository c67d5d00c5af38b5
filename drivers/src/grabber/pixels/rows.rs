//! Which lines of a buffer make a picture.
//!
//! Interlaced video holds two moments: the even lines (the top field, from line 0) and the odd ones (the bottom field), half a frame apart. A
//! moving probe then has combs at its edges, so that fields are better taken one by one, each with its own time.

/// One of the two halves of an interlaced frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Field {
    /// Lines 0, 2, 4, …
    Top,
    /// Lines 1, 3, 5, …
    Bottom,
}

impl Field {
    /// The other one.
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

/// How a buffer's lines are ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Scan {
    /// Line after line, of one moment; or a field by itself.
    Progressive,
    /// The two fields' lines in turn, top field first in space.
    Interlaced,
    /// One field, then the other.
    Sequential {
        /// The field whose lines come first.
        first: Field,
    },
}

/// What of a buffer becomes the picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Take {
    /// All lines.
    All,
    /// Every other line.
    Field(Field),
}

/// Where a picture's lines are in a buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Rows {
    /// The buffer's order.
    pub scan: Scan,
    /// What is taken of it.
    pub take: Take,
}

impl Rows {
    /// All lines as they come.
    pub const WHOLE: Self = Self { scan: Scan::Progressive, take: Take::All };

    /// Lines of the picture, for a buffer of `height` lines. Both fields of a frame have as many.
    pub const fn lines(self, height: usize) -> usize {
        match self.take {
            Take::All => height,
            Take::Field(_) => height / 2,
        }
    }

    /// The buffer's line that is the picture's line `i`.
    pub fn line(self, i: usize, height: usize) -> usize {
        let [k, parity] = self.in_field(i);
        match self.scan {
            // The line where it belongs in the frame.
            Scan::Progressive | Scan::Interlaced => 2 * k + parity,
            Scan::Sequential { first } if parity == first.parity() => k,
            Scan::Sequential { first } => k + Self::first_field(first, height),
        }
    }

    /// The same for planes that have one line for two (4:2:0). Those of interlaced video belong to fields as the others do: two lines of the
    /// same field share one.
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

    /// The picture's line `i` as a line of its field, and the field's parity.
    const fn in_field(self, i: usize) -> [usize; 2] {
        match self.take {
            Take::All => [i / 2, i % 2],
            Take::Field(field) => [i, field.parity()],
        }
    }

    /// Lines of the field that comes first, of an odd number of lines the top one has one more.
    fn first_field(first: Field, height: usize) -> usize {
        match first {
            Field::Top => height.div_ceil(2),
            Field::Bottom => height / 2,
        }
    }
}
