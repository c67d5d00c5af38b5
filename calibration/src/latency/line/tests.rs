//! Detected lines against known ones, and frames without a line.

use super::*;
use crate::tests::noise::Noise as Random;

const WIDTH: usize = 400;
const HEIGHT: usize = 320;
/// Columns and rows of the scanner's image; the rest is an unused border.
const DATA: [[usize; 2]; 2] = [[90, 330], [20, 300]];

/// Renders a floor's echo: speckled, of varying thickness, with a tail below, under a static
/// ruler and letters.
fn picture(random: &mut Random, floor: Option<(f64, f64)>, brightness: f64) -> Vec<u8> {
    let mut pixels = vec![0_u8; WIDTH * HEIGHT];
    let [columns, rows] = DATA;
    // Speckle is correlated over some columns.
    let mut speckle = [0.0; 16];
    for u in columns[0]..columns[1] {
        if u % 6 == 0 {
            speckle = std::array::from_fn(|_| 0.3 + random.uniform());
        }
        for v in rows[0]..rows[1] {
            let mut grey = 4.0 * random.uniform();
            if let Some((row, slope)) = floor {
                let off = v as f64 - row - slope * (u as f64 - 210.0);
                let thick = 3.0 + (u as f64 * 0.05).sin();
                let echo = (-(off / thick).powi(2)).exp() + if off > 0.0 { 0.25 * (-off / 12.0).exp() } else { 0.0 };
                grey += brightness * echo * speckle[(off / 3.0 + 8.0).clamp(0.0, 15.0) as usize];
            }
            pixels[v * WIDTH + u] = grey.clamp(0.0, 255.0) as u8;
        }
    }
    for v in (20..300).step_by(10) {
        pixels[v * WIDTH + 340..v * WIDTH + 350].fill(255);
    }
    // A static line across the whole frame, brighter than any floor.
    pixels[310 * WIDTH..311 * WIDTH].fill(255);
    pixels
}

fn finder(random: &mut Random) -> Finder {
    let mut still = None;
    for k in 0..12 {
        let pixels = picture(random, Some((60.0 + 15.0 * f64::from(k), 0.02 * f64::from(k))), 150.0);
        let view = GreyView::packed([WIDTH, HEIGHT], &pixels).unwrap();
        match &mut still {
            None => still = Some(Still::new(&view)),
            Some(still) => assert!(still.add(&view)),
        }
    }
    Finder::new(still.unwrap())
}

#[test]
fn floor_is_found_to_subpixel_at_any_tilt_and_brightness() {
    let mut random = Random::new(2);
    let mut finder = finder(&mut random);
    let mut worst: (f64, f64) = (0.0, 0.0);
    let mut squares = 0.0;
    let cases: Vec<(f64, f64, f64)> = (0..60)
        .map(|_| (80.0 + 160.0 * random.uniform(), 0.9 * (random.uniform() - 0.5), 30.0 + 180.0 * random.uniform()))
        .collect();
    for (row, slope, brightness) in &cases {
        let pixels = picture(&mut random, Some((*row, *slope)), *brightness);
        let line = finder.find(&GreyView::packed([WIDTH, HEIGHT], &pixels).unwrap()).unwrap();
        // The tail draws the centre down by a constant amount; the test checks its constancy.
        let below = line.below(DVec2::new(210.0, *row)) - 0.6;
        worst = (worst.0.max(below.abs()), worst.1.max((line.angle_deg() - slope.atan().to_degrees()).abs()));
        squares += below * below;
        assert!(line.columns[0] < 110.0 && line.columns[1] > 300.0 && line.scatter_px < 2.0, "{line:?}");
    }
    let rms = (squares / cases.len() as f64).sqrt();
    println!("{worst:?} rms {rms}");
    assert!(rms < 0.4 && worst.0 < 1.2 && worst.1 < 0.6, "{worst:?} {rms}");
}

#[test]
fn frame_without_floor_has_no_line() {
    let mut random = Random::new(4);
    let mut finder = finder(&mut random);
    for _ in 0..50 {
        let pixels = picture(&mut random, None, 0.0);
        assert_eq!(finder.find(&GreyView::packed([WIDTH, HEIGHT], &pixels).unwrap()), Err(NoLine::Scattered));
    }
    // A blob, however bright, is no line; a black frame has none either.
    let mut pixels = picture(&mut random, None, 0.0);
    for v in 140..160 {
        pixels[v * WIDTH + 200..v * WIDTH + 222].fill(255);
    }
    assert_eq!(finder.find(&GreyView::packed([WIDTH, HEIGHT], &pixels).unwrap()), Err(NoLine::Scattered));
    assert_eq!(
        finder.find(&GreyView::packed([WIDTH, HEIGHT], &vec![0; WIDTH * HEIGHT]).unwrap()),
        Err(NoLine::Nothing)
    );
}

#[test]
fn static_line_is_no_floor() {
    let mut random = Random::new(6);
    let pixels = picture(&mut random, Some((150.0, 0.1)), 200.0);
    let view = GreyView::packed([WIDTH, HEIGHT], &pixels).unwrap();
    let mut finder = Finder::new(Still::new(&view));
    assert_eq!(finder.find(&view), Err(NoLine::Nothing));
    assert!(!Still::new(&view).add(&GreyView::packed([WIDTH / 2, 2 * HEIGHT], &pixels).unwrap()));
}

#[test]
fn distance_below_point_is_signed() {
    let line = Line { point_px: DVec2::new(10.0, 20.0), direction: DVec2::X, columns: [0.0, 20.0], scatter_px: 0.0 };
    assert_eq!((line.below(DVec2::new(3.0, 15.0)), line.below(DVec2::new(3.0, 22.0))), (5.0, -2.0));
    let steep = Line { direction: DVec2::new(1.0, 1.0).normalize(), ..line };
    assert!((steep.angle_deg() - 45.0).abs() < 1e-12);
}

/// [`Finder::best_shear`] one pixel at a time.
fn plain_best_shear(finder: &Finder) -> Option<(f64, f64)> {
    let [width, height] = finder.size;
    let centre = 0.5 * (width as f64 - 1.0);
    let steps = (STEEPEST * centre).ceil() as i32;
    let mut best = (0.0, None);
    for slope in (-steps..=steps).map(|step| f64::from(step) / centre.max(1.0)) {
        for middle in 0..height {
            let mut sum = 0.0_f32;
            for u in 0..width {
                let v = middle as f64 + (slope * (u as f64 - centre)).round();
                if (0.0..height as f64).contains(&v) {
                    sum += finder.outstanding[u * height + v as usize];
                }
            }
            if sum > best.0 {
                best = (sum, Some((middle as f64, slope)));
            }
        }
    }
    best.1
}

#[test]
fn best_line_equals_plain_search_in_frames_of_any_shape() {
    let mut random = Random::new(9);
    for size in [[WIDTH, HEIGHT], [600, 40], [40, 600], [7, 7], [1, 300], [300, 1]] {
        let mut pixels = || -> Vec<u8> { (0..size[0] * size[1]).map(|_| (255.0 * random.uniform()) as u8).collect() };
        let (still, pixels) = (pixels(), pixels());
        let mut finder = Finder::new(Still::new(&GreyView::packed(size, &still).unwrap()));
        // Noise shows no floor; the best line is found before that is decided.
        assert!(finder.find(&GreyView::packed(size, &pixels).unwrap()).is_err(), "{size:?}");
        assert_eq!(finder.best_shear(), plain_best_shear(&finder), "{size:?}");
    }
}
