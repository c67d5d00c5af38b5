use glam::DQuat;

use super::*;
use crate::clock::TimeFlags;
use crate::clock::simulation::Draws;
use crate::history::{PoseHistory, Unavailable};

const MS: i64 = 1_000_000;
const SECOND: i64 = 1_000 * MS;
/// Poses a second.
const RATE: i64 = 120;
/// Distance of the image's middle from the sensor, mm.
const LEVER: DVec3 = DVec3::new(0.0, 110.0, 0.0);
const OFFLINE: Smoothing = Smoothing { half_width_ns: 300 * MS, ahead_ns: 300 * MS };
/// One frame at 30 frames a second.
const LIVE: Smoothing = Smoothing { ahead_ns: 33_333_333, ..OFFLINE };

impl Draws {
    fn normals(&mut self) -> DVec3 {
        DVec3::new(self.normal(), self.normal(), self.normal())
    }
}

fn sample(time_ns: i64, pose: Rigid) -> PoseSample {
    PoseSample { time_ns, bound_ns: 0, flags: TimeFlags::NONE, pose, invalid: None }
}

fn time_of(index: i64) -> i64 {
    index * SECOND / RATE
}

/// A hand that sweeps at 10.5 mm/s: it wanders slowly, corrects itself, and trembles.
struct Hand(Vec<[DVec3; 4]>);

impl Hand {
    fn new(seed: u64) -> Self {
        let mut draws = Draws::new(seed);
        // Frequencies, Hz; standard deviations along an axis, mm and degrees.
        let parts = [([0.03, 0.4], 1.2, 3.4), ([0.4, 2.0], 0.05, 0.1), ([7.0, 11.0], 0.023, 0.029)];
        let mut waves = Vec::new();
        for ([low, high], mm, degrees) in parts {
            const WAVES: usize = 10;
            for _ in 0..WAVES {
                let mut any = || DVec3::new(draws.unit(), draws.unit(), draws.unit());
                let per_second = any() * (high - low) + low;
                let phases = any();
                let size = libm::sqrt(2.0 / WAVES as f64);
                waves.push([
                    per_second,
                    phases,
                    DVec3::splat(size * mm),
                    DVec3::splat(size * f64::to_radians(degrees)),
                ]);
            }
        }
        Self(waves)
    }

    fn at(&self, time_ns: i64) -> Rigid {
        let s = time_ns as f64 * 1e-9;
        let (mut position_mm, mut turn) = (DVec3::Z * (10.5 * s), DVec3::ZERO);
        for [per_second, phases, mm, rad] in &self.0 {
            let angles = (*per_second * s + *phases) * std::f64::consts::TAU;
            position_mm += *mm * angles.map(libm::sin);
            turn += *rad * angles.map(libm::cos);
        }
        Rigid { rotation: of_rotation_vector(turn), position_mm }
    }
}

/// Returns a pose with noise: standard deviations along and about an axis, mm and degrees.
fn noisy(pose: Rigid, mm: f64, degrees: f64, draws: &mut Draws) -> Rigid {
    let turn = of_rotation_vector(draws.normals() * degrees.to_radians());
    Rigid { rotation: (turn * pose.rotation).normalize(), position_mm: pose.position_mm + draws.normals() * mm }
}

fn history(samples: impl IntoIterator<Item = PoseSample>) -> PoseHistory {
    let mut history = PoseHistory::new(8192, 100 * MS);
    samples.into_iter().for_each(|sample| history.insert(sample));
    history
}

/// Root mean squares of a point's error in the middle of the image, mm: interpolated, smoothed
/// offline, smoothed one frame ahead. `noise` makes a sample of the true pose.
fn errors(seconds: i64, mut noise: impl FnMut(i64, Rigid) -> Rigid) -> [f64; 3] {
    let hand = Hand::new(3);
    let history = history((0..seconds * RATE).map(|n| sample(time_of(n), noise(n, hand.at(time_of(n))))));
    let mut sums = [0.0; 3];
    let mut frames = 0;
    for time_ns in (SECOND..(seconds - 1) * SECOND).step_by(33_733_333) {
        let between = history.at(time_ns).unwrap().pose();
        let smoothed = [OFFLINE, LIVE].map(|settings| smoothed(&history, time_ns, &settings).unwrap().pose);
        let truth = hand.at(time_ns).point(LEVER);
        for (sum, pose) in sums.iter_mut().zip([between, smoothed[0], smoothed[1]]) {
            *sum += (pose.point(LEVER) - truth).length_squared();
        }
        frames += 1;
    }
    sums.map(|sum| (sum / f64::from(frames)).sqrt())
}

