//! FASTRAK's wire format, text and binary; the text of ISOTRAK and ISOTRAK II is the same (one list for all their stations).
//!
//! | | |
//! |---|---|
//! | Clock | none: records carry neither a time nor a number |
//! | Tick | the unit's cycle, 1/120 s divided by the stations in use (ISOTRAK II: 1/60 s) |
//! | Wrap | nothing to wrap |
//! | Instant | the centre of the sampling window, 3.75 ms before the record's first byte (FASTRAK, without filters; the filters add up to 158 ms) |
//!
//! A record is three bytes (`'0'`, station, error letter) and the items of the [output list](Layout), in text at fixed columns without anything
//! between them, in binary as singles. There is no checksum, so that a record is believed only if everything about it is right: station in use,
//! letter printable, columns or numbers and line end as the list says, in binary also numbers that a tracker can measure. What begins
//! with `'2'` and ends with CR LF is a [`Reply`], also amid records.
//!
//! Finding the beginning: a record counts when a second one, or a reply, follows at its end. From then on each good record is given at its last
//! byte, until one is not good; then the search goes on one byte further. Replies are given wherever they are found.
//!
//! The quaternion, the angles and the cosines describe the sensor in the transmitter's frame: x forward, y right, z down; R = Rz(azimuth) ·
//! Ry(elevation) · Rx(roll). The unit of positions (inches, cm) is a setting of the unit that its records do not carry; [`Status`] tells.

mod columns;
pub mod command;
mod list;
pub mod reply;
mod unit;
pub mod write;

pub use command::Command;
pub use list::{Entry, Item, LONGEST_RECORD, Layout, ListError, MOST_ENTRIES, Mode};
pub use reply::{Reply, Status};
pub(super) use unit::judge_stations;
pub use unit::{Question, Speech, Unit, status_of};

use crate::framing::{Format, Look, Refusal};

/// Most stations of a unit.
pub const STATIONS: usize = 4;

/// Longest reply that is waited for: the answer to `O` with a full list has 69 bytes, the status 55.
pub const LONGEST_REPLY: usize = 128;

/// Among short records a reply has to end sooner, so that what only looks like the beginning of one does not hold records up; a status still fits.
const FEWEST_REPLY_BYTES: usize = 56;

/// Farthest that a binary position may be, in the unit that was set.
const FARTHEST: f64 = 500.0;

/// What the unit sends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Record<'a> {
    /// A station's measurement.
    Pose(&'a Pose),
    /// An answer to a command, or an error.
    Reply(Reply<'a>),
}

/// A station's measurement: what its output list asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Station, from 1.
    pub station: u8,
    /// The unit's last error as its letter; a blank for none. It can be older than this record, so it qualifies the pose and does not refute it.
    pub error: u8,
    /// Position in the unit that was set (inches by default, or cm).
    pub position: Option<[f64; 3]>,
    /// Position relative to the last such record, in the same unit.
    pub relative_position: Option<[f64; 3]>,
    /// Azimuth, elevation, roll in degrees.
    pub euler_deg: Option<[f64; 3]>,
    /// Rows of the direction cosine matrix.
    pub cosines: [Option<[f64; 3]>; 3],
    /// Quaternion w, x, y, z as sent, not normalised.
    pub quaternion_wxyz: Option<[f64; 4]>,
    /// The stylus' switch as sent: two characters, a blank and a digit.
    pub stylus: Option<[u8; 2]>,
}

impl Pose {
    /// Nothing measured yet.
    pub const fn empty(station: u8, error: u8) -> Self {
        Self {
            station,
            error,
            position: None,
            relative_position: None,
            euler_deg: None,
            cosines: [None; 3],
            quaternion_wxyz: None,
            stylus: None,
        }
    }
}

/// Reads FASTRAK records and replies; also those of ISOTRAK and ISOTRAK II in text.
#[derive(Debug, Clone)]
pub struct Fastrak {
    /// What stations 1 to 4 send; `None` for those not in use.
    layouts: [Option<Layout>; STATIONS],
    longest: usize,
    reply_bytes: usize,
    locked: bool,
    /// The last record, and the one behind it that confirms it: a pose is large, and moving it would take longer than reading it.
    pose: Pose,
    next: Pose,
}

