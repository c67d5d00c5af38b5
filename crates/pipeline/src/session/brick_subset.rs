//! Copied bricks: those that some planes meet, so that planes are sampled while insertion
//! continues.

use glam::DVec3;
use rustc_hash::{FxHashMap, FxHashSet};

use render::section::{Box3, Section};
use volume::brick::{BrickIndex, EDGE, VOXELS};
use volume::read::{SEEN, Values};

/// Voxels of which the median weight is taken, about 1 ms.
const MEDIAN_OF: usize = 1 << 16;

/// A brick's values and weights, x fastest; 0 if unseen.
pub struct BrickCopy {
    /// Values, grey levels.
    pub value: [f32; VOXELS],
    /// Weights.
    pub weight: [f32; VOXELS],
}

impl BrickCopy {
    pub(super) fn of(volume: &impl Values, brick: BrickIndex) -> Box<Self> {
        let mut leaf = Self::unseen();
        volume.brick(brick, &mut leaf.value, &mut leaf.weight);
        leaf
    }

    /// Returns a brick of which nothing was seen.
    pub(super) fn unseen() -> Box<Self> {
        Box::new(Self { value: [0.0; VOXELS], weight: [0.0; VOXELS] })
    }
}

/// Copied bricks of a volume; empty elsewhere.
#[derive(Default)]
pub(super) struct BrickSubset {
    leaves: FxHashMap<BrickIndex, Box<BrickCopy>>,
}

impl BrickSubset {
    pub(super) fn put(&mut self, brick: BrickIndex, leaf: Box<BrickCopy>) {
        self.leaves.insert(brick, leaf);
    }

    pub(super) fn remove(&mut self, brick: BrickIndex) {
        self.leaves.remove(&brick);
    }

    pub(super) fn has(&self, brick: BrickIndex) -> bool {
        self.leaves.contains_key(&brick)
    }

    /// Keeps only bricks that meet one of these planes.
    pub(super) fn keep(&mut self, sheets: &[PlaneFootprint]) {
        self.leaves.retain(|brick, _| sheets.iter().any(|sheet| sheet.meets(*brick)));
    }

    pub(super) fn clear(&mut self) {
        self.leaves.clear();
    }

    pub(super) fn len(&self) -> usize {
        self.leaves.len()
    }

    /// Returns the median weight of the seen voxels, or of a sample of them in many bricks; 0 if
    /// there are none.
    pub(super) fn median_weight(&self) -> f32 {
        // An odd step meets all columns of a brick.
        let step = (self.leaves.len() * VOXELS / MEDIAN_OF) | 1;
        let weights = self.leaves.values().flat_map(|leaf| leaf.weight.iter().step_by(step));
        let mut seen: Vec<f32> = weights.copied().filter(|weight| *weight > SEEN).collect();
        let middle = seen.len() / 2;
        if seen.is_empty() { 0.0 } else { *seen.select_nth_unstable_by(middle, f32::total_cmp).1 }
    }

    /// Returns the memory of the copies, bytes.
    pub(super) fn bytes(&self) -> u64 {
        (self.leaves.len() * size_of::<BrickCopy>()) as u64
    }
}

impl Values for BrickSubset {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        assert_eq!(value.len(), weight.len(), "as many weights as values");
        let edge = EDGE as i64;
        let mut done = 0;
        while done < value.len() {
            let at = [start[0] + done as i64, start[1], start[2]];
            let within = at.map(|x| x.rem_euclid(edge) as usize);
            let count = (EDGE - within[0]).min(value.len() - done);
            let (to_value, to_weight) = (&mut value[done..done + count], &mut weight[done..done + count]);
            match brick_of(at).and_then(|brick| self.leaves.get(&brick)) {
                Some(leaf) => {
                    let from = (within[2] * EDGE + within[1]) * EDGE + within[0];
                    to_value.copy_from_slice(&leaf.value[from..from + count]);
                    to_weight.copy_from_slice(&leaf.weight[from..from + count]);
                }
                None => {
                    to_value.fill(0.0);
                    to_weight.fill(0.0);
                }
            }
            done += count;
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(self.leaves.keys().copied())
    }
}

