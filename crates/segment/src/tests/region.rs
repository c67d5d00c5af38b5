use std::f64::consts::PI;

use glam::DQuat;

use super::*;
use crate::error::SegmentError;
use crate::field::{Field, VoxelBox};
use crate::region::{Growth, Region};

fn growth(seed: DVec3) -> Growth {
    Growth { seed, range: None, radius_mm: 2.0, smoothing_mm: None, opening_mm: 0.0, limit_ml: 200.0, grey_level: 1.0 }
}

/// Position of a voxel of 0.5 mm.
fn at(voxel: [i64; 3]) -> DVec3 {
    DVec3::from_array(voxel.map(|at| 0.5 * at as f64))
}

/// Speckle with this mean: Rayleigh's distribution, of a standard deviation of 0.26 of the mean, as
/// of four looks.
fn speckle(voxel: [i64; 3], mean: f64) -> f64 {
    let looks = (0..4).map(|look| (-2.0 * noise([voxel[0], voxel[1], voxel[2] + 1000 * look]).max(1e-9).ln()).sqrt());
    mean * looks.sum::<f64>() / (4.0 * (PI / 2.0).sqrt())
}

fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * PI * radius.powi(3)
}

fn cube(edge: i64, value: impl Fn([i64; 3]) -> f32) -> Field {
    let space = VoxelBox { low: [-edge; 3], size: [2 * edge as usize + 1; 3] };
    Field::new(space, (0..space.voxels()).map(|place| value(space.voxel(place))).collect())
}

/// Two balls of radius 6 mm about ±10 mm, with a bridge of radius 1 mm between them.
fn bridged(voxel: [i64; 3]) -> f32 {
    let p = at(voxel);
    let is_in_ball = [-10.0, 10.0].iter().any(|x| p.distance(DVec3::X * *x) <= 6.0);
    if is_in_ball || (p.y.hypot(p.z) <= 1.0 && p.x.abs() < 10.0) { 60.0 } else { 150.0 }
}

#[test]
fn ball_in_speckle_has_dice_above_95_percent() {
    for (inside, outside) in [(60.0, 140.0), (120.0, 30.0)] {
        let is_in = |voxel| at(voxel).length() <= 10.0;
        let scene = cube(36, |voxel| speckle(voxel, if is_in(voxel) { inside } else { outside }) as f32);
        let request = growth(DVec3::new(1.0, -2.0, 0.5));
        let region = request.grow(&scene, lattice(), LIMIT).unwrap();
        let [mut both, mut true_voxels] = [0_u64; 2];
        for n in 0..73_i64.pow(3) {
            let voxel = [n % 73 - 36, n / 73 % 73 - 36, n / (73 * 73) - 36];
            true_voxels += u64::from(is_in(voxel));
            both += u64::from(is_in(voxel) && region.contains(voxel));
        }
        let dice = 2.0 * both as f64 / (true_voxels + region.counts.voxels) as f64;
        assert!(dice >= 0.95, "{inside} in {outside}: {dice}, {:?}", region.counts);
        // Halfway between both means, the border lies within its error.
        let middle = 0.5 * (inside + outside) as f32;
        let range = if inside < outside { [0.0, middle] } else { [middle, 900.0] };
        let half = Growth { range: Some(range), ..request }.grow(&scene, lattice(), LIMIT).unwrap();
        assert!((half.volume_mm3 - ball_volume(10.0)).abs() <= half.error_mm3, "{}", half.volume_mm3);
    }
}

#[test]
fn bridge_thinner_than_opening_is_cut() {
    let scene = cube(36, bridged);
    let seed = DVec3::new(-10.0, 0.0, 0.0);
    let request = Growth { range: Some([0.0, 105.0]), ..growth(seed) };
    let leaked = request.grow(&scene, lattice(), LIMIT).unwrap();
    assert!(leaked.contains([20, 0, 0]) && leaked.volume_mm3 > 1.8 * ball_volume(6.0));
    let opened = Growth { opening_mm: 1.5, ..request }.grow(&scene, lattice(), LIMIT).unwrap();
    assert!(!opened.contains([20, 0, 0]) && !opened.contains([0, 0, 0]) && opened.contains([-20, 0, 0]));
    assert!((opened.volume_mm3 / ball_volume(6.0) - 1.0).abs() < 0.06, "{}", opened.volume_mm3);
    assert_eq!(opened.counts.removed, leaked.counts.voxels - opened.counts.voxels);
}

