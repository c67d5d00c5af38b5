//! Tests of the pictures' weights against their definition, sample by sample.

use mask::Mask;
use simd::Simd;
use simd::sharing::Sharing;
use simd::team::Team;
use sonoweave_core::region::{ClipRect, Fan};
use sonoweave_core::slice::{Image, Pixels};

use super::beams::Beams;
use super::*;
use crate::nodes::Nodes;

const SIZE: [u32; 2] = [200, 160];
const PIXEL_MM: [f64; 2] = [0.5; 2];

fn fan() -> Mask {
    Mask::fan(SIZE[0], SIZE[1], &Fan::new([100.0, -40.0], [50.0, 195.0], [-28.0, 28.0]).unwrap())
}

/// A grey level by pixel, with noise that is the same everywhere.
fn picture(grey: impl Fn(f64, f64) -> f64) -> Image {
    let mut state = 1_u64;
    let mut noise = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        0.5 + (state >> 40) as f64 / f64::from(1 << 24)
    };
    let [width, height] = SIZE;
    let pixels = (0..width * height).map(|i| (grey(f64::from(i % width), f64::from(i / width)) * noise()) as u8);
    Image::new(width, height, Pixels::U8(pixels.collect()))
}

/// Nodes on every pixel, and a margin of two.
fn nodes() -> Nodes {
    let [columns, rows] = SIZE.map(|n| n as usize + 4);
    Nodes::new([-2, -2], columns, rows, columns.next_multiple_of(simd::LANES))
}

fn weights(mask: &Mask, image: &Image) -> Option<Nodes> {
    let mut weights = PictureWeights::new(&ShadowWeights::default(), mask, PIXEL_MM, &nodes(), [1.0; 2]).unwrap();
    weights.of(image, Simd::detect(), Sharing::Alone).cloned()
}

/// Weights at pixels of the data.
fn of_pixels<'a>(mask: &'a Mask, nodes: &'a Nodes) -> impl Iterator<Item = ([u32; 2], f32)> + 'a {
    let all = (0..SIZE[1]).flat_map(|v| (0..SIZE[0]).map(move |u| [u, v]));
    let inside = all.filter(|[u, v]| mask.contains(*u, *v));
    inside.map(|[u, v]| ([u, v], nodes.data[(v as usize + 2) * nodes.stride + u as usize + 2]))
}

fn grey(image: &Image, at: u32) -> f64 {
    match image.pixels() {
        Pixels::U8(p) => f64::from(p[at as usize]),
        _ => unreachable!("pictures of eight bits"),
    }
}

#[test]
fn weights_follow_their_definition() {
    let settings = ShadowWeights { tail_mm: 15.0, beams: 5, level: 0.5, width: 0.1 };
    let striped = picture(|u, v| if (u / 15.0 + v / 40.0).sin() > -0.5 { 90.0 } else { 4.0 });
    let part = Mask::rect(SIZE[0], SIZE[1], ClipRect::new(20, 10, 90, 120).unwrap());
    for mask in [fan(), part, Mask::full(SIZE[0], SIZE[1])] {
        let beams = Beams::new(&settings, &mask, PIXEL_MM, &nodes(), [1.0; 2]).unwrap();
        let mut data: Vec<f64> = beams.pixels.iter().flatten().map(|at| grey(&striped, *at)).collect();
        data.sort_by(f64::total_cmp);
        let median = data[data.len() / 2];
        let expected = |beam: usize, depth: usize| {
            let tail = beams.tail(beam, depth);
            assert!(!tail.is_empty(), "every beam has data");
            let all = beams.beside(beam).flat_map(|beam| tail.clone().map(move |at| beam * beams.depths + at));
            let greys: Vec<f64> = all.filter_map(|at| beams.pixels[at]).map(|at| grey(&striped, at)).collect();
            settings.weight(greys.iter().sum::<f64>() / greys.len() as f64 / median)
        };
        let expected: Vec<f64> =
            (0..beams.count * beams.depths).map(|at| expected(at / beams.depths, at % beams.depths)).collect();
        let mut made = PictureWeights::new(&settings, &mask, PIXEL_MM, &nodes(), [1.0; 2]).unwrap();
        let found = made.of(&striped, Simd::detect(), Sharing::Alone).unwrap();
        let mut range = [f64::INFINITY, 0.0_f64];
        for (node, (at, [beam, depth])) in found.data.iter().zip(&beams.places) {
            let corner = |beams_on: usize, depths_on: usize| {
                let at = *at as usize + beams_on * beams.depths + depths_on;
                expected.get(at).copied().unwrap_or(1.0)
            };
            let [beam, depth] = [beam, depth].map(|part| f64::from(*part));
            let along = |beams_on: usize| (1.0 - depth) * corner(beams_on, 0) + depth * corner(beams_on, 1);
            let expected = (1.0 - beam) * along(0) + beam * along(1);
            range = [range[0].min(expected), range[1].max(expected)];
            assert!((f64::from(*node) - expected).abs() < 1e-4, "{node} {expected}");
        }
        assert!(range[0] < 0.1 && range[1] > 0.8, "{range:?}");
    }
}

