//! How a phantom's wires lie to each other, as far as the picture of a plane shows it.

use glam::{DVec2, DVec3};

use crate::phantom::nwire::PARALLEL_RAD;
use crate::phantom::{Geometry, Wire};

/// How far four parallel wires spread across the line through them at least, of how far along it: with less no affine map is told from another.
const LEAST_DEPTH: f64 = 0.03;

/// A phantom's wires, ready to be recognised.
#[derive(Debug, Clone)]
pub struct Layout {
    geometry: Geometry,
    /// The wires that are parallel to each other.
    posts: Vec<Post>,
    ns: Vec<N>,
    pairs: Vec<Pair>,
}

/// One of the parallel wires.
#[derive(Debug, Clone, Copy)]
pub(super) struct Post {
    /// Among the phantom's.
    pub(super) wire: usize,
    /// Where it is, seen along it, mm.
    pub(super) at: DVec2,
}

/// An N among parallel wires.
#[derive(Debug, Clone, Copy)]
pub(super) struct N {
    /// Its parallel wires, among the posts.
    pub(super) outer: [usize; 2],
    /// Its slanted one, among the phantom's wires.
    pub(super) middle: usize,
    /// How far apart the parallel ones are, mm.
    pub(super) width_mm: f64,
}

/// Two N's whose four posts, in the order first's and second's, are not in line: what takes their dots to the affine map between them.
#[derive(Debug, Clone)]
pub(super) struct Pair {
    /// Among the N's.
    pub(super) ns: [usize; 2],
    /// The map's columns by dots: x, y and shift.
    pub(super) inverse: [[f64; 4]; 3],
    /// The combination of dots that is zero for every affine map; of length 1.
    pub(super) test: [f64; 4],
}

impl Layout {
    /// Of a phantom.
    ///
    /// # Errors
    /// [`Unsuitable`]: with these wires dots could not be told from each other.
    pub fn new(geometry: Geometry) -> Result<Self, Unsuitable> {
        let found = geometry.nwires();
        let wires = geometry.wires();
        let Some(first) = found.first() else { return Err(Unsuitable::NoN { wires: wires.len() }) };
        let direction = wires[first.outer[0]].direction();
        let parallel = |wire: usize| wires[wire].direction().cross(direction).length().asin() <= PARALLEL_RAD;
        if let Some(other) = found.iter().find(|n| !parallel(n.outer[0])) {
            let name = |wire: usize| wires[wire].name.clone();
            return Err(Unsuitable::Turned { first: name(first.outer[0]), other: name(other.outer[0]) });
        }
        let (x, y) = direction.any_orthonormal_pair();
        let across = |at: DVec3| DVec2::new(at.dot(x), at.dot(y));
        let posts: Vec<Post> = (0..wires.len())
            .filter(|&wire| parallel(wire))
            .map(|wire| Post { wire, at: across(0.5 * (wires[wire].ends_mm[0] + wires[wire].ends_mm[1])) })
            .collect();
        let post = |wire: usize| posts.iter().position(|post| post.wire == wire);
        let ns: Vec<N> = found
            .iter()
            .filter_map(|n| {
                let outer = [post(n.outer[0])?, post(n.outer[1])?];
                let width_mm = posts[outer[0]].at.distance(posts[outer[1]].at);
                Some(N { outer, middle: n.middle, width_mm })
            })
            .collect();
        let places = (0..ns.len()).flat_map(|i| (i + 1..ns.len()).map(move |j| [i, j]));
        let pairs: Vec<Pair> = places.filter_map(|two| Pair::of(two, &ns, &posts)).collect();
        if pairs.is_empty() {
            return Err(Unsuitable::Flat { ns: ns.len() });
        }
        Ok(Self { geometry, posts, ns, pairs })
    }

    /// The same wires, so many times as large; `None` where no phantom is of that size.
    pub(super) fn scaled(&self, factor: f64) -> Option<Self> {
        let wire = |wire: &Wire| Wire { ends_mm: wire.ends_mm.map(|end| end * factor), ..wire.clone() };
        let patterns = self.geometry.patterns().map(|p| self.geometry.wires()[p].iter().map(wire).collect()).collect();
        Self::new(Geometry::new(self.geometry.name(), patterns, Vec::new()).ok()?).ok()
    }

    /// The phantom.
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

    /// Where u points in the phantom when it is scanned as its file has it: along the N's, from the last wire to the first.
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
        // The roots of the moments: how far the posts lie from one line, and along it.
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
        // The shift is that of the posts' own zero.
        let [x, y, shift] = inverse;
        inverse[2] = std::array::from_fn(|dot| shift[dot] - centre.x * x[dot] - centre.y * y[dot]);
        // What the map leaves of a dot that alone is off: each dot's share is a multiple of the one combination.
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

/// Why dots of a phantom could not be told from each other.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Unsuitable {
    /// No three wires make an N.
    #[error(
        "of the phantom's {wires} wires no pattern of three makes an N (two parallel wires and one aslant between them, in one plane); is this the file of an N-wire phantom?"
    )]
    NoN {
        /// How many there are.
        wires: usize,
    },
    /// N's whose parallel wires are not parallel to those of others.
    #[error(
        "the N's of the phantom are turned to each other ({first} is not parallel to {other}); N's with parallel wires are recognised"
    )]
    Turned {
        /// A wire.
        first: String,
        /// One that is not parallel to it.
        other: String,
    },
    /// One N, or several in one plane.
    #[error(
        "the phantom has {ns} N, or N's in one plane only; two N's in different planes at least are needed to tell their dots from each other"
    )]
    Flat {
        /// How many there are.
        ns: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::phantom::tests::three_ns;

    #[test]
    fn four_dots_give_the_affine_map_and_one_test() {
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
    fn phantoms_whose_dots_cannot_be_told_apart_are_refused() {
        let wires = three_ns().wires().to_vec();
        let refusal = |patterns: Vec<Vec<Wire>>| {
            Layout::new(Geometry::new("", patterns, Vec::new()).unwrap()).unwrap_err().to_string()
        };
        let posts = vec![wires[0].clone(), wires[2].clone(), wires[3].clone()];
        assert!(refusal(vec![posts]).contains("of the phantom's 3 wires no pattern of three makes an N"));
        assert!(refusal(vec![wires[..3].to_vec()]).contains("the phantom has 1 N"));
        let turned = |wire: &Wire| {
            let ends_mm = wire.ends_mm.map(|end| DVec3::new(end.y, end.x, end.z));
            Wire { ends_mm, ..wire.clone() }
        };
        let second = wires[3..6].iter().map(turned).collect();
        assert!(refusal(vec![wires[..3].to_vec(), second]).contains("1a is not parallel to 2a"));
    }
}
