//! To whom a running session tells how it is: whoever asks over HTTP, and the service manager.

use std::sync::Arc;
use std::time::{Duration, Instant};

use calibration::file::date::Date;
use drivers::clock::{Clock as _, Monotonic};

use crate::cli::Failure;
use crate::coach::age::calibration_age;
use crate::coach::spacing::Spacing;
use crate::coach::{Coach, CoachSettings};
use crate::config::bedside::{Bedside, Realtime, pixel_mm};
use crate::console::{About, Basis, Console, Latest, Listen, Screen, Shown};
use crate::desk::Desk;
use crate::measure::{Doubt, Slices};
use crate::pipeline::live::{Account, Standing};
use crate::reconstruct::kernel::AxisKernel;
use crate::service::Service;

/// The kind of a recorded session.
pub(in crate::cli) const REPLAY: &str = "replay";
/// Between two accounts for those who ask.
const OFTEN: Duration = Duration::from_millis(200);

/// Those who are told.
pub(in crate::cli) struct Telling {
    kind: &'static str,
    service: Service,
    latest: Arc<Latest>,
    console: Option<Console>,
    screen: Option<Arc<Screen>>,
    slices: Arc<Slices>,
    coach: Option<Arc<Coach>>,
    told: Option<Instant>,
}

impl Telling {
    /// Before any device is opened.
    ///
    /// # Errors
    /// [`Failure`] where the status was to be had is taken, or others could ask for it who must not.
    pub(in crate::cli) fn begin(
        bedside: &Bedside,
        listen: Option<Listen>,
        kind: &'static str,
        desk: &Arc<Desk>,
    ) -> Result<Self, Failure> {
        let latest = Arc::new(Latest::new(basis(bedside, kind)));
        let screen = listen.as_ref().map(|_| Arc::new(Screen::default()));
        let slices = Arc::new(Slices::default());
        let console = match (&listen, &screen) {
            (Some(listen), Some(screen)) => {
                let shown = Shown {
                    latest: Arc::clone(&latest),
                    screen: Arc::clone(screen),
                    desk: Arc::clone(desk),
                    slices: Arc::clone(&slices),
                };
                Some(Console::open(listen, shown)?)
            }
            _ => None,
        };
        let service = Service::new();
        let mut telling = Self { kind, service, latest, console, screen, slices, coach: None, told: None };
        telling.weaves(bedside)?;
        Ok(telling)
    }

    /// A volume begins that is woven by these settings.
    ///
    /// # Errors
    /// [`Failure`] for a kernel that is none.
    pub(in crate::cli) fn weaves(&mut self, bedside: &Bedside) -> Result<(), Failure> {
        if let Some(screen) = &self.screen {
            let coach = coach(bedside)?;
            screen.follow(&coach);
            self.coach = Some(coach);
        }
        self.slices.weave(kernels(bedside).map(|[_, _, across]| across));
        self.latest.adopt(basis(bedside, self.kind));
        Ok(())
    }

    /// Where it is to be seen, if it is.
    pub(in crate::cli) fn address(&self) -> Option<String> {
        self.console.as_ref().map(|console| console.url().to_owned())
    }

    /// What browsers see, where they may.
    pub(in crate::cli) fn screen(&self) -> Option<Arc<Screen>> {
        self.screen.clone()
    }

    /// Who keeps where all slices lie.
    pub(in crate::cli) fn slices(&self) -> Arc<Slices> {
        Arc::clone(&self.slices)
    }

    /// Who knows how the scan goes, where a page could show it.
    pub(in crate::cli) fn coach(&self) -> Option<Arc<Coach>> {
        self.coach.clone()
    }

    /// The settings are about to be read again.
    pub(super) fn reloading(&mut self) {
        self.service.reloading();
    }

    /// These hold now.
    pub(super) fn reloaded(&mut self, bedside: &Bedside) {
        self.latest.adopt(basis(bedside, self.kind));
        self.service.reloaded();
    }

    /// What it has come to.
    pub(in crate::cli) fn over(&mut self, account: &Account) {
        self.told = Some(Instant::now());
        self.latest.tell(account, &[]);
    }

