//! Orbit camera of the page in control: turns, zooms, and re-centring, applied in order.

use glam::{DAffine3, DQuat, DVec3};
use serde::Deserialize;

use render::Renderer;
use render::camera::{Axes, Camera, View};
use volume::brick::{BrickIndex, EDGE};

use super::request_error::RequestError;

/// Range of the zoom, in doublings.
const ZOOMS: [f64; 2] = [-2.0, 6.0];
/// Largest rotation per command, degrees.
const MOST_TURN: f64 = 360.0;

/// Viewing directions, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum From {
    /// The configured view.
    Home,
    /// Along the world's +y.
    Front,
    /// Along −y.
    Back,
    /// Along +x.
    Left,
    /// Along −x.
    Right,
    /// Along −z.
    Above,
    /// Along +z.
    Below,
}

/// A camera command.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Steer {
    /// Turns the volume: near side to the right, upwards, and clockwise; degrees.
    Turn {
        /// To the right.
        right: f64,
        /// Upwards.
        up: f64,
        /// About the middle.
        clockwise: f64,
    },
    /// Magnifies, in doublings.
    Zoom(f64),
    /// Moves a point into the middle: fraction of the picture's width from the left, of its
    /// height from the top.
    Centre([f64; 2]),
    /// Goes to one of the sides.
    Side(From),
}

/// Camera and render region of the last picture: they relate world points to its pixels.
#[derive(Debug, Clone, Copy)]
struct LastPicture {
    camera: Camera,
    world_from_region: DAffine3,
    /// Lattice index of region coordinate 0.
    first: [i64; 3],
}

/// The requested view.
#[derive(Debug, Default)]
pub struct OrbitCamera {
    /// `None` follows the settings.
    view: Option<View>,
    home: View,
    shown: Option<LastPicture>,
}

impl OrbitCamera {
    /// Returns the requested view; `home` is the configured one.
    pub fn view(&mut self, home: View) -> View {
        self.home = home;
        self.view.unwrap_or(home)
    }

    /// Returns the requested view, as far as the configured one is known.
    pub(super) fn present(&self) -> View {
        self.view.unwrap_or(self.home)
    }

    /// Returns a test whether the middle of a brick lies in the last picture.
    pub(super) fn sees(&self) -> impl Fn(BrickIndex) -> bool + use<> {
        let shown = self.shown;
        move |brick| {
            let Some(LastPicture { camera, world_from_region, first }) = shown else { return true };
            let middle = |a: usize| (f64::from(brick[a]) + 0.5) * EDGE as f64 - first[a] as f64;
            let at = world_from_region.transform_point3(DVec3::from_array(std::array::from_fn(middle)));
            let at = camera.project_world(at);
            at.is_some_and(|at| at.iter().zip(camera.size()).all(|(x, side)| (0.0..f64::from(side)).contains(x)))
        }
    }

    /// Records a rendered picture.
    pub fn drawn(&mut self, renderer: &Renderer) {
        let (camera, region) = (*renderer.camera(), renderer.region());
        let world_from_region = region.world_from_region();
        self.shown = Some(LastPicture { camera, world_from_region, first: region.first() });
    }

    /// Returns the pixel position of a world point (mm) in the last picture; whole numbers are
    /// pixel centres. `None` if the point is not visible, and before the first picture.
    pub fn project(&self, at: DVec3) -> Option<[f64; 2]> {
        self.shown?.camera.project_world(at)
    }

    /// Returns the last picture's size in pixels.
    pub fn size(&self) -> Option<[u32; 2]> {
        Some(self.shown?.camera.size())
    }

    /// Changes the view.
    ///
    /// # Errors
    /// [`RequestError`] for an invalid turn, zoom or place; the view stays.
    pub(super) fn steer(&mut self, steer: Steer) -> Result<(), RequestError> {
        let view = self.view.unwrap_or(self.home);
        self.view = match steer {
            Steer::Turn { right, up, clockwise } => {
                if [right, up, clockwise].iter().any(|angle| !(-MOST_TURN..=MOST_TURN).contains(angle)) {
                    return Err(RequestError::ViewTurn(MOST_TURN));
                }
                Some(turned(&view, right, up, clockwise))
            }
            Steer::Zoom(by) => {
                if !by.is_finite() {
                    return Err(RequestError::Zoom);
                }
                Some(View { zoom: (view.zoom + by).clamp(ZOOMS[0], ZOOMS[1]), ..view })
            }
            Steer::Centre(at) => Some(View { aim: self.place(at)?, ..view }),
            Steer::Side(From::Home) => None,
            Steer::Side(from) => Some(View { perspective: view.perspective, turns: view.turns, ..side(from) }),
        };
        Ok(())
    }

    /// Returns the world point at a point of the picture, in the middle of its depth.
    fn place(&self, at: [f64; 2]) -> Result<Option<DVec3>, RequestError> {
        if at.iter().any(|share| !(0.0..=1.0).contains(share)) {
            return Err(RequestError::PicturePoint);
        }
        let Some(LastPicture { camera, world_from_region, .. }) = self.shown else {
            return Err(RequestError::NoPicture);
        };
        let [width, height] = camera.size().map(f64::from);
        let ray = camera.ray_through([at[0] * width - 0.5, at[1] * height - 0.5]);
        let middle = ray.base + ray.step * (0.5 * f64::from(camera.samples() - 1));
        Ok(Some(world_from_region.transform_point3(middle)))
    }
}

