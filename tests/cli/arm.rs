//! `calibrate arm`: an arm with wrong zeros and lengths in its file touches divots, is recorded,
//! and is then calibrated.

use std::sync::{Arc, Mutex};

use glam::DVec2;

use calibration::arm::inverse::Elbow;
use calibration::arm::{Arm, JOINTS, Joint, PlanarPose, Sign};
use calibration::file::CalibrationFile;
use drivers::simulated::{Faults, Pty, ea1};
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};
use sonoweave_core::reading::AXES;

use super::place::Place;

const TURN: f64 = 40_000.0;
/// The arm rests at home; then it is moved to each position and held there.
const HOME: i64 = 5 * SECOND;
const MOVE: i64 = 150 * MS;
const HOLD: i64 = 450 * MS;
const DIVOTS: [[f64; 2]; 4] = [[0.0, 0.0], [80.0, 0.0], [80.0, 60.0], [0.0, 60.0]];
/// The divots in the order of touching, from 1.
const ORDER: [usize; 22] = [1, 2, 1, 3, 1, 4, 1, 2, 3, 1, 4, 2, 1, 3, 2, 4, 1, 4, 3, 1, 2, 3];

fn arm(lengths: [f64; JOINTS], zeros: [f64; JOINTS]) -> Arm {
    let mut joints = lengths.map(|mm| Joint::revolute(mm, TURN));
    joints.iter_mut().zip(zeros).for_each(|(joint, zero)| joint.zero_counts = zero);
    joints[1].sign = Sign::Minus;
    Arm::new(joints).unwrap()
}

fn truth() -> Arm {
    arm([252.3, 198.7, 81.4], [0.0, 311.25, -87.5])
}

/// The calibration as estimated with a ruler and by eye.
fn guess() -> CalibrationFile {
    let rows = [0.0, 0.2, 0.0, 45.0, 0.0, 0.0, 0.2, 0.0, 0.2, 0.0, 0.0, -6.0, 0.0, 0.0, 0.0, 1.0];
    CalibrationFile {
        provenance: "by ruler".into(),
        probe_from_image: Some(sonoweave_core::frames::Transform::from_rows(&rows).unwrap()),
        arm: Some(arm([250.0, 200.0, 80.0], [0.0; JOINTS])),
        ..CalibrationFile::default()
    }
}

/// Returns reproducible pseudo-noise with a standard deviation of about 1.
fn scatter(n: f64, which: f64) -> f64 {
    (2.0 * ((n * 7919.0 + which * 104_729.0) * 0.618_033_988_75).fract() - 1.0) * 1.7
}

/// Returns the counts at home and in each touch. The elbow is left or right, the wrist turned,
/// and the tip off the divot's middle by some hundredths of a mm.
fn counts() -> Vec<[i64; JOINTS]> {
    let mut all = vec![[0; JOINTS]];
    for (n, divot) in (0..).zip(ORDER) {
        let n = f64::from(n);
        let hole = DVec2::new(scatter(n, 1.0), scatter(n, 2.0)) * 0.05;
        let at = DVec2::from_angle(0.4).rotate(DVec2::from_array(DIVOTS[divot - 1])) + DVec2::new(190.0, 60.0) + hole;
        let elbow = if (n * 0.7).sin() > 0.0 { Elbow::Up } else { Elbow::Down };
        let pose = PlanarPose { position_mm: at, heading_rad: 0.9 * n };
        let values = truth().inverse(&pose, elbow).unwrap();
        all.push(truth().counts(&values).map(|count| count.round() as i64));
    }
    all
}

/// Returns the joints' counts over time.
fn moved(begin_ns: i64, at_ns: i64, places: &[[i64; JOINTS]]) -> [i64; AXES] {
    let after = at_ns - begin_ns - HOME;
    let step = usize::try_from(after.div_euclid(MOVE + HOLD) + 1).unwrap_or(0).min(places.len() - 1);
    let mut all = [0; AXES];
    let done = if step == 0 { MOVE } else { (after - (step as i64 - 1) * (MOVE + HOLD)).clamp(0, MOVE) };
    let from = places[step.saturating_sub(1)];
    for (count, (from, to)) in all.iter_mut().zip(from.into_iter().zip(places[step])) {
        *count = from + (to - from) * done / MOVE;
    }
    all
}

