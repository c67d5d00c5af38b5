use super::*;

/// One grey level, as a share of the full range.
const GREY: f32 = 1.0 / 255.0;

fn picture(volume: &(impl Values + ?Sized), settings: &RenderSettings, region: RenderRegion) -> (Picture, RenderWork) {
    let mut renderer = Renderer::new(settings, region).unwrap();
    let work = renderer.update_all(volume).work;
    (renderer.picture(), work)
}

/// A body of fog of this radius about a place, opaque inside and thinning out over its border.
fn body(centre: DVec3, radius: f64, border: f64) -> impl Fn([i64; 3]) -> f64 {
    move |at: [i64; 3]| {
        let distance = (DVec3::from_array(at.map(|x| x as f64)) - centre).length();
        let part = ((radius - distance) / border).clamp(0.0, 1.0);
        part * part * (3.0 - 2.0 * part)
    }
}

/// Opacity from transparent black at 0 to white at 255, which has opacity `alpha` per voxel;
/// flat light.
fn clear(alpha: f64) -> RenderSettings {
    let curve = Curve::new(&[(0.0, 0.0), (255.0, alpha)]).unwrap();
    let transfer = Transfer::new(Opacity::Curve(curve), 0.5, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
    let light = Light::default().with_parts(1.0, 0.0, 0.0, 1).unwrap();
    RenderSettings { light, stop: 0.0, ..RenderSettings::new([70, 61], transfer) }
}

#[test]
fn adaptive_incremental_picture_equals_full_picture() {
    let turned = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_y(0.2);
    let mut shows = 0;
    for (n, (base, epsilon)) in all_settings().into_iter().zip([4.0, 1.0, 8.0, 40.0, 20.0]).enumerate() {
        let settings = RenderSettings { adaptive: epsilon * GREY, size: [160, 128], ..base };
        let (scan, reconstruction, region) = sweep(30, [Motion::Freehand, Motion::Crossing][n % 2], turned);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let mut following = Renderer::new(&settings, region).unwrap();
        let mut unlike = [true; 2];
        let mut done = RenderWork::default();
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            following.update(reconstructor.volume(), &touched.bricks);
            if frame % 7 == 6 || frame + 1 == scan.frames() {
                let cache = Cache::ALL[frame as usize % 4];
                let threads = 1 + frame as usize % 3;
                let other = RenderSettings { cache, threads, ..settings.clone() };
                let (whole, work) = picture(reconstructor.volume(), &other, region);
                assert_eq!(whole, following.picture(), "frame {frame}, {n}: {cache:?} on {threads} threads");
                let (exact, _) = picture(reconstructor.volume(), &RenderSettings { adaptive: 0.0, ..other }, region);
                done = work;
                unlike = [unlike[0] && exact != whole, unlike[1] && work.pixels_interpolated > 500];
            }
        }
        assert!(unlike[1], "{n}: rays are left out: {done:?}");
        shows += u32::from(unlike[0]);
    }
    // If rays are left out only in clear water, the error does not show.
    assert!(shows >= 2, "{shows} of 5");
}

#[test]
fn tiny_threshold_changes_at_most_one_grey_level() {
    for base in all_settings() {
        let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        scan.slices(0..24).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
        let (exact, all) = picture(reconstructor.volume(), &base, region);
        let (tiny, few) = picture(reconstructor.volume(), &RenderSettings { adaptive: 1e-6, ..base.clone() }, region);
        let off = exact.over([0.0; 3]).iter().zip(tiny.over([0.0; 3])).map(|(a, b)| a.abs_diff(b)).max().unwrap();
        assert!(off <= 1, "{:?}: {off} grey levels", base.view);
        assert!(few.rays <= all.rays && few.regions > 0, "{few:?} {all:?}");
        // Without sparse rays no ray is cast twice.
        let (zero, work) = picture(reconstructor.volume(), &RenderSettings { adaptive: 0.0, ..base }, region);
        assert_eq!((zero, work.regions, work.pixels_interpolated), (exact, 0, 0));
    }
}

