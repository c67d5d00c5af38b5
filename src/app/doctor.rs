//! Checks of this machine: findings with what to do, from gathered facts.

pub(crate) mod checks;
pub(crate) mod facts;

use serde::Serialize;

/// Severity of a finding.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Verdict {
    Ok,
    /// A session works, but not as well as it could.
    Warning,
    /// A session does not work.
    Problem,
}

impl Verdict {
    /// Returns its name.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Ok => "ok",
            Self::Warning => "warning",
            Self::Problem => "problem",
        }
    }
}

/// A checked item.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub(crate) struct Finding {
    pub(crate) item: &'static str,
    pub(crate) verdict: Verdict,
    /// The state that was found, in words.
    pub(crate) found: String,
    /// The remedy; `None` if there is nothing to do.
    pub(crate) advice: Option<String>,
}

fn fine(item: &'static str, found: impl Into<String>) -> Finding {
    Finding { item, verdict: Verdict::Ok, found: found.into(), advice: None }
}

fn warning(item: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding { item, verdict: Verdict::Warning, found: found.into(), advice: Some(advice.into()) }
}

fn problem(item: &'static str, found: impl Into<String>, advice: impl Into<String>) -> Finding {
    Finding { verdict: Verdict::Problem, ..warning(item, found, advice) }
}
