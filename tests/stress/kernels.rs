//! Tests of every kernel against the closed forms of its effective width: blobs, a sphere,
//! waves.

use std::f64::consts::TAU;
use volume::Voxels;

use glam::{DMat3, DVec3};

use phantom::Scene;
use phantom::scene::{Blobs, Sphere};
use reconstruct::kernel::{AxisKernel, Method, Support};
use reconstruct::{Reconstructor, Settings};
use sonoweave_core::slice::Slice;

use crate::figures::{Sheet, Test};
use crate::insertion::{BLURRING, Probe, Voxel, WIDE, half_mm, positions, reconstruct_all, seen, turned};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "P3",
            "Gaussian blobs under an anisotropic kernel turned with the slices: within 1 % of the closed form",
            blobs,
        ),
        Test::new("P4", "sphere under an isotropic kernel: within 1 % of the closed form", sphere),
        Test::new(
            "P5",
            "waves along u, v, n and between: amplitude within 1 % of e^(−2π²σ²f²) at the effective width",
            waves,
        ),
        Test::new("37", "sphere of R = 3, 5, 10 σ: radius ± 0.02 σ, volume by the exact root", radius),
    ]
}

/// The slices of a cube as wide as the image.
fn scan(probe: &Probe, gap: f64, scene: impl Fn(DVec3) -> f64) -> Vec<Slice> {
    let reach = 0.5 * f64::from(probe.size[0]) * probe.pixel_mm;
    positions(reach, gap).map(|along| probe.scan(along, &scene)).collect()
}

fn within(r: &Reconstructor, mm: f64) -> Vec<Voxel> {
    seen(r).into_iter().filter(|voxel| voxel.at.length() < mm).collect()
}

fn worst(voxels: &[Voxel], truth: impl Fn(DVec3) -> f64) -> f64 {
    voxels.iter().map(|voxel| (voxel.value - truth(voxel.at)).abs()).fold(0.0, f64::max)
}

fn rms(voxels: &[Voxel], truth: impl Fn(DVec3) -> f64) -> f64 {
    (voxels.iter().map(|voxel| (voxel.value - truth(voxel.at)).powi(2)).sum::<f64>() / voxels.len() as f64).sqrt()
}

/// In the plane, interpolating methods have the pixels' width and not the requested σ. The
/// nearest method shows values up to half a pixel and half a gap beside. For any width of its
/// kernel, its largest difference is a gradient times that distance. Its average meets the
/// closed form (rms, at finer pixels and gaps).
fn blobs(sheet: &mut Sheet) {
    let mut blobs = Blobs::draw(5);
    blobs.sphere = None;
    let scene = Scene::Blobs(blobs);
    for (name, axes) in [("straight", DMat3::IDENTITY), ("turned", turned(0.7, -0.4, 0.3))] {
        let coarse = Probe { axes, ..Probe::straight([96, 96], 0.2) };
        let coarse_slices = scan(&coarse, 0.3, |p| scene.value(p));
        for method in BLURRING {
            let average = method == Method::Nearest;
            // For straight slices, every voxel would have the same distance from its pixel.
            if average && axes == DMat3::IDENTITY {
                continue;
            }
            let fine = Probe { axes, ..Probe::straight([124, 124], 0.1) };
            let fine_slices = if average { scan(&fine, 0.15, |p| scene.value(p)) } else { Vec::new() };
            let (probe, slices, radius) =
                if average { (fine, &fine_slices, 4.5) } else { (coarse, &coarse_slices, 6.0) };
            let settings = Settings { method, sigma_mm: [Some(0.5), Some(0.7), Some(0.9)], ..half_mm() };
            let r = reconstruct_all(settings, &probe.mask(), slices);
            let variances = DVec3::from_array(r.kernels().unwrap().map(|k| k.sigma_effective_mm().powi(2)));
            let blur = axes * DMat3::from_diagonal(variances) * axes.transpose();
            let inside = within(&r, radius);
            let values = || inside.iter().map(|voxel| voxel.value);
            let range = values().fold(0.0, f64::max) - values().fold(f64::MAX, f64::min);
            let blurred = |p| scene.blurred(p, &blur).unwrap();
            let what = format!("{}, {name}", method.name());
            let largest = format!("{what}: largest difference / range");
            if average {
                sheet.record(&largest, format!("{:.4}", worst(&inside, blurred) / range));
                sheet.at_most(&format!("{what}: rms difference / range"), rms(&inside, blurred) / range, 0.01);
            } else {
                sheet.at_most(&largest, worst(&inside, blurred) / range, 0.01);
            }
            let sharp = worst(&inside, |p| scene.value(p));
            let plain = if method.interpolates() { 0.012 } else { 0.02 };
            sheet.above(&format!("{what}: the same against the scene unblurred"), sharp / range, plain);
        }
    }
}

