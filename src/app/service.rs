//! Notifications of a session to systemd, through the socket named in `NOTIFY_SOCKET`. Without
//! that variable, nothing is sent.
//!
//! | when | message |
//! |---|---|
//! | every device has been tried: it runs, or its error is reported | `READY=1` |
//! | periodically, if it has changed | `STATUS=`, a line |
//! | with `WATCHDOG_USEC`, three times as often as it asks for | `WATCHDOG=1`, if every stage has progressed since |
//! | the settings are read again | `RELOADING=1` and the time, then `READY=1` |
//! | the session is to end | `STOPPING=1` |
//!
//! If a stage is blocked, the watchdog gets no message and systemd restarts the daemon; the log
//! names the stage.

use std::time::{Duration, Instant};

use sd_notify::NotifyState;

use pipeline::session::{SessionStatus, StallDetector};

/// Interval of the progress checks, unless the watchdog requires shorter ones. A turn takes a
/// fraction of a second, or a few seconds while a device is opened.
const CHECK: Duration = Duration::from_secs(5);
/// Shortest interval of the progress checks.
const SHORTEST_CHECK: Duration = Duration::from_millis(500);
/// Interval of status lines.
const STATUS: Duration = Duration::from_secs(2);
/// Longest time for which a device that cannot be opened delays `READY=1`.
const PATIENCE: Duration = Duration::from_secs(10);

/// The session as a service of systemd.
#[derive(Debug)]
pub struct Service {
    began: Instant,
    ready: bool,
    stopping: bool,
    status_line: String,
    status_at: Option<Instant>,
    detector: StallDetector,
    check_every: Duration,
    checked_at: Option<Instant>,
    watched: bool,
    stalled: Vec<String>,
    refused: bool,
}

impl Service {
    /// Returns the service, configured by the environment.
    pub fn new() -> Self {
        let watchdog = sd_notify::watchdog_enabled();
        Self {
            began: Instant::now(),
            ready: false,
            stopping: false,
            status_line: String::new(),
            status_at: None,
            detector: StallDetector::default(),
            check_every: watchdog.map_or(CHECK, |within| (within / 3).max(SHORTEST_CHECK)),
            checked_at: None,
            watched: watchdog.is_some(),
            stalled: Vec::new(),
            refused: false,
        }
    }

    /// Checks the session, and sends the notifications that are due; `line` formats its status
    /// line. Call it several times a second.
    pub fn update(&mut self, status: &SessionStatus, line: impl FnOnce(&SessionStatus) -> String) {
        let now = Instant::now();
        if !self.ready && (started(status) || now.duration_since(self.began) >= PATIENCE) {
            self.ready = true;
            self.notify(&[NotifyState::Ready]);
        }
        if !self.ready {
            self.status("opens its devices");
        } else if self.status_at.is_none_or(|at| now.duration_since(at) >= STATUS) {
            self.status_at = Some(now);
            self.status(&line(status));
        }
        if self.checked_at.is_none_or(|at| now.duration_since(at) >= self.check_every) {
            self.checked_at = Some(now);
            let stalled = self.detector.stalled(&status.stages);
            if !stalled.is_empty() && stalled != self.stalled {
                tracing::error!("stands still: {}", stalled.join(", "));
            }
            self.stalled = stalled;
            if self.watched && self.stalled.is_empty() {
                self.notify(&[NotifyState::Watchdog]);
            }
        }
    }

    /// Returns the stages that were blocked between the last two checks.
    pub fn stalled(&self) -> &[String] {
        &self.stalled
    }

    /// Sends a status line, if it has changed.
    pub fn status(&mut self, line: &str) {
        // A line break would begin another assignment.
        let line = line.replace(['\n', '\r'], "; ");
        if line != self.status_line {
            self.notify(&[NotifyState::Status(&line)]);
            self.status_line = line;
        }
    }

    /// Reports that the settings are being read again; [`Self::reloaded`] follows.
    pub fn reloading(&mut self) {
        match NotifyState::monotonic_usec_now() {
            Ok(at) => self.notify(&[NotifyState::Reloading, at]),
            Err(error) => tracing::warn!("the service manager did not receive the new settings: {error}"),
        }
    }

    /// Reports that the settings have been read, or refused; the session continues.
    pub fn reloaded(&mut self) {
        self.notify(&[NotifyState::Ready]);
    }

    /// Reports that the session ends; its results are written next.
    pub fn stopping(&mut self) {
        if !std::mem::replace(&mut self.stopping, true) {
            self.notify(&[NotifyState::Stopping]);
        }
    }

    fn notify(&mut self, states: &[NotifyState<'_>]) {
        // A failure is logged once: the session does not depend on systemd.
        if let Err(error) = sd_notify::notify(states)
            && !std::mem::replace(&mut self.refused, true)
        {
            tracing::warn!("the service manager cannot be notified: {error}; is NOTIFY_SOCKET right?");
        }
    }
}

impl Default for Service {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns whether every device has been tried, that is, none is stalled being opened for the
/// first time.
fn started(status: &SessionStatus) -> bool {
    let tried = |state: &str, set_up: u64| state == "running" || state == "ended" || state == "silent" || set_up > 0;
    status.devices.iter().all(|device| tried(device.state, device.set_up) || !device.why.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use pipeline::session::DeviceStatus;

    #[test]
    fn session_started_when_devices_run_or_report_errors() {
        let device = |state, why: &str, set_up| DeviceStatus {
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
        let of = |devices: Vec<DeviceStatus>| started(&SessionStatus { devices, ..SessionStatus::default() });
        assert!(of(vec![device("running", "", 1), device("absent", "no such file; plug it in", 0)]));
        assert!(!of(vec![device("running", "", 1), device("starting", "", 0)]));
        assert!(!of(vec![device("stopped", "", 0)]));
        assert!(of(vec![device("starting", "", 1)]), "anew");
    }
}