impl Fastrak {
    /// Of a unit whose stations send these layouts; with none at all, only replies are read.
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

    /// Of a unit whose first so many stations send the same layout.
    pub fn uniform(stations: usize, layout: Layout) -> Self {
        let mut layouts = [None; STATIONS];
        layouts.iter_mut().take(stations).for_each(|each| *each = Some(layout));
        Self::new(layouts)
    }

    /// Of a unit that is being set up: replies are read, everything else is skipped.
    pub fn replies() -> Self {
        Self::new([None; STATIONS])
    }

    /// What stations 1 to 4 send.
    pub fn layouts(&self) -> &[Option<Layout>; STATIONS] {
        &self.layouts
    }

    /// As long as the beginning of records is not known, or where something else than a record begins.
    #[cold]
    fn search<'a>(&'a mut self, window: &'a [u8]) -> Look<Record<'a>> {
        match judge(&self.layouts, self.reply_bytes, window, &mut self.pose) {
            Look::Record { length, record: None } => {
                match judge(&self.layouts, self.reply_bytes, &window[length..], &mut self.next) {
                    Look::Record { .. } => {
                        self.locked = true;
                        Look::Record { length, record: Record::Pose(&self.pose) }
                    }
                    Look::Skip { .. } => Look::skip_byte(Refusal::Unconfirmed),
                    Look::Short => Look::Short,
                }
            }
            Look::Record { length, record: Some(reply) } => Look::Record { length, record: Record::Reply(reply) },
            Look::Skip { bytes, why } => {
                self.locked = false;
                Look::Skip { bytes, why }
            }
            Look::Short => Look::Short,
        }
    }
}

/// Judges what begins here, whether or not the beginning of records is known: a reply, or none where there is a pose.
fn judge<'a>(
    layouts: &[Option<Layout>; STATIONS],
    reply_bytes: usize,
    window: &'a [u8],
    pose: &mut Pose,
) -> Look<Option<Reply<'a>>> {
    match window.first() {
        None => Look::Short,
        Some(b'0') => judge_record(layouts, window, pose).map(|()| None),
        Some(b'2') => reply::judge(window, reply_bytes).map(Some),
        Some(_) => Look::skip_byte(Refusal::Noise),
    }
}

#[inline(always)]
fn judge_record(layouts: &[Option<Layout>; STATIONS], window: &[u8], pose: &mut Pose) -> Look<()> {
    let layout = match window.get(1) {
        None => return Look::Short,
        Some(station) => match layouts.get(usize::from(station.wrapping_sub(b'1'))) {
            Some(Some(layout)) => layout,
            _ => return Look::skip_byte(Refusal::Header),
        },
    };
    if window.get(2).is_some_and(|error| !(0x20..0x7f).contains(error)) {
        return Look::skip_byte(Refusal::Header);
    }
    let Some(bytes) = window.get(..layout.length()) else {
        return Look::Short;
    };
    match columns::read(bytes, layout, pose) {
        Ok(()) => Look::Record { length: bytes.len(), record: () },
        Err(why) => Look::skip_byte(why),
    }
}

impl Format for Fastrak {
    type Record<'a> = Record<'a>;

    fn window(&self) -> usize {
        2 * self.longest.max(self.reply_bytes)
    }

    /// Three times the longest record (168 bytes at most for records shorter than a status reply).
    fn lock_bytes(&self) -> usize {
        self.longest + self.reply_bytes.max(2 * self.longest)
    }

    #[inline]
    fn look<'a>(&'a mut self, window: &'a [u8]) -> Look<Record<'a>> {
        if self.locked && window[0] == b'0' {
            let look = judge_record(&self.layouts, window, &mut self.pose);
            self.locked = !matches!(look, Look::Skip { .. });
            return look.map(|()| Record::Pose(&self.pose));
        }
        self.search(window)
    }

    fn interrupted(&mut self) {
        self.locked = false;
    }
}
