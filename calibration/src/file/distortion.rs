//! Field distortion zones in a calibration file: one table, and one more for each zone.

use std::fmt::Write as _;

use glam::DVec3;

use sonoweave_core::date::Date;
use sonoweave_core::keys::{Entry, FileError};

use super::origin::{self, Origin};
use crate::tracker::zones::{Zone, Zones};

/// Reads the table: the zones, and their origin.
pub(super) fn read(entry: &Entry<'_>) -> Result<(Zones, Origin), FileError> {
    let own = ["measured", "cell_mm", "limit_mm", "zone"];
    let table = entry.table(&[&own[..], &origin::KEYS].concat())?;
    let above_zero = |key| {
        let entry = table.need(key)?;
        match entry.number()? {
            mm if mm > 0.0 => Ok(mm),
            mm => Err(entry.error(format!("must be above 0, not {mm}"))),
        }
    };
    let (cell_mm, limit_mm) = (above_zero("cell_mm")?, above_zero("limit_mm")?);
    let day = |entry: Entry<'_>| {
        let text = entry.text()?;
        Date::parse(text).ok_or_else(|| entry.error(format!("must be a day as \"2026-11-22\", not \"{text}\"")))
    };
    let measured = table.get("measured").map(day).transpose()?;
    let items = match table.get("zone") {
        Some(list) => list.items("a list of tables, each headed [[distortion.zone]]")?,
        None => Vec::new(),
    };
    let mut zones = Vec::with_capacity(items.len());
    for item in &items {
        let table = item.table(&["low_mm", "rms_mm"])?;
        let low = table.need("low_mm")?;
        let zone = Zone { low_mm: DVec3::from_array(low.numbers()?), rms_mm: table.need("rms_mm")?.number()? };
        if !zone.is_cell(cell_mm) {
            return Err(low.error(format!("must be a corner of a cell: multiples of cell_mm = {cell_mm}")));
        }
        zones.push(zone);
    }
    Ok((Zones::new(cell_mm, limit_mm, measured, zones), Origin::read(&table)?))
}

/// Writes the table.
pub(super) fn write(zones: &Zones, origin: &Origin, text: &mut String) {
    let (cell_mm, limit_mm) = (zones.cell_mm(), zones.limit_mm());
    // Writing to a String cannot fail.
    let _ = writeln!(text, "\n[distortion]");
    if let Some(day) = zones.measured() {
        let _ = writeln!(text, "measured = \"{day}\"");
    }
    let _ = writeln!(text, "cell_mm = {cell_mm:?}\nlimit_mm = {limit_mm:?}");
    origin.write_day(text);
    for Zone { low_mm, rms_mm } in zones.all() {
        let _ = writeln!(text, "\n[[distortion.zone]]\nlow_mm = {:?}\nrms_mm = {rms_mm:?}", low_mm.to_array());
    }
    origin.write_inputs("distortion", text);
}
