//! Echoes of surfaces and wires, and their reverberations.

use glam::{DAffine3, DVec3};

use super::beam::{Loss, Way, ray};
use super::raster::Raster;
use super::scatter::amplitude;
use super::spread::Spread;
use super::{Layout, REFERENCE_DB, Scanner, hash};
use crate::body::{Body, Material, Passage, Wire};
use crate::elementary::exp;

/// Offsets of the beams across the slice's thickness, in σ, and their weights: the three points
/// of Gauss and Hermite's rule, the middle first.
const ACROSS: [[f64; 2]; 3] =
    [[0.0, 2.0 / 3.0], [-1.732_050_807_568_877_2, 1.0 / 6.0], [1.732_050_807_568_877_2, 1.0 / 6.0]];
/// Size of cells of equal surface unevenness, mm.
const UNEVEN_MM: f64 = 0.8;
/// Echoes below this are neglected.
const FAINTEST: f64 = 1e-4;
/// Angular width of a wire's reflection about the right angle: σ of the sine.
const WIRE_LOBE: f64 = 0.35;
/// Part that a wire reflects at any angle.
const WIRE_DIFFUSE: f64 = 0.03;
/// Amplitude ratio of successive echoes of a wire, as sound runs to and fro within it.
const WIRE_AGAIN: f64 = 0.35;
/// Half of the slice's thickness in which wires are visible, σ.
const WIRE_REACH: f64 = 2.8;

/// Follows all beams: attenuates the scatterers, and adds the echoes of surfaces.
#[derive(Debug)]
pub(super) struct Beams<'a> {
    pub(super) scanner: &'a Scanner,
    pub(super) layout: &'a Layout,
    pub(super) spread: &'a Spread,
    pub(super) body: &'a Body,
    pub(super) loss: &'a Loss,
    pub(super) body_from_face: &'a DAffine3,
}

impl Beams<'_> {
    pub(super) fn follow(&self, raster: &mut Raster, way: &mut Way) {
        let effects = self.scanner.effects;
        let length = self.layout.range(self.layout.rows);
        let thickness = self.scanner.elevation_sigma_mm(self.scanner.elevation.focus_mm);
        for column in 0..self.layout.columns {
            for [aside, part] in ACROSS {
                let [origin, direction] = ray(self.layout, self.body_from_face, column, aside * thickness);
                way.go(self.body, self.loss, origin, direction, length);
                if aside == 0.0 {
                    way.weaken(self.body, self.loss, self.layout, raster.both(), column);
                }
                if !effects.surfaces {
                    break;
                }
                for (passage, left) in way.passages.iter().zip(&way.left) {
                    let at = origin + direction * passage.at;
                    let (echo, uneven) = self.surface(at, direction, passage);
                    self.again(raster, column, passage.at, echo * left, uneven.map(|x| x * part));
                }
            }
        }
    }

    /// Returns the part of the amplitude that a surface reflects back to its source, and its
    /// unevenness, complex.
    fn surface(&self, at: DVec3, direction: DVec3, passage: &Passage) -> (f64, [f64; 2]) {
        let solid = &self.body.solids[usize::from(passage.solid)];
        let cosine = solid.shape.normal(at).dot(direction).abs().min(1.0);
        let [before, behind, own] =
            [passage.from, passage.to, solid.material].map(|m| &self.body.materials[usize::from(m)]);
        let echo = before.reflection(behind).abs() * shine(own, cosine);
        let roughness = own.roughness;
        let cell = (at / UNEVEN_MM).floor().to_array().map(|x| x as i32);
        let [a, b] = hash::amplitudes(hash::cell(cell, hash::key(self.scanner.seed, 2))[1]).map(f64::from);
        (echo, [1.0 - roughness + 1.4 * roughness * a, 1.4 * roughness * b])
    }

    /// Adds an echo and its reverberations between surface and transducer face. The k-th is at
    /// k times the range. Each is weaker by the reflections of face and surface and by the
    /// attenuation on the way.
    fn again(&self, raster: &mut Raster, column: usize, at: f64, once: f64, uneven: [f64; 2]) {
        let again = if self.scanner.effects.reverberation { self.scanner.reverberations } else { 0 };
        let mut strength = once * amplitude(REFERENCE_DB) * f64::from(self.spread.of_surfaces);
        for time in 1..=again + 1 {
            let row = f64::from(time) * at / self.layout.range_step + self.layout.above as f64;
            if strength < FAINTEST || row + 1.0 >= self.layout.rows as f64 {
                break;
            }
            let whole = row.floor();
            let value = uneven.map(|x| x as f32);
            raster.put_in_column(column, whole as usize, (row - whole) as f32, value, strength as f32);
            strength *= once * self.scanner.face_reflection;
        }
    }
}

