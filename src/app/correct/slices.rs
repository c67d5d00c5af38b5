//! Slices of a session in memory, at the poses before a correction.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DAffine3, DQuat};

use calibration::slices::Slices;
use calibration::trajectory::PoseSample;
use calibration::trajectory::pose_spline::PoseSpline;
use config::bedside::{Bedside, SettingsOverride, probe_from_image};
use pipeline::session::RecordedDecisions;
use sonoweave_core::frames::affine_from_rows;
use sonoweave_core::slice::Pixels;

use super::note::Kind;
use super::poses::{IMAGE_TO_PROBE, Poses, transform};
use super::standing::Standing;
use crate::app::calibrate::recorded::data;
use crate::app::calibrate::slices::Varying;
use crate::app::live::stages::Kept;
use crate::app::replay::reel::{Reel, Still};
use crate::failure::Failure;

/// Most frames that are held in memory at once.
const MOST_FRAMES: usize = 4000;

/// A session's frames with a pose before a correction.
pub(super) struct Before {
    pub(super) bedside: Bedside,
    /// Settings and poses of the corrections before.
    pub(super) settings: SettingsOverride,
    pub(super) poses: Poses,
    /// From image to probe, of the last calibration.
    pub(super) probe_from_image: DAffine3,
    /// Each frame with its time, s, and its pose, pixels to world mm, ascending by time.
    pub(super) frames: Vec<(u64, f64, DAffine3)>,
}

/// Its slices, reduced, and the number of each one's frame.
pub(super) struct Read {
    pub(super) slices: Slices,
    pub(super) numbers: Vec<u64>,
    /// Width and height of a frame, pixels, and its first row with data.
    pub(super) size: [u32; 2],
    pub(super) top_row: u32,
}

impl Before {
    /// Reads the poses of a session before a correction of this kind.
    ///
    /// # Errors
    /// [`Failure`] when the session or its corrections cannot be read.
    pub(super) fn of(session: &Path, kind: Kind) -> Result<Self, Failure> {
        let decisions = RecordedDecisions::read(session)?;
        let (settings, poses) = Standing::of(session, &decisions)?.before(kind);
        Self::with(session, &decisions, settings, poses)
    }

    /// Uses known poses.
    ///
    /// # Errors
    /// [`Failure`] when the session cannot be read, or its image is not calibrated.
    pub(super) fn with(
        session: &Path,
        decisions: &RecordedDecisions,
        settings: SettingsOverride,
        poses: Poses,
    ) -> Result<Self, Failure> {
        let bedside = Kept::bedside(session, decisions)?;
        let corrected = settings.get(IMAGE_TO_PROBE).map(|rows| {
            let rows: [f64; 16] = serde_json::from_value(rows.clone())?;
            affine_from_rows(&rows).map_err(|why| Failure::new(format!("ImageToProbe {why}")))
        });
        let probe_from_image = match corrected.transpose()?.or_else(|| probe_from_image(&bedside.calibration)) {
            Some(probe_from_image) => probe_from_image,
            None => fail!("{}: the session has no ImageToProbe; record it with a calibration", session.display()),
        };
        let times_ns = decisions.placed_times_ns();
        let mut frames = Vec::with_capacity(poses.len());
        for (frame, rows) in &poses {
            let Some(time_ns) = times_ns.get(frame) else { continue };
            frames.push((*frame, *time_ns as f64 * 1e-9, transform(*frame, rows)?.affine()));
        }
        frames.sort_by(|a, b| a.1.total_cmp(&b.1));
        frames.dedup_by(|a, b| a.1 == b.1);
        Ok(Self { bedside, settings, poses, probe_from_image, frames })
    }

    /// Reads the images of all frames.
    ///
    /// # Errors
    /// As of [`Self::read`], and for more frames than fit in memory.
    pub(super) fn read_all(&self, session: &Path) -> Result<Read, Failure> {
        if self.frames.len() > MOST_FRAMES {
            fail!(
                "no correction: the session has {} frames with a pose, and {MOST_FRAMES} fit in memory; record shorter \
                 sessions",
                self.frames.len()
            );
        }
        self.read(session, MOST_FRAMES)
    }

    /// Reads the images of at most so many frames, evenly thinned.
    ///
    /// # Errors
    /// [`Failure`] when an image cannot be read, or has more than 8 bits.
    pub(super) fn read(&self, session: &Path, most: usize) -> Result<Read, Failure> {
        let unread = |why: String| Failure::new(format!("{}: {why}", session.display()));
        let mut reel = Reel::open(session)?;
        let every = self.frames.len().div_ceil(most).max(1);
        let used: BTreeMap<u64, f64> =
            self.frames.iter().step_by(every).map(|(frame, time_s, _)| (*frame, *time_s)).collect();
        let mut places = Vec::new();
        let mut varying: Option<Varying> = None;
        for place in 0..reel.count() {
            let Still { item, image, .. } = reel.still(place).map_err(unread)?;
            let Some(time_s) = used.get(&item).copied() else { continue };
            let Pixels::U8(pixels) = image.pixels() else {
                fail!("no correction: its images have more than 8 bits; record a session in 8 bits")
            };
            let size = [image.width(), image.height()];
            match &mut varying {
                None => varying = Some(Varying::new(pixels, size)),
                Some(varying) if varying.size() != size => {
                    fail!("no correction: its images have several sizes; record a session of one size")
                }
                Some(varying) => varying.add(pixels),
            }
            places.push((place, item, time_s));
        }
        let Some(varying) = varying else {
            fail!("{}: no frame has a pose; record another session", session.display())
        };
        let size = varying.size();
        let is_data = varying.is_data(data(&self.bedside.mask, size)?.as_ref());
        let image_from_probe = self.probe_from_image.inverse();
        let sample = |(_, time_s, world_from_image): &(u64, f64, DAffine3)| {
            let pose = *world_from_image * image_from_probe;
            let rotation = DQuat::from_mat3(&pose.matrix3).normalize();
            PoseSample { time_s: *time_s, rotation, position_mm: pose.translation }
        };
        let samples: Vec<PoseSample> = self.frames.iter().map(sample).collect();
        let poses = PoseSpline::new(&samples)?;
        let mut slices = Slices::new(size[0], size[1], &is_data, self.probe_from_image, poses);
        for (place, _, time_s) in &places {
            let Still { image, .. } = reel.still(*place).map_err(unread)?;
            if let Pixels::U8(pixels) = image.pixels() {
                slices.push(*time_s, pixels, size[0], size[1]);
            }
        }
        let first = is_data.iter().position(|is| *is).unwrap_or(0);
        let top_row = u32::try_from(first).unwrap_or(0) / size[0].max(1);
        Ok(Read { slices, numbers: places.into_iter().map(|(_, item, _)| item).collect(), size, top_row })
    }
}
