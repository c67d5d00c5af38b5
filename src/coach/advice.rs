//! All that the coach has seen, in sentences that say what to do, the worst first.
//!
//! A sentence is said once its sign has lasted for a while and stays for a while after, so that it does not flicker; meanwhile its numbers go on.

use std::borrow::Cow;

use drivers::clock::MS;
use serde::Serialize;

use super::contact::Contact;
use super::holes::HolesTold;
use super::sensors::SensorTold;
use super::speed::{SpeedTold, Verdict};
use crate::pipeline::live::Account;

/// A sign is believed after this, ns,
const BELIEVED_NS: i64 = 300 * MS;
/// and gone when it was not seen for this long, ns.
const GONE_NS: i64 = 1500 * MS;
/// Of a sensor whose poses are invalid to a larger part than this, it is out of range,
const OUT: f64 = 0.5;
/// and to a larger part than this, it is seen badly.
const BADLY: f64 = 0.05;

/// How bad it is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum How {
    /// What is scanned now is lost.
    Bad,
    /// It could be better.
    Heed,
}

/// A sentence.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Advice {
    /// How bad it is.
    pub how: How,
    /// The same while it is the same trouble.
    pub key: Cow<'static, str>,
    /// What to do.
    pub sentence: String,
    /// Why.
    pub more: String,
}

/// All that there is to go by.
#[derive(Debug, Clone, Copy)]
pub struct Signs<'a> {
    /// How the probe moves.
    pub speed: Option<&'a SpeedTold>,
    /// What was left out.
    pub holes: &'a HolesTold,
    /// Whether the probe has contact.
    pub contact: Contact,
    /// The tracker's sensors.
    pub sensors: &'a [SensorTold],
    /// What the session tells of itself.
    pub account: &'a Account,
    /// The calibration's age.
    pub calibration: Option<&'a str>,
}

/// A sign, and since when it is seen or not.
#[derive(Debug)]
struct Kept {
    advice: Advice,
    first_ns: i64,
    last_ns: i64,
    is_said: bool,
}

/// What was said last.
#[derive(Debug, Default)]
pub struct Counsel {
    kept: Vec<Kept>,
}

impl Counsel {
    /// What is to be said by these signs at a time, ns.
    pub fn of(&mut self, signs: &Signs<'_>, now_ns: i64) -> Vec<Advice> {
        let seen = seen(signs);
        for advice in &seen {
            match self.kept.iter_mut().find(|kept| kept.advice.key == advice.key) {
                Some(kept) => {
                    (kept.advice, kept.last_ns) = (advice.clone(), now_ns);
                }
                None => {
                    self.kept.push(Kept { advice: advice.clone(), first_ns: now_ns, last_ns: now_ns, is_said: false })
                }
            }
        }
        // What is not believed yet must be seen each time.
        self.kept.retain(|kept| if kept.is_said { now_ns - kept.last_ns < GONE_NS } else { kept.last_ns == now_ns });
        for kept in &mut self.kept {
            kept.is_said |= now_ns - kept.first_ns >= BELIEVED_NS;
        }
        let mut said: Vec<Advice> =
            self.kept.iter().filter(|kept| kept.is_said).map(|kept| kept.advice.clone()).collect();
        said.sort_by_key(|advice| rank(&advice.key));
        said
    }
}

/// The keys' first words, the worst first.
const ORDER: [&str; 9] =
    ["tracker-lost", "frozen", "contact", "too-fast", "bent", "tracker-weak", "holes", "fast", "calibration"];

fn rank(key: &str) -> usize {
    let first = key.split(' ').next().unwrap_or_default();
    ORDER.iter().position(|known| *known == first).unwrap_or(ORDER.len())
}

fn seen(signs: &Signs<'_>) -> Vec<Advice> {
    let mut all = Vec::new();
    let mut say = |how, key: Cow<'static, str>, sentence: String, more: String| {
        all.push(Advice { how, key, sentence, more });
    };
    for SensorTold { name, invalid, why } in signs.sensors {
        let percent = 100.0 * invalid;
        let more = format!("{percent:.0} % of its poses of the last second are not valid: {why}.");
        if *invalid > OUT {
            let sentence =
                format!("{} is out of the tracker's range: bring it back, and see to its cable.", called(name));
            say(How::Bad, format!("tracker-lost {name}").into(), sentence, more);
        } else if *invalid > BADLY {
            let sentence = format!("The tracker sees {} badly: bring it nearer.", called(name).to_lowercase());
            say(How::Heed, format!("tracker-weak {name}").into(), sentence, more);
        }
    }
    let account = signs.account;
    if let Some(seconds) = account.frozen_s {
        say(
            How::Bad,
            "frozen".into(),
            "The scanner is frozen: unfreeze it to go on.".into(),
            format!("One picture for {seconds:.0} s while the probe moved."),
        );
    }
    // A frozen picture tells nothing of now.
    if signs.contact == Contact::Lost && account.frozen_s.is_none() {
        say(
            How::Bad,
            "contact".into(),
            "No contact: add gel and press the probe on.".into(),
            "Nothing comes back from the depth of the picture.".into(),
        );
    }
    match signs.speed {
        Some(SpeedTold { verdict: Verdict::TooFast, edge_mm_per_s, gapless_mm_per_s, .. }) => say(
            How::Bad,
            "too-fast".into(),
            format!("Slow down: {edge_mm_per_s:.0} mm/s where {gapless_mm_per_s:.0} mm/s leaves no gaps."),
            "Slices lie too far apart across the picture.".into(),
        ),
        Some(SpeedTold { verdict: Verdict::Fast, edge_mm_per_s, even_mm_per_s, .. }) => say(
            How::Heed,
            "fast".into(),
            format!("Slower is better: {edge_mm_per_s:.0} mm/s where {even_mm_per_s:.0} mm/s makes an even volume."),
            String::new(),
        ),
        _ => {}
    }
    if account.distortion.is_some_and(|found| found.rms_mm.is_some()) {
        say(
            How::Heed,
            "bent".into(),
            "Metal bends the tracker's field here: move it away, or scan elsewhere.".into(),
            "Slices are taken, but lie less surely.".into(),
        );
    }
    let HolesTold { open, beyond, nearest, .. } = signs.holes;
    if *open > 0 {
        let holes = if *open == 1 { "One part was left out".into() } else { format!("{open} parts were left out") };
        let way = nearest.as_ref().map_or("go back and sweep over them slowly".into(), String::clone);
        let more = match beyond {
            0 => String::new(),
            beyond => format!("{beyond} further gaps were not kept."),
        };
        say(How::Heed, "holes".into(), format!("{holes}: {way}."), more);
    }
    if let Some(sentence) = signs.calibration {
        say(How::Heed, "calibration".into(), sentence.into(), String::new());
    }
    all
}

/// A sensor, by its frame.
fn called(name: &str) -> String {
    match name {
        "Probe" => "The probe's sensor".into(),
        "Reference" => "The patient's sensor".into(),
        other => format!("The sensor {other}"),
    }
}
