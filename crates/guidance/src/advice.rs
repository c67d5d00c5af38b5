//! Combines all findings of the scan guidance into sentences of advice, the worst first.
//!
//! To avoid flicker, a sentence appears once its condition has lasted for a while, and stays for
//! a while after it ends. Its numbers are updated meanwhile.

use std::borrow::Cow;

use serde::Serialize;

use pipeline::session::SessionStatus;
use sonoweave_core::clock::MS;

use super::breathing::BreathingStatus;
use super::contact::Contact;
use super::holes::HolesStatus;
use super::sensors::{REFERENCE, SensorStatus};
use super::speed::{SpeedStatus, Verdict};

/// Time after which a condition is reported, ns.
const BELIEVED_NS: i64 = 300 * MS;
/// Time without the condition after which its advice is removed, ns.
const GONE_NS: i64 = 1500 * MS;
/// Share of invalid poses above which a sensor counts as out of range.
const OUT: f64 = 0.5;
/// Share of invalid poses above which a sensor counts as badly tracked.
const BADLY: f64 = 0.05;

/// Severity of advice.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum How {
    /// The current scan data are lost.
    Bad,
    /// The scan could be better.
    Heed,
}

/// One sentence of advice.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Advice {
    /// Severity.
    pub how: How,
    /// Key, unchanged while the problem is the same.
    pub key: Cow<'static, str>,
    /// Instruction to the user.
    pub sentence: String,
    /// Reason.
    pub more: String,
}

/// Inputs of the advice.
#[derive(Debug, Clone, Copy)]
pub struct Signs<'a> {
    /// Motion of the probe.
    pub speed: Option<&'a SpeedStatus>,
    /// Unscanned gaps.
    pub holes: &'a HolesStatus,
    /// Contact of the probe.
    pub contact: Contact,
    /// The tracker's sensors.
    pub sensors: &'a [SensorStatus],
    /// Breathing of the body.
    pub breathing: Option<BreathingStatus>,
    /// The session status.
    pub account: &'a SessionStatus,
    /// Sentence about the calibration's age.
    pub calibration: Option<&'a str>,
}

/// A condition, and the times when it was first and last met.
#[derive(Debug)]
struct Kept {
    advice: Advice,
    first_ns: i64,
    last_ns: i64,
    is_shown: bool,
}

/// State of the advice between calls.
#[derive(Debug, Default)]
pub struct AdviceDebouncer {
    kept: Vec<Kept>,
}

impl AdviceDebouncer {
    /// Returns the advice for these inputs at a time, ns.
    pub fn of(&mut self, signs: &Signs<'_>, now_ns: i64) -> Vec<Advice> {
        let seen = seen(signs);
        for advice in &seen {
            match self.kept.iter_mut().find(|kept| kept.advice.key == advice.key) {
                Some(kept) => {
                    (kept.advice, kept.last_ns) = (advice.clone(), now_ns);
                }
                None => {
                    self.kept.push(Kept { advice: advice.clone(), first_ns: now_ns, last_ns: now_ns, is_shown: false })
                }
            }
        }
        // A condition that is not reported yet must be met at every call.
        self.kept.retain(|kept| if kept.is_shown { now_ns - kept.last_ns < GONE_NS } else { kept.last_ns == now_ns });
        for kept in &mut self.kept {
            kept.is_shown |= now_ns - kept.first_ns >= BELIEVED_NS;
        }
        let mut shown: Vec<Advice> =
            self.kept.iter().filter(|kept| kept.is_shown).map(|kept| kept.advice.clone()).collect();
        shown.sort_by_key(|advice| rank(&advice.key));
        shown
    }
}

/// The keys' first words, the worst first.
const ORDER: [&str; 10] = [
    "tracker-lost",
    "frozen",
    "contact",
    "too-fast",
    "bent",
    "tracker-weak",
    "holes",
    "fast",
    "breathing",
    "calibration",
];

fn rank(key: &str) -> usize {
    let first = key.split(' ').next().unwrap_or_default();
    ORDER.iter().position(|known| *known == first).unwrap_or(ORDER.len())
}

