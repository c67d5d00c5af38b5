//! Beams through a body: attenuation of sound on its way there and back.

use glam::{DAffine3, DVec3};

use super::scatter::amplitude;
use super::{Layout, Scanner};
use crate::body::{Body, Material, Met, Passage};

/// Losses in materials and at surfaces, according to a scanner's settings.
#[derive(Debug, Clone)]
pub(super) struct Loss {
    /// Round-trip loss per mm of each material, dB.
    db_per_mm: Vec<f64>,
    /// Whether surfaces remove the amplitude that they reflect.
    at_surfaces: bool,
}

impl Loss {
    pub(super) fn new(scanner: &Scanner, body: &Body) -> Self {
        let there_and_back = |m: &Material| 2.0 * 0.1 * m.attenuation * scanner.frequency_mhz;
        let db_per_mm =
            body.materials.iter().map(|m| if scanner.effects.attenuation { there_and_back(m) } else { 0.0 });
        Self { db_per_mm: db_per_mm.collect(), at_surfaces: scanner.effects.losses }
    }

    /// Returns the part of the amplitude that passes a surface on the way there and again on
    /// the way back.
    fn through(&self, body: &Body, passage: &Passage) -> f64 {
        let [from, to] = [passage.from, passage.to].map(|m| &body.materials[usize::from(m)]);
        let reflected = from.reflection(to);
        if self.at_surfaces { 1.0 - reflected * reflected } else { 1.0 }
    }
}

/// A straight path from the transducer, with all surfaces that it crosses.
#[derive(Debug, Clone, Default)]
pub(super) struct Way {
    met: Met,
    pub(super) passages: Vec<Passage>,
    first: u8,
    /// Round-trip amplitude that is left before each crossing.
    pub(super) left: Vec<f64>,
}

impl Way {
    pub(super) fn with_room_for(body: &Body) -> Self {
        let most = 2 * body.solids.len();
        let (passages, left) = (Vec::with_capacity(most), Vec::with_capacity(most));
        Self { met: Met::with_room_for(body), passages, first: 0, left }
    }

    /// Follows a ray for `length` mm from `origin` along a unit vector, both in the body's
    /// axes.
    pub(super) fn go(&mut self, body: &Body, loss: &Loss, origin: DVec3, direction: DVec3, length: f64) {
        self.first = body.trace(origin, direction, length, &mut self.met, &mut self.passages);
        self.left.clear();
        let (mut left, mut at, mut material) = (1.0, 0.0, self.first);
        for passage in &self.passages {
            left *= amplitude(-loss.db_per_mm[usize::from(material)] * (passage.at - at));
            self.left.push(left);
            left *= loss.through(body, passage);
            (at, material) = (passage.at, passage.to);
        }
    }

    /// Returns the round-trip amplitude left at a distance.
    pub(super) fn left_at(&self, body: &Body, loss: &Loss, distance: f64) -> f64 {
        let passed = self.passages.partition_point(|p| p.at <= distance);
        let Some(last) = passed.checked_sub(1) else {
            return amplitude(-loss.db_per_mm[usize::from(self.first)] * distance.max(0.0));
        };
        let passage = &self.passages[last];
        let behind = self.left[last] * loss.through(body, passage);
        behind * amplitude(-loss.db_per_mm[usize::from(passage.to)] * (distance - passage.at))
    }

    /// Attenuates a column of a raster, rows `columns` apart, by the amplitude left at each
    /// row.
    pub(super) fn weaken(&self, body: &Body, loss: &Loss, layout: &Layout, [re, im]: [&mut [f32]; 2], column: usize) {
        let mut row = layout.above;
        let mut next = 0;
        while row < layout.rows {
            let range = layout.range(row);
            while self.passages.get(next).is_some_and(|p| p.at <= range) {
                next += 1;
            }
            let material = next.checked_sub(1).map_or(self.first, |last| self.passages[last].to);
            let end = self.passages.get(next).map_or(layout.rows, |p| {
                (layout.above + (p.at / layout.range_step).ceil() as usize).clamp(row + 1, layout.rows)
            });
            let mut left = self.left_at(body, loss, range);
            let step = amplitude(-loss.db_per_mm[usize::from(material)] * layout.range_step);
            if step == 1.0 && left == 1.0 {
                row = end;
                continue;
            }
            for r in row..end {
                let i = r * layout.columns + column;
                let part = left as f32;
                re[i] *= part;
                im[i] *= part;
                left *= step;
            }
            row = end;
        }
    }
}

/// Returns origin and direction of a column's beam in the body, `aside` mm out of the slice's
/// plane.
pub(super) fn ray(layout: &Layout, body_from_face: &DAffine3, column: usize, aside: f64) -> [DVec3; 2] {
    let (origin, direction) = layout.transducer.beam(layout.lateral(column));
    let origin = body_from_face.transform_point3(origin.extend(aside));
    [origin, body_from_face.transform_vector3(direction.extend(0.0))]
}
