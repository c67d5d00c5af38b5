//! One canonical form for all descriptions of a lattice. Which voxel has index 0 is a
//! convention, and a file's differs from that of the volume it was made from.

use glam::{DAffine3, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};

use super::brick::{BrickIndex, EDGE, VOXELS};
use super::read::{Values, lines};

/// Resolution of a lattice's position, in fractions of a voxel. It is much finer than a
/// rendered view shows, and much coarser than rounding between descriptions of one lattice.
const PARTS: f64 = 1_048_576.0;
/// Fraction of a voxel from which a lattice counts as that of the next one. Users place
/// lattices at halves and thirds of a voxel, but none at this fraction.
const UP: f64 = 0.512_345_678_9;

/// A lattice whose voxel (0, 0, 0) is the one next to the world's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Canonical {
    /// Maps voxel indices to world mm. Descriptions with the same axes that differ only in
    /// which voxel is (0, 0, 0) give the same bits.
    pub world_from_lattice: Transform<World, Volume>,
    /// A voxel's canonical index minus its index in the given description.
    pub offset: [i64; 3],
}

/// Splits the position of a lattice into whole voxels, which go into the indices, and a
/// remainder of less than a voxel, rounded to 2⁻²⁰ voxel.
///
/// The axes are unchanged. A lattice through the world's origin has no remainder. For other
/// lattices, the remainder may lie so near the middle between two roundings that the file's
/// decimals round to the other side. At positions 10⁵ voxels from the origin this happens for
/// one in ten thousand; its rendered view is then up to 10⁻⁶ voxel off.
pub fn canonical(world_from_lattice: Transform<World, Volume>) -> Canonical {
    let affine = world_from_lattice.affine();
    let at = affine.matrix3.inverse() * affine.translation;
    let whole = (at + UP).floor();
    // Adding 0 turns a negative zero into a positive one.
    let rest = ((at - whole) * PARTS).round() / PARTS + DVec3::ZERO;
    let translation = affine.matrix3 * rest;
    Canonical {
        world_from_lattice: Transform::from_affine(DAffine3 { matrix3: affine.matrix3, translation }),
        // Saturates beyond 64 bits and for NaN: no box lies there.
        offset: whole.to_array().map(|x| x as i64),
    }
}

impl Canonical {
    /// Returns the canonical index of a voxel given by its index in the description.
    #[inline]
    pub fn index(&self, voxel: [i64; 3]) -> [i64; 3] {
        std::array::from_fn(|a| voxel[a].saturating_add(self.offset[a]))
    }
}

/// A volume with an offset added to its voxel indices.
#[derive(Clone, Copy)]
pub struct Shifted<'a, V: Values + ?Sized> {
    volume: &'a V,
    offset: [i64; 3],
}

impl<'a, V: Values + ?Sized> Shifted<'a, V> {
    /// Returns the volume with `offset` added to its voxel indices.
    pub fn new(volume: &'a V, offset: [i64; 3]) -> Self {
        Self { volume, offset }
    }
}

impl<V: Values + ?Sized> Values for Shifted<'_, V> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        self.volume.values(std::array::from_fn(|a| start[a] - self.offset[a]), value, weight);
    }

    fn brick(&self, brick: BrickIndex, value: &mut [f32; VOXELS], weight: &mut [f32; VOXELS]) {
        let edge = EDGE as i64;
        let given: [_; 3] =
            std::array::from_fn(|a| i32::try_from(i64::from(brick[a]) - self.offset[a].div_euclid(edge)));
        match given {
            // A whole brick of the volume is read faster than its lines.
            [Ok(x), Ok(y), Ok(z)] if self.offset.iter().all(|o| o % edge == 0) => {
                self.volume.brick([x, y, z], value, weight);
            }
            _ => lines(self, brick, value, weight),
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let given: Vec<BrickIndex> = self.volume.bricks().collect();
        let mut bricks = Vec::new();
        shift(&given, self.offset, &mut bricks);
        Box::new(bricks.into_iter())
    }
}

