use std::time::Duration;

use super::super::layers::{Channels, channels};
use super::*;

const STEP: Duration = Duration::ZERO;

fn from(azimuth: f64, elevation: f64) -> View {
    View { azimuth, elevation, ..View::default() }
}

fn fresh(settings: &RenderSettings, view: View, volume: &(impl Values + ?Sized), region: RenderRegion) -> Picture {
    let mut renderer = Renderer::new(&RenderSettings { view, ..settings.clone() }, region).unwrap();
    renderer.update_all(volume);
    renderer.picture()
}

fn finish(renderer: &mut Renderer) {
    let progress = renderer.refine(Duration::from_secs(3600));
    assert!(progress.finished && progress.spacing == 1, "{progress:?}");
}

#[test]
fn any_order_of_views_and_slices_gives_same_picture() {
    let turned = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_y(0.2);
    for (n, base) in all_settings().into_iter().enumerate() {
        // Every second case uses adaptive rays.
        let settings = RenderSettings { adaptive: if n % 2 == 0 { 0.0 } else { 0.01 }, ..base };
        let (scan, reconstruction, region) = sweep(36, [Motion::Crossing, Motion::Freehand][n % 2], turned);
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let mut renderer = Renderer::new(&settings, region).unwrap();
        let (mut view, mut steps) = (settings.view, 0);
        let mut compared = 0;
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            renderer.update(reconstructor.volume(), &touched.bricks);
            // View changes before and during relighting, during set-up and refinement, and at
            // rest.
            if frame % 5 == 4 {
                let perspective = (frame % 2 == 0).then_some(30.0);
                view = View { perspective, ..from(f64::from(frame) * 23.0, f64::from(frame) - 18.0) };
                renderer.set_view(view).unwrap();
                steps = [0, 2, 6, 11, 40, 17][frame as usize / 5 % 6];
            }
            for _ in 0..steps / 4 {
                renderer.refine(STEP);
            }
            if frame % 9 == 8 {
                finish(&mut renderer);
                assert_eq!(
                    renderer.picture(),
                    fresh(&settings, view, reconstructor.volume(), region),
                    "{n}, frame {frame}"
                );
                compared += 1;
            }
        }
        finish(&mut renderer);
        assert_eq!(renderer.picture(), fresh(&settings, view, reconstructor.volume(), region), "{n}, at the end");
        assert!(compared > 2);
        // At rest nothing remains to be done, and the kept rays serve the next slice.
        assert_eq!(renderer.refine(STEP).work, RenderWork::default());
        let before = renderer.work().rays;
        let Some(slice) = scan.slices(0..1).pop() else { unreachable!() };
        let mut again = Renderer::new(&RenderSettings { view, ..settings.clone() }, region).unwrap();
        again.update_all(reconstructor.volume());
        let touched = reconstructor.insert(&slice).map(|touched| touched.bricks.to_vec()).unwrap_or_default();
        renderer.update(reconstructor.volume(), &touched);
        let work = again.update(reconstructor.volume(), &touched).work;
        // Adaptive rays that were not needed yet differ in their cached data.
        if settings.adaptive == 0.0 {
            assert_eq!(renderer.work().rays - before, work.rays, "as many rays as a renderer that never turned");
        }
        assert_eq!(renderer.picture(), again.picture());
    }
}

