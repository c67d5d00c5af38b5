//! All render modes: closed forms, the equations in f64, and incremental updates.

use super::*;
use crate::classify::light::DepthCue;

const SAMPLED: Mode = Mode::Shaded(Shading::Sample);

fn window() -> Transfer {
    let curve = Curve::new(&[(0.0, 0.5)]).unwrap();
    Transfer::new(Opacity::Curve(curve), 1.0, Colour::grey([0.0, 255.0]).unwrap()).unwrap()
}

fn coloured() -> Transfer {
    let curve = Curve::new(&[(40.0, 0.0), (160.0, 0.7)]).unwrap();
    Transfer::new(Opacity::Curve(curve), 1.0, Colour::perceptual([0.0, 255.0]).unwrap()).unwrap()
}

/// Renders the whole volume in one picture; returns also its camera.
fn drawn(
    volume: &Field<impl Fn([i64; 3]) -> Option<f32> + Sync>,
    settings: &RenderSettings,
) -> (Picture, Camera, RenderRegion) {
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    let camera = Camera::new(&settings.view, settings.size, settings.step, &region).unwrap();
    let mut renderer = Renderer::new(settings, region).unwrap();
    renderer.update_all(volume);
    (renderer.picture(), camera, region)
}

#[test]
fn opaque_pixels_are_those_of_the_picture_and_grey_where_it_is() {
    let volume =
        Field { low: [0; 3], high: [30; 3], value: |at: [i64; 3]| (at[0] > 4).then(|| (at[1] * 8 + at[2] % 3) as f32) };
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    let opacity = Mode::Opacity(Shading::Voxel);
    let modes = [Mode::default(), SAMPLED, opacity, Mode::Maximum, Mode::Average, Mode::Isosurface(100.0)];
    for (mode, transfer) in modes.into_iter().flat_map(|mode| [tissue(), coloured()].map(|transfer| (mode, transfer))) {
        for (adaptive, threads) in [(0.0, 1), (0.0, 3), (0.02, 2)] {
            // Only voxels that are classified have adaptive rays.
            let adaptive = if mode == Mode::default() { adaptive } else { 0.0 };
            let settings =
                RenderSettings { mode, adaptive, threads, ..RenderSettings::new([41, 37], transfer.clone()) };
            let mut renderer = Renderer::new(&settings, region).unwrap();
            renderer.update_all(&volume);
            let picture = renderer.picture();
            for background in [[0.0; 3], [0.3; 3], [0.1, 0.5, 0.9]] {
                let expected = picture.over(background);
                assert!(expected.iter().any(|value| *value > 40), "{mode:?}");
                let is_grey = expected.as_chunks().0.iter().all(|[red, green, blue]| red == green && green == blue);
                let (found, says_grey) = match renderer.opaque_pixels(background) {
                    OpaquePixels::Grey(values) => (values.into_iter().flat_map(|value| [value; 3]).collect(), true),
                    OpaquePixels::Colour(values) => (values, false),
                };
                assert!(found == expected && says_grey == is_grey, "{mode:?} over {background:?}: {says_grey}");
            }
        }
    }
}

#[test]
fn ball_maximum_is_nearest_to_its_middle() {
    let off = |at: [i64; 3]| at.iter().map(|x| (*x as f64 - 20.0).powi(2)).sum::<f64>();
    let volume = Field {
        low: [0; 3],
        high: [40; 3],
        value: |at: [i64; 3]| (off(at) < 15.0 * 15.0).then(|| (200.0 - 0.2 * off(at)) as f32),
    };
    for perspective in [None, Some(30.0)] {
        let view = View { azimuth: 33.0, elevation: 21.0, roll: 7.0, perspective, turns: false, ..View::default() };
        let settings =
            RenderSettings { view, mode: Mode::Maximum, step: 0.25, ..RenderSettings::new([61, 47], window()) };
        let (picture, camera, region) = drawn(&volume, &settings);
        let mut seen = 0;
        for (j, i) in (0..47).flat_map(|j| (0..61).map(move |i| (j, i))) {
            let ray = camera.ray(i, j);
            let middle = DVec3::from_array(region.first().map(|first| 20.0 - first as f64)) - ray.base;
            let off = (middle - ray.step * (middle.dot(ray.step) / ray.step.length_squared())).length();
            let [r, _, _, t] = picture.pixels[(j * 61 + i) as usize];
            if off < 13.5 {
                // Between voxels a parabola is interpolated too low by up to 3/8 of its second
                // difference, along the ray by the step's.
                let exact = 200.0 - 0.2 * off * off;
                let below = exact - f64::from(r) * 255.0;
                assert!((-0.01..0.16).contains(&below) && t == 0.0, "{off} voxels off: {below} below {exact}");
                seen += 1;
            } else if off > 16.0 {
                assert_eq!([r, t], [0.0, 1.0], "{off} voxels off nothing was seen");
            }
            // At the end of coverage the picture ends; it does not darken.
            assert!(t == 1.0 || (t == 0.0 && f64::from(r) * 255.0 > 200.0 - 0.2 * 256.0), "{off}: {r}");
        }
        assert!(seen > 200, "{seen}");
    }
}

