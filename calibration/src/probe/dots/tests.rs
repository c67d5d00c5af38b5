use super::*;
use crate::probe::layout::Layout;
use crate::probe::matching::Matcher;
use crate::tests::noise::Noise;
use crate::tests::wire_scans::{Imperfect, SIZE_PX, Scan};

/// Renders dots similar to those of a scanner: wider than high, on speckle, each with fainter
/// echoes below it, above a tank's floor.
pub(crate) fn painted(places: &[DVec2], speckle: f64, noise: &mut Noise) -> Vec<u8> {
    let [width, height] = SIZE_PX.map(|n| n as usize);
    let mut picture = vec![0.0_f64; width * height];
    // Speckle: amplitudes of a complex field with grains of a few pixels.
    let grains = [0, 1].map(|_| {
        let raw: Vec<f32> = (0..width * height).map(|_| noise.normal() as f32).collect();
        let mut smooth = raw;
        let mut row = Vec::new();
        (0..2).for_each(|_| binomial(&mut smooth, width, height, &mut row));
        smooth
    });
    for (at, grey) in picture.iter_mut().enumerate() {
        let amplitude = f64::from(grains[0][at]).hypot(f64::from(grains[1][at])) / 0.25;
        *grey = speckle * amplitude;
    }
    let mut spot = |centre: DVec2, height_grey: f64, size: [f64; 2]| {
        for v in 0..height {
            let y = (v as f64 - centre.y) / size[1];
            if y.abs() > 5.0 {
                continue;
            }
            for u in 0..width {
                let x = (u as f64 - centre.x) / size[0];
                picture[v * width + u] += height_grey * (-0.5 * (x * x + y * y)).exp();
            }
        }
    };
    for place in places {
        let bright = noise.between(110.0, 220.0);
        spot(*place, bright, [noise.between(4.0, 8.0), noise.between(2.5, 4.0)]);
        for echo in 1..3 {
            spot(*place + DVec2::new(0.0, 14.0 * f64::from(echo)), bright * 0.3_f64.powi(echo), [5.0, 2.5]);
        }
    }
    spot(DVec2::new(410.0, 560.0), 200.0, [150.0, 3.0]);
    picture.into_iter().map(|grey| grey.clamp(0.0, 255.0).round() as u8).collect()
}

fn view(pixels: &[u8]) -> GreyView<'_> {
    let [width, height] = SIZE_PX.map(|n| n as usize);
    GreyView::new(width, height, width, pixels).unwrap()
}

#[test]
fn dots_are_found_to_subpixel_on_speckle_and_echoes() {
    let mut noise = Noise::new(11);
    let scan = Scan::new(12, Imperfect::default(), &mut noise);
    let layout: &Layout = &scan.layout;
    let (mut finder, mut matcher) = (DotFinder::new(), Matcher::new());
    for (speckle, off_px) in [(0.0, 0.3), (6.0, 1.0)] {
        let (mut seen, mut read, mut squares) = (0, 0, 0.0);
        for sighting in &scan.sightings {
            let places: Vec<DVec2> = sighting.marks.iter().map(|mark| mark.at_px).collect();
            let pixels = painted(&places, speckle, &mut noise);
            let dots = finder.find(&view(&pixels), None).to_vec();
            for place in &places {
                let nearest = dots.iter().map(|dot| dot.at_px.distance(*place)).fold(f64::INFINITY, f64::min);
                seen += usize::from(nearest < 3.0);
            }
            let Some(reading) = matcher.read(&dots, SIZE_PX, layout) else { continue };
            assert!(reading.best.rightwards);
            for mark in &reading.best.marks {
                let truth = sighting.marks.iter().find(|other| other.wire == mark.wire).unwrap();
                let off = mark.at_px.distance(truth.at_px);
                read += usize::from(off < 3.0);
                squares += off.min(3.0).powi(2);
            }
        }
        let all = scan.sightings.iter().map(|s| s.marks.len()).sum::<usize>();
        let rms = (squares / read.max(1) as f64).sqrt();
        assert!(100 * seen >= 97 * all && 100 * read >= 95 * all, "{seen} {read} of {all}");
        assert!(rms < off_px, "{rms} with speckle {speckle}");
    }
}

#[test]
fn speckle_and_lines_are_no_dots() {
    let mut noise = Noise::new(12);
    let mut finder = DotFinder::new();
    let pixels = painted(&[], 8.0, &mut noise);
    let found = finder.find(&view(&pixels), None).len();
    let rings = finder.work().rings;
    assert!(rings > 1000 && 200 * found < rings, "{found} of {rings}");
    let black = vec![0; pixels.len()];
    assert!(finder.find(&view(&black), None).is_empty());
    assert_eq!(finder.work(), DotWork { smoothed: 670_824, rings: 0, weighed: 0 });
}

#[test]
fn spots_outside_clip_are_ignored() {
    let mut noise = Noise::new(13);
    let places = [DVec2::new(200.25, 150.5), DVec2::new(600.75, 300.0)];
    let pixels = painted(&places, 0.0, &mut noise);
    let mut finder = DotFinder::new();
    let near = |dots: &[Dot], place: DVec2| dots.iter().any(|dot| dot.at_px.distance(place) < 0.5);
    let all = finder.find(&view(&pixels), None).to_vec();
    assert!(near(&all, places[0]) && near(&all, places[1]), "{all:?}");
    let clip = ClipRect::new(100, 50, 300, 400).unwrap();
    let dots = finder.find(&view(&pixels), Some(clip));
    assert!(near(dots, places[0]) && !near(dots, places[1]), "{dots:?}");
}

#[test]
fn images_smaller_than_ring_have_no_dots() {
    let mut finder = DotFinder::new();
    for (width, height) in [(1, 1), (3, 40), (11, 11), (40, 2)] {
        let pixels = vec![200; width * height];
        assert!(finder.find(&GreyView::new(width, height, width, &pixels).unwrap(), None).is_empty());
    }
}
