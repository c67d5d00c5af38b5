use fastrand::Rng;
use simd::Simd;
use simd::sharing::Sharing;

use super::*;
use crate::classify::soft::SoftLight;
use crate::crop::{Crop, Operation};
use crate::soft::field::Opacities;
use crate::soft::smoothed::Smoothed;
use crate::soft::{self, SoftWork};

/// A bright ball before a bright wall, in darkness, with noise; some voxels were not seen.
fn scene(noise: f32) -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    let value = move |at: [i64; 3]| {
        let [x, y, z] = at.map(|x| x as f32);
        let seed = at.iter().fold(7_u64, |seed, x| seed.wrapping_mul(1_000_003).wrapping_add(*x as u64));
        let mut random = Rng::with_seed(seed);
        if random.u8(..) < 12 {
            return None;
        }
        let ball = (x - 24.0).powi(2) + (y - 16.0).powi(2) + (z - 26.0).powi(2) < 64.0;
        let body = if ball || y > 36.0 { 180.0 } else { 12.0 };
        Some((body + noise * (random.f32() - 0.5)).clamp(0.0, 255.0))
    };
    Field { low: [0; 3], high: [47; 3], value }
}

fn region_of(field: &Field<impl Fn([i64; 3]) -> Option<f32> + Sync>) -> RenderRegion {
    RenderRegion::new(half_mm(), field.low, field.high).unwrap()
}

fn portrait() -> (SoftLight, Transfer) {
    SoftLight::preset("portrait", [0.0, 255.0]).unwrap()
}

fn smoothed(volume: &(impl Values + ?Sized), region: &RenderRegion, simd: Simd) -> (Smoothed, SoftWork) {
    let (light, transfer) = portrait();
    let mut work = SoftWork::default();
    let inputs = (&light, transfer.visible());
    (Smoothed::new(volume, region, inputs, (simd, Sharing::Alone), &mut work), work)
}

/// The smoothed value of a voxel by the definition, in f64, for a variance of the noise.
fn by_definition(volume: &impl Values, at: [i64; 3], noise: f64) -> Option<f64> {
    let around = |at: [i64; 3], reach: i64| {
        let side = -reach..=reach;
        let places = side.clone().flat_map(move |z| {
            let side = -reach..=reach;
            side.clone().flat_map(move |y| side.clone().map(move |x| [x, y, z]))
        });
        places.filter_map(move |off| {
            let (mut value, mut weight) = ([0.0], [0.0]);
            volume.values(std::array::from_fn(|a| at[a] + off[a]), &mut value, &mut weight);
            (weight[0] > 0.0).then(|| (off, f64::from(value[0])))
        })
    };
    let despeckled = |at: [i64; 3], value: f64| {
        let near: Vec<f64> = around(at, 1).map(|(_, value)| value).collect();
        let n = near.len() as f64;
        let mean = near.iter().sum::<f64>() / n;
        let variance = near.iter().map(|value| (value - mean) * (value - mean)).sum::<f64>() / n;
        mean + (1.0 - noise / variance).max(0.0) * (value - mean)
    };
    let (mut sum, mut weights, mut is_seen) = (0.0, 0.0, false);
    for (off, value) in around(at, 3) {
        is_seen |= off == [0; 3];
        let weight = libm::exp(-0.5 * off.map(|x| (x * x) as f64).iter().sum::<f64>());
        weights += weight;
        sum += weight * despeckled(std::array::from_fn(|a| at[a] + off[a]), value);
    }
    is_seen.then(|| sum / weights)
}

#[test]
fn smoothed_values_are_those_of_the_definition() {
    let volume = scene(40.0);
    let region = region_of(&volume);
    let (smoothed, work) = smoothed(&volume, &region, Simd::detect());
    // The noise is the median of variances; a voxel shows which it was.
    let noise = f64::from(work.noise);
    assert!((60.0..200.0).contains(&noise), "uniform noise of 40 levels has a variance of 133: {noise}");
    let mut random = Rng::with_seed(3);
    let (mut compared, mut unseen) = (0, 0);
    while compared < 150 {
        let at = [random.i64(0..48), random.i64(0..48), random.i64(28..48)];
        let (mut value, mut weight) = ([0.0], [0.0]);
        smoothed.values(at, &mut value, &mut weight);
        match by_definition(&volume, at, noise) {
            Some(exact) if weight[0] > 0.0 => {
                assert!((f64::from(value[0]) - exact).abs() < 0.02, "{at:?}: {} and {exact}", value[0]);
                compared += 1;
            }
            None => {
                assert_eq!((value[0], weight[0]), (0.0, 0.0), "unseen stays unseen at {at:?}");
                unseen += 1;
            }
            Some(exact) => assert!(exact < 51.0, "a brick left out at {at:?} would be visible: {exact}"),
        }
    }
    assert!(unseen > 0);
}

