mod adaptive;
mod crop;
mod interval;
mod pick;
mod reading;
mod refine;
mod slab;
mod soft;

use crate::classify::light::{self, Light};
use crate::classify::transfer::{Colour, Curve, Opacity, Transfer};
use glam::{DAffine3, DMat3, DVec3};

use phantom::scene::{Blobs, Scene};
use phantom::{Motion, Scan, ScanSettings};
use reconstruct::{PathReconstructor, Settings};
use sonoweave_core::frames::{Transform, Volume, World};
use volume::Values;
use volume::brick::{BrickIndex, EDGE};

use super::camera::{Camera, View};
use super::*;

pub(super) mod modes;

/// A volume defined by a function of the voxel, seen where the function returns a value.
struct Field<F> {
    low: [i64; 3],
    high: [i64; 3],
    value: F,
}

impl<F: Fn([i64; 3]) -> Option<f32> + Sync> Values for Field<F> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (x, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
            let at = [start[0] + x as i64, start[1], start[2]];
            let inside = (0..3).all(|a| (self.low[a]..=self.high[a]).contains(&at[a]));
            (*value, *weight) = inside.then(|| (self.value)(at)).flatten().map_or((0.0, 0.0), |v| (v, 1.0));
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        let edge = EDGE as i64;
        let span = move |a: usize| self.low[a].div_euclid(edge) as i32..=self.high[a].div_euclid(edge) as i32;
        Box::new(span(2).flat_map(move |z| span(1).flat_map(move |y| span(0).map(move |x| [x, y, z]))))
    }
}

fn lattice(direction: DMat3, spacing: DVec3, origin: DVec3) -> Transform<World, Volume> {
    Transform::from_affine(DAffine3 { matrix3: direction * DMat3::from_diagonal(spacing), translation: origin })
}

fn half_mm() -> Transform<World, Volume> {
    lattice(DMat3::IDENTITY, DVec3::splat(0.5), DVec3::ZERO)
}

/// Returns a transfer function with the same opacity for every intensity, white, and flat light.
fn fog(alpha: f64, unit_mm: f64) -> (Transfer, Light) {
    let curve = Curve::new(&[(0.0, alpha), (255.0, alpha)]).unwrap();
    (
        Transfer::new(Opacity::Curve(curve), unit_mm, Colour::grey([0.0, 255.0]).unwrap()).unwrap(),
        Light::default().with_parts(1.0, 0.0, 0.0, 1).unwrap(),
    )
}

fn tissue() -> Transfer {
    Transfer::preset("tissue", [0.0, 255.0]).unwrap()
}

#[test]
fn fog_slab_follows_beer_lambert_at_any_step() {
    // 40 voxels of 0.5 mm along the view, much wider than the picture: from the first voxel's
    // cell to the last's.
    let volume = Field { low: [0; 3], high: [59, 39, 59], value: |_: [i64; 3]| Some(200.0) };
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    for (step, perspective) in [(1.0, None), (0.5, None), (0.25, None), (0.25, Some(10.0))] {
        let (transfer, light) = fog(0.05, 0.5);
        let settings = RenderSettings {
            step,
            light,
            stop: 0.0,
            view: View { perspective, ..View::default() },
            ..RenderSettings::new([33, 33], transfer)
        };
        let mut renderer = Renderer::new(&settings, region).unwrap();
        renderer.update_all(&volume);
        let picture = renderer.picture();
        let [r, _, _, t] = picture.pixels[16 * 33 + 16];
        // Outside of the last voxels the opacity falls off over one voxel: 39 whole voxels and
        // twice a half.
        let exact = 0.95_f64.powf(40.0);
        let off = (f64::from(t) / exact - 1.0).abs();
        assert!(off < 0.01 * step, "step {step}: {t} against {exact}");
        // A white medium emits as much light as it absorbs.
        let white = f64::from(200.0_f32 / 255.0) * (1.0 - f64::from(t));
        assert!((f64::from(r) - white).abs() < 1e-5, "{r} against {white}");
    }
}