#[test]
fn smoothing_lowers_white_noise_of_a_hand_offline_and_live() {
    let mut draws = Draws::new(7);
    let [between, offline, live] = errors(40, |_, pose| noisy(pose, 0.3, 0.3, &mut draws));
    assert!(offline <= 0.35 * between && live <= 0.45 * between, "{between} {offline} {live}");
}

#[test]
fn accurate_poses_do_not_become_worse() {
    for (noise, most) in [(0.1, 0.9), (0.03, 1.0), (0.01, 1.05), (0.0, 1.05)] {
        let mut draws = Draws::new(7);
        let hand = Hand::new(3);
        let history =
            history((0..1200).map(|n| sample(time_of(n), noisy(hand.at(time_of(n)), noise, noise, &mut draws))));
        let mut sums = [0.0; 3];
        for time_ns in (SECOND..9 * SECOND).step_by(33_733_333) {
            let between = history.at(time_ns).unwrap().pose();
            let smoothed = [OFFLINE, LIVE]
                .map(|settings| smoothed(&history, time_ns, &settings).map_or(between, |found| found.pose));
            let truth = hand.at(time_ns).point(LEVER);
            for (sum, pose) in sums.iter_mut().zip([between, smoothed[0], smoothed[1]]) {
                *sum += (pose.point(LEVER) - truth).length_squared();
            }
        }
        let [between, offline, live] = sums.map(f64::sqrt);
        assert!(offline <= most * between && live <= most * between, "{noise}: {between} {offline} {live}");
    }
}

#[test]
fn stated_standard_error_is_that_of_a_resting_sensor() {
    let mut draws = Draws::new(5);
    let rest = Rigid { rotation: DQuat::from_rotation_x(2.0), position_mm: DVec3::new(100.0, -50.0, 20.0) };
    let history = history((0..120 * RATE).map(|n| sample(time_of(n), noisy(rest, 0.3, 0.2, &mut draws))));
    let (mut squares, mut stated, mut frames) = ([0.0; 2], [0.0; 2], 0.0);
    // The last samples are kept; windows beside each other share none.
    for time_ns in (60 * SECOND..119 * SECOND).step_by(300_000_000) {
        let found = smoothed(&history, time_ns, &OFFLINE).unwrap();
        let off = rotation_vector(found.pose.rotation * rest.rotation.conjugate());
        squares[0] += (found.pose.position_mm - rest.position_mm).length_squared() / 3.0;
        squares[1] += off.length_squared() / 3.0;
        stated[0] += found.position_se_mm.powi(2);
        stated[1] += found.rotation_se_rad.powi(2);
        frames += 1.0;
    }
    for kind in 0..2 {
        let [sd, stated] = [squares[kind], stated[kind]].map(|sum| (sum / frames).sqrt());
        assert!((stated / sd - 1.0).abs() < 0.1, "{kind}: {stated} {sd}");
    }
}

#[test]
fn constant_acceleration_passes_unchanged() {
    let at = |time_ns: i64| {
        let s = time_ns as f64 * 1e-9;
        let turn = DVec3::new(0.6, -0.64, 0.48) * (0.5 * s + 0.2 * s * s);
        Rigid {
            rotation: of_rotation_vector(turn),
            position_mm: DVec3::new(50.0 * s, 100.0 - 8.0 * s * s, 20.0 * s * s),
        }
    };
    let history = history((0..4 * RATE).map(|n| sample(time_of(n), at(time_of(n)))));
    for settings in [OFFLINE, LIVE] {
        for time_ns in [SECOND, SECOND + 3 * MS, 2 * SECOND + 4_166_667] {
            let found = smoothed(&history, time_ns, &settings).unwrap();
            let truth = at(time_ns);
            assert!((found.pose.position_mm - truth.position_mm).length() < 1e-9, "{found:?}");
            assert!(found.pose.rotation.dot(truth.rotation).abs() > 1.0 - 1e-14, "{found:?}");
            assert_eq!(found.half_widths_ns, [300 * MS; 2]);
        }
    }
}

#[test]
fn outliers_count_little() {
    let mut draws = Draws::new(11);
    let [_, clean, _] = errors(30, |_, pose| noisy(pose, 0.3, 0.3, &mut draws));
    let mut draws = Draws::new(11);
    let [between, outlying, live] = errors(30, |n, pose| match n % 100 {
        50 => noisy(pose, 5.0, 5.0, &mut draws),
        _ => noisy(pose, 0.3, 0.3, &mut draws),
    });
    assert!(
        outlying <= 1.2 * clean && live < 0.5 * between && between > 2.0 * clean,
        "{clean} {outlying} {live} {between}"
    );
}