/// Returns the brick of a voxel; `None` beyond the range of any volume.
fn brick_of(voxel: [i64; 3]) -> Option<BrickIndex> {
    let [x, y, z] = voxel.map(|x| i32::try_from(x.div_euclid(EDGE as i64)).ok());
    Some([x?, y?, z?])
}

/// All existing bricks.
pub(super) type Known = FxHashSet<BrickIndex>;

/// Footprint of a plane on the lattice: the bricks that its image depends on.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlaneFootprint {
    /// Map from voxels to the section's pixels, and a brick's half extent in pixels to the right
    /// and down.
    pixel: [(DVec3, f64); 2],
    span: [f64; 2],
    size: [u32; 2],
    /// The plane: its unit normal, and the offset along it in voxels.
    normal: DVec3,
    offset: f64,
    /// Half of a brick's extent across the plane, including the voxels interpolated with its
    /// own.
    reach: f64,
}

impl PlaneFootprint {
    pub(super) fn new(section: &Section, place: &Box3) -> Self {
        let lattice_from_world = place.lattice_from_world();
        let [right, down] = [section.right, section.down].map(|axis| lattice_from_world.transform_vector3(axis));
        let normal = right.cross(down).normalize_or_zero();
        let offset = normal.dot(lattice_from_world.transform_point3(section.first));
        // A voxel contributes up to one voxel from its centre; the margin covers rounding.
        let half = 0.5 * (EDGE as f64 - 1.0) + 1.0 + 1e-6;
        // The pixel index is a linear function of the world position, and that of the voxel
        // index.
        let world_from_lattice = place.world_from_lattice;
        let pixel = [section.right, section.down].map(|axis| {
            let per_mm = axis / axis.length_squared();
            let along = world_from_lattice.matrix3.transpose() * per_mm;
            (along, per_mm.dot(world_from_lattice.translation - section.first))
        });
        let span = pixel.map(|(along, _)| half * along.abs().element_sum());
        Self { pixel, span, size: section.size, normal, offset, reach: half * normal.abs().element_sum() }
    }

    /// Returns the first and last pixel to which a voxel of the brick can contribute, both
    /// inclusive; `None` if there is none.
    pub(super) fn pixels(&self, brick: BrickIndex) -> Option<[[u32; 2]; 2]> {
        let middle = middle(brick);
        let mut pixels = [[0; 2]; 2];
        for (k, (along, offset)) in self.pixel.into_iter().enumerate() {
            let at = along.dot(middle) + offset;
            let (low, high) = ((at - self.span[k]).floor(), (at + self.span[k]).ceil());
            if high < 0.0 || low > f64::from(self.size[k] - 1) {
                return None;
            }
            // Within the image, by the check above.
            (pixels[0][k], pixels[1][k]) = (low.max(0.0) as u32, high.min(f64::from(self.size[k] - 1)) as u32);
        }
        Some(pixels)
    }

    /// Returns whether a voxel of the brick can contribute to the plane's image.
    pub(super) fn meets(&self, brick: BrickIndex) -> bool {
        (self.normal.dot(middle(brick)) - self.offset).abs() <= self.reach
    }
}