#[test]
fn rays_enter_and_leave_at_geometric_bounds() {
    let region = RenderRegion::new(half_mm(), [0, 0, 0], [39, 39, 39]).unwrap();
    let camera = Camera::new(&View::default(), [65, 65], 1.0, &region).unwrap();
    // From the front: along +y, through the middle at 9.75 mm in x and z.
    let ray = camera.ray(32, 32);
    let world = region.world_from_region();
    let first = world.transform_point3(ray.base);
    let radius = 20.5 * 0.5 * 3.0_f64.sqrt();
    assert!((first - DVec3::new(9.75, 9.75 - radius, 9.75)).length() < 1e-9, "{first}");
    let step = world.transform_vector3(ray.step);
    assert!((step - DVec3::new(0.0, 0.5, 0.0)).length() < 1e-12, "{step}");
    let low: [i64; 3] = std::array::from_fn(|a| -region.first()[a]);
    let [from, to] = crate::rays::line::span(&ray, ray.step.recip(), low, low.map(|x| x + 39), [0, camera.samples()]);
    // A voxel around the box: from −0.5 mm to 20 mm.
    let distance = |k: u32| f64::from(k) * 0.5 + first.y;
    assert!(distance(from) >= -0.52 && distance(from) < 0.0, "{}", distance(from));
    assert!(distance(to - 1) <= 20.02 && distance(to - 1) > 19.5, "{}", distance(to - 1));
    // To the right is +x, down is −z.
    assert!(world.transform_point3(camera.ray(40, 32).base).x > first.x + 1.0);
    assert!(world.transform_point3(camera.ray(32, 40).base).z < first.z - 1.0);
    let forward = |azimuth, elevation| View { azimuth, elevation, ..View::default() }.axes().forward;
    assert!((forward(90.0, 0.0) + DVec3::X).length() < 1e-12 && (forward(0.0, 90.0) + DVec3::Z).length() < 1e-12);
}

#[test]
fn projected_point_lies_on_its_ray() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-0.7);
    let region = RenderRegion::new(
        lattice(turned, DVec3::new(0.4, 0.5, 0.8), DVec3::new(100.0, -7.0, 3.0)),
        [-20, 5, 0],
        [30, 40, 21],
    );
    let region = region.unwrap();
    let aim = DVec3::new(97.0, -1.0, 12.0);
    for (perspective, zoom) in [(None, 0.0), (None, 1.7), (Some(40.0), 0.0), (Some(40.0), -1.1)] {
        let aim = (zoom != 0.0).then_some(aim);
        let view = View { azimuth: 37.0, elevation: 21.0, roll: 12.0, perspective, turns: true, zoom, aim };
        let camera = Camera::new(&view, [97, 61], 0.7, &region).unwrap();
        for (i, j, k) in [(0, 0, 3), (96, 60, 50), (48, 30, 20), (13, 55, 77)] {
            let ray = camera.ray(i, j);
            let [x, y] = camera.project(ray.base + ray.step * f64::from(k)).unwrap();
            assert!((x - f64::from(i)).abs() < 1e-9 && (y - f64::from(j)).abs() < 1e-9, "{x} {y} for {i} {j}");
            let at = region.world_from_region().transform_point3(ray.base + ray.step * f64::from(k));
            let [x, y, w] = camera.projection().map(|row| DVec3::new(row[0], row[1], row[2]).dot(at) + row[3]);
            assert!((x / w - f64::from(i)).abs() < 1e-9 && (y / w - f64::from(j)).abs() < 1e-9, "{x} {y} {w}");
        }
        // The aimed-at point is in the middle, magnified by the zoom.
        let plain = Camera::new(&View { zoom: 0.0, ..view }, [97, 61], 0.7, &region).unwrap();
        let across = |camera: &Camera| {
            let [middle, aside] = [DVec3::ZERO, view.axes().right].map(|by| region.centre_mm() + by);
            let [a, b] = [middle, aside].map(|at| camera.project_world(at).unwrap());
            (b[0] - a[0]).hypot(b[1] - a[1])
        };
        assert!((across(&camera) / across(&plain) - zoom.exp2()).abs() < 1e-9, "{zoom}");
        if let Some(aim) = aim {
            let [x, y] = camera.project_world(aim).unwrap();
            assert!((x - 48.0).abs() < 1e-9 && (y - 30.0).abs() < 1e-9, "{x} {y}");
        }
        let ray = camera.ray(20, 20);
        let mm = region.world_from_region().transform_vector3(ray.step).length();
        assert!((mm - 0.7 * 0.4).abs() < 1e-12);
    }
}

