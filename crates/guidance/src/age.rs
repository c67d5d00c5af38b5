//! Advice about the age of the probe calibration.

use sonoweave_core::date::Date;

/// Returns a sentence about a calibration made on a day, if it is older than
/// `worth_a_word_days`.
pub fn calibration_age(made: Date, today: Date, worth_a_word_days: i64) -> Option<String> {
    let days = today.days_since(made);
    if days < -1 {
        return Some(format!(
            "The calibration's day, {made}, is still to come: set this machine's clock, or see who calibrated."
        ));
    }
    match days - worth_a_word_days {
        ..=0 => None,
        more if more <= worth_a_word_days => {
            Some(format!("The calibration is {days} days old: check it, or calibrate the probe anew."))
        }
        // More than twice that age.
        _ => Some(format!(
            "The calibration is {days} days old, of {made}: calibrate the probe anew before anything is measured."
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn old_calibration_gives_advice_by_age() {
        let day = |text| Date::parse(text).unwrap();
        let made = day("2026-01-01");
        assert_eq!(calibration_age(made, day("2026-06-30"), 180), None);
        let old = calibration_age(made, day("2026-07-01"), 180).unwrap();
        assert!(old.contains("181 days old: check it"), "{old}");
        let older = calibration_age(made, day("2027-01-01"), 180).unwrap();
        assert!(older.contains("365 days old, of 2026-01-01: calibrate the probe anew before"), "{older}");
        assert_eq!(calibration_age(made, day("2025-12-31"), 180), None, "east of here it is tomorrow already");
        assert!(calibration_age(made, day("2025-12-30"), 180).unwrap().contains("still to come"));
    }
}