#[test]
fn region_never_passes_unseen_voxels() {
    // One layer of unseen voxels, at a slant so that they touch by edges and corners alone.
    let is_unseen = |[x, y, z]: [i64; 3]| x + y + z == 5;
    let scene =
        Scene { low: [-12; 3], high: [12; 3], value: |voxel| (!is_unseen(voxel)).then_some(80.0 + voxel[0] as f32) };
    let request = Growth { range: Some([0.0, 200.0]), ..growth(DVec3::ZERO) };
    let region = request.grow(&scene, lattice(), LIMIT).unwrap();
    let mut count = 0;
    for n in 0..25_i64.pow(3) {
        let voxel = [n % 25 - 12, n / 25 % 25 - 12, n / 625 - 12];
        let is_before = voxel.iter().sum::<i64>() < 5;
        assert_eq!(region.contains(voxel), is_before, "{voxel:?}");
        count += u64::from(is_before);
    }
    assert_eq!(region.counts.voxels, count);
    assert!(region.counts.unseen_faces > 0);
}

#[test]
fn region_has_same_bits_for_any_threads() {
    let scene = cube(36, |voxel| (f64::from(bridged(voxel)) * (0.8 + 0.4 * noise(voxel))) as f32);
    let request = Growth { opening_mm: 1.0, ..growth(DVec3::new(-10.0, 0.0, 0.0)) };
    let grow = |threads| on(threads, || request.grow(&scene, lattice(), LIMIT).unwrap());
    let first = grow(1);
    let bits = |region: &Region| region.field().unwrap().in_order().iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    for threads in [2, 3, 7] {
        let other = grow(threads);
        assert!(other == first && on(threads, || bits(&other)) == bits(&first), "{threads} threads");
    }
}

#[test]
fn only_bricks_at_the_region_are_smoothed() {
    let scene = cube(80, |voxel| if at(voxel).length() <= 4.0 { 40.0 } else { 140.0 });
    let region = growth(DVec3::ZERO).grow(&scene, lattice(), LIMIT).unwrap();
    // The ball's voxels from −8 to 8 lie in at most 4 bricks along each axis.
    assert!(region.work.bricks_smoothed <= 64, "{:?}", region.work);
}

#[test]
fn default_range_is_two_deviations_about_the_mean() {
    // Half of the ball's voxels each are 50 and 70.
    let scene = cube(12, |[x, y, z]| if (x + y + z) % 2 == 0 { 50.0 } else { 70.0 });
    let region = growth(DVec3::ZERO).grow(&scene, lattice(), LIMIT).unwrap();
    let [low, high] = region.range;
    assert!((low - 40.0).abs() < 1.1 && (high - 80.0).abs() < 1.1, "{low} {high}");
    // Equal values have no deviation: a grey level counts.
    let even = growth(DVec3::ZERO).grow(&cube(12, |_| 60.0), lattice(), LIMIT).unwrap();
    assert_eq!((even.range, even.counts.voxels), ([58.0, 62.0], 25 * 25 * 25));
}

#[test]
fn enclosed_pockets_are_filled_unless_unseen() {
    let scene = Scene {
        low: [-20; 3],
        high: [20; 3],
        value: |voxel: [i64; 3]| match voxel {
            [0, 0, 0] => None,
            [4..=5, 4, 4] => Some(200.0),
            _ if at(voxel).length() <= 6.0 => Some(60.0),
            _ => Some(150.0),
        },
    };
    let request = Growth { smoothing_mm: Some(0.0), range: Some([50.0, 70.0]), ..growth(DVec3::new(2.0, 0.0, 0.0)) };
    let region = request.grow(&scene, lattice(), LIMIT).unwrap();
    assert!(region.contains([4, 4, 4]) && region.contains([5, 4, 4]) && !region.contains([0, 0, 0]));
    assert_eq!((region.counts.filled, region.counts.unseen_faces), (2, 6));
}

