use fastrand::Rng;

use super::*;
use crate::crop::{Crop, Operation};

/// A volume whose hidden voxels were not seen.
struct Without<'a, V> {
    volume: &'a V,
    hides: &'a (dyn Fn(DVec3) -> bool + Sync),
}

impl<V: Values> Values for Without<'_, V> {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        self.volume.values(start, value, weight);
        for (x, (value, weight)) in (0..).zip(value.iter_mut().zip(weight)) {
            let at =
                half_mm().affine().transform_point3(DVec3::from([start[0] + x, start[1], start[2]].map(|x| x as f64)));
            if (self.hides)(at) {
                (*value, *weight) = (0.0, 0.0);
            }
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        self.volume.bricks()
    }
}

fn body() -> Field<impl Fn([i64; 3]) -> Option<f32> + Sync> {
    let value = |at: [i64; 3]| {
        let [x, y, z] = at.map(|x| x as f32 * 0.3);
        Some(120.0 + 60.0 * x.sin() * (0.7 * y).cos() + 30.0 * (1.3 * z).sin())
    };
    Field { low: [0; 3], high: [47; 3], value }
}

fn picture(settings: &RenderSettings, volume: &(impl Values + ?Sized), region: RenderRegion) -> Picture {
    let mut renderer = Renderer::new(settings, region).unwrap();
    renderer.update_all(volume);
    renderer.picture()
}

#[test]
fn cropped_picture_is_that_of_a_volume_never_seen_there() {
    let volume = body();
    let region = RenderRegion::new(half_mm(), volume.low, volume.high).unwrap();
    let plane = Operation::BeyondPlane { point: [12.0, 10.0, 9.0], normal: [1.0, 2.0, 0.5] };
    let ball = Operation::Ball { centre: [5.0, 4.0, 18.0], radius: 6.0 };
    let hides = |at: DVec3| {
        DVec3::new(1.0, 2.0, 0.5).dot(at - DVec3::new(12.0, 10.0, 9.0)) > 0.0
            || at.distance(DVec3::new(5.0, 4.0, 18.0)) < 6.0
    };
    let cut = Without { volume: &volume, hides: &hides };
    for (mode, parts, threads) in [
        (Mode::default(), None, 2),
        (Mode::default(), Some(3), 2),
        (Mode::Maximum, None, 1),
        (Mode::Isosurface(150.0), None, 1),
        (Mode::Shaded(Shading::Sample), None, 2),
    ] {
        let whole = RenderSettings { mode, parts, threads, ..RenderSettings::new([48, 40], tissue()) };
        let crop = Crop::new(vec![plane.clone(), ball.clone()]).unwrap();
        let cropped = RenderSettings { crop, ..whole.clone() };
        let [a, b] = [picture(&cropped, &volume, region), picture(&whole, &cut, region)];
        assert_eq!(a, b, "{mode:?}");
        assert!(a != picture(&whole, &volume, region), "{mode:?}: something is hidden");
        let exact = reference::render(&volume, &cropped, &region).unwrap();
        let [most, _] = exact.difference(&a);
        assert!(most <= 1.0 / 255.0, "{mode:?}: {most}");
    }
}

#[test]
fn crops_and_slices_in_turns_give_the_bits_of_a_new_picture() {
    let (scan, reconstruction, region) = sweep(24, Motion::Freehand, DMat3::IDENTITY);
    let mut rng = Rng::with_seed(7);
    for (parts, cache) in [(None, Cache::OneLevel), (None, Cache::Linear), (Some(2), Cache::OneLevel)] {
        let settings = RenderSettings { parts, cache, threads: 2, ..RenderSettings::new([40, 36], tissue()) };
        let mut reconstructor = PathReconstructor::general(reconstruction.clone(), scan.mask().clone()).unwrap();
        let mut renderer = Renderer::new(&settings, region).unwrap();
        let centre = region.centre_mm();
        let mut crop = Crop::default();
        let mut pictures: Vec<(Crop, u32, Picture)> = Vec::new();
        let (mut read, mut all) = (0, 0);
        for frame in 0..scan.frames() {
            let touched = reconstructor.insert(&scan.slice(frame)).unwrap();
            renderer.update(reconstructor.volume(), &touched.bricks);
            let near = (centre + 6.0 * DVec3::new(rng.f64() - 0.5, rng.f64() - 0.5, rng.f64() - 0.5)).to_array();
            crop = match rng.u8(0..8) {
                0 => crop.with(Operation::Nothing {}).unwrap(),
                1 | 2 => crop.undone().unwrap_or_default(),
                3 => {
                    let normal = [rng.f64() - 0.5, rng.f64() - 0.5, 0.1];
                    crop.with(Operation::BeyondPlane { point: near, normal }).unwrap()
                }
                _ => crop.with(Operation::Ball { centre: near, radius: 1.0 + 2.0 * rng.f64() }).unwrap(),
            };
            let updated = renderer.set_crop(crop.clone(), reconstructor.volume());
            (read, all) = (read + updated.work.bricks_read, all + reconstructor.volume().bricks().count() as u64);
            let fresh = RenderSettings { crop: crop.clone(), ..settings.clone() };
            let fresh = picture(&fresh, reconstructor.volume(), region);
            assert_eq!(renderer.picture(), fresh, "frame {frame}: {:?}", crop.present());
            pictures.push((crop.clone(), frame, fresh));
        }
        assert!(2 * read < all, "{read} of {all} bricks were read for crops");
        // The volume's last state with each crop in turn: undoing restores the bits.
        for (crop, frame, fresh) in pictures.iter().rev() {
            renderer.set_crop(crop.clone(), reconstructor.volume());
            if frame + 1 == scan.frames() {
                assert_eq!(renderer.picture(), *fresh);
            }
        }
        let (last, _, fresh) = &pictures[pictures.len() - 1];
        renderer.set_crop(last.clone(), reconstructor.volume());
        assert_eq!(renderer.picture(), *fresh, "as before");
    }
}
