//! Figure 13 with ours beside it: a thigh, 46 slices of 512×480 inserted into about 128³ voxels,
//! half as many slices as there should be.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle};

use phantom::body::thigh::{self, ARTERY, ARTERY_RADII_MM, FEMUR, FEMUR_RADIUS_MM};
use phantom::{Motion, Scanner};
use render::Mode;
use render::camera::View;
use render::classify::transfer::{Colour, Curve, Opacity, Transfer};
use render::mode::Shading;

use crate::bedside::{Bedside, Sweep, middle_and_ninth, shown};
use crate::report::Report;

const SLICES: u32 = 46;
/// Voxels along each axis.
const VOXELS: f64 = 128.0;
/// Depth of the frames, and the rendered depths, which begin below skin and fascia, mm.
const DEPTH_MM: f64 = 120.0;
const SHOWN_MM: [f64; 2] = [27.0, 112.0];
/// Radius of the transducer, mm.
const FACE_MM: f64 = 60.0;

pub(crate) fn draw(report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let gap_mm = thigh::SWEEP_MM / f64::from(SLICES - 1);
    let sweep = Sweep { motion: Motion::Freehand, frames: SLICES, gap_mm, image_size: [512, 480] };
    let scanner = Scanner::abdominal(DEPTH_MM);
    let [wide, high] = scanner.transducer.extent_mm(DEPTH_MM);
    // Tilts and the kernel reach beyond the sweep.
    let spacing = DVec3::new(wide + 8.0, high + 8.0, thigh::SWEEP_MM + 16.0) / VOXELS;
    let bedside = Bedside::new(thigh::thigh(FACE_MM), scanner, &sweep, spacing)?;
    let (low, top) = bedside.reconstructor.volume().seen_bounds().ok_or("nothing was seen")?;
    let size = [0, 1, 2].map(|a| top[a] - low[a] + 1);
    report.check(size.iter().all(|n| (105..=145).contains(n)), format!("figure 13: {size:?} voxels"));

    let femur = femur(&bedside);
    let [middle, ninth] = middle_and_ninth(femur.iter().map(|f| (f.found - f.depth).abs()).collect());
    report.check(femur.len() > 100, format!("figure 13: the femur is seen at only {} places", femur.len()));
    report.check(
        middle < 1.5 && ninth < 3.0,
        format!("figure 13: the femur is off by {middle} mm, nine tenths by {ninth}"),
    );
    let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
    let [lit, shadow] = [
        femur.iter().filter_map(|f| f.before).collect::<Vec<_>>(),
        femur.iter().flat_map(|f| f.behind).flatten().collect(),
    ];
    let dark = mean(&shadow) / mean(&lit);
    report
        .check(shadow.len() > 100 && dark < 0.4, format!("figure 13: the shadow shows {dark} of what lies before it"));
    let [lumen, wall] = artery(&bedside);
    let tube = mean(&lumen) / mean(&wall);
    report.check(lumen.len() > 20 && tube < 0.6, format!("figure 13: blood shows {tube} of its vessel's wall"));
    let unseen = unseen(&bedside, gap_mm);
    report.check(unseen == 0.0, format!("figure 13: a part of {unseen} between the slices was not seen"));

    // Muscle has grey values of about 100, and is to be transparent.
    let echoes = Curve::new(&[(112.0, 0.0), (135.0, 0.4), (165.0, 0.95)])?;
    let transfer = Transfer::new(Opacity::Curve(echoes), 1.0, Colour::grey([0.0, 150.0])?)?;
    let region = bedside.region(SHOWN_MM)?;
    let front = View { azimuth: 0.0, elevation: 0.0, roll: 90.0, ..View::default() };
    let rendered = bedside.rendered(region, front, Mode::Shaded(Shading::Voxel), &transfer)?;
    let turned = bedside.rendered(
        region,
        View { azimuth: 35.0, elevation: 25.0, ..front },
        Mode::Shaded(Shading::Voxel),
        &transfer,
    )?;
    let [slice, _] = bedside.slice(0.0, &transfer)?;
    let profile = |x: f64| -> Vec<[f64; 2]> {
        (0..1150).map(|k| 0.1 * f64::from(k)).filter_map(|y| Some([y, bedside.at(DVec3::new(x, y, 0.0))?])).collect()
    };
    let figure = Figure {
        id: "figure-13-thigh",
        title: "Figure 13: a thigh with femur and vessels".into(),
        caption: format!(
            "a) One of {SLICES} slices of 512×480, painted: nearly along the thigh, up is its front, right its upper end. The femur's near surface shines and throws a \
             strong shadow; right and below of it are an artery and its vein. b) The same plane of the volume of {}×{}×{} voxels. c), d) The part of the thigh \
             below {} mm, from the front (up is the upper end) and turned. Slices lie {gap_mm:.2} mm apart, two σ of the kernel: half as many as there should be, and yet \
             no place between them is unseen. The femur is off by {middle:.2} mm in the middle of {} places, its shadow shows {:.0} % of what lies before it, and blood \
             {:.0} % of its vessel's wall.",
            size[0],
            size[1],
            size[2],
            SHOWN_MM[0],
            femur.len(),
            100.0 * dark,
            100.0 * tube
        ),
        columns: 2,
        height: 330.0,
        panels: vec![
            Panel::picture("a) A painted slice", bedside.painted(SLICES / 2)?),
            Panel::picture("b) The volume in about the same plane", slice),
            Panel::picture("c) Rendered, from the front", shown(&rendered)?),
            Panel::picture("d) and turned", shown(&turned)?),
            Panel::new(
                "Down through the femur, and beside it",
                Axis::linear("depth, mm").from_to(0.0, 115.0),
                Axis::linear("grey level").from_to(0.0, 255.0),
                vec![
                    Series::new("through the femur", SeriesStyle::Line, Ink::Vermilion, profile(-40.0)),
                    Series::new("through the artery", SeriesStyle::Line, Ink::Blue, profile(45.0)),
                ],
            ),
        ],
    };
    report.figure(figure, folder)
}

