//! `reconstruct --smoothing`: smoothed poses of a recorded sweep.

use super::place::{Place, SMALL_BEDSIDE};

const SWEEP: &str = "phantom -o s.mha --image-size 96x80 --pixel 0.35 --frames 120 --gap 0.35 --noise 0 --truth t.mha";

/// Returns the error of a volume, grey levels.
fn rmse(place: &Place, volume: &str) -> f64 {
    let report = place.does(&format!("inspect {volume} --json --against t.mha --weights w.mha"));
    let comparison = &serde_json::from_str::<serde_json::Value>(&report).unwrap()["comparison"];
    assert!(comparison["voxels"].as_u64().unwrap() > 20_000, "{comparison}");
    comparison["rmse"].as_f64().unwrap()
}

#[test]
fn smoothed_sweep_of_noisy_tracker_is_more_accurate() {
    let place = Place::new();
    place.does(&format!("{SWEEP} --tracker-noise 0.4,0.4"));
    let flags = "--path general --sigma 0.4,0.4,0.5 --weights w.mha";
    place.does(&format!("reconstruct s.mha -o before.mha {flags}"));
    let before = rmse(&place, "before.mha");
    let said = place.does(&format!("reconstruct s.mha -o after.mha {flags} --smoothing 300 --json=after.json"));
    assert!(said.starts_with("poses of ") && said.contains(" frames were smoothed: their corners moved by "), "{said}");
    let after = rmse(&place, "after.mha");
    assert!(after < 0.75 * before, "{before} {after}");
    let smoothing = &place.json("after.json")["smoothing"];
    assert!(smoothing["smoothed"].as_u64().unwrap() > 100 && smoothing["half_width_ms"] == 300.0, "{smoothing}");
    // The sensor's noise is found from its poses.
    let sensor = &smoothing["sensors"][0];
    assert!((sensor["position_mm"].as_f64().unwrap() / 0.4 - 1.0).abs() < 0.25, "{sensor}");
    let about = place.does("inspect after.mha --json");
    assert!(
        about.contains("SonoweaveSmoothing") && about.contains("300 ms before and 300 ms after a frame"),
        "{about}"
    );
    // Any number of threads gives the same volume, and 0 the one without smoothing.
    for (name, more, expected) in
        [("one.mha", "--smoothing 300 --threads 1", "after.mha"), ("off.mha", "--smoothing 0", "before.mha")]
    {
        place.does(&format!("reconstruct s.mha -o {name} {flags} {more}"));
        assert!(place.volume(name).values == place.volume(expected).values, "{name}");
    }
}

#[test]
fn exact_poses_are_left_as_accurate_as_they_are() {
    let place = Place::new();
    place.does(SWEEP);
    let flags = "--path general --sigma 0.4,0.4,0.5 --weights w.mha";
    place.does(&format!("reconstruct s.mha -o before.mha {flags}"));
    let before = rmse(&place, "before.mha");
    place.does(&format!("reconstruct s.mha -o after.mha {flags} --smoothing 300"));
    let after = rmse(&place, "after.mha");
    assert!(after < 1.01 * before, "{before} {after}");
}

#[test]
fn useless_smoothing_times_are_refused() {
    let place = Place::new();
    place.does(SWEEP);
    for time in ["20", "-5", "2000", "x"] {
        let run = place.run(&format!("reconstruct s.mha -o v.mha --smoothing={time}"));
        assert!(run.code == 2 && run.stderr.contains("'--smoothing <MS>'"), "{time}: {} {}", run.code, run.stderr);
        assert!(!place.names().contains("v.mha"));
    }
}

/// Smoothed poses, the kernel of fourth order, gap weights, shadow weights and standard errors in
/// one session.
#[test]
fn session_with_all_methods_is_the_same_replayed_by_any_threads() {
    let place = Place::new();
    let volume = "[volume]\nmethod = \"gaussian4\"\ngap_weights = true\nshadow_weights = true\nstandard_error = true\n";
    let bedside = SMALL_BEDSIDE.replace("[volume]\n", volume) + "tracker_noise_mm = 0.3\ntracker_noise_deg = 0.3\n";
    let bedside = bedside + "[pairing]\nsmoothing_ms = 300\n";
    let session = place.recorded(&bedside, 4);
    let replay = |name: &str, flags: &str| {
        let files = format!("-o {name}.mha --weights {name}-w.mha --error {name}-e.mha --json={name}.json");
        let run = place.run(&format!("replay {session} {files} {flags}"));
        assert_eq!(run.code, 0, "{}", run.stderr);
        run.stderr
    };
    let said = replay("v", "");
    assert!(said.contains("the same as in the live session, bit by bit"), "{said}");
    assert!(place.json("v.json")["frames"]["used"].as_u64().unwrap() > 20, "{said}");
    for threads in [1, 3] {
        place.put("threads.toml", bedside.replace("[volume]\n", &format!("[volume]\nthreads = {threads}\n")));
        replay("t", "--config threads.toml");
        for part in ["", "-w", "-e"] {
            let [all, other] = ["v", "t"].map(|name| place.volume(&format!("{name}{part}.mha")).values);
            assert!(all == other, "{threads} threads: {part}");
        }
    }
}
