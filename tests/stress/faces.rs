//! Tests of cells between bricks: each ends in up to seven other bricks, and must be visible
//! even if its own brick is empty.

use render::camera::View;
use render::{Cache, RenderSettings, Renderer, reference};

use crate::figures::{Sheet, Test};
use crate::pictures::{Field, fog, millimetres, other_bits, whole};

pub(crate) fn tests() -> Vec<Test> {
    vec![Test::new(
        "34",
        "a voxel beside a brick's face, edge or corner is seen from all 26 bricks around it, and gone when it is gone",
        around,
    )]
}

/// The directions in which a brick has neighbours.
fn directions() -> impl Iterator<Item = [i64; 3]> {
    (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1]).filter(|d| *d != [0; 3])
}

/// One voxel at that side of brick (1, 1, 1): its cells on that side begin or end in the
/// neighbouring brick. The render region holds 3³ bricks.
fn body(direction: [i64; 3]) -> [i64; 3] {
    direction.map(|d| match d {
        -1 => 8,
        0 => 11,
        _ => 15,
    })
}

fn around(sheet: &mut Sheet) {
    let views = [(0.0, 0.0), (90.0, 0.0), (0.0, 90.0), (41.0, 23.0)];
    let (mut worst, mut dropped, mut left, mut beyond) = (0.0_f64, 0, 0, u32::MAX);
    let mut differ = 0;
    for direction in directions() {
        let at = body(direction);
        let only = Field { low: [0; 3], high: [23; 3], value: |voxel: [i64; 3]| (voxel == at).then_some(1.0) };
        let none = Field { low: [0; 3], high: [23; 3], value: |_: [i64; 3]| None };
        let region = only.region(millimetres());
        let mut outside = 0;
        for (azimuth, elevation) in views {
            let view = View { azimuth, elevation, ..View::default() };
            // Several rays and samples per cell.
            let settings = RenderSettings { view, step: 0.5, ..whole([80, 80], fog(0.6)) };
            let exact = reference::render(&only, &settings, &region).unwrap();
            let mut first = None;
            for cache in [Cache::TwoLevel, Cache::None] {
                let mut renderer = Renderer::new(&RenderSettings { cache, ..settings.clone() }, region).unwrap();
                renderer.update(&only, &[[1, 1, 1]]);
                let picture = renderer.picture();
                worst = worst.max(exact.difference(&picture)[0]);
                let seen = |x: f64| x < 1.0 - 1e-6;
                let pairs = exact.pixels.iter().zip(&picture.pixels);
                dropped += pairs.filter(|(exact, p)| seen(exact[3]) && p[3] == 1.0).count();
                differ += other_bits(&picture, first.get_or_insert_with(|| picture.clone()));
                renderer.update(&none, &[[1, 1, 1]]);
                left += renderer.picture().pixels.iter().filter(|p| **p != [0.0, 0.0, 0.0, 1.0]).count();
            }
            // Samples beyond the voxel in that direction, in the reference; the renderer must
            // have found them.
            let camera = render::camera::Camera::new(&view, settings.size, settings.step, &region).unwrap();
            let voxel = glam::DVec3::from_array(std::array::from_fn(|a| (at[a] - region.first()[a]) as f64));
            for number in 0..80 * 80 {
                let ray = camera.ray(number % 80, number / 80);
                for k in 0..camera.samples() {
                    let off = ray.base + ray.step * f64::from(k) - voxel;
                    let there = (0..3).all(|a| off[a].abs() < 0.9 && off[a] * direction[a] as f64 >= 0.0)
                        && (0..3).all(|a| direction[a] == 0 || off[a].abs() > 0.05);
                    outside += u32::from(there);
                }
            }
        }
        beyond = beyond.min(outside);
    }
    sheet.above("fewest samples on the far side of a face, edge or corner", f64::from(beyond), 20.0);
    sheet.at_most("off the reference, all directions and views", worst, 1e-5);
    sheet.equal("pixels that see nothing where the reference does", dropped, 0);
    sheet.equal("pixels of other bits in another cache", differ, 0);
    sheet.equal("pixels that still see it when it is gone", left, 0);
}