#[test]
fn refinement_error_falls_with_each_step_or_depth() {
    let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    scan.slices(0..24).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
    let cases = all_settings().into_iter().zip([from(0.0, 0.0), from(70.0, 10.0), from(200.0, 45.0)]);
    for ((base, view), adaptive) in cases.flat_map(|case| [(case.clone(), 0.0), (case, 0.002)]) {
        let settings = RenderSettings { adaptive, ..base };
        let exact = fresh(&settings, view, reconstructor.volume(), region);
        let mut renderer = Renderer::new(&settings, region).unwrap();
        renderer.update_all(reconstructor.volume());
        let changed = renderer.set_view(view).unwrap().work;
        assert!(
            changed.coarse_rays > 50 && changed.coarse_rays < 150 && changed.rays == 0 && changed.voxels_shaded == 0
        );
        let rms = |renderer: &Renderer| exact.difference(&renderer.picture())[1];
        let (mut errors, mut spacing) = (vec![rms(&renderer)], 8);
        let nothing = Picture { pixels: vec![[0.0, 0.0, 0.0, 1.0]; exact.pixels.len()], ..exact.clone() };
        let blind = exact.difference(&nothing)[1];
        assert!(errors[0] < blind, "{errors:?} of {blind}");
        loop {
            let progress = renderer.refine(STEP);
            // Adaptive rays have less error once a depth is complete.
            if adaptive == 0.0 || progress.spacing < spacing || progress.finished {
                spacing = progress.spacing;
                errors.push(rms(&renderer));
            }
            if progress.finished {
                break;
            }
        }
        assert!(errors.len() >= 5 && errors.windows(2).all(|pair| pair[1] <= pair[0]), "{errors:?}");
        assert_eq!(errors.last(), Some(&0.0));
    }
}

#[test]
fn new_view_skips_empty_space() {
    let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    scan.slices(0..24).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
    let transfer = Transfer::preset("phantom", [0.0, 255.0]).unwrap();
    for perspective in [None, Some(40.0)] {
        let settings = RenderSettings::new([160, 120], transfer.clone());
        let mut renderer = Renderer::new(&settings, region).unwrap();
        renderer.update_all(reconstructor.volume());
        renderer.set_view(View { perspective, ..from(70.0, 10.0) }).unwrap();
        let work = renderer.refine(Duration::from_secs(3600)).work;
        let all: u32 = channels!(renderer.image(), layers => {
            layers.rows.iter().flat_map(|row| row.lines()).map(|line| line.end - line.first).sum()
        });
        assert!(work.samples > 1000, "{work:?}");
        assert!(5 * (work.samples + work.samples_skipped) < u64::from(all), "{work:?} of {all}");
        // A turn makes all rays new, and casts each that meets the region once.
        assert!(work.rays <= 160 * 120 && work.rays > 160 * 120 / 4, "{work:?}");
    }
}

#[test]
fn slice_during_refinement_restarts_only_what_it_reaches() {
    let (scan, reconstruction, region) = sweep(24, Motion::Parallel, DMat3::IDENTITY);
    for adaptive in [0.0, 0.001] {
        let mut reconstructor = PathReconstructor::general(reconstruction.clone(), scan.mask().clone()).unwrap();
        let base = RenderSettings { view: from(90.0, 0.0), ..RenderSettings::new([512, 96], tissue()) };
        let settings = RenderSettings { adaptive, ..base };
        let mut renderer = Renderer::new(&settings, region).unwrap();
        for frame in 0..23 {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            renderer.update(reconstructor.volume(), &touched.bricks);
        }
        renderer.set_view(from(90.0, 3.0)).unwrap();
        // Until some rays are cast, but not all.
        while renderer.refine(STEP).work.rays == 0 || adaptive > 0.0 && renderer.refine(STEP).spacing > 2 {}
        let before = renderer.picture();
        let touched = reconstructor.insert(&scan.slice(23)).unwrap();
        let work = renderer.update(reconstructor.volume(), &touched.bricks).work;
        assert!(work.rays > 0 && work.rays < 512 * 96 / 2, "{work:?}");
        assert_eq!((work.regions > 0, work.coarse_rays > 0), (adaptive > 0.0, adaptive == 0.0), "{work:?}");
        let same = before.pixels.iter().zip(&renderer.picture().pixels).filter(|(a, b)| a == b).count();
        assert!(same > 512 * 96 / 2, "{same}");
        assert!(!renderer.refine(STEP).finished || adaptive == 0.0);
        finish(&mut renderer);
        assert_eq!(renderer.picture(), fresh(&settings, from(90.0, 3.0), reconstructor.volume(), region));
    }
}

