//! The N's among a phantom's wires, found by geometry and not by names.

use std::ops::Range;

use glam::DVec3;

use super::wire::Wire;

/// Largest angle between parallel wires, rad: about 1°. Phantoms are printed or drilled to a
/// tenth of that.
pub const PARALLEL_RAD: f64 = 0.02;
/// Least angle between an N's slanted wire and the others, rad: below it the slanted wire's dot
/// hardly determines the place of the cut.
const LEAST_SLANT_RAD: f64 = 0.05;
/// Largest distance of an N's wires from one plane, mm.
const PLANE_MM: f64 = 0.5;

/// Two parallel wires and a slanted one in their plane, which crosses both lines.
#[derive(Debug, Clone, PartialEq)]
pub struct Nwire {
    /// Indices of the parallel wires in the phantom's list, in its order.
    pub outer: [usize; 2],
    /// Index of the wire between them.
    pub middle: usize,
    /// The points of the middle wire's line nearest to each outer wire's line, mm; the
    /// crossings, if the wires are in one plane.
    pub crossings_mm: [DVec3; 2],
}

impl Nwire {
    /// Returns the N that three wires of the list make, if they make one.
    pub(super) fn of(wires: &[Wire], pattern: Range<usize>) -> Option<Self> {
        let [a, b, c] = <[usize; 3]>::try_from(pattern.collect::<Vec<_>>()).ok()?;
        let angle = |i: usize, j: usize| wires[i].direction().cross(wires[j].direction()).length().asin();
        let orders = [([a, c], b), ([a, b], c), ([b, c], a)];
        let (outer, middle) = orders.into_iter().find(|(outer, middle)| {
            angle(outer[0], outer[1]) <= PARALLEL_RAD
                && outer.iter().all(|&wire| angle(wire, *middle) >= LEAST_SLANT_RAD)
        })?;
        let crossings_mm = outer.map(|wire| crossing(&wires[middle], &wires[wire]));
        let in_plane =
            crossings_mm.iter().zip(outer).all(|(crossing, wire)| wires[wire].nearest(*crossing).0 <= PLANE_MM);
        in_plane.then_some(Self { outer, middle, crossings_mm })
    }

    /// Returns the cut of the middle wire, mm, from its dot's share of the way between the
    /// first and the second outer wire's dots. Exact for parallel outer wires.
    pub fn middle_mm(&self, share: f64) -> DVec3 {
        self.crossings_mm[0].lerp(self.crossings_mm[1], share)
    }
}

/// Returns the point of the first wire's line that is nearest to the second's. They are not
/// parallel.
fn crossing(first: &Wire, second: &Wire) -> DVec3 {
    let (d, e) = (first.direction(), second.direction());
    let between = second.ends_mm[0] - first.ends_mm[0];
    let cosine = d.dot(e);
    let along = (between.dot(d) - cosine * between.dot(e)) / (1.0 - cosine * cosine);
    first.ends_mm[0] + along * d
}

#[cfg(test)]
mod tests {
    use super::super::geometry::tests::three_ns;
    use super::*;

    #[test]
    fn n_is_found_in_any_wire_order() {
        let phantom = three_ns();
        let found = phantom.nwires();
        assert_eq!(
            found.iter().map(|n| (n.outer, n.middle)).collect::<Vec<_>>(),
            [([0, 2], 1), ([3, 5], 4), ([6, 8], 7)]
        );
        let wires = phantom.wires();
        for order in [[1, 0, 2], [0, 2, 1], [2, 1, 0]] {
            let turned: Vec<_> = order.iter().map(|&i| wires[i].clone()).collect();
            let n = Nwire::of(&turned, 0..3).unwrap();
            assert_eq!(turned[n.middle].name, "1b");
        }
    }

    #[test]
    fn plane_cut_divides_middle_wire_like_dots() {
        let phantom = three_ns();
        for n in phantom.nwires() {
            // A plane oblique to everything.
            let (normal, at) = (DVec3::new(0.2, 0.9, -0.3).normalize(), DVec3::new(33.0, 17.0, 4.0));
            let cut = |wire: usize| {
                let wire = &phantom.wires()[wire];
                let (from, d) = (wire.ends_mm[0], wire.direction());
                from + d * ((at - from).dot(normal) / d.dot(normal))
            };
            let [first, second] = n.outer.map(cut);
            let middle = cut(n.middle);
            let share = first.distance(middle) / first.distance(second);
            assert!(n.middle_mm(share).distance(middle) < 1e-12);
        }
    }

    #[test]
    fn three_other_wires_are_no_n() {
        let wires = three_ns().wires().to_vec();
        let with = |change: fn(&mut Vec<Wire>)| {
            let mut three = wires[..3].to_vec();
            change(&mut three);
            Nwire::of(&three, 0..3)
        };
        assert!(with(|_| ()).is_some());
        assert!(with(|w| w[1].ends_mm = w[1].ends_mm.map(|end| end + DVec3::Z)).is_none(), "out of their plane");
        assert!(with(|w| w[1].ends_mm[1].x = 40.0).is_none(), "all parallel");
        assert!(with(|w| w[2].ends_mm[1].x += 3.0).is_none(), "none parallel");
        assert!(Nwire::of(&wires, 0..4).is_none() && Nwire::of(&wires, 0..2).is_none());
    }
}
