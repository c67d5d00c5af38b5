//! Tests of the kernel of fourth order: against the equations, on polynomials, at borders.

use super::*;

fn method(method: Method) -> Settings {
    Settings { method, sigma_mm: [Some(0.4), Some(0.4), Some(0.5)], ..settings() }
}

/// A slice of these grey levels by pixel.
fn painted(grey: impl Fn(u32, u32) -> f32) -> Slice {
    let scan = scan(Scene::Constant(1.0), 1, 0.0, Depth::U8);
    let pixels: Vec<f32> = (0..60).flat_map(|v| (0..72).map(move |u| (u, v))).map(|(u, v)| grey(u, v)).collect();
    Slice { image: Image::new(72, 60, Pixels::F32(pixels.into())), ..scan.slice(0) }
}

fn reconstructed(settings: Settings, mask: Mask, slices: &[Slice]) -> Reconstructor {
    let mut r = Reconstructor::new(settings, mask).unwrap();
    slices.iter().for_each(|slice| drop(r.insert(slice).unwrap()));
    r
}

/// Voxels with their place in the slice, pixels.
fn seen(r: &Reconstructor, slice: &Slice) -> Vec<([f64; 2], f64)> {
    let (grid, low) = grid_around(r.volume(), 0.5);
    let image_from_world = slice.world_from_image.affine().inverse();
    let values = voxels(&grid, low).filter_map(|(_, at)| {
        let (value, w) = r.volume().voxel(at);
        let place = image_from_world.transform_point3(DVec3::from_array(at.map(|x| x as f64 * 0.5)));
        (w > SEEN).then(|| ([place.x, place.y], f64::from(value / w)))
    });
    values.collect()
}

#[test]
fn fourth_order_matches_equations_within_deviation() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(3)), 6, 6.0, Depth::U8);
    let slices = scan.slices(0..scan.frames());
    let fast = reconstructed(method(Method::Gaussian4), fan(), &slices);
    let (grid, low) = grid_around(fast.volume(), 0.5);
    let mut slow = Reference::new(grid);
    slices.iter().for_each(|slice| slow.insert(slice, &fan(), fast.kernels().unwrap()));
    let (_, deviation) = fast.decimation().unwrap();
    assert!(deviation <= 0.002, "{deviation}");
    let (mut compared, mut differ) = (0, 0);
    for (i, voxel) in voxels(&grid, low) {
        let (r, w) = fast.volume().voxel(voxel);
        if (f64::from(w) - slow.w[i]).abs() > 1e-3 + 2.0 * deviation * slow.w[i] {
            differ += 1;
        } else if let Some(value) = slow.value(i).filter(|_| slow.w[i] > 0.05 && w > SEEN) {
            compared += 1;
            let error = (f64::from(r / w) - value).abs();
            assert!(error <= 5.0 * 2.0 * deviation * 255.0, "{voxel:?}: {error}");
        }
    }
    assert!(compared > 500 && differ * 50 < compared, "{differ} of {compared}");
}

#[test]
fn fourth_order_keeps_curvature_that_gaussian_blurs() {
    // A parabola along u, of which a Gaussian raises every value by σ², in pixels².
    let slice = painted(|u, _| 0.05 * (u as f32 - 36.0).powi(2));
    let raised = |settings: Settings| {
        let r = reconstructed(settings, Mask::full(72, 60), std::slice::from_ref(&slice));
        let inside =
            seen(&r, &slice).into_iter().filter(|([u, v], _)| (20.0..52.0).contains(u) && (14.0..46.0).contains(v));
        let errors: Vec<f64> = inside.map(|([u, _], value)| value - 0.05 * (u - 36.0).powi(2)).collect();
        assert!(errors.len() > 300);
        errors.iter().sum::<f64>() / errors.len() as f64
    };
    let sigma_px = 0.4 / 0.25;
    let gaussian = raised(method(Method::GaussianTruncated));
    assert!((gaussian / (0.05 * sigma_px * sigma_px) - 1.0).abs() < 0.1, "{gaussian}");
    let fourth = raised(method(Method::Gaussian4));
    assert!(fourth.abs() < 0.05 * gaussian, "{fourth} {gaussian}");
}

#[test]
fn fourth_order_leaves_constant_constant_up_to_the_rim() {
    let slice = painted(|_, _| 137.0);
    let r = reconstructed(method(Method::Gaussian4), fan(), std::slice::from_ref(&slice));
    let values = seen(&r, &slice);
    assert!(values.len() > 500);
    assert!(values.iter().all(|(_, value)| (value - 137.0).abs() < 1e-3));
}

#[test]
fn fourth_order_gives_same_bits_anywhere() {
    let scan = scan(Scene::Blobs(phantom::scene::Blobs::draw(1)), 6, 6.0, Depth::U8);
    let slices = scan.slices(0..scan.frames());
    let run = |simd, threads| {
        bits(reconstructed(Settings { simd, threads, ..method(Method::Gaussian4) }, fan(), &slices).volume())
    };
    let expected = run(Simd::Portable, 1);
    for simd in Simd::ALL.into_iter().filter(|simd| simd.is_available()) {
        assert!(run(simd, 3) == expected, "{}", simd.name());
    }
}

#[test]
fn fourth_order_is_refused_on_planar_path() {
    let beyond = method(Method::Gaussian4).beyond_planar();
    assert_eq!(beyond.as_deref(), Some("the kernel gaussian4"));
}
