//! Tests of volumes whose pixels are weighted by their shadows.

use super::*;
use crate::{Decay, PathReconstructor, SettingsError, ShadowWeights};

/// Slices of even tissue, with a stone's shadow in every other one.
fn slices() -> Vec<Slice> {
    let mut slices = scan(Scene::Constant(120.0), 12, 30.0, Depth::U8).slices(0..12);
    for (i, slice) in slices.iter_mut().enumerate().filter(|(i, _)| i % 2 == 1) {
        let Pixels::U8(pixels) = slice.image.pixels() else { unreachable!("pictures of eight bits") };
        let in_shadow = |at: usize| (20 + i..40 + i).contains(&(at % 72)) && at / 72 >= 20;
        let shadowed = pixels.iter().enumerate().map(|(at, grey)| if in_shadow(at) { grey / 32 } else { *grey });
        slice.image = Image::new(72, 60, Pixels::U8(shadowed.collect()));
    }
    slices
}

fn weighted() -> Settings {
    Settings { shadow_weights: Some(ShadowWeights { tail_mm: 6.0, ..ShadowWeights::default() }), ..settings() }
}

fn inserted(settings: Settings, mask: &Mask, slices: &[Slice]) -> Reconstructor {
    let mut r = Reconstructor::new(settings, mask.clone()).unwrap();
    slices.iter().for_each(|slice| assert!(r.insert(slice).is_ok()));
    r
}

#[test]
fn sums_are_those_of_each_slice_times_its_weights() {
    let slices = slices();
    for (method, mask) in [
        (Method::GaussianTruncated, fan()),
        (Method::Gaussian4, Mask::full(72, 60)),
        (Method::Linear, fan()),
        (Method::Nearest, Mask::full(72, 60)),
    ] {
        let (with, without) = (Settings { method, ..weighted() }, Settings { method, ..settings() });
        let all = inserted(with.clone(), &mask, &slices);
        let (grid, low) = grid_around(all.volume(), 0.5);
        let mut expected = vec![[0.0; 2]; voxels(&grid, low).count()];
        let mut most = [0.0_f32; 2];
        for slice in &slices {
            let [weighted, plain] =
                [&with, &without].map(|settings| inserted(settings.clone(), &mask, std::slice::from_ref(slice)));
            for (sum, (_, at)) in expected.iter_mut().zip(voxels(&grid, low)) {
                let ((r, w), (plain_r, plain_w)) = (weighted.volume().voxel(at), plain.volume().voxel(at));
                *sum = [sum[0] + f64::from(r), sum[1] + f64::from(w)];
                if plain_w > 1e-4 {
                    let part = w / plain_w;
                    assert!((0.0099..1.0001).contains(&part), "{at:?}: {part}");
                    // The value is that without weights.
                    assert!((r / w - plain_r / plain_w).abs() < 2e-3, "{at:?}: {} {}", r / w, plain_r / plain_w);
                    most = [most[0].max(part), most[1].max(1.0 - part)];
                }
            }
        }
        assert!(most[0] > 0.99 && most[1] > 0.98, "{most:?}");
        for (expected, (_, at)) in expected.into_iter().zip(voxels(&grid, low)) {
            let (r, w) = all.volume().voxel(at);
            for (expected, found) in expected.into_iter().zip([r, w]) {
                assert!((f64::from(found) - expected).abs() <= 1e-5 * expected.abs() + 1e-6, "{at:?}");
            }
        }
        assert_eq!(all.work().without_shadows, 0);
    }
}

#[test]
fn shadow_in_some_views_hardly_changes_the_mean() {
    let slices = slices();
    let error = |settings: Settings| {
        let r = inserted(settings, &Mask::full(72, 60), &slices);
        let (grid, low) = grid_around(r.volume(), 0.5);
        let seen = voxels(&grid, low).map(|(_, at)| r.volume().voxel(at)).filter(|(_, w)| *w > 0.5);
        let squares: Vec<f32> = seen.map(|(r, w)| (r / w - 120.0).powi(2)).collect();
        (squares.iter().sum::<f32>() / squares.len() as f32).sqrt()
    };
    let [mean, weighted] = [settings(), weighted()].map(error);
    assert!(weighted < 0.3 * mean, "{weighted} {mean}");
}

#[test]
fn weighted_pixels_have_same_bits_in_parts_and_by_any_threads() {
    let slices = slices();
    let decay = Compounding::Decay(Decay::Exponential { rate_per_s: 0.7 });
    for (compounding, standard_error) in [(Compounding::Mean, false), (Compounding::Mean, true), (decay, false)] {
        let settings = Settings { compounding, standard_error, ..weighted() };
        let whole = inserted(settings.clone(), &fan(), &slices);
        for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
            let other = inserted(Settings { simd, threads: 2, ..settings.clone() }, &fan(), &slices);
            assert!(bits(other.volume()) == bits(whole.volume()), "{compounding}, {simd:?}");
        }
        let mut first = Reconstructor::new(settings.clone(), fan()).unwrap();
        let mut part = Reconstructor::new(settings, fan()).unwrap();
        for slice in &slices {
            first.insert(slice).unwrap();
            part.insert_decided(slice, &first.last().unwrap().decision).unwrap();
        }
        assert!(bits(part.volume()) == bits(whole.volume()), "{compounding}");
    }
}

#[test]
fn pictures_that_tell_nothing_count_in_full() {
    let mut slices = slices();
    for slice in &mut slices {
        let Pixels::U8(pixels) = slice.image.pixels() else { unreachable!("pictures of eight bits") };
        let ended = pixels.iter().enumerate().map(|(at, grey)| if at / 72 >= 40 { 0 } else { *grey });
        slice.image = Image::new(72, 60, Pixels::U8(ended.collect()));
    }
    let (with, without) = (inserted(weighted(), &fan(), &slices), inserted(settings(), &fan(), &slices));
    assert!(bits(with.volume()) == bits(without.volume()));
    assert_eq!((with.work().without_shadows, without.work().without_shadows), (12, 0));
}

#[test]
fn weights_of_pixels_refused_where_they_have_no_meaning() {
    for compounding in [Compounding::Maximum, Compounding::Latest] {
        let refused = Reconstructor::new(Settings { compounding, ..weighted() }, fan()).err();
        assert_eq!(refused, Some(SettingsError::ShadowWeights(compounding.name())));
    }
    let planar = PathReconstructor::planar(weighted(), crate::planar::PlanarSettings::default(), Mask::full(72, 60));
    assert_eq!(planar.err(), Some(SettingsError::BeyondPlanar("shadow weights".into())));
    let mut general = PathReconstructor::general(weighted(), Mask::full(72, 60)).unwrap();
    general.insert(&slices()[0]).unwrap();
    assert!(general.first_moment().is_none());
    let beams = ShadowWeights { beams: 200, ..ShadowWeights::default() };
    let refused = Reconstructor::new(Settings { shadow_weights: Some(beams), ..settings() }, fan()).err().unwrap();
    assert!(refused.to_string().contains("the number of their beams must lie between 1 and 128, not at 200"));
}
