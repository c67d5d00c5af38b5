//! The paper's claims about volumes, tested on the reconstructor itself against the equations in
//! f64.

use std::error::Error;

use glam::DVec3;
use sonoweave_figures::order;

use mask::Mask;
use phantom::scan::Depth;
use phantom::scene::{Blob, Blobs};
use phantom::{Motion, Scan, ScanSettings, Scene};
use reconstruct::kernel::{Method, Support};
use reconstruct::reference::Reference;
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::slice::Slice;
use volume::Voxels;
use volume::brick_volume::SEEN;

use crate::report::Report;

/// Returns a voxel's value; `None` if unseen.
pub(crate) fn value(volume: &dyn Voxels, voxel: [i64; 3]) -> Option<f64> {
    let (r, w) = volume.voxel(voxel);
    (w > SEEN).then(|| f64::from(r) / f64::from(w))
}

fn reconstructed<'a>(
    settings: &Settings,
    mask: &Mask,
    slices: impl Iterator<Item = &'a Slice>,
) -> Result<Reconstructor, Box<dyn Error>> {
    let mut reconstructor = Reconstructor::new(settings.clone(), mask.clone())?;
    for slice in slices {
        reconstructor.insert(slice)?;
    }
    Ok(reconstructor)
}

/// C1: sums, their quotient, and independence of the order of slices.
pub(crate) fn sums(report: &mut Report) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        frames: 16,
        gap_mm: 0.6,
        image_size: [80, 64],
        pixel_mm: [0.4; 2],
        ..ScanSettings::default()
    })?;
    let slices = scan.slices(0..scan.frames());
    let settings = Settings::new(DVec3::splat(0.6));
    let forward = reconstructed(&settings, scan.mask(), slices.iter())?;
    let backward = reconstructed(&settings, scan.mask(), slices.iter().rev())?;
    let kernels = forward.kernels().ok_or("nothing was inserted")?;
    let (_, promised) = forward.decimation().ok_or("nothing was inserted")?;
    let grid = scan.grid(settings.spacing_mm, 2.0)?;
    let mut reference = Reference::new(grid);
    slices.iter().for_each(|slice| reference.insert(slice, scan.mask(), kernels));
    let first = (grid.origin / grid.spacing).round().to_array().map(|x| x as i64);
    let [nx, ny, _] = grid.size.map(|n| n as usize);
    let (mut squares, mut worst, mut count, mut reordered) = (0.0, 0.0_f64, 0_u32, 0.0_f64);
    for i in 0..reference.w.len() {
        let at = [i % nx, i / nx % ny, i / (nx * ny)];
        let voxel = [0, 1, 2].map(|a| first[a] + at[a] as i64);
        let ((r, w), (r2, w2)) = (forward.volume().voxel(voxel), backward.volume().voxel(voxel));
        // Less weight lies at an end of the support, where a rounding error decides whether it
        // is seen.
        let Some(expected) = reference.value(i).filter(|_| w > 0.05 && reference.w[i] > 0.05) else { continue };
        let error = (f64::from(r) / f64::from(w) - expected).abs();
        squares += error * error;
        worst = worst.max(error);
        count += 1;
        reordered = reordered.max(f64::from(r2 / r - 1.0).abs()).max(f64::from(w2 / w - 1.0).abs());
    }
    let rms = (squares / f64::from(count)).sqrt();
    // The in-plane filter's guaranteed bound, of 8 bits; its root mean square is far below.
    let bound = 0.1 * promised * 255.0;
    let rounding = 4.0 * f64::from(scan.frames()) * 2.0_f64.powi(-24);
    report.check(count > 10_000, format!("C1: only {count} voxels compared"));
    report.check(rms <= bound, format!("C1: {rms} grey levels rms from the equations, more than {bound}"));
    report.check(
        reordered <= rounding,
        format!("C1: the order of slices changes sums by a part of {reordered}, more than {rounding}"),
    );
    report.claim(
        ["C1", "r and w gather Σ o·f and Σ f; i = r/w", "formulae"],
        format!(
            "{count} voxels against all samples in f64: rms {rms:.4}, largest {worst:.3} of 255 grey levels; reversed order changes sums by a part of {} \
             at most",
            order(reordered)
        ),
        rms <= bound && reordered <= rounding,
        ["holds", "does not hold"],
    );
    Ok(())
}