#[test]
fn ramp_average_is_its_middle_without_rim() {
    let volume = Field {
        low: [0; 3],
        high: [39, 29, 39],
        value: |[x, y, z]: [i64; 3]| ((x - 20).abs() + (z - 20).abs() < 16).then_some(64.0 + 2.0 * y as f32),
    };
    let settings = RenderSettings { mode: Mode::Average, step: 0.25, ..RenderSettings::new([41, 41], window()) };
    let mut seen = 0;
    for [r, _, _, t] in drawn(&volume, &settings).0.pixels {
        // Along the ramp: its middle, also where only part of the ray was seen.
        assert!(t == 1.0 || (t == 0.0 && (f64::from(r) * 255.0 - 93.0).abs() < 0.05), "{}", r * 255.0);
        seen += u32::from(t == 0.0);
    }
    assert!(seen > 400, "{seen}");
    // Across it: its value at each place, exactly.
    let across = RenderSettings { view: View { azimuth: 90.0, ..View::default() }, ..settings };
    let (picture, camera, region) = drawn(&volume, &across);
    for i in 0..41 {
        let [r, _, _, t] = picture.pixels[(20 * 41 + i) as usize];
        let y = camera.ray(i, 20).base.y + region.first()[1] as f64;
        if (0.0..=29.0).contains(&y) {
            let off = f64::from(r) * 255.0 - (64.0 + 2.0 * y);
            assert!(off.abs() < 1e-4 && t == 0.0, "{y}: {off}");
        }
    }
}

#[test]
fn fog_opacity_follows_beer_lambert() {
    let volume = Field { low: [0; 3], high: [59, 39, 59], value: |_: [i64; 3]| Some(200.0) };
    for shading in [Shading::Voxel, Shading::Sample] {
        let (transfer, _) = fog(0.05, 0.5);
        let settings = RenderSettings {
            mode: Mode::Opacity(shading),
            step: 0.25,
            stop: 0.0,
            ..RenderSettings::new([33, 33], transfer)
        };
        let [r, g, b, t] = drawn(&volume, &settings).0.pixels[16 * 33 + 16];
        let exact = 0.95_f64.powf(40.0);
        assert!((f64::from(t) / exact - 1.0).abs() < 0.0025, "{shading:?}: {t} against {exact}");
        assert!((r - (1.0 - t)).abs() < 1e-5 && r == g && g == b, "{shading:?}: {r} and {t}");
    }
}

/// Returns the distance of a ray's isosurface, in voxels from the ray's beginning, from the
/// darkening by a depth cue.
fn distance(brightness: f32, camera: &Camera, region: &RenderRegion, ray: &super::super::camera::Ray) -> f64 {
    let depth = 1.0 / f64::from(brightness) - 1.0;
    let [from, to] = [0.0, 1.0].map(|k| camera.depth(ray.base + ray.step * k, region));
    (depth - from) / (to - from) * ray.step.length()
}

/// Even light that fades to a half.
fn fading() -> Light {
    Light::default().with_parts(1.0, 0.0, 0.0, 1).unwrap().with_depth_cue(Some(DepthCue::new(1.0, 0.5).unwrap()))
}

