//! Painting: a scene's grey levels over a flat lattice of points, such as an image's pixels or
//! a layer of a volume.
//!
//! On two perpendicular axes, an isotropic Gaussian is the product of one Gaussian along each.
//! A blob thus costs one product and one sum per pixel instead of an exponential. Distant blobs
//! cost nothing. Waves and zone plates are products of complex factors in the same way. Radial
//! profiles are read from a table: the soft sphere's edge and the rings of Marschner and Lobb.
//! Wires and thin sheets are evaluated only near themselves. Omission and interpolation err by
//! less than 1e-4 grey levels for the standard scenes.

use glam::DVec3;

mod oscillation;
mod profile;
mod ridge;
mod shadow;
mod sheet;

use oscillation::Oscillation;
use profile::Rings;
pub(super) use profile::SphereProfile;
use ridge::Ridge;
use shadow::Shadow;
pub use sheet::Sheet;
use sheet::rows;

use super::scene::{Blobs, Scene, Waves, ZonePlate};

/// A scene prepared for painting. A moving scene is painted as at time 0; see
/// [`Scene::at_time`].
#[derive(Debug, Clone)]
pub struct Painter {
    scene: Scene,
    tables: Tables,
}

/// Tables computed once for all sheets.
#[derive(Debug, Clone)]
enum Tables {
    None,
    Sphere(SphereProfile),
    Rings(Rings),
}

impl Painter {
    /// Prepares a scene.
    pub fn new(scene: Scene) -> Self {
        let scene = scene.at_time(0);
        let tables = match &scene {
            Scene::Blobs(Blobs { sphere: Some(sphere), .. }) | Scene::Sphere(sphere) => {
                Tables::Sphere(SphereProfile::new(*sphere))
            }
            Scene::MarschnerLobb(function) => Tables::Rings(Rings::new(*function)),
            _ => Tables::None,
        };
        Self { scene, tables }
    }

    /// Returns the scene.
    pub fn scene(&self) -> &Scene {
        &self.scene
    }

    /// Writes the scene's grey levels at a sheet's points, u fastest, into `grey`.
    ///
    /// # Panics
    /// If `grey` does not have as many values as the sheet has points.
    pub fn paint(&self, sheet: &Sheet, grey: &mut [f64]) {
        assert_eq!(grey.len(), sheet.width * sheet.height, "the values do not fill the sheet");
        match (&self.scene, &self.tables) {
            (Scene::Constant(value), _) => grey.fill(*value),
            (Scene::Blobs(blobs), _) if sheet.is_rectangular() => self.paint_blobs(blobs, sheet, grey),
            (Scene::Sphere(_), Tables::Sphere(sphere)) => each_point(sheet, grey, |point| sphere.value(point)),
            (Scene::MarschnerLobb(_), Tables::Rings(rings)) => rings.paint(sheet, grey),
            (Scene::ZonePlate(plate), _) if sheet.is_rectangular() => paint_zone_plate(plate, sheet, grey),
            (Scene::Waves(waves), _) => paint_waves(waves, sheet, grey),
            (Scene::Wires(wires), _) => {
                let ridges = wires.wires.iter().map(|wire| Ridge::of_wire(wire, sheet));
                paint_ridges(wires.background, ridges, sheet, grey);
            }
            (Scene::ThinSheet(thin), _) => {
                paint_ridges(thin.background, [Ridge::of_thin_sheet(thin, sheet)], sheet, grey);
            }
            (scene, _) => each_point(sheet, grey, |point| scene.value(point)),
        }
    }

    fn paint_blobs(&self, blobs: &Blobs, sheet: &Sheet, grey: &mut [f64]) {
        let shadows: Vec<Shadow> = blobs.blobs.iter().filter_map(|b| Shadow::cast(b, sheet)).collect();
        for (j, row) in rows(sheet, grey) {
            row.fill(blobs.background);
            for shadow in &shadows {
                shadow.add_to(j, row);
            }
            if let Tables::Sphere(sphere) = &self.tables {
                sphere.add_to(sheet, j, row);
            }
        }
    }
}

fn paint_zone_plate(plate: &ZonePlate, sheet: &Sheet, grey: &mut [f64]) {
    let oscillation = Oscillation::of_zone_plate(plate, sheet);
    for (j, row) in rows(sheet, grey) {
        row.fill(plate.mean);
        oscillation.add_to(j, row);
    }
}

fn paint_waves(waves: &Waves, sheet: &Sheet, grey: &mut [f64]) {
    let oscillations: Vec<_> = waves.waves.iter().map(|wave| Oscillation::of_wave(wave, sheet)).collect();
    for (j, row) in rows(sheet, grey) {
        row.fill(waves.mean);
        for oscillation in &oscillations {
            oscillation.add_to(j, row);
        }
    }
}

