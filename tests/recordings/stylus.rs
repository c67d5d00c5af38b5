//! Stylus and landmarks on the recording of PLUS's phantom registration: eight divots, in each
//! of which the stylus was pivoted about its tip.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};
use libtest_mimic::Failed;
use sonoweave::app::calibrate::guide::Gathering;
use sonoweave::app::calibrate::poses::{Recording, Source};

use calibration::error::CalibrationError;
use calibration::landmarks::{Reading, Registered, Settings, register};
use calibration::pivot::{self, Pivot};
use calibration::statistics::Spread;
use config::Settings as Config;
use config::phantom::PhantomSettings;
use sonoweave_core::frames::{Phantom, Reference, Transform};
use sonoweave_core::named::StaticTransform;

use crate::Test;

const LANDMARKS: &str = "tracking/EightLandmarkPointsTrackedForPhantomRegistration.igs.mha";
const SWEEP: &str = "freehand/NwirePhantomFreehand.igs.mha";

pub(crate) const TESTS: &[Test] = &[
    Test::of_file("the_phantom_is_where_plus_found_it", LANDMARKS, whole),
    Test::of_file("half_of_the_landmarks_say_nearly_the_same", LANDMARKS, half),
    Test::of_file("the_tip_of_another_stylus_is_refused", LANDMARKS, other_tip),
    Test::of_file("each_swing_finds_the_same_tip", LANDMARKS, swings),
    Test::of_file("a_stylus_that_lies_on_the_table_has_no_tip", LANDMARKS, still),
    Test::of_file("a_stylus_that_was_never_seen_is_said_to_be", SWEEP, unseen),
];

/// Returns a time range of a recording, s.
fn part(path: &Path, from: f64, to: f64) -> Recording {
    let source = Source { sequence: Some(path.to_owned()), ..Source::default() };
    Recording {
        source,
        gathering: Gathering::default(),
        stylus: "Stylus".into(),
        reference: None,
        from: Some(from),
        to: Some(to),
        flags: ["--stylus", "--reference"],
    }
}

/// Returns the configuration of the recording, and PLUS's results.
fn files(path: &Path) -> [PathBuf; 2] {
    ["PlusDeviceSet_fCal_Sim_RecordPhantomLandmarks.xml", "PhantomRegistrationLandmarkDetection.results.xml"]
        .map(|name| path.with_file_name(name))
}

fn transform(file: &Path, name: &str) -> Result<StaticTransform, Failed> {
    let found = Config::read(file, None)?.transforms.into_iter().find(|t| t.name() == name);
    found.ok_or_else(|| format!("{}: no {name}", file.display()).into())
}

fn registered(path: &Path, tip: &Path, from: f64, to: f64) -> Result<Result<Registered, CalibrationError>, Failed> {
    let phantom = PhantomSettings::read(&files(path)[0])?;
    let tip = transform(tip, "StylusTipToStylus")?.affine.translation;
    let read = part(path, from, to).read().map_err(|failure| failure.0.sentence)?;
    assert_eq!((read.frame.as_str(), read.route.as_str()), ("Reference", "Stylus → Tracker → Reference"));
    let reading = |(time_s, pose): &(f64, _)| Reading { time_s: *time_s, reference_from_stylus: *pose };
    let readings: Vec<Reading> = read.poses.iter().map(reading).collect();
    Ok(register(&readings, tip, phantom.geometry.landmarks(), &Settings::default()))
}

/// Returns the landmarks' distances from PLUS's registration, mm, and the angle between both,
/// degrees.
fn from_plus(path: &Path, registered: &Registered) -> Result<(Vec<f64>, f64), Failed> {
    let [configuration, results] = files(path);
    let plus = transform(&results, "PhantomToReference")?;
    assert!((plus.affine.translation - DVec3::new(22.7064, -39.7536, 25.6504)).length() < 1e-9);
    let plus = Transform::<Reference, Phantom>::from_affine(plus.affine);
    let phantom = PhantomSettings::read(&configuration)?;
    let ours = &registered.reference_from_phantom;
    let apart = |p: DVec3| ours.point(p).distance(plus.point(p));
    let turn = DQuat::from_mat3(&(ours.affine().matrix3 * plus.affine().matrix3.transpose()));
    let angle = turn.normalize().to_scaled_axis().length().to_degrees();
    Ok((phantom.geometry.landmarks().iter().map(|landmark| apart(landmark.position_mm)).collect(), angle))
}

fn whole(path: &Path) -> Result<(), Failed> {
    let found = registered(path, &files(path)[0], 0.0, 100.0)??;
    let (apart, angle) = from_plus(path, &found)?;
    let farthest = apart.iter().fold(0.0, |most: f64, mm| most.max(*mm));
    println!(
        "error {:.3} mm (PLUS 0.198), at landmarks at most {farthest:.3} mm and {angle:.3}° from PLUS's; noise {:.3} mm",
        found.error_mm.mean, found.noise_mm
    );
    let order: Vec<usize> = found.touched.iter().map(|touched| touched.landmark).collect();
    assert_eq!((order.as_slice(), found.missed.len(), found.by_order), ([0, 1, 2, 3, 4, 5, 6, 7].as_slice(), 0, false));
    // They were touched in the file's order, for five seconds each.
    let begins: Vec<f64> = found.touched.iter().map(|touched| touched.rests[0].time_s[0]).collect();
    assert!(begins.windows(2).all(|two| two[1] > two[0] + 5.0), "{begins:?}");
    assert!(found.touched.iter().all(|touched| touched.rests.len() == 1));
    // It was static before and after.
    assert_eq!(found.elsewhere.len(), 2);
    assert!(found.error_mm.mean < 0.35 && farthest < 0.35 && angle < 0.15, "{:?} {apart:?} {angle}", found.error_mm);
    // The estimated error covers the distance from PLUS's result: within three standard
    // deviations.
    let phantom = PhantomSettings::read(&files(path)[0])?;
    for (landmark, mm) in phantom.geometry.landmarks().iter().zip(&apart) {
        let sd = found.sd_at(landmark.position_mm);
        assert!(*mm < 3.0 * sd && sd < 0.3, "{}: {mm} mm, of {sd}", landmark.name);
    }
    Ok(())
}