/// Records a session of the arm while its touches are judged; returns its path.
fn recorded(place: &Place) -> String {
    guess().write(&place.path("guess.toml")).unwrap();
    let (begin_ns, places) = (Monotonic.now_ns(), counts());
    let length = HOME + places.len() as i64 * (MOVE + HOLD);
    let mut twin = ea1::Twin::new(Arc::new(move |at_ns| moved(begin_ns, at_ns, &places)), Faults::default());
    (twin.starts_when_opened, twin.homed, twin.counts_per_turn) = (false, 7, [TURN as u32; JOINTS]);
    let line = Pty::run(Arc::new(Mutex::new(twin))).unwrap();
    place.put(
        "bedside.toml",
        format!(
            "format = \"sonoweave-bedside\"\nversion = 1\n[calibration]\nfile = \"guess.toml\"\n[arm]\nkind = \"ea1\"\nport = \"{}\"\n\
             [grabber]\ndevice = \"virtual\"\nsize = \"64x64\"\n[virtual]\nscene = \"blobs\"\n[record]\nfull_frame = true\n",
            line.path().display()
        ),
    );
    // The goal is never reached: the user is told what is missing until the time is over.
    place.put("plate.toml", plate(1.0));
    let seconds = length / SECOND + 1;
    let run = place.run(&format!(
        "calibrate arm --live bedside.toml --record sessions --duration {seconds} --goal 0.001 --rest 0.3 --skip 1 --plate plate.toml --order {}",
        joined(ORDER)
    ));
    assert_eq!(run.code, 0, "{} {}", run.stdout, run.stderr);
    for says in [
        "--order gives the divots of 22 touches, but the joints rested ",
        "22 touches of 4 divots: the tip is known to 0.",
    ] {
        assert!(run.stderr.contains(says), "{says}: {}", run.stderr);
    }
    assert!(run.stdout.starts_with("22 touches of 4 divots: 0.0"), "{}", run.stdout);
    let entry = std::fs::read_dir(place.path("sessions")).unwrap().next().unwrap().unwrap();
    std::fs::rename(entry.path(), place.path("arm.mcap")).unwrap();
    std::fs::remove_dir(place.path("sessions")).unwrap();
    "arm.mcap".into()
}

fn plate(factor: f64) -> String {
    let divots: Vec<String> = DIVOTS.iter().map(|[x, y]| format!("[{:?}, {:?}]", x * factor, y * factor)).collect();
    format!("format = \"sonoweave-plate\"\nversion = 1\ndivots_mm = [{}]\n", divots.join(", "))
}

fn joined(numbers: impl IntoIterator<Item = impl ToString>) -> String {
    numbers.into_iter().map(|number| number.to_string()).collect::<Vec<_>>().join(",")
}

/// Checks that the result lies within four standard deviations of the truth, and that these are
/// small.
fn is_found(report: &serde_json::Value, most_mm: f64) {
    let found = report["found"].as_array().unwrap();
    assert!(found.len() >= 4, "{report}");
    for number in found {
        let joint = number["joint"].as_u64().unwrap() as usize - 1;
        let of = |key: &str| number[key].as_f64().unwrap();
        let (true_value, most) = match number["number"].as_str().unwrap() {
            "length" => (truth().joints()[joint].length_mm, most_mm),
            "zero" => (truth().joints()[joint].zero_counts, most_mm / 80.0 * TURN / std::f64::consts::TAU),
            other => panic!("{other} was not asked for"),
        };
        let (off, sd) = ((of("value") - true_value).abs(), of("sd"));
        assert!(off < 4.0 * sd && sd < most, "{number}: off by {off} in {report}");
    }
}

