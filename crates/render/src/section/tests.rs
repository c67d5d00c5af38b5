use std::sync::Arc;

use glam::{DAffine3, DMat3, DQuat, DVec3};
use proptest::prelude::*;

use ::volume::Values;
use ::volume::brick::BrickIndex;
use mask::Mask;
use sonoweave_core::frames::Transform;
use sonoweave_core::region::ClipRect;
use sonoweave_core::slice::{Image, Pixels, Slice};

use super::layout::{Room, three};
use super::*;
use crate::settings::team;

/// A volume defined by a function of the voxel index: value and weight.
struct Made<F>(F);

impl<F: Fn([i64; 3]) -> (f32, f32) + Sync> Values for Made<F> {
    fn values(&self, [x, y, z]: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (n, (value, weight)) in (0..).zip(value.iter_mut().zip(weight)) {
            (*value, *weight) = (self.0)([x + n, y, z]);
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(std::iter::empty())
    }
}

/// Returns a rotated lattice of uneven spacing.
fn place(low: [i64; 3], high: [i64; 3]) -> Box3 {
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.4, -1.1, 0.7)));
    let lattice = DAffine3 {
        matrix3: turn * DMat3::from_diagonal(DVec3::new(0.3, 0.5, 1.25)),
        translation: DVec3::new(12.0, -30.0, 4.5),
    };
    Box3::new(Transform::from_affine(lattice), [low, high])
}

fn sample<F: Fn([i64; 3]) -> (f32, f32) + Sync>(
    volume: &Made<F>,
    place: Box3,
    section: &Section,
) -> (Vec<Sampled>, PlanarWork) {
    Planar { volume, place, team: None }.sample(section)
}

#[test]
fn plane_through_ramp_is_exact() {
    let place = place([-7, 3, -2], [25, 30, 14]);
    let slope = DVec3::new(1.5, -0.75, 2.25);
    let ramp = |world: DVec3| 100.0 + slope.dot(world);
    let volume = Made(|v: [i64; 3]| {
        let at = place.world_from_lattice.transform_point3(DVec3::from_array(v.map(|x| x as f64)));
        (ramp(at) as f32, 2.0)
    });
    for (normal, up) in
        [(DVec3::Z, None), (DVec3::new(1.0, -2.0, 0.5), None), (DVec3::new(-0.2, 0.1, 3.0), Some(DVec3::X))]
    {
        let plane = Plane::new(place.middle() + DVec3::new(0.3, -0.2, 0.4), normal, up).unwrap();
        let section = plane.fit(&place, [61, 47]).unwrap();
        let (pixels, work) = sample(&volume, place, &section);
        let to_lattice = place.lattice_from_world();
        let mut inner = 0;
        for (n, pixel) in (0_u32..).zip(&pixels) {
            let world = section.at(n % 61, n / 61);
            assert!((world - plane.point).dot(plane.normal).abs() < 1e-9, "pixels lie in the plane");
            let at = to_lattice.transform_point3(world);
            // Inside a complete cell the value is exactly the ramp's.
            let whole = (0..3).all(|a| at[a] >= place.low[a] as f64 && at[a] <= place.high[a] as f64);
            if whole {
                inner += 1;
                assert!((f64::from(pixel.value) - ramp(world)).abs() < 2e-5, "{pixel:?} at {world}");
                assert!((pixel.weight - 2.0).abs() < 1e-6 && (pixel.share - 1.0).abs() < 1e-6);
            }
            let beyond = (0..3).any(|a| at[a] < place.low[a] as f64 - 0.51 || at[a] > place.high[a] as f64 + 0.51);
            assert!(!(beyond && pixel.is_seen()), "{pixel:?} at {at}");
        }
        assert!(inner > 500, "{inner}");
        assert_eq!(work.pixels, 61 * 47);
        assert!(work.pixels_outside > 0 && work.voxels_read <= 8 * (work.pixels - work.pixels_outside), "{work:?}");
    }
}

