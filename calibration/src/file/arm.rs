//! The arm in a calibration file: a table for each joint, base first.

use std::fmt::Write as _;

use sonoweave_core::keys::{Entry, FileError};

use super::origin::{self, Origin};
use crate::arm::{Arm, JOINTS, Joint, Kind, Sign};

/// Keys that every joint has.
const COMMON: [&str; 4] = ["type", "length_mm", "zero_counts", "sign"];

/// Reads the arm's table: the joints, the residual of their fit, if given, and their origin.
pub(super) fn read(entry: &Entry<'_>) -> Result<(Arm, Option<f64>, Origin), FileError> {
    let table = entry.table(&[&["fit_rms_mm", "joint"], &origin::KEYS[..]].concat())?;
    let fit_rms_mm = match table.get("fit_rms_mm").map(|entry| entry.number().map(|mm| (mm, entry))).transpose()? {
        Some((mm, entry)) if mm < 0.0 => return Err(entry.error(format!("must be 0 or more, not {mm}"))),
        given => given.map(|(mm, _)| mm),
    };
    let list = table.need("joint")?;
    let items = list.items("a list of tables, each headed [[arm.joint]]")?;
    let joints = items.iter().map(joint).collect::<Result<Vec<_>, _>>()?;
    let Ok(joints) = <[Joint; JOINTS]>::try_from(joints) else {
        return Err(list.error(format!("must hold {JOINTS} joints, base first, not {}", items.len())));
    };
    let arm = Arm::new(joints).map_err(|e| entry.error(e.to_string()))?;
    Ok((arm, fit_rms_mm, Origin::read(&table)?))
}

fn joint(entry: &Entry<'_>) -> Result<Joint, FileError> {
    let [kind, length, zero, sign] = COMMON;
    let all = [&COMMON[..], &["direction_deg", "counts_per_turn", "counts_per_mm"]].concat();
    let table = entry.table(&all)?;
    let turns = match table.need(kind)?.text()? {
        "revolute" => true,
        "prismatic" => false,
        _ => return Err(table.need(kind)?.error("must be \"revolute\" or \"prismatic\"")),
    };
    let (counts, other) =
        if turns { ("counts_per_turn", "counts_per_mm") } else { ("counts_per_mm", "counts_per_turn") };
    if let Some(other) = table.get(other) {
        return Err(other.error(format!("is not for a joint of this type; give {counts}")));
    }
    let kind = match table.get("direction_deg") {
        Some(direction) if turns => {
            return Err(
                direction.error("is not for a joint that turns, whose zero_counts say where it begins; leave it out")
            );
        }
        _ if turns => Kind::Revolute,
        direction => {
            let direction_deg = direction.map(|entry| entry.number()).transpose()?.unwrap_or(0.0);
            Kind::Prismatic { direction_deg }
        }
    };
    let sign = match table.get(sign).map(|entry| entry.number().map(|x| (x, entry))).transpose()? {
        None => Sign::Plus,
        Some((1.0, _)) => Sign::Plus,
        Some((-1.0, _)) => Sign::Minus,
        Some((x, entry)) => return Err(entry.error(format!("must be 1 or -1, not {x}"))),
    };
    Ok(Joint {
        kind,
        length_mm: table.need(length)?.number()?,
        zero_counts: table.get(zero).map(|entry| entry.number()).transpose()?.unwrap_or(0.0),
        counts_per_unit: table.need(counts)?.number()?,
        sign,
    })
}

/// Writes the arm's tables.
pub(super) fn write(arm: &Arm, fit_rms_mm: Option<f64>, origin: &Origin, text: &mut String) {
    if fit_rms_mm.is_some() || origin.made.is_some() {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "\n[arm]");
    }
    if let Some(mm) = fit_rms_mm {
        let _ = writeln!(text, "fit_rms_mm = {mm:?}");
    }
    origin.write_day(text);
    for joint in arm.joints() {
        let Joint { kind, length_mm, zero_counts, counts_per_unit, sign } = *joint;
        let kind = match kind {
            Kind::Revolute => {
                format!("type = \"revolute\"\nlength_mm = {length_mm:?}\ncounts_per_turn = {counts_per_unit:?}")
            }
            Kind::Prismatic { direction_deg } => format!(
                "type = \"prismatic\"\ndirection_deg = {direction_deg:?}\nlength_mm = {length_mm:?}\ncounts_per_mm = {counts_per_unit:?}"
            ),
        };
        let sign = sign.factor();
        let _ = writeln!(text, "\n[[arm.joint]]\n{kind}\nzero_counts = {zero_counts:?}\nsign = {sign}");
    }
    origin.write_inputs("arm", text);
}
