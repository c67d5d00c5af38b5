//! The inserter: holds slices until their mask is known, and until the next slice gives them their
//! weight, if gaps count; then inserts each by the path that poses and mask allow.

use std::time::Instant;

use glam::DVec3;
use sha2::{Digest as _, Sha256};
use tracing::trace_span;

use mask::{AutoMask, Mask, MaskChange, MaskFound, MaskPlan, MaskSettings};
use reconstruct::path_choice::{Chosen, PathChoice};
use reconstruct::planar::PlanarSettings;
use reconstruct::settings::IN_PLANE_SIGMA;
use reconstruct::{GapWeights, Path, PathReconstructor, Refused, Settings, SettingsError};
use sonoweave_core::frames::{Image as ImageFrame, Transform, World};
use sonoweave_core::refusal::{Reason, Refusal};
use sonoweave_core::slice::{Pixels, Slice};
use sync::FramePose;
use sync::extent::{mean_axes, reached};

use super::observer::InsertedSlice;
use super::{PipelineError, PixelKind};
use crate::masking::{MaskOrigin, MaskRefusal};
use crate::trace::STAGE;

/// Memory limit of slices that wait for the mask; if frames are larger, fewer are analysed.
const MOST_WAITING_BYTES: usize = 64 << 20;

/// Off-plane σ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum OffPlane {
    /// The value of the settings.
    Settings,
    /// Half the 90th-percentile gap between neighbouring slices, from all poses of the
    /// recording.
    Auto,
}

/// Receives the outcome of each slice, in the order of the decisions.
pub(super) trait OutcomeSink {
    /// The slice was inserted.
    ///
    /// # Errors
    /// Any; it ends the run.
    fn inserted(&mut self, inserted: &InsertedSlice<'_>) -> Result<(), PipelineError>;

    /// The slice was refused; nothing has changed.
    fn refused(&mut self, refusal: &Refusal);

    /// The mask of later slices is known, or has changed.
    fn masked(&mut self, found: &MaskFound, origin: MaskOrigin);

    /// An operator's mask was not taken.
    fn mask_refused(&mut self, refusal: &MaskRefusal);
}

/// The mask stage: slices wait until the frame's data region is known.
enum MaskState {
    /// The frame's size is unknown too.
    Unknown(MaskSettings),
    Searching {
        search: AutoMask,
        waiting: Vec<(u64, Slice)>,
        bytes: usize,
    },
    Known(Box<PathReconstructor>),
}

/// Inputs of the reconstruction, except the mask.
pub(super) struct Plan {
    /// Whether the automatic mask knows only borders that are exactly zero, as in sessions of
    /// earlier versions.
    pub(super) zero_borders: bool,
    pub(super) choice: PathChoice,
    pub(super) settings: Settings,
    pub(super) planar: PlanarSettings,
    /// The path, if all poses are known beforehand or the path does not depend on them.
    pub(super) chosen: Option<Chosen>,
    /// Otherwise poses spread over those that may come; empty if any may come.
    pub(super) reach: Vec<Transform<World, ImageFrame>>,
    pub(super) off_plane: OffPlane,
    /// All poses that will come, if they are known beforehand.
    pub(super) poses: Vec<FramePose>,
}

impl Plan {
    /// Chooses the path once the mask is known.
    fn begin(&mut self, mask: &Mask, notes: &mut Vec<String>) -> Result<MaskState, SettingsError> {
        let mut chosen = match self.chosen.take() {
            Some(chosen) => chosen,
            None => Chosen::by_reach(&self.settings, &self.planar, [mask.width(), mask.height()], &self.reach),
        };
        let reconstructor = chosen.reconstructor(self.choice, &self.settings, &self.planar, mask)?;
        tracing::info!(path = reconstructor.path().name(), why = chosen.why, "insertion path");
        if self.choice == PathChoice::Auto && reconstructor.path() == Path::Planar {
            notes.push(format!(
                "the planar path inserts the slices, because {}: the volume's axes are the scan's, as its header says; \
                the general path would keep to the world's",
                chosen.why
            ));
        }
        if let Some(departure) = reconstructor.upgraded() {
            notes.push(format!("{departure}; the general path inserts all slices"));
        }
        self.chosen = Some(chosen);
        Ok(MaskState::Known(Box::new(reconstructor)))
    }
}

/// Inserts slices into the volume.
pub(super) struct VolumeInserter {
    plan: Plan,
    stage: MaskState,
    mask: Option<MaskFound>,
    /// Gap weights, if they count, and the slice that waits for its own.
    gaps: Option<GapWeights>,
    last: Option<(u64, Slice)>,
    used: u64,
    reached: Option<[[i64; 3]; 2]>,
    slice_axes: Option<[DVec3; 2]>,
    pixels: PixelKind,
    notes: Vec<String>,
    /// Over the slices in the volume.
    digest: Sha256,
}

/// Result of an inserter.
pub(super) struct FinishedVolume {
    pub(super) reconstructor: PathReconstructor,
    pub(super) mask: MaskFound,
    pub(super) chosen: Chosen,
    pub(super) reached: Option<[[i64; 3]; 2]>,
    pub(super) slice_axes: Option<[DVec3; 2]>,
    pub(super) pixels: PixelKind,
    pub(super) notes: Vec<String>,
    pub(super) slices_sha256: [u8; 32],
}

impl VolumeInserter {
    /// Returns an empty inserter; the first slice determines the frame's size.
    pub(super) fn new(plan: Plan, mask: MaskSettings) -> Self {
        Self {
            gaps: plan.settings.weights_by_gaps(),
            last: None,
            plan,
            stage: MaskState::Unknown(mask),
            mask: None,
            used: 0,
            reached: None,
            slice_axes: None,
            pixels: PixelKind::U8,
            notes: Vec::new(),
            digest: Sha256::new(),
        }
    }

