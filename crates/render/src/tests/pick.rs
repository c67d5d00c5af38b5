//! Picking in pictures of known bodies.

use super::*;
use crate::classify::transfer::Transfer;

const MIDDLE: DVec3 = DVec3::new(12.0, 9.0, 11.0);
const RADIUS_MM: f64 = 7.0;
const VOXEL_MM: f64 = 0.5;

/// Transparent below half of the grey levels, opaque above.
fn clear_or_opaque() -> Transfer {
    let curve = Curve::new(&[(120.0, 0.0), (136.0, 1.0)]).unwrap();
    Transfer::new(Opacity::Curve(curve), VOXEL_MM, Colour::grey([0.0, 255.0]).unwrap()).unwrap()
}

/// Returns a body's brightness at a depth below its surface, mm: it rises over a millimetre and
/// is half at the surface.
fn edge(within_mm: f64) -> f32 {
    (128.0 + 200.0 * within_mm).clamp(0.0, 255.0) as f32
}

/// Depth of a world position within a body, mm.
type Body = fn(DVec3) -> f64;

fn ball(at: DVec3) -> f64 {
    RADIUS_MM - at.distance(MIDDLE)
}

fn block(at: DVec3) -> f64 {
    (DVec3::new(6.0, 5.0, 4.0) - (at - MIDDLE).abs()).min_element()
}

fn renderer(body: Body, settings: &RenderSettings) -> Renderer {
    let value = move |at: [i64; 3]| Some(edge(body(DVec3::from_array(at.map(|x| x as f64 * VOXEL_MM)))));
    let volume = Field { low: [0; 3], high: [48, 40, 46], value };
    let mut renderer = Renderer::new(settings, RenderRegion::new(half_mm(), volume.low, volume.high).unwrap()).unwrap();
    renderer.update_all(&volume);
    renderer
}

fn views() -> Vec<View> {
    let [above, aside] = [(0.0, 90.0), (37.0, 21.0)];
    [(0.0, 0.0, None), (above.0, above.1, None), (aside.0, aside.1, None), (aside.0, aside.1, Some(40.0))]
        .map(|(azimuth, elevation, perspective)| View { azimuth, elevation, perspective, ..View::default() })
        .into()
}

/// Returns the point where a ray from outside first enters a body, in steps of a hundredth of a
/// mm.
fn entered(renderer: &Renderer, at: [f64; 2], body: impl Fn(DVec3) -> f64) -> Option<DVec3> {
    let ray = renderer.camera().ray_through(at);
    let to_world = renderer.region().world_from_region();
    let from = to_world.transform_point3(ray.base);
    let along = to_world.transform_vector3(ray.step).normalize();
    (0..8000).map(|n| from + along * (f64::from(n) * 0.01)).find(|at| body(*at) >= 0.0)
}

