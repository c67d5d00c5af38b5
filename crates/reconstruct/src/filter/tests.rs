use std::sync::Arc;

use simd::team::Team;
use sonoweave_core::region::ClipRect;

use super::*;
use crate::kernel::{AxisKernel, Method, Support};

fn kernel(sigma: f64) -> AxisKernel {
    AxisKernel::new(Method::Gaussian, sigma, Support::Energy(1e-4)).unwrap()
}

fn taps(sigma: [f64; 2]) -> [Taps; 2] {
    sigma.map(|s| Taps::design(&kernel(s), 1.0).unwrap())
}

/// A fan-like mask with two spans in its upper rows.
fn horns(width: u32, height: u32) -> Mask {
    Mask::from_rows(
        width,
        (0..height).map(|v| match v {
            0..3 => vec![],
            3..12 => vec![Span { start: 20 - v, end: 24 }, Span { start: width - 24, end: width - 20 + v }],
            _ => vec![Span { start: 5, end: width - 7 }],
        }),
    )
}

fn picture(width: u32, height: u32) -> Image {
    let pixels: Vec<u8> = (0..width * height).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as u8).collect();
    Image::new(width, height, Pixels::U8(Arc::from(pixels)))
}

fn filter(simd: Simd, sigma: [f64; 2], mask: Mask) -> SliceFilter {
    SliceFilter::new(simd, taps(sigma), mask, sigma.map(|s| s + 0.5)).unwrap()
}

/// Value of the spline given by the nodes, at a pixel position, in f64.
fn sample(nodes: &Nodes, step: [f64; 2], at: [f64; 2]) -> f64 {
    let b = |x: f64| {
        let x = x.abs();
        if x < 1.0 { 2.0 / 3.0 - x * x + 0.5 * x.powi(3) } else { (2.0 - x).max(0.0).powi(3) / 6.0 }
    };
    let u = at[0] / step[0] - nodes.first[0] as f64;
    let v = at[1] / step[1] - nodes.first[1] as f64;
    let mut sum = 0.0;
    for r in v.floor() as usize - 1..=v.floor() as usize + 2 {
        for c in u.floor() as usize - 1..=u.floor() as usize + 2 {
            sum += f64::from(nodes.data[r * nodes.stride + c]) * b(u - c as f64) * b(v - r as f64);
        }
    }
    sum
}

/// The exact sums, pixel by pixel.
fn exact(image: &Image, mask: &Mask, sigma: [f64; 2], at: [f64; 2]) -> (f64, f64) {
    let Pixels::U8(pixels) = image.pixels() else { unreachable!() };
    let weights = |axis: usize, n: i64| -> Vec<f64> {
        let k = kernel(sigma[axis]);
        let total: f64 = (-100..n + 100).map(|j| k.weight(at[axis] - j as f64)).sum();
        (0..n).map(|j| k.weight(at[axis] - j as f64) / total).collect()
    };
    let wu = weights(0, i64::from(image.width()));
    let wv = weights(1, i64::from(image.height()));
    let (mut value, mut certainty) = (0.0, 0.0);
    for v in 0..mask.height() as usize {
        for u in mask.row(v as u32).iter().flat_map(|s| s.start..s.end) {
            let w = wu[u as usize] * wv[v];
            value += w * f64::from(pixels[v * image.width() as usize + u as usize]);
            certainty += w;
        }
    }
    (value, certainty)
}

#[test]
fn nodes_match_exact_sums_within_deviation() {
    // Decimation, one node per pixel, several nodes per pixel; both axes different.
    for sigma in [[4.6, 4.6], [1.5, 6.0], [0.75, 3.1], [2.3, 0.8]] {
        let (width, height) = (75, 61);
        let image = picture(width, height);
        let mask = horns(width, height);
        let mut filter = filter(Simd::detect(), sigma, mask.clone());
        let sure = filter.certainty(Sharing::Alone);
        filter.filter(&image, Sharing::Alone);
        assert!(filter.deviation() <= crate::spline::DEVIATION_LIMIT, "{sigma:?}: {}", filter.deviation());
        let limit = filter.deviation() * 255.0 + 1e-3;
        let mut worst = 0.0_f64;
        for i in 0..400 {
            let at = [4.4 + f64::from(i * 37 % 641) * 0.1, 2.4 + f64::from(i * 53 % 583) * 0.1];
            let (value, certainty) = exact(&image, &mask, sigma, at);
            let relative = sample(&filter.value, filter.step_px(), at);
            let level = f64::from(filter.level);
            let error = (relative + level * certainty - value).abs();
            worst = worst.max(error);
            assert!(error <= limit, "{sigma:?} at {at:?}: {error} > {limit}");
            let error = (sample(&sure, filter.step_px(), at) - certainty).abs();
            assert!(error <= filter.deviation() * 1.01 + 1e-5, "certainty {sigma:?} at {at:?}: {error}");
        }
        assert!(worst > 0.0);
    }
}

