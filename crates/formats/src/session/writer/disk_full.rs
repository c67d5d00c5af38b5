//! Behaviour when the disk takes no more data: it is full, or a write fails.
//!
//! Messages stay in memory and are written again later. When the memory is full too, frames are
//! lost first. Losses are counted, and written to the session once the disk takes data again.

use crate::Error;
use crate::session::writer::SessionWriter;

impl SessionWriter {
    /// Writes complete pieces, unless a write failed just before.
    pub(super) fn commit(&mut self, now_ns: i64) -> Result<(), Error> {
        let is_stuck = !self.account.trouble.is_empty();
        let mut buffer = self.tail.buffer();
        if is_stuck && now_ns < self.retry_ns || buffer.len() == buffer.unfinished() {
            return Ok(());
        }
        let done = buffer.commit();
        let stored = buffer.stored();
        drop(buffer);
        self.count_stored();
        self.rate.note(now_ns, stored);
        match done {
            Ok(()) if is_stuck => {
                tracing::warn!("{}: is written again", self.path.display());
                let written = self.write_losses(now_ns);
                self.account.trouble.clear();
                written
            }
            Ok(()) => Ok(()),
            Err(source) => {
                self.retry_ns = now_ns + self.options.retry_ns;
                let error = self.failed("writing the session (it is whole up to here, and tried again)", source);
                if is_stuck {
                    return Ok(());
                }
                self.account.trouble = error.to_string();
                self.account.failures += 1;
                Err(error)
            }
        }
    }

    pub(super) fn failed(&self, doing: &'static str, source: std::io::Error) -> Error {
        Error::Io { path: self.path.clone(), doing, source }
    }

    pub(super) fn write_losses(&mut self, now_ns: i64) -> Result<(), Error> {
        let topic_of = |channel: u16| self.topics.get(channel).topic.clone();
        let Some(loss) = self.losing.drain(&self.account.trouble, topic_of) else { return Ok(()) };
        tracing::error!("{}: {} messages were lost: {}", self.path.display(), loss.messages(), loss.why);
        self.message.clear();
        loss.write(&mut self.message);
        self.put(self.losses, now_ns, now_ns)
    }

    /// Returns whether memory is left. Frames fill the memory, so they are dropped first.
    pub(super) fn has_room(&self, is_frame: bool) -> bool {
        let most = self.options.held_bytes;
        self.tail.buffer().len() < if is_frame { most } else { most + most / 4 }
    }

    pub(super) fn lose(&mut self, channel: u16, bytes: usize, at_ns: i64) {
        let sequence = &mut self.topics.get_mut(channel).sequence;
        *sequence = sequence.wrapping_add(1);
        self.account.messages += 1;
        self.account.lost += 1;
        self.losing.add(channel, bytes, at_ns.max(self.last_ns));
    }
}
