//! Cross-validation on recordings: each slice is predicted from the others, and compared with
//! its own data.

use std::error::Error;
use std::fs;
use std::path::Path as Folder;

use glam::DVec3;
use sonoweave_figures::files::field;
use sonoweave_figures::gaps::widest_gap;
use sonoweave_figures::{Figure, Panel};

use calibration::tracker::noise::TrackerNoise;
use mask::Mask;
use phantom::truth::covering_grid;
use reconstruct::kernel::Method;
use sonoweave_core::slice::{Pixels, Slice};
use volume::Grid;

use crate::baselines::Drop;
use crate::contestant::{Contestant, DEFAULT_VOXEL_MM, Input, Path, corrected, default_kernels, on_lattice};
use crate::figures::Figures;
use crate::loading;
use crate::pictures::{axis, by_family, range};
use crate::report::{Report, digits, markdown};
use crate::timing::quantile;

/// Name, sequence, and the configuration with its calibration; largest permitted RMSE, grey levels.
/// It is twice the measured one: 23 at most for the spine, 6.3 of the default for the N-wires. Most
/// of it are details that neighbouring slices do not show, so that contestants differ by a tenth.
const RECORDINGS: [([&str; 3], f64); 2] = [
    (
        [
            "Spine phantom, 21 frames",
            "freehand/SpinePhantomFreehand.igs.mha",
            "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml",
        ],
        46.0,
    ),
    (
        [
            "N-wire phantom, 97 frames",
            "freehand/NwirePhantomFreehand.igs.mha",
            "freehand/PlusDeviceSet_VolumeReconstructionOnly_SpinePhantom_NN_MEAN.xml",
        ],
        13.0,
    ),
];
/// One slice in so many is left out at a time.
const EVERY: usize = 4;
/// Spacing of the predicted pixels, along u and v.
const STRIDE: u32 = 5;
/// Margin around the slices, which contains every support, mm.
const MARGIN_MM: f64 = 12.0;

/// Squared errors of a prediction, one per pixel in the same order for all contestants; NaN if
/// nothing was predicted.
struct Predicted {
    contestant: Contestant,
    errors: Vec<f64>,
    ms: Vec<f64>,
}

fn contestants() -> Vec<Contestant> {
    let default = Contestant::default_configuration(false);
    let kernel = |method, across| Contestant::new(Path::Kernel(method, [None, across]), DEFAULT_VOXEL_MM);
    let mut list = vec![default];
    list.extend([0.1, 0.001].map(|energy| kernel(Method::default(), Some(energy))));
    list.extend(Method::ALL.map(|method| kernel(method, None)).into_iter().filter(|c| !c.same(&default)));
    list.extend(corrected().map(|path| Contestant::new(path, DEFAULT_VOXEL_MM)));
    list.extend([Drop::Nearest, Drop::Trilinear].map(|drop| Contestant::new(Path::Splat(drop), DEFAULT_VOXEL_MM)));
    list
}