#[test]
fn coverage_ends_half_voxel_beyond_seen() {
    let lattice = Box3::new(Transform::from_affine(DAffine3::IDENTITY), [[0; 3], [9; 3]]);
    // Seen up to x = 4; the last column has a thousandth of the weight, and is far too bright.
    let volume = Made(|[x, ..]: [i64; 3]| match x {
        0..=3 => (50.0, 1.0),
        4 => (1050.0, 1e-3),
        _ => (0.0, 0.0),
    });
    let along = |x: f64| {
        let section = Section { first: DVec3::new(x, 5.0, 5.0), right: DVec3::X, down: DVec3::Y, size: [1, 1] };
        sample(&volume, lattice, &section).0[0]
    };
    assert!(along(4.49).is_seen() && along(4.5).is_seen() && !along(4.51).is_seen());
    assert!(along(-0.5).is_seen() && !along(-0.51).is_seen());
    assert_eq!((along(4.0).value, along(3.0).value, along(4.3).value), (1050.0, 50.0, 1050.0));
    // Half-way: (0.5·50 + 0.0005·1050) / 0.5005.
    assert!((along(3.5).value - 50.999).abs() < 1e-3, "{:?}", along(3.5));
    assert_eq!(along(7.0), Sampled::UNSEEN);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(60))]
    #[test]
    fn volume_planes_match_reference_on_any_threads(
        seed in any::<u32>(),
        normal in proptest::array::uniform3(-1.0..1.0f64),
        off in proptest::array::uniform3(-3.0..3.0f64),
    ) {
        let place = place([-3, -9, 2], [8, 1, 9]);
        let volume = Made(move |v: [i64; 3]| {
            let hash = v.iter().fold(seed, |h, x| (h ^ (*x as u32)).wrapping_mul(0x9E37_79B1).rotate_left(13));
            if hash % 3 == 0 { (0.0, 0.0) } else { ((hash >> 8) as f32 / 1e4, (hash % 1000 + 1) as f32 / 100.0) }
        });
        let plane = Plane::new(place.middle() + DVec3::from_array(off) * 0.3, DVec3::from_array(normal), None);
        prop_assume!(plane.is_ok());
        let section = plane.unwrap().fit(&place, [23, 19]);
        prop_assume!(section.is_ok());
        // Wider than the volume, so that some pixels lie outside.
        let mut section = section.unwrap();
        section.first -= section.right * 5.0;
        let (pixels, work) = sample(&volume, place, &section);
        let exact = reference::of_volume(&volume, &place, &section);
        for (pixel, [value, weight, share]) in pixels.iter().zip(&exact) {
            prop_assert!((f64::from(pixel.weight) - weight).abs() < 1e-5, "{pixel:?} {weight}");
            prop_assert!((f64::from(pixel.share) - share).abs() < 1e-6, "{pixel:?} {share}");
            // For very small weights, rounding of positions decides.
            if *weight > 1e-6 {
                prop_assert!((f64::from(pixel.value) - value).abs() < 1e-3 * value.abs().max(1.0), "{pixel:?} {value}");
            }
        }
        let shared = team(3).unwrap();
        let again = Planar { volume: &volume, place, team: shared.as_deref() }.sample(&section);
        prop_assert_eq!(again, (pixels, work));
    }

    #[test]
    fn nearest_slices_match_brute_force(
        poses in proptest::collection::vec((proptest::array::uniform3(-0.6..0.6f64), -4.0..4.0f64), 1..7),
        reach in 0.2..3.0f64,
        seed in any::<u32>(),
    ) {
        let slices: Vec<(u64, Slice, Mask)> = (3..).zip(&poses).map(|(item, (turn, z))| {
            let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::from_array(*turn)));
            let pixel = DMat3::from_diagonal(DVec3::new(0.8, 0.6, 2.0));
            let affine = DAffine3 { matrix3: turn * pixel, translation: turn * DVec3::new(-4.0, -3.0, *z) };
            let image: Vec<u8> = (0..11 * 12_u32)
                .map(|n| (n.wrapping_mul(2_654_435_761).wrapping_add(seed.wrapping_mul(item as u32)) >> 13) as u8)
                .collect();
            let mask = Mask::rect(11, 12, ClipRect::new(1, 0, 9, 10).unwrap());
            (item, slice(11, 12, image, affine), mask)
        }).collect();
        let section = Plane::new(DVec3::new(0.2, 0.1, -0.3), DVec3::new(0.3, -1.0, 0.2), None).unwrap()
            .fit(&Box3::new(Transform::from_affine(DAffine3::IDENTITY), [[-5; 3], [5; 3]]), [31, 29]).unwrap();
        let mut fast = NearestSlices::new(section);
        for (item, slice, mask) in &slices {
            fast.insert(*item, slice, mask, reach);
        }
        for (nearest, exact) in fast.nearest().iter().zip(reference::of_slices(&slices, reach, &section)) {
            match exact {
                None => prop_assert_eq!(nearest.sampled, Sampled::UNSEEN),
                Some((item, [value, ..])) => {
                    prop_assert_eq!(nearest.item, item);
                    prop_assert!((f64::from(nearest.sampled.value) - value).abs() < 1e-4);
                }
            }
        }
        let work = fast.work();
        prop_assert_eq!((work.slices, work.pixels), (slices.len() as u64, 31 * 29 * slices.len() as u64));
        prop_assert!(work.pixels_considered < work.pixels && work.pixels_taken <= work.pixels_considered);
    }
}