/// Returns a freehand sweep over blobs, the settings of its reconstruction, and a render region
/// that holds it all.
pub(super) fn sweep(frames: u32, motion: Motion, direction: DMat3) -> (Scan, Settings, RenderRegion) {
    let scan = Scan::new(ScanSettings {
        scene: Scene::Blobs(Blobs::draw(3)),
        motion,
        frames,
        gap_mm: 0.9,
        image_size: [60, 50],
        pixel_mm: [0.4; 2],
        noise_sd: 6.0,
        ..ScanSettings::default()
    })
    .unwrap();
    let settings = Settings { lattice_direction: direction, ..Settings::new(DVec3::splat(0.7)) };
    let world_from_lattice = lattice(direction, DVec3::splat(0.7), DVec3::ZERO);
    let region = RenderRegion::new(world_from_lattice, [-45; 3], [45; 3]).unwrap();
    (scan, settings, region)
}

pub(super) fn all_settings() -> Vec<RenderSettings> {
    let view = View { azimuth: 30.0, elevation: 25.0, roll: 5.0, perspective: None, turns: false, ..View::default() };
    let base = RenderSettings { view, ..RenderSettings::new([80, 64], tissue()) };
    let colour = Colour::perceptual([0.0, 255.0]).unwrap();
    let curve = Curve::new(&[(40.0, 0.0), (160.0, 0.7)]).unwrap();
    let coloured = Transfer::new(Opacity::Curve(curve), 1.0, colour).unwrap();
    vec![
        base.clone(),
        RenderSettings {
            view: View { zoom: 1.4, aim: Some(DVec3::new(4.0, -3.0, 6.0)), ..view },
            cache: Cache::OneLevel,
            threads: 3,
            // Not whole tiles.
            size: [77, 61],
            ..base.clone()
        },
        RenderSettings {
            view: View { perspective: Some(35.0), zoom: 0.7, aim: Some(DVec3::new(-5.0, 2.0, 3.0)), ..view },
            threads: 2,
            cache: Cache::Linear,
            ..base.clone()
        },
        RenderSettings { transfer: coloured, step: 0.6, arity: Some(5), simd: simd::Simd::Portable, ..base.clone() },
        RenderSettings {
            arity: Some(1),
            stop: 0.0,
            size: [83, 70],
            view: View { azimuth: 90.0, ..View::default() },
            ..base
        },
    ]
}

#[test]
fn incremental_picture_equals_full_picture() {
    let turned = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_y(0.2);
    for (settings, motion) in all_settings().into_iter().zip([
        Motion::Freehand,
        Motion::Crossing,
        Motion::Jittered,
        Motion::Freehand,
        Motion::Parallel,
    ]) {
        let (scan, reconstruction, region) = sweep(40, motion, turned);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let mut following = Renderer::new(&settings, region).unwrap();
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            let updated = following.update(reconstructor.volume(), &touched.bricks);
            assert!(updated.work.bricks_changed > 0 && updated.work.bricks_changed <= updated.work.bricks_read);
            if frame % 13 == 0 || frame + 1 == scan.frames() {
                let mut whole = Renderer::new(&settings, region).unwrap();
                let all = whole.update_all(reconstructor.volume());
                let (a, b) = (following.picture(), whole.picture());
                let same = a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits));
                assert!(same, "frame {frame}: {:?} off {:?}", settings.view, a.difference(&b));
                assert!(frame < 20 || updated.work.voxels_shaded < all.work.voxels_shaded / 2, "{updated:?} {all:?}");
            }
        }
        for cache in Cache::ALL {
            let other = RenderSettings { cache, threads: 1, ..settings.clone() };
            let mut one = Renderer::new(&other, region).unwrap();
            one.update_all(reconstructor.volume());
            assert_eq!(one.picture(), following.picture(), "{cache:?}, on one thread");
        }
        assert!(following.picture().pixels.iter().filter(|p| p[3] < 0.99).count() > 200, "something is seen");
    }
}

#[test]
fn separate_read_and_draw_equal_update() {
    let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
    let settings = RenderSettings { cache: Cache::TwoLevel, ..RenderSettings::new([64, 48], tissue()) };
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    let [mut together, mut apart] = [0, 1].map(|_| Renderer::new(&settings, region).unwrap());
    let mut before = apart.picture();
    for frame in 0..scan.frames() {
        let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
        together.update(reconstructor.volume(), &touched.bricks);
        let read = apart.read(reconstructor.volume(), &touched.bricks);
        assert_eq!(read.work.bricks_read, touched.bricks.len() as u64);
        assert_eq!(apart.picture(), before, "frame {frame}: reading draws nothing");
        // Up to five slices are drawn at once, sometimes by a new view.
        match frame % 12 {
            4 | 7 => drop(apart.draw()),
            11 => {
                let view = View { azimuth: f64::from(frame), ..View::default() };
                for renderer in [&mut together, &mut apart] {
                    renderer.set_view(view).unwrap();
                    while !renderer.refine(std::time::Duration::from_millis(50)).finished {}
                }
            }
            _ => continue,
        }
        before = apart.picture();
        assert_eq!(before, together.picture(), "frame {frame}");
        assert_eq!(apart.draw().work, RenderWork::default(), "nothing is left to be drawn");
    }
}

