//! Planes through the volume for pages: three across its axes and a free one, all through one
//! point; their grey value window, and their pictures.

use glam::{DQuat, DVec3};
use serde_json::{Value, json};

use pipeline::session::{Extent, PlaneImage, PlaneRequest, Readout};
use render::section::{Plane, Sampled, Section};

use super::encoded_frame::Kind;
use super::request_error::RequestError;

/// Most pixels along a side.
const MOST_PX: u32 = 512;
/// Grid of plane positions, mm: moving within a plane leaves that plane unchanged despite
/// rounding.
const GRAIN_MM: f64 = 1e-6;
/// Largest rotation of the free plane per command, degrees.
const MOST_TURN: f64 = 360.0;
/// Largest accepted magnitude of a grey value.
const MOST_GREY: f64 = 1e6;
/// Number of histogram bins.
const BINS: usize = 64;
/// The planes in the order of their numbers.
pub(super) const KINDS: [Kind; 4] = [Kind::AcrossZ, Kind::AcrossY, Kind::AcrossX, Kind::Free];
/// Volume axes that run right and down in the first three planes, as in the pictures of
/// `render`.
const AXES: [[usize; 2]; 3] = [[0, 1], [0, 2], [1, 2]];

/// Commands of a user with control for the planes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Move {
    /// Moves all planes through this point, world mm.
    Cross([f64; 3]),
    /// Turns the free plane as if held in the hand: near side to the right, upwards, and
    /// clockwise; degrees.
    Tilt {
        /// To the right.
        right: f64,
        /// Upwards.
        up: f64,
        /// About the middle.
        clockwise: f64,
    },
    /// Grey values displayed as black and as white.
    Window([f64; 2]),
    /// Resets the planes: through the volume's middle, the free one between the axes.
    Home,
    /// Resets the grey values to the configured ones.
    HomeWindow,
    /// Shows or hides the standard errors of the planes' voxels.
    Errors(bool),
    /// Shows or hides which places were seen weakly, in shadows only.
    WeaklySeen(bool),
}

/// Position and style of the planes.
#[derive(Debug)]
pub struct Planes {
    /// `None` is the volume's middle, which moves as the volume grows.
    cross: Option<DVec3>,
    /// The free plane's directions to the right and down, in the volume's axes; `None` lies
    /// between them.
    free: Option<[DVec3; 2]>,
    window: Option<[f32; 2]>,
    /// The configured window.
    usual: [f32; 2],
    extent: Option<Extent>,
    /// The sections displayed last.
    shown: [Option<Section>; KINDS.len()],
    /// Number of moves and changes: of two messages, the one with the higher number holds.
    turn: u64,
    /// Number of changes of the window and of what is shown.
    style_changes: u64,
    shows_errors: bool,
    shows_weakly_seen: bool,
}

impl Default for Planes {
    fn default() -> Self {
        Self {
            cross: None,
            free: None,
            window: None,
            usual: [0.0, 255.0],
            extent: None,
            shown: [None; KINDS.len()],
            turn: 0,
            style_changes: 0,
            shows_errors: false,
            shows_weakly_seen: false,
        }
    }
}

/// Returns unit directions to the right and down, at right angles.
fn squared(right: DVec3, down: DVec3) -> [DVec3; 2] {
    let right = right.normalize();
    [right, (down - right * down.dot(right)).normalize()]
}

impl Planes {
    /// Sets the configured grey values.
    pub(super) fn usual(&mut self, window: [f32; 2]) {
        if self.usual != window {
            self.usual = window;
            self.style_changes += 1;
        }
    }

    /// Returns the grey values displayed as black and as white.
    pub(super) fn window(&self) -> [f32; 2] {
        self.window.unwrap_or(self.usual)
    }

    /// Returns whether the planes are shown with standard errors.
    pub(super) fn shows_errors(&self) -> bool {
        self.shows_errors
    }

    /// Returns whether the planes are shown with the places seen weakly.
    pub(super) fn shows_weakly_seen(&self) -> bool {
        self.shows_weakly_seen
    }