#[test]
fn fixed_light_is_kept_for_new_view() {
    let (scan, reconstruction, region) = sweep(12, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    scan.slices(0..12).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
    let view = from(60.0, 10.0);
    let parts = |diffuse, specular| Light::default().with_parts(0.3, diffuse, specular, 4).unwrap();
    let sun = light::Source::Fixed(DVec3::new(1.0, -1.0, 2.0));
    let cue = light::DepthCue::new(1.0, 0.5).unwrap();
    for (light, again) in [
        (parts(0.7, 0.0).with_source(sun).unwrap(), false),
        (parts(0.0, 0.0), false),
        (parts(0.7, 0.0), true),
        (parts(0.7, 0.2).with_source(sun).unwrap(), true),
        (parts(0.0, 0.0).with_depth_cue(Some(cue)), true),
    ] {
        let settings = RenderSettings { light, ..RenderSettings::new([64, 64], tissue()) };
        let mut renderer = Renderer::new(&settings, region).unwrap();
        let all = renderer.update_all(reconstructor.volume()).work.voxels_shaded;
        renderer.set_view(view).unwrap();
        let shaded = renderer.refine(Duration::from_secs(3600)).work.voxels_shaded;
        assert!(if again { shaded > 0 && shaded <= all } else { shaded == 0 }, "{light:?}: {shaded} of {all}");
        assert_eq!(renderer.picture(), fresh(&settings, view, reconstructor.volume(), region), "{light:?}");
    }
}

#[test]
fn hidden_view_does_nothing_then_catches_up() {
    let (scan, reconstruction, region) = sweep(20, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    let settings = RenderSettings::new([64, 64], tissue());
    let mut renderer = Renderer::new(&settings, region).unwrap();
    let insert = |frames: std::ops::Range<u32>, reconstructor: &mut PathReconstructor, renderer: &mut Renderer| {
        for frame in frames {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            renderer.update(reconstructor.volume(), &touched.bricks);
        }
    };
    insert(0..8, &mut reconstructor, &mut renderer);
    let (work, picture) = (renderer.work(), renderer.picture());
    renderer.hide();
    insert(8..14, &mut reconstructor, &mut renderer);
    assert_eq!((renderer.work(), renderer.picture()), (work, picture));
    assert!(renderer.show(reconstructor.volume()).work.bricks_changed > 0);
    assert_eq!(renderer.picture(), fresh(&settings, settings.view, reconstructor.volume(), region));
    // Nor for a new view.
    let work = renderer.work();
    renderer.hide();
    let view = from(45.0, 45.0);
    renderer.set_view(view).unwrap();
    insert(14..20, &mut reconstructor, &mut renderer);
    assert!(!renderer.refine(Duration::from_secs(1)).finished);
    assert_eq!(renderer.work(), work);
    renderer.show(reconstructor.volume());
    assert_eq!(renderer.show(reconstructor.volume()).work, RenderWork::default(), "the view is visible already");
    finish(&mut renderer);
    assert_eq!(renderer.picture(), fresh(&settings, view, reconstructor.volume(), region));
}

#[test]
fn invalid_or_same_view_changes_nothing() {
    let (scan, reconstruction, region) = sweep(6, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    scan.slices(0..6).iter().for_each(|slice| drop(reconstructor.insert(slice).unwrap()));
    let settings = RenderSettings::new([64, 64], tissue());
    let mut renderer = Renderer::new(&settings, region).unwrap();
    renderer.update_all(reconstructor.volume());
    let (work, picture) = (renderer.work(), renderer.picture());
    assert!(renderer.set_view(from(f64::NAN, 0.0)).is_err());
    assert_eq!(renderer.set_view(settings.view).unwrap().work, RenderWork::default());
    assert!(renderer.refine(STEP).finished);
    assert_eq!((renderer.work(), renderer.picture()), (work, picture));
    // If a cache is too large for one view, the next view chooses it again.
    let wide = from(45.0, 35.0);
    let of = |view| Renderer::new(&RenderSettings { view, ..settings.clone() }, region).unwrap();
    let (front, corner) = (of(settings.view), of(wide));
    assert_ne!(front.memory().rays, corner.memory().rays);
    renderer.set_view(wide).unwrap();
    finish(&mut renderer);
    assert_eq!(renderer.cache(), corner.cache());
    // The room of longer rays is kept.
    assert_eq!(renderer.memory().rays, front.memory().rays.max(corner.memory().rays));
}