fn half(path: &Path) -> Result<(), Failed> {
    // Up to the middle of the sixth landmark; from the middle of the third.
    for (from, to, missed) in [(0.0, 46.0, vec![6, 7]), (20.5, 100.0, vec![0, 1])] {
        let found = registered(path, &files(path)[0], from, to)??;
        let (apart, angle) = from_plus(path, &found)?;
        let farthest = apart.iter().fold(0.0, |most: f64, mm| most.max(*mm));
        println!(
            "{from} to {to} s: {:.3} mm, at most {farthest:.3} mm and {angle:.3}° from PLUS's",
            found.error_mm.mean
        );
        assert_eq!(found.missed, missed);
        assert!(farthest < 0.6 && angle < 0.3, "{farthest} {angle}");
    }
    Ok(())
}

fn other_tip(path: &Path) -> Result<(), Failed> {
    // This tip is 13 mm from the stylus's own.
    let error = registered(path, &files(path)[1], 0.0, 100.0)?.expect_err("another tip").to_string();
    assert!(error.contains("the stylus's tip"), "{error}");
    Ok(())
}

fn pivot(path: &Path, from: f64, to: f64) -> Result<Result<Pivot, CalibrationError>, Failed> {
    let poses: Vec<_> = part(path, from, to).read().map_err(|failure| failure.0.sentence)?.poses;
    let poses: Vec<_> = poses.into_iter().map(|(_, pose)| pose).collect();
    Ok(pivot::calibrate(&poses, &pivot::Settings::default()))
}

/// Five seconds in each of eight divots, with axes turned by only 9 to 23°: each gives the tip
/// to some tenths of a mm. All agree within twice their estimated errors. (The tip rolls in the
/// divot, which is not noise.)
fn swings(path: &Path) -> Result<(), Failed> {
    let found = registered(path, &files(path)[0], 0.0, 100.0)??;
    let mut tips: Vec<Pivot> = Vec::new();
    for touched in &found.touched {
        let [from, to] = touched.rests[0].time_s;
        // The tip settles into the divot and leaves it.
        match pivot(path, from + 0.3, to - 0.3)? {
            Ok(tip) => tips.push(tip),
            Err(error) => println!("{from:.1} to {to:.1} s: {error}"),
        }
    }
    assert!(tips.len() >= 7, "{}", tips.len());
    let mean = tips.iter().map(|tip| tip.tip_mm).sum::<DVec3>() / tips.len() as f64;
    let mut squares = 0.0;
    for tip in &tips {
        let sds = [0, 1, 2].map(|i| tip.tip_covariance_mm2[i][i].sqrt());
        let apart = tip.tip_mm - mean;
        println!("{:.2}, sd {sds:.2?}, strays {:.3} mm (PLUS's own tip 0.462)", tip.tip_mm, tip.residual_mm.mean);
        squares += (0..3).map(|i| (apart[i] / sds[i]).powi(2)).sum::<f64>();
        assert!(sds.iter().all(|sd| *sd < 0.8) && tip.residual_mm.mean < 0.6, "{sds:?} {}", tip.residual_mm.mean);
    }
    let errors = (squares / (3.0 * (tips.len() as f64 - 1.0))).sqrt();
    println!("errors are {errors:.2} times what is said of them");
    assert!((0.3..2.0).contains(&errors), "{errors}");
    let spread = Spread::of(tips.iter().map(|tip| tip.tip_mm.distance(mean)));
    // PLUS's tip of this stylus was calibrated on another day.
    let plus = transform(&files(path)[0], "StylusTipToStylus")?.affine.translation;
    println!("mean {mean:.2}, {:.2} mm apart (rms), {:.2} mm from PLUS's tip", spread.rms, plus.distance(mean));
    assert!(spread.rms < 0.8 && plus.distance(mean) < 2.0, "{} {}", spread.rms, plus.distance(mean));
    Ok(())
}

fn still(path: &Path) -> Result<(), Failed> {
    let error = pivot(path, 0.0, 2.4)?.expect_err("it lies still").to_string();
    assert!(error.starts_with("the stylus was hardly turned (0."), "{error}");
    Ok(())
}

fn unseen(path: &Path) -> Result<(), Failed> {
    let recording = Recording { from: None, to: None, ..part(path, 0.0, 1.0) };
    let error = recording.read().expect_err("its stylus is INVALID throughout").0.sentence;
    assert!(error.contains("none of 97 poses of Stylus is usable") && error.contains("status INVALID"), "{error}");
    let other = Recording { stylus: "Pointer".into(), ..recording };
    let error = other.read().expect_err("there is no pointer").0.sentence;
    assert!(error.contains("holds no frame Pointer, only ") && error.contains("--stylus"), "{error}");
    Ok(())
}