#[test]
fn pick_finds_body_surface_and_nothing_beside() {
    let modes =
        [Mode::default(), Mode::Opacity(Shading::Voxel), Mode::Shaded(Shading::Sample), Mode::Isosurface(128.0)];
    for (view, mode) in views().into_iter().flat_map(|view| modes.map(|mode| (view, mode))) {
        for body in [ball as Body, block] {
            let settings = RenderSettings { view, mode, stop: 0.0, ..RenderSettings::new([64, 60], clear_or_opaque()) };
            let renderer = renderer(body, &settings);
            let (mut hits, mut misses) = (0, 0);
            for at in (0..60).step_by(3).flat_map(|j| (0..64).step_by(3).map(move |i| [f64::from(i), f64::from(j)])) {
                let truth = entered(&renderer, at, body);
                let picked = renderer.pick(at);
                // Along the outline a ray passes through the rim alone.
                let passes_by = entered(&renderer, at, |at| body(at) + 1.0).is_none();
                match (truth, picked) {
                    (Some(truth), Some(Picked { point, along, depth_mm, pixel_mm })) => {
                        let ray = renderer.camera().ray_through(at);
                        let [near, far] = [0.0, 1.0]
                            .map(|k| renderer.region().world_from_region().transform_point3(ray.base + ray.step * k));
                        assert!((along - (far - near).normalize()).length() < 1e-9);
                        assert!((point - near).cross(along).length() < 1e-9, "it lies on its ray");
                        let off = (point - truth).dot(along);
                        // A ray that grazes the body goes through its rim for longer than across
                        // it.
                        let slant = -(body(point + along * 0.05) - body(point - along * 0.05)) / 0.1;
                        if slant.abs() > 0.5 {
                            assert!(off.abs() <= VOXEL_MM, "{mode:?} {view:?} {at:?}: {off} mm off");
                            hits += 1;
                        }
                        assert!(depth_mm >= renderer.camera().step_mm() && depth_mm < 8.0, "{depth_mm}");
                        let projected = renderer.camera().project_world(point + view.axes().right * pixel_mm).unwrap();
                        assert!((projected[0] - at[0] - 1.0).abs() < 0.02, "{projected:?} {at:?}");
                    }
                    (None, Some(_)) => assert!(!passes_by, "{mode:?} {view:?} {at:?}: nothing is there"),
                    (Some(_), None) => {}
                    (None, None) => misses += 1,
                }
            }
            assert!(hits > 15 && misses > 20, "{mode:?} {view:?}: {hits} of {misses}");
        }
    }
}

#[test]
fn pick_finds_maximum_and_ignores_thin_tissue() {
    // Brightest in the middle.
    let value = |at: [i64; 3]| {
        let off = DVec3::from_array(at.map(|x| x as f64 * VOXEL_MM)).distance(MIDDLE);
        (off < 8.0).then_some((200.0 - 20.0 * off) as f32)
    };
    let volume = Field { low: [0; 3], high: [48, 40, 46], value };
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    for mode in [Mode::Maximum, Mode::Average] {
        for view in views() {
            let settings = RenderSettings { view, mode, ..RenderSettings::new([64, 60], clear_or_opaque()) };
            let mut renderer = Renderer::new(&settings, region).unwrap();
            renderer.update_all(&volume);
            let at = renderer.camera().project_world(MIDDLE).unwrap();
            let Picked { point, depth_mm, .. } = renderer.pick(at).unwrap();
            assert!(point.distance(MIDDLE) <= VOXEL_MM, "{mode:?} {view:?}: {point}");
            // It falls to half within 5 mm on each side.
            assert!((9.0..11.0).contains(&depth_mm), "{depth_mm}");
            assert_eq!(renderer.pick([0.0, 0.0]), None);
        }
    }
    for (alpha, is_place) in [(0.002, false), (0.2, true)] {
        let (transfer, light) = fog(alpha, VOXEL_MM);
        let mut renderer =
            Renderer::new(&RenderSettings { light, ..RenderSettings::new([64, 60], transfer) }, region).unwrap();
        renderer.update_all(&volume);
        let at = renderer.camera().project_world(MIDDLE).unwrap();
        let picked = renderer.pick(at);
        assert_eq!(picked.is_some(), is_place, "{alpha}");
        if let Some(Picked { point, depth_mm, .. }) = picked {
            // 3.1 voxels of it hide half, 1.3 a quarter and 6.2 three quarters. It begins half a
            // voxel before its first one.
            let deep = (point - MIDDLE).y + 7.75;
            assert!((deep - 3.1 * VOXEL_MM).abs() < 0.2 * VOXEL_MM, "{deep}");
            assert!((depth_mm - (4.9 * VOXEL_MM).hypot(renderer.camera().step_mm())).abs() < 0.3, "{depth_mm}");
        }
    }
}

#[test]
fn pick_changes_no_picture_and_casts_no_ray() {
    let settings = RenderSettings { adaptive: 0.02, ..RenderSettings::new([64, 60], clear_or_opaque()) };
    let renderer = renderer(ball, &settings);
    let (before, work) = (renderer.picture(), renderer.work());
    assert!(renderer.pick([32.0, 30.0]).is_some());
    assert_eq!((renderer.picture(), renderer.work()), (before, work));
}