/// Computes the bricks that hold the voxels of `bricks` after adding an offset to their
/// indices, each once. For an offset of whole bricks, they stay in the given order. They
/// replace the content of `shifted`.
pub fn shift(bricks: &[BrickIndex], offset: [i64; 3], shifted: &mut Vec<BrickIndex>) {
    let edge = EDGE as i64;
    shifted.clear();
    let ends = offset.map(|o| [o.div_euclid(edge), (o + edge - 1).div_euclid(edge)]);
    for brick in bricks {
        let place = |a: usize, end: usize| i32::try_from(i64::from(brick[a]) + ends[a][end]);
        for corner in 0..8 {
            let end = [corner & 1, corner >> 1 & 1, corner >> 2];
            if (0..3).any(|a| end[a] == 1 && ends[a][0] == ends[a][1]) {
                continue;
            }
            // No volume has voxels beyond that range.
            if let (Ok(x), Ok(y), Ok(z)) = (place(0, end[0]), place(1, end[1]), place(2, end[2])) {
                shifted.push([x, y, z]);
            }
        }
    }
    if shifted.len() > bricks.len() {
        shifted.sort_unstable_by_key(|[x, y, z]| [*z, *y, *x]);
        shifted.dedup();
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::{DMat3, DQuat};
    use proptest::prelude::*;

    use super::*;
    use crate::{BrickVolume, Grid};

    fn bits(of: &Canonical) -> [u64; 12] {
        of.world_from_lattice.affine().to_cols_array().map(f64::to_bits)
    }

    /// Formats as decimals and parses again, as through a volume's header.
    fn printed(v: DVec3) -> DVec3 {
        DVec3::from_array(v.to_array().map(|x| x.to_string().parse().unwrap()))
    }

    fn lattice(turn: [f64; 3], spacing: [f64; 3], origin: DVec3) -> Grid {
        let turn = DQuat::from_scaled_axis(DVec3::from_array(turn));
        Grid { origin, spacing: DVec3::from_array(spacing), direction: DMat3::from_quat(turn), size: [1; 3] }
    }

    /// The same lattice with another first voxel, by way of a header.
    fn from_header(grid: &Grid, first: [i64; 3]) -> Grid {
        let origin = grid.world_from_volume().point(DVec3::from_array(first.map(|x| x as f64)));
        let axes = [grid.direction.x_axis, grid.direction.y_axis, grid.direction.z_axis].map(printed);
        Grid {
            origin: printed(origin),
            spacing: printed(grid.spacing),
            direction: DMat3::from_cols(axes[0], axes[1], axes[2]),
            size: grid.size,
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]
        #[test]
        fn file_lattice_equals_volume_lattice_bit_for_bit(
            turn in proptest::array::uniform3(-3.0..3.0f64),
            spacing in proptest::array::uniform3(0.05..3.0f64),
            origin in proptest::array::uniform3(-1e4..1e4f64),
            first in proptest::array::uniform3(-20_000..20_000i64),
        ) {
            let given = lattice(turn, spacing, DVec3::from_array(origin));
            // Closer to the middle between two roundings, decimals are not precise enough.
            let parts = given.world_from_volume().inverse().point(DVec3::ZERO) * PARTS;
            prop_assume!(parts.to_array().iter().all(|x| (x - x.floor() - 0.5).abs() > 1e-3));
            let (a, b) = (canonical(given.world_from_volume()), canonical(from_header(&given, first).world_from_volume()));
            prop_assert_eq!(bits(&a), bits(&b));
            prop_assert_eq!(a.index(first), b.index([0; 3]));
            // It is the given lattice.
            let apart = a.world_from_lattice.point(DVec3::from_array(a.index(first).map(|x| x as f64)))
                - given.world_from_volume().point(DVec3::from_array(first.map(|x| x as f64)));
            prop_assert!(apart.length() < 1e-6 * given.spacing.length(), "{:?}", apart);
        }
    }

    #[test]
    fn lattices_at_even_voxel_fractions_agree() {
        for turn in [[0.0; 3], [0.3, -1.2, 0.7]] {
            for spacing in [0.1, 0.2, 0.3, 0.5, 0.7, 1.0] {
                for parts in [2.0, 3.0, 4.0, 5.0, 8.0, 10.0, 100.0] {
                    for n in -12..12 {
                        let origin = DVec3::new(1.0, -1.0, 3.0) * (f64::from(n) * spacing / parts);
                        let given = lattice(turn, [spacing; 3], origin);
                        let first = [i64::from(n) * 977, -31, 5];
                        let a = canonical(given.world_from_volume());
                        let b = canonical(from_header(&given, first).world_from_volume());
                        assert_eq!((bits(&a), a.index(first)), (bits(&b), b.index([0; 3])), "{spacing} {parts} {n}");
                    }
                }
            }
        }
    }

    #[test]
    fn lattice_through_world_origin_has_no_remainder() {
        let given = lattice([0.2, 0.1, -0.4], [0.5, 0.3, 0.2], DVec3::ZERO);
        let far = from_header(&given, [-4000, 17, 123]);
        let found = canonical(far.world_from_volume());
        assert_eq!((found.world_from_lattice.affine().translation, found.offset), (DVec3::ZERO, [-4000, 17, 123]));
        assert!(found.world_from_lattice.affine().translation.to_array().iter().all(|x| x.is_sign_positive()));
    }

    #[test]
    fn shifted_voxels_lie_in_listed_bricks() {
        let mut volume = BrickVolume::new();
        volume.reserve(1).unwrap();
        let (slot, _) = volume.find_or_insert([1, -1, 0]);
        let brick = volume.brick_mut(slot);
        let voxels = || (0..512_i64).map(|i| [i % 8, i / 8 % 8, i / 64]);
        for [x, y, z] in voxels() {
            let place = crate::brick::offset(x as usize, y as usize, z as usize);
            (brick.r[place], brick.w[place]) = ((z * 64 + y * 8 + x) as f32, 2.0);
        }
        for offset in [[0, 0, 0], [8, -16, 0], [3, -5, 1], [0, 7, 0]] {
            let shifted = Shifted::new(&volume, offset);
            let bricks: Vec<BrickIndex> = shifted.bricks().collect();
            let named: BTreeSet<BrickIndex> = bricks.iter().copied().collect();
            assert_eq!(named.len(), bricks.len());
            let mut holding = BTreeSet::new();
            for [x, y, z] in voxels() {
                let at = [8 + x + offset[0], -8 + y + offset[1], z + offset[2]];
                let (mut value, mut weight) = ([0.0], [0.0]);
                shifted.values(at, &mut value, &mut weight);
                assert_eq!((value[0], weight[0]), ((z * 64 + y * 8 + x) as f32 / 2.0, 2.0));
                holding.insert(at.map(|i| i.div_euclid(8) as i32));
            }
            assert_eq!(named, holding, "{offset:?}");
            for brick in shifted.bricks() {
                let ([mut value, mut weight], [mut by_line, mut weight_by_line]) =
                    ([[0.0; VOXELS]; 2], [[0.0; VOXELS]; 2]);
                shifted.brick(brick, &mut value, &mut weight);
                lines(&shifted, brick, &mut by_line, &mut weight_by_line);
                assert!(value == by_line && weight == weight_by_line, "{offset:?} {brick:?}");
            }
        }
    }
}
