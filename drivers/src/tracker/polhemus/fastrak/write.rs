//! Writes records and replies as a unit does, for virtual units and tests.

use super::list::{Entry, Item, Layout, Mode};
use super::record::{PACKED_CM, PACKED_DEG, PACKED_UNIT};
use super::reply::Status;
use super::{Pose, STATIONS};

impl Pose {
    /// Appends the record in this layout. Missing numbers are written as 0, as a unit writes
    /// missing measurements. Numbers that do not fit their columns are written as the nearest
    /// that does.
    pub fn write(&self, layout: &Layout, to: &mut Vec<u8>) {
        to.extend([b'0', b'0' + self.station, self.error]);
        let mut packed_begun = false;
        for &Entry { item, extended } in layout.entries() {
            let values: &[f64] = match item {
                Item::Position | Item::Position14 => &self.position.unwrap_or_default(),
                Item::RelativePosition => &self.relative_position.unwrap_or_default(),
                Item::Euler | Item::Euler14 => &self.euler_deg.unwrap_or_default(),
                Item::Cosines(row) => &self.cosines[usize::from(row)].unwrap_or_default(),
                Item::Quaternion | Item::Quaternion14 => &self.quaternion_wxyz.unwrap_or_default(),
                Item::Space => {
                    to.push(b' ');
                    continue;
                }
                Item::CrLf => {
                    to.extend(b"\r\n");
                    continue;
                }
                Item::Stylus => {
                    to.extend(self.stylus.unwrap_or(*b" 0"));
                    continue;
                }
            };
            for &value in values {
                match (layout.mode(), item) {
                    (_, Item::Position14) => pack(value / PACKED_CM, &mut packed_begun, to),
                    (_, Item::Euler14) => pack(value / PACKED_DEG, &mut packed_begun, to),
                    (_, Item::Quaternion14) => pack(value / PACKED_UNIT, &mut packed_begun, to),
                    (Mode::Binary, _) => to.extend((value as f32).to_le_bytes()),
                    (Mode::Ascii, _) if extended => extended_number(value, to),
                    (Mode::Ascii, Item::Cosines(_) | Item::Quaternion) => column(value, 4, -9.9999, 9.9999, to),
                    (Mode::Ascii, _) => column(value, 2, -999.99, 9999.99, to),
                }
            }
        }
    }
}

fn column(value: f64, decimals: usize, low: f64, high: f64, to: &mut Vec<u8>) {
    // `clamp` keeps NaN, which a column cannot show; a unit always writes digits.
    let value = if value.is_nan() { 0.0 } else { value.clamp(low, high) };
    to.extend(format!("{value:7.decimals$}").bytes());
}

/// Writes ` d.dddddEsdd` and a blank.
fn extended_number(value: f64, to: &mut Vec<u8>) {
    let value = if value.is_nan() { 0.0 } else { value.clamp(-9.99999e99, 9.99999e99) };
    let text = format!("{value:.5e}");
    let (digits, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if exponent < -99 {
        return extended_number(0.0, to);
    }
    let sign = if exponent < 0 { '-' } else { '+' };
    to.extend(format!("{digits:>8}E{sign}{:02} ", exponent.abs()).bytes());
}

fn pack(counts: f64, begun: &mut bool, to: &mut Vec<u8>) {
    // The cast saturates; the lowest two bits are not sent.
    let bits = (counts.round() as i16).cast_unsigned();
    let first = if *begun { 0 } else { 0x80 };
    *begun = true;
    to.extend([first | (bits >> 2 & 0x7f) as u8, (bits >> 9) as u8]);
}

impl Status {
    /// Appends the status reply.
    pub fn write(&self, to: &mut Vec<u8>) {
        let flags = u8::from(self.binary)
            | u8::from(self.centimetres) << 1
            | u8::from(self.compensated) << 2
            | u8::from(self.continuous) << 3
            | u8::from(self.configured) << 4;
        to.extend([b'2', self.station, b'S']);
        to.extend(format!("{flags:03X}").bytes());
        to.extend(self.test);
        to.extend(self.model);
        to.extend(self.version);
        to.extend(self.identity);
        to.extend(b"\r\n");
    }
}

/// Appends the answer to `O`: the output list of a station.
pub fn write_output_list(station: u8, layout: &Layout, to: &mut Vec<u8>) {
    to.extend([b'2', b'0' + station, b'O']);
    layout.entries().iter().for_each(|entry| to.extend(format!("{:2}", entry.code()).bytes()));
    to.extend(b"\r\n");
}

/// Appends the answer to `l`: the stations in use.
pub fn write_stations(station: u8, stations: [bool; STATIONS], to: &mut Vec<u8>) {
    to.extend([b'2', b'0' + station, b'l']);
    to.extend(stations.map(|on| if on { b'1' } else { b'0' }));
    to.extend(b"\r\n");
}

/// Appends an error reply. Documented are its `2`, blank, `E`, `*ERROR*` and the code after `EC`;
/// the other wording is ours.
pub fn write_error(code: i32, to: &mut Vec<u8>) {
    to.extend(format!("2 E*ERROR* EC {code}\r\n").bytes());
}