/// A sphere and an isotropic kernel with the same support along all axes. The edge is soft
/// enough for the pixels; `total` is the σ of both.
struct Round {
    method: Method,
    sigma: f64,
    edge: f64,
    spacing: f64,
    gap: f64,
}

impl Round {
    /// Returns volume, sphere and total σ for a radius in units of it.
    fn scan(&self, radius: f64) -> (Reconstructor, Sphere, f64) {
        let support = [Some(Support::Energy(1e-4)); 2];
        let width = AxisKernel::new(self.method, self.sigma, Support::Energy(1e-4)).unwrap().sigma_effective_mm();
        let total = width.hypot(self.edge);
        let centre = DVec3::new(0.13, -0.21, 0.08);
        let ball = Sphere { centre, radius: radius * total, inside: 180.0, outside: 60.0, edge_sigma: self.edge };
        let side = ((2.0 * (ball.radius + 5.0 * total)) / 0.2) as u32;
        let probe = Probe { axes: turned(0.7, -0.4, 0.3), ..Probe::straight([side, side], 0.2) };
        let sigma_mm = [Some(self.sigma); 3];
        let settings = Settings { method: self.method, sigma_mm, support, ..Settings::new(DVec3::splat(self.spacing)) };
        let scene = Scene::Sphere(ball);
        (reconstruct_all(settings, &probe.mask(), &scan(&probe, self.gap, |p| scene.value(p))), ball, total)
    }
}

/// The closed form is that of an isotropic kernel. The interpolating methods are wider across
/// the plane; the difference is integrated there. For them the sphere is softer, since pixels
/// that are not averaged must be fine beside it. The nearest method is tested by its rms, as
/// with the blobs.
fn sphere(sheet: &mut Sheet) {
    for method in BLURRING {
        let (edge, gap) = match method {
            Method::Linear => (0.8, 0.2),
            Method::Nearest => (1.2, 0.1),
            _ => (0.3, 0.2),
        };
        let round = Round { method, sigma: 0.8, edge, spacing: 0.5, gap };
        let (r, ball, total) = round.scan(if method.interpolates() { 5.0 } else { 7.0 });
        let [plane, _, across] = r.kernels().unwrap().map(|k| k.sigma_effective_mm().powi(2));
        let blur = DMat3::from_diagonal(DVec3::splat(plane));
        let more = (across - plane).max(0.0).sqrt();
        let normal = turned(0.7, -0.4, 0.3).z_axis;
        let inside = within(&r, ball.radius + 2.0 * total);
        let scene = Scene::Sphere(ball);
        let nodes: Vec<(f64, f64)> = match more > 1e-6 {
            true => (-20..=20).map(|k| (0.25 * f64::from(k), (-0.5 * (0.25 * f64::from(k)).powi(2)).exp())).collect(),
            false => vec![(0.0, 1.0)],
        };
        let total_weight: f64 = nodes.iter().map(|(_, w)| w).sum();
        let blurred = |p: DVec3| {
            let at = |z: f64| scene.blurred(p + normal * (z * more), &blur).unwrap();
            nodes.iter().map(|(z, w)| w * at(*z)).sum::<f64>() / total_weight
        };
        if method == Method::Nearest {
            sheet.record(&format!("{}: largest difference / step", method.name()), worst(&inside, blurred) / 120.0);
            sheet.at_most(&format!("{}: rms difference / step", method.name()), rms(&inside, blurred) / 120.0, 0.01);
        } else {
            sheet.at_most(
                &format!("{}: largest difference / step", method.name()),
                worst(&inside, blurred) / 120.0,
                0.01,
            );
        }
        let sharp = worst(&inside, |p| scene.value(p)) / 120.0;
        let plain = if method.interpolates() { 0.03 } else { 0.1 };
        sheet.above(&format!("{}: the same against the scene unblurred", method.name()), sharp, plain);
    }
}