#[test]
fn arm_is_calibrated_and_slipped_encoder_is_named() {
    let place = Place::new();
    let session = recorded(&place);
    // The first rest is at home.
    let by = format!("calibrate arm --session {session} --rest 0.3 --skip 1");
    let order = format!("--plate plate.toml --order {}", joined(ORDER));
    place.put("cal.toml", place.get("guess.toml"));
    let said = place.does(&format!("{by} {order} -o cal.toml --json=arm.json"));
    assert!(said.starts_with("22 touches of 4 divots: 0.0"), "{said}");
    for part in
        ["zero of joint 2", "(was 250)", "the tip is known to 0.", "touch 2 of divot 1", "calibration: cal.toml"]
    {
        assert!(said.contains(part), "{part}: {said}");
    }
    let report = place.json("arm.json");
    is_found(&report, 0.3);
    assert_eq!((report["found"].as_array().unwrap().len(), report["touches"].as_array().unwrap().len()), (5, 22));
    let file = CalibrationFile::read(&place.path("cal.toml")).unwrap();
    assert!(file.provenance.starts_with("by ruler; Arm: 22 touches of 4 divots in arm.mcap"), "{}", file.provenance);
    assert_eq!((file.arm_fit_rms_mm, file.probe_from_image), (report["rms_mm"].as_f64(), guess().probe_from_image));
    let is_near = |one: f64, other: f64| (one - other).abs() < 1.0;
    assert!(is_near(file.arm.unwrap().joints()[0].length_mm, 252.3), "{file:?}");
    place.knows_origin(&file.origins["arm"], &[&session, "plate.toml"]);
    place.does("inspect cal.toml");

    // One divot determines the zeros and all lengths but one. So do distances, if every two
    // touches have their own.
    let elsewhere = (2..).zip(ORDER).filter(|(_, divot)| *divot != 1).map(|(rest, _)| rest);
    let exact = CalibrationFile { arm: Some(arm([252.3, 200.0, 80.0], [0.0; JOINTS])), ..guess() };
    exact.write(&place.path("exact.toml")).unwrap();
    let skipped = by.replace("--skip 1", &format!("--skip {}", joined([1].into_iter().chain(elsewhere))));
    let said = place.does(&format!("{skipped} --point --arm exact.toml --json=point.json"));
    assert!(said.contains("touches of one point") && said.contains("252.3 mm, unchanged"), "{said}");
    is_found(&place.json("point.json"), 3.0);
    let distance = |two: &[usize]| {
        let [one, other] = [two[0], two[1]].map(|divot| DVec2::from_array(DIVOTS[divot - 1]));
        one.distance(other)
    };
    let distances = joined(ORDER.chunks(2).map(distance));
    place.does(&format!("{by} --distances {distances} --json=distances.json"));
    is_found(&place.json("distances.json"), 3.0);

    // The check confirms the arm against its own fit. An encoder that has slipped since shows as
    // a changed zero.
    let said = place.does(&format!("{by} {order} --arm cal.toml --check --json=check.json"));
    assert!(said.contains("the arm agrees with its calibration") && said.contains("its fit had 0.0"), "{said}");
    assert_eq!(place.json("check.json")["changed"], false);
    let mut slipped = *file.arm.unwrap().joints();
    slipped[2].zero_counts += 250.0;
    CalibrationFile { arm: Some(Arm::new(slipped).unwrap()), ..file }.write(&place.path("slipped.toml")).unwrap();
    let run = place.run(&format!("{by} {order} --arm slipped.toml --check --json=slipped.json"));
    assert_eq!(run.code, 1, "{} {}", run.stdout, run.stderr);
    let advice = "the arm no longer agrees with its calibration; the zero of joint 3 has moved by -2";
    assert!(run.stderr.contains(advice), "{}", run.stderr);
    assert_eq!(place.json("slipped.json")["slipped"]["joint"], 3);

    // The tip's repeatability changes what counts as a deviation. Counts a turn are found on
    // request.
    place.does(&format!("{by} {order} --seat 0.4 --json=wide.json"));
    let wide = place.json("wide.json");
    assert_eq!((&wide["seat_mm"], &report["seat_mm"]), (&0.4.into(), &0.1.into()));
    let ratio = wide["spread"].as_f64().unwrap() / report["spread"].as_f64().unwrap();
    assert!((ratio - 0.25).abs() < 0.01, "{ratio}");
    let numbers = |report: &serde_json::Value, kind: &str| {
        report["found"].as_array().unwrap().iter().filter(|number| number["number"] == kind).count()
    };
    place.does(&format!("{by} {order} --counts --json=turns.json"));
    let turns = place.json("turns.json");
    assert!(turns["found"].as_array().unwrap().len() > 5 && numbers(&turns, "length") == numbers(&report, "length"));
    // A tip beside the last link is the same tip if the link is shorter and the zero turned.
    place.does(&format!("{by} {order} --tip 1.5,0 --json=tip.json"));
    let tip = place.json("tip.json");
    assert_eq!(tip["tip_mm"], serde_json::json!([1.5, 0.0]));
    let length = |report: &serde_json::Value| {
        let all = report["found"].as_array().unwrap().iter();
        let mut last = all.filter(|number| number["number"] == "length" && number["joint"] == 3);
        last.next().map(|number| number["value"].as_f64().unwrap())
    };
    assert!((length(&report).unwrap() - length(&tip).unwrap() - 1.5).abs() < 0.01, "{report} {tip}");

    // Unsuitable files and values are refused.
    let moving = "--order gives the divots of 22 touches, but the joints rested ";
    place.refuses(&format!("{by} {order} --still 1000"), &[moving]);
    for (flag, says) in [
        ("--seat 0", "must be above 0"),
        ("--still=-1", "must be above 0"),
        ("--tip 1", "2 numbers"),
        ("--tip a,b", "number"),
        ("--counts --check", "cannot be used with"),
    ] {
        let run = place.run(&format!("{by} {order} {flag}"));
        assert!(run.code == 2 && run.stderr.contains(says), "{flag}: {}", run.stderr);
    }
    place.put("cm.toml", plate(0.1));
    place.put("inches.toml", plate(1.0 / 25.4));
    let refuses = |words: &str, says: &[&str]| place.refuses(&format!("{by} {words} -o new.toml"), says);
    refuses(&order.replace("plate.toml", "cm.toml"), &["arm.mcap: ", "their numbers are in cm and must be in mm"]);
    refuses(&order.replace("plate.toml", "inches.toml"), &["their numbers are in inches and must be in mm"]);
    refuses("--plate plate.toml", &["rested 22 times, which is no whole number of rounds over 4 divots", "2 at "]);
    refuses("--plate plate.toml --order 1,2,3", &["--order gives the divots of 3 touches, but the joints rested 22"]);
    refuses("--distances 80,60", &["but each of 2 distances takes two touches"]);
    refuses("--point --skip 30", &["--skip 30: must be a rest's number, and the joints rested 23 times"]);
    place.refuses(
        &format!("calibrate arm --session {session} --rest 30 --point"),
        &["arm.mcap: the joints never rested for 30 s"],
    );
    let wrong = format!("--plate plate.toml --order {}", joined(ORDER.iter().rev()));
    refuses(&wrong, &["arm.mcap: "]);
    let few = joined((1..=20).chain([23]));
    place.refuses(
        &format!(
            "calibrate arm --session {session} --rest 0.3 --plate plate.toml --skip {few} --order 1,2 -o new.toml"
        ),
        &["2 touches are too few for 8 numbers"],
    );
    let run = place.run("calibrate arm --session arm.mcap");
    assert!(run.code == 2 && run.stderr.contains("--plate <PLATE.toml>"), "{}", run.stderr);
}

#[test]
fn tracker_session_is_refused_as_without_arm() {
    let place = Place::new();
    let bedside = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"96x80\"\n";
    let words = format!("calibrate arm --session {} --point", place.recorded(bedside, 1));
    place.check_refusal(&place.run(&words), &words, &["holds no arm; record a session with [arm]"]);
}