/// C3: a σ for each axis of the image.
pub(crate) fn widths(report: &mut Report) -> Result<(), Box<dyn Error>> {
    const BLOB: f64 = 2.0;
    let blob = Blob { centre: DVec3::ZERO, sigma: BLOB, amplitude: 200.0 };
    let scan = Scan::new(ScanSettings {
        scene: Scene::Blobs(Blobs { background: 0.0, blobs: vec![blob], sphere: None }),
        motion: Motion::Parallel,
        frames: 61,
        gap_mm: 0.4,
        image_size: [97, 97],
        pixel_mm: [0.25; 2],
        noise_sd: 0.0,
        depth: Depth::F32,
        ..ScanSettings::default()
    })?;
    let slices = scan.slices(0..scan.frames());
    let settings = Settings { sigma_mm: [Some(0.5), Some(0.8), Some(1.1)], ..Settings::new(DVec3::splat(0.5)) };
    let volume = reconstructed(&settings, scan.mask(), slices.iter())?;
    let kernels = volume.kernels().ok_or("nothing was inserted")?;
    let (mut mass, mut moments) = (0.0, DVec3::ZERO);
    let places = || -22..=22_i64;
    for (x, y) in places().flat_map(|x| places().map(move |y| (x, y))) {
        for z in places() {
            if let Some(value) = value(volume.volume(), [x, y, z]) {
                let at = DVec3::new(x as f64, y as f64, z as f64) * settings.spacing_mm;
                mass += value;
                moments += value * at * at;
            }
        }
    }
    let found = (moments / mass - DVec3::splat(BLOB * BLOB)).to_array().map(f64::sqrt);
    let expected = kernels.map(|k| k.sigma_effective_mm());
    let off = found.iter().zip(expected).map(|(f, e)| (f / e - 1.0).abs()).fold(0.0, f64::max);
    report.check(off < 0.02, format!("C3: widths {found:?} where {expected:?} are expected"));
    report.claim(
        ["C3", "a σ of its own for each of u, v, n", "“width of the PSF in each of (u,v,n) axes separately”"],
        format!(
            "a blob of σ {BLOB} mm widened by {:.3}, {:.3}, {:.3} mm along u, v, n; effective widths set: {:.3}, {:.3}, {:.3}",
            found[0], found[1], found[2], expected[0], expected[1], expected[2]
        ),
        off < 0.02,
        ["holds", "does not hold"],
    );
    Ok(())
}

/// C19: the voxels that a single oblique slice reaches.
pub(crate) fn slab(report: &mut Report) -> Result<(), Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        motion: Motion::Fan { axis_distance_mm: 30.0 },
        frames: 3,
        gap_mm: 15.0,
        image_size: [100, 90],
        pixel_mm: [0.3; 2],
        ..ScanSettings::default()
    })?;
    let slice = scan.slice(0);
    let settings = Settings {
        method: Method::GaussianTruncated,
        sigma_mm: [None, None, Some(1.0)],
        ..Settings::new(DVec3::splat(0.5))
    };
    let reconstructor = reconstructed(&settings, scan.mask(), std::iter::once(&slice))?;
    let kernels = reconstructor.kernels().ok_or("nothing was inserted")?;
    let d = kernels[2].support_mm;
    let affine = slice.world_from_image.affine();
    let normal = affine.matrix3.x_axis.cross(affine.matrix3.y_axis).normalize();
    let image_from_world = slice.world_from_image.inverse();
    // Tolerance for rounding, mm.
    const SLACK: f64 = 1e-4;
    let (low, high) = reconstructor.volume().seen_bounds().ok_or("nothing was seen")?;
    let (mut inside, mut missing, mut beyond, mut thickest) = (0_u32, 0_u32, 0_u32, 0.0_f64);
    for (x, y) in (low[0] - 8..=high[0] + 8).flat_map(|x| (low[1] - 8..=high[1] + 8).map(move |y| (x, y))) {
        for z in low[2] - 8..=high[2] + 8 {
            let world = DVec3::new(x as f64, y as f64, z as f64) * settings.spacing_mm;
            let distance = (world - affine.translation).dot(normal).abs();
            let pixel = image_from_world.point(world - normal * (world - affine.translation).dot(normal));
            let seen = reconstructor.volume().voxel([x, y, z]).1 > 0.0;
            let within = (0.0..=99.0).contains(&pixel.x) && (0.0..=89.0).contains(&pixel.y);
            if seen {
                thickest = thickest.max(distance);
                beyond += u32::from(distance > d + SLACK);
            }
            if within && distance < d - SLACK {
                inside += 1;
                missing += u32::from(!seen);
            }
        }
    }
    report.check(
        inside > 10_000 && missing == 0 && beyond == 0,
        format!("C19: {missing} of {inside} voxels missing, {beyond} beyond"),
    );
    report.claim(
        ["C19", "with 6 degrees of freedom a slice is a slab as thick as the kernel's truncation", "thickness = truncation width; linear in the plane, DDA"],
        format!(
            "oblique slice: of {inside} voxels within d = {d:.3} mm of the picture {missing} are missing; of all that it reached {beyond} lie beyond d (farthest \
             {thickest:.3} mm); ours is Gaussian in the plane too, and goes by bricks"
        ),
        missing == 0 && beyond == 0,
        ["holds", "does not hold"],
    );
    Ok(())
}