/// Returns the radius at which the blurred sphere of `radius` has half its step: the root of
/// the closed form (0 outside, 1 inside).
fn half_level(radius: f64, sigma: f64) -> f64 {
    let s2 = std::f64::consts::SQRT_2 * sigma;
    let level = |r: f64| {
        let bell = |x: f64| (-0.5 * (x / sigma).powi(2)).exp();
        0.5 * (error_function((radius + r) / s2) + error_function((radius - r) / s2))
            - sigma / (TAU.sqrt() * r) * (bell(radius - r) - bell(radius + r))
    };
    let (mut low, mut high) = (0.2 * radius, radius);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if level(middle) > 0.5 { low = middle } else { high = middle }
    }
    low
}

/// The error function by its series and its asymptotic limit: 1e-12 and better where the sphere
/// needs it.
fn error_function(x: f64) -> f64 {
    if x.abs() > 5.5 {
        return x.signum();
    }
    // 2/√π e^{−x²} Σ 2ⁿx²ⁿ⁺¹/(2n+1)!!: no term cancels another.
    let (mut term, mut sum, mut n) = (x, x, 0.0);
    while term.abs() > 1e-17 * sum.abs() {
        n += 1.0;
        term *= 2.0 * x * x / (2.0 * n + 1.0);
        sum += term;
    }
    std::f64::consts::FRAC_2_SQRT_PI * (-x * x).exp() * sum
}

fn radius(sheet: &mut Sheet) {
    // The exact root is that of an isotropic kernel.
    for method in WIDE {
        for radii in [3.0, 5.0, 10.0] {
            let round = Round { method, sigma: 0.8, edge: 0.3, spacing: 0.4, gap: 0.4 };
            let (r, ball, total) = round.scan(radii);
            let exact = half_level(ball.radius, total);
            let (crossings, volume) = surface(&r, &ball);
            let mean = crossings.iter().sum::<f64>() / crossings.len() as f64;
            let what = format!("{}, R = {radii} σ", method.name());
            sheet.above(&format!("{what}: crossings of the half level"), crossings.len() as f64, 100.0);
            sheet.near(
                &format!("{what}: (mean radius − R) / σ"),
                (mean - ball.radius) / total,
                (exact - ball.radius) / total,
                0.02,
            );
            let farthest = crossings.iter().map(|c| (c - exact).abs()).fold(0.0, f64::max);
            sheet.at_most(
                &format!("{what}: largest distance of a crossing from the exact radius / σ"),
                farthest / total,
                0.05,
            );
            let full = 4.0 / 3.0 * std::f64::consts::PI * ball.radius.powi(3);
            let expected = (exact / ball.radius).powi(3) - 1.0;
            sheet.near(&format!("{what}: volume error"), volume / full - 1.0, expected, 0.01);
            sheet.record(&format!("{what}: −3σ²/R²"), format!("{:.6}", -3.0 / (radii * radii)));
        }
    }
}

/// Returns the distances from the centre at which lines of voxels along x cross the half level
/// (linear between voxels), and the volume between them.
fn surface(r: &Reconstructor, ball: &Sphere) -> (Vec<f64>, f64) {
    let spacing = r.settings().spacing_mm.x;
    let reach = (1.2 * ball.radius / spacing) as i64 + 3;
    let value = |voxel: [i64; 3]| {
        let (r, w) = r.volume().voxel(voxel);
        if w > 0.0 { f64::from(r) / f64::from(w) } else { f64::NAN }
    };
    let (mut crossings, mut volume) = (Vec::new(), 0.0);
    for z in -reach..=reach {
        for y in -reach..=reach {
            for x in -reach..reach {
                let [a, b] = [0, 1].map(|i| value([x + i, y, z]) - 120.0);
                if a.is_nan() || b.is_nan() {
                    // The lattice's corners lie outside the scan's box; the sphere's surface
                    // must lie inside.
                    let at = DVec3::new(x as f64, y as f64, z as f64) * spacing - ball.centre;
                    assert!(at.length() > 1.1 * ball.radius, "the scan holds the sphere");
                    continue;
                }
                if (a < 0.0) != (b < 0.0) {
                    let along = (x as f64 + a / (a - b)) * spacing;
                    let at = DVec3::new(along, y as f64 * spacing, z as f64 * spacing) - ball.centre;
                    crossings.push(at.length());
                    volume += spacing * spacing * if a < 0.0 { -along } else { along };
                }
            }
        }
    }
    (crossings, volume)
}

