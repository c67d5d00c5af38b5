//! The signal of figure 6 reconstructed from slices, by the reconstructor itself: the error that
//! uneven gaps leave, and corrections of it. Lengths are in mm, with a σ of 1 mm in the paper.

use std::error::Error;
use std::path::Path;
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use mask::Mask;
use reconstruct::kernel::{AxisKernel, Method, Support};
use reconstruct::{PathReconstructor, Settings};
use sonoweave_core::frames::Transform;
use sonoweave_core::slice::{Image, Pixels, Slice};
use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};
use volume::Voxels;

use crate::report::Report;
use crate::signal::{SHOWN, positions, signal};

/// Edge of a voxel and of a pixel, and pixels along each side of a slice.
const VOXEL: f64 = 0.25;
const PIXELS: u32 = 8;
/// Widths across the slices, in the paper's σ.
const WIDTHS: [f64; 5] = [0.5, 0.65, 0.8, 1.0, 1.3];
/// The paper's.
const PAPERS: usize = 3;
/// Largest part of the Gaussian's error that both corrections leave at the paper's width.
const MOST: f64 = 0.6;
const NAMES: [&str; 4] = ["the sums’ quotient", "first moment", "gap weights", "both"];
const STYLES: [(SeriesStyle, Ink); 4] = [
    (SeriesStyle::Dashed, Ink::Vermilion),
    (SeriesStyle::Dotted, Ink::Blue),
    (SeriesStyle::Dashed, Ink::Blue),
    (SeriesStyle::Line, Ink::Blue),
];

/// Returns a slice across the signal at a position: all its pixels have the signal's value.
fn slice(at: f64) -> Slice {
    let grey: Arc<[f32]> = std::iter::repeat_n(signal(at, 0.0) as f32, (PIXELS * PIXELS) as usize).collect();
    Slice {
        image: Image::new(PIXELS, PIXELS, Pixels::F32(grey)),
        time_ns: 0,
        world_from_image: Transform::from_affine(DAffine3 {
            matrix3: DMat3::from_cols(DVec3::Z * VOXEL, DVec3::Y * VOXEL, DVec3::NEG_X),
            translation: DVec3::new(at, 0.0, 0.0),
        }),
    }
}

/// Returns the mean squares of the errors against the blurred signal, in the order of [`NAMES`].
fn mean_squares(seed: u64, sigma: f64) -> Result<[f64; 4], Box<dyn Error>> {
    let at = positions(seed);
    let support = Support::Energy(0.01);
    let blur = AxisKernel::new(Method::Gaussian, sigma, support)?.sigma_effective_mm();
    let slices: Vec<Slice> = at.iter().map(|at| slice(*at)).collect();
    let [low, high] = [at[SHOWN.start], at[SHOWN.end - 1]].map(|x| (x / VOXEL) as i64);
    let middle = i64::from(PIXELS / 2);
    let mut found = Vec::new();
    for gap_weights in [false, true] {
        let settings = Settings {
            method: Method::Gaussian,
            sigma_mm: [Some(VOXEL), Some(VOXEL), Some(sigma)],
            support: [Some(support); 2],
            gap_weights,
            ..Settings::new(DVec3::splat(VOXEL))
        };
        let gaps = settings.weights_by_gaps();
        let poses = slices.iter().map(|slice| slice.world_from_image);
        let weights = gaps.map_or_else(|| vec![1.0; slices.len()], |gaps| gaps.of_sweep(poses, [PIXELS; 2]));
        let mut volume = PathReconstructor::general(settings, Mask::from_fn(PIXELS, PIXELS, |_, _| true))?;
        for (slice, weight) in slices.iter().zip(weights) {
            volume.insert_weighted(slice, weight)?;
        }
        let corrected = volume.first_moment().ok_or("nothing is corrected")?;
        for voxels in [volume.volume() as &dyn Voxels, &corrected] {
            let square = |x: i64| {
                let (sum, weight) = voxels.voxel([x, middle, middle]);
                (f64::from(sum / weight) - signal(x as f64 * VOXEL, blur)).powi(2)
            };
            found.push((low..=high).map(square).sum::<f64>() / (high - low + 1) as f64);
        }
    }
    Ok(found.try_into().map_err(|_| "four contestants")?)
}

/// Draws the errors over the kernel's width.
///
/// # Errors
/// If a slice is refused, or the figure cannot be written.
pub(crate) fn draw(report: &mut Report, folder: &Path, draws: u64) -> Result<(), Box<dyn Error>> {
    let mut errors = [const { Vec::new() }; 4];
    for sigma in WIDTHS {
        let all = (0..draws).map(|seed| mean_squares(seed, sigma)).collect::<Result<Vec<_>, _>>()?;
        for (contestant, errors) in errors.iter_mut().enumerate() {
            let sum: f64 = all.iter().map(|squares| squares[contestant]).sum();
            errors.push((sum / draws as f64).sqrt());
        }
    }
    let [papers, moment, weights, both] = [0, 1, 2, 3].map(|contestant| errors[contestant][PAPERS]);
    report.check(
        moment < papers && weights < papers && both < MOST * papers,
        format!("corrections of uneven gaps: {moment}, {weights}, {both} against {papers}"),
    );
    let series = errors.iter().zip(NAMES).zip(STYLES).map(|((errors, name), (style, ink))| {
        Series::new(name, style, ink, WIDTHS.iter().zip(errors).map(|(sigma, error)| [*sigma, *error]).collect())
    });
    let figure = Figure {
        id: "corrected-gaps",
        title: "Uneven gaps, and corrections of them".into(),
        caption: format!(
            "The signal of figure 6 is scanned by slices at its samples' positions, and reconstructed by the general path with the Gaussian less its pedestal. Errors \
             against the signal under the kernel's effective width, root mean squares over {draws} draws. At the paper's σ of 1, gap weights leave {:.2} of the \
             error, the first moment's correction {:.2}, and both {:.2}.",
            weights / papers,
            moment / papers,
            both / papers
        ),
        columns: 1,
        height: 260.0,
        panels: vec![Panel::new(
            "Error of the value",
            Axis::linear("σ of the kernel, in the paper's"),
            Axis::log("rms").from_to(0.005, 0.05),
            series.collect(),
        )],
    };
    report.figure(figure, folder)
}
