//! What a frame's body is made of: the unit's output list.

/// One entry of an output list. The numbers are not FASTRAK's: the quaternion is 7 here and 11 there.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Item {
    /// A blank.
    Space,
    /// Carriage return and line feed.
    CrLf,
    /// Position x, y, z in the unit that was set.
    Position,
    /// The same in extended precision, which in binary is no other.
    PositionExtended,
    /// Azimuth, elevation, roll in degrees.
    Euler,
    /// The same in extended precision, which in binary is no other.
    EulerExtended,
    /// Direction cosine matrix, row by row. That all nine numbers are sent is not verified.
    Cosines,
    /// Quaternion w, x, y, z.
    Quaternion,
    /// Milliseconds since the unit's clock was last set to 0.
    Timestamp,
    /// Number of the frame.
    FrameCount,
    /// The stylus' switch.
    Stylus,
    /// Distortion level, 0 to 2.
    Distortion,
    /// Flag of the external sync input.
    ExternalSync,
}

impl Item {
    /// By the number that stands for each in the command `O`.
    const ALL: [Self; 13] = [
        Self::Space,
        Self::CrLf,
        Self::Position,
        Self::PositionExtended,
        Self::Euler,
        Self::EulerExtended,
        Self::Cosines,
        Self::Quaternion,
        Self::Timestamp,
        Self::FrameCount,
        Self::Stylus,
        Self::Distortion,
        Self::ExternalSync,
    ];

    /// The number that stands for it in the command `O`.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// The item that a number of the command `O` stands for.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    const fn bytes(self) -> usize {
        match self {
            Self::Space => 1,
            Self::CrLf => 2,
            Self::Position | Self::PositionExtended | Self::Euler | Self::EulerExtended => 12,
            Self::Cosines => 36,
            Self::Quaternion => 16,
            Self::Timestamp | Self::FrameCount | Self::Stylus | Self::Distortion | Self::ExternalSync => 4,
        }
    }
}

/// Most entries of a list.
pub const MOST_ITEMS: usize = 32;

/// Longest body of a frame.
pub const LONGEST_BODY: usize = 1000;

/// Why a list of codes is none.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// A code that no unit has.
    #[error("output item {0} is not known; known are 0 to 12")]
    Unknown(u8),
    /// More entries than are taken here.
    #[error("{0} output items are more than the {MOST_ITEMS} that are taken")]
    TooMany(usize),
    /// A body longer than a unit sends.
    #[error("frames of {0} bytes are longer than the {LONGEST_BODY} that a unit sends; ask for fewer output items")]
    TooLong(usize),
}

/// What the body of every frame looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Layout {
    items: [Item; MOST_ITEMS],
    count: usize,
    body: usize,
}

impl Layout {
    /// The layout that a list of output codes leads to.
    ///
    /// There is no checksum. A byte lost within a frame shifts all that follow it, which the quaternion tells by its length: it should
    /// come last.
    ///
    /// # Errors
    /// [`ListError`] for codes and lengths that no unit has.
    pub fn new(codes: &[u8]) -> Result<Self, ListError> {
        if codes.len() > MOST_ITEMS {
            return Err(ListError::TooMany(codes.len()));
        }
        let mut items = [Item::Space; MOST_ITEMS];
        let mut body = 0;
        for (item, &code) in items.iter_mut().zip(codes) {
            *item = Item::from_code(code).ok_or(ListError::Unknown(code))?;
            body += item.bytes();
        }
        if body > LONGEST_BODY { Err(ListError::TooLong(body)) } else { Ok(Self { items, count: codes.len(), body }) }
    }

    /// The list, in order.
    pub fn items(&self) -> &[Item] {
        &self.items[..self.count]
    }

    /// Bytes of a frame's body.
    pub fn body(&self) -> usize {
        self.body
    }

    /// Bytes of a frame.
    pub fn length(&self) -> usize {
        super::HEADER + self.body
    }
}