#[test]
fn bricks_without_visible_voxels_are_not_smoothed() {
    let value = |[x, y, z]: [i64; 3]| Some(if [x, y, z].iter().all(|x| (24..32).contains(x)) { 200.0 } else { 10.0 });
    let volume = Field { low: [0; 3], high: [79; 3], value };
    let (_, work) = smoothed(&volume, &region_of(&volume), Simd::detect());
    assert_eq!((work.bricks, work.bricks_smoothed), (1000, 27));
}

#[test]
fn soft_picture_has_same_bits_however_it_is_computed() {
    let volume = scene(60.0);
    let region = region_of(&volume);
    let (light, transfer) = portrait();
    let settings = RenderSettings::new([48, 40], transfer);
    let of = |settings: &RenderSettings| soft::render(&volume, settings, &light, &region).unwrap().0.picture();
    let first = of(&settings);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
        for threads in [1, 3] {
            assert!(of(&RenderSettings { simd, threads, ..settings.clone() }) == first, "{simd:?}, {threads}");
        }
    }
    let (prepared, smoothed, _) = soft::prepare(&volume, &settings, &light, &region).unwrap();
    let exact = reference::render(&smoothed, &prepared, &region).unwrap();
    let [most, _] = exact.difference(&first);
    assert!(most < 1.0 / 255.0, "{most}");
}

#[test]
fn light_in_fog_follows_its_closed_form() {
    let (transfer, _) = fog(0.1, 1.0);
    let size = [40, 44, 48];
    let towards = DVec3::new(0.3, -0.2, 0.9).normalize();
    // A ball of 16 cells in the middle; cells of 1 mm, of which some lie only in part inside.
    let (middle, radius) = (DVec3::new(20.0, 22.0, 24.0), 16.0);
    let alpha = |cell: usize| {
        let first = DVec3::new((cell % 40) as f64, (cell / 40 % 44) as f64, (cell / (40 * 44)) as f64) - 0.375;
        let inside = (0..64).filter(|n| {
            let off = DVec3::new(f64::from(n % 4), f64::from(n / 4 % 4), f64::from(n / 16)) * 0.25;
            (first + off).distance(middle) <= radius
        });
        1.0 - libm::pow(0.9, inside.count() as f64 / 64.0) as f32
    };
    let opacities = Opacities { size, alpha: (0..40 * 44 * 48).map(alpha).collect() };
    let at = |at: DVec3| (at.z as usize * 44 + at.y as usize) * 40 + at.x as usize;
    let light = opacities.transmitted(&transfer, towards.to_array(), 0.0);
    for off in [0.0, 4.0, -4.0, -9.0] {
        let place = (middle + off * towards).round();
        // The way from the surface to the side of the cell that faces the light.
        let to_middle = middle - place;
        let along = to_middle.dot(towards);
        let way = along + (radius * radius - to_middle.length_squared() + along * along).sqrt() - 0.5 / towards.z;
        let depth = libm::log(f64::from(light[at(place)])) / libm::log(0.9);
        assert!((depth / way - 1.0).abs() < 0.02, "{depth} mm of {way} at {off}");
    }
    // Light that spreads grows no stronger on the way.
    let spread = opacities.transmitted(&transfer, towards.to_array(), 0.09);
    let mut before = 1.0;
    for step in 0..18 {
        let here = spread[at((middle - (f64::from(step) - 9.0) * towards).round())];
        assert!(here <= before + 1e-3, "{here} after {before}");
        before = here;
    }
    assert!(before < 0.3, "{before}");
}

#[test]
fn ball_casts_a_shadow_that_a_crop_takes_away() {
    let volume = scene(0.0);
    let region = region_of(&volume);
    let (light, transfer) = portrait();
    // From the upper left, the ball's shadow falls on the wall to the lower right.
    let settings = RenderSettings::new([96, 96], transfer);
    let without = Operation::Ball { centre: [12.0, 8.0, 13.0], radius: 5.5 };
    let cropped = RenderSettings { crop: Crop::new(vec![without]).unwrap(), ..settings.clone() };
    let [with, without] =
        [&settings, &cropped].map(|settings| soft::render(&volume, settings, &light, &region).unwrap().0.picture());
    let darker = with.pixels.iter().zip(&without.pixels).filter(|([a, ..], [b, ..])| *a < 0.8 * *b).count();
    assert!(darker > 200, "{darker} pixels of the wall lie in the ball's shadow");
}

#[test]
fn unknown_soft_light_and_empty_range_are_refused() {
    let error = SoftLight::preset("portait", [0.0, 255.0]).unwrap_err();
    assert_eq!(error, RenderError::SoftName { name: "portait".into() });
    assert!(error.to_string().contains("portrait, bone, vessel and glass"), "{error}");
    for range in [[1.0, 1.0], [0.0, f64::NAN], [255.0, 0.0]] {
        assert!(matches!(SoftLight::preset("glass", range), Err(RenderError::SoftRange { .. })), "{range:?}");
    }
    for (name, _) in SoftLight::PRESETS {
        let (_, transfer) = SoftLight::preset(name, [-1.0, 3.0]).unwrap();
        assert!(transfer.visible().is_some(), "{name}");
    }
}
