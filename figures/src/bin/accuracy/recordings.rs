//! Errors of kernels on recordings: slices are predicted from the others.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use serde_json::{Map, Value};

use mask::Mask;
use reconstruct::kernel::Method;
use reconstruct::{PathReconstructor, Settings};
use render::section::{Box3, Planar, Sampled, Section};
use sonoweave_core::slice::{Pixels, Slice};
use sonoweave_figures::gaps::widest_gap;
use sonoweave_figures::{Axis, Figure, Panel};
use volume::Voxels;

use crate::kernels::{ALL, ByWidth, KERNELS, Least, drawn, inserted, rows};
use crate::loading;
use crate::report::{Report, markdown};

/// Name and sequence of a recording, and the largest part of the best Gaussian's error that the
/// corrected fourth order may have. On recordings little is gained: most of the error are details
/// that neighbouring slices do not show.
const RECORDINGS: [(&str, &str, f64); 2] = [
    ("spine phantom", "freehand/SpinePhantomFreehand.igs.mha", 1.0),
    ("N-wire phantom", "freehand/NwirePhantomFreehand.igs.mha", 0.995),
];
const CONFIGURATION: &str = "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml";
const SPACING_MM: f64 = 0.4;
/// Widths along u and v, mm; across the plane as a part of the gap beside a slice left out.
const IN_PLANE_MM: [f64; 4] = [0.15, 0.25, 0.4, 0.5];
const ACROSS: [f64; 2] = [0.3, 0.45];
/// One slice in so many is left out at a time.
const EVERY: usize = 4;
/// Spacing of the predicted pixels, along u and v.
const STRIDE: u32 = 5;

/// A recording.
struct Recording {
    slices: Vec<Slice>,
    mask: Mask,
    gap_mm: f64,
}

impl Recording {
    fn read(sequence: &Path, configuration: &Path) -> Result<Self, Box<dyn Error>> {
        let (slices, mask) = loading::load(sequence, configuration)?;
        // A slice left out doubles the gap.
        let gap_mm = 2.0 * widest_gap(&slices)?;
        Ok(Self { slices, mask, gap_mm })
    }

    /// Returns the squared errors of the predicted pixels with a kernel, and with the first moment
    /// corrected, too; NaN where nothing is predicted.
    fn predicted(
        &self,
        (method, gap_weights): (Method, bool),
        [plane, across]: [f64; 2],
    ) -> Result<[Vec<f32>; 2], Box<dyn Error>> {
        let mut errors = [Vec::new(), Vec::new()];
        for first in 0..EVERY {
            let is_out = |i: usize| i % EVERY == first && i > 0 && i + 1 < self.slices.len();
            let sigma_mm = [Some(plane), Some(plane), Some(across * self.gap_mm)];
            let usual = Settings { threads: 2, ..Settings::new(DVec3::splat(SPACING_MM)) };
            let settings = Settings { method, sigma_mm, gap_weights, ..usual };
            let kept = self.slices.iter().enumerate().filter(|(i, _)| !is_out(*i));
            let volume = inserted(settings, &self.mask, &kept.map(|(_, slice)| slice).collect::<Vec<_>>())?;
            let corrected = volume.first_moment().ok_or("nothing is corrected")?;
            for (_, slice) in self.slices.iter().enumerate().filter(|(i, _)| is_out(*i)) {
                errors[0].extend(self.compared(slice, volume.volume(), &volume)?);
                errors[1].extend(self.compared(slice, &corrected, &volume)?);
            }
        }
        Ok(errors)
    }

    /// Returns the squared errors of a volume at a slice's pixels.
    fn compared(
        &self,
        slice: &Slice,
        volume: &dyn Voxels,
        reconstructor: &PathReconstructor,
    ) -> Result<Vec<f32>, Box<dyn Error>> {
        let Pixels::U8(pixels) = slice.image.pixels() else {
            return Err("slices are left out of recordings of 8 bits only".into());
        };
        let (width, height) = (self.mask.width(), self.mask.height());
        let step = |axis: DVec3| slice.world_from_image.vector(axis) * f64::from(STRIDE);
        let section = Section {
            first: slice.world_from_image.point(DVec3::ZERO),
            right: step(DVec3::X),
            down: step(DVec3::Y),
            size: [width.div_ceil(STRIDE), height.div_ceil(STRIDE)],
        };
        let (low, high) = volume.seen_bounds().ok_or("no voxel is seen")?;
        let place = Box3::new(reconstructor.world_from_lattice(), [low, high]);
        let (sampled, _) = Planar { volume, place, team: None }.sample(&section);
        let places = (0..section.size[1]).flat_map(|j| (0..section.size[0]).map(move |i| [i * STRIDE, j * STRIDE]));
        let inside = places.zip(sampled).filter(|([u, v], _)| self.mask.contains(*u, *v));
        let error = |([u, v], Sampled { value, share, .. }): ([u32; 2], Sampled)| {
            let seen = f32::from(pixels[(v * width + u) as usize]);
            if share > 0.0 { (value - seen).powi(2) } else { f32::NAN }
        };
        Ok(inside.map(error).collect())
    }

