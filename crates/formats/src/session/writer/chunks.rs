//! The way of the writer's chunks to the disk: closed, written, and synced.

use crate::Error;
use crate::session::writer::{SessionWriter, refused};

impl SessionWriter {
    /// Closes a due chunk, writes complete chunks, and requests a due sync.
    pub(super) fn advance(&mut self, now_ns: i64) -> Result<(), Error> {
        // Only messages advance the messages' times: messages handed over before `now_ns` may
        // still arrive.
        let now_ns = now_ns.max(self.last_ns);
        let is_old = self.chunk_ns.is_some_and(|begun_ns| now_ns - begun_ns >= self.options.chunk_ns);
        let buffer = self.tail.buffer();
        let is_due = is_old || self.syncs.is_due(buffer.stored(), now_ns);
        let is_full = buffer.unfinished() >= self.options.chunk_bytes;
        drop(buffer);
        if self.chunk_ns.is_some() && (is_due || is_full) {
            self.close()?;
        }
        let written = self.commit(now_ns);
        if is_due {
            self.request_sync(now_ns);
        }
        written?;
        self.report_sync()
    }

    pub(super) fn request_sync(&mut self, now_ns: i64) {
        let buffer = self.tail.buffer();
        let stored = buffer.stored();
        self.syncs.request(stored, stored + buffer.len() as u64, now_ns);
    }

    /// Reports that syncs begin to fail, or succeed again.
    fn report_sync(&mut self) -> Result<(), Error> {
        match self.syncs.news() {
            None => Ok(()),
            Some(Ok(())) => {
                tracing::warn!("{}: is synced again", self.path.display());
                self.syncs.set_trouble(String::new());
                Ok(())
            }
            Some(Err(source)) => {
                let doing = "syncing the session (a power cut may take what was written since; it is tried again)";
                let error = self.failed(doing, source);
                self.syncs.set_trouble(error.to_string());
                self.account.failures += 1;
                Err(error)
            }
        }
    }

    pub(super) fn close(&mut self) -> Result<(), Error> {
        self.chunk_ns = None;
        self.file.flush().map_err(|error| refused(&self.path, error))?;
        self.whole();
        Ok(())
    }

    /// Marks everything written so far as one piece for the disk.
    pub(super) fn whole(&mut self) {
        let pieces = self.tail.buffer().whole();
        if pieces > self.waiting.len() {
            self.waiting.push_back(std::mem::take(&mut self.begun));
        }
    }

    /// Counts the messages of pieces that are now on the disk.
    pub(super) fn count_stored(&mut self) {
        let pieces = self.tail.buffer().whole();
        while self.waiting.len() > pieces {
            self.account.stored += self.waiting.pop_front().unwrap_or(0);
        }
    }
}
