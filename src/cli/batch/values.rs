//! Values of flags: memory and times with units.

use std::time::Duration;

/// Longest time limit, s: a year.
const LONGEST_S: f64 = 366.0 * 86_400.0;

/// Parses an amount of memory, such as `8GiB`; returns bytes.
pub(super) fn memory(text: &str) -> Result<u64, String> {
    let units = [("KiB", 10), ("MiB", 20), ("GiB", 30), ("TiB", 40)];
    let parsed = units.into_iter().find_map(|(unit, bits)| {
        let number: f64 = text.strip_suffix(unit)?.trim().parse().ok()?;
        Some(number * (1_u64 << bits) as f64)
    });
    // Less than this, and the program does not start.
    let least = f64::from(256 << 20);
    match parsed {
        Some(bytes) if bytes >= least && bytes < 1e18 => Ok(bytes as u64),
        Some(_) => Err("must be at least 256MiB".into()),
        None => Err("must be a number with KiB, MiB, GiB or TiB, such as 8GiB".into()),
    }
}

/// Parses a time, such as `90s`, `30m` or `1h`.
pub(super) fn time(text: &str) -> Result<Duration, String> {
    let units = [("ms", 1e-3), ("s", 1.0), ("m", 60.0), ("h", 3600.0)];
    let parsed = units.into_iter().find_map(|(unit, seconds)| {
        let number: f64 = text.strip_suffix(unit)?.trim().parse().ok()?;
        Some(number * seconds)
    });
    match parsed {
        Some(seconds) if seconds > 0.0 && seconds <= LONGEST_S => Ok(Duration::from_secs_f64(seconds)),
        Some(_) => Err("must be above 0, and at most a year".into()),
        None => Err("must be a number with ms, s, m or h, such as 30m".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn amounts_need_units_and_sense() {
        assert_eq!(memory("8GiB"), Ok(8 << 30));
        assert_eq!(memory("0.5 GiB"), Ok(1 << 29));
        assert_eq!(time("1.5h"), Ok(Duration::from_secs(5400)));
        assert_eq!(time("250ms"), Ok(Duration::from_millis(250)));
        for wrong in ["8", "8GB", "-1GiB", "1MiB", "NaNGiB", "infTiB", ""] {
            assert!(memory(wrong).is_err(), "{wrong}");
        }
        for wrong in ["8", "0s", "-1s", "NaNs", "infh", "1d", ""] {
            assert!(time(wrong).is_err(), "{wrong}");
        }
    }
}