    /// Inserts the next slice; `item` is its frame's number. The slice may wait for the mask, or
    /// for the next one; its outcome is then reported later.
    ///
    /// # Errors
    /// [`PipelineError`] if no further slice could be inserted either, or `outcomes` returns an
    /// error.
    pub(super) fn insert(
        &mut self,
        item: u64,
        slice: Slice,
        outcomes: &mut impl OutcomeSink,
    ) -> Result<(), PipelineError> {
        if let MaskState::Unknown(settings) = self.stage {
            let (width, height) = (slice.image.width(), slice.image.height());
            match settings.plan(width, height)? {
                MaskPlan::Fixed(mask) => {
                    self.known(&settings.known(mask), MaskOrigin::Configured, outcomes)?;
                }
                MaskPlan::Auto(search) => {
                    let zero = self.plan.zero_borders;
                    let search = if zero { AutoMask::of_zero_borders(width, height) } else { search };
                    self.stage = MaskState::Searching { search, waiting: Vec::new(), bytes: 0 };
                }
            }
        }
        let found = match &mut self.stage {
            MaskState::Unknown(_) => None,
            MaskState::Known(_) => return self.weigh(item, slice, outcomes),
            MaskState::Searching { search, waiting, bytes } => {
                let found = search.push(&slice.image);
                *bytes += slice.image.pixels().bytes();
                waiting.push((item, slice));
                found.or_else(|| (*bytes > MOST_WAITING_BYTES).then(|| search.finish()))
            }
        };
        found.map_or(Ok(()), |found| self.found(&found, outcomes))
    }

    /// Inserts the slices that waited for the mask, once it is found.
    fn found(&mut self, found: &MaskFound, outcomes: &mut impl OutcomeSink) -> Result<(), PipelineError> {
        self.notes.extend(found.notes());
        if let MaskState::Searching { waiting, .. } = self.known(found, MaskOrigin::Found, outcomes)? {
            for (item, slice) in waiting {
                self.weigh(item, slice, outcomes)?;
            }
        }
        Ok(())
    }

    /// Begins the volume with a mask; returns the stage before.
    fn known(
        &mut self,
        found: &MaskFound,
        origin: MaskOrigin,
        outcomes: &mut impl OutcomeSink,
    ) -> Result<MaskState, PipelineError> {
        let known = self.plan.begin(&found.mask, &mut self.notes)?;
        self.mask = Some(found.clone());
        outcomes.masked(found, origin);
        Ok(std::mem::replace(&mut self.stage, known))
    }

    /// Changes the mask of later slices, as an operator orders; slices that wait are inserted
    /// before. A mask that cannot be taken leaves the present one.
    ///
    /// # Errors
    /// Same as [`Self::insert`].
    pub(super) fn change_mask(
        &mut self,
        change: &MaskChange,
        outcomes: &mut impl OutcomeSink,
    ) -> Result<(), PipelineError> {
        self.end(outcomes)?;
        let (MaskState::Known(reconstructor), Some(present)) = (&mut self.stage, &mut self.mask) else {
            outcomes.mask_refused(&MaskRefusal::Undecided);
            return Ok(());
        };
        let mask = match change.mask([present.mask.width(), present.mask.height()]) {
            Ok(mask) => mask,
            Err(error) => {
                outcomes.mask_refused(&error.into());
                return Ok(());
            }
        };
        let (changed, origin) = match mask.zip(change.shape()) {
            None => {
                let confirmed = MaskFound { recognised: true, confidence: 1.0, reasons: Vec::new(), ..present.clone() };
                (confirmed, MaskOrigin::Confirmed)
            }
            Some((mask, shape)) => (MaskFound::certain(mask, shape), MaskOrigin::Operator),
        };
        if changed.mask != present.mask && !reconstructor.set_mask((*changed.mask).clone())? {
            outcomes.mask_refused(&MaskRefusal::Planar);
            return Ok(());
        }
        outcomes.masked(&changed, origin);
        *present = changed;
        Ok(())
    }

