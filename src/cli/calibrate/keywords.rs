//! Calibrations by the flags of their commands as keywords of a program.

use std::path::Path;

use super::done::{Calibrate, Outlets};
use super::{arm, crossings, landmarks, latency, pivot, probe, tracker};
use crate::app::calibrate::guide::{Advice, Advisor};
use crate::app::input;
use crate::cli::keywords::{Keyword, parse};
use crate::failure::Failure;
use pipeline::session::SessionStatus;

/// Advises nobody.
struct Silent;

impl Advisor for Silent {
    fn say(&self, sentence: &str) {
        tracing::info!("{sentence}");
    }

    fn show(&mut self, _advice: &Advice, _status: &SessionStatus) {}

    fn end(&mut self, _last: &Advice) {}
}

/// Calibrates a quantity, a name of a subcommand, by its flags as keywords; a session may be given
/// as the sequence, too. Returns the report, as JSON.
///
/// # Errors
/// [`Failure`] when a keyword does not fit, and as of [`Calibrate::calibrate`].
pub(crate) fn by_keywords(quantity: &str, keywords: Vec<Keyword>) -> Result<String, Failure> {
    match quantity {
        "probe" => of::<probe::Arguments>(quantity, keywords),
        "latency" => of::<latency::Arguments>(quantity, keywords),
        "crossings" => of::<crossings::Arguments>(quantity, keywords),
        "pivot" => of::<pivot::Arguments>(quantity, keywords),
        "landmarks" => of::<landmarks::Arguments>(quantity, keywords),
        "tracker" => of::<tracker::Arguments>(quantity, keywords),
        "arm" => of::<arm::Arguments>(quantity, keywords),
        _ => fail_usage!("{quantity}: is no calibration; give the name of a command of `sonoweave calibrate`"),
    }
}

fn of<A: Calibrate>(quantity: &str, mut keywords: Vec<Keyword>) -> Result<String, Failure> {
    if keywords.iter().any(|(name, _)| name == "live") {
        fail_usage!("live: is for people at the bedside; use `sonoweave calibrate {quantity} --live`");
    }
    for (name, value) in &mut keywords {
        if let (true, Some(path)) = (name == "sequence", value)
            && input::is_session(Path::new(path))?
        {
            *name = "session".into();
        }
    }
    let outlets = Outlets { advisor: &mut Silent, steps: &|_, _| Box::new(|_| ()), wants_report: true };
    Ok(parse::<A>(&keywords)?.calibrate(outlets)?.report)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::Reason;

    #[test]
    fn session_is_recognised_and_live_is_refused() {
        let session = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/recordings/sessions/arm.mcap");
        let refused = |quantity: &str, name: &str, value: &str| {
            let keywords = vec![(name.to_owned(), Some(value.to_owned()))];
            let Failure(Reason { sentence, .. }) = by_keywords(quantity, keywords).unwrap_err();
            sentence
        };
        for quantity in ["pivot", "tracker"] {
            let said = refused(quantity, "sequence", session);
            assert!(said.starts_with(session) && !said.contains("MetaImage"), "{said}");
            assert_eq!(said, refused(quantity, "session", session));
        }
        assert!(refused("arm", "live", "bedside.toml").contains("`sonoweave calibrate arm --live`"));
        assert!(refused("drawing", "output", "plate.pdf").contains("is no calibration"));
    }
}