/// Returns the ripple of the weight between slices at a distance of `gap` σ, and the share of
/// the positions that no slice reaches.
pub(crate) fn between_slices(gap: f64) -> Result<[f64; 2], Box<dyn Error>> {
    let scan = Scan::new(ScanSettings {
        scene: Scene::Constant(100.0),
        motion: Motion::Parallel,
        frames: 14,
        gap_mm: gap,
        image_size: [24, 24],
        pixel_mm: [0.5; 2],
        noise_sd: 0.0,
        ..ScanSettings::default()
    })?;
    // 200 voxels from the middle of a gap to the middle of the next.
    let along = gap / 200.0;
    let settings = Settings {
        method: Method::GaussianTruncated,
        sigma_mm: [None, None, Some(1.0)],
        ..Settings::new(DVec3::new(0.5, 0.5, along))
    };
    let slices = scan.slices(0..scan.frames());
    let reconstructor = reconstructed(&settings, scan.mask(), slices.iter())?;
    let weights: Vec<f64> = (0..200).map(|z| f64::from(reconstructor.volume().voxel([0, 0, z]).1)).collect();
    let (low, high) = weights.iter().fold((f64::INFINITY, 0.0_f64), |(l, h), w| (l.min(*w), h.max(*w)));
    let mean = weights.iter().sum::<f64>() / 200.0;
    let unseen = weights.iter().filter(|w| **w <= f64::from(SEEN)).count() as f64 / 200.0;
    Ok([0.5 * (high - low) / mean, unseen])
}

/// C21, and the ripples that the figure shows.
pub(crate) fn undersampling(report: &mut Report) -> Result<Vec<[f64; 2]>, Box<dyn Error>> {
    let mut ripples = Vec::new();
    for gap in [1.0, 2.0, 3.0, 4.0] {
        ripples.push([gap, between_slices(gap)?[0]]);
    }
    let [_, twofold] = between_slices(2.0)?;
    let [_, fivefold] = between_slices(5.5)?;
    let d = Support::Energy(0.01).half_width_mm(1.0)?;
    report.check(twofold == 0.0, format!("C21: a part of {twofold} is unseen at gaps of 2 σ"));
    report.near("part unseen at gaps of 5.5 σ", fivefold, 1.0 - 2.0 * d / 5.5, 0.1);
    report.claim(
        ["C21", "twofold undersampling across the plane is typical", "×2"],
        format!(
            "slices 2 σ apart: no place unseen, the weight ripples by {:.2} % (whole Gaussian {:.2} %); 5.5 σ apart {:.1} % of the places are unseen",
            100.0 * ripples[1][1],
            100.0 * crate::ripple::formula(2.0),
            100.0 * fivefold
        ),
        twofold == 0.0,
        ["bearable: no hole", "not bearable: holes"],
    );
    Ok(ripples)
}
