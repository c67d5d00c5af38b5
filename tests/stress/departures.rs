//! Tests of slices that the planar path cannot hold: refused without a trace, or taken over by
//! the general path with nothing lost. Also tests of its memory limit.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use mask::Mask;
use reconstruct::planar::{Departure, OnDeparture, PlanarReconstructor, PlanarSettings};
use reconstruct::{Compounding, Decay, Path, PathReconstructor, Refused, Settings, SettingsError};
use sonoweave_core::frames::Transform;
use sonoweave_core::region::Fan;
use sonoweave_core::slice::{Image, Slice};

use crate::figures::{Sheet, Test};
use crate::insertion::{Probe, constant, content, half_mm, held, noise, on_the_world_s_axes, reconstructor};
use crate::planar::{SIZE, full, moved, reconstructed, refusing, settings, sweep};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("21", "planar, slices that cannot be used: refused, every bit and counter as before", refused),
        Test::new("29", "a fan, a hole, a corner cut off: refused, or the general path from the beginning", masks),
        Test::new(
            "29",
            "poses out of the plane: refused without a trace, or the general path with every bit there was",
            departures,
        ),
        Test::new("29", "ages go with the voxels: what was old before the upgrade fades after it", upgraded_ages),
        Test::new("36", "planar, memory limit: kept to the tile, a typed refusal, every bit as before", limit),
        Test::new("36", "planar, columns 2·10⁹ voxels apart: memory by what was scanned", far_apart),
    ]
}

type Expected = fn(&Refused) -> bool;

/// Returns a slice modified in the ways that only the planar path refuses.
fn out_of_plane(slice: &Slice) -> Vec<(&'static str, Slice)> {
    let pose = slice.world_from_image.affine();
    let [u, v, n] = [pose.matrix3.x_axis, pose.matrix3.y_axis, pose.matrix3.z_axis].map(DVec3::normalize);
    let turned = |axis, angle| DAffine3 { matrix3: DMat3::from_axis_angle(axis, angle) * pose.matrix3, ..pose };
    let with = |pose: DAffine3| Slice { world_from_image: Transform::from_affine(pose), ..slice.clone() };
    vec![
        // A quarter of a voxel is 0.125 mm.
        ("0.13 mm along u", with(DAffine3 { translation: pose.translation + u * 0.13, ..pose })),
        ("turned by 0.02 about v", with(turned(v, 0.02))),
        ("turned by 0.02 about n", with(turned(n, 0.02))),
        (
            "u the wrong way round",
            with(DAffine3 { matrix3: DMat3::from_cols(-pose.matrix3.x_axis, pose.matrix3.y_axis, n), ..pose }),
        ),
        (
            "pixels 2 % wider",
            with(DAffine3 { matrix3: DMat3::from_cols(pose.matrix3.x_axis * 1.02, pose.matrix3.y_axis, n), ..pose }),
        ),
    ]
}

fn refused(sheet: &mut Sheet) {
    let slices = sweep(DQuat::from_rotation_x(1.0), 3);
    let good = &slices[1];
    let pose = good.world_from_image.affine();
    let with = |pose: DAffine3| Slice { world_from_image: Transform::from_affine(pose), ..good.clone() };
    let at = |translation: DVec3| with(DAffine3 { translation, ..pose });
    let columns = |u: DVec3, v: DVec3| with(DAffine3 { matrix3: DMat3::from_cols(u, v, pose.matrix3.z_axis), ..pose });
    let [u, v] = [pose.matrix3.x_axis, pose.matrix3.y_axis];
    let degenerate: Expected = |e| matches!(e, Refused::Degenerate);
    let mut cases: Vec<(&str, Slice, Expected)> = vec![
        ("position NaN", at(DVec3::NAN), degenerate),
        ("position infinite", at(DVec3::new(0.0, f64::INFINITY, 0.0)), degenerate),
        ("direction NaN", columns(DVec3::NAN, v), degenerate),
        ("u of no length", columns(DVec3::ZERO, v), degenerate),
        ("v along u", columns(u, u * 2.0), degenerate),
        // That far out, f64 cannot resolve whether it is in the plane.
        ("10¹² mm along v", at(pose.translation + v.normalize() * 1e12), |e| {
            matches!(e, Refused::OutOfRange | Refused::Departure(_))
        }),
        ("another size", Slice { image: Image::new(2, 2, noise([2, 2], 1).pixels().clone()), ..good.clone() }, |e| {
            matches!(e, Refused::Size { .. })
        }),
        ("the same again", slices[0].clone(), |e| matches!(e, Refused::Repeated)),
    ];
    let departure: Expected = |e| matches!(e, Refused::Departure(Departure::Pose { .. }));
    cases.extend(out_of_plane(good).into_iter().map(|(name, slice)| (name, slice, departure)));
    let mut r = reconstructed(settings(), full(), &slices[..1]);
    let (before, work) = (content(r.volume()), r.work());
    for (name, slice, expected) in cases {
        let result = r.insert(&slice);
        let answer = result.as_ref().map_or_else(ToString::to_string, |t| format!("{} voxels changed", t.voxels));
        sheet.record(&format!("{name}: answer"), answer);
        sheet.holds(&format!("{name}: refused for its reason"), result.is_err_and(|e| expected(&e)));
        sheet.holds(&format!("{name}: state and work"), content(r.volume()) == before && r.work() == work);
    }
    sheet.holds(
        "0.12 mm along u is within the tolerance",
        r.insert(&at(pose.translation + u.normalize() * 0.12)).is_ok(),
    );
    sheet.holds("a good slice still enters", r.insert(&slices[2]).is_ok());
}