/// Returns the middle of a brick, in voxel indices.
fn middle(brick: BrickIndex) -> DVec3 {
    DVec3::from_array(brick.map(|b| f64::from(b) * EDGE as f64 + 0.5 * (EDGE as f64 - 1.0)))
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DQuat};
    use sonoweave_core::frames::Transform;

    use super::*;
    use render::section::{Planar, Plane, Sampled};

    /// A box-shaped volume in which every third voxel is unseen.
    struct Painted([i64; 3]);

    impl Values for Painted {
        fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
            for (x, (value, weight)) in (start[0]..).zip(value.iter_mut().zip(weight)) {
                let at = [x, start[1], start[2]];
                let n = at[0] * 7 + at[1] * 31 + at[2] * 101;
                let seen = n % 3 != 0 && (0..3).all(|a| (0..self.0[a]).contains(&at[a]));
                (*value, *weight) = if seen { ((n % 253) as f32, 1.0 + (n % 5) as f32) } else { (0.0, 0.0) };
            }
        }

        fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
            let [x, y, z] = self.0.map(|n| ((n + 7) / 8) as i32);
            Box::new((0..x * y * z).map(move |n| [n % x, n / x % y, n / x / y]))
        }
    }

    #[test]
    fn median_weight_is_that_of_seen_voxels() {
        let mut subset = BrickSubset::default();
        assert_eq!(subset.median_weight(), 0.0);
        // A third of the voxels is unseen, more than a third has weight 2, the others have 5.
        for x in 0..400 {
            let mut leaf = Box::new(BrickCopy { value: [0.0; VOXELS], weight: [0.0; VOXELS] });
            let of = |at: usize| [0.0, 2.0, 5.0][(at + x) % 3];
            leaf.weight.iter_mut().enumerate().for_each(|(at, weight)| *weight = of(at));
            leaf.weight[VOXELS / 2..][..VOXELS / 4].fill(2.0);
            subset.put([x as i32, 0, 0], leaf);
            if x == 0 || x == 399 {
                assert_eq!(subset.median_weight(), 2.0, "of {} bricks", x + 1);
            }
        }
    }

    #[test]
    fn planes_of_copied_bricks_equal_those_of_the_volume() {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.3, -0.2, 0.5));
        let affine = DAffine3::from_scale_rotation_translation(DVec3::new(0.4, 0.5, 0.7), turn, DVec3::splat(3.7));
        let volume = Painted([67, 59, 41]);
        let place = Box3::new(Transform::from_affine(affine), [[0; 3], volume.0.map(|n| n - 1)]);
        let [x, y, z] = place.directions();
        for normal in [z, x, y * 0.6 + z * 0.8, DVec3::new(0.3, -0.5, 0.8), DVec3::new(1.0, 1.0, 0.1)] {
            let plane = Plane::new(place.middle() + DVec3::splat(0.31), normal, None).unwrap();
            let section = plane.cover(&place, 0.21, 300).unwrap();
            let sheet = PlaneFootprint::new(&section, &place);
            let all: Vec<BrickIndex> = volume.bricks().collect();
            let mut subset = BrickSubset::default();
            all.iter().for_each(|brick| subset.put(*brick, BrickCopy::of(&volume, *brick)));
            subset.keep(&[sheet]);
            assert!(subset.len() < all.len() / 2, "{} of {}", subset.len(), all.len());
            let (whole, _) = Planar { volume: &volume, place, team: None }.sample(&section);
            let (cut, _) = Planar { volume: &subset, place, team: None }.sample(&section);
            assert!(whole == cut && whole.iter().any(Sampled::is_seen), "{normal}");
            // Without its middle brick, the image differs.
            let at = place.lattice_from_world().transform_point3(plane.point).round().to_array().map(|x| x as i64);
            let middle = brick_of(at).unwrap();
            assert!(subset.has(middle));
            subset.remove(middle);
            let (mut without, _) = Planar { volume: &subset, place, team: None }.sample(&section);
            assert!(without != whole);
            // Sampling that brick's pixels again restores it.
            subset.put(middle, BrickCopy::of(&volume, middle));
            let planar = Planar { volume: &subset, place, team: None };
            let pixels = sheet.pixels(middle).unwrap();
            assert!(planar.sample_again(&section, pixels, &mut without) && without == whole);
            assert!(!planar.sample_again(&section, pixels, &mut without), "the same again is no other one");
            let [low, high] = pixels;
            assert!((0..2).all(|k| high[k] - low[k] < 70), "no more than about it: {pixels:?}");
            assert_eq!(sheet.pixels([4000, 4000, 4000]), None);
        }
    }
}
