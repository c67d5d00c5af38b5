//! A region between three pairs of parallel planes: the part of the volume that a slice
//! changed.

use glam::{DMat3, DVec3};

/// Two parallel planes and the space between them: `low ≤ normal·x ≤ high`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faces {
    /// Unit normal.
    pub normal: DVec3,
    /// The nearer plane's distance from the origin along the normal.
    pub low: f64,
    /// The farther plane's distance.
    pub high: f64,
}

/// An oblique box in voxel indices, given by its faces; a voxel counts by its centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prism {
    /// Its pairs of faces.
    pub faces: [Faces; 3],
}

impl Prism {
    /// Returns the region in which three affine functions of the voxel lie within limits. Each
    /// function is given as its value at voxel 0 and its steps along x, y and z. `None` if a
    /// function is constant, depends on the others, or is not finite.
    pub fn between(functions: [(f64, DVec3); 3], limits: [[f64; 2]; 3]) -> Option<Self> {
        let faces: [Faces; 3] = std::array::from_fn(|a| {
            let ((base, step), [low, high]) = (functions[a], limits[a]);
            let length = step.length();
            Faces { normal: step / length, low: (low - base) / length, high: (high - base) / length }
        });
        let sound = |f: &Faces| f.normal.is_finite() && f.low.is_finite() && f.high.is_finite() && f.low <= f.high;
        let [x, y, z] = faces.map(|f| f.normal);
        let volume = DMat3::from_cols(x, y, z).determinant().abs();
        (faces.iter().all(sound) && volume > 1e-9).then_some(Self { faces })
    }

    /// Returns the same region on a lattice with `offset` added to voxel indices.
    #[must_use]
    pub fn shifted(&self, offset: [i64; 3]) -> Self {
        let offset = DVec3::from_array(offset.map(|x| x as f64));
        let faces = self.faces.map(|f| {
            let moved = f.normal.dot(offset);
            Faces { low: f.low + moved, high: f.high + moved, ..f }
        });
        Self { faces }
    }

    /// Whether a voxel lies inside, or at most `slack` outside a face.
    #[inline]
    pub fn holds(&self, voxel: [i64; 3], slack: f64) -> bool {
        let at = DVec3::from_array(voxel.map(|x| x as f64));
        self.faces.iter().all(|f| (f.low - slack..=f.high + slack).contains(&f.normal.dot(at)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prism_holds_voxels_within_function_limits() {
        let functions =
            [(1.0, DVec3::new(0.5, 0.1, 0.0)), (-2.0, DVec3::new(0.0, 2.0, 0.3)), (0.0, DVec3::new(0.1, -0.2, 0.9))];
        // No voxel lies on a face, since rounding would decide there.
        let limits = [[0.013, 4.013], [-8.017, 8.017], [-1.017, 1.517]];
        let prism = Prism::between(functions, limits).unwrap();
        let moved = prism.shifted([-3, 2, -5]);
        let mut inside = 0;
        for place in 0..20_i64.pow(3) {
            let voxel = [place % 20, place / 20 % 20, place / 400].map(|x| x - 10);
            let at = DVec3::from_array(voxel.map(|x| x as f64));
            let within = (0..3).all(|a| {
                let value = functions[a].0 + functions[a].1.dot(at);
                (limits[a][0]..=limits[a][1]).contains(&value)
            });
            assert_eq!(prism.holds(voxel, 0.0), within, "{voxel:?}");
            assert_eq!(moved.holds([voxel[0] - 3, voxel[1] + 2, voxel[2] - 5], 1e-12), within, "{voxel:?}");
            inside += u32::from(within);
        }
        assert!(inside > 100, "{inside}");
    }

    #[test]
    fn flat_or_not_finite_gives_no_prism() {
        let [x, y, z] = [DVec3::X, DVec3::Y, DVec3::Z];
        let unit = [[0.0, 1.0]; 3];
        assert!(Prism::between([(0.0, x), (0.0, y), (0.0, z)], unit).is_some());
        assert!(Prism::between([(0.0, x), (0.0, y), (0.0, x + y)], unit).is_none());
        assert!(Prism::between([(0.0, x), (0.0, DVec3::ZERO), (0.0, z)], unit).is_none());
        assert!(Prism::between([(0.0, x), (f64::NAN, y), (0.0, z)], unit).is_none());
        assert!(Prism::between([(0.0, x), (0.0, y), (0.0, z)], [[0.0, 1.0], [1.0, 0.0], [0.0, 1.0]]).is_none());
    }
}
