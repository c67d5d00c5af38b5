//! The scan coach: what tells whoever holds the probe, while the scan goes on, how to scan better.
//!
//! It looks on as a [`Witness`] and decides nothing: what is paired, refused and woven is the same with it and without.
//!
//! - [`spacing`]: how far apart slices may lie, by the kernel that weaves them.
//! - [`pane`]: a slice's plane with its data.
//! - [`speed`]: how fast the picture moves, and what part of that is across it.
//! - [`gap`], [`holes`]: what lies between two slices and was seen by neither, and what became of it since.
//! - [`contact`]: whether anything comes back from the depth of the picture.
//! - [`age`]: what there is to say of the day on which the probe was calibrated.
//! - [`sensors`]: which share of the tracker's poses is valid.
//! - [`outlines`]: where the holes and the present slice lie, to be drawn, also in a plane.
//! - [`advice`]: all of it in sentences, the worst first, that do not flicker.
//!
//! A slice costs a bounded number of steps, whatever was scanned before: see [`holes`]. Nothing of the volume is read, so that the weaver is never waited for.

pub mod advice;
pub mod age;
pub mod contact;
pub mod gap;
pub mod holes;
pub mod outlines;
pub mod pane;
pub mod sensors;
pub mod spacing;
pub mod speed;
#[cfg(test)]
mod tests;

use std::sync::{Mutex, MutexGuard, PoisonError};

use drivers::clock::SECOND;
use serde::Serialize;

use crate::mask::{Mask, MaskPlan, MaskSettings};
use crate::pipeline::live::{Account, Glimpsed, Witness};
use crate::slice::Slice;
use crate::sync::history::PoseSample;
use advice::{Advice, Counsel, Signs};
use contact::{Contact, Coupling};
use holes::{Holes, HolesTold};
use outlines::Outlines;
use pane::Pane;
use sensors::{SensorTold, Sensors};
use spacing::Spacing;
use speed::{Speed, SpeedTold};

/// A slice that is older tells nothing of where the probe is.
const PRESENT_NS: i64 = SECOND;

/// What the coach goes by.
#[derive(Debug, Clone)]
pub struct CoachSettings {
    /// How far apart slices may lie.
    pub spacing: Spacing,
    /// What of the picture is data. One that is found in the pictures themselves counts as all of them here.
    pub mask: MaskSettings,
    /// What there is to say of the calibration's age; it is said for as long as the session lasts.
    pub calibration: Option<String>,
}

/// What the coach tells.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CoachTold {
    /// How far apart slices may lie.
    pub spacing: Spacing,
    /// How the probe moves; `None` while no slices come.
    pub speed: Option<SpeedTold>,
    /// What was left out.
    pub holes: HolesTold,
    /// Whether anything comes back from the depth.
    pub contact: Contact,
    /// The tracker's sensors.
    pub sensors: Vec<SensorTold>,
    /// What to do, the worst first.
    pub advice: Vec<Advice>,
    /// Slices that were looked at, and pictures.
    pub slices: u64,
    /// Pictures whose depth was looked at.
    pub pictures: u64,
}

/// Looks on, and knows better.
#[derive(Debug)]
pub struct Coach {
    settings: CoachSettings,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    mask: Option<Mask>,
    speed: Speed,
    holes: Holes,
    present: Option<(Pane, i64)>,
    coupling: Coupling,
    sensors: Sensors,
    counsel: Counsel,
    slices: u64,
}

impl Coach {
    /// That goes by these.
    pub fn new(settings: CoachSettings) -> Self {
        let state = State {
            mask: None,
            speed: Speed::default(),
            holes: Holes::new(settings.spacing),
            present: None,
            coupling: Coupling::default(),
            sensors: Sensors::default(),
            counsel: Counsel::default(),
            slices: 0,
        };
        Self { settings, state: Mutex::new(state) }
    }

    /// What there is to tell at this time, host ns, of a session that tells this of itself. Advice comes and goes with the times of these calls.
    pub fn tell(&self, account: &Account, now_ns: i64) -> CoachTold {
        let mut state = self.lock();
        let speed = state.speed.told(self.settings.spacing, now_ns);
        let present = state.present(now_ns);
        let travel = state.speed.travel();
        let holes = state.holes.told(present.as_ref(), travel);
        let contact = state.coupling.contact(now_ns);
        let sensors = state.sensors.told(now_ns);
        let signs = Signs {
            speed: speed.as_ref(),
            holes: &holes,
            contact,
            sensors: &sensors,
            account,
            calibration: self.settings.calibration.as_deref(),
        };
        let advice = state.counsel.of(&signs, now_ns);
        let (slices, pictures) = (state.slices, state.coupling.pictures());
        CoachTold { spacing: self.settings.spacing, speed, holes, contact, sensors, advice, slices, pictures }
    }

    /// Where the holes and the present slice lie.
    pub fn outlines(&self, now_ns: i64) -> Outlines {
        let state = self.lock();
        Outlines {
            present: state.present(now_ns).map(|pane| *pane.corners()),
            holes: state.holes.gaps().map(|gap| *gap.prism()).collect(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn present(&self, now_ns: i64) -> Option<Pane> {
        let (pane, at_ns) = self.present.as_ref()?;
        (now_ns - at_ns < PRESENT_NS).then_some(*pane)
    }

    /// The data of pictures of a size.
    fn mask_of(&mut self, settings: &MaskSettings, [width, height]: [u32; 2]) {
        if self.mask.as_ref().is_some_and(|mask| [mask.width(), mask.height()] == [width, height]) {
            return;
        }
        self.mask = Some(match settings.plan(width, height) {
            Ok(MaskPlan::Fixed(mask)) => mask,
            _ => Mask::full(width, height),
        });
    }
}

impl Witness for Coach {
    fn cleared(&self) {
        let mut state = self.lock();
        (state.speed, state.holes) = (Speed::default(), Holes::new(self.settings.spacing));
        state.present = None;
    }

    fn glimpsed(&self, glimpsed: &Glimpsed<'_>) {
        let mut state = self.lock();
        let state = &mut *state;
        if !state.coupling.is_due(glimpsed.captured_ns) {
            return;
        }
        state.mask_of(&self.settings.mask, [glimpsed.image.width(), glimpsed.image.height()]);
        if let Some(mask) = &state.mask {
            state.coupling.look(glimpsed.image, mask, glimpsed.captured_ns);
        }
    }

    fn slice(&self, _world: &str, _item: u64, slice: &Slice) {
        let mut state = self.lock();
        let state = &mut *state;
        state.mask_of(&self.settings.mask, [slice.image.width(), slice.image.height()]);
        let Some(mask) = &state.mask else { return };
        let Some(pane) = Pane::new(slice.world_from_image, mask) else { return };
        state.slices += 1;
        state.speed.add(&pane, slice.time_ns);
        state.holes.add(&pane, mask, slice.time_ns);
        state.present = Some((pane, slice.time_ns));
    }

    fn pose(&self, [from, _]: [&str; 2], sample: &PoseSample) {
        self.lock().sensors.add(from, sample.time_ns, sample.invalid.as_deref());
    }
}