fn slice(width: u32, height: u32, pixels: Vec<u8>, affine: DAffine3) -> Slice {
    Slice {
        image: Image::new(width, height, Pixels::U8(Arc::from(pixels))),
        time_ns: 0,
        world_from_image: Transform::from_affine(affine),
    }
}

#[test]
fn parallel_slices_show_nearest_then_oldest() {
    // Slices across z at 0, 2, 4 and again at 4 mm, each of one grey level; pixels of 1 mm.
    let mask = Mask::full(10, 10);
    // A column of pixels along z, from −1 to 6 mm in steps of 0.5 mm, at one position of the
    // slices.
    let section =
        Section { first: DVec3::new(4.5, 4.5, -1.0), right: DVec3::X * 0.5, down: DVec3::Z * 0.5, size: [1, 15] };
    let mut nearest = NearestSlices::new(section);
    for (item, (z, grey)) in (0..).zip([(0.0, 10), (2.0, 20), (4.0, 40), (4.0, 41)]) {
        let stack = slice(10, 10, vec![grey; 100], DAffine3::from_translation(DVec3::new(0.0, 0.0, z)));
        nearest.insert(item, &stack, &mask, 1.25);
    }
    let shown: Vec<f32> = nearest.sampled().iter().map(|s| if s.is_seen() { s.value } else { -1.0 }).collect();
    // At 1 and 3 mm two slices are equally near; beyond 1.25 mm of the first and the last there
    // is none.
    let expected = [10.0, 10.0, 10.0, 10.0, 10.0, 20.0, 20.0, 20.0, 20.0, 40.0, 40.0, 40.0, 40.0, -1.0, -1.0];
    assert_eq!(shown, expected);
    assert_eq!(nearest.nearest()[2].distance_mm, 0.0);
    // A slice out of reach adds no considered pixels.
    let before = nearest.work();
    let far = slice(10, 10, vec![9; 100], DAffine3::from_translation(DVec3::new(0.0, 0.0, 99.0)));
    nearest.insert(7, &far, &mask, 1.25);
    let work = nearest.work();
    assert_eq!((work.pixels_considered, work.slices_beside), (before.pixels_considered, before.slices_beside + 1));
    // A slice with a degenerate plane shows nothing.
    let flat = DAffine3 { matrix3: DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z), translation: DVec3::ZERO };
    nearest.insert(8, &slice(10, 10, vec![9; 100], flat), &mask, 1e9);
    assert_eq!(nearest.work().pixels_considered, work.pixels_considered);
}

#[test]
fn posed_image_is_interpolated_in_place() {
    // u along +y, v along −x, 0.5 mm pixels: grey 10·u + v at its pixels.
    let pixels = (0..8).flat_map(|v| (0..9).map(move |u| 10 * u + v)).collect();
    let axes = DMat3::from_cols(DVec3::Y * 0.5, DVec3::NEG_X * 0.5, DVec3::Z);
    let posed = slice(9, 8, pixels, DAffine3 { matrix3: axes, translation: DVec3::new(1.0, 2.0, 3.0) });
    let at = |x: f64, y: f64, mask: &Mask| {
        let section = Section { first: DVec3::new(x, y, 3.2), right: DVec3::X, down: DVec3::Y, size: [1, 1] };
        let mut nearest = NearestSlices::new(section);
        nearest.insert(0, &posed, mask, 0.3);
        nearest.nearest()[0]
    };
    let full = Mask::full(9, 8);
    // u = (y − 2) / 0.5, v = (1 − x) / 0.5.
    for (u, v) in [(0.0, 0.0), (3.0, 2.0), (4.25, 1.5), (7.9, 6.9)] {
        let found = at(1.0 - 0.5 * v, 2.0 + 0.5 * u, &full);
        assert!((f64::from(found.sampled.value) - (10.0 * u + v)).abs() < 1e-4, "{u} {v} {found:?}");
        assert!((found.distance_mm - 0.2).abs() < 1e-12);
    }
    // The image ends half a pixel beyond its last pixels, and so does the data.
    assert!(at(1.0, 2.0 + 0.5 * 8.49, &full).sampled.is_seen() && !at(1.0, 2.0 + 0.5 * 8.51, &full).sampled.is_seen());
    let part = Mask::rect(9, 8, ClipRect::new(0, 0, 4, 8).unwrap());
    let (inner, outer) = (at(1.0, 2.0 + 0.5 * 3.49, &part).sampled, at(1.0, 2.0 + 0.5 * 3.51, &part).sampled);
    assert!(inner.is_seen() && inner.value == 30.0 && !outer.is_seen(), "{inner:?} {outer:?}");
}