#[test]
fn linear_field_isosurface_is_hit_exactly() {
    let normal = DVec3::new(1.7, 2.9, -0.6);
    let field = move |at: DVec3| 10.0 + normal.dot(at);
    let volume = Field {
        low: [0; 3],
        high: [39; 3],
        value: |at: [i64; 3]| Some(field(DVec3::from_array(at.map(|x| x as f64))) as f32),
    };
    for (perspective, step, cache) in
        [(None, 1.0, Cache::TwoLevel), (None, 0.4, Cache::None), (Some(40.0), 0.9, Cache::OneLevel)]
    {
        let view = View { azimuth: 12.0, elevation: 24.0, perspective, ..View::default() };
        let settings = RenderSettings {
            view,
            step,
            cache,
            mode: Mode::Isosurface(90.0),
            light: fading(),
            ..RenderSettings::new([51, 43], window())
        };
        let (picture, camera, region) = drawn(&volume, &settings);
        let (mut hits, mut worst) = (0, 0.0_f64);
        for (j, i) in (0..43).flat_map(|j| (0..51).map(move |i| (j, i))) {
            let ray = camera.ray(i, j);
            let lattice = |k: f64| ray.base + ray.step * k + DVec3::from_array(region.first().map(|x| x as f64));
            let k = (90.0 - field(lattice(0.0))) / normal.dot(ray.step);
            let at = lattice(k);
            // Only the surface itself, seen all around; elsewhere the ray meets the end of
            // coverage first.
            if at.min_element() > 1.0 && at.max_element() < 38.0 {
                let [r, _, _, t] = picture.pixels[(j * 51 + i) as usize];
                assert_eq!(t, 0.0, "{at}");
                worst = worst.max((distance(r, &camera, &region, &ray) - k * ray.step.length()).abs());
                hits += 1;
            }
        }
        assert!(hits > 150 && worst < 1e-3, "{hits} hits, {worst} voxels off");
    }
}

#[test]
fn coverage_end_is_isosurface_of_bright_tissue() {
    let volume = Field { low: [0; 3], high: [29; 3], value: |_: [i64; 3]| Some(200.0) };
    let settings =
        RenderSettings { mode: Mode::Isosurface(100.0), light: fading(), ..RenderSettings::new([33, 33], window()) };
    let (picture, camera, region) = drawn(&volume, &settings);
    let ray = camera.ray(16, 16);
    // Half a voxel before the first one.
    let exact = -0.5 - region.first()[1] as f64 - ray.base.y;
    let found = distance(picture.pixels[16 * 33 + 16][0], &camera, &region, &ray);
    assert!((found - exact).abs() < 1.0 / 64.0, "{found} against {exact}");
    let below = RenderSettings { mode: Mode::Isosurface(200.5), ..settings.clone() };
    assert!(drawn(&volume, &below).0.pixels.iter().all(|p| *p == [0.0, 0.0, 0.0, 1.0]));
    // White for a grey transfer function, otherwise the colour of its intensity.
    let [r, ..] = picture.pixels[16 * 33 + 16];
    let other = RenderSettings { transfer: coloured(), ..settings };
    let [red, green, blue, _] = drawn(&volume, &other).0.pixels[16 * 33 + 16];
    let exact = coloured().colour(100.0_f32).map(|c| c * r);
    assert!([red, green, blue].iter().zip(exact).all(|(a, b)| (a - b).abs() < 1e-6), "{red} {green} {blue}: {exact:?}");
}

/// Settings with all composite modes, in grey and colour, parallel and in perspective.
pub(in super::super) fn ways() -> Vec<RenderSettings> {
    let view = View { azimuth: 30.0, elevation: 25.0, roll: 5.0, perspective: None, turns: false, ..View::default() };
    let far = View { perspective: Some(35.0), ..view };
    let base = RenderSettings { view, ..RenderSettings::new([72, 56], tissue()) };
    let colour = RenderSettings { transfer: coloured(), view: far, step: 0.7, ..base.clone() };
    vec![
        RenderSettings { mode: Mode::Maximum, threads: 2, ..base.clone() },
        RenderSettings { mode: Mode::Maximum, cache: Cache::Linear, arity: Some(5), ..colour.clone() },
        RenderSettings { mode: Mode::Average, ..base.clone() },
        RenderSettings { mode: Mode::Average, cache: Cache::OneLevel, threads: 3, ..colour.clone() },
        RenderSettings { mode: Mode::Isosurface(80.0), ..base.clone() },
        RenderSettings { mode: Mode::Isosurface(60.0), cache: Cache::OneLevel, threads: 2, ..colour.clone() },
        RenderSettings { mode: Mode::Opacity(Shading::Voxel), cache: Cache::Linear, ..colour.clone() },
        RenderSettings { mode: Mode::Opacity(Shading::Sample), ..base.clone() },
        RenderSettings { mode: SAMPLED, threads: 3, simd: simd::Simd::Portable, ..base },
        RenderSettings { mode: SAMPLED, cache: Cache::OneLevel, ..colour },
    ]
}

