//! Reads the list axis of 3D Slicer's sequences: `axis 3 index values:=0 0.033 …` (earlier
//! `axis 0 …`), and fields of single items.

use crate::image::fault::Fault;
use crate::image::header::Header;
use crate::image::nrrd::place::quoted;
use crate::image::numbers::number;

/// Splits `axis 3 item 7 Name` into item number and field name.
pub(super) fn item(key: &str) -> Option<(&str, &str)> {
    let (axis, rest) = key.strip_prefix("axis ")?.split_once(" item ")?;
    let (number, name) = rest.split_once(' ')?;
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    (digits(axis) && digits(number) && !name.trim().is_empty()).then_some((number, name.trim()))
}

/// Returns whether a key belongs to the axis index.
pub(super) fn is_index(key: &str) -> bool {
    axis_of(key, " index values").or_else(|| axis_of(key, " index type")).is_some()
}

fn axis_of(key: &str, what: &str) -> Option<usize> {
    key.strip_prefix("axis ")?.strip_suffix(what)?.parse().ok()
}

/// Returns the items' times, s, if the index of their axis holds times: it is numeric, and the
/// axis has the label `time`. Any other index gives only the order, which the items have
/// anyway.
pub(super) fn times(header: &Header) -> Result<Option<Vec<f64>>, Fault> {
    let Some((axis, field)) =
        header.global.iter().find_map(|field| Some((axis_of(&field.name, " index values")?, field)))
    else {
        return Ok(None);
    };
    let is_text = header.get(&format!("axis {axis} index type")).is_some_and(|kind| &*kind.value != "numeric");
    // Writers do not count a preceding channel axis, so the label's position decides.
    let labels = header.get("labels").map_or_else(Vec::new, |field| quoted(&field.value));
    let Some(at) = labels.iter().position(|label| label.eq_ignore_ascii_case("time")).filter(|_| !is_text) else {
        return Ok(None);
    };
    let units = header.get("units").map_or_else(Vec::new, |field| quoted(&field.value));
    let scale = match units.get(at).map_or("", |unit| unit.trim()) {
        "" | "s" | "sec" | "second" | "seconds" => 1.0,
        "ms" => 1e-3,
        _ => return Ok(None),
    };
    let seconds = |token: &str| match number(token).map(|value| value * scale) {
        Some(value) if value.is_finite() => Ok(value),
        _ => Err(field.fault(format!("holds {token:?}; each time must be a finite number"))),
    };
    field.value.split_whitespace().map(seconds).collect::<Result<Vec<f64>, Fault>>().map(Some)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn item_and_index_keys_are_recognised() {
        assert_eq!(item("axis 3 item 7 Probe Status"), Some(("7", "Probe Status")));
        for key in ["axis 3 item", "axis x item 7 A", "axis 3 item x A", "axis 3 item 7 ", "axis 3 index values"] {
            assert_eq!(item(key), None, "{key}");
        }
        assert!(is_index("axis 0 index values") && is_index("axis 3 index type"));
        assert!(!is_index("axis 3 item 0 index values") && !is_index("axis index type"));
    }
}
