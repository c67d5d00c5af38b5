//! The corrections that a replay applies to a session and to those that it resumes.

use std::path::Path;

use config::bedside::Bedside;

use super::standing::Standing;
use crate::app::input::name_of;
use crate::app::live::resume::Chain;
use crate::app::live::stages::Kept;
use crate::failure::Failure;

/// Sections of settings by which poses are paired; and the latencies of all devices.
const OF_POSES: [&str; 2] = ["calibration.", "pairing."];

/// Applies the corrections that stand to the sessions of a chain, but with another configuration
/// only those of a session whose poses it does not change. Returns sentences for the user.
///
/// # Errors
/// [`Failure`] when a session or its corrections cannot be read.
pub(crate) fn apply(chain: &mut Chain, other: Option<&Bedside>) -> Result<Vec<String>, Failure> {
    let mut sentences = Vec::new();
    for (session, decisions) in chain.links() {
        let standing = Standing::of(session, decisions)?;
        if standing.is_empty() {
            continue;
        }
        if let Some(other) = other
            && let Some(key) = changed(session, &Kept::bedside(session, decisions)?, other)
        {
            sentences.push(key);
            continue;
        }
        sentences.extend(standing.stale());
        if let Some(frames) = standing.frames()? {
            sentences.push(format!("{}: corrections applied: {}", name_of(session), frames.words));
            sentences.extend(standing.differences(session)?);
            decisions.correct(frames);
        }
    }
    Ok(sentences)
}

/// Returns a sentence if another configuration would place a session's frames elsewhere.
fn changed(session: &Path, own: &Bedside, other: &Bedside) -> Option<String> {
    let changes = own.changes(other);
    let mut keys = changes.at_once.iter().chain(&changes.next_session).map(|change| &*change.key);
    let is_of_poses = |key: &&str| OF_POSES.iter().any(|of| key.starts_with(of)) || key.ends_with(".latency_ms");
    keys.find(is_of_poses).map(|key| {
        format!(
            "{}: its corrections are not applied, as {key} is another one than when it was recorded",
            name_of(session)
        )
    })
}
