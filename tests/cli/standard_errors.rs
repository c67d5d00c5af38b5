//! `--error`: standard errors of a volume's voxels.

use super::place::{Place, SMALL_BEDSIDE};
use super::sequence::{Sequence, pose};

const SWEEP: &str = "phantom -o s.mha --scene blobs --image-size 96x80 --pixel 0.25 --frames 80 --gap 0.35 --noise 3 \
                     --truth t.mha";
const FLAGS: &str = "--path general --sigma 0.3,0.3,0.3 --type f32";

#[test]
fn errors_of_sweep_hold_its_truth() {
    let place = Place::new();
    place.does(SWEEP);
    let said =
        place.does_narrowly(&format!("reconstruct s.mha -o v.mha --weights w.mha --error e.mha --json=s.json {FLAGS}"));
    assert!(said.contains("standard errors: e.mha, ") && said.contains("that of poses is not known"), "{said}");
    let numbers = &place.json("s.json")["standard_error"];
    // A Gaussian of 0.3 mm lowers the noise of 3 in pixels of 0.25 mm.
    let noise = 3.0 * 0.25 / (2.0 * std::f64::consts::PI.sqrt() * 0.3);
    assert!((numbers["noise"].as_f64().unwrap() / noise - 1.0).abs() < 0.25, "{numbers} {noise}");
    assert!(numbers["slices"].as_f64().unwrap() > 2.0 && numbers["pose_mm"].is_null(), "{numbers}");
    let [volume, weights, errors, truth] = ["v.mha", "w.mha", "e.mha", "t.mha"].map(|name| place.volume(name));
    assert_eq!((&volume.header.size, &volume.header.origin), (&errors.header.size, &errors.header.origin));
    assert_eq!(errors.field("SonoweaveUnseen"), "-1");
    assert!(errors.field("SonoweaveStandardError").starts_with("of sampling and noise: a slice "));
    let middle = weights.values.iter().copied().fold(0.0, f32::max) * 0.3;
    let (mut inside, mut held) = (0_u32, 0_u32);
    for (i, error) in errors.values.iter().enumerate() {
        assert_eq!(weights.values[i] > 0.0, *error > 0.0, "an error where and only where a voxel was seen");
        assert!(*error > 0.0 || *error == -1.0, "{error}");
        if let (true, Some(truth)) = (weights.values[i] > middle, volume.of_other(i, &truth)) {
            inside += 1;
            held += u32::from((volume.values[i] - truth).abs() <= 2.2 * error);
        }
    }
    let share = f64::from(held) / f64::from(inside);
    assert!(inside > 20_000 && (0.90..0.99).contains(&share), "{held} of {inside}");
    // The volume is the same, and without the flag no errors are kept.
    place.does_narrowly(&format!("reconstruct s.mha -o plain.mha --json=plain.json {FLAGS}"));
    assert!(place.volume("plain.mha").values == volume.values);
    let plain = place.json("plain.json");
    assert!(plain["standard_error"].is_null(), "{plain}");
    let bytes = |document: &serde_json::Value| document["bytes"].as_u64().unwrap() as f64;
    let ratio = bytes(&place.json("s.json")) / bytes(&plain);
    assert!((1.1..1.13).contains(&ratio), "{ratio}");
    // Smoothed poses have a known error, which adds to it.
    place.does(&format!("{SWEEP} --tracker-noise 0.3,0.3"));
    let said = place
        .does_narrowly(&format!("reconstruct s.mha -o n.mha --error n.e.mha --smoothing 300 --json=n.json {FLAGS}"));
    let noisy = &place.json("n.json")["standard_error"];
    assert!(noisy["pose_mm"].as_f64().unwrap() > 0.05 && said.contains("; of poses 0."), "{noisy} {said}");
}

#[test]
fn errors_beside_several_volumes_and_in_any_format() {
    let place = Place::new();
    place.does(SWEEP);
    place.put("b.mha", place.get("s.mha"));
    std::fs::create_dir(place.path("out")).unwrap();
    place.does("reconstruct s.mha b.mha -o out --error out --path general");
    place.does("reconstruct b.mha -o v.mha --error e.nrrd --fill nearest --path general");
    assert!(place.volume("out/s.error.mha").values == place.volume("out/b.error.mha").values);
    // Filled voxels have no error.
    place.does("convert e.nrrd -o e.mha");
    assert!(place.volume("e.mha").values == place.volume("out/b.error.mha").values);
}

