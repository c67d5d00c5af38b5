//! Painting: a scene's grey levels over a flat lattice of points, a picture's pixels or one layer of a volume.
//!
//! On two perpendicular axes an isotropic Gaussian is the product of one Gaussian along each, so a blob costs one product and one sum a pixel instead of an
//! exponential; blobs out of reach cost nothing. The soft sphere's edge is read from a table of its radial profile. What is left out or interpolated
//! stays below 1e-4 grey levels for scenes of the size of [`Blobs::draw`].

use glam::DVec3;

use super::elementary::exp;
use super::scene::{Blob, Blobs, EDGE_REACH, Scene, Sphere};

/// Blobs end this many σ from their centres, where they are below 1e-9 of their amplitude.
const BLOB_REACH: f64 = 6.5;

/// Steps of the soft edge's table: over 16.6 σ, linear interpolation errs by less than 1e-6 of the edge's height.
const PROFILE_STEPS: usize = 8192;

/// A flat lattice of points: point (i, j) lies at `origin + i·step_u + j·step_v`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sheet {
    /// World mm of point (0, 0).
    pub origin: DVec3,
    /// From a point to the next along u, mm.
    pub step_u: DVec3,
    /// From a point to the next along v, mm.
    pub step_v: DVec3,
    /// Points along u.
    pub width: usize,
    /// Points along v.
    pub height: usize,
}

impl Sheet {
    /// World mm of a point, from the base and not from its neighbour: errors must not add up along a row.
    pub fn point(&self, i: usize, j: usize) -> DVec3 {
        self.origin + self.step_u * i as f64 + self.step_v * j as f64
    }

    /// Whether the axes are perpendicular, which the product of two Gaussians needs.
    fn is_rectangular(&self) -> bool {
        self.step_u.dot(self.step_v).abs() <= 1e-12 * self.step_u.length() * self.step_v.length()
    }
}

/// A scene prepared for painting.
#[derive(Debug, Clone)]
pub struct Painter {
    scene: Scene,
    sphere: Option<SphereProfile>,
}

impl Painter {
    /// Prepares a scene.
    pub fn new(scene: Scene) -> Self {
        let sphere = match &scene {
            Scene::Blobs(Blobs { sphere, .. }) => sphere.map(SphereProfile::new),
            Scene::Sphere(sphere) => Some(SphereProfile::new(*sphere)),
            Scene::Constant(_) | Scene::Ramp(_) | Scene::Plane(_) => None,
        };
        Self { scene, sphere }
    }

    /// The scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// The scene's grey levels at a sheet's points, u fastest, into `grey`.
    ///
    /// # Panics
    /// When `grey` does not hold as many values as the sheet has points.
    pub fn paint(&self, sheet: &Sheet, grey: &mut [f64]) {
        assert_eq!(grey.len(), sheet.width * sheet.height, "the values do not fill the sheet");
        match &self.scene {
            Scene::Constant(value) => grey.fill(*value),
            Scene::Blobs(blobs) if sheet.is_rectangular() => self.paint_blobs(blobs, sheet, grey),
            scene => {
                for (j, row) in rows(sheet, grey) {
                    for (i, value) in row.iter_mut().enumerate() {
                        let point = sheet.point(i, j);
                        *value = match &self.sphere {
                            Some(sphere) if matches!(scene, Scene::Sphere(_)) => sphere.value(point),
                            _ => scene.value(point),
                        };
                    }
                }
            }
        }
    }

    fn paint_blobs(&self, blobs: &Blobs, sheet: &Sheet, grey: &mut [f64]) {
        let shadows: Vec<Shadow> = blobs.blobs.iter().filter_map(|b| Shadow::cast(b, sheet)).collect();
        for (j, row) in rows(sheet, grey) {
            row.fill(blobs.background);
            for shadow in &shadows {
                shadow.add_to(j, row);
            }
            if let Some(sphere) = &self.sphere {
                sphere.add_to(sheet, j, row);
            }
        }
    }
}

