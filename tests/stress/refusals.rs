//! Tests of unusable frames: counted, named, and without any effect.

use glam::{DAffine3, DMat3, DVec3};
use serde_json::json;

use reconstruct::{Reconstructor, Refused};
use sonoweave_core::slice::Slice;

use crate::figures::{Sheet, Test};
use crate::insertion::{Probe, half_mm, noise, posed, state};
use crate::place::Place;
use crate::sequence::{Sequence, grey};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "21",
            "NaN, infinity, det = −1, scaled rotation, invalid pose in a sequence: each counted, the volume that of the others",
            in_a_sequence,
        ),
        Test::new(
            "21",
            "slices without a plane, of another size, too far, repeated: refused, every bit and counter as before",
            slices,
        ),
    ]
}

/// A pixel's bytes in a float sequence.
fn float(u: u32, v: u32, frame: u32) -> Vec<u8> {
    f32::from(grey(u, v, frame)).to_le_bytes().to_vec()
}

fn tracker_pose(frame: u32) -> String {
    format!("1 0 0 0.3 0 1 0 -0.2 0 0 1 {frame} 0 0 0 1")
}

fn in_a_sequence(sheet: &mut Sheet) {
    let good = Sequence {
        size: [24, 20],
        element: "MET_FLOAT",
        transform: "ProbeToTracker",
        pose: tracker_pose,
        pixel: float,
        ..Sequence::default()
    };
    // Frames 0 to 5 are good; the bad ones follow.
    let bad = Sequence {
        frames: 13,
        pixel: |u, v, frame| match (frame, u, v) {
            (6, 11, 7) => f32::NAN.to_le_bytes().to_vec(),
            (7, 0, 0) => f32::INFINITY.to_le_bytes().to_vec(),
            (8, 23, 19) => f32::NEG_INFINITY.to_le_bytes().to_vec(),
            _ => float(u, v, frame % 6),
        },
        pose: |frame| match frame {
            9 => "1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1".into(),
            10 => "1 0 0 0 0 1 0 0 0 0 -1 3 0 0 0 1".into(),
            11 => "1.2 0 0 0 0 1.2 0 0 0 0 1.2 3 0 0 0 1".into(),
            frame => tracker_pose(frame),
        },
        status: |frame| if frame == 12 { "INVALID" } else { "OK" },
        ..good.clone()
    };
    let place = Place::new();
    let run = |name: &str, sequence: &Sequence| {
        place.put("s.mha", sequence.bytes());
        let matrix = "0.5 0 0 0 0 0.5 0 0 0 0 1 0 0 0 0 1";
        let mut command = crate::program();
        command.args(["reconstruct", "s.mha", "--clip", "none", "--type", "f32", "--image-to-probe", matrix]);
        command.args(["-o", &format!("{name}.mha"), "--weights", &format!("{name}-w.mha"), "--json=s.json"]);
        let run = place.output(&mut command);
        assert_eq!(run.code, 0, "{}", run.stderr);
        let [values, weights] = [format!("{name}.mha"), format!("{name}-w.mha")].map(|n| place.volume(&n).values);
        let bits = |v: Vec<f32>| v.into_iter().map(f32::to_bits).collect::<Vec<_>>();
        (bits(values), bits(weights), place.json("s.json")["frames"].clone())
    };
    let (values, weights, _) = run("good", &good);
    let (with_values, with_weights, frames) = run("bad", &bad);
    let refused = json!({
        "pixel_not_finite": 3, "pose_not_finite": 1, "pose_mirrored": 1, "pose_not_rigid": 1, "pose_invalid": 1,
    });
    sheet.equal("frames", (&frames["total"], &frames["used"], &frames["waiting"]), (&json!(13), &json!(6), &json!(0)));
    sheet.equal("refused, by reason", &frames["refused"], &refused);
    sheet.holds("values: the bits of the good frames alone", values == with_values && !values.is_empty());
    sheet.holds("weights: the bits of the good frames alone", weights == with_weights);
}

fn slices(sheet: &mut Sheet) {
    let probe = Probe::oblique([40, 30], 0.3);
    let mut r = Reconstructor::new(half_mm(), probe.mask()).unwrap();
    let [first, good] = [0.0, 0.4].map(|along| probe.put(&noise(probe.size, 1), along));
    r.insert(&first).unwrap();
    let (before, work) = (state(r.volume()), r.work());
    let pose = probe.pose(0.4);
    let columns = |u: DVec3, v: DVec3| DAffine3 { matrix3: DMat3::from_cols(u, v, pose.matrix3.z_axis), ..pose };
    let [u, v] = [pose.matrix3.x_axis, pose.matrix3.y_axis];
    let at = |translation: DVec3| DAffine3 { translation, ..pose };
    type Expected = fn(&Refused) -> bool;
    let degenerate: Expected = |e| matches!(e, Refused::Degenerate);
    let far: Expected = |e| matches!(e, Refused::OutOfRange);
    let settings: Expected = |e| matches!(e, Refused::Settings(_));
    let large: Expected = |e| matches!(e, Refused::Memory { .. } | Refused::OutOfRange | Refused::Settings(_));
    let with = |pose: DAffine3| posed(&good.image, pose);
    let cases: Vec<(&str, Slice, Expected)> = vec![
        ("position NaN", with(at(DVec3::NAN)), degenerate),
        ("position infinite", with(at(DVec3::new(0.0, f64::INFINITY, 0.0))), degenerate),
        ("direction NaN", with(columns(DVec3::NAN, v)), degenerate),
        ("u of no length", with(columns(DVec3::ZERO, v)), degenerate),
        ("u along v", with(columns(v * 2.0, v)), degenerate),
        ("u along v but for 10⁻¹⁰", with(columns(v * 2.0 + u * 1e-10, v)), degenerate),
        ("beyond the lattice", with(at(DVec3::splat(1e12))), far),
        ("beyond what f64 squares", with(at(DVec3::splat(1e200))), far),
        ("pixels of a micrometre", with(columns(u * 3e-6, v)), settings),
        ("pixels of 300 m", with(columns(u * 1e6, v)), large),
        ("another size", Probe::oblique([30, 40], 0.3).put(&noise([30, 40], 1), 0.0), |e| {
            matches!(e, Refused::Size { .. })
        }),
        ("the same again", first.clone(), |e| matches!(e, Refused::Repeated)),
    ];
    for (name, slice, expected) in cases {
        let result = r.insert(&slice);
        let answer = match &result {
            Ok(touched) => format!("{} voxels changed", touched.voxels),
            Err(error) => error.to_string(),
        };
        sheet.record(&format!("{name}: answer"), answer);
        sheet.holds(&format!("{name}: refused for its reason"), result.is_err_and(|e| expected(&e)));
        sheet.equal(&format!("{name}: state"), state(r.volume()), before);
        sheet.holds(&format!("{name}: work counters"), r.work() == work);
    }
    sheet.holds("a good slice still enters", r.insert(&good).is_ok());
    sheet.holds("and changes the state", state(r.volume()) != before);
}
