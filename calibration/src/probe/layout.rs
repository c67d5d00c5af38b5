//! Arrangement of a phantom's wires, as far as an image plane shows it.

use glam::{DVec2, DVec3};

use crate::error::{CalibrationError, ProbeError};
use crate::phantom::find_nwires::PARALLEL_RAD;
use crate::phantom::{Geometry, Nwire, Wire};

/// Minimum ratio of four parallel wires' spread across their common line to that along it.
/// Below it affine maps cannot be distinguished.
const LEAST_DEPTH: f64 = 0.03;

/// A phantom's wires, prepared for recognition.
#[derive(Debug, Clone)]
pub struct Layout {
    geometry: Geometry,
    /// The wires that are parallel to each other.
    posts: Vec<Post>,
    ns: Vec<N>,
    /// Pairs of N's; empty if the N's lie in one plane.
    pairs: Vec<Pair>,
}

/// Minimum number of dots to recognise two N's: both complete.
const DOTS_OF_TWO: usize = 6;
/// Minimum number of dots to recognise a single N.
const DOTS_OF_ONE: usize = 3;

/// One of the parallel wires.
#[derive(Debug, Clone, Copy)]
pub(super) struct Post {
    /// Index among the phantom's wires.
    pub(super) wire: usize,
    /// Position, seen along it, mm.
    pub(super) at: DVec2,
}

/// An N among parallel wires.
#[derive(Debug, Clone, Copy)]
pub(super) struct N {
    /// Indices of its parallel wires among the posts.
    pub(super) outer: [usize; 2],
    /// Index of its slanted wire among the phantom's wires.
    pub(super) middle: usize,
    /// Distance of the parallel wires, mm.
    pub(super) width_mm: f64,
    /// Positions of the slanted wire's two ends, as shares of the way from the first post to
    /// the second.
    pub(super) ends: [f64; 2],
}

/// Two N's whose four posts are not in line, and the linear map from their dots to the affine
/// map. The posts are in the order of both N's.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    /// Indices of the N's.
    pub(super) ns: [usize; 2],
    /// The affine map's columns as combinations of dots: x, y and shift.
    pub(super) inverse: [[f64; 4]; 3],
    /// The combination of dots that is zero for every affine map; of length 1.
    pub(super) test: [f64; 4],
}

impl Layout {
    /// Prepares a phantom.
    ///
    /// # Errors
    /// [`ProbeError`]: the dots of these wires are indistinguishable.
    pub fn new(geometry: Geometry) -> Result<Self, CalibrationError> {
        let found = geometry.nwires();
        let alike = Self::parallel_to(&geometry, &found);
        // N's that are turned to each other cannot be recognised together. Those of the best
        // direction are; the others follow once the plane is known.
        let of = |first: &Nwire| Self::along(geometry.clone(), &found, geometry.wires()[first.outer[0]].direction());
        let better = |a: Self, b: Self| {
            let rank = |layout: &Self| (!layout.is_flat(), layout.ns.len());
            if rank(&b) > rank(&a) { b } else { a }
        };
        let wires = geometry.wires().len();
        alike.iter().map(|first| of(&found[*first])).reduce(better).ok_or(ProbeError::NoN { wires }.into())
    }

    /// Returns the first N of each direction.
    fn parallel_to(geometry: &Geometry, found: &[Nwire]) -> Vec<usize> {
        let wires = geometry.wires();
        let mut firsts: Vec<usize> = Vec::new();
        for (number, n) in found.iter().enumerate() {
            let own = |first: &usize| are_parallel(&wires[found[*first].outer[0]], wires[n.outer[0]].direction());
            if !firsts.iter().any(own) {
                firsts.push(number);
            }
        }
        firsts
    }