    /// Returns the crossing point of all planes, which is always inside the volume.
    pub(super) fn cross(&self, extent: &Extent) -> DVec3 {
        let Some(cross) = self.cross else { return extent.place.middle() };
        let lattice = extent.place.lattice_from_world().transform_point3(cross);
        let [low, high] = [extent.place.low, extent.place.high].map(|end| DVec3::from_array(end.map(|x| x as f64)));
        match lattice.cmpge(low).all() && lattice.cmple(high).all() {
            true => cross,
            false => extent.place.world_from_lattice.transform_point3(lattice.clamp(low, high)),
        }
    }

    fn free(&self, extent: &Extent) -> [DVec3; 2] {
        let [x, y, z] = extent.place.directions();
        self.free.unwrap_or_else(|| squared(x + y, z))
    }

    fn plane(&self, number: usize, extent: &Extent) -> Plane {
        let directions = extent.place.directions();
        let [right, down] = match AXES.get(number) {
            Some(axes) => axes.map(|axis| directions[axis]),
            None => self.free(extent),
        };
        let normal = down.cross(right);
        let middle = extent.place.middle();
        let off = (self.cross(extent) - middle).dot(normal);
        let point = middle + normal * ((off / GRAIN_MM).round() * GRAIN_MM);
        Plane { point, normal, right, down }
    }

    /// Returns the subscribed planes through a volume of this extent.
    pub(super) fn requests(&mut self, extent: &Extent, is_viewed: impl Fn(Kind) -> bool) -> Vec<PlaneRequest> {
        self.extent = Some(*extent);
        let viewers = KINDS.iter().enumerate().filter(|(_, kind)| is_viewed(**kind));
        let section = |number| self.plane(number, extent).cover(&extent.place, extent.voxel_mm, MOST_PX);
        viewers
            .filter_map(|(number, _)| {
                Some(PlaneRequest { number, section: section(number).ok()?, style: self.style_changes })
            })
            .collect()
    }

    /// Forgets the volume.
    pub(super) fn without(&mut self) {
        (self.extent, self.shown) = (None, [None; KINDS.len()]);
    }

    /// Records the section displayed for a plane.
    pub(super) fn show(&mut self, request: &PlaneRequest) {
        self.shown[request.number] = Some(request.section);
    }

    /// Returns the sections displayed last, of the subscribed kinds.
    pub(super) fn shown(&self, is_viewed: impl Fn(Kind) -> bool) -> Vec<(Kind, Section)> {
        let all = KINDS.into_iter().zip(self.shown).filter(|(kind, _)| is_viewed(*kind));
        all.filter_map(|(kind, section)| Some((kind, section?))).collect()
    }

    /// Executes a command.
    ///
    /// # Errors
    /// [`RequestError`] for an invalid command, which changes nothing.
    pub(super) fn steer(&mut self, what: Move) -> Result<(), RequestError> {
        match what {
            Move::Cross(at) => self.cross = Some(self.inside(at)?),
            Move::Tilt { right, up, clockwise } => {
                if [right, up, clockwise].iter().any(|angle| !(-MOST_TURN..=MOST_TURN).contains(angle)) {
                    return Err(RequestError::PlaneTurn(MOST_TURN));
                }
                let extent = self.extent.ok_or(RequestError::NoVolume("turn a plane"))?;
                self.free = Some(turned(self.free(&extent), right, up, clockwise));
            }
            Move::Window([black, white]) => {
                let fits = [black, white].iter().all(|grey| (-MOST_GREY..=MOST_GREY).contains(grey));
                // Both must also differ in single precision.
                if !fits || white as f32 <= black as f32 {
                    return Err(RequestError::Window(MOST_GREY));
                }
                self.window = Some([black as f32, white as f32]);
                self.style_changes += 1;
            }
            Move::Home => (self.cross, self.free) = (None, None),
            Move::Errors(shown) => {
                self.shows_errors = shown;
                self.style_changes += 1;
            }
            Move::WeaklySeen(shown) => {
                self.shows_weakly_seen = shown;
                self.style_changes += 1;
            }
            Move::HomeWindow => {
                self.window = None;
                self.style_changes += 1;
            }
        }
        self.turn += 1;
        Ok(())
    }