#[test]
fn incremental_equals_full_picture_in_every_mode() {
    let turned = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_y(0.2);
    let motions = [Motion::Freehand, Motion::Crossing, Motion::Jittered, Motion::Parallel];
    for (settings, motion) in ways().into_iter().zip(motions.into_iter().cycle()) {
        let (scan, reconstruction, region) = sweep(22, motion, turned);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let mut following = Renderer::new(&settings, region).unwrap();
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            following.update(reconstructor.volume(), &touched.bricks);
            if frame % 9 == 4 || frame + 1 == scan.frames() {
                let mut whole = Renderer::new(&settings, region).unwrap();
                whole.update_all(reconstructor.volume());
                let (a, b) = (following.picture(), whole.picture());
                let same = a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits));
                assert!(same, "{:?}, frame {frame}: off by {:?}", settings.mode, a.difference(&b));
            }
        }
        for cache in Cache::ALL {
            let other = RenderSettings { cache, threads: 1, ..settings.clone() };
            let mut one = Renderer::new(&other, region).unwrap();
            one.update_all(reconstructor.volume());
            assert_eq!(one.picture(), following.picture(), "{:?}, {cache:?}, on one thread", settings.mode);
        }
        let seen = following.picture().pixels.iter().filter(|p| p[3] < 0.99).count();
        assert!(seen > 50, "{:?}, {motion:?}: {seen} pixels are seen", settings.mode);
    }
}

#[test]
fn live_picture_matches_reference_in_every_mode() {
    for settings in ways() {
        let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        scan.slices(0..24).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
        let mut live = Renderer::new(&settings, region).unwrap();
        live.update_all(reconstructor.volume());
        let exact = reference::render(reconstructor.volume(), &settings, &region).unwrap();
        let [most, rms] = exact.difference(&live.picture());
        // The error of the stop, and the rounding of single precision; for an isosurface at its
        // silhouettes, too.
        let stop = if settings.mode.shading().is_some() { f64::from(settings.stop) } else { 0.0 };
        assert!(most <= stop + 2e-5 && rms < 3e-4, "{:?}: {most} {rms}", settings.mode);
        assert!(most <= 1.0 / 255.0, "{:?}: {most}", settings.mode);
    }
}

#[test]
fn invalid_isovalue_is_refused() {
    let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
    let settings = RenderSettings { mode: Mode::Isosurface(f64::NAN), ..RenderSettings::new([8, 8], tissue()) };
    let refused = Renderer::new(&settings, region).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(refused.contains("isovalue") && refused.contains("NaN"), "{refused}");
}

#[test]
fn voxel_before_isosurface_updates_samples_behind() {
    let volume = |changed: Option<[i64; 3]>, row: i64| Field {
        low: [0; 3],
        high: [20; 3],
        value: move |at: [i64; 3]| Some(if changed == Some(at) { 0.0 } else { 100.0 + 12.0 * (at[1] - row) as f32 }),
    };
    let region = RenderRegion::new(half_mm(), [0; 3], [20; 3]).unwrap();
    // If steps are short, the voxels whose gradients change also hold the next sample. Only the
    // fading light shows the surface's position along its ray.
    let settings = RenderSettings {
        mode: Mode::Isosurface(105.0),
        arity: Some(3),
        step: 2.5,
        light: fading(),
        ..RenderSettings::new([40; 2], window())
    };
    let mut changes = 0;
    // Where samples lie between the surface's rows depends on the view.
    let rows = [10, 11, 12, 13];
    for (i, (x, y)) in (8..16).flat_map(|x| (8..16).map(move |y| (x, y))).enumerate() {
        let row = rows[(i + i / 8) % rows.len()];
        let before = volume(None, row);
        let mut following = Renderer::new(&settings, region).unwrap();
        following.update_all(&before);
        let was = following.picture();
        let after = volume(Some([x, y, x]), row);
        following.update(&after, &[[1, 1, 1]]);
        let mut whole = Renderer::new(&settings, region).unwrap();
        whole.update_all(&after);
        assert!(following.picture() == whole.picture(), "a dark voxel at {x} {y}");
        changes += u32::from(was != whole.picture());
    }
    assert!(changes > 8, "{changes} of 64 are seen");
}