    /// Prepares the wires along a direction, and their N's.
    fn along(geometry: Geometry, found: &[Nwire], direction: DVec3) -> Self {
        let wires = geometry.wires();
        let (x, y) = direction.any_orthonormal_pair();
        let across = |at: DVec3| DVec2::new(at.dot(x), at.dot(y));
        let posts: Vec<Post> = (0..wires.len())
            .filter(|&wire| are_parallel(&wires[wire], direction))
            .map(|wire| Post { wire, at: across(0.5 * (wires[wire].ends_mm[0] + wires[wire].ends_mm[1])) })
            .collect();
        let post = |wire: usize| posts.iter().position(|post| post.wire == wire);
        let ns: Vec<N> = found
            .iter()
            .filter_map(|n| {
                let outer = [post(n.outer[0])?, post(n.outer[1])?];
                let width_mm = posts[outer[0]].at.distance(posts[outer[1]].at);
                let [from, to] = outer.map(|post| posts[post].at);
                let ends = wires[n.middle].ends_mm.map(|end| (across(end) - from).dot(to - from) / width_mm.powi(2));
                Some(N { outer, middle: n.middle, width_mm, ends })
            })
            .collect();
        let places = (0..ns.len()).flat_map(|i| (i + 1..ns.len()).map(move |j| [i, j]));
        let pairs: Vec<Pair> = places.filter_map(|two| Pair::of(two, &ns, &posts)).collect();
        Self { geometry, posts, ns, pairs }
    }

    /// Returns whether the N's lie in one plane, or there is only one. The dots are then in
    /// line, and the side cannot be recognised in an image.
    pub fn is_flat(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Returns the number of wires used for recognition.
    pub fn searched_wires(&self) -> usize {
        self.posts.len() + self.ns.len()
    }

    /// Returns the minimum number of dots for recognition.
    pub fn least_dots(&self) -> usize {
        if self.ns.len() == 1 { DOTS_OF_ONE } else { DOTS_OF_TWO }
    }

    /// Returns the same wires, scaled; `None` if the size is implausible.
    pub(super) fn scaled(&self, factor: f64) -> Option<Self> {
        let wire = |wire: &Wire| Wire { ends_mm: wire.ends_mm.map(|end| end * factor), ..wire.clone() };
        let patterns = self.geometry.patterns().map(|p| self.geometry.wires()[p].iter().map(wire).collect()).collect();
        Self::new(Geometry::new(self.geometry.name(), patterns, Vec::new()).ok()?).ok()
    }

    /// Returns the phantom.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    pub(super) fn posts(&self) -> &[Post] {
        &self.posts
    }

    pub(super) fn ns(&self) -> &[N] {
        &self.ns
    }

    pub(super) fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// Returns the direction of u in the phantom when scanned as its file assumes: along the
    /// N's, from the last wire to the first.
    pub fn rightwards(&self) -> DVec3 {
        let wires = self.geometry.wires();
        let sum: DVec3 = self
            .ns
            .iter()
            .map(|n| {
                let [first, last] = n.outer.map(|post| &wires[self.posts[post].wire]);
                0.5 * (first.ends_mm[0] + first.ends_mm[1] - last.ends_mm[0] - last.ends_mm[1])
            })
            .sum();
        sum.normalize_or_zero()
    }
}

impl Pair {
    fn of(ns: [usize; 2], all: &[N], posts: &[Post]) -> Option<Self> {
        let [a, b] = ns.map(|n| all[n].outer);
        let at = [a[0], a[1], b[0], b[1]].map(|post| posts[post].at);
        let centre = at.into_iter().sum::<DVec2>() / 4.0;
        let mut moments = [[0.0; 3]; 3];
        let rows = at.map(|at| [at.x - centre.x, at.y - centre.y, 1.0]);
        for row in rows {
            for i in 0..3 {
                (0..3).for_each(|j| moments[i][j] += row[i] * row[j]);
            }
        }
        // Roots of the moments: the posts' spread across and along their common line.
        let [[xx, xy, _], [_, yy, _], _] = moments;
        let apart = ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt();
        let [least, most] = [0.5 * (xx + yy - apart), 0.5 * (xx + yy + apart)];
        if least <= LEAST_DEPTH * LEAST_DEPTH * most {
            return None;
        }
        let mut inverse = [[0.0; 4]; 3];
        for (dot, row) in rows.iter().enumerate() {
            let column = super::plane::solve(moments, *row)?;
            (0..3).for_each(|i| inverse[i][dot] = column[i]);
        }
        // Refers the shift to the posts' own origin.
        let [x, y, shift] = inverse;
        inverse[2] = std::array::from_fn(|dot| shift[dot] - centre.x * x[dot] - centre.y * y[dot]);
        // The residual of a single displaced dot. For every dot it is a multiple of the same
        // combination.
        let residual = |off: usize| -> [f64; 4] {
            std::array::from_fn(|dot| {
                let fit = at[dot].x * inverse[0][off] + at[dot].y * inverse[1][off] + inverse[2][off];
                if dot == off { 1.0 - fit } else { -fit }
            })
        };
        let length = |v: &[f64; 4]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let test = (0..4).map(residual).max_by(|a, b| length(a).total_cmp(&length(b)))?;
        let norm = length(&test);
        let test = test.map(|x| x / norm);
        Some(Self { ns, inverse, test })
    }
}

