use proptest::prelude::*;

use super::*;

const MS: i64 = 1_000_000;

fn sample(ms: i64, x: f64) -> PoseSample {
    let pose = Rigid { rotation: DQuat::from_rotation_z(x * 0.01), position_mm: DVec3::new(x, -x, 5.0) };
    PoseSample { time_ns: ms * MS, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None }
}

fn history(times_ms: &[i64]) -> PoseHistory {
    let mut history = PoseHistory::new(100, 50 * MS);
    times_ms.iter().for_each(|ms| history.insert(sample(*ms, *ms as f64)));
    history
}

#[test]
fn query_returns_how_or_why_not() {
    let mut history = history(&[10, 20, 30, 100]);
    let found = history.at(20 * MS).unwrap();
    assert_eq!((found.how, found.pose()), (How::Exact, sample(20, 20.0).pose));
    let found = history.at(25 * MS).unwrap();
    assert_eq!(found.how, How::Interpolated { gap_ns: 10 * MS });
    assert!((found.pose().position_mm - DVec3::new(25.0, -25.0, 5.0)).length() < 1e-12);
    assert!(found.pose().rotation.angle_between(DQuat::from_rotation_z(0.25)) < 1e-7);
    assert_eq!(history.at(9 * MS).unwrap_err(), Unavailable::Before { by_ns: MS });
    assert_eq!(history.at(101 * MS).unwrap_err(), Unavailable::After { by_ns: MS });
    assert_eq!(history.at(60 * MS).unwrap_err(), Unavailable::Gap { gap_ns: 70 * MS });
    let word = Cow::Borrowed("signal weak");
    history.insert(PoseSample { invalid: Some(word.clone()), ..sample(110, 0.0) });
    history.insert(sample(120, 0.0));
    for at in [105, 110, 115] {
        assert_eq!(history.at(at * MS).unwrap_err(), Unavailable::Invalid { word: word.clone() }, "{at}");
    }
    assert!(history.at(100 * MS).is_ok(), "beside it does not matter");
    history.insert(PoseSample { flags: TimeFlags::LOST, ..sample(130, 0.0) });
    assert_eq!(history.at(125 * MS).unwrap_err(), Unavailable::ClockLost);
    assert_eq!(PoseHistory::new(9, 1).at(0).unwrap_err(), Unavailable::Nothing);
    let sentences = [Unavailable::Nothing, Unavailable::After { by_ns: 12 * MS }].map(|why| why.to_string());
    assert_eq!(sentences, ["nothing was received", "no pose came after the time: the last is 12.0 ms before it"]);
}

#[test]
fn out_of_order_samples_sorted_and_counted() {
    let mut history = history(&[10, 30, 20, 40, 30]);
    let times: Vec<i64> = history.samples.iter().map(|sample| sample.time_ns / MS).collect();
    assert_eq!(times, [10, 20, 30, 40]);
    let expected = Inserted { samples: 5, out_of_order: 1, repeated: 1, too_old: 0 };
    assert_eq!(history.inserted(), expected);
    history.kept = 4;
    history.insert(sample(5, 0.0));
    assert_eq!(history.inserted(), Inserted { too_old: 1, ..expected });
    history.insert(sample(50, 0.0));
    assert_eq!((history.len(), history.newest_ns()), (4, Some(50 * MS)));
    assert_eq!(history.at(15 * MS).unwrap_err(), Unavailable::Before { by_ns: 5 * MS });
}

#[test]
fn shorter_rotation_for_either_quaternion_sign() {
    for sign in [1.0, -1.0] {
        let a = Rigid { rotation: DQuat::from_rotation_x(0.2), ..Rigid::IDENTITY };
        let b = Rigid { rotation: DQuat::from_rotation_x(0.6) * sign, ..Rigid::IDENTITY };
        let half = a.between(&b, 0.5).rotation;
        assert!(half.dot(DQuat::from_rotation_x(0.4)).abs() > 1.0 - 1e-12);
    }
}

#[test]
fn error_is_clock_error_plus_bend() {
    // 1 mm per ms along x, and from 30 ms on along y.
    let place = |ms: i64| {
        let [x, y] = [ms.min(30), (ms - 30).max(0)].map(|ms| ms as f64);
        let pose = Rigid { position_mm: DVec3::new(x, y, 0.0), ..Rigid::IDENTITY };
        PoseSample { time_ns: ms * MS, bound_ns: MS / 2, flags: TimeFlags::NONE, pose, invalid: None }
    };
    let mut history = PoseHistory::new(10, 50 * MS);
    [0, 12, 24, 36, 48].iter().for_each(|ms| history.insert(place(*ms)));
    let found = history.at(30 * MS).unwrap();
    let error = found.error_mm(MS / 4, |pose| pose.point(DVec3::ZERO));
    let bend = (found.pose().position_mm - DVec3::new(30.0, 0.0, 0.0)).length();
    // 0.75 ms at 1 mm per ms, plus the bend at its worst place.
    assert!((bend - 12.0 * 2.0_f64.sqrt() / 4.0).abs() < 1e-9, "{bend}");
    assert!(error >= 0.75 + bend && error < 0.75 + 1.5 * bend, "{error}");
    let straight = history.at(18 * MS).unwrap().error_mm(0, |pose| pose.point(DVec3::ZERO));
    assert!(straight > 0.5, "the way may bend before the next sample: {straight}");
}