#[test]
fn live_picture_matches_reference_within_grey_level() {
    for settings in all_settings() {
        let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        scan.slices(0..24).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
        let mut live = Renderer::new(&settings, region).unwrap();
        live.update_all(reconstructor.volume());
        let exact = reference::render(reconstructor.volume(), &settings, &region).unwrap();
        let [most, rms] = exact.difference(&live.picture());
        // The error of the stop, and the rounding of single precision.
        assert!(most <= f64::from(settings.stop) + 2e-4, "{:?}: {most} {rms}", settings.view);
        assert!(most <= 1.0 / 255.0 && rms < 3e-4, "{most} {rms}");
    }
}

#[test]
fn widened_region_keeps_voxels_and_has_the_bits_of_a_new_one() {
    let depth_cue = Light::default().with_depth_cue(Some(light::DepthCue::new(1.0, 0.4).unwrap()));
    let mut all = all_settings();
    all.push(RenderSettings { light: depth_cue, threads: 2, ..all[0].clone() });
    all.push(RenderSettings { adaptive: 0.02, ..all[1].clone() });
    all.push(RenderSettings { mode: Mode::Isosurface(120.0), ..all[0].clone() });
    for settings in all {
        let (scan, reconstruction, whole) = sweep(40, Motion::Freehand, DMat3::IDENTITY);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let lattice = Transform::from_affine(reconstructor.world_from_lattice().affine());
        // Whole bricks, each box in the next one.
        let region = |bricks: i64| RenderRegion::new(lattice, [-8 * bricks; 3], [8 * bricks + 7; 3]).unwrap();
        let mut renderer = Renderer::new(&settings, region(4)).unwrap();
        let mut pending: Vec<BrickIndex> = Vec::new();
        for frame in 0..scan.frames() {
            pending.extend(reconstructor.insert(&scan.slice(frame)).unwrap().bricks);
            let view = View { azimuth: 60.0 + f64::from(frame), ..settings.view };
            match frame {
                // In the middle of a new view, whose voxels are not lit again yet.
                19 => drop(renderer.set_view(view).unwrap()),
                20 | 24 => {
                    let shaded = renderer.work().voxels_shaded;
                    assert!(shaded > 0);
                    let wider = region(i64::from(frame) / 4);
                    assert!(renderer.widen(wider).unwrap());
                    assert_eq!((renderer.work().voxels_shaded, *renderer.region()), (shaded, wider));
                    // Bricks outside of the box before were not read.
                    pending = reconstructor.volume().bricks().collect();
                }
                22 => drop(renderer.refine(std::time::Duration::MAX)),
                _ => {}
            }
            renderer.update(reconstructor.volume(), &std::mem::take(&mut pending));
        }
        while !renderer.refine(std::time::Duration::from_millis(5)).finished {}
        let last = View { azimuth: 79.0, ..settings.view };
        let mut fresh = Renderer::new(&RenderSettings { view: last, ..settings.clone() }, region(6)).unwrap();
        let shaded = fresh.update_all(reconstructor.volume()).work.voxels_shaded;
        assert!(renderer.picture() == fresh.picture(), "{:?} {:?}", settings.mode, settings.view);
        assert_eq!((renderer.bricks(), renderer.cache()), (fresh.bricks(), fresh.cache()));
        let seen = fresh.picture().pixels.iter().filter(|p| p[3] < 0.99).count();
        assert!(shaded > 0 && seen > 50, "{shaded} {seen} {:?} {:?}", settings.mode, settings.view);
        // A box that does not hold it, that cuts its bricks, or of another lattice.
        let before = renderer.picture();
        let other = RenderRegion::new(half_mm(), [-80; 3], [87; 3]).unwrap();
        for refused in [region(5), RenderRegion::new(lattice, [-49; 3], [53; 3]).unwrap(), other, whole] {
            assert!(!renderer.widen(refused).unwrap());
        }
        let cut = RenderRegion::new(lattice, [-48; 3], [45; 3]).unwrap();
        assert!(!Renderer::new(&settings, cut).unwrap().widen(region(9)).unwrap());
        assert!(renderer.picture() == before && renderer.refine(std::time::Duration::ZERO).finished);
    }
}

