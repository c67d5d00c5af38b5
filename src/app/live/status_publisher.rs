//! Publishes a running session's status over HTTP and to the service manager.

use std::sync::Arc;
use std::time::{Duration, Instant};

use config::bedside::{Bedside, Realtime, pixel_mm, probe_from_image};
use console::{About, Basis, Console, ConsoleSession, FrameBroadcaster, Latest, Listen};
use guidance::age::calibration_age;
use guidance::spacing::Spacing;
use guidance::{GuidanceSettings, ScanGuidance};
use measure::{Slices, Uncertainty};
use pipeline::control::SessionController;
use pipeline::session::{SchedulingPolicy, SessionStatus};
use reconstruct::kernel::AxisKernel;
use sonoweave_core::clock::{Clock as _, Monotonic};
use sonoweave_core::date::Date;
use statistics::IgtlNumbers;

use super::identity;
use crate::app::service::Service;
use crate::failure::Failure;

/// Kind of a replayed session.
pub(crate) const REPLAY: &str = "replay";
/// Time between two status updates for clients.
const OFTEN: Duration = Duration::from_millis(200);

/// The status publisher.
pub(crate) struct StatusPublisher {
    kind: &'static str,
    /// Hash that identifies the session; empty before the first.
    session: String,
    service: Service,
    latest: Arc<Latest>,
    console: Option<Console>,
    broadcaster: Option<Arc<FrameBroadcaster>>,
    slices: Arc<Slices>,
    guidance: Option<Arc<ScanGuidance>>,
    /// Time of the last status update for clients.
    published: Option<Instant>,
}

impl StatusPublisher {
    /// Starts the publisher, before any device is opened.
    ///
    /// # Errors
    /// [`Failure`] when the status address is taken, or would be open to unauthorised clients.
    pub(crate) fn begin(
        bedside: &Bedside,
        listen: Option<Listen>,
        kind: &'static str,
        controller: &Arc<SessionController>,
    ) -> Result<Self, Failure> {
        let latest = Arc::new(Latest::new(basis(bedside, kind, "")));
        let broadcaster = listen.as_ref().map(|_| Arc::new(FrameBroadcaster::default()));
        let slices = Arc::new(Slices::default());
        let console = match (&listen, &broadcaster) {
            (Some(listen), Some(broadcaster)) => {
                let session = ConsoleSession {
                    latest: Arc::clone(&latest),
                    broadcaster: Arc::clone(broadcaster),
                    controller: Arc::clone(controller),
                    slices: Arc::clone(&slices),
                };
                Some(Console::open(listen, session)?)
            }
            _ => None,
        };
        let service = Service::new();
        let mut publisher = Self {
            kind,
            session: String::new(),
            service,
            latest,
            console,
            broadcaster,
            slices,
            guidance: None,
            published: None,
        };
        publisher.begin_volume(bedside)?;
        Ok(publisher)
    }

    /// Begins a session with these settings; `recording` is the name of its file, if it has one.
    ///
    /// # Errors
    /// [`Failure`] for an invalid kernel.
    pub(crate) fn begin_session(&mut self, bedside: &Bedside, recording: Option<&str>) -> Result<(), Failure> {
        self.session = identity::of_session(recording);
        self.begin_volume(bedside)
    }

    /// Begins a volume with these settings.
    fn begin_volume(&mut self, bedside: &Bedside) -> Result<(), Failure> {
        if let Some(broadcaster) = &self.broadcaster {
            let guidance = guidance(bedside)?;
            broadcaster.follow(&guidance);
            self.guidance = Some(guidance);
        }
        self.slices.restart(kernels(bedside).map(|[_, _, across]| across));
        self.latest.adopt(basis(bedside, self.kind, &self.session));
        Ok(())
    }

    /// Returns the console's address, if there is one.
    pub(crate) fn address(&self) -> Option<String> {
        self.console.as_ref().map(|console| console.url().to_owned())
    }

    /// Returns the browser viewers' view of the volume, if there is a console.
    pub(crate) fn broadcaster(&self) -> Option<Arc<FrameBroadcaster>> {
        self.broadcaster.clone()
    }

    /// Returns the record of all slice positions.
    pub(crate) fn slices(&self) -> Arc<Slices> {
        Arc::clone(&self.slices)
    }

    /// Returns the scan guidance, if a page could show it.
    pub(crate) fn guidance(&self) -> Option<Arc<ScanGuidance>> {
        self.guidance.clone()
    }

    /// Announces to the service manager that the settings are read again.
    pub(super) fn reloading(&mut self) {
        self.service.reloading();
    }

    /// Publishes the settings that are active now.
    pub(super) fn reloaded(&mut self, bedside: &Bedside) {
        self.latest.adopt(basis(bedside, self.kind, &self.session));
        self.service.reloaded();
    }