fn seen(signs: &Signs<'_>) -> Vec<Advice> {
    let mut all = Vec::new();
    let mut add = |how, key: Cow<'static, str>, sentence: String, more: String| {
        all.push(Advice { how, key, sentence, more });
    };
    for SensorStatus { name, invalid, why } in signs.sensors {
        let percent = 100.0 * invalid;
        let more = format!("{percent:.0} % of its poses of the last second are not valid: {why}.");
        if *invalid > OUT {
            let sentence =
                format!("{} is out of the tracker's range: bring it back, and see to its cable.", sensor_name(name));
            add(How::Bad, format!("tracker-lost {name}").into(), sentence, more);
        } else if *invalid > BADLY {
            let sentence = format!("The tracker sees {} badly: bring it nearer.", sensor_name(name).to_lowercase());
            add(How::Heed, format!("tracker-weak {name}").into(), sentence, more);
        }
    }
    let account = signs.account;
    if let Some(seconds) = account.stuck_s {
        add(
            How::Bad,
            "frozen".into(),
            "The scanner is frozen: unfreeze it to go on.".into(),
            format!("One picture for {seconds:.0} s while the probe moved."),
        );
    }
    // A stuck image gives no information about the present contact.
    if signs.contact == Contact::Lost && account.stuck_s.is_none() {
        add(
            How::Bad,
            "contact".into(),
            "No contact: add gel and press the probe on.".into(),
            "Nothing comes back from the depth of the picture.".into(),
        );
    }
    match signs.speed {
        Some(SpeedStatus { verdict: Verdict::TooFast, edge_mm_per_s, gapless_mm_per_s, .. }) => add(
            How::Bad,
            "too-fast".into(),
            format!("Slow down: {edge_mm_per_s:.0} mm/s where {gapless_mm_per_s:.0} mm/s leaves no gaps."),
            "Slices lie too far apart across the picture.".into(),
        ),
        Some(SpeedStatus { verdict: Verdict::Fast, edge_mm_per_s, even_mm_per_s, .. }) => add(
            How::Heed,
            "fast".into(),
            format!("Slower is better: {edge_mm_per_s:.0} mm/s where {even_mm_per_s:.0} mm/s makes an even volume."),
            String::new(),
        ),
        _ => {}
    }
    if account.distortion.is_some_and(|found| found.rms_mm.is_some()) {
        add(
            How::Heed,
            "bent".into(),
            "Metal bends the tracker's field here: move it away, or scan elsewhere.".into(),
            "Slices are taken, but lie less surely.".into(),
        );
    }
    let HolesStatus { open, beyond, nearest, .. } = signs.holes;
    if *open > 0 {
        let holes = if *open == 1 { "One part was left out".into() } else { format!("{open} parts were left out") };
        let direction = nearest.as_ref().map_or("go back and sweep over them slowly".into(), String::clone);
        let more = match beyond {
            0 => String::new(),
            beyond => format!("{beyond} further gaps were not kept."),
        };
        add(How::Heed, "holes".into(), format!("{holes}: {direction}."), more);
    }
    if let Some(BreathingStatus { period_s, size_mm, speed_mm_s }) = signs.breathing {
        add(
            How::Heed,
            "breathing".into(),
            format!(
                "The body breathes: to gate it, sweep slower than {speed_mm_s:.1} mm/s, or each place three times."
            ),
            format!(
                "Its sensor moves by {size_mm:.0} mm every {period_s:.1} s. A volume in its frame follows it; what \
                 moves against it is blurred, and `sonoweave correct gate` then leaves frames out."
            ),
        );
    }
    if let Some(sentence) = signs.calibration {
        add(How::Heed, "calibration".into(), sentence.into(), String::new());
    }
    all
}

/// Returns the name of a sensor, by its frame.
fn sensor_name(name: &str) -> String {
    match name {
        "Probe" => "The probe's sensor".into(),
        REFERENCE => "The patient's sensor".into(),
        other => format!("The sensor {other}"),
    }
}