/// Runs the cross-validation on the recordings that are present, and names those that are
/// missing.
///
/// # Errors
/// If a present recording cannot be read.
pub(crate) fn measure(
    project: &Folder,
    whole: bool,
    report: &mut Report,
    figures: &mut Figures,
    folder: &Folder,
) -> Result<(), Box<dyn Error>> {
    let data = loading::folder(project);
    let mut csv = String::from("recording,contestant,pixels,part_of_all,rmse,ms_median\n");
    let mut text = String::from("## Recordings: slices predicted from the others\n\n");
    let mut panels = Vec::new();
    for ([name, sequence, config], most) in &RECORDINGS[..if whole { 2 } else { 1 }] {
        let [sequence, config] = [sequence, config].map(|file| data.join(file));
        if let Some(absent) = [&sequence, &config].into_iter().find(|file| !file.is_file()) {
            let absent = absent.file_name().unwrap_or_default().display();
            text += &format!(
                "{name}: skipped, because {absent} is not in the folder of recordings (../shared/data, or the one that SONOWEAVE_TEST_DATA names).\n\n"
            );
            continue;
        }
        let (slices, mask) = loading::load(&sequence, &config)?;
        let widest = widest_gap(&slices)?;
        // Leaving a slice out doubles the gap; `--sigma auto` takes half of it.
        let predicted = predict(&slices, &mask, 2.0 * widest)?;
        let pixels = predicted.first().map_or(0, |p| p.errors.len());
        let common: Vec<usize> = (0..pixels).filter(|i| predicted.iter().all(|p| !p.errors[*i].is_nan())).collect();
        let part = common.len() as f64 / pixels as f64;
        report.findings.check(part > 0.5, format!("{name}: only {part} of the pixels are predicted by all"));
        let mut lines = Vec::new();
        let mut points = Vec::new();
        for p in &predicted {
            let own = p.errors.iter().filter(|e| !e.is_nan()).count() as f64 / pixels as f64;
            let rmse = (common.iter().map(|i| p.errors[*i]).sum::<f64>() / common.len() as f64).sqrt();
            // A NaN lies in no range.
            let what = format!("{name}, {}: RMSE {rmse}, of at most {most}", p.contestant.name());
            report.findings.check((0.0..=*most).contains(&rmse), what);
            let ms = quantile(&p.ms, 0.5);
            csv += &format!("{},{},{},{own},{rmse},{ms}\n", field(name), field(&p.contestant.name()), common.len());
            lines.push(vec![
                p.contestant.method(),
                digits(rmse, 4),
                format!("{} %", digits(100.0 * own, 3)),
                digits(ms, 3),
            ]);
            points.push((p.contestant, [ms, rmse]));
        }
        let least = |is: fn(&Contestant) -> bool| {
            points.iter().filter(|(c, _)| is(c)).map(|(_, [_, rmse])| *rmse).fold(f64::NAN, f64::min)
        };
        let short = name.split(' ').next().unwrap_or(name);
        figures.add(&format!("left out/{short}/default"), least(Contestant::is_default));
        figures.add(&format!("left out/{short}/baselines"), least(|c| matches!(c.path, Path::Splat(_))));
        text += &format!(
            "{name}: neighbouring slices {} mm apart (90 % of gaps are no wider); σ across the plane {} mm; {} pixels, {} % of those left out, predicted by all.\n\n{}\n",
            digits(widest, 3),
            digits(widest, 3),
            common.len(),
            digits(100.0 * part, 3),
            markdown(&["method", "RMSE, grey levels", "predicts", "ms a slice"], &lines)
        );
        let [x, y] = [0, 1].map(|c| range(points.iter().map(|(_, p)| p[c])));
        panels.push(Panel::new(
            *name,
            axis("ms a slice", x),
            axis("RMSE, grey levels", y),
            by_family(points.into_iter()),
        ));
    }
    text += "Every fourth slice is left out in turn but for the first and the last, all others are reconstructed, and the volume is read at its pixels. What a slice shows that its \
             neighbours do not is in every row alike; differences between rows are the methods'. Times are of one run.\n";
    report.section(text);
    // The figure writes its own numbers to left-out.csv.
    fs::write(folder.join("left-out-rmse.csv"), csv)?;
    if !panels.is_empty() {
        let figure = Figure {
            id: "left-out",
            title: "Recordings: slices predicted from the others".into(),
            caption: "Root mean square difference between the pixels of slices left out and the volume reconstructed from the others, over the pixels that all predict. \
                      Kernels have the default's effective width; what follows pixels, and the fourth order, have it across the plane only. The errors' axis does not begin at zero: what a slice \
                      shows that its neighbours do not is in all of them alike."
                .into(),
            columns: 2,
            height: 230.0,
            panels,
        };
        report.findings.figure(figure, folder)?;
    }
    Ok(())
}

/// Returns each contestant's prediction of the slices left out, with a gap of `gap_mm` around
/// each.
fn predict(slices: &[Slice], mask: &Mask, gap_mm: f64) -> Result<Vec<Predicted>, Box<dyn Error>> {
    let size = [mask.width(), mask.height()];
    let grid = |spacing: f64| -> Result<Grid, Box<dyn Error>> {
        let poses = slices.iter().map(|s| (s.world_from_image, size));
        Ok(on_lattice(covering_grid(poses, DVec3::splat(spacing), MARGIN_MM)?))
    };
    let axes = slices[0].world_from_image.affine().matrix3;
    let pixel_mm = [axes.x_axis.length(), axes.y_axis.length()];
    let sigma_n_mm = Some(0.5 * gap_mm);
    let effective_mm = default_kernels(pixel_mm, sigma_n_mm)?.map(|k| k.sigma_effective_mm());
    let mut all: Vec<Predicted> = contestants()
        .into_iter()
        .map(|contestant| Predicted { contestant, errors: Vec::new(), ms: Vec::new() })
        .collect();
    // Unknown, and no contestant uses it here.
    let noise = TrackerNoise { position_mm: 0.0, rotation_deg: 0.0 };
    for first in 0..EVERY {
        let is_out = |i: usize| i % EVERY == first && i > 0 && i + 1 < slices.len();
        let kept: Vec<Slice> =
            slices.iter().enumerate().filter(|(i, _)| !is_out(*i)).map(|(_, slice)| slice.clone()).collect();
        let input = Input { slices: &kept, mask, pixel_mm, effective_mm, sigma_n_mm, gap_mm, noise, grid: &grid };
        for predicted in &mut all {
            let (ms, reconstructed) = predicted.contestant.reconstruct(&input)?;
            predicted.ms.extend(ms);
            let field = reconstructed.field();
            for (_, slice) in slices.iter().enumerate().filter(|(i, _)| is_out(*i)) {
                let Pixels::U8(pixels) = slice.image.pixels() else {
                    return Err("slices are left out of recordings of 8 bits only".into());
                };
                for v in (0..size[1]).step_by(STRIDE as usize) {
                    for u in (0..size[0]).step_by(STRIDE as usize).filter(|u| mask.contains(*u, v)) {
                        let seen = f64::from(pixels[(v * size[0] + u) as usize]);
                        let place = slice.world_from_image.point(DVec3::new(f64::from(u), f64::from(v), 0.0));
                        predicted.errors.push(field.sample(place).map_or(f64::NAN, |value| (value - seen).powi(2)));
                    }
                }
            }
        }
    }
    Ok(all)
}