#[test]
fn live_is_offline_without_what_comes_later() {
    let mut draws = Draws::new(2);
    let hand = Hand::new(1);
    let all: Vec<PoseSample> =
        (0..6 * RATE).map(|n| sample(time_of(n), noisy(hand.at(time_of(n)), 0.3, 0.3, &mut draws))).collect();
    let whole = history(all.iter().cloned());
    for time_ns in (SECOND..5 * SECOND).step_by(171_717_171) {
        let cut = history(all.iter().filter(|one| one.time_ns <= time_ns + LIVE.ahead_ns).cloned());
        let [live, offline] =
            [(&whole, LIVE), (&cut, OFFLINE)].map(|(from, settings)| smoothed(from, time_ns, &settings).unwrap());
        let bits = |found: &Smoothed| {
            (found.pose.rotation.to_array().map(f64::to_bits), found.pose.position_mm.to_array().map(f64::to_bits))
        };
        assert_eq!(bits(&live), bits(&offline));
    }
}

#[test]
fn time_reversed_samples_give_the_same_place() {
    let mut draws = Draws::new(4);
    let hand = Hand::new(1);
    let all: Vec<PoseSample> =
        (-40..=40).map(|n| sample(time_of(n), noisy(hand.at(time_of(n)), 0.3, 0.3, &mut draws))).collect();
    let mirrored: Vec<PoseSample> =
        all.iter().rev().map(|one| PoseSample { time_ns: -one.time_ns, ..one.clone() }).collect();
    let [there, back] = [all, mirrored].map(|all| smoothed(&history(all), 0, &OFFLINE).unwrap());
    assert!((there.pose.position_mm - back.pose.position_mm).length() < 1e-9);
    assert!(there.pose.rotation.dot(back.pose.rotation) > 1.0 - 1e-14);
}

#[test]
fn wide_turns_lose_nothing() {
    let mut draws = Draws::new(9);
    // 160 degrees in two seconds, fastest in the middle.
    let at = |time_ns: i64| {
        let angle = 80.0_f64.to_radians() * libm::sin(0.5 * std::f64::consts::PI * (time_ns as f64 * 1e-9 - 1.0));
        Rigid { rotation: DQuat::from_axis_angle(DVec3::new(0.6, 0.0, 0.8), angle), position_mm: DVec3::ZERO }
    };
    let history = history((0..2 * RATE).map(|n| sample(time_of(n), noisy(at(time_of(n)), 0.3, 0.3, &mut draws))));
    let (mut sum, mut frames) = (0.0, 0.0);
    for time_ns in (400 * MS..1600 * MS).step_by(7_000_001) {
        let found = smoothed(&history, time_ns, &OFFLINE).unwrap();
        sum += rotation_vector(found.pose.rotation * at(time_ns).rotation.conjugate()).length_squared() / 3.0;
        frames += 1.0;
    }
    let sd_degrees = (sum / frames).sqrt().to_degrees();
    assert!(sd_degrees < 0.3 * 0.3, "{sd_degrees}");
}

#[test]
fn repeated_readings_are_left_out() {
    let mut draws = Draws::new(6);
    let hand = Hand::new(1);
    let measured: Vec<PoseSample> = (0..6 * RATE)
        .filter(|n| n % 2 == 0)
        .map(|n| sample(time_of(n), noisy(hand.at(time_of(n)), 0.3, 0.3, &mut draws)))
        .collect();
    let repeated = measured.iter().flat_map(|one| {
        let again = PoseSample { time_ns: one.time_ns + SECOND / RATE, ..one.clone() };
        [one.clone(), again]
    });
    let [once, twice] = [history(measured.clone()), history(repeated)].map(|history| {
        let found = smoothed(&history, 2 * SECOND, &OFFLINE).unwrap();
        (found.pose, found.half_widths_ns)
    });
    assert_eq!(once, twice);
}

#[test]
fn rest_without_noise_keeps_its_bits() {
    let rest = Rigid { rotation: DQuat::from_rotation_x(2.0), position_mm: DVec3::new(0.1, 0.2, 0.3) };
    let history = history((0..2 * RATE).map(|n| sample(time_of(n), rest)));
    assert_eq!(smoothed(&history, SECOND, &OFFLINE).unwrap_err(), NotSmoothed::FewSamples { samples: 0 });
    assert_eq!(history.at(SECOND).unwrap().pose(), rest);
}