#[test]
fn samples_with_overlapping_bounds_give_no_velocity() {
    // 10 mm/s; the second sample's time is wrong by 60 ms, within its bound, so that it lies a
    // microsecond before the third's.
    let place = |ms: i64, time_ns: i64, bound_ns: i64| {
        let pose = Rigid { position_mm: DVec3::X * ms as f64 * 0.01, ..Rigid::IDENTITY };
        PoseSample { time_ns, bound_ns, flags: TimeFlags::NONE, pose, invalid: None }
    };
    let mut history = PoseHistory::new(10, 100 * MS);
    history.insert(place(0, 0, 1000));
    history.insert(place(20, 80 * MS - 1000, 61 * MS));
    history.insert(place(80, 80 * MS, 1000));
    history.insert(place(100, 100 * MS, 1000));
    for at in [60 * MS, 80 * MS - 500, 90 * MS] {
        let found = history.at(at).unwrap();
        let error = found.error_mm(0, |pose| pose.point(DVec3::ZERO));
        let off = (found.pose().position_mm.x - at as f64 * 1e-8).abs();
        assert!(off <= error && error < 3.0, "{at}: {off} {error}");
    }
}

proptest! {
    #[test]
    fn query_matches_linear_search(
        times in prop::collection::vec(0_i64..400, 1..60), at in -10_i64..420,
    ) {
        let history = history(&times);
        let mut sorted = times.clone();
        sorted.sort_unstable();
        sorted.dedup();
        let [before, after] = [sorted.iter().rev().find(|t| **t <= at), sorted.iter().find(|t| **t >= at)];
        match (before, after, history.at(at * MS)) {
            (Some(a), Some(b), Ok(found)) => {
                prop_assert_eq!(found.about.map(|sample| sample.time_ns / MS), [*a, *b]);
                prop_assert!(b - a <= 50);
                // The motion is linear and turns at constant speed, and so is the
                // interpolation.
                prop_assert!((found.pose().position_mm.x - at as f64).abs() < 1e-9);
            }
            (Some(a), Some(b), Err(Unavailable::Gap { gap_ns })) => prop_assert_eq!(gap_ns, (b - a) * MS),
            (None, Some(a), Err(Unavailable::Before { by_ns })) => prop_assert_eq!(by_ns, (a - at) * MS),
            (Some(b), None, Err(Unavailable::After { by_ns })) => prop_assert_eq!(by_ns, (at - b) * MS),
            other => prop_assert!(false, "{:?}", other),
        }
    }

    #[test]
    fn smooth_motion_within_error(
        speed in 1.0..200.0_f64, bend in -3000.0..3000.0_f64, rate in 20_i64..250, share in 0.0..1.0_f64,
    ) {
        let way = |s: f64| DVec3::new(speed * s, 0.5 * bend * s * s, 0.0);
        let mut history = PoseHistory::new(100, 100 * MS);
        for n in 0..10 {
            let time_ns = n * 1000 * MS / rate;
            let pose = Rigid { position_mm: way(time_ns as f64 * 1e-9), ..Rigid::IDENTITY };
            history.insert(PoseSample { time_ns, pose, ..sample(0, 0.0) });
        }
        let at = ((4.0 + share) * 1e9 / rate as f64) as i64;
        let found = history.at(at).unwrap();
        let off = (found.pose().position_mm - way(at as f64 * 1e-9)).length();
        prop_assert!(off <= found.error_mm(0, |pose| pose.point(DVec3::ZERO)) + 1e-9, "{}", off);
    }
}

#[test]
fn interpolation_of_equal_poses_is_exact() {
    for n in 0..1000 {
        let share = f64::from(n) / 999.0;
        // Many quaternions change when they are normalised twice.
        let rotation = DQuat::from_xyzw(0.1, share - 0.7, 0.3, 0.2).normalize();
        let pose = Rigid { rotation, position_mm: DVec3::new(0.1, -33.3, 1e3 / 7.0) };
        assert_eq!(pose.between(&pose, share), pose);
    }
}
