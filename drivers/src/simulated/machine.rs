//! Common interface of all virtual devices, for their line and for programs that run one.

use super::Wire;
use crate::transport::{LineError, Peer};

/// A virtual device of any kind. A line asks it for bytes by [`Peer`].
pub trait Machine: Send {
    /// Returns its line.
    fn wire(&mut self) -> &mut Wire;

    /// Takes bytes that the host sent at a rate; only while it listens.
    fn hear(&mut self, bytes: &[u8], line_baud: u32, now_ns: i64);

    /// Follows the opening of its line.
    fn opened(&mut self, _now_ns: i64) {}

    /// Begins to be read at a time; what was not read long before is lost.
    fn awaited(&mut self, _now_ns: i64) {}

    /// Returns the time of its next own action, ns, if it acts by itself.
    fn turn(&self) -> Option<i64> {
        None
    }

    /// Acts up to a time, ns.
    fn act(&mut self, _line_baud: u32, _until_ns: i64) {}

    /// Unplugs it: data in transit are lost, and so is its state without power.
    fn unplug(&mut self) {
        self.wire().plugged = false;
        self.wire().cut();
    }

    /// Plugs it in again.
    fn plug_in(&mut self, _now_ns: i64) {
        self.wire().plugged = true;
    }

    /// Returns the commands obeyed since the last call, as bytes. Programs that run a device for
    /// long must call this regularly, or the commands accumulate.
    fn take_obeyed(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.wire().obeyed)
    }
}

impl<M: Machine + ?Sized> Peer for M {
    fn open(&mut self, now_ns: i64) -> Result<(), LineError> {
        if !self.wire().plugged {
            return Err(LineError::Absent("no such file".into()));
        }
        self.opened(now_ns);
        Ok(())
    }

    fn written(&mut self, bytes: &[u8], baud: u32, now_ns: i64) {
        if self.wire().plugged && !self.wire().hung {
            self.hear(bytes, baud, now_ns);
        }
    }

    fn next(&mut self, baud: u32, now_ns: i64, until_ns: i64) -> Result<Option<(i64, Vec<u8>)>, LineError> {
        if !self.wire().plugged {
            return Err(LineError::Gone("unplugged".into()));
        }
        self.awaited(now_ns);
        loop {
            // Advances only to the first byte that the host waits for, because the host's answer
            // may change everything after it.
            match self.wire().due() {
                Some(at) if at <= until_ns => return Ok(self.wire().receive(at.max(now_ns))),
                _ => {}
            }
            match self.turn() {
                Some(at) if at <= until_ns => self.act(baud, at),
                _ => return Ok(None),
            }
        }
    }

    fn due(&mut self, _now_ns: i64) -> Option<i64> {
        [self.wire().due(), self.turn()].into_iter().flatten().min()
    }
}
