//! Updates limited to a slab, and samples that no ray reaches.

use reconstruct::planar::PlanarSettings;

use super::*;

fn same(a: &Picture, b: &Picture) -> bool {
    a.pixels.iter().zip(&b.pixels).all(|(a, b)| a.map(f32::to_bits) == b.map(f32::to_bits))
}

#[test]
fn slab_update_changes_no_bit_on_either_path() {
    let xray = Transfer::preset("xray", [0.0, 255.0]).unwrap();
    for (planar, motion) in [(false, Motion::Freehand), (false, Motion::Crossing), (true, Motion::Jittered)] {
        for settings in all_settings().into_iter().take(3) {
            let (scan, reconstruction, region) = sweep(14, motion, DMat3::IDENTITY);
            let mask = scan.mask().clone();
            let mut reconstructor = match planar {
                true => PathReconstructor::planar(reconstruction, PlanarSettings::default(), mask).unwrap(),
                false => PathReconstructor::general(reconstruction, mask).unwrap(),
            };
            let settings = RenderSettings { transfer: xray.clone(), ..settings };
            let mut renderers: Option<[Renderer; 2]> = None;
            for frame in 0..scan.frames() {
                let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
                let slab = touched.slab.expect("the slice lies somewhere");
                let [low, high] = region.bounds();
                let region = RenderRegion::new(reconstructor.world_from_lattice(), low, high).unwrap();
                let [by_slab, by_boxes] = renderers.get_or_insert_with(|| {
                    [Renderer::new(&settings, region).unwrap(), Renderer::new(&settings, region).unwrap()]
                });
                // A debug assertion inside checks that the slab holds each changed voxel.
                by_slab.update_within(reconstructor.volume(), &touched.bricks, &slab);
                by_boxes.update(reconstructor.volume(), &touched.bricks);
                assert!(
                    same(&by_slab.picture(), &by_boxes.picture()),
                    "frame {frame}, {motion:?}, {:?}",
                    settings.view
                );
            }
            let [by_slab, by_boxes] = renderers.unwrap().map(|r| r.work());
            assert!(by_slab.pixels_changed > 500 && by_slab.pixels_changed == by_boxes.pixels_changed);
            assert!(by_slab.pixels_met < by_boxes.pixels_met, "{by_slab:?} {by_boxes:?}");
            // Boxes can fit closer if the slice lies along the lattice.
            assert!(by_slab.samples_marked < by_boxes.samples_marked * 5 / 4, "{by_slab:?} {by_boxes:?}");
        }
    }
}

#[test]
fn stale_samples_behind_plate_update_when_it_goes() {
    let curve = Curve::new(&[(0.0, 0.0), (100.0, 0.0), (200.0, 0.2), (250.0, 1.0)]).unwrap();
    let transfer = Transfer::new(Opacity::Curve(curve), 0.5, Colour::grey([0.0, 255.0]).unwrap()).unwrap();
    // Viewed along y: an optional opaque plate in front, and a body of the given brightness
    // behind.
    let scene = |wall: bool, size: i64, bright: f32| {
        let body =
            move |[x, y, z]: [i64; 3]| (y - 48).abs() <= size && (x - 20).abs() <= size && (z - 20).abs() <= size;
        let value = move |at: [i64; 3]| {
            Some(match at {
                [_, 0..8, _] if wall => 255.0,
                _ if body(at) => bright,
                _ => 10.0,
            })
        };
        Field { low: [0; 3], high: [39, 63, 39], value }
    };
    for cache in [Cache::TwoLevel, Cache::Linear, Cache::OneLevel] {
        let settings = RenderSettings { cache, ..RenderSettings::new([48, 48], transfer.clone()) };
        let region = RenderRegion::new(half_mm(), [0; 3], [39, 63, 39]).unwrap();
        let mut renderer = Renderer::new(&settings, region).unwrap();
        renderer.update_all(&scene(true, 8, 150.0));
        let before = renderer.picture();
        // A wide change, then a narrower one that must not discard the first.
        for (size, bright) in [(8, 190.0), (3, 160.0)] {
            let work = renderer.update_all(&scene(true, size, bright)).work;
            assert!(work.rays > 20 && work.samples_marked > 500, "{cache:?}: {work:?}");
            assert_eq!([work.samples, work.samples_skipped, work.pixels_changed], [0; 3], "{cache:?}: {work:?}");
        }
        assert!(same(&before, &renderer.picture()));
        let gone = scene(false, 3, 160.0);
        renderer.update_all(&gone);
        let mut whole = Renderer::new(&settings, region).unwrap();
        whole.update_all(&gone);
        assert!(same(&renderer.picture(), &whole.picture()), "{cache:?}");
        assert!(whole.picture().pixels.iter().filter(|p| p[3] < 0.9).count() > 20);
    }
}
