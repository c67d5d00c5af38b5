//! Figure 12 with ours beside it: a doll in a water tank, its simulated echoes reconstructed and
//! rendered.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use phantom::body::{Met, doll};
use phantom::{Motion, Scanner};
use render::Mode;
use render::camera::View;
use render::classify::transfer::Transfer;
use render::mode::Shading;

use crate::bedside::{Bedside, Sweep, middle_and_ninth, shown};
use crate::report::Report;

/// Distance of slices, mm: "roughly 2 mm interval".
const GAP_MM: f64 = 2.0;
/// Voxel spacing, mm.
const SPACING_MM: f64 = 1.0;
/// Depths that are rendered, mm: below the transducer's ringing, above the floor.
const SHOWN_MM: [f64; 2] = [14.0, 85.0];
/// Grey level of the doll's surface.
const SURFACE: f64 = 70.0;

pub(crate) fn draw(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let frames = (doll::SWEEP_MM / GAP_MM) as u32;
    let sweep = Sweep { motion: Motion::Jittered, frames, gap_mm: GAP_MM, image_size: [320, 256] };
    let scanner = Scanner::abdominal(105.0).in_water();
    let bedside = Bedside::new(doll::doll(), scanner, &sweep, DVec3::splat(SPACING_MM))?;
    let transfer = Transfer::preset("tissue", [0.0, 255.0])?;
    // A slice through hands and belly.
    let z = -10.0;
    let [slice, opacity] = bedside.slice(z, &transfer)?;
    let region = bedside.region(SHOWN_MM)?;
    let front = View { azimuth: 0.0, elevation: 0.0, ..View::default() };
    let aside = View { azimuth: 35.0, elevation: 15.0, ..View::default() };
    let [rendered, turned] =
        [front, aside].map(|view| bedside.rendered(region, view, Mode::Shaded(Shading::Voxel), &transfer));
    let rendered = rendered?;

    let surface = surface(&bedside);
    let [middle, ninth] =
        middle_and_ninth(surface.iter().map(|[_, _, true_mm, found]| (found - true_mm).abs()).collect());
    report.check(surface.len() > 400, format!("figure 12: the doll's front is found at only {} places", surface.len()));
    report.check(
        middle < 0.8 && ninth < 2.5,
        format!("figure 12: the front is off by {middle} mm, nine tenths by {ninth}"),
    );
    let water: Vec<f64> = water(&bedside);
    let clear = water.iter().map(|v| v.abs()).sum::<f64>() / water.len() as f64;
    report
        .check(water.len() > 1000 && clear < 6.0, format!("figure 12: water shows {clear} at {} places", water.len()));
    let truth = bedside.met(&region, &front, |name| name == "rubber" || name == "eyes")?;
    let opaque: Vec<bool> = rendered.pixels.iter().map(|p| p[3] < 0.5).collect();
    let count = |f: &dyn Fn(bool, bool) -> bool| truth.iter().zip(&opaque).filter(|(t, o)| f(**t, **o)).count() as f64;
    let overlap = count(&|t, o| t && o) / count(&|t, o| t || o);
    report.check(overlap > 0.8, format!("figure 12: outlines overlap by {overlap} only"));

    let profile: Vec<[f64; 2]> =
        (20..=800).map(|k| 0.1 * f64::from(k)).filter_map(|y| Some([y, bedside.at(DVec3::new(0.0, y, z))?])).collect();
    let at_surface = first_surface(&bedside, 0.0, z).ok_or("the belly is in the way")?;
    let figure = Figure {
        id: "figure-12-doll",
        title: "Figure 12: a doll scanned in a water tank".into(),
        caption: format!(
            "Echoes as a curvilinear scanner of 3.5 MHz shows them, painted of {frames} nearly parallel slices with roughly {GAP_MM} mm interval, from feet to \
             head; reconstructed into voxels of {SPACING_MM} mm; x-y slice of the volume, of its opacities (by intensity and gradient), and the doll as rendered. \
             Bright at the top is the transducer's ringing, at the bottom the tank's floor, faint arcs below the doll are echoes that came again; neither of \
             the first two is rendered. The doll's front is off by {middle:.2} mm in the middle of {} places and by less than {ninth:.1} at nine tenths; outlines \
             overlap by {:.0} %; water shows {clear:.1} grey levels.",
            surface.len(),
            100.0 * overlap
        ),
        columns: 3,
        height: 230.0,
        panels: vec![
            Panel::picture("A painted slice near it", bedside.painted(((z + 0.5 * doll::SWEEP_MM) / GAP_MM) as u32)?),
            Panel::picture("The volume, x-y slice", slice),
            Panel::picture("Its opacities", opacity),
            Panel::picture("Rendered, from the front", shown(&rendered)?),
            Panel::picture("and from the side", shown(&turned?)?),
            Panel::new(
                "Down through the belly",
                Axis::linear("depth, mm").from_to(0.0, 80.0),
                Axis::linear("grey level").from_to(0.0, 255.0),
                vec![
                    Series::new("volume", SeriesStyle::Line, Ink::Blue, profile),
                    Series::new(
                        "the doll's true front",
                        SeriesStyle::Dashed,
                        Ink::Black,
                        vec![[at_surface, 0.0], [at_surface, 255.0]],
                    ),
                ],
            ),
        ],
    };
    report.figure(figure, folder)
}

/// Returns the depth of the doll's front at x and z, mm of the body, where the scanner sees it
/// from the front.
fn first_surface(bedside: &Bedside, x: f64, z: f64) -> Option<f64> {
    let (mut met, mut passages) = (Met::with_room_for(&bedside.body), Vec::new());
    bedside.body.trace(DVec3::new(x, 0.0, z), DVec3::Y, SHOWN_MM[1], &mut met, &mut passages);
    let first = passages.first()?;
    let solid = &bedside.body.solids[usize::from(first.solid)];
    let steep = solid.shape.normal(DVec3::new(x, first.at, z)).y < -0.75;
    steep.then_some(first.at)
}

/// Returns x, z, the true depth of the front, and the depth of the volume's brightest voxel, mm.
/// The search begins where the value first exceeds the surface's grey level.
fn surface(bedside: &Bedside) -> Vec<[f64; 4]> {
    let places = (-20..=20).flat_map(|i| (-40..=40).map(move |k| [2.0 * f64::from(i), 2.0 * f64::from(k)]));
    let found = |[x, z]: [f64; 2]| {
        let truth = first_surface(bedside, x, z)?;
        let mut depths = (140..850).map(|k| 0.1 * f64::from(k));
        let near = depths.find(|y| bedside.at(DVec3::new(x, *y, z)).is_some_and(|v| v > SURFACE))?;
        Some([x, z, truth, bedside.brightest([x, z], [near, near + 4.0])?])
    };
    places.filter_map(found).collect()
}

/// Returns the volume's values in the water between the ringing and the doll.
fn water(bedside: &Bedside) -> Vec<f64> {
    let at = |x: i32, y: i32, z: i32| DVec3::new(2.0 * f64::from(x), f64::from(y), 4.0 * f64::from(z));
    let places = (-12..=12).flat_map(|x| (13..=18).flat_map(move |y| (-19..=19).map(move |z| at(x, y, z))));
    places.filter_map(|p| bedside.at(p)).collect()
}