    /// Inserts a slice, or the one before it, whose weight is then known.
    fn weigh(&mut self, item: u64, slice: Slice, outcomes: &mut impl OutcomeSink) -> Result<(), PipelineError> {
        let Some(gaps) = &mut self.gaps else { return self.insert_now(item, &slice, 1.0, outcomes) };
        let weight = gaps.next(slice.world_from_image, [slice.image.width(), slice.image.height()]);
        let before = self.last.replace((item, slice));
        self.insert_before(before.zip(weight), outcomes)
    }

    fn insert_before(
        &mut self,
        before: Option<((u64, Slice), f32)>,
        outcomes: &mut impl OutcomeSink,
    ) -> Result<(), PipelineError> {
        before.map_or(Ok(()), |((item, slice), weight)| self.insert_now(item, &slice, weight, outcomes))
    }

    fn insert_now(
        &mut self,
        item: u64,
        slice: &Slice,
        weight: f32,
        outcomes: &mut impl OutcomeSink,
    ) -> Result<(), PipelineError> {
        let MaskState::Known(reconstructor) = &mut self.stage else { return Ok(()) };
        let (began, before) = (Instant::now(), reconstructor.path());
        let span = trace_span!(target: STAGE, "insert", frame = item);
        let result = span.in_scope(|| reconstructor.insert_weighted(slice, weight));
        let took = began.elapsed();
        if reconstructor.path() != before
            && let Some(departure) = reconstructor.upgraded()
        {
            tracing::warn!(item, %departure, "the general path takes over");
            self.notes.push(format!(
                "frame {item}: {departure}; the general path has taken over from there, on the same lattice"
            ));
        }
        let reason = match result {
            Ok(touched) => {
                // The lattice and the kernels are known from the first slice on.
                if let (None, Some(kernels), Some(data)) =
                    (self.reached, reconstructor.kernels(), self.mask.as_ref().and_then(|found| found.mask.bounds()))
                {
                    let supports_mm = kernels.each_ref().map(|k| k.support_mm);
                    self.reached = reached(&self.plan.poses, data, supports_mm, reconstructor.world_from_lattice());
                    self.slice_axes = mean_axes(&self.plan.poses);
                }
                self.used += 1;
                digest(&mut self.digest, item, slice);
                self.pixels = match slice.image.pixels() {
                    Pixels::U8(_) => PixelKind::U8,
                    Pixels::U16(_) => PixelKind::U16,
                    Pixels::F32(_) => PixelKind::F32,
                };
                let Some(MaskFound { mask, .. }) = &self.mask else { return Ok(()) };
                return outcomes.inserted(&InsertedSlice {
                    item,
                    slice,
                    mask,
                    reconstructor,
                    path_reason: self.plan.chosen.as_ref().map_or("", |chosen| &chosen.why),
                    touched: &touched.bricks,
                    slab: touched.slab,
                    upgraded: reconstructor.path() != before,
                    insert: took,
                    reached: self.reached,
                    slice_axes: self.slice_axes,
                    pixels: self.pixels,
                });
            }
            Err(source @ Refused::Memory { .. }) => return Err(PipelineError::Memory { item, source }),
            // Before the first slice the settings are at fault, later the pose.
            Err(Refused::Settings(error)) if self.used == 0 => return Err(error.into()),
            Err(Refused::Settings(error)) => (Reason::PixelSize, error.to_string()),
            Err(e @ Refused::Repeated) => (Reason::Repeated, e.to_string()),
            Err(e @ Refused::Size { .. }) => (Reason::SizeChanged, e.to_string()),
            Err(e @ Refused::Degenerate) => (Reason::PoseSingular, e.to_string()),
            Err(e @ Refused::OutOfTime) => (Reason::OutOfTime, e.to_string()),
            Err(e @ Refused::OutOfRange) => (Reason::OutOfRange, e.to_string()),
            Err(e @ Refused::Departure(_)) => (Reason::OutOfPlane, e.to_string()),
        };
        outcomes.refused(&Refusal::new(item, reason.0, reason.1));
        Ok(())
    }

    /// Discards the volume; later slices go into an empty one with the same settings. Slices
    /// that wait for the mask are inserted before; the mask stays.
    ///
    /// # Errors
    /// Same as [`Self::insert`].
    pub(super) fn clear(&mut self, outcomes: &mut impl OutcomeSink) -> Result<(), PipelineError> {
        self.end(outcomes)?;
        if let Some(MaskFound { mask, .. }) = &self.mask {
            // The notes were made when the mask was found.
            self.stage = self.plan.begin(mask, &mut Vec::new())?;
        }
        (self.used, self.reached, self.slice_axes) = (0, None, None);
        self.digest = Sha256::new();
        Ok(())
    }