/// Returns the part of a reflection that goes back to its source, for the cosine of the angle
/// to the normal: slightly above 1 at the normal.
fn shine(surface: &Material, cosine: f64) -> f64 {
    let lobe = surface.lobe_deg.to_radians();
    let sine_squared = 1.0 - cosine * cosine;
    exp(-0.5 * sine_squared / (lobe * lobe)) + surface.diffuse * cosine
}

/// Adds the echoes of wires. Each begins half a diameter before the axis, at the wire's
/// surface, and is followed by weaker ones a diameter apart.
#[derive(Debug)]
pub(super) struct Wires<'a> {
    pub(super) beams: Beams<'a>,
    pub(super) face_from_body: &'a DAffine3,
}

impl Wires<'_> {
    pub(super) fn add(&self, raster: &mut Raster, way: &mut Way) {
        for wire in &self.beams.body.wires {
            self.wire(wire, raster, way);
        }
    }

    /// Adds a wire as points, close together relative to a beam's width and the slice's
    /// thickness. Each counts by its distance from the slice's plane, so that a wire across the
    /// slice has its own echo.
    fn wire(&self, wire: &Wire, raster: &mut Raster, way: &mut Way) {
        let Beams { scanner, layout, .. } = self.beams;
        let [from, to] = [wire.from, wire.to].map(|end| self.face_from_body.transform_point3(end));
        let along = to - from;
        let length = along.length();
        let thinnest = scanner.elevation.focal_sigma_mm(scanner.wavelength_mm());
        let narrowest = scanner.lateral.focal_sigma_mm(scanner.wavelength_mm());
        let step = (0.4 * narrowest).min(0.25 * thinnest).min(0.5 * scanner.axial_sigma_mm());
        let [first, last] = self.within_slice(from, along);
        // Points are numbered from the wire's end, so that they do not move with the slice.
        let points = (first * length / step).ceil() as i64..=(last * length / step).floor() as i64;
        let direction = along / length;
        for point in points {
            let p = from + direction * (point as f64 * step);
            let [lateral, axis] = layout.transducer.locate(p.truncate());
            let range = axis - 0.5 * wire.diameter_mm;
            let (column, row) = (layout.column(lateral), range / layout.range_step + layout.above as f64);
            let inside = column >= 0.0 && column + 1.0 < layout.columns as f64 && row >= layout.above as f64;
            if !inside || row + 1.0 >= layout.rows as f64 {
                continue;
            }
            let sigma = scanner.elevation_sigma_mm(range);
            let weight = exp(-0.5 * (p.z / sigma) * (p.z / sigma)) * step / (sigma * std::f64::consts::TAU.sqrt());
            if weight < FAINTEST * FAINTEST {
                continue;
            }
            let (_, beam) = layout.transducer.beam(lateral);
            let slope = direction.dot(beam.extend(0.0)) / WIRE_LOBE;
            let shine = exp(-0.5 * slope * slope) + WIRE_DIFFUSE;
            let left = self.left(lateral, range, way);
            self.point(raster, [column, row], wire, amplitude(wire.echo_db) * shine * weight * left);
        }
    }

    /// Returns the range of a wire's length that runs within the slice.
    fn within_slice(&self, from: DVec3, along: DVec3) -> [f64; 2] {
        let scanner = self.beams.scanner;
        let thickest =
            [0.0, scanner.depth_mm].map(|range| scanner.elevation_sigma_mm(range)).into_iter().fold(0.0, f64::max);
        let half = WIRE_REACH * thickest;
        if along.z.abs() < 1e-9 {
            return if from.z.abs() <= half { [0.0, 1.0] } else { [1.0, 0.0] };
        }
        let ends = [(-half - from.z) / along.z, (half - from.z) / along.z];
        [ends[0].min(ends[1]).max(0.0), ends[0].max(ends[1]).min(1.0)]
    }

    fn left(&self, lateral: f64, range: f64, way: &mut Way) -> f64 {
        let Beams { layout, body, loss, body_from_face, .. } = self.beams;
        let (origin, direction) = layout.transducer.beam(lateral);
        let origin = body_from_face.transform_point3(origin.extend(0.0));
        way.go(body, loss, origin, body_from_face.transform_vector3(direction.extend(0.0)), range);
        way.left_at(body, loss, range)
    }

    fn point(&self, raster: &mut Raster, [column, row]: [f64; 2], wire: &Wire, strength: f64) {
        let Beams { scanner, layout, spread, .. } = self.beams;
        let mut strength = strength;
        let again = if scanner.effects.reverberation { 2 * scanner.reverberations } else { 0 };
        for time in 0..=again {
            let row = row + f64::from(time) * wire.diameter_mm / layout.range_step;
            if row + 1.0 >= layout.rows as f64 {
                return;
            }
            let at = [column, row].map(|x| x as usize);
            let between = [(column - at[0] as f64) as f32, (row - at[1] as f64) as f32];
            raster.put(at, between, [1.0, 0.0], strength as f32 * spread.of_points[at[1]]);
            strength *= WIRE_AGAIN;
        }
    }
}

