//! Tests of refused slices and of the upgrade to the general path.

use super::*;

#[test]
fn refused_slices_change_nothing() {
    let slices = sweep(DQuat::from_rotation_x(1.0), 0.0, 3);
    let mut r = reconstructed(&settings(), refusing(), &full(), &slices[..1]);
    let (before, work, lattice) = (bits(r.volume()), r.work(), r.settings().lattice_direction);
    let good = &slices[1];
    let pose = good.world_from_image.affine();
    let posed = |affine: DAffine3| Slice { world_from_image: Transform::from_affine(affine), ..good.clone() };
    let flat = DMat3::from_cols(pose.matrix3.x_axis, pose.matrix3.x_axis * 2.0, pose.matrix3.z_axis);
    let small = Image::new(2, 2, Pixels::U8(Arc::from([1_u8, 2, 3, 4])));
    let u = pose.matrix3.x_axis.normalize();
    let departure: Expected = |e| matches!(e, Refused::Departure(Departure::Pose { .. }));
    // A quarter of a voxel is 0.125 mm.
    let shifted = |mm: f64| DAffine3 { translation: pose.translation + u * mm, ..pose };
    let tilted =
        DAffine3 { matrix3: DMat3::from_axis_angle(pose.matrix3.y_axis.normalize(), 0.012) * pose.matrix3, ..pose };
    let rolled =
        DAffine3 { matrix3: DMat3::from_axis_angle(pose.matrix3.z_axis.normalize(), 0.012) * pose.matrix3, ..pose };
    let mirrored =
        DAffine3 { matrix3: DMat3::from_cols(-pose.matrix3.x_axis, pose.matrix3.y_axis, pose.matrix3.z_axis), ..pose };
    let wide = DAffine3 {
        matrix3: DMat3::from_cols(pose.matrix3.x_axis * 1.02, pose.matrix3.y_axis, pose.matrix3.z_axis),
        ..pose
    };
    let cases: [(Slice, Expected); 10] = [
        (slices[0].clone(), |e| matches!(e, Refused::Repeated)),
        (Slice { image: small, ..good.clone() }, |e| matches!(e, Refused::Size { found: [2, 2], .. })),
        (posed(DAffine3 { translation: DVec3::splat(f64::NAN), ..pose }), |e| matches!(e, Refused::Degenerate)),
        (posed(DAffine3 { matrix3: flat, ..pose }), |e| matches!(e, Refused::Degenerate)),
        (posed(DAffine3 { translation: pose.translation + pose.matrix3.y_axis * 1e12, ..pose }), |e| {
            // That far out, f64 cannot resolve whether it is in the plane.
            matches!(e, Refused::OutOfRange | Refused::Departure(_))
        }),
        (posed(shifted(0.13)), departure),
        (posed(tilted), departure),
        (posed(rolled), departure),
        (posed(mirrored), departure),
        (posed(wide), departure),
    ];
    for (slice, expected) in cases {
        let error = r.insert(&slice).unwrap_err();
        assert!(expected(&error), "{error}");
        assert!(bits(r.volume()) == before && r.work() == work, "{error}");
        assert_eq!(r.settings().lattice_direction, lattice);
    }
    assert!(r.insert(&posed(shifted(0.12))).is_ok(), "within the tolerance");
    assert!(r.insert(&slices[2]).is_ok(), "a good slice still enters");
}

#[test]
fn refused_first_slice_leaves_no_plane() {
    let tiny = Settings { memory_bytes: 100_000, ..settings() };
    let slices = sweep(DQuat::IDENTITY, 0.0, 2);
    let mut r = PlanarReconstructor::new(tiny, refusing(), full()).unwrap();
    let error = r.insert(&slices[0]).unwrap_err();
    assert!(matches!(error, Refused::Memory { .. }) && error.to_string().contains("100000 bytes"), "{error}");
    assert!(r.kernels().is_none() && r.volume().tiles() == 0 && r.volume().depth() == 0);
    // An image with skewed axes does not fit any plane.
    let mut r = PlanarReconstructor::new(settings(), refusing(), full()).unwrap();
    let pose = slices[0].world_from_image.affine();
    let skew =
        DMat3::from_cols(pose.matrix3.x_axis, pose.matrix3.y_axis + 0.1 * pose.matrix3.x_axis, pose.matrix3.z_axis);
    let skewed =
        Slice { world_from_image: Transform::from_affine(DAffine3 { matrix3: skew, ..pose }), ..slices[0].clone() };
    assert!(matches!(r.insert(&skewed), Err(Refused::Departure(_))));
    assert!(r.kernels().is_none());
    assert!(r.insert(&slices[0]).is_ok());
}

#[test]
fn non_rectangular_mask_refused_before_slices() {
    let fan = Mask::fan(SIZE[0], SIZE[1], &Fan::new([20.0, -10.0], [12.0, 44.0], [-25.0, 25.0]).unwrap());
    let error = PlanarReconstructor::new(settings(), refusing(), fan).err().unwrap();
    assert!(matches!(error, SettingsError::Planar(Departure::Mask { .. })), "{error}");
    assert!(error.to_string().contains("no rectangle") && error.to_string().contains("the general path"), "{error}");
    // Columns covered in part along u: a rectangle with a corner cut off.
    let cut = Mask::from_fn(SIZE[0], SIZE[1], |u, v| u + v > 2);
    assert!(PlanarReconstructor::new(settings(), refusing(), cut).is_err());
    let askew = PlanarSettings { direction: Some(DMat3::from_diagonal(DVec3::new(1.0, 1.0, 2.0))), ..refusing() };
    assert!(matches!(PlanarReconstructor::new(settings(), askew, full()).err(), Some(SettingsError::Direction(_))));
    let nan = PlanarSettings { tolerance_voxels: f64::NAN, ..refusing() };
    assert!(matches!(PlanarReconstructor::new(settings(), nan, full()).err(), Some(SettingsError::Tolerance(_))));
}

