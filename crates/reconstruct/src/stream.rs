//! The stream of slices: decisions about a slice that depend on the slices before it.
//!
//! They are its admission, the kernels in force, its stamp and its time on the decay's clock. With
//! them, a slice can be inserted into any part of the volume by itself, in another process, too:
//! each brick gets the bits of an insertion into the whole.

use serde::{Deserialize, Serialize};

use mask::Mask;
use simd::sharing::Sharing;
use sonoweave_core::slice::Slice;

use super::admission::Admission;
use super::compounding::{Compounding, StampClock};
use super::decay::DecayClock;
use super::falloff::Falloff;
use super::filter::SliceFilter;
use super::kernel::AxisKernel;
use super::nodes::Nodes;
use super::refusal::{Refused, RepeatError};
use super::sampling::Sampling;
use super::settings::{Settings, SettingsError};
use super::shadow_weights::PictureWeights;
use super::slab::{MaskSummary, Plane, SlabGeometry};
use super::spline::Taps;
use super::task::{Rule, SliceTime};

/// Pixel sizes that differ by less than this, relatively, use the same filter.
pub(super) const SAME_PIXEL: f64 = 1e-3;

/// Decisions about a slice that depend on the slices before it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Decision {
    /// Pixel size along u and v that the kernels in force were made for, mm. The slice's own may
    /// differ by a thousandth.
    pub pixel_mm: [f64; 2],
    /// Fingerprint of these kernels, their filter and the mask, bit by bit. Another processor or C
    /// library may give others.
    pub kernels: u64,
    /// Stamp by which [`Compounding::Latest`] selects; 0 for other compoundings.
    pub stamp: u32,
    /// Time on the decay's clock, ns.
    pub elapsed_ns: i64,
    /// Weight of the whole slice, by the gaps beside it; 1 without [`Settings::gap_weights`].
    pub weight: f32,
}

/// A decided slice, before it has entered.
pub(super) struct Decided {
    pub(super) plane: Plane,
    pub(super) decision: Decision,
    clock: DecayClock,
}

/// Data that depends on the pixel size.
#[derive(Clone)]
pub(super) struct Prepared {
    pub(super) pixel_mm: [f64; 2],
    pub(super) kernels: [AxisKernel; 3],
    pub(super) filter: SliceFilter,
    pub(super) certainty: Nodes,
    /// Weights by shadows, if they count.
    pub(super) shadows: Option<PictureWeights>,
    pub(super) mask: MaskSummary,
    pub(super) rule: Rule,
    fingerprint: u64,
}

/// Takes the decisions, slice by slice.
#[derive(Clone)]
pub(super) struct Stream {
    pub(super) settings: Settings,
    pub(super) mask: Mask,
    pub(super) prepared: Option<Prepared>,
    admission: Admission,
    stamps: StampClock,
    pub(super) clock: DecayClock,
}

impl Stream {
    pub(super) fn new(settings: Settings, mask: Mask) -> Self {
        let (admission, stamps, clock) = (Admission::default(), StampClock::default(), DecayClock::default());
        Self { settings, mask, prepared: None, admission, stamps, clock }
    }

    /// Continues after the slices that another path has admitted.
    pub(super) fn after(self, admission: Admission, clock: DecayClock) -> Self {
        Self { admission, clock, ..self }
    }

    /// Changes the mask of later slices.
    ///
    /// # Errors
    /// [`SettingsError`] when the settings cannot work with this mask; nothing has changed then.
    pub(super) fn set_mask(&mut self, mask: Mask, sharing: Sharing) -> Result<(), SettingsError> {
        self.settings.check(&mask)?;
        let before = (std::mem::replace(&mut self.mask, mask), self.prepared.take());
        let Some(pixel_mm) = before.1.as_ref().map(|prepared| prepared.pixel_mm) else { return Ok(()) };
        let made = self.prepare(pixel_mm, sharing);
        if made.is_err() {
            (self.mask, self.prepared) = before;
        }
        made
    }

    /// Decides about a slice of this weight. It counts for later ones once it has
    /// [entered](Self::entered).
    ///
    /// # Errors
    /// [`Refused`] with the reason.
    pub(super) fn decide(&mut self, slice: &Slice, weight: f32, sharing: Sharing) -> Result<Decided, Refused> {
        let plane = self.admission.check(slice, &self.mask)?;
        let stamp = match self.settings.compounding {
            Compounding::Latest => self.stamps.stamp(slice.time_ns).ok_or(Refused::OutOfTime)?,
            _ => 0,
        };
        let clock = self.clock.after(slice.time_ns);
        let same = |p: &Prepared| (0..2).all(|a| (p.pixel_mm[a] / plane.pixel_mm[a] - 1.0).abs() <= SAME_PIXEL);
        if !self.prepared.as_ref().is_some_and(same) {
            self.prepare(plane.pixel_mm, sharing)?;
        }
        let Some(Prepared { pixel_mm, fingerprint, .. }) = self.prepared else {
            return Err(SettingsError::EmptyMask.into());
        };
        let elapsed_ns = clock.elapsed_ns();
        let decision = Decision { pixel_mm, kernels: fingerprint, stamp, elapsed_ns, weight };
        Ok(Decided { plane, decision, clock })
    }

