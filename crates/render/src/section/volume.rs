//! Samples of a volume in a plane.

use glam::DVec3;

use simd::sharing::Sharing;
use simd::team::Team;

use super::Sampled;
use super::plane::{Box3, Section};
pub use volume::Values;

/// Work done for planes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize)]
pub struct PlanarWork {
    /// Pixels of the planes.
    pub pixels: u64,
    /// Pixels outside the volume's box; nothing was read for them.
    pub pixels_outside: u64,
    /// Voxels read.
    pub voxels_read: u64,
}

impl std::ops::AddAssign for PlanarWork {
    fn add_assign(&mut self, other: Self) {
        self.pixels += other.pixels;
        self.pixels_outside += other.pixels_outside;
        self.voxels_read += other.voxels_read;
    }
}

/// Reads planes of a volume.
pub struct Planar<'a, V: Values + ?Sized> {
    /// Voxels by the indices of `place`.
    pub volume: &'a V,
    /// Their box; nothing is read beyond it.
    pub place: Box3,
    /// Threads that share the rows; any number gives the same result.
    pub team: Option<&'a Team>,
}

impl<V: Values + ?Sized> Planar<'_, V> {
    /// Samples the pixels of a section, row by row.
    pub fn sample(&self, section: &Section) -> (Vec<Sampled>, PlanarWork) {
        let mut pixels = vec![Sampled::UNSEEN; section.pixels()];
        let mut works = vec![PlanarWork::default(); section.size[1] as usize];
        let width = section.size[0].max(1) as usize;
        Sharing::of(self.team).chunks_beside(&mut pixels, width, &mut works, |work, j, row| {
            // There are fewer than 2³² rows.
            self.row(section, j as u32, [0, section.size[0]], row, work);
        });
        let mut work = PlanarWork::default();
        works.into_iter().for_each(|w| work += w);
        (pixels, work)
    }

    /// Samples the pixels from `low` to `high`, both inclusive, of a section again, with the
    /// same bits as [`Self::sample`]; `pixels` holds all of them, row by row. Returns whether
    /// any pixel changed.
    pub fn sample_again(&self, section: &Section, [low, high]: [[u32; 2]; 2], pixels: &mut [Sampled]) -> bool {
        let (width, mut work, mut is_other) = (section.size[0], PlanarWork::default(), false);
        let mut row = vec![Sampled::UNSEEN; width as usize];
        for j in low[1]..=high[1].min(section.size[1].saturating_sub(1)) {
            let range = [low[0].min(width), width.min(high[0].saturating_add(1))];
            let of_row = range.map(|i| i as usize);
            row[of_row[0]..of_row[1]].fill(Sampled::UNSEEN);
            self.row(section, j, range, &mut row, &mut work);
            let from = j as usize * width as usize;
            let (new, old) = (&row[of_row[0]..of_row[1]], &mut pixels[from + of_row[0]..from + of_row[1]]);
            is_other |= new != old;
            old.copy_from_slice(new);
        }
        is_other
    }

    fn row(&self, section: &Section, j: u32, range: [u32; 2], pixels: &mut [Sampled], work: &mut PlanarWork) {
        let lattice_from_world = self.place.lattice_from_world();
        let base = lattice_from_world.transform_point3(section.at(0, j));
        let step = lattice_from_world.transform_vector3(section.right);
        let [from, to] = range;
        let mut range = range;
        for a in 0..3 {
            let (low, high) = (self.place.low[a] as f64 - 1.0, self.place.high[a] as f64 + 1.0);
            range = Section::between(range, base[a], step[a], low, high);
        }
        work.pixels += u64::from(to - from);
        work.pixels_outside += u64::from((to - from) - (range[1] - range[0]));
        for i in range[0]..range[1] {
            let at = lattice_from_world.transform_point3(section.at(i, j));
            pixels[i as usize] = self.between(at, work);
        }
    }

    /// Interpolates trilinearly between those of the eight voxels about a place that were seen.
    fn between(&self, at: DVec3, work: &mut PlanarWork) -> Sampled {
        let floor = at.floor();
        let part = at - floor;
        let cell = floor.to_array().map(|x| x as i64);
        let (mut numerator, mut weights, mut seen) = (0.0, 0.0, 0.0);
        for line in 0..4_i64 {
            let (y, z) = (cell[1] + (line & 1), cell[2] + (line >> 1));
            let inside = |a: usize, index: i64| (self.place.low[a]..=self.place.high[a]).contains(&index);
            let across =
                if line & 1 == 1 { part.y } else { 1.0 - part.y } * if line >> 1 == 1 { part.z } else { 1.0 - part.z };
            if across == 0.0 || !(inside(1, y) && inside(2, z)) {
                continue;
            }
            let (mut value, mut weight) = ([0.0; 2], [0.0; 2]);
            self.volume.values([cell[0], y, z], &mut value, &mut weight);
            work.voxels_read += 2;
            for (dx, along) in [1.0 - part.x, part.x].into_iter().enumerate() {
                if weight[dx] > 0.0 && inside(0, cell[0] + dx as i64) {
                    let share = across * along;
                    numerator += share * f64::from(weight[dx]) * f64::from(value[dx]);
                    weights += share * f64::from(weight[dx]);
                    seen += share;
                }
            }
        }
        Sampled::of(numerator, weights, seen)
    }
}
