//! Scan guidance: live advice to the operator of the probe.
//!
//! It only observes, as a [`Observer`]. Pairing, refusals and insertion are the same with it
//! and without it.
//!
//! - [`spacing`]: allowed distance between slices, by the reconstruction kernel.
//! - [`slice_plane`]: a slice's plane and its data.
//! - [`speed`]: speed of the image plane, and its part across the plane.
//! - [`gap`], [`holes`]: gaps between slices, and their later closure.
//! - [`contact`]: whether echoes return from the depth of the image.
//! - [`age`]: advice about the age of the probe calibration.
//! - [`breathing`]: breathing of the body, by the Reference sensor.
//! - [`sensors`]: share of the tracker's poses that is valid.
//! - [`outlines`]: outlines of the holes and the present slice, also for drawing in a plane.
//! - [`advice`]: all findings in sentences, the worst first, without flicker.
//!
//! A slice costs a bounded number of steps, whatever was scanned before: see [`holes`]. The
//! guidance does not read the volume, so it never blocks the reconstruction.

pub mod advice;
pub mod age;
pub mod breathing;
pub mod contact;
pub mod gap;
pub mod holes;
pub mod outlines;
pub mod sensors;
pub mod slice_plane;
pub mod spacing;
pub mod speed;
#[cfg(test)]
mod tests;

use std::sync::{Mutex, MutexGuard, PoisonError};

use serde::Serialize;

use mask::{Mask, MaskPlan, MaskSettings};
use pipeline::session::SessionStatus;
use pipeline::{CapturedFrame, InsertedSlice, Observer};
use sonoweave_core::clock::SECOND;
use sonoweave_core::slice::Slice;
use sync::history::PoseSample;

use advice::{Advice, AdviceDebouncer, Signs};
use breathing::{Breathing, BreathingStatus};
use contact::{Contact, Coupling};
use holes::{Holes, HolesStatus};
use outlines::Outlines;
use sensors::{REFERENCE, SensorStatus, Sensors};
use slice_plane::SlicePlane;
use spacing::Spacing;
use speed::{Speed, SpeedStatus};

/// Age at which a slice no longer gives the probe's position, ns.
const PRESENT_NS: i64 = SECOND;

/// Settings of the scan guidance.
#[derive(Debug, Clone)]
pub struct GuidanceSettings {
    /// Allowed distance between slices.
    pub spacing: Spacing,
    /// Data area of the image. A mask to be detected from the images counts as the full image
    /// here.
    pub mask: MaskSettings,
    /// Sentence about the calibration's age; it is shown for the whole session.
    pub calibration: Option<String>,
}

/// Report of the scan guidance.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GuidanceStatus {
    /// Allowed distance between slices.
    pub spacing: Spacing,
    /// Motion of the probe; `None` while no slices arrive.
    pub speed: Option<SpeedStatus>,
    /// Holes in the scan.
    pub holes: HolesStatus,
    /// Contact of the probe.
    pub contact: Contact,
    /// The tracker's sensors.
    pub sensors: Vec<SensorStatus>,
    /// Breathing of the body, if a Reference sensor on it shows that.
    pub breathing: Option<BreathingStatus>,
    /// Advice, the worst first.
    pub advice: Vec<Advice>,
    /// Slices evaluated.
    pub slices: u64,
    /// Images whose depth was evaluated.
    pub pictures: u64,
}

/// Scan guidance of a session.
#[derive(Debug)]
pub struct ScanGuidance {
    settings: GuidanceSettings,
    state: Mutex<State>,
}

#[derive(Debug)]
struct State {
    mask: Option<Mask>,
    speed: Speed,
    holes: Holes,
    present: Option<(SlicePlane, i64)>,
    coupling: Coupling,
    sensors: Sensors,
    breathing: Breathing,
    advice: AdviceDebouncer,
    slices: u64,
}