fn paint_ridges(background: f64, ridges: impl IntoIterator<Item = Ridge>, sheet: &Sheet, grey: &mut [f64]) {
    grey.fill(background);
    for ridge in ridges {
        for (j, row) in rows(sheet, grey) {
            ridge.add_to(j, row);
        }
    }
}

fn each_point(sheet: &Sheet, grey: &mut [f64], value: impl Fn(DVec3) -> f64) {
    for (j, row) in rows(sheet, grey) {
        for (i, grey) in row.iter_mut().enumerate() {
            *grey = value(sheet.point(i, j));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::scene::{Blob, MarschnerLobb, Plane, Pulsating, Speckle, Sphere, ThinSheet, Wire, Wires};
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
        assert!(worst(Scene::standard_sphere().softened(0.8).unwrap(), &sheet) < 1e-3);
        assert!(worst(Scene::standard_sphere().softened(6.0).unwrap(), &sheet) < 1e-3);
        assert_eq!(worst(Scene::standard_ramp(), &sheet), 0.0);
        assert_eq!(worst(Scene::Constant(7.0), &sheet), 0.0);
    }

    #[test]
    fn oscillations_ridges_and_rings_match_plain_evaluation() {
        let direction = DVec3::new(1.0, -2.0, 3.0);
        let mut skewed = oblique(130, 120, [0.4, 0.46]);
        skewed.step_v += 0.3 * skewed.step_u;
        let level =
            Sheet { origin: DVec3::new(-25.0, -20.0, 1.3), step_u: 0.4 * DVec3::X, step_v: 0.3 * DVec3::Y, ..skewed };
        for sheet in [oblique(260, 240, [0.2, 0.23]), skewed, level] {
            for scene in [
                Scene::ZonePlate(ZonePlate::standard()),
                Scene::ZonePlate(ZonePlate::standard()).softened(0.7).unwrap(),
                Scene::Waves(Waves::standard()),
                Scene::Waves(Waves::single(DVec3::new(0.3, -0.5, 0.2))),
                Scene::Wires(Wires::standard()),
                Scene::Wires(Wires::standard()).softened(0.9).unwrap(),
                Scene::ThinSheet(ThinSheet::standard(direction)),
                Scene::ThinSheet(ThinSheet::standard(DVec3::Y)),
                Scene::Plane(Plane::standard(direction)),
                Scene::MarschnerLobb(MarschnerLobb::standard()),
                Scene::Pulsating(Pulsating::standard()),
            ] {
                let off = worst(scene.clone(), &sheet);
                assert!(off < 1e-4, "{scene:?}: {off}");
            }
        }
        assert_eq!(worst(Scene::Speckle(Speckle::draw(1, 0.6)), &skewed), 0.0);
    }

    #[test]
    fn ridge_along_rows_is_painted_whole() {
        let sheet = Sheet { origin: DVec3::ZERO, step_u: DVec3::X, step_v: 0.25 * DVec3::Y, width: 50, height: 40 };
        let wires = Wires {
            background: 10.0,
            wires: vec![Wire { point: DVec3::new(0.0, 5.0, 0.5), direction: DVec3::X, sigma: 0.4, amplitude: 100.0 }],
        };
        assert!(worst(Scene::Wires(wires), &sheet) < 1e-6);
        assert!(worst(Scene::ThinSheet(ThinSheet::standard(DVec3::Z)), &sheet) < 1e-6);
    }

    #[test]
    fn blobs_on_skewed_axes_match_plain_evaluation() {
        let mut skewed = oblique(60, 50, [0.9, 0.8]);
        skewed.step_v += 0.2 * skewed.step_u;
        assert!(worst(Scene::Blobs(Blobs::draw(1)), &skewed) < 1e-9);
        let mut blobs = Blobs::draw(1);
        blobs.sphere = blobs.sphere.map(|s| Sphere { outside: 5.0, ..s });
        assert!(worst(Scene::Blobs(blobs), &oblique(60, 50, [0.9, 0.8])) < 1e-4);
    }

    #[test]
    fn blob_beyond_reach_of_sheet_has_no_footprint() {
        let sheet = oblique(10, 10, [0.5, 0.5]);
        let normal = sheet.step_u.cross(sheet.step_v).normalize();
        let blob = |centre| Blob { centre, sigma: 1.0, amplitude: 100.0 };
        assert!(Shadow::cast(&blob(sheet.point(5, 5) + normal * 6.4), &sheet).is_some());
        assert!(Shadow::cast(&blob(sheet.point(5, 5) + normal * 6.6), &sheet).is_none());
        assert!(Shadow::cast(&blob(sheet.point(5, 5) + sheet.step_u * 40.0), &sheet).is_none());
    }
}
