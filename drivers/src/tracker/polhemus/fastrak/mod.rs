//! FASTRAK's wire format, text and binary; the text of ISOTRAK and ISOTRAK II is the same (one
//! list for all their stations).
//!
//! | | |
//! |---|---|
//! | Clock | none: records carry neither a time nor a number |
//! | Tick | the unit's cycle, 1/120 s divided by the stations in use (ISOTRAK II: 1/60 s) |
//! | Wrap | nothing to wrap |
//! | Instant | the centre of the sampling window, 3.75 ms before the record's first byte (FASTRAK, without filters; the filters add up to 158 ms) |
//!
//! A record is three bytes (`'0'`, station, error letter) and the items of the [output
//! list](Layout). In text the items have fixed columns without separators; in binary they are
//! singles. There is no checksum, so every part of a record must be valid: the station in use, a
//! printable letter, columns or numbers and line end as the list requires. Binary numbers must
//! also be within the measuring range. A sequence that begins with `'2'` and ends with CR LF is a
//! [`Reply`], also amid records.
//!
//! Synchronisation: the decoder accepts a record when a second one, or a reply, follows at its
//! end. From then on it delivers each valid record at its last byte, until one is invalid; then
//! it searches again from the next byte. Replies are always delivered.
//!
//! The quaternion, the angles and the cosines describe the sensor in the transmitter's frame: x
//! forward, y right, z down; R = Rz(azimuth) · Ry(elevation) · Rx(roll). The unit of positions
//! (inches, cm) is a setting that records do not carry; [`Status`] gives it.

pub mod command;
mod limits;
mod list;
mod pose;
mod record;
pub mod reply;
mod unit;
pub mod write;

pub use command::Command;
pub use limits::{LONGEST_REPLY, STATIONS};
pub use list::{Entry, Item, LONGEST_RECORD, Layout, MOST_ENTRIES, Mode};
pub use pose::Pose;
pub use reply::{Reply, Status};
pub(super) use unit::judge_stations;
pub use unit::{FastrakProtocol, Question, Unit, status_of};

use crate::framing::{Format, Parsed, Refusal};

/// A record or reply from the unit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Record<'a> {
    /// A measurement of a station.
    Pose(&'a Pose),
    /// An answer to a command, or an error.
    Reply(Reply<'a>),
}

/// Reads FASTRAK records and replies; also those of ISOTRAK and ISOTRAK II in text.
#[derive(Debug, Clone)]
pub struct Fastrak {
    /// Layouts of stations 1 to 4; `None` for those not in use.
    layouts: [Option<Layout>; STATIONS],
    longest: usize,
    reply_bytes: usize,
    locked: bool,
    /// The last record and its successor, which confirms it. They are stored here because copying
    /// a pose would take longer than reading it.
    pose: Pose,
    next: Pose,
}

impl Fastrak {
    /// Creates a format for stations with these layouts; without any layout it reads only
    /// replies.
    pub fn new(layouts: [Option<Layout>; STATIONS]) -> Self {
        let used = || layouts.iter().flatten();
        Self {
            layouts,
            longest: used().map(Layout::length).max().unwrap_or(0),
            reply_bytes: used().map(Layout::reply_bytes).max().unwrap_or(LONGEST_REPLY),
            locked: false,
            pose: Pose::empty(0, b' '),
            next: Pose::empty(0, b' '),
        }
    }

    /// Creates a format for a unit whose first `stations` stations share one layout.
    pub fn uniform(stations: usize, layout: Layout) -> Self {
        let mut layouts = [None; STATIONS];
        layouts.iter_mut().take(stations).for_each(|each| *each = Some(layout));
        Self::new(layouts)
    }

    /// Creates a format for set-up: replies are read, everything else is skipped.
    pub fn replies() -> Self {
        Self::new([None; STATIONS])
    }

    /// Returns the layouts of stations 1 to 4.
    pub fn layouts(&self) -> &[Option<Layout>; STATIONS] {
        &self.layouts
    }

    /// Judges the window while unsynchronised, or when something other than a record begins.
    #[cold]
    fn search<'a>(&'a mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        match judge(&self.layouts, self.reply_bytes, window, &mut self.pose) {
            Parsed::Record { length, record: None } => {
                match judge(&self.layouts, self.reply_bytes, &window[length..], &mut self.next) {
                    Parsed::Record { .. } => {
                        self.locked = true;
                        Parsed::Record { length, record: Record::Pose(&self.pose) }
                    }
                    Parsed::Skip { .. } => Parsed::skip_byte(Refusal::Unconfirmed),
                    Parsed::Short => Parsed::Short,
                }
            }
            Parsed::Record { length, record: Some(reply) } => Parsed::Record { length, record: Record::Reply(reply) },
            Parsed::Skip { bytes, why } => {
                self.locked = false;
                Parsed::Skip { bytes, why }
            }
            Parsed::Short => Parsed::Short,
        }
    }
}

/// Judges the beginning of the window in either state: returns a reply, or `None` for a pose.
fn judge<'a>(
    layouts: &[Option<Layout>; STATIONS],
    reply_bytes: usize,
    window: &'a [u8],
    pose: &mut Pose,
) -> Parsed<Option<Reply<'a>>> {
    match window.first() {
        None => Parsed::Short,
        Some(b'0') => judge_record(layouts, window, pose).map(|()| None),
        Some(b'2') => reply::judge(window, reply_bytes).map(Some),
        Some(_) => Parsed::skip_byte(Refusal::Noise),
    }
}

#[inline(always)]
fn judge_record(layouts: &[Option<Layout>; STATIONS], window: &[u8], pose: &mut Pose) -> Parsed<()> {
    let layout = match window.get(1) {
        None => return Parsed::Short,
        Some(station) => match layouts.get(usize::from(station.wrapping_sub(b'1'))) {
            Some(Some(layout)) => layout,
            _ => return Parsed::skip_byte(Refusal::Header),
        },
    };
    if window.get(2).is_some_and(|error| !(0x20..0x7f).contains(error)) {
        return Parsed::skip_byte(Refusal::Header);
    }
    let Some(bytes) = window.get(..layout.length()) else {
        return Parsed::Short;
    };
    match record::read(bytes, layout, pose) {
        Ok(()) => Parsed::Record { length: bytes.len(), record: () },
        Err(why) => Parsed::skip_byte(why),
    }
}

impl Format for Fastrak {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        2 * self.longest.max(self.reply_bytes)
    }

    /// Three times the longest record (168 bytes at most for records shorter than a status
    /// reply).
    fn lock_bytes(&self) -> usize {
        self.longest + self.reply_bytes.max(2 * self.longest)
    }

    #[inline]
    fn parse<'a>(&'a mut self, window: &'a [u8]) -> Parsed<Record<'a>> {
        if self.locked && window[0] == b'0' {
            let parsed = judge_record(&self.layouts, window, &mut self.pose);
            self.locked = !matches!(parsed, Parsed::Skip { .. });
            return parsed.map(|()| Record::Pose(&self.pose));
        }
        self.search(window)
    }

    fn interrupted(&mut self) {
        self.locked = false;
    }
}