    /// Returns the present volume; `None` while slices wait for the mask.
    pub(super) fn reconstructor(&self) -> Option<&PathReconstructor> {
        match &self.stage {
            MaskState::Known(reconstructor) => Some(reconstructor),
            MaskState::Searching { .. } | MaskState::Unknown(_) => None,
        }
    }

    /// Ends the input: slices that wait for the mask, or for the next one, are inserted.
    ///
    /// # Errors
    /// Same as [`Self::insert`].
    pub(super) fn end(&mut self, outcomes: &mut impl OutcomeSink) -> Result<(), PipelineError> {
        let found = match &mut self.stage {
            MaskState::Searching { search, .. } => Some(search.finish()),
            MaskState::Known(_) | MaskState::Unknown(_) => None,
        };
        if let Some(found) = found {
            self.found(&found, outcomes)?;
        }
        let weight = self.gaps.as_mut().and_then(GapWeights::end);
        let before = self.last.take();
        self.insert_before(before.zip(weight), outcomes)
    }

    /// Notes that slices follow whose poses were not known: the box that slices reach is unknown
    /// from now on.
    pub(super) fn extended(&mut self) {
        self.plan.poses.clear();
        self.reached = None;
    }

    /// Returns the present result, without slices that wait. `None` if no slice was
    /// inserted.
    ///
    /// # Errors
    /// When the system has no memory for a copy of the volume.
    pub(super) fn snapshot(&self) -> std::io::Result<Option<FinishedVolume>> {
        let (MaskState::Known(reconstructor), Some(mask), Some(chosen)) = (&self.stage, &self.mask, &self.plan.chosen)
        else {
            return Ok(None);
        };
        if self.used == 0 {
            return Ok(None);
        }
        Ok(Some(FinishedVolume {
            reconstructor: reconstructor.copy()?,
            mask: mask.clone(),
            chosen: chosen.clone(),
            reached: self.reached,
            slice_axes: self.slice_axes,
            pixels: self.pixels,
            notes: self.notes.iter().cloned().chain(narrow(reconstructor, self.plan.off_plane)).collect(),
            slices_sha256: self.digest.clone().finalize().into(),
        }))
    }

    /// Returns the result, after its [end](Self::end). `None` if no slice was inserted.
    pub(super) fn finish(mut self) -> Option<FinishedVolume> {
        let (MaskState::Known(reconstructor), Some(mask)) = (self.stage, self.mask) else { return None };
        if self.used == 0 {
            return None;
        }
        self.notes.extend(narrow(&reconstructor, self.plan.off_plane));
        Some(FinishedVolume {
            reconstructor: *reconstructor,
            mask,
            chosen: self.plan.chosen?,
            reached: self.reached,
            slice_axes: self.slice_axes,
            pixels: self.pixels,
            notes: self.notes,
            slices_sha256: self.digest.finalize().into(),
        })
    }
}

/// Adds a slice to a digest: its frame's number, its time and its pose.
fn digest(digest: &mut Sha256, item: u64, slice: &Slice) {
    digest.update(item.to_le_bytes());
    digest.update(slice.time_ns.to_le_bytes());
    for number in slice.world_from_image.affine().to_cols_array() {
        digest.update(number.to_le_bytes());
    }
}

/// Returns a note about kernels narrower than the lattice can represent: the axes, and the
/// remedy. A σ across the plane that was derived from the slices' own gaps is wide enough, as is
/// one that reaches half a voxel whatever its σ. Methods that interpolate between pixels have no
/// other width in the plane.
fn narrow(reconstructor: &PathReconstructor, off_plane: OffPlane) -> Option<String> {
    let settings = reconstructor.settings();
    let spacing = settings.spacing_mm.max_element();
    // The default in the plane is this very σ; rounding must not make it narrow.
    let least = IN_PLANE_SIGMA * spacing * (1.0 - 1e-9);
    let in_plane = !settings.method.interpolates();
    let across = off_plane == OffPlane::Settings && !settings.compounding.selects();
    let axes = [("u", in_plane), ("v", in_plane), ("the normal", across)];
    let narrow: Vec<String> = axes
        .iter()
        .zip(reconstructor.kernels()?)
        .filter(|((_, counts), kernel)| *counts && kernel.sigma_mm < least)
        .map(|((axis, _), kernel)| format!("{:.3} mm along {axis}", kernel.sigma_mm))
        .collect();
    (!narrow.is_empty()).then(|| {
        format!(
            "the kernel's σ is below {IN_PLANE_SIGMA} voxel ({}, voxels of {spacing} mm): what lies between voxels is lost, and slices \
             far apart leave holes; choose a finer spacing or a larger σ",
            narrow.join(", ")
        )
    })
}