#[test]
fn slices_find_their_bricks_prepared() {
    let (scan, reconstruction, region) = sweep(40, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    let settings = RenderSettings { threads: 2, ..RenderSettings::new([64, 48], tissue()) };
    let mut renderer = Renderer::new(&settings, region).unwrap();
    let (mut unprepared, mut bricks) = (Vec::new(), Vec::new());
    for frame in 0..scan.frames() {
        let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
        unprepared.push(renderer.update(reconstructor.volume(), &touched.bricks).work.bricks_unprepared);
        bricks.push(renderer.bricks());
    }
    assert!(unprepared[0] > 0, "nothing is prepared for a volume that may not grow: {unprepared:?}");
    assert_eq!(unprepared[10..], [0; 30]);
    assert!(bricks[39] > 2 * bricks[9], "{bricks:?}");
    assert_eq!(renderer.work().bricks_unprepared, unprepared.iter().sum::<u64>());
}

#[test]
fn bricks_that_show_nothing_are_held_only_beside_those_that_do() {
    let (scan, reconstruction, region) = sweep(30, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    let settings =
        ["bone", "xray"].map(|preset| RenderSettings::new([64, 48], Transfer::preset(preset, [0.0, 255.0]).unwrap()));
    let [mut some, mut all] = settings.each_ref().map(|settings| Renderer::new(settings, region).unwrap());
    for frame in 0..scan.frames() {
        let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
        let volume = reconstructor.volume();
        match &touched.slab {
            Some(slab) => some.update_within(volume, &touched.bricks, slab),
            None => some.update(volume, &touched.bricks),
        };
        all.update(volume, &touched.bricks);
        if frame % 7 == 0 || frame + 1 == scan.frames() {
            let mut fresh = Renderer::new(&settings[0], region).unwrap();
            fresh.update_all(volume);
            assert_eq!(some.picture(), fresh.picture(), "frame {frame}");
            assert!(fresh.bricks() <= some.bricks(), "a brick that has shown something stays held");
        }
    }
    assert!(0 < some.bricks() && 2 * some.bricks() < all.bricks(), "{} of {}", some.bricks(), all.bricks());
    assert!(some.memory().voxels < all.memory().voxels);
}

#[test]
fn unchanged_volume_costs_no_work() {
    let (scan, reconstruction, region) = sweep(3, Motion::Freehand, DMat3::IDENTITY);
    let settings = RenderSettings::new([64, 64], tissue());
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    let touched = reconstructor.insert(&scan.slice(0)).unwrap();
    let mut renderer = Renderer::new(&settings, region).unwrap();
    renderer.update(reconstructor.volume(), &touched.bricks);
    // The inserter refuses the same image from a parked probe; its bricks, if given again, have
    // not changed.
    assert!(reconstructor.insert(&scan.slice(0)).is_err());
    let again = renderer.update(reconstructor.volume(), &touched.bricks).work;
    let idle = RenderWork { bricks_read: touched.bricks.len() as u64, ..RenderWork::default() };
    assert_eq!(again, idle);
    // A volume outside the render region is not read.
    let aside = RenderRegion::new(half_mm(), [400; 3], [420; 3]).unwrap();
    let mut elsewhere = Renderer::new(&settings, aside).unwrap();
    let work = elsewhere.update(reconstructor.volume(), &touched.bricks).work;
    assert_eq!(work, idle);
    assert!(elsewhere.picture().pixels.iter().all(|p| *p == [0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn cache_beyond_limit_is_reduced_with_note() {
    let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
    let small = RenderSettings { cache_bytes: 1_000, ..RenderSettings::new([64, 64], tissue()) };
    let renderer = Renderer::new(&small, region).unwrap();
    assert_eq!(renderer.cache(), Cache::None);
    assert!(renderer.notes()[0].contains("--cache-bytes"), "{:?}", renderer.notes());
    let rays = Cache::ALL.map(|cache| {
        let large = Renderer::new(&RenderSettings { cache, cache_bytes: 1 << 28, ..small.clone() }, region).unwrap();
        assert!(large.cache() == cache && large.notes().is_empty());
        large.memory().rays
    });
    assert!(rays.windows(2).all(|pair| pair[0] > pair[1]), "{rays:?}");
    // Between the memory of composited blocks and that of samples.
    let middle = RenderSettings { cache_bytes: 700_000, ..small };
    assert_eq!(Renderer::new(&middle, region).unwrap().cache(), Cache::OneLevel);
}

#[test]
fn coverage_end_is_no_surface() {
    // Evenly grey where it was seen, so only gradient-dependent opacity could show its border.
    let volume =
        Field { low: [0; 3], high: [30; 3], value: |[x, y, z]: [i64; 3]| (x + 2 * y < 50 && z != 13).then_some(120.0) };
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    let opacity = Opacity::Region(Curve::new(&[(0.0, 1.0), (255.0, 1.0)]).unwrap());
    let transfer = Transfer::new(opacity, 0.5, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
    let mut renderer = Renderer::new(&RenderSettings::new([40, 40], transfer), region).unwrap();
    let work = renderer.update_all(&volume).work;
    assert!(work.bricks_changed > 40 && work.rays == 0, "{work:?}");
    assert!(renderer.picture().pixels.iter().all(|p| p[3] == 1.0));
}

#[test]
fn invalid_settings_are_refused() {
    let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
    let fine = RenderSettings::new([64, 64], tissue());
    let text =
        |settings: RenderSettings| Renderer::new(&settings, region).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text(RenderSettings { size: [0, 64], ..fine.clone() }).contains("0×64"));
    assert!(text(RenderSettings { size: [64, 100_000], ..fine.clone() }).contains("8192"));
    assert!(text(RenderSettings { step: 0.0, ..fine.clone() }).contains("a longer step"));
    assert!(text(RenderSettings { step: f64::NAN, ..fine.clone() }).contains("a longer step"));
    assert!(text(RenderSettings { step: 1e-4, ..fine.clone() }).contains("samples a ray"));
    assert!(text(RenderSettings { arity: Some(0), ..fine.clone() }).contains("the arity"));
    assert!(text(RenderSettings { stop: 1.5, ..fine.clone() }).contains("transmittance"));
    for view in [
        View { azimuth: f64::NAN, ..View::default() },
        View { perspective: Some(0.0), ..View::default() },
        View { perspective: Some(180.0), ..View::default() },
    ] {
        assert!(text(RenderSettings { view, ..fine.clone() }).contains("azimuth"), "{view:?}");
    }
    assert!(
        RenderRegion::new(half_mm(), [3; 3], [2; 3]).is_err()
            && RenderRegion::new(half_mm(), [0; 3], [1 << 20; 3]).is_err()
    );
}

#[test]
fn place_is_hidden_only_by_tissue_before_it() {
    let value = |v: [i64; 3]| Some((v[0] * 7 + v[1] * 3 + v[2] * 5).rem_euclid(200) as f32);
    let volume = Field { low: [3, -5, 0], high: [30, 20, 25], value };
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    for perspective in [None, Some(35.0)] {
        let view = View { azimuth: 30.0, elevation: 20.0, perspective, ..View::default() };
        let settings = RenderSettings { stop: 0.0, view, ..RenderSettings::new([33, 31], tissue()) };
        let mut renderer = Renderer::new(&settings, region).unwrap();
        renderer.update_all(&volume);
        let (picture, camera) = (renderer.picture(), *renderer.camera());
        for (i, j) in [(16, 15), (11, 19), (20, 10)] {
            let ray = camera.ray(i, j);
            let hidden = |k: f64| {
                let at = region.world_from_region().transform_point3(ray.base + ray.step * k);
                renderer.transmittance_to(at)
            };
            // Behind everything, a place is as visible as the background; before everything, it
            // is fully visible.
            let end = f64::from(camera.samples());
            let whole = picture.pixels[j as usize * 33 + i as usize][3];
            assert!((hidden(end + 2.0) - whole).abs() < 1e-4 && whole < 0.9, "{} {whole}", hidden(end + 2.0));
            assert_eq!(hidden(1.0), 1.0);
            let course: Vec<f32> = (0..camera.samples() * 2).map(|k| hidden(0.5 * f64::from(k))).collect();
            assert!(course.is_sorted_by(|a, b| *b <= *a + 1e-5), "the farther, the more lies before it");
            assert!(course.iter().any(|t| (whole + 0.02..0.98).contains(t)), "by and by");
        }
    }
}