/// Returns whether a wire is parallel to a direction.
fn are_parallel(wire: &Wire, direction: DVec3) -> bool {
    wire.direction().cross(direction).length().asin() <= PARALLEL_RAD
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::geometry::tests::three_ns;

    #[test]
    fn four_dots_give_affine_map_and_one_test() {
        let layout = Layout::new(three_ns()).unwrap();
        assert_eq!((layout.posts().len(), layout.ns().len(), layout.pairs().len()), (6, 3, 3));
        let map = |at: DVec2| DVec2::new(3.0 * at.x - 0.5 * at.y + 40.0, 0.25 * at.x + 4.0 * at.y - 7.0);
        for pair in layout.pairs() {
            let [a, b] = pair.ns.map(|n| layout.ns()[n].outer);
            let posts = [a[0], a[1], b[0], b[1]].map(|post| layout.posts()[post].at);
            let by = |weights: &[f64; 4]| (0..4).map(|i| weights[i] * map(posts[i])).sum::<DVec2>();
            let [x, y, shift] = [0, 1, 2].map(|i| by(&pair.inverse[i]));
            for (found, truth) in [(x, [3.0, 0.25]), (y, [-0.5, 4.0]), (shift, [40.0, -7.0])] {
                assert!(found.distance(DVec2::from_array(truth)) < 1e-10, "{found} {truth:?}");
            }
            assert!(by(&pair.test).length() < 1e-10);
            assert!((pair.test.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-12);
        }
        assert!(layout.rightwards().distance(DVec3::NEG_X) < 1e-12);
    }

    #[test]
    fn phantom_without_n_is_refused() {
        let wires = three_ns().wires().to_vec();
        let refusal =
            |patterns: Vec<Vec<Wire>>| Layout::new(Geometry::new("", patterns, Vec::new()).unwrap()).unwrap_err();
        let posts = vec![wires[0].clone(), wires[2].clone(), wires[3].clone()];
        assert_eq!(refusal(vec![posts]), ProbeError::NoN { wires: 3 }.into());
    }

    #[test]
    fn flat_and_crossed_ns_are_accepted() {
        let wires = three_ns().wires().to_vec();
        let layout = |patterns: Vec<Vec<Wire>>| Layout::new(Geometry::new("", patterns, Vec::new()).unwrap()).unwrap();
        let shape = |layout: &Layout| (layout.is_flat(), layout.ns().len(), layout.least_dots());
        assert_eq!(shape(&layout(vec![wires[..3].to_vec()])), (true, 1, 3));
        let beside = |wire: &Wire| Wire {
            name: format!("{}'", wire.name),
            ends_mm: wire.ends_mm.map(|end| end + DVec3::X * 30.0),
        };
        let row = layout(vec![wires[..3].to_vec(), wires[..3].iter().map(beside).collect()]);
        assert_eq!(shape(&row), (true, 2, 6));
        assert_eq!(shape(&layout(three_ns().patterns().map(|p| wires[p].to_vec()).collect())), (false, 3, 6));
        let turned = |wire: &Wire| {
            let ends_mm = wire.ends_mm.map(|end| DVec3::new(end.y, end.x, end.z));
            Wire { ends_mm, ..wire.clone() }
        };
        // The two layers of one direction are used, not the single layer of the other direction
        // that comes first.
        let first: Vec<Wire> = wires[..3].iter().map(turned).collect();
        let mixed = layout(vec![first, wires[3..6].to_vec(), wires[6..].to_vec()]);
        assert_eq!(shape(&mixed), (false, 2, 6));
        assert_eq!(mixed.ns().iter().map(|n| n.middle).collect::<Vec<_>>(), [4, 7]);
        let crossed = layout(vec![wires[..3].to_vec(), wires[3..6].iter().map(turned).collect()]);
        assert_eq!((shape(&crossed), crossed.ns()[0].middle), ((true, 1, 3), 1));
    }
}