#[test]
fn reason_is_given_where_smoothing_would_be_wrong() {
    let mut draws = Draws::new(8);
    let hand = Hand::new(1);
    // Too few poses a second.
    let slow =
        history((0..6 * 15).map(|n| sample(n * SECOND / 15, noisy(hand.at(n * SECOND / 15), 0.3, 0.3, &mut draws))));
    let few = smoothed(&slow, 2 * SECOND, &Smoothing { half_width_ns: 200 * MS, ..OFFLINE }).unwrap_err();
    assert_eq!((few, few.name()), (NotSmoothed::FewSamples { samples: 6 }, "few samples"));
    assert_eq!(few.to_string(), "only 6 different poses lie in the window");
    // A shake that no window can follow, and hardly any noise.
    let shake = |n: i64| DVec3::X * 5.0 * libm::sin(time_of(n) as f64 * 1e-9 * 20.0 * std::f64::consts::TAU);
    let shaken = history((0..6 * RATE).map(|n| {
        let pose = Rigid { rotation: DQuat::IDENTITY, position_mm: shake(n) };
        sample(time_of(n), noisy(pose, 1e-3, 1e-3, &mut draws))
    }));
    let fast = smoothed(&shaken, 2 * SECOND, &OFFLINE).unwrap_err();
    assert!(matches!(fast, NotSmoothed::TooFast | NotSmoothed::NotWhite { .. }), "{fast}");
    // The tracker's own filter: the mean of the last four poses, thrice.
    let mut filters = [[DVec3::ZERO; 4]; 3];
    let mut filtered = || {
        let mut noise = draws.normals();
        for last in &mut filters {
            last.rotate_right(1);
            last[0] = noise;
            noise = last.iter().sum::<DVec3>() * 0.25;
        }
        noise
    };
    let coloured = history((0..6 * RATE).map(|n| {
        let Rigid { rotation, position_mm } = hand.at(time_of(n));
        sample(time_of(n), Rigid { rotation, position_mm: position_mm + filtered() })
    }));
    let not_white = smoothed(&coloured, 3 * SECOND, &OFFLINE).unwrap_err();
    assert!(matches!(not_white, NotSmoothed::NotWhite { lag_1 } if lag_1 > -0.5), "{not_white}");
    assert!(not_white.to_string().contains("−0.75"), "{not_white}");
    // Beside a lost sensor there is no pose at all.
    assert_eq!(coloured.at(7 * SECOND).unwrap_err(), Unavailable::After { by_ns: 7 * SECOND - time_of(6 * RATE - 1) });
}

#[test]
fn noise_of_moving_sensor_is_found_by_third_differences() {
    let hand = Hand::new(2);
    for (mm, degrees) in [(0.3, 0.3), (0.05, 0.02)] {
        let mut draws = Draws::new(13);
        let all: Vec<PoseSample> =
            (0..20 * RATE).map(|n| sample(time_of(n), noisy(hand.at(time_of(n)), mm, degrees, &mut draws))).collect();
        let [position, rotation] = fast_noise(&all.iter().collect::<Vec<_>>()).unwrap();
        assert!((position.variance.sqrt() / mm - 1.0).abs() < 0.06, "{position:?}");
        assert!((rotation.variance.sqrt().to_degrees() / degrees - 1.0).abs() < 0.06, "{rotation:?}");
        for noise in [position, rotation] {
            assert!((noise.lag_1 + 0.75).abs() < 0.03, "{noise:?}");
        }
    }
    // Autoregressive noise shows less of itself, and a higher correlation.
    for (coefficient, share, lag_1) in [(0.5, 0.62, -0.684), (0.9, 0.25, -0.659)] {
        let mut draws = Draws::new(17);
        let mut slow = DVec3::ZERO;
        let all: Vec<PoseSample> = (0..20 * RATE)
            .map(|n| {
                slow = slow * coefficient + draws.normals() * libm::sqrt(1.0 - coefficient * coefficient);
                let Rigid { rotation, position_mm } = noisy(hand.at(time_of(n)), 0.0, 0.1, &mut draws);
                sample(time_of(n), Rigid { rotation, position_mm: position_mm + slow })
            })
            .collect();
        let [position, _] = fast_noise(&all.iter().collect::<Vec<_>>()).unwrap();
        assert!((position.variance.sqrt() - share).abs() < 0.05, "{coefficient}: {position:?}");
        assert!((position.lag_1 - lag_1).abs() < 0.03, "{coefficient}: {position:?}");
    }
    let one = sample(0, Rigid::IDENTITY);
    assert_eq!(fast_noise(&[&one; 18]), None);
}