fn masks(sheet: &mut Sheet) {
    let [width, height] = SIZE;
    for (name, mask) in [
        ("fan", Mask::fan(width, height, &Fan::new([22.0, -10.0], [12.0, 44.0], [-25.0, 25.0]).unwrap())),
        ("one pixel missing", Mask::from_fn(width, height, |u, v| (u, v) != (20, 20))),
        ("a corner missing", Mask::from_fn(width, height, |u, v| u + v > 2)),
        ("covered in part along u", Mask::from_fn(width, height, |u, v| u < 30 || v < 20)),
    ] {
        let refused = PathReconstructor::planar(settings(), refusing(), mask.clone()).err();
        let by_type = matches!(refused, Some(SettingsError::Planar(Departure::Mask { .. })));
        sheet.holds(&format!("{name}: refused by type"), by_type);
        let mut upgraded = PathReconstructor::planar(settings(), PlanarSettings::default(), mask.clone()).unwrap();
        sheet.equal(&format!("{name}: path, where it may choose"), upgraded.path(), Path::General);
        let mut general = PathReconstructor::general(settings(), mask).unwrap();
        for slice in &sweep(DQuat::IDENTITY, 4) {
            upgraded.insert(slice).unwrap();
            general.insert(slice).unwrap();
        }
        let same = content(upgraded.volume()) == content(general.volume());
        sheet.holds(&format!("{name}: the general path's bits"), same);
    }
    let [none, all] = [|_, _| false, |_, _| true]
        .map(|of| PathReconstructor::planar(settings(), refusing(), Mask::from_fn(width, height, of)));
    sheet.equal("an empty mask", none.err(), Some(SettingsError::EmptyMask));
    sheet.holds("a rectangle is none of these", all.is_ok());
}

fn departures(sheet: &mut Sheet) {
    let slices = sweep(DQuat::IDENTITY, 6);
    // Far beside the others, so that existing content must stay unchanged.
    let beside = DAffine3::from_translation(DVec3::new(0.0, 200.0, 0.0));
    for (name, spoilt) in out_of_plane(&moved(&slices[3], beside)) {
        for on_departure in [OnDeparture::Refuse, OnDeparture::Upgrade] {
            let planar = on_the_world_s_axes(on_departure);
            let mut r = PathReconstructor::planar(settings(), planar, full()).unwrap();
            slices.iter().for_each(|slice| drop(r.insert(slice).unwrap()));
            let (before, work) = (held(r.volume()), r.work());
            let result = r.insert(&spoilt);
            if on_departure == OnDeparture::Refuse {
                sheet.holds(&format!("{name}, refused: for its reason"), matches!(result, Err(Refused::Departure(_))));
                let as_before = r.path() == Path::Planar && held(r.volume()) == before && r.work() == work;
                sheet.holds(&format!("{name}, refused: path, state and work as before"), as_before);
            } else {
                sheet
                    .holds(&format!("{name}, upgraded: it enters"), result.is_ok_and(|touched| touched.voxels > 1_000));
                sheet.equal(
                    &format!("{name}, upgraded: path and slices"),
                    (r.path(), r.work().slices),
                    (Path::General, 7),
                );
                let lost = before.iter().filter(|(index, s, v)| {
                    let (r, w) = r.volume().voxel(*index);
                    (r.to_bits(), w.to_bits()) != (s.to_bits(), v.to_bits())
                });
                sheet.equal(&format!("{name}, upgraded: voxels of {} that lost a bit", before.len()), lost.count(), 0);
                sheet.holds(&format!("{name}, upgraded: the next slice enters"), r.insert(&slices[2]).is_ok());
            }
        }
    }
}