#[test]
fn simd_and_threads_give_same_bits() {
    let team = Team::new("test", 3).unwrap();
    for sigma in [[4.6, 4.6], [1.5, 0.8]] {
        let image = picture(150, 99);
        let run = |simd, sharing| {
            let mut filter = filter(simd, sigma, horns(150, 99));
            filter.filter(&image, sharing);
            filter.value.data.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
        };
        let reference = run(Simd::Portable, Sharing::Alone);
        for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
            assert!(run(simd, Sharing::Alone) == reference, "{}", simd.name());
            assert!(run(simd, Sharing::of(team.as_ref())) == reference, "{} on three threads", simd.name());
        }
    }
}

#[test]
fn masked_pixels_not_read_and_free() {
    let (width, height) = (160, 120);
    let mask = Mask::rect(width, height, ClipRect::new(50, 40, 40, 40).unwrap());
    let mut boxed = filter(Simd::detect(), [3.0, 3.0], mask);
    let clean = picture(width, height);
    let Pixels::U8(pixels) = clean.pixels() else { unreachable!() };
    let dirty: Vec<u8> = pixels
        .iter()
        .enumerate()
        .map(|(i, p)| {
            let (u, v) = (i as u32 % width, i as u32 / width);
            if (50..90).contains(&u) && (40..80).contains(&v) { *p } else { p ^ 0xFF }
        })
        .collect();
    boxed.filter(&clean, Sharing::Alone);
    let first = boxed.value.data.clone();
    boxed.filter(&Image::new(width, height, Pixels::U8(Arc::from(dirty))), Sharing::Alone);
    assert_eq!(first, boxed.value.data);

    assert_eq!(boxed.work.pixels, 40 * 40);
    let whole = filter(Simd::detect(), [3.0, 3.0], Mask::full(width, height));
    assert_eq!(whole.work.pixels, u64::from(width * height));
    assert!(boxed.work.taps * 4 < whole.work.taps, "{:?} against {:?}", boxed.work, whole.work);
}

#[test]
fn mask_interior_certainty_is_one_and_constant_stays() {
    let (width, height) = (150, 120);
    let mask = horns(width, height);
    for sigma in [[4.6, 4.6], [0.8, 1.4]] {
        let mut filter = filter(Simd::detect(), sigma, mask.clone());
        let sure = filter.certainty(Sharing::Alone);
        filter.filter(
            &Image::new(width, height, Pixels::F32(Arc::from(vec![77.3_f32; (width * height) as usize]))),
            Sharing::Alone,
        );
        let at = |u: f64, v: f64| {
            let column = ((u / filter.step_px()[0]).round() as i64 - filter.value.first[0]) as usize;
            let row = ((v / filter.step_px()[1]).round() as i64 - filter.value.first[1]) as usize;
            row * filter.value.stride + column
        };
        let centre = at(75.0, 70.0);
        assert_eq!(sure.data[centre], 1.0);
        assert_eq!(filter.level, 77.3);
        assert!(filter.value.data.iter().all(|v| *v == 0.0), "a constant has no contrast");
    }
}

#[test]
fn empty_mask_or_too_many_nodes_refused() {
    let filter = |mask| SliceFilter::new(Simd::Portable, taps([0.8, 0.8]), mask, [1.0, 1.0]);
    assert_eq!(filter(Mask::from_fn(9, 9, |_, _| false)).err(), Some(SettingsError::EmptyMask));
    // Narrow images are mostly padding, which counts.
    assert!(matches!(filter(Mask::full(4, 400_000)).err(), Some(SettingsError::Nodes(n)) if n > MOST_NODES));
    assert!(filter(Mask::full(4, 10_000)).is_ok());
}
