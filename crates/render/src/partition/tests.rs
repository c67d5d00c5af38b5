use std::time::Duration;

use glam::DMat3;

use phantom::Motion;
use reconstruct::PathReconstructor;

use super::*;
use crate::Renderer;
use crate::camera::View;
use crate::picture::Picture;
use crate::tests::modes::ways;
use crate::tests::{all_settings, sweep};

mod bands;

#[test]
fn any_number_of_parts_gives_same_picture() {
    let turned = DMat3::from_rotation_z(0.4) * DMat3::from_rotation_x(0.3);
    for (base, motion) in all_settings().into_iter().zip([
        Motion::Freehand,
        Motion::Crossing,
        Motion::Jittered,
        Motion::Freehand,
        Motion::Parallel,
    ]) {
        let (scan, reconstruction, region) = sweep(16, motion, turned);
        for parts in [1, 2, 3, 8] {
            let mut reconstructor = PathReconstructor::general(reconstruction.clone(), scan.mask().clone()).unwrap();
            let mut renderer = Renderer::new(&base, region).unwrap();
            let mut compositor = Compositor::new(&base, &region).unwrap();
            let mut workers: Vec<Part> = (0..parts).map(|k| Part::new(&base, &region, k, parts).unwrap()).collect();
            let (mut sent, mut most) = (0, 0);
            for frame in 0..scan.frames() {
                let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
                renderer.update(reconstructor.volume(), &touched.bricks);
                for worker in &mut workers {
                    let message = worker
                        .update(&Within { volume: reconstructor.volume(), region: worker.region() }, &touched.bricks);
                    compositor.receive(&message.bytes).unwrap();
                    sent += message.bytes.len();
                    most = most.max(message.bytes.len());
                }
                let (a, b) = (compositor.picture(), renderer.picture());
                let same = a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits));
                assert!(same, "{parts} parts, frame {frame}: {:?} off {:?}", base.view, a.difference(&b));
            }
            // All the voxels that slices changed would be several times as much.
            assert!(sent > 0 && most < 300_000, "{sent} {most}");
            // Unchanged bricks cause no work.
            let all: Vec<BrickIndex> = reconstructor.volume().bricks().collect();
            for worker in &mut workers {
                let message = worker.update(&Within { volume: reconstructor.volume(), region: worker.region() }, &all);
                let idle = RenderWork { bricks_read: message.work.bricks_read, ..RenderWork::default() };
                assert!(message.bytes.is_empty() && message.work == idle, "{:?}", message.work);
            }
        }
    }
}

#[test]
fn parts_give_same_picture_in_every_mode() {
    for base in ways() {
        let (scan, reconstruction, region) = sweep(12, Motion::Freehand, DMat3::from_rotation_x(0.3));
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let mut compositor = Compositor::new(&base, &region).unwrap();
        let mut workers: Vec<Part> = (0..3).map(|k| Part::new(&base, &region, k, 3).unwrap()).collect();
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            for worker in &mut workers {
                let region = Within { volume: reconstructor.volume(), region: worker.region() };
                compositor.receive(&worker.update(&region, &touched.bricks).bytes).unwrap();
            }
        }
        let mut renderer = Renderer::new(&base, region).unwrap();
        renderer.update_all(reconstructor.volume());
        let (a, b) = (compositor.picture(), renderer.picture());
        assert!(a == b, "{:?}: off by {:?}", base.mode, a.difference(&b));
    }
}

/// A volume that holds only a region.
struct Within<'a, V: ?Sized> {
    volume: &'a V,
    region: [[i64; 3]; 2],
}

impl<V: Values + ?Sized> Values for Within<'_, V> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        self.volume.values(start, value, weight);
        let [low, high] = self.region;
        for (x, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
            let at = [start[0] + x as i64, start[1], start[2]];
            if (0..3).any(|a| !(low[a]..=high[a]).contains(&at[a])) {
                (*value, *weight) = (f32::NAN, 1.0);
            }
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.volume.bricks()
    }
}

#[test]
fn invalid_parts_and_messages_are_refused() {
    let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
    let base = &all_settings()[0];
    let refused = |part, parts| Part::new(base, &region, part, parts).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(refused(2, 2).contains("part 2 of 2") && refused(0, 0).contains("from 0 on"));
    assert!(refused(0, 1000).contains("one a layer"));
    let mut compositor = Compositor::new(base, &region).unwrap();
    let before = compositor.picture();
    for bytes in [&[1, 2, 3][..], &[255; 14][..]] {
        assert!(compositor.receive(bytes).is_err_and(|e| e.to_string().contains("message")));
    }
    assert_eq!(compositor.receive(&[]), Ok(0));
    assert_eq!(compositor.picture(), before);
}

fn same(a: &Picture, b: &Picture) -> bool {
    a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits))
}

/// Compares a renderer in parts with one without: pixels, places and hidden places.
fn assert_same(in_parts: &Renderer, plain: &Renderer, what: &str) {
    let (a, b) = (in_parts.picture(), plain.picture());
    assert!(same(&a, &b), "{what}: off by {:?}", a.difference(&b));
    let [width, height] = a.size.map(f64::from);
    for share in [0.31, 0.5, 0.62] {
        let at = [share * width, (1.0 - share) * height];
        let picked = in_parts.pick(at);
        assert_eq!(picked, plain.pick(at), "{what}: pixel {at:?}");
        for place in picked.iter().map(|picked| picked.point + picked.along) {
            let [a, b] = [in_parts, plain].map(|renderer| renderer.transmittance_to(place).to_bits());
            assert_eq!(a, b, "{what}: before {place}");
        }
    }
    assert_eq!(in_parts.bricks(), plain.bricks(), "{what}");
}