#[test]
fn free_plane_fits_its_cut_through_box() {
    let place =
        Box3::new(Transform::from_affine(DAffine3::from_scale(DVec3::new(0.5, 1.0, 2.0))), [[0; 3], [19, 9, 4]]);
    // 10 × 10 × 10 mm, starting at (−0.25, −0.5, −1).
    let middle = place.middle();
    assert_eq!(middle, DVec3::new(4.75, 4.5, 4.0));
    let level = Plane::new(middle, DVec3::Z, None).unwrap();
    assert_eq!((level.right, level.down), (DVec3::X, DVec3::NEG_Y));
    let section = level.fit(&place, [200, 100]).unwrap();
    assert!((section.mm_per_px() - 0.1).abs() < 1e-12);
    // 10 mm in the middle of 20: starts at −5.25 plus half a pixel.
    assert!((section.first - DVec3::new(4.75 - 9.95, 4.5 + 4.95, 4.0)).length() < 1e-9, "{section:?}");
    let upright = Plane::new(middle, DVec3::NEG_Y, None).unwrap();
    assert_eq!((upright.right, upright.down), (DVec3::X, DVec3::NEG_Z));
    // The cut across the diagonal is a hexagon of edges 10/√2.
    let across = Plane::new(middle, DVec3::ONE, None).unwrap();
    let cut = across.fit(&place, [100, 100]).unwrap();
    assert!((cut.mm_per_px() * 100.0 - 200.0_f64.sqrt()).abs() < 1e-9, "{}", cut.mm_per_px());
    // A plane in a face meets it; the error for one beyond gives the volume's position.
    assert!(Plane::new(DVec3::new(0.0, 0.0, -1.0), DVec3::Z, None).unwrap().fit(&place, [9, 9]).is_ok());
    let beside = Plane::new(DVec3::new(0.0, 0.0, -1.1), DVec3::Z, None).unwrap().fit(&place, [9, 9]).unwrap_err();
    let message = beside.to_string();
    assert!(
        message.contains("misses the volume") && message.contains("from -0.25, -0.50, -1.00 to 9.75, 9.50, 9.00"),
        "{message}"
    );
    for (point, normal, up, text) in [
        (DVec3::ZERO, DVec3::ZERO, None, "normal 0, 0, 0"),
        (DVec3::ZERO, DVec3::new(f64::NAN, 0.0, 1.0), None, "normal NaN"),
        (DVec3::INFINITY, DVec3::X, None, "point inf"),
        (DVec3::ZERO, DVec3::X, Some(DVec3::X * -2.0), "along its normal"),
        (DVec3::ZERO, DVec3::X, Some(DVec3::ZERO), "upward direction 0"),
    ] {
        let error = Plane::new(point, normal, up).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    }
    // Very short and very long normals are valid.
    assert_eq!(Plane::new(middle, DVec3::Z * 1e-300, None).unwrap(), level);
    assert_eq!(Plane::new(middle, DVec3::Z * 1e300, None).unwrap(), level);
}