    /// Now and then while the session runs, and once when it begins to end.
    pub(in crate::cli) fn look(&mut self, account: &Account, line: fn(&Account) -> String, ends: bool) {
        if ends {
            self.latest.end();
            self.service.stopping();
            self.service.status(&format!("ends: {}", line(account)));
        } else {
            self.service.look(account, line);
        }
        if ends || self.told.is_none_or(|told| told.elapsed() >= OFTEN) {
            self.told = Some(Instant::now());
            // What there is to do better is of no use afterwards.
            if let Some(coach) = self.coach.as_ref().filter(|_| self.kind != REPLAY) {
                self.latest.coached(coach.tell(account, Monotonic.now_ns()));
            }
            self.latest.tell(account, self.service.still());
        }
    }
}

/// What there is to tell of what a session runs by.
fn basis(bedside: &Bedside, kind: &'static str) -> Basis {
    Basis { config: bedside.effective.clone(), doubt: doubt(bedside), about: about(bedside, kind) }
}

/// The kernels of its slices, where the calibration says how large their pixels are.
fn kernels(bedside: &Bedside) -> Option<[AxisKernel; 3]> {
    bedside.volume.settings.kernels(pixel_mm(&bedside.calibration)?).ok()
}

/// How far places of its volume may be off.
fn doubt(bedside: &Bedside) -> Doubt {
    let quality = bedside.calibration.preset.as_ref().and_then(|preset| preset.quality);
    let widest = |kernels: [AxisKernel; 3]| kernels.map(|k| k.hwhm() * k.sigma_mm).into_iter().fold(0.0, f64::max);
    Doubt {
        calibration_mm: quality.map(|quality| quality.corner_mm),
        voxel_mm: bedside.volume.settings.spacing_mm.max_element(),
        hwhm_mm: kernels(bedside).map_or(0.0, widest),
    }
}

/// The session, to pages.
fn about(bedside: &Bedside, kind: &'static str) -> About {
    let name = bedside.path.file_name().unwrap_or(bedside.path.as_os_str()).to_string_lossy().into_owned();
    let size = bedside.grabber.settings.size.map(|size| bedside.grabber.turned(size));
    About { name, kind, size, pixel_mm: pixel_mm(&bedside.calibration) }
}

/// Who knows how the scan goes, by what the volume is woven with.
///
/// # Errors
/// [`Failure`] for a kernel that is none.
fn coach(bedside: &Bedside) -> Result<Arc<Coach>, Failure> {
    let settings = &bedside.volume.settings;
    let pixel_mm = pixel_mm(&bedside.calibration).unwrap_or([settings.spacing_mm.max_element(); 2]);
    let preset = bedside.calibration.preset.as_ref();
    let worth_a_word_days = bedside.effective.get("calibration.warn_after_days").and_then(|days| days.as_i64());
    let calibration = preset
        .and_then(|preset| preset.made)
        .zip(worth_a_word_days)
        .and_then(|(made, days)| calibration_age(made, Date::today(), days));
    Ok(Arc::new(Coach::new(CoachSettings {
        spacing: Spacing::of(settings, pixel_mm)?,
        mask: bedside.mask,
        calibration,
    })))
}

/// The session's standing with the scheduler, as the configuration wants it. A virtual bedside paints what its grabber shows, in the thread that captures: that is no work to
/// be done before all other, and is so only where it must be.
///
/// # Errors
/// [`Failure`] when it wants more than there is.
pub(in crate::cli) fn standing(bedside: &Bedside) -> Result<Standing, Failure> {
    let is_wanted = match bedside.process.realtime {
        Realtime::Never => false,
        Realtime::IfPermitted => bedside.rehearsal.is_none(),
        Realtime::Required => true,
    };
    if !is_wanted {
        return Ok(Standing::default());
    }
    let standing = Standing::ask(bedside.volume.settings.memory_bytes);
    match (bedside.process.realtime, standing.granted().why.first()) {
        (Realtime::Required, Some(why)) => Err(Failure(format!("process.realtime = \"required\": {why}"))),
        _ => Ok(standing),
    }
}