#[test]
fn errors_that_are_not_kept_are_refused() {
    let place = Place::new();
    place.put("a.mha", Sequence::default().bytes());
    place.put("far.mha", Sequence { pose: |f| pose(20.0 * f64::from(f)), ..Sequence::default() }.bytes());
    let command = "reconstruct a.mha -o v.mha --clip none --error e.mha";
    for (flags, says) in [
        ("--compound maximum", "--error: a standard error is that of a mean"),
        ("--path planar", "--error: the planar path keeps no sums for it"),
        ("--out-of-core -o v.ome.zarr", "--error: needs the whole volume in memory"),
    ] {
        let command = if flags.contains("-o ") { command.replace("-o v.mha ", "") } else { command.to_owned() };
        place.refuses_with(&format!("{command} {flags}"), &[says]);
    }
    place.refuses_with("reconstruct a.mha -o v.mha --error a.mha", &["is the input"]);
    place.refuses(
        "reconstruct far.mha -o v.mha --clip none --error e.mha",
        &["e.mha: no voxel was reached by two slices", "--sigma"],
    );
    assert!(!place.path("v.mha").exists() && !place.path("e.mha").exists());
    // A scan of a plane takes the general path for it.
    place.does("reconstruct a.mha -o v.mha --clip none --error e.mha --json=s.json --sigma 1,1,2");
    let statistics = place.json("s.json");
    assert_eq!(statistics["path"], "general");
    assert_eq!(statistics["path_reason"], "the planar path has no way for standard errors");
}

/// The small bedside with more keys of its volume.
fn with(keys: &str) -> String {
    SMALL_BEDSIDE.replace("[volume]\n", &format!("[volume]\n{keys}\n"))
}

#[test]
fn session_has_errors_live_and_replayed() {
    let place = Place::new();
    let (plain, errors) = (SMALL_BEDSIDE.to_owned(), with("standard_error = true"));
    place.put("plain.toml", &plain);
    place.refuses(
        "live --config plain.toml --duration 1 --error e.mha",
        &["--error: the session keeps no sums for it", "volume.standard_error = true"],
    );
    place.put("errors.toml", &errors);
    let run = place.run("live --config errors.toml --duration 2 --record live --error live.mha --json=live.json");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.contains("standard errors: live.mha, "), "{}", run.stdout);
    let session = std::fs::read_dir(place.path("live")).unwrap().next().unwrap().unwrap().path();
    // The replay's threads are those of this machine.
    let run = place.run(&format!("replay {} --error again.mha", session.display()));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("the same as in the live session, bit by bit"), "{}", run.stderr);
    assert!(place.volume("live.mha").values == place.volume("again.mha").values);
    // A session without the key gets its errors in a replay, with the same volume.
    let session = place.recorded(&plain, 2);
    let run = place.run(&format!("replay {session} --error later.mha -o v.mha"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.contains("of poses 0.00 mm"), "a virtual tracker states its noise: {}", run.stdout);
    assert!(run.stderr.contains("the same as in the live session, bit by bit"), "{}", run.stderr);
    assert!(place.volume("later.mha").values.iter().any(|error| *error > 0.0));
}

#[test]
fn session_whose_slices_do_not_overlap_keeps_its_volume() {
    let place = Place::new();
    // A frame a second, and a kernel much thinner than the gaps.
    let keys = with("standard_error = true\nsigma_mm = [1.2, 1.2, 0.1]");
    place.put("thin.toml", keys.replace("[volume]\n", "rate_hz = 1\n[volume]\n"));
    let run = place.run("live --config thin.toml --duration 2 -o v.mha --error e.mha");
    assert!(run.code != 0 && run.stderr.contains("e.mha: no voxel was reached by two slices"), "{}", run.stderr);
    assert!(place.path("v.mha").exists() && !place.path("e.mha").exists());
}

#[test]
fn standard_error_of_maximum_refused_in_configuration() {
    let place = Place::new();
    for (more, says) in [
        ("compound = \"maximum\"", "compound = \"mean\" instead of \"maximum\""),
        ("path = \"planar\"", "the planar path does not support standard errors"),
    ] {
        place.put("b.toml", with(&format!("standard_error = true\n{more}")));
        place.refuses("live --config b.toml --check", &[says]);
    }
}

#[test]
fn errors_of_an_arms_replay_are_refused() {
    let place = Place::new();
    let arm = "format = \"sonoweave-bedside\"\nversion = 1\n[arm]\nkind = \"ea1\"\nport = \"virtual\"\n[grabber]\n\
               device = \"virtual\"\nsize = \"64x48\"\nrate_hz = 20\n[volume]\nspacing_mm = 1.0\n";
    let session = place.recorded(arm, 1);
    place.refuses_with(&format!("replay {session} --error e.mha"), &["--error: the session of an arm", "--config"]);
}