#[test]
fn region_follows_a_turned_lattice() {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, 2.0) / 3.0, 0.7);
    let scale = DVec3::new(0.5, 0.4, 0.6);
    let origin = DVec3::new(120.0, -80.0, 300.0);
    let placed = Transform::from_affine(DAffine3::from_scale_rotation_translation(scale, turn, origin));
    let scene = cube(30, |voxel| {
        let p = DVec3::from_array(voxel.map(|at| at as f64)) * scale;
        if p.length() <= 7.0 { 60.0 } else { 150.0 }
    });
    let seed = placed.point(DVec3::new(3.0, -2.0, 1.0));
    let request = Growth { range: Some([0.0, 105.0]), ..growth(seed) };
    let region = request.grow(&scene, placed, LIMIT).unwrap();
    assert!((region.volume_mm3 - ball_volume(7.0)).abs() < region.error_mm3, "{}", region.volume_mm3);
    assert!((region.counts.voxels as f64 * 0.12 - region.volume_mm3).abs() < 1e-6);
}

#[test]
fn surface_of_a_region_encloses_its_volume() {
    let scene = cube(30, |voxel| if at(voxel).length() <= 10.0 { 60.0 } else { 150.0 });
    let region = Growth { range: Some([0.0, 105.0]), ..growth(DVec3::ZERO) }.grow(&scene, lattice(), LIMIT).unwrap();
    let (mesh, _) = surface::extract(&region.field().unwrap(), 0.0, lattice(), LIMIT).unwrap();
    let topology = surface::Topology::of(&mesh);
    assert_eq!((topology.is_closed(), topology.components, topology.euler_number()), (true, 1, 2));
    let volume = surface::measure::volume_mm3(&mesh, &topology).unwrap();
    assert!((volume / region.volume_mm3 - 1.0).abs() < 0.02, "{volume} {}", region.volume_mm3);
}

#[test]
fn impossible_growths_are_refused() {
    let scene = cube(20, |voxel| if at(voxel).length() <= 6.0 { 60.0 } else { 150.0 });
    let plain = || growth(DVec3::ZERO);
    let refused = |request: Growth| request.grow(&scene, lattice(), LIMIT).unwrap_err();
    let far = DVec3::new(50.0, 0.0, 0.0);
    assert_eq!(refused(growth(far)), SegmentError::SeedUnseen { at: far.to_array() });
    assert!(matches!(
        refused(Growth { range: Some([70.0, 90.0]), ..plain() }),
        SegmentError::SeedRange { low: 70.0, high: 90.0, .. }
    ));
    assert!(matches!(refused(Growth { range: Some([9.0, 3.0]), ..plain() }), SegmentError::Setting { .. }));
    assert!(matches!(refused(Growth { range: Some([f32::NAN, 3.0]), ..plain() }), SegmentError::Setting { .. }));
    assert!(matches!(refused(Growth { radius_mm: -1.0, ..plain() }), SegmentError::Setting { .. }));
    assert!(matches!(refused(Growth { smoothing_mm: Some(f64::NAN), ..plain() }), SegmentError::Setting { .. }));
    assert!(matches!(refused(Growth { opening_mm: f64::INFINITY, ..plain() }), SegmentError::Setting { .. }));
    assert!(matches!(refused(Growth { radius_mm: 0.4, ..plain() }), SegmentError::FewVoxels { voxels: 1, .. }));
    assert!(matches!(refused(Growth { radius_mm: 17.0, ..plain() }), SegmentError::Wide { voxels: 34, .. }));
    assert!(matches!(refused(Growth { smoothing_mm: Some(5.0), ..plain() }), SegmentError::Wide { voxels: 30, .. }));
    assert!(matches!(refused(Growth { opening_mm: 20.0, ..plain() }), SegmentError::Wide { voxels: 40, .. }));
    assert_eq!(refused(Growth { limit_ml: 0.3, ..plain() }), SegmentError::Limit { limit_ml: 0.3 });
    assert_eq!(refused(Growth { opening_mm: 8.0, ..plain() }), SegmentError::Opened { radius_mm: 8.0 });
    assert!(matches!(plain().grow(&scene, lattice(), 1000), Err(SegmentError::Memory { limit_bytes: 1000, .. })));
    let mut sheared = lattice().affine();
    sheared.matrix3.y_axis.x = 0.1;
    let sheared = plain().grow(&scene, Transform::from_affine(sheared), LIMIT);
    assert!(matches!(sheared, Err(SegmentError::Sheared { .. })));
}
