//! Reference implementation of planes, pixel by pixel in f64, without skipping. All other
//! implementations are compared with it.

use glam::DVec3;

use mask::Mask;
use sonoweave_core::slice::{Pixels, Slice};
use volume::Values;

use super::nearest::slice_from_world;
use super::plane::{Box3, Section};

/// A pixel: grey level, weight and seen share, like [`Sampled`](super::Sampled); all 0 if
/// unseen.
pub type Exact = [f64; 3];

/// Samples a volume's plane with the tent function of every contributing voxel.
pub fn of_volume(volume: &(impl Values + ?Sized), place: &Box3, section: &Section) -> Vec<Exact> {
    let to_lattice = place.lattice_from_world();
    pixels(section, |world| {
        let at = to_lattice.transform_point3(world);
        let (mut numerator, mut weight, mut share) = (0.0, 0.0, 0.0);
        let around = |a: usize| {
            let middle = at[a].round() as i64;
            (middle - 1).max(place.low[a])..=(middle + 1).min(place.high[a])
        };
        for z in around(2) {
            for y in around(1) {
                for x in around(0) {
                    let off = (at - DVec3::new(x as f64, y as f64, z as f64)).abs();
                    let tent: f64 = off.to_array().map(|d| (1.0 - d).max(0.0)).iter().product();
                    let (mut v, mut w) = ([0.0], [0.0]);
                    volume.values([x, y, z], &mut v, &mut w);
                    if w[0] > 0.0 {
                        numerator += tent * f64::from(w[0]) * f64::from(v[0]);
                        weight += tent * f64::from(w[0]);
                        share += tent;
                    }
                }
            }
        }
        if weight > 0.0 { [numerator / weight, weight, share] } else { [0.0; 3] }
    })
}

/// Samples the plane of the nearest slices, given oldest first as number, slice and its data.
/// Computes every slice's distance for every pixel.
pub fn of_slices(slices: &[(u64, Slice, Mask)], reach_mm: f64, section: &Section) -> Vec<Option<(u64, Exact)>> {
    pixels(section, |world| {
        let mut nearest: Option<(f64, u64, Exact)> = None;
        for (item, slice, mask) in slices {
            let Some(to_slice) = slice_from_world(slice.world_from_image) else { continue };
            let at = to_slice.transform_point3(world);
            let distance = at.z.abs();
            if distance > reach_mm || nearest.is_some_and(|(d, ..)| d <= distance) {
                continue;
            }
            let (mut sum, mut shares) = (0.0, 0.0);
            for v in 0..slice.image.height() {
                for u in 0..slice.image.width() {
                    let tent =
                        (1.0 - (at.x - f64::from(u)).abs()).max(0.0) * (1.0 - (at.y - f64::from(v)).abs()).max(0.0);
                    if tent > 0.0 && mask.contains(u, v) {
                        let place = (v * slice.image.width() + u) as usize;
                        let value = match slice.image.pixels() {
                            Pixels::U8(p) => f64::from(p[place]),
                            Pixels::U16(p) => f64::from(p[place]),
                            Pixels::F32(p) => f64::from(p[place]),
                        };
                        if value.is_finite() {
                            sum += tent * value;
                            shares += tent;
                        }
                    }
                }
            }
            // The compared samples are in single precision, which can round a share up to one
            // half.
            if shares >= super::SEEN_SHARE - 1e-8 {
                nearest = Some((distance, *item, [sum / shares, shares, shares]));
            }
        }
        nearest.map(|(_, item, exact)| (item, exact))
    })
}

fn pixels<T>(section: &Section, mut of: impl FnMut(DVec3) -> T) -> Vec<T> {
    let [width, height] = section.size;
    (0..height).flat_map(|j| (0..width).map(move |i| (i, j))).map(|(i, j)| of(section.at(i, j))).collect()
}