    fn inside(&self, at: [f64; 3]) -> Result<DVec3, RequestError> {
        if at.iter().any(|x| !x.is_finite()) {
            return Err(RequestError::CrossingPoint);
        }
        let extent = self.extent.ok_or(RequestError::NoVolume("move planes"))?;
        let at = DVec3::from_array(at);
        let lattice = extent.place.lattice_from_world().transform_point3(at);
        let is_inside = (0..3).all(|a| {
            // The box extends by half a voxel beyond the outer voxel centres.
            (extent.place.low[a] as f64 - 0.5..=extent.place.high[a] as f64 + 0.5).contains(&lattice[a])
        });
        if is_inside {
            return Ok(at);
        }
        let [low, high] = extent.place.world_bounds();
        let text = |at: DVec3| at.to_array().map(|x| format!("{x:.1}")).join(", ");
        Err(RequestError::OutsideVolume { at: text(at), low: text(low), high: text(high) })
    }

    /// Returns the description that precedes a plane's picture.
    pub(super) fn to_json(&self, image: &PlaneImage<'_>, sequence: u32) -> Value {
        let PlaneImage { request, extent, sampled, slices, work, keeps_errors, weighs_shadows, readout, .. } = image;
        let readout = readout.map(|Readout { value, error, halved_by }| {
            let interval = error.map(|error| error.half_width_95());
            let slices = error.map(|error| error.slices);
            json!({ "value": value, "error": interval, "slices": slices, "halved_by": halved_by })
        });
        let [first, right, down] =
            [request.section.first, request.section.right, request.section.down].map(|v| v.to_array());
        let [low, high] = [extent.place.low, extent.place.high].map(|end| DVec3::from_array(end.map(|x| x as f64)));
        let to_world = extent.place.world_from_lattice;
        let edges =
            [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| to_world.transform_vector3(axis * (high - low)).to_array());
        json!({ "plane": {
            "kind": KINDS[request.number] as u8,
            "sequence": sequence,
            "origin": first,
            "right": right,
            "down": down,
            "size": request.section.size,
            "mm_per_px": request.section.mm_per_px(),
            "voxel_mm": extent.voxel_mm,
            "slices": slices,
            "volume": { "corner": to_world.transform_point3(low).to_array(), "edges": edges },
            "turn": self.turn,
            "cross": self.cross(extent).to_array(),
            "voxel": readout,
            "errors": keeps_errors.then_some(self.shows_errors),
            "weakly_seen": weighs_shadows.then_some(self.shows_weakly_seen),
            "home": self.cross.is_none() && self.free.is_none(),
            "window": self.window(),
            "levels": extent.grey_levels,
            "histogram": histogram(sampled, extent.grey_levels).as_slice(),
            "work": { "bricks": work.bricks, "planes": work.planes, "shown": work.shown },
        } })
    }
}

/// Turns the content as if held in the hand: to the right, upwards, clockwise. The plane's
/// directions therefore turn the other way.
fn turned([right, down]: [DVec3; 2], right_deg: f64, up_deg: f64, clockwise_deg: f64) -> [DVec3; 2] {
    let forward = right.cross(down);
    let by = DQuat::from_axis_angle(down, right_deg.to_radians())
        * DQuat::from_axis_angle(right, up_deg.to_radians())
        * DQuat::from_axis_angle(forward, -clockwise_deg.to_radians());
    squared(by * right, by * down)
}

/// Returns the grey value histogram of the seen pixels; values outside the range count in the
/// end bins.
fn histogram(sampled: &[Sampled], [low, high]: [f32; 2]) -> [u32; BINS] {
    let mut counts = [0; BINS];
    let scale = BINS as f32 / (high - low);
    for sampled in sampled.iter().filter(|sampled| sampled.is_seen()) {
        // Casts saturate, at 0 too.
        let bin = ((sampled.value - low) * scale) as usize;
        counts[bin.min(BINS - 1)] += 1;
    }
    counts
}

#[cfg(test)]
mod tests {
    use glam::DAffine3;
    use sonoweave_core::frames::Transform;

    use super::*;
    use pipeline::session::PlaneWork;
    use render::section::Box3;