#[test]
fn upgrade_keeps_every_voxel() {
    let slices = sweep(DQuat::from_rotation_y(0.4), 0.0, 6);
    let planar = reconstructed(&settings(), refusing(), &full(), &slices);
    let general = planar.upgraded().unwrap();
    assert!(bits(planar.volume()) == bits(general.volume()));
    assert_eq!(general.work(), planar.work());
    assert_eq!(general.world_from_lattice().affine(), planar.world_from_lattice().affine());
    let mut general = general;
    assert_eq!(general.insert(&slices[5]), Err(Refused::Repeated), "what came last is known");
    let tight = Settings { memory_bytes: planar.volume().bytes() + 4096, ..settings() };
    let planar = reconstructed(&tight, refusing(), &full(), &slices);
    assert!(matches!(planar.upgraded().err(), Some(Refused::Memory { .. })), "bricks take twice the memory");
}

#[test]
fn slice_out_of_plane_refused_or_upgrades() {
    let mut slices = sweep(DQuat::from_rotation_y(0.4), 0.0, 9);
    let pose = slices[5].world_from_image.affine();
    let axis = pose.matrix3.y_axis.normalize();
    let tilted = DAffine3 { matrix3: DMat3::from_axis_angle(axis, 0.1) * pose.matrix3, ..pose };
    slices[5].world_from_image = Transform::from_affine(tilted);
    // Refused: nothing changes, and later slices are inserted.
    let mut refusing = PathReconstructor::planar(settings(), refusing(), full()).unwrap();
    let results: Vec<_> = slices.iter().map(|s| refusing.insert(s)).collect();
    assert!(matches!(results[5], Err(Refused::Departure(_))), "{:?}", results[5]);
    assert_eq!(results.iter().filter(|r| r.is_ok()).count(), 8);
    assert_eq!((refusing.path(), refusing.upgraded(), refusing.work().slices), (Path::Planar, None, 8));
    // Upgraded: every slice is in the volume, as if the general path had inserted them all.
    let mut upgrading = PathReconstructor::planar(settings(), PlanarSettings::default(), full()).unwrap();
    for (i, slice) in slices.iter().enumerate() {
        assert_eq!(upgrading.path(), if i <= 5 { Path::Planar } else { Path::General });
        let touched = upgrading.insert(slice).unwrap();
        assert!(touched.voxels > 1000);
    }
    assert!(matches!(upgrading.upgraded(), Some(Departure::Pose { .. })));
    assert_eq!(upgrading.work().slices, 9);
    let mut general = Reconstructor::new(upgrading.settings().clone(), full()).unwrap();
    for slice in &slices {
        general.insert(slice).unwrap();
    }
    let (_, deviation) = general.decimation().unwrap();
    let (same, differ, value) = compared(upgrading.volume(), general.volume(), upgrading.settings(), deviation);
    assert!(same > 15_000 && differ * 50 < same, "{differ} of {same}");
    assert!(value <= 5.0 * 2.0 * deviation * 255.0, "{value}");
    // Nothing is missing in the opposite comparison either.
    let (same, differ, _) = compared(general.volume(), upgrading.volume(), upgrading.settings(), deviation);
    assert!(same > 15_000 && differ * 50 < same, "{differ} of {same}");
}

#[test]
fn general_mask_refused_or_upgrades() {
    let fan = Mask::fan(SIZE[0], SIZE[1], &Fan::new([20.0, -10.0], [12.0, 44.0], [-25.0, 25.0]).unwrap());
    assert!(matches!(
        PathReconstructor::planar(settings(), refusing(), fan.clone()).err(),
        Some(SettingsError::Planar(_))
    ));
    let mut path_reconstructor = PathReconstructor::planar(settings(), PlanarSettings::default(), fan).unwrap();
    assert_eq!(path_reconstructor.path(), Path::General);
    assert!(matches!(path_reconstructor.upgraded(), Some(Departure::Mask { .. })));
    assert!(path_reconstructor.insert(&sweep(DQuat::IDENTITY, 0.0, 1)[0]).is_ok());
}

#[test]
fn worst_pose_of_recording_reported() {
    let slices = sweep(DQuat::from_rotation_y(0.4), 0.0, 6);
    let mut poses: Vec<_> = slices.iter().map(|s| s.world_from_image).collect();
    let worst = |poses: &[Transform<_, _>]| {
        worst_departure(&settings(), &PlanarSettings::default(), SIZE, poses.iter().copied())
    };
    let (_, voxels) = worst(&poses).unwrap();
    assert!(voxels < 1e-9, "{voxels}");
    let u = poses[3].vector(DVec3::X).normalize();
    poses[3] = Transform::from_affine(DAffine3::from_translation(u * 0.3) * poses[3].affine());
    let (which, voxels) = worst(&poses).unwrap();
    assert!((voxels - 0.6).abs() < 1e-9 && which == 3, "{voxels}");
    assert!(worst(&[]).is_none());
}