    /// Repeats another stream's decision about a slice.
    ///
    /// # Errors
    /// [`RepeatError::OtherKernels`] if this machine makes other kernels, and reasons that depend
    /// on the slice alone.
    pub(super) fn repeat(
        &mut self,
        slice: &Slice,
        decision: &Decision,
        sharing: Sharing,
    ) -> Result<Plane, RepeatError> {
        let plane = Admission::default().check(slice, &self.mask)?;
        if self.prepared.as_ref().is_none_or(|prepared| prepared.pixel_mm != decision.pixel_mm) {
            self.prepare(decision.pixel_mm, sharing).map_err(Refused::from)?;
        }
        match &self.prepared {
            Some(prepared) if prepared.fingerprint == decision.kernels => Ok(plane),
            _ => Err(RepeatError::OtherKernels),
        }
    }

    /// Records that a slice has entered the volume.
    pub(super) fn entered(&mut self, slice: &Slice, decided: &Decided) {
        self.admission.entered(slice);
        self.stamps.start(slice.time_ns);
        self.clock = decided.clock;
    }

    /// Creates kernels and filter for a pixel size.
    fn prepare(&mut self, pixel_mm: [f64; 2], sharing: Sharing) -> Result<(), SettingsError> {
        let (settings, kernels) = (&self.settings, self.settings.kernels(pixel_mm)?);
        let method = settings.method;
        let design = |axis: usize, name: char| {
            if method.interpolates() {
                return Ok(Taps::identity());
            }
            Taps::design(&kernels[axis], pixel_mm[axis]).map_err(|source| SettingsError::Spline { axis: name, source })
        };
        let taps = [design(0, 'u')?, design(1, 'v')?];
        let rule = Rule {
            sampling: Sampling::of(method),
            falloff: Falloff::new(&kernels[2]),
            entry: settings.entry()?,
            most_weight: (settings.max_weight * kernels[2].peak()) as f32,
        };
        // Half a pixel to the border of the data, plus one σ: from 0.84 σ on, too little of the
        // kernel lies on data.
        let margin = [0, 1].map(|a| (kernels[a].sigma_mm / pixel_mm[a]).min(kernels[a].support_mm / pixel_mm[a]) + 0.5);
        let mut filter = SliceFilter::new(settings.simd, taps, self.mask.clone(), margin)?;
        let certainty = filter.certainty(sharing);
        let step_px = filter.step_px();
        let shadows = settings.shadow_weights.as_ref();
        let shadows = shadows.and_then(|s| PictureWeights::new(s, &self.mask, pixel_mm, &certainty, step_px));
        let mask = MaskSummary::new(&certainty);
        let fingerprint = fingerprint(&kernels, &filter, &certainty);
        self.prepared = Some(Prepared { pixel_mm, kernels, filter, certainty, shadows, mask, rule, fingerprint });
        Ok(())
    }
}

impl Prepared {
    /// Returns the slab of a slice, with voxel indices by `lattice`, which maps them to the world.
    pub(super) fn slab(&self, plane: &Plane, settings: &Settings) -> SlabGeometry {
        let normal = &self.kernels[2];
        let image_from_lattice = plane.image_from_world * settings.world_from_lattice();
        let step = self.filter.step_px();
        SlabGeometry::new(image_from_lattice, &self.certainty, step, normal.sigma_mm, normal.support_mm)
    }
}

impl Decision {
    /// Returns the slice's time, as insertion needs it.
    pub(super) fn time(&self) -> SliceTime {
        SliceTime { stamp: self.stamp, elapsed_ns: self.elapsed_ns }
    }
}

/// Returns a fingerprint of all numbers that insertion takes from the kernels: FNV-1a over their
/// bits, 64 at a time.
fn fingerprint(kernels: &[AxisKernel; 3], filter: &SliceFilter, certainty: &Nodes) -> u64 {
    let kernels = kernels.iter().flat_map(|k| [k.sigma_mm, k.support_mm, k.pedestal, k.peak()]).map(f64::to_bits);
    let numbers = filter.weights().chain(certainty.data.iter().copied()).map(|x| u64::from(x.to_bits()));
    kernels.chain(numbers).fold(0xCBF2_9CE4_8422_2325, |hash, bits| (hash ^ bits).wrapping_mul(0x0100_0000_01B3))
}