#[test]
fn three_planes_share_scale_without_overlap() {
    let room = Room { gap: 10, above: 20, left: 12, below: 14, foot: 30 };
    for (high, size) in [
        ([39, 9, 29], [512, 512]),
        ([39, 9, 29], [900, 200]),
        ([39, 9, 29], [160, 700]),
        ([3, 90, 200], [640, 480]),
        ([0, 0, 0], [300, 300]),
    ] {
        let place = place([0; 3], high);
        let panels = three(&place, None, size, room).unwrap();
        let mm = panels[0].section.mm_per_px();
        let lengths = [0.3, 0.5, 1.25].iter().zip(high).map(|(s, n)| s * (n + 1) as f64).collect::<Vec<_>>();
        for (n, panel) in panels.iter().enumerate() {
            let [right, down, cut] = panel.axes;
            assert!((panel.section.mm_per_px() - mm).abs() < 1e-12);
            for (axis, pixels) in [(right, panel.section.size[0]), (down, panel.section.size[1])] {
                assert!((f64::from(pixels) * mm - lengths[axis]).abs() <= mm + 1e-9, "{pixels} {axis}");
            }
            assert!((panel.at_voxel - 0.5 * high[cut] as f64).abs() < 1e-9);
            let end = [0, 1].map(|k| panel.corner[k] + panel.section.size[k]);
            assert!(end[0] + room.gap <= size[0] && end[1] + room.below + room.gap + room.foot <= size[1], "{panel:?}");
            for other in &panels[n + 1..] {
                let apart = (0..2)
                    .any(|k| end[k] < other.corner[k] || other.corner[k] + other.section.size[k] < panel.corner[k]);
                assert!(apart, "{panel:?} {other:?}");
            }
            // All planes pass through the middle, and their pixels lie symmetrically about it.
            let [w, h] = panel.section.size;
            let middle = 0.5 * (panel.section.at(0, 0) + panel.section.at(w - 1, h - 1));
            assert!((middle - place.middle()).length() < 1e-9);
        }
        // Along one of its sides the picture is filled: less than a pixel for each plane
        // remains.
        let far = [0, 1].map(|k| panels.iter().map(|p| p.corner[k] + p.section.size[k]).max().unwrap());
        let near = [0, 1].map(|k| panels.iter().map(|p| p.corner[k]).min().unwrap());
        let spare = [size[0] - far[0] - room.gap, size[1] - far[1] - room.gap - room.below - room.foot];
        let before = [near[0] - room.gap - room.left, near[1] - room.gap - room.above];
        assert!((0..2).any(|k| spare[k] + before[k] <= 3), "{spare:?} {before:?}");
    }
    let place = place([0; 3], [9; 3]);
    let beside = three(&place, Some(DVec3::splat(1e3)), [512, 512], room).unwrap_err().to_string();
    assert!(beside.contains("the point 1000.00, 1000.00, 1000.00 mm misses the volume"), "{beside}");
    assert!(three(&place, None, [60, 60], room).unwrap_err().to_string().contains("no room"));
}

#[test]
fn plane_cover_matches_its_cut() {
    let place = place([-7, 3, -2], [25, 30, 14]);
    for normal in [DVec3::Z, DVec3::new(0.3, -0.8, 0.5), place.directions()[1]] {
        let plane = Plane::new(place.middle(), normal, None).unwrap();
        let (section, fitted) = (plane.cover(&place, 0.3, 512).unwrap(), plane.fit(&place, [400, 400]).unwrap());
        assert!((section.mm_per_px() - 0.3).abs() < 1e-12);
        // The extent matches that of the fitted plane, to a pixel.
        let long = f64::from(section.size[0].max(section.size[1])) * 0.3;
        assert!((long - 400.0 * fitted.mm_per_px()).abs() <= 0.3, "{long} {fitted:?}");
        let middle = |s: &Section| 0.5 * (s.at(0, 0) + s.at(s.size[0] - 1, s.size[1] - 1));
        assert!((middle(&section) - middle(&fitted)).length() < 1e-9);
        let coarse = plane.cover(&place, 0.3, 40).unwrap();
        assert_eq!(coarse.size.into_iter().max(), Some(40));
    }
    // A whole number of pixels stays exact: the box is 33 voxels of 0.3 mm long.
    let across = Plane {
        point: place.middle(),
        normal: place.directions()[2],
        right: place.directions()[0],
        down: -place.directions()[1],
    };
    assert_eq!(across.cover(&place, 0.3, 512).unwrap().size, [33, 47]);
    let beside = Plane::new(place.middle() + DVec3::splat(1e3), DVec3::Z, None).unwrap();
    assert!(beside.cover(&place, 0.3, 512).unwrap_err().to_string().contains("misses the volume"));
}