fn upgraded_ages(sheet: &mut Sheet) {
    let arm = Probe::arm([24, 24], 0.5);
    let grey = |grey, along, seconds: f64| {
        let slice = arm.put(&constant(arm.size, grey), along);
        Slice { time_ns: (seconds * 1e9) as i64, ..slice }
    };
    for decay in [Decay::DeadTime { rate_per_s: 1.0, wait_s: 2.0 }, Decay::Exponential { rate_per_s: 1.0 }] {
        let compounding = Compounding::Decay(decay);
        let planar = on_the_world_s_axes(OnDeparture::Upgrade);
        let mut r = PathReconstructor::planar(Settings { compounding, ..half_mm() }, planar, arm.mask()).unwrap();
        r.insert(&grey(0.0, 0.0, 0.0)).unwrap();
        // The planar path continues elsewhere for a while, so that its content has ages.
        r.insert(&grey(0.0, 20.0, 9.8)).unwrap();
        let tilted = DAffine3::from_translation(DVec3::Y * 50.0) * DAffine3::from_rotation_x(0.1);
        r.insert(&moved(&grey(0.0, 0.0, 9.9), tilted)).unwrap();
        sheet.equal(&format!("{}: path after a tilted slice", decay.name()), r.path(), Path::General);
        r.insert(&grey(100.0, 0.0, 10.0)).unwrap();
        let (sum, weight) = r.volume().voxel([0; 3]);
        let old = 1.0 - f64::from(sum) / f64::from(weight) / 100.0;
        let factor = decay.factor(10.0);
        sheet.near(
            &format!("{}: old content after 10 s", decay.name()),
            old,
            factor / (1.0 + factor),
            0.01 * factor + 1e-6,
        );
    }
}

fn limit(sheet: &mut Sheet) {
    let arm = Probe::arm([48, 40], 0.25);
    let slices = [0.0, 3.0, 40.0].map(|along| arm.put(&noise(arm.size, 1), along));
    let free = |count: usize| {
        let mut r = PlanarReconstructor::new(half_mm(), refusing(), arm.mask()).unwrap();
        slices[..count].iter().for_each(|slice| drop(r.insert(slice).unwrap()));
        let volume = r.volume();
        // Columns of whole vectors, with one weight each.
        (volume.tiles() as u64, 64 * 4 * (volume.depth().next_multiple_of(16) as u64 + 1))
    };
    let [(one, tile), (two, _), (three, _)] = [1, 2, 3].map(free);
    for (name, room, entered) in [
        ("exactly enough for all", three * tile, 3),
        ("a byte less", three * tile - 1, 2),
        ("exactly enough for two", two * tile, 2),
        ("a tile less than for two", (two - 1) * tile, 1),
        ("a tile less than for one", (one - 1) * tile, 0),
    ] {
        let mut r =
            PlanarReconstructor::new(Settings { memory_bytes: room, ..half_mm() }, refusing(), arm.mask()).unwrap();
        let (mut taken, mut clean) = (0, true);
        for slice in &slices {
            let (before, work) = (content(r.volume()), r.work());
            match r.insert(slice) {
                Ok(_) => taken += 1,
                Err(Refused::Memory { needed, limit_bytes }) => {
                    clean &= needed > 0 && limit_bytes == room && content(r.volume()) == before && r.work() == work;
                    break;
                }
                Err(other) => panic!("{other}"),
            }
        }
        sheet.equal(&format!("{name}: slices that entered"), taken, entered);
        sheet.holds(&format!("{name}: refused by type, state and counters as before"), clean);
        sheet.holds(&format!("{name}: within the limit"), r.volume().tiles() as u64 * tile <= room);
    }
}

fn far_apart(sheet: &mut Sheet) {
    let arm = Probe::arm([9, 9], 0.5);
    let picture = noise(arm.size, 4);
    let mut r = reconstructor(Path::Planar, half_mm(), arm.mask());
    let near = r.insert(&arm.put(&picture, 0.0)).unwrap();
    let reach = 1e9;
    for [x, y] in [[reach, reach], [reach, -reach], [-reach, reach], [-reach, -reach]] {
        let there = Probe { centre: DVec3::new(x, y, 0.0), ..arm };
        let touched = r.insert(&there.put(&picture, 0.0)).unwrap();
        sheet.equal(&format!("({x:e}, {y:e}) mm: voxels, as many as at the origin"), touched.voxels, near.voxels);
        let middle = there.centre.to_array().map(|x| (x / 0.5) as i64);
        let (here, origin) = (r.volume().voxel(middle), r.volume().voxel([0; 3]));
        sheet.at_most(
            &format!("({x:e}, {y:e}) mm: its middle is the origin's, off by"),
            f64::from((here.0 - origin.0).abs()),
            1e-3,
        );
        let wrapped = [middle[0] + (1 << 35), middle[1], middle[2]];
        sheet.equal(
            &format!("({x:e}, {y:e}) mm: 2³⁵ voxels on there is nothing"),
            r.volume().voxel(wrapped),
            (0.0, 0.0),
        );
    }
    let before = content(r.volume());
    let beyond = Probe { centre: DVec3::Y * 1.08e9, ..arm };
    sheet.equal("beyond the lattice", r.insert(&beyond.put(&picture, 0.0)).err(), Some(Refused::OutOfRange));
    sheet.equal("state after it", content(r.volume()), before);
    sheet.at_most("bytes held", r.volume().bytes() as f64, 5.0 * 4.0 * 64.0 * 17.0 * 4.0 + 4096.0);
}