#[test]
fn dot_or_wire_between_region_corners_is_found() {
    let (low, high) = ([0; 3], [59; 3]);
    let region = RenderRegion::new(half_mm(), low, high).unwrap();
    for (view, adaptive) in [
        (View::default(), 4.0 * GREY),
        (View { azimuth: 30.0, elevation: 20.0, ..View::default() }, 2.0 * GREY),
        (View { azimuth: -70.0, elevation: 40.0, perspective: Some(40.0), ..View::default() }, 8.0 * GREY),
    ] {
        // In front of, or in, a body equally opaque, whose picture is even.
        let settings = RenderSettings { view, adaptive, size: [140, 122], ..clear(0.9) };
        let beyond = DVec3::splat(30.0) + view.axes().forward * 16.0;
        let wall = body(beyond, 14.0, 6.0);
        for step in 0..9_i64 {
            let dot = [23 + step, 20 + step % 3, 24 + (step * 5) % 8];
            let wire = |at: [i64; 3]| (at[0] - at[2] == step) && at[1] == 12;
            let small = |at: [i64; 3]| if at == dot { Some(255.0) } else { wire(at).then_some(180.0) };
            let volume = Field { low, high, value: |at| small(at).or(Some(200.0 * wall(at) as f32)) };
            let (exact, all) = picture(&volume, &RenderSettings { adaptive: 0.0, ..settings.clone() }, region);
            let (found, few) = picture(&volume, &settings, region);
            let without = Field { low, high, value: |at| Some(200.0 * wall(at) as f32) };
            let (empty, _) = picture(&without, &RenderSettings { adaptive: 0.0, ..settings.clone() }, region);
            let shows = exact.difference(&empty)[0];
            // The picture must be right where the small features show.
            let mut worst = 0.0_f32;
            for ((exact, found), empty) in exact.pixels.iter().zip(&found.pixels).zip(&empty.pixels) {
                let off = |a: &[f32; 4], b: &[f32; 4]| (0..4).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
                if off(exact, empty) > adaptive {
                    worst = worst.max(off(exact, found));
                }
            }
            assert!(shows > 0.2 && worst <= adaptive, "{view:?}, {step}: {worst} of {shows}");
            assert!(few.rays < all.rays && few.regions_split < few.regions, "{few:?} {all:?}");
        }
    }
}

#[test]
fn even_picture_error_stays_within_threshold() {
    let (low, high) = ([0; 3], [69; 3]);
    let region = RenderRegion::new(half_mm(), low, high).unwrap();
    let fog = body(DVec3::splat(35.0), 34.0, 33.0);
    let volume = Field { low, high, value: |at| Some(255.0 * fog(at) as f32) };
    let view = View { azimuth: 20.0, elevation: 30.0, ..View::default() };
    let exact = RenderSettings { view, size: [200, 170], ..clear(0.008) };
    let (full, all) = picture(&volume, &exact, region);
    let mut rays = all.rays;
    for epsilon in [1.0, 2.0, 4.0, 8.0] {
        let settings = RenderSettings { adaptive: epsilon * GREY, ..exact.clone() };
        let (few, work) = picture(&volume, &settings, region);
        let [most, rms] = full.difference(&few);
        assert!(most <= f64::from(epsilon * GREY) && rms < 0.2 * f64::from(epsilon * GREY), "{epsilon}: {most} {rms}");
        assert!(work.rays < rays, "{epsilon}: {} rays of {rays}", work.rays);
        rays = work.rays;
    }
    assert!(rays * 3 < all.rays, "{rays} of {}", all.rays);
}

#[test]
fn small_pictures_have_regions() {
    let (low, high) = ([0; 3], [20; 3]);
    let region = RenderRegion::new(half_mm(), low, high).unwrap();
    let fog = body(DVec3::splat(10.0), 9.0, 4.0);
    let volume = Field { low, high, value: |at| Some(255.0 * fog(at) as f32) };
    for size in [[1, 1], [1, 9], [2, 1], [8, 9], [9, 8], [10, 17], [65, 3]] {
        let settings = RenderSettings { size, adaptive: 1e-7, threads: 2, ..clear(0.4) };
        let (exact, _) = picture(&volume, &RenderSettings { adaptive: 0.0, ..settings.clone() }, region);
        let (split, _) = picture(&volume, &settings, region);
        assert!(exact.difference(&split)[0] < 1e-6, "{size:?}: {:?}", exact.difference(&split));
        let coarse = RenderSettings { adaptive: 1.0, ..settings };
        assert!(picture(&volume, &coarse, region).0.pixels.iter().flatten().all(|x| (0.0..=1.0).contains(x)));
    }
    let settings = |adaptive| RenderSettings { adaptive, ..clear(0.4) };
    for wrong in [-0.1, 1.5, f32::NAN] {
        let refusal = Renderer::new(&settings(wrong), region).err().unwrap().to_string();
        assert!(refusal.contains("rays can"), "{refusal}");
    }
}
