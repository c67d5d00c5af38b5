//! Labels of subjects and sessions, as names of folders have them.

use std::collections::BTreeMap;

use crate::app::batch::plan::Planned;
use crate::app::pseudonym::PseudonymKey;
use crate::failure::{Failure, FailureKind};

/// Label of sweeps whose row names no subject.
const UNKNOWN: &str = "unknown";

/// Labels of a sweep: letters and digits alone, as BIDS asks.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Labels {
    pub(crate) subject: String,
    pub(crate) session: Option<String>,
    /// Number of the sweep in its session, from 1.
    pub(crate) run: u32,
}

impl Labels {
    /// Returns the folder of the sweep's session: `sub-X/ses-Y/us`.
    pub(crate) fn folder(&self) -> String {
        let session = self.session.as_ref().map_or_else(String::new, |session| format!("ses-{session}/"));
        format!("sub-{}/{session}us", self.subject)
    }

    /// Returns the beginning of the names of the sweep's files.
    pub(crate) fn stem(&self) -> String {
        let session = self.session.as_ref().map_or_else(String::new, |session| format!("_ses-{session}"));
        format!("sub-{}{session}_run-{:02}", self.subject, self.run)
    }
}

/// Returns the labels of all sweeps, in their order.
///
/// # Errors
/// [`Failure`] when two subjects, or two sessions of one, have the same label, or one has no letter
/// and no digit.
pub(crate) fn labels(plan: &[Planned], key: Option<&PseudonymKey>) -> Result<Vec<Labels>, Failure> {
    let mut named: BTreeMap<String, &str> = BTreeMap::new();
    let mut runs: BTreeMap<(String, Option<String>), u32> = BTreeMap::new();
    let label = |within: &str, usage: &'static str, text: &str| -> Result<String, Failure> {
        Ok(match key {
            // A session's name may be a date, which two subjects have in common.
            Some(key) => key.pseudonym(usage, &format!("{within}{text}")),
            None => plain(usage, text)?,
        })
    };
    let mut made = Vec::new();
    for sweep in plan {
        let subject = match &sweep.subject {
            Some(text) => label("", "subject", text)?,
            None => UNKNOWN.to_owned(),
        };
        let within = sweep.subject.as_deref().unwrap_or_default();
        let session = match &sweep.session {
            Some(text) => Some(label(&format!("{within}/"), "session", text)?),
            None => None,
        };
        let texts = [
            (format!("sub-{subject}"), sweep.subject.as_deref()),
            (format!("sub-{subject}_ses-{}", session.as_deref().unwrap_or_default()), sweep.session.as_deref()),
        ];
        for (label, text) in texts {
            let Some(text) = text else { continue };
            let first = *named.entry(label.clone()).or_insert(text);
            if first != text {
                let sentence = format!(
                    "the manifest's {first:?} and {text:?} both become {label}; give them names that differ in letters or digits"
                );
                return Err(Failure::new(sentence).of(FailureKind::Input));
            }
        }
        let run = runs.entry((subject.clone(), session.clone())).or_default();
        *run += 1;
        made.push(Labels { subject, session, run: *run });
    }
    Ok(made)
}

/// Returns the letters and digits of a name.
fn plain(usage: &str, text: &str) -> Result<String, Failure> {
    let label: String = text.chars().filter(char::is_ascii_alphanumeric).collect();
    if label.is_empty() {
        let sentence =
            format!("the {usage} {text:?} has no letter and no digit; give it a name that has, or give --key");
        return Err(Failure::new(sentence).of(FailureKind::Input));
    }
    Ok(label)
}