/// A position on the femur's near surface, along y.
struct Near {
    /// True depth, and that of the brightest voxel within 8 mm, mm.
    depth: f64,
    found: f64,
    /// The volume's values 8 mm before it, and 18 and 26 mm behind.
    before: Option<f64>,
    behind: [Option<f64>; 2],
}

fn femur(bedside: &Bedside) -> Vec<Near> {
    let [from, to] = FEMUR.map(DVec3::from_array);
    let along = (to - from).normalize();
    // The line of the surface nearest to the transducer: against y, across the axis.
    let up = (DVec3::NEG_Y + along * along.y).normalize();
    let aside = along.cross(up);
    let places = (20..=70).flat_map(|k| (-3..=3).map(move |j| [3.0 * f64::from(k), 0.12 * f64::from(j)]));
    let near = |[t, turn]: [f64; 2]| {
        let p = from + along * t + (up * turn.cos() + aside * turn.sin()) * FEMUR_RADIUS_MM;
        // Well within the fan at every rendered depth.
        if p.x.abs() > 32.0 {
            return None;
        }
        let at = |y: f64| bedside.at(DVec3::new(p.x, y, p.z));
        let found = bedside.brightest([p.x, p.z], [p.y - 8.0, p.y + 8.0])?;
        Some(Near { depth: p.y, found, before: at(p.y - 8.0), behind: [at(p.y + 18.0), at(p.y + 26.0)] })
    };
    places.filter_map(near).collect()
}

/// Returns the volume's values within the artery, and in its near and far wall, where the femur
/// does not hide it.
fn artery(bedside: &Bedside) -> [Vec<f64>; 2] {
    let [from, to] = ARTERY.map(DVec3::from_array);
    let [outer, inner] = ARTERY_RADII_MM;
    let along = (to - from).normalize();
    let up = (DVec3::NEG_Y + along * along.y).normalize();
    let shown = |p: DVec3| p.x > 25.0 && p.x < 65.0;
    let axis = |k: i32| from + along * f64::from(k);
    let lumen = (0..250).map(axis).filter(|p| shown(*p)).filter_map(|p| bedside.at(p));
    let wall = |side: f64| move |k: i32| axis(k) + up * (side * 0.5 * (outer + inner));
    let walls =
        (0..250).map(wall(1.0)).chain((0..250).map(wall(-1.0))).filter(|p| shown(*p)).filter_map(|p| bedside.at(p));
    [lumen.collect(), walls.collect()]
}

/// Returns the unseen share of the positions between the first and the last slice, well within
/// their fans.
fn unseen(bedside: &Bedside, gap_mm: f64) -> f64 {
    let half = 0.5 * thigh::SWEEP_MM - 6.0 * gap_mm;
    let steps = (2.0 * half / 0.25) as i32;
    let at = |x: i32, y: i32, z: i32| DVec3::new(6.0 * f64::from(x), 8.0 * f64::from(y), 0.25 * f64::from(z) - half);
    let places = (-3..=3).flat_map(|x| (2..=12).flat_map(move |y| (0..steps).map(move |z| at(x, y, z))));
    let seen: Vec<bool> = places.map(|p| bedside.at(p).is_some()).collect();
    seen.iter().filter(|s| !**s).count() as f64 / seen.len() as f64
}