/// The transducer's ringing at its face: rows of a raster from the face on. It belongs to the
/// transducer and does not move.
#[derive(Debug, Clone)]
pub(super) struct Ringing {
    re: Vec<f32>,
    im: Vec<f32>,
    first: usize,
}

impl Ringing {
    /// Returns the memory of the table, bytes.
    pub(super) fn bytes(&self) -> usize {
        size_of_val(&*self.re) + size_of_val(&*self.im)
    }

    pub(super) fn new(scanner: &Scanner, layout: &Layout, spread: &Spread) -> Self {
        let key = hash::key(scanner.seed, 3);
        let (mut re, mut im) = (Vec::new(), Vec::new());
        let strongest = scanner.ringing_db;
        for row in layout.above..layout.rows {
            let db = strongest - scanner.ringing_db_per_mm * layout.range(row);
            // Below the noise it is neglected.
            if !scanner.effects.ringing || db < scanner.noise_db.max(-80.0) {
                break;
            }
            let strength = amplitude(db) as f32 * spread.of_surfaces;
            // A common pulse of all elements, and a part of each element's own.
            let number = row as i32;
            let common = hash::amplitudes(hash::cell([number, 0, 0], key)[1]);
            for column in 0..layout.columns as i32 {
                let own = hash::amplitudes(hash::cell([number, column / 2, 1], key)[1]);
                re.push(strength * (0.35 + 0.5 * common[0] + 0.35 * own[0]));
                im.push(strength * (0.5 * common[1] + 0.35 * own[1]));
            }
        }
        Self { re, im, first: layout.above * layout.columns }
    }

    pub(super) fn add(&self, raster: &mut Raster) {
        let [re, im] = raster.both();
        for (to, from) in re[self.first..].iter_mut().zip(&self.re).chain(im[self.first..].iter_mut().zip(&self.im)) {
            *to += *from;
        }
    }
}