    /// Publishes the numbers of the OpenIGTLink server.
    pub(crate) fn publish_igtl(&self, numbers: IgtlNumbers) {
        self.latest.publish_igtl(numbers);
    }

    /// Publishes the final status.
    pub(crate) fn over(&mut self, status: &SessionStatus) {
        self.published = Some(Instant::now());
        self.latest.publish(status, &[]);
    }

    /// Publishes the status while the session runs, and once when it begins to end.
    pub(crate) fn publish(&mut self, status: &SessionStatus, line: fn(&SessionStatus) -> String, ends: bool) {
        if ends {
            self.latest.end();
            self.service.stopping();
            self.service.status(&format!("ends: {}", line(status)));
        } else {
            self.service.update(status, line);
        }
        if ends || self.published.is_none_or(|told| told.elapsed() >= OFTEN) {
            self.published = Some(Instant::now());
            // Scan guidance is useless for a replay.
            if let Some(guidance) = self.guidance.as_ref().filter(|_| self.kind != REPLAY) {
                self.latest.publish_guidance(guidance.status(status, Monotonic.now_ns()));
            }
            self.latest.publish(status, self.service.stalled());
        }
    }
}

/// Returns the session's settings, as published.
fn basis(bedside: &Bedside, kind: &'static str, session: &str) -> Basis {
    Basis {
        config: bedside.effective.clone(),
        uncertainty: uncertainty(bedside),
        about: about(bedside, kind),
        identity: identity::identity(bedside, session),
        calibrated: bedside.calibration.record.origin.made,
    }
}

/// Returns the slices' kernels, if the calibration gives the pixel size.
fn kernels(bedside: &Bedside) -> Option<[AxisKernel; 3]> {
    bedside.volume.settings.kernels(pixel_mm(&bedside.calibration)?).ok()
}

/// Returns what is known of the errors of the volume's places.
fn uncertainty(bedside: &Bedside) -> Uncertainty {
    let hwhm_mm = |kernels: [AxisKernel; 3]| kernels.map(|kernel| kernel.hwhm() * kernel.sigma_mm);
    Uncertainty {
        probe_from_image: probe_from_image(&bedside.calibration),
        calibration: bedside.calibration.record.covariance.clone(),
        sensors: bedside.sensor_noise(),
        has_reference: bedside.tracking.has_reference(),
        voxel_mm: bedside.volume.settings.spacing_mm.max_element(),
        hwhm_mm: kernels(bedside).map_or([0.0; 3], hwhm_mm),
    }
}

/// Describes the session for pages.
fn about(bedside: &Bedside, kind: &'static str) -> About {
    let name = bedside.path.file_name().unwrap_or(bedside.path.as_os_str()).to_string_lossy().into_owned();
    let size = bedside.grabber.settings.size.map(|size| bedside.grabber.turned(size));
    About { name, kind, size, pixel_mm: pixel_mm(&bedside.calibration) }
}

/// Creates the scan guidance for the reconstruction settings.
///
/// # Errors
/// [`Failure`] for an invalid kernel.
fn guidance(bedside: &Bedside) -> Result<Arc<ScanGuidance>, Failure> {
    let settings = &bedside.volume.settings;
    let pixel_mm = pixel_mm(&bedside.calibration).unwrap_or([settings.spacing_mm.max_element(); 2]);
    let made = bedside.calibration.record.origin.made;
    let worth_a_word_days = bedside.effective.get("calibration.warn_after_days").and_then(|days| days.as_i64());
    let calibration = made.zip(worth_a_word_days).and_then(|(made, days)| calibration_age(made, Date::today(), days));
    Ok(Arc::new(ScanGuidance::new(GuidanceSettings {
        spacing: Spacing::of(settings, pixel_mm)?,
        mask: bedside.mask,
        calibration,
    })))
}

/// Returns the session's scheduling policy, from the configuration. A virtual bedside renders
/// its images in the capture thread. This work is not urgent, so it gets real-time scheduling
/// only if required.
///
/// # Errors
/// [`Failure`] when the required policy is not available.
pub(crate) fn policy(bedside: &Bedside) -> Result<SchedulingPolicy, Failure> {
    let is_wanted = match bedside.process.realtime {
        Realtime::Never => false,
        Realtime::IfPermitted => bedside.virtual_bedside.is_none(),
        Realtime::Required => true,
    };
    if !is_wanted {
        return Ok(SchedulingPolicy::default());
    }
    let policy = SchedulingPolicy::ask(bedside.volume.settings.memory_bytes);
    match (bedside.process.realtime, policy.granted().why.first()) {
        (Realtime::Required, Some(why)) => Err(Failure::new(format!("process.realtime = \"required\": {why}"))),
        _ => Ok(policy),
    }
}