#[test]
fn samples_lie_on_straight_beams_at_equal_distances() {
    let [apex_u, apex_v] = [100.0, -40.0];
    let beams = Beams::new(&ShadowWeights::default(), &fan(), PIXEL_MM, &nodes(), [1.0; 2]).unwrap();
    let place = |at: u32| [f64::from(at % SIZE[0]) - apex_u, f64::from(at / SIZE[0]) - apex_v];
    for beam in [2, 40, 125] {
        let pixels = &beams.pixels[beam * beams.depths..(beam + 1) * beams.depths];
        let angle = (-28.0 + (beam as f64 + 0.5) * 56.0 / 128.0_f64).to_radians();
        let mut before = None;
        for [x, y] in pixels.iter().flatten().map(|at| place(*at)) {
            let across = x * angle.cos() - y * angle.sin();
            assert!(across.abs() < 1.5, "beam {beam}: {across}");
            let radius = x.hypot(y);
            assert!(before.is_none_or(|before: f64| (radius - before - 2.0).abs() < 1.5), "{radius} {before:?}");
            before = Some(radius);
        }
        assert!(before.is_some_and(|last| last > 190.0), "to the far end: {before:?}");
    }
    // 50 mm are 100 pixels, 50 samples; at the end 12 are left.
    assert_eq!((beams.tail(64, 5), beams.tail(64, beams.depths - 1).len()), (5..55, 12));
}

#[test]
fn even_tissue_counts_in_full_and_a_black_beam_hardly() {
    for mask in [fan(), Mask::full(SIZE[0], SIZE[1])] {
        let even = weights(&mask, &picture(|_, _| 100.0)).unwrap();
        let (mut all, mut full) = (0, 0);
        for (_, weight) in of_pixels(&mask, &even) {
            all += 1;
            full += usize::from(weight >= 0.95);
        }
        assert!(f64::from(full as u32) >= 0.99 * f64::from(all), "{full} of {all}");
    }
    // Behind a stone, between columns 80 and 120 and from row 60 on.
    let mask = Mask::full(SIZE[0], SIZE[1]);
    let in_shadow = |u: f64, v: f64| (80.0..120.0).contains(&u) && v >= 60.0;
    let shadowed = weights(&mask, &picture(|u, v| if in_shadow(u, v) { 0.0 } else { 100.0 })).unwrap();
    for ([u, v], weight) in of_pixels(&mask, &shadowed) {
        if (85..115).contains(&u) && v >= 60 {
            assert!((0.01..0.0105).contains(&weight), "{u} {v}: {weight}");
        } else if !(75..125).contains(&u) {
            assert!(weight > 0.9, "{u} {v}: {weight}");
        }
    }
}

#[test]
fn dark_places_that_are_bright_behind_count() {
    let mask = Mask::full(SIZE[0], SIZE[1]);
    let cyst = |u: f64, v: f64| (u - 100.0).hypot(v - 70.0) < 20.0;
    let found = weights(&mask, &picture(|u, v| if cyst(u, v) { 0.0 } else { 100.0 })).unwrap();
    let least = of_pixels(&mask, &found).map(|(_, weight)| weight).fold(f32::INFINITY, f32::min);
    assert!(least > 0.15, "{least}");
    let middle = found.data[72 * found.stride + 102];
    assert!(middle > 0.9, "{middle}");
}

#[test]
fn pictures_that_end_in_the_dark_tell_nothing() {
    let mask = Mask::full(SIZE[0], SIZE[1]);
    assert!(weights(&mask, &picture(|_, v| if v < 100.0 { 100.0 } else { 3.0 })).is_none(), "the depth ends");
    assert!(weights(&mask, &picture(|u, _| if u < 70.0 { 100.0 } else { 3.0 })).is_some(), "35 % are bright");
    let dark = picture(|u, v| if u < 60.0 || v < 10.0 { 200.0 } else { 0.0 });
    assert!(weights(&mask, &dark).is_none(), "the median is black");
    assert!(weights(&mask, &picture(|_, _| 0.0)).is_none(), "black");
    let numbers = (0..SIZE[0] * SIZE[1]).map(|i| if i % 3 == 0 { f32::NAN } else { -1.0 });
    assert!(weights(&mask, &Image::new(SIZE[0], SIZE[1], Pixels::F32(numbers.collect()))).is_none());
}

#[test]
fn weights_have_same_bits_for_any_threads() {
    let team = Team::new("test", 3).unwrap();
    let image = picture(|u, v| if u > 90.0 && v > 40.0 { 5.0 } else { 120.0 });
    for mask in [fan(), Mask::full(SIZE[0], SIZE[1])] {
        let mut made = PictureWeights::new(&ShadowWeights::default(), &mask, PIXEL_MM, &nodes(), [1.0; 2]).unwrap();
        let alone = made.of(&image, Simd::detect(), Sharing::Alone).unwrap().pairs.clone();
        for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
            let shared = made.of(&image, simd, Sharing::of(team.as_ref())).unwrap();
            assert!(shared.pairs == alone, "{}", simd.name());
        }
    }
}

#[test]
fn numbers_out_of_range_are_named() {
    let usual = ShadowWeights::default();
    assert_eq!(usual.beyond(), None);
    for (settings, says) in [
        (ShadowWeights { tail_mm: f64::NAN, ..usual }, "tails"),
        (ShadowWeights { beams: 0, ..usual }, "beams"),
        (ShadowWeights { level: 1.5, ..usual }, "level"),
        (ShadowWeights { width: 0.0, ..usual }, "transition"),
    ] {
        assert!(settings.beyond().is_some_and(|(name, ..)| name.contains(says)), "{settings:?}");
    }
}