    /// Returns the errors of each contestant by the width in the plane, over the pixels that all
    /// predict, and the share of these.
    fn errors(&self) -> Result<(ByWidth, f64), Box<dyn Error>> {
        let mut all = Vec::new();
        for (number, kernel) in KERNELS.into_iter().enumerate() {
            for plane in IN_PLANE_MM {
                for across in ACROSS {
                    let both = self.predicted(kernel, [plane, across])?;
                    all.extend((2 * number..).zip(both).map(|(of, errors)| (of, [plane, across], errors)));
                }
            }
        }
        let pixels = all.first().map_or(0, |(.., errors)| errors.len());
        let common: Vec<usize> = (0..pixels).filter(|i| all.iter().all(|(.., errors)| !errors[*i].is_nan())).collect();
        let mut least = [const { Vec::<Least>::new() }; ALL];
        for (of, [plane, across], errors) in &all {
            let sum = common.iter().map(|i| f64::from(errors[*i])).sum::<f64>();
            let (rmse, across) = ((sum / common.len() as f64).sqrt(), across * self.gap_mm);
            match least[*of].iter_mut().find(|least| least.plane == *plane) {
                Some(least) if least.rmse <= rmse => {}
                Some(least) => (least.across, least.rmse) = (across, rmse),
                None => least[*of].push(Least { plane: *plane, across, rmse }),
            }
        }
        Ok((least, common.len() as f64 / pixels as f64))
    }
}

/// Compares the kernels on the recordings that are present, and names those that are missing.
///
/// # Errors
/// If a present recording cannot be read, or a file cannot be written.
pub(crate) fn compare(
    project: &Path,
    is_whole: bool,
    report: &mut Report,
    figures: &mut Map<String, Value>,
    folder: &Path,
) -> Result<(), Box<dyn Error>> {
    let data = loading::folder(project);
    let (mut lines, mut panels, mut text) = (Vec::new(), Vec::new(), String::new());
    for (name, sequence, most) in &RECORDINGS[..if is_whole { 2 } else { 1 }] {
        let [sequence, configuration] = [sequence, CONFIGURATION].map(|file| data.join(file));
        if let Some(absent) = [&sequence, &configuration].into_iter().find(|file| !file.is_file()) {
            let absent = absent.file_name().unwrap_or_default().display();
            text += &format!("{name}: skipped, because {absent} is not in the folder of recordings.\n\n");
            continue;
        }
        let (errors, share) = Recording::read(&sequence, &configuration)?.errors()?;
        report.findings.check(share > 0.5, format!("{name}: only {share} of the pixels are predicted by all"));
        let best = |of: &Vec<Least>| of.iter().copied().min_by(|a, b| a.rmse.total_cmp(&b.rmse)).ok_or("no width");
        let best = errors.iter().map(best).collect::<Result<Vec<_>, _>>()?;
        let ratio = best[ALL - 1].rmse / best[0].rmse;
        report.findings.check(ratio <= *most, format!("{name}: {ratio:.3} of the Gaussian's error, more than {most}"));
        lines.extend(rows(name, &best, &format!("recordings/{name}"), figures));
        let (x, y) = (Axis::linear("σ in the plane, mm"), Axis::linear("error, grey levels"));
        panels.push(Panel::new(*name, x, y, drawn(&errors)));
    }
    let columns = ["recording", "kernel", "σ in the plane, mm", "across", "RMSE, grey levels", "× of the Gaussian"];
    report.section(format!(
        "# Recordings\n\nEvery fourth slice is left out in turn but for the first and the last, and predicted from \
         the others, over the pixels that all predict. The best width of each kernel.\n\n{text}{}",
        markdown(&columns, &lines)
    ));
    if panels.is_empty() {
        return Ok(());
    }
    report.findings.figure(
        Figure {
            id: "recordings",
            title: "Recordings: slices predicted from the others".into(),
            caption: "At each width in the plane, the best one across it; both: gap weights and first moment. The \
                      errors' axis does not begin at zero: what a slice shows that its neighbours do not is in all of them alike."
                .into(),
            columns: 2,
            height: 230.0,
            panels,
        },
        folder,
    )
}
