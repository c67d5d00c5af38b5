//! Guides that need only poses.

use std::borrow::Cow;

use sync::ingest::live::Live;

use super::super::poses::{Recording, check};
use super::super::recorded::{GRABBER, Tracks, without_latency};
use super::{Advice, Advisor, Gathered, Guide, lead};
use crate::failure::{Failure, Reason};

/// Evaluates all poses so far at each step, in the same way as the final recording.
struct PoseGuide<J> {
    tracks: Tracks,
    advise: J,
}

impl<J: FnMut(&Tracks) -> Result<Advice, Failure>> Guide for PoseGuide<J> {
    fn add(&mut self, device: usize, live: Live) {
        self.tracks.add(device, live);
    }

    fn advise(&mut self) -> Advice {
        if self.tracks.is_empty() {
            return Advice::missing("waiting for the tracker's poses");
        }
        (self.advise)(&self.tracks).unwrap_or_else(|Failure(Reason { sentence: why, .. })| Advice::missing(why))
    }
}

/// Returns the recording. If it is still to be made, records it now, guided by `advise`. A second
/// sensor of the same recording is checked, too.
///
/// # Errors
/// [`Failure`] when the recording cannot be made; before it begins, if a sensor is not configured.
pub(crate) fn gathered<'r>(
    recording: &'r Recording,
    second: Option<&Recording>,
    advisor: &mut dyn Advisor,
    advise: impl FnMut(&Tracks) -> Result<Advice, Failure>,
) -> Result<Cow<'r, Recording>, Failure> {
    let Some(path) = recording.gathering.of(recording.source.live.as_ref())? else {
        return Ok(Cow::Borrowed(recording));
    };
    let Gathered { session, from_s } = lead(path, &recording.gathering, advisor, |bedside| {
        let mut roles = without_latency(bedside)?;
        roles.truncate(GRABBER);
        let tracks = Tracks::of_roles(&roles, bedside);
        std::iter::once(recording).chain(second).try_for_each(|one| check(one, &tracks, path))?;
        Ok((PoseGuide { tracks, advise }, roles))
    })?;
    let mut made = recording.clone();
    (made.source.live, made.source.session) = (None, Some(session));
    made.from = made.from.or(from_s);
    Ok(Cow::Owned(made))
}