/// Turns the content as if held in the hand.
fn turned(view: &View, right_deg: f64, up_deg: f64, clockwise_deg: f64) -> View {
    let Axes { right, up, forward } = view.axes();
    // The volume turns one way, so the camera goes the other.
    let by = DQuat::from_axis_angle(up, -right_deg.to_radians())
        * DQuat::from_axis_angle(right, up_deg.to_radians())
        * DQuat::from_axis_angle(forward, -clockwise_deg.to_radians());
    let View { azimuth, elevation, roll, .. } = View::along(by * forward, by * up);
    View { azimuth, elevation, roll, ..*view }
}

fn side(from: From) -> View {
    let (azimuth, elevation) = match from {
        From::Home | From::Front => (0.0, 0.0),
        From::Back => (180.0, 0.0),
        From::Left => (-90.0, 0.0),
        From::Right => (90.0, 0.0),
        From::Above => (0.0, 90.0),
        From::Below => (0.0, -90.0),
    };
    View { azimuth, elevation, ..View::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sonoweave_core::frames::Transform;

    use render::classify::transfer::Transfer;
    use render::{RenderRegion, RenderSettings};

    #[test]
    fn view_turns_in_drag_direction() {
        let stage = RenderRegion::new(Transform::from_affine(DAffine3::IDENTITY), [0; 3], [40; 3]).unwrap();
        let camera = |view: &View| Camera::new(view, [100, 100], 1.0, &stage).unwrap();
        for (azimuth, elevation, roll) in [(0.0, 0.0, 0.0), (40.0, -20.0, 70.0), (0.0, 90.0, 0.0)] {
            let view = View { azimuth, elevation, roll, ..View::default() };
            let Axes { forward, up, .. } = view.axes();
            // A point on the near side, and one on top.
            let near = stage.centre_mm() - forward * 10.0;
            let top = stage.centre_mm() + up * 10.0;
            let seen = |view: &View, at: DVec3| camera(view).project_world(at).unwrap();
            let before = [seen(&view, near), seen(&view, top)];
            let right = seen(&turned(&view, 10.0, 0.0, 0.0), near);
            assert!(right[0] > before[0][0] + 1.0 && (right[1] - before[0][1]).abs() < 1e-6, "{right:?} {before:?}");
            let upwards = seen(&turned(&view, 0.0, 10.0, 0.0), near);
            assert!(upwards[1] < before[0][1] - 1.0 && (upwards[0] - before[0][0]).abs() < 1e-6, "{upwards:?}");
            let clockwise = seen(&turned(&view, 0.0, 0.0, 10.0), top);
            assert!(clockwise[0] > before[1][0] + 1.0, "{clockwise:?} {before:?}");
        }
    }

    #[test]
    fn view_centres_chosen_place_and_returns_home() {
        let stage =
            RenderRegion::new(Transform::from_affine(DAffine3::from_scale(DVec3::splat(0.5))), [-9; 3], [60, 40, 30])
                .unwrap();
        let home = View { azimuth: 30.0, elevation: 20.0, ..View::default() };
        let settings = RenderSettings {
            view: home,
            ..RenderSettings::new([120, 80], Transfer::preset("tissue", [0.0, 255.0]).unwrap())
        };
        let mut renderer = Renderer::new(&settings, stage).unwrap();
        let mut sight = OrbitCamera::default();
        assert_eq!(sight.view(home), home);
        assert!(sight.steer(Steer::Centre([0.2, 0.3])).unwrap_err().to_string().contains("no picture yet"));
        sight.drawn(&renderer);
        sight.steer(Steer::Zoom(1.5)).unwrap();
        sight.steer(Steer::Centre([0.2, 0.3])).unwrap();
        let view = sight.view(home);
        let aim = view.aim.unwrap();
        let before = renderer.camera().project_world(aim).unwrap();
        assert!((before[0] - 23.5).abs() < 1e-9 && (before[1] - 23.5).abs() < 1e-9, "{before:?}");
        renderer.set_view(view).unwrap();
        let after = renderer.camera().project_world(aim).unwrap();
        assert!((after[0] - 59.5).abs() < 1e-9 && (after[1] - 39.5).abs() < 1e-9, "{after:?}");
        for (steer, sentence) in [
            (Steer::Turn { right: f64::NAN, up: 0.0, clockwise: 0.0 }, "360°"),
            (Steer::Zoom(f64::INFINITY), "doublings"),
            (Steer::Centre([0.5, 1.1]), "from 0 to 1"),
        ] {
            assert!(sight.steer(steer).unwrap_err().to_string().contains(sentence));
            assert_eq!(sight.view(home), view, "what is refused changes nothing");
        }
        for _ in 0..9 {
            sight.steer(Steer::Zoom(3.0)).unwrap();
        }
        assert_eq!(sight.view(home).zoom, 6.0);
        sight.steer(Steer::Side(From::Home)).unwrap();
        assert_eq!(sight.view(home), home);
    }
}