fn rows<'a>(sheet: &Sheet, grey: &'a mut [f64]) -> impl Iterator<Item = (usize, &'a mut [f64])> + use<'a> {
    grey.chunks_exact_mut(sheet.width.max(1)).enumerate()
}

/// What a blob leaves on a sheet: the product of a Gaussian along u and one along v.
struct Shadow {
    first_u: usize,
    along_u: Vec<f64>,
    first_v: usize,
    /// With the amplitude and the attenuation by the blob's distance from the plane.
    along_v: Vec<f64>,
}

impl Shadow {
    /// `None` when the blob is out of the sheet's reach.
    fn cast(blob: &Blob, sheet: &Sheet) -> Option<Self> {
        let reach = BLOB_REACH * blob.sigma;
        let offset = blob.centre - sheet.origin;
        let (pitch_u, pitch_v) = (sheet.step_u.length(), sheet.step_v.length());
        let (u, v) = (offset.dot(sheet.step_u) / pitch_u, offset.dot(sheet.step_v) / pitch_v);
        let normal = sheet.step_u.cross(sheet.step_v) / (pitch_u * pitch_v);
        let distance = offset.dot(normal);
        let left = reach * reach - distance * distance;
        if left <= 0.0 {
            return None;
        }
        let in_plane = left.sqrt();
        let span_u = indices_within(u, in_plane, pitch_u, sheet.width)?;
        let span_v = indices_within(v, in_plane, pitch_v, sheet.height)?;
        let falloff = |mm: f64| exp(-mm * mm / (2.0 * blob.sigma * blob.sigma));
        let height = blob.amplitude * falloff(distance);
        Some(Self {
            first_u: span_u.start,
            along_u: span_u.map(|i| falloff(i as f64 * pitch_u - u)).collect(),
            first_v: span_v.start,
            along_v: span_v.map(|j| height * falloff(j as f64 * pitch_v - v)).collect(),
        })
    }

    fn add_to(&self, j: usize, row: &mut [f64]) {
        let Some(scale) = j.checked_sub(self.first_v).and_then(|j| self.along_v.get(j)) else { return };
        for (value, u) in row[self.first_u..].iter_mut().zip(&self.along_u) {
            *value += scale * u;
        }
    }
}

/// The indices whose points lie within `reach` of `middle` on an axis of `count` points `pitch` apart; `None` when there are none.
fn indices_within(middle: f64, reach: f64, pitch: f64, count: usize) -> Option<std::ops::Range<usize>> {
    let first = ((middle - reach) / pitch).ceil().max(0.0);
    let end = (((middle + reach) / pitch).floor() + 1.0).min(count as f64);
    (first < end).then_some(first as usize..end as usize)
}

/// A sphere's grey level by distance from its centre, tabulated over the soft edge.
#[derive(Debug, Clone)]
struct SphereProfile {
    sphere: Sphere,
    /// Distance of the first table entry, mm; up to there the sphere has its inner grey level.
    inner: f64,
    /// Beyond it the sphere has its outer grey level, mm.
    outer: f64,
    /// Table entries per mm; 0 for a hard edge.
    per_mm: f64,
    table: Vec<f64>,
}

impl SphereProfile {
    fn new(sphere: Sphere) -> Self {
        if sphere.edge_sigma == 0.0 {
            return Self { sphere, inner: sphere.radius, outer: sphere.radius, per_mm: 0.0, table: Vec::new() };
        }
        let reach = EDGE_REACH * sphere.edge_sigma;
        let (inner, outer) = ((sphere.radius - reach).max(0.0), sphere.radius + reach);
        let step = (outer - inner) / PROFILE_STEPS as f64;
        let table = (0..=PROFILE_STEPS).map(|k| sphere.at_distance(inner + k as f64 * step)).collect();
        Self { sphere, inner, outer, per_mm: step.recip(), table }
    }

    fn value(&self, world: DVec3) -> f64 {
        self.at_squared_distance(world.distance_squared(self.sphere.centre))
    }

    fn at_squared_distance(&self, squared: f64) -> f64 {
        let r = squared.sqrt();
        if r > self.outer {
            return self.sphere.outside;
        }
        if self.table.is_empty() || (r < self.inner) {
            return self.sphere.inside;
        }
        let at = (r - self.inner) * self.per_mm;
        let k = (at as usize).min(PROFILE_STEPS - 1);
        self.table[k] + (at - k as f64) * (self.table[k + 1] - self.table[k])
    }

    /// Adds the sphere to row j; outside its reach only if it is not black there.
    fn add_to(&self, sheet: &Sheet, j: usize, row: &mut [f64]) {
        let start = sheet.point(0, j) - self.sphere.centre;
        let pitch = sheet.step_u.length();
        let along = -start.dot(sheet.step_u) / pitch;
        let beside = (start + sheet.step_u * (along / pitch)).length_squared();
        let reach = self.outer * self.outer - beside;
        let span = if self.sphere.outside != 0.0 {
            0..row.len()
        } else if reach > 0.0 {
            indices_within(along, reach.sqrt(), pitch, row.len()).unwrap_or(0..0)
        } else {
            0..0
        };
        for i in span {
            let mm = i as f64 * pitch - along;
            row[i] += self.at_squared_distance(beside + mm * mm);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DQuat};

    fn oblique(width: usize, height: usize, pitch: [f64; 2]) -> Sheet {
        let turn = DMat3::from_quat(DQuat::from_euler(glam::EulerRot::ZYX, 0.3, -0.4, 0.6));
        let (step_u, step_v) = (turn.x_axis * pitch[0], turn.y_axis * pitch[1]);
        let middle = DVec3::new(1.0, -2.0, 3.0);
        Sheet {
            origin: middle - step_u * (width / 2) as f64 - step_v * (height / 2) as f64,
            step_u,
            step_v,
            width,
            height,
        }
    }

    fn worst(scene: Scene, sheet: &Sheet) -> f64 {
        let mut grey = vec![f64::NAN; sheet.width * sheet.height];
        let painter = Painter::new(scene);
        painter.paint(sheet, &mut grey);
        grey.iter()
            .enumerate()
            .map(|(k, g)| (g - painter.scene().value(sheet.point(k % sheet.width, k / sheet.width))).abs())
            .fold(0.0, |a, e| if e.is_nan() { f64::INFINITY } else { a.max(e) })
    }

    #[test]
    fn fast_painting_equals_plain_evaluation() {
        let sheet = oblique(260, 240, [0.2, 0.23]);
        for seed in 0..3 {
            let worst = worst(Scene::Blobs(Blobs::draw(seed)), &sheet);
            assert!(worst < 1e-4, "{worst}");
        }
        assert!(worst(Scene::standard_sphere(), &sheet) < 1e-9);
        assert!(worst(Scene::standard_sphere().softened(0.8), &sheet) < 1e-3);
        assert!(worst(Scene::standard_sphere().softened(6.0), &sheet) < 1e-3);
        assert_eq!(worst(Scene::standard_ramp(), &sheet), 0.0);
        assert_eq!(worst(Scene::Constant(7.0), &sheet), 0.0);
    }

    #[test]
    fn blobs_on_skewed_axes_and_with_a_grey_outside_are_still_right() {
        let mut skewed = oblique(60, 50, [0.9, 0.8]);
        skewed.step_v += 0.2 * skewed.step_u;
        assert!(worst(Scene::Blobs(Blobs::draw(1)), &skewed) < 1e-9);
        let mut blobs = Blobs::draw(1);
        blobs.sphere = blobs.sphere.map(|s| Sphere { outside: 5.0, ..s });
        assert!(worst(Scene::Blobs(blobs), &oblique(60, 50, [0.9, 0.8])) < 1e-4);
    }

    #[test]
    fn a_blob_beyond_reach_of_the_sheet_casts_no_shadow() {
        let sheet = oblique(10, 10, [0.5, 0.5]);
        let normal = sheet.step_u.cross(sheet.step_v).normalize();
        let blob = |centre| Blob { centre, sigma: 1.0, amplitude: 100.0 };
        assert!(Shadow::cast(&blob(sheet.point(5, 5) + normal * 6.4), &sheet).is_some());
        assert!(Shadow::cast(&blob(sheet.point(5, 5) + normal * 6.6), &sheet).is_none());
        assert!(Shadow::cast(&blob(sheet.point(5, 5) + sheet.step_u * 40.0), &sheet).is_none());
    }
}
