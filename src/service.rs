//! What a service manager is told of a session: systemd's notifications, by the socket that it names in `NOTIFY_SOCKET`. Without one nothing is told, and nothing is missing.
//!
//! | when | what |
//! |---|---|
//! | every device has been tried: it runs, or it was said why not | `READY=1` |
//! | now and then, when it has changed | `STATUS=`, a line |
//! | with `WATCHDOG_USEC`, three times as often as it asks for | `WATCHDOG=1`, if every stage has moved since |
//! | the settings are read again | `RELOADING=1` and the time, then `READY=1` |
//! | the session is told to end | `STOPPING=1` |
//!
//! A stage that stands still leaves the watchdog without its word, and the manager starts the daemon anew; which stage, the log says.

use std::time::{Duration, Instant};

use sd_notify::NotifyState;

use crate::pipeline::live::{Account, Movement};

/// Between two looks at whether stages have moved, where nobody asks for them more often. A turn takes a fraction of a second, and a few seconds where a device is opened.
const LOOK: Duration = Duration::from_secs(5);
/// And at least, where somebody does.
const LEAST_LOOK: Duration = Duration::from_millis(500);
/// Between two status lines.
const STATUS: Duration = Duration::from_secs(2);
/// A device that cannot be opened does not keep the session from being ready for longer.
const PATIENCE: Duration = Duration::from_secs(10);

/// The service that a session is, to its manager.
#[derive(Debug)]
pub struct Service {
    began: Instant,
    ready: bool,
    stopping: bool,
    said: String,
    said_at: Option<Instant>,
    movement: Movement,
    look_every: Duration,
    looked_at: Option<Instant>,
    watched: bool,
    still: Vec<String>,
    refused: bool,
}

impl Service {
    /// As the environment has it.
    pub fn new() -> Self {
        let watchdog = sd_notify::watchdog_enabled();
        Self {
            began: Instant::now(),
            ready: false,
            stopping: false,
            said: String::new(),
            said_at: None,
            movement: Movement::default(),
            look_every: watchdog.map_or(LOOK, |within| (within / 3).max(LEAST_LOOK)),
            looked_at: None,
            watched: watchdog.is_some(),
            still: Vec::new(),
            refused: false,
        }
    }

    /// Looks at the session, and tells what is due; `line` makes a line of it. To be called several times a second.
    pub fn look(&mut self, account: &Account, line: impl FnOnce(&Account) -> String) {
        let now = Instant::now();
        if !self.ready && (started(account) || now.duration_since(self.began) >= PATIENCE) {
            self.ready = true;
            self.tell(&[NotifyState::Ready]);
        }
        if !self.ready {
            self.status("opens its devices");
        } else if self.said_at.is_none_or(|at| now.duration_since(at) >= STATUS) {
            self.said_at = Some(now);
            self.status(&line(account));
        }
        if self.looked_at.is_none_or(|at| now.duration_since(at) >= self.look_every) {
            self.looked_at = Some(now);
            let still = self.movement.still(&account.stages);
            if !still.is_empty() && still != self.still {
                tracing::error!("stands still: {}", still.join(", "));
            }
            self.still = still;
            if self.watched && self.still.is_empty() {
                self.tell(&[NotifyState::Watchdog]);
            }
        }
    }

    /// The stages that stood still between the last two looks.
    pub fn still(&self) -> &[String] {
        &self.still
    }

    /// What is told in one line, if it is not what was told last.
    pub fn status(&mut self, line: &str) {
        // A line break would begin another assignment.
        let line = line.replace(['\n', '\r'], "; ");
        if line != self.said {
            self.tell(&[NotifyState::Status(&line)]);
            self.said = line;
        }
    }

    /// The settings are being read again; [`Self::reloaded`] follows.
    pub fn reloading(&mut self) {
        match NotifyState::monotonic_usec_now() {
            Ok(at) => self.tell(&[NotifyState::Reloading, at]),
            Err(error) => tracing::warn!("the service manager is not told of the new settings: {error}"),
        }
    }

    /// They have been read, or refused; the session goes on.
    pub fn reloaded(&mut self) {
        self.tell(&[NotifyState::Ready]);
    }

    /// The session ends; what it leaves is written next.
    pub fn stopping(&mut self) {
        if !std::mem::replace(&mut self.stopping, true) {
            self.tell(&[NotifyState::Stopping]);
        }
    }

    fn tell(&mut self, states: &[NotifyState<'_>]) {
        // A manager that does not listen is said once: the session needs nothing of it.
        if let Err(error) = sd_notify::notify(states)
            && !std::mem::replace(&mut self.refused, true)
        {
            tracing::warn!("the service manager is not told: {error}; is NOTIFY_SOCKET right?");
        }
    }
}

impl Default for Service {
    fn default() -> Self {
        Self::new()
    }
}

/// Whether every device has been tried: none is still to be opened for the first time.
fn started(account: &Account) -> bool {
    let tried = |state: &str, set_up: u64| state == "running" || state == "ended" || state == "silent" || set_up > 0;
    account.devices.iter().all(|device| tried(device.state, device.set_up) || !device.why.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::live::DeviceBoard;

    #[test]
    fn a_session_has_started_when_each_device_runs_or_says_why_not() {
        let device = |state, why: &str, set_up| DeviceBoard {
            name: "tracking".into(),
            state,
            why: why.into(),
            bytes: 0,
            readings: 0,
            lost: 0,
            set_up,
            last_reading_s_ago: None,
            clocks: Vec::new(),
        };
        let of = |devices: Vec<DeviceBoard>| started(&Account { devices, ..Account::default() });
        assert!(of(vec![device("running", "", 1), device("absent", "no such file; plug it in", 0)]));
        assert!(!of(vec![device("running", "", 1), device("starting", "", 0)]));
        assert!(!of(vec![device("stopped", "", 0)]));
        assert!(of(vec![device("starting", "", 1)]), "anew");
    }
}