#[test]
fn renderer_in_parts_makes_same_bits_on_any_threads() {
    for (base, motion) in all_settings().into_iter().zip([Motion::Freehand, Motion::Crossing].into_iter().cycle()) {
        let (scan, reconstruction, region) = sweep(12, motion, DMat3::IDENTITY);
        let layers = region.bricks()[2];
        let with = |parts, threads| RenderSettings { parts: Some(parts), threads, ..base.clone() };
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let mut plain = Renderer::new(&with(1, 1), region).unwrap();
        let ways: Vec<(u32, usize)> = (1..=8).flat_map(|parts| [(parts, 1), (parts, 2)]).chain([(1000, 2)]).collect();
        let mut in_parts: Vec<Renderer> =
            ways.iter().map(|(parts, threads)| Renderer::new(&with(*parts, *threads), region).unwrap()).collect();
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            plain.update(reconstructor.volume(), &touched.bricks);
            for (renderer, (parts, threads)) in in_parts.iter_mut().zip(&ways) {
                match &touched.slab {
                    Some(slab) if frame % 2 == 1 => {
                        renderer.update_within(reconstructor.volume(), &touched.bricks, slab);
                    }
                    _ => drop(renderer.update(reconstructor.volume(), &touched.bricks)),
                }
                assert_eq!(renderer.count_of_parts(), (*parts).min(layers));
                let what = format!("{parts} parts on {threads} threads, frame {frame}");
                assert_same(renderer, &plain, &what);
            }
        }
        assert!(plain.picture().pixels.iter().filter(|p| p[3] < 0.99).count() > 100, "something is seen");
        for (renderer, (parts, _)) in in_parts.iter_mut().zip(&ways) {
            assert_eq!(renderer.work().pixels_changed, plain.work().pixels_changed, "{parts} parts");
            let before = renderer.work();
            renderer.update_all(reconstructor.volume());
            let idle = RenderWork { bricks_read: renderer.work().bricks_read, ..before };
            assert_eq!(renderer.work(), idle, "unchanged bricks cause no work in {parts} parts");
        }
    }
}

#[test]
fn new_view_unites_parts_and_keeps_bits() {
    for base in all_settings().into_iter().chain(ways()) {
        let (scan, reconstruction, region) = sweep(14, Motion::Freehand, DMat3::from_rotation_x(0.3));
        let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
        let settings = RenderSettings { parts: Some(3), ..base.clone() };
        let mut renderer = Renderer::new(&settings, region).unwrap();
        let view = View { azimuth: -50.0, elevation: -20.0, ..base.view };
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            renderer.read(reconstructor.volume(), &touched.bricks);
            if frame == 9 {
                // Changes that were read and not drawn are not lost.
                assert_eq!(renderer.count_of_parts(), 3);
                renderer.set_view(view).unwrap();
                assert_eq!(renderer.count_of_parts(), 1);
                assert!(renderer.refine(Duration::MAX).finished);
            } else {
                renderer.draw();
            }
            if frame >= 8 {
                let view = if frame < 9 { base.view } else { view };
                let whole = RenderSettings { parts: Some(1), view, ..base.clone() };
                let mut plain = Renderer::new(&whole, region).unwrap();
                plain.update_all(reconstructor.volume());
                assert_same(&renderer, &plain, &format!("{:?}, frame {frame}", base.mode));
            }
        }
    }
}

#[test]
fn adaptive_rays_and_no_parts_are_refused() {
    let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
    let base = all_settings().remove(0);
    let refused = |parts, adaptive| Renderer::new(&RenderSettings { parts, adaptive, ..base.clone() }, region).err();
    assert_eq!(refused(Some(2), 0.01), Some(RenderError::AdaptiveParts { parts: 2 }));
    assert_eq!(refused(Some(0), 0.0), Some(RenderError::Part { part: 0, parts: 0, layers: region.bricks()[2] }));
    assert_eq!([refused(Some(1), 0.01), refused(None, 0.01)], [None, None]);
}

#[test]
fn parts_without_memory_for_blocks_are_left_out() {
    let (scan, reconstruction, region) = sweep(3, Motion::Freehand, DMat3::IDENTITY);
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    let settings = RenderSettings { parts: Some(4), cache_bytes: 1000, ..all_settings().remove(0) };
    let mut renderer = Renderer::new(&settings, region).unwrap();
    let mut plain = Renderer::new(&RenderSettings { parts: Some(1), ..settings }, region).unwrap();
    reconstructor.insert(&scan.slice(1)).unwrap();
    renderer.update_all(reconstructor.volume());
    plain.update_all(reconstructor.volume());
    assert_same(&renderer, &plain, "no memory");
    assert_eq!((renderer.count_of_parts(), renderer.cache()), (1, Cache::None));
    assert!(renderer.notes().iter().any(|note| note.contains("4 parts")), "{:?}", renderer.notes());
}

#[test]
fn pictures_are_cut_only_where_asked() {
    let (_, _, region) = sweep(2, Motion::Freehand, DMat3::IDENTITY);
    let base = RenderSettings { size: [16; 2], cache: Cache::None, threads: 2, ..all_settings().remove(0) };
    let parts = |parts| Renderer::new(&RenderSettings { parts, ..base.clone() }, region).unwrap().count_of_parts();
    assert_eq!([None, Some(1), Some(2)].map(parts), [1, 1, 2]);
}