impl ScanGuidance {
    /// Creates the scan guidance.
    pub fn new(settings: GuidanceSettings) -> Self {
        let state = State {
            mask: None,
            speed: Speed::default(),
            holes: Holes::new(settings.spacing),
            present: None,
            coupling: Coupling::default(),
            sensors: Sensors::default(),
            breathing: Breathing::default(),
            advice: AdviceDebouncer::default(),
            slices: 0,
        };
        Self { settings, state: Mutex::new(state) }
    }

    /// Returns the report at this time, host ns, given the session status. The times of these
    /// calls control the appearance and removal of advice.
    pub fn status(&self, account: &SessionStatus, now_ns: i64) -> GuidanceStatus {
        let mut state = self.lock();
        let speed = state.speed.status(self.settings.spacing, now_ns);
        let present = state.present(now_ns);
        let travel = state.speed.travel();
        let holes = state.holes.status(present.as_ref(), travel);
        let contact = state.coupling.contact(now_ns);
        let sensors = state.sensors.status(now_ns);
        let breathing = state.breathing.status(now_ns);
        let signs = Signs {
            speed: speed.as_ref(),
            holes: &holes,
            contact,
            sensors: &sensors,
            breathing,
            account,
            calibration: self.settings.calibration.as_deref(),
        };
        let advice = state.advice.of(&signs, now_ns);
        let (slices, pictures) = (state.slices, state.coupling.pictures());
        GuidanceStatus {
            spacing: self.settings.spacing,
            speed,
            holes,
            contact,
            sensors,
            breathing,
            advice,
            slices,
            pictures,
        }
    }

    /// Returns the outlines of the holes and the present slice.
    pub fn outlines(&self, now_ns: i64) -> Outlines {
        let state = self.lock();
        Outlines {
            present: state.present(now_ns).map(|plane| *plane.corners()),
            holes: state.holes.gaps().map(|gap| *gap.prism()).collect(),
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn present(&self, now_ns: i64) -> Option<SlicePlane> {
        let (plane, at_ns) = self.present.as_ref()?;
        (now_ns - at_ns < PRESENT_NS).then_some(*plane)
    }

    /// Sets the mask for images of a size.
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

impl Observer for ScanGuidance {
    fn cleared(&self) {
        let mut state = self.lock();
        (state.speed, state.holes) = (Speed::default(), Holes::new(self.settings.spacing));
        state.present = None;
    }

    fn captured(&self, glimpsed: &CapturedFrame<'_>) {
        let mut state = self.lock();
        let state = &mut *state;
        if !state.coupling.is_due(glimpsed.captured_ns) {
            return;
        }
        state.mask_of(&self.settings.mask, [glimpsed.image.width(), glimpsed.image.height()]);
        if let Some(mask) = &state.mask {
            state.coupling.inspect(glimpsed.image, mask, glimpsed.captured_ns);
        }
    }

    fn slice(&self, _world: &str, _item: u64, slice: &Slice) {
        let mut state = self.lock();
        let state = &mut *state;
        state.mask_of(&self.settings.mask, [slice.image.width(), slice.image.height()]);
        let Some(mask) = &state.mask else { return };
        let Some(plane) = SlicePlane::new(slice.world_from_image, mask) else { return };
        state.slices += 1;
        state.speed.add(&plane, slice.time_ns);
        state.holes.add(&plane, mask, slice.time_ns);
        state.present = Some((plane, slice.time_ns));
    }

    /// Follows the mask that was found, or that an operator chose.
    fn inserted(&self, inserted: &InsertedSlice<'_>) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        let mut state = self.lock();
        if state.mask.as_ref() != Some(inserted.mask) {
            state.mask = Some(inserted.mask.clone());
        }
        Ok(())
    }

    fn pose(&self, [from, _]: [&str; 2], sample: &PoseSample) {
        let mut state = self.lock();
        state.sensors.add(from, sample.time_ns, sample.invalid.as_deref());
        if from == REFERENCE && sample.invalid.is_none() {
            state.breathing.add(sample.time_ns, sample.pose.position_mm);
        }
    }
}
