//! The newest status of a session, and the settings that clients can query.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use config::bedside::Effective;
use guidance::GuidanceStatus;
use measure::Uncertainty;
use pipeline::session::SessionStatus;
use sonoweave_core::date::Date;
use statistics::{IgtlNumbers, LiveStatistics};

/// Description of a session for pages.
#[derive(Debug, Clone, Default)]
pub struct About {
    /// Name of the session: its configuration's name.
    pub name: String,
    /// Kind of session: live, demo or replay.
    pub kind: &'static str,
    /// Pixels of the B-mode image to the right and down, if known.
    pub size: Option<[u32; 2]>,
    /// Pixel spacing, mm, by the calibration.
    pub pixel_mm: Option<[f64; 2]>,
}

/// Identity of a session for programs that watch many. Its hashes are cut to 12 digits, and name
/// no person and no folder.
#[derive(Debug, Clone, Default)]
pub struct Identity {
    /// Hash of the name of the session's recording; empty before it begins.
    pub session: String,
    /// Hash of the configuration file.
    pub configuration: String,
    /// Hash of the calibration file; empty without one.
    pub calibration: String,
}

/// A session whose status is older than this has stalled.
pub(super) const STALE: Duration = Duration::from_secs(5);

/// Settings of a session that clients can query.
#[derive(Debug, Clone, Default)]
pub struct Basis {
    /// The session's settings, key by key.
    pub config: Effective,
    /// Uncertainty of measured places.
    pub uncertainty: Uncertainty,
    /// Description of the session's pictures.
    pub about: About,
    /// Identity of the session.
    pub identity: Identity,
    /// Day of the probe's calibration, if known.
    pub calibrated: Option<Date>,
}

/// The newest status of a session, for clients.
#[derive(Debug)]
pub struct Latest {
    began: Instant,
    pub(super) report: Mutex<Report>,
}

/// The last report.
#[derive(Debug, Clone)]
pub(super) struct Report {
    pub(super) at: Instant,
    pub(super) account: Arc<SessionStatus>,
    pub(super) guidance: Option<Arc<GuidanceStatus>>,
    pub(super) igtl: Option<IgtlNumbers>,
    pub(super) basis: Arc<Basis>,
    pub(super) still: Vec<String>,
    pub(super) ended: bool,
}

impl Default for Latest {
    fn default() -> Self {
        Self::new(Basis::default())
    }
}

impl Latest {
    /// Starts the status of a session that begins now, with these settings.
    pub fn new(basis: Basis) -> Self {
        let began = Instant::now();
        let report = Report {
            at: began,
            account: Arc::default(),
            guidance: None,
            igtl: None,
            basis: Arc::new(basis),
            still: Vec::new(),
            ended: false,
        };
        Self { began, report: Mutex::new(report) }
    }

    /// Stores the present status and the stalled stages.
    pub fn publish(&self, account: &SessionStatus, still: &[String]) {
        let (account, still) = (Arc::new(account.clone()), still.to_vec());
        let mut report = self.lock();
        (report.at, report.account, report.still) = (Instant::now(), account, still);
    }

    /// Stores the present scan guidance.
    pub fn publish_guidance(&self, guidance: GuidanceStatus) {
        self.lock().guidance = Some(Arc::new(guidance));
    }

    /// Stores the present numbers of the OpenIGTLink server.
    pub fn publish_igtl(&self, numbers: IgtlNumbers) {
        self.lock().igtl = Some(numbers);
    }

    /// Records that the session is ending: from now on it only finishes its output.
    pub fn end(&self) {
        self.lock().ended = true;
    }

    /// Replaces the settings from now on.
    pub fn adopt(&self, basis: Basis) {
        self.lock().basis = Arc::new(basis);
    }

    fn lock(&self) -> MutexGuard<'_, Report> {
        self.report.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the last report.
    pub(super) fn report(&self) -> Report {
        self.lock().clone()
    }

    /// Returns the time since the last frame by a report, or since the session's begin before the
    /// first, s. It grows even if the session no longer reports.
    pub(super) fn frame_age_s(&self, report: &Report) -> f64 {
        match report.account.last_frame_s_ago {
            Some(ago) => ago + report.at.elapsed().as_secs_f64(),
            None => self.began.elapsed().as_secs_f64(),
        }
    }

    pub(super) fn statistics<'a>(&'a self, report: &'a Report) -> LiveStatistics<'a> {
        LiveStatistics::new(&report.account, report.at.duration_since(self.began), &report.basis.config)
            .with_guidance(report.guidance.as_deref())
            .with_igtl(report.igtl)
    }
}