    fn extent() -> Extent {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.2, 0.5, -0.4));
        let affine =
            DAffine3::from_scale_rotation_translation(DVec3::new(0.5, 0.5, 0.8), turn, DVec3::new(30.0, -4.0, 9.0));
        let place = Box3::new(Transform::from_affine(affine), [[-32, 0, 64], [127, 95, 127]]);
        Extent { place, voxel_mm: 0.5, grey_levels: [0.0, 255.0] }
    }

    fn all(planes: &mut Planes) -> Vec<PlaneRequest> {
        planes.requests(&extent(), |_| true)
    }

    #[test]
    fn planes_default_cross_centre_orthogonally() {
        let mut planes = Planes::default();
        let request = all(&mut planes);
        assert_eq!(request.iter().map(|request| request.number).collect::<Vec<_>>(), [0, 1, 2, 3]);
        let place = extent().place;
        for request in &request {
            let section = request.section;
            let normal = section.right.cross(section.down).normalize();
            assert!((section.first - place.middle()).dot(normal).abs() < 1e-6, "through the middle");
            assert!((section.mm_per_px() - 0.5).abs() < 1e-9 && section.size.iter().all(|side| *side <= MOST_PX));
        }
        assert_eq!(request[0].section.size, [160, 96]);
        assert_eq!(planes.requests(&extent(), |kind| kind == Kind::Free), request[3..]);
        // A larger volume has larger pixels.
        let mut far = extent();
        far.place.high = [4000, 95, 127];
        let large = planes.requests(&far, |_| true);
        assert!(large.iter().all(|request| request.section.size.iter().all(|side| *side <= MOST_PX)));
    }

    #[test]
    fn cross_moved_within_plane_leaves_plane_bit_identical() {
        let mut planes = Planes::default();
        let before = all(&mut planes);
        let PlaneRequest { section, .. } = before[0];
        let at = extent().place.middle() + section.right * 7.3 + section.down * -11.9;
        planes.steer(Move::Cross(at.to_array())).unwrap();
        let after = all(&mut planes);
        assert_eq!(before[0], after[0], "it moved within it");
        (1..4).for_each(|n| assert_ne!(before[n].section, after[n].section, "{n}"));
        // All planes go through the point.
        for request in &after {
            let section = request.section;
            assert!((section.first - at).dot(section.right.cross(section.down).normalize()).abs() < 1e-5);
        }
        planes.steer(Move::Home).unwrap();
        assert_eq!(all(&mut planes), before);
    }

    #[test]
    fn free_plane_rotates_about_cross_and_stays_orthonormal() {
        let mut planes = Planes::default();
        let before = all(&mut planes);
        for _ in 0..500 {
            planes.steer(Move::Tilt { right: 7.0, up: -3.0, clockwise: 11.0 }).unwrap();
        }
        let PlaneRequest { section, .. } = all(&mut planes)[3];
        assert!(section.right.dot(section.down).abs() < 1e-12);
        assert!(
            (section.first - extent().place.middle()).dot(section.right.cross(section.down).normalize()).abs() < 1e-5
        );
        planes.steer(Move::Home).unwrap();
        // After a clockwise quarter turn, the former right direction of the content points down
        // in the picture.
        let [_, _, _, home] = all(&mut planes)[..] else { panic!("four") };
        planes.steer(Move::Tilt { right: 0.0, up: 0.0, clockwise: 90.0 }).unwrap();
        let rolled = all(&mut planes)[3].section;
        assert!((rolled.down.normalize() - home.section.right.normalize()).length() < 1e-9, "{rolled:?}");
        assert_eq!(all(&mut planes)[..3], before[..3], "the others stay");
    }

    #[test]
    fn invalid_plane_command_is_refused_and_changes_nothing() {
        let mut planes = Planes::default();
        assert!(planes.steer(Move::Cross([0.0; 3])).unwrap_err().to_string().contains("no volume yet"));
        assert!(
            planes
                .steer(Move::Tilt { right: 1.0, up: 0.0, clockwise: 0.0 })
                .unwrap_err()
                .to_string()
                .contains("no volume yet")
        );
        let before = all(&mut planes);
        for (what, sentence) in [
            (Move::Cross([1e9, 0.0, 0.0]), "outside the volume, which extends from"),
            (Move::Cross([f64::NAN, 0.0, 0.0]), "finite"),
            (Move::Tilt { right: 361.0, up: 0.0, clockwise: 0.0 }, "360°"),
            (Move::Tilt { right: 0.0, up: f64::NAN, clockwise: 0.0 }, "360°"),
            (Move::Window([100.0, 100.0]), "larger one"),
            (Move::Window([f64::NEG_INFINITY, 100.0]), "larger one"),
            (Move::Window([0.0, f64::NAN]), "larger one"),
            (Move::Window([1e6, 1e6 + 1e-9]), "larger one"),
        ] {
            let refused = planes.steer(what).unwrap_err().to_string();
            assert!(refused.contains(sentence), "{refused}");
            assert_eq!((all(&mut planes), planes.window(), planes.turn), (before.clone(), [0.0, 255.0], 0));
        }
        // If the volume shrinks past the cross, the cross moves to its edge.
        let corner = extent().place.corners()[7] * 0.999 + extent().place.middle() * 0.001;
        planes.steer(Move::Cross(corner.to_array())).unwrap();
        let mut small = extent();
        small.place.high = [0, 31, 95];
        assert_eq!(planes.requests(&small, |_| true).len(), 4);
    }

    #[test]
    fn plane_has_histogram_and_a_window_that_holds() {
        let seen = |value| Sampled { value, weight: 1.0, share: 1.0 };
        let sampled: Vec<Sampled> =
            (0..40).map(|n| if n % 2 == 0 { seen(n as f32) } else { Sampled::UNSEEN }).collect();
        // Every second of the 40 pixels is seen.
        let counts = histogram(&sampled, [0.0, 255.0]);
        assert_eq!(counts.iter().sum::<u32>(), 20);
        assert_eq!(histogram(&[seen(-5.0), seen(300.0)], [0.0, 255.0])[BINS - 1], 1);

        let mut planes = Planes::default();
        let before = all(&mut planes);
        planes.steer(Move::Window([20.0, 80.0])).unwrap();
        let after = all(&mut planes);
        assert!(before.iter().zip(&after).all(|(a, b)| a.section == b.section && a.style != b.style));
        assert_eq!(planes.window(), [20.0, 80.0]);
        planes.usual([0.0, 200.0]);
        assert_eq!(planes.window(), [20.0, 80.0], "what somebody has chosen holds");
        planes.steer(Move::HomeWindow).unwrap();
        assert_eq!(planes.window(), [0.0, 200.0]);
        let image = PlaneImage {
            request: after[3],
            extent: extent(),
            sampled: &sampled,
            errors: &[],
            keeps_errors: true,
            weighs_shadows: true,
            weak: 0.0,
            readout: Some(Readout { value: 81.5, error: None, halved_by: None }),
            slices: 5,
            item: 6,
            captured_ns: None,
            work: PlaneWork::default(),
        };
        let to_json = planes.to_json(&image, 9);
        assert_eq!(
            (&to_json["plane"]["kind"], &to_json["plane"]["sequence"], &to_json["plane"]["slices"]),
            (&json!(6), &json!(9), &json!(5))
        );
        assert_eq!(to_json["plane"]["window"], json!([0.0, 200.0]));
        assert_eq!(
            to_json["plane"]["voxel"],
            json!({ "value": 81.5, "error": null, "slices": null, "halved_by": null })
        );
        assert_eq!(to_json["plane"]["errors"], json!(false));
        planes.steer(Move::Errors(true)).unwrap();
        assert_ne!(all(&mut planes)[0].style, after[0].style, "the picture is drawn again");
        assert_eq!(planes.to_json(&image, 9)["plane"]["errors"], json!(true));
        assert_eq!(planes.to_json(&image, 9)["plane"]["weakly_seen"], json!(false));
        let before = all(&mut planes)[0].style;
        planes.steer(Move::WeaklySeen(true)).unwrap();
        assert!(all(&mut planes)[0].style != before && planes.shows_weakly_seen());
        assert_eq!(planes.to_json(&image, 9)["plane"]["weakly_seen"], json!(true));
        let without = PlaneImage { keeps_errors: false, weighs_shadows: false, readout: None, ..image };
        let told = planes.to_json(&without, 9);
        let plane = &told["plane"];
        assert!(["errors", "weakly_seen", "voxel"].iter().all(|name| plane[name].is_null()), "{plane}");
    }
}