/// Fraction of a wave of `per_mm` cycles that a kernel passes: its Fourier transform, by the
/// midpoint rule.
pub(crate) fn passed(kernel: &AxisKernel, per_mm: f64) -> f64 {
    let n = 20_000;
    let step = 2.0 * kernel.support_mm / f64::from(n);
    let (mut all, mut wave) = (0.0, 0.0);
    for i in 0..n {
        let x = -kernel.support_mm + (f64::from(i) + 0.5) * step;
        all += kernel.weight(x);
        wave += kernel.weight(x) * (TAU * per_mm * x).cos();
    }
    wave / all
}

/// Amplitude of the best fit of `mean + a·cos + b·sin` to the voxels.
fn amplitude(voxels: &[Voxel], wave: DVec3) -> f64 {
    let mut normal = DMat3::ZERO;
    let mut right = DVec3::ZERO;
    for voxel in voxels {
        let (sin, cos) = (TAU * wave.dot(voxel.at)).sin_cos();
        let row = DVec3::new(1.0, cos, sin);
        normal += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
        right += row * voxel.value;
    }
    let fit = normal.inverse() * right;
    fit.y.hypot(fit.z)
}

/// A kernel that is cut off and lowered is not a Gaussian of its effective width for waves of
/// which it passes less than 0.6. At 0.37 its amplitude is 0.025 lower in any reconstruction.
/// There the kernel's own transform is the closed form.
fn waves(sheet: &mut Sheet) {
    let axes = turned(0.7, -0.4, 0.3);
    for method in BLURRING {
        // The nearest method's samples between pixels and slices are correct only on average
        // over many.
        let (probe, gap) = match method {
            Method::Nearest => (Probe { axes, ..Probe::straight([160, 160], 0.1) }, 0.1),
            _ => (Probe { axes, ..Probe::straight([96, 96], 0.2) }, 0.4),
        };
        for (name, direction) in
            [("u", DVec3::X), ("v", DVec3::Y), ("n", DVec3::Z), ("between", DVec3::new(0.6, 0.5, 0.4))]
        {
            for cycles in [0.08, 0.16, 0.24] {
                let per_axis = direction.normalize() * cycles;
                let wave = axes * per_axis;
                let settings = Settings { method, sigma_mm: [Some(0.6), Some(0.8), Some(1.0)], ..half_mm() };
                let slices = scan(&probe, gap, |p| 128.0 + 100.0 * (TAU * wave.dot(p) + 0.3).sin());
                let r = reconstruct_all(settings, &probe.mask(), &slices);
                let kernels = r.kernels().unwrap();
                let measured = amplitude(&within(&r, 6.0), wave) / 100.0;
                let frequencies = per_axis.to_array();
                let exact: f64 = (0..3).map(|a| passed(&kernels[a], frequencies[a])).product();
                let exponent: f64 = (0..3).map(|a| (kernels[a].sigma_effective_mm() * frequencies[a]).powi(2)).sum();
                let gaussian = (-0.5 * TAU * TAU * exponent).exp();
                let what = format!("{}, along {name}, {cycles} cycles a mm", method.name());
                let by_width = format!("{what}: amplitude, by the width");
                if exact > 0.6 {
                    sheet.near(&by_width, measured, gaussian, 0.01);
                } else {
                    sheet.record(&by_width, format!("{measured:.6} for {gaussian:.6}"));
                }
                sheet.near(&format!("{what}: amplitude, by the kernel's transform"), measured, exact, 0.003);
            }
        }
    }
}
