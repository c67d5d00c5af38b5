//! Sessions of an arm: the insertion path follows from its joints and the calibration, live and
//! replayed alike, for each way of compounding.

use serde_json::Value;

use super::place::Place;

/// A virtual arm whose image is perpendicular to the plane in which it moves. The rectangle lies
/// within the scanner's sector.
const ARM: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[arm]\nkind = \"ea1\"\nport = \"virtual\"\n\
    [grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\nrate_hz = 20\n[calibration]\nclip_px = [20, 18, 24, 20]\n\
    [picture]\nimage_size = \"64x64\"\ntransfer = \"phantom\"\n[virtual]\ntrajectory = \"arm\"\nframes = 40\n\
    [volume]\nspacing_mm = 1.0\n";

/// Records a session with this way of compounding, and replays it with a picture after each slice.
/// Returns the statistics of the session and of the replay.
fn session(compounding: &str) -> [Value; 2] {
    let place = Place::new();
    place.put("arm.toml", format!("{ARM}compound = \"{compounding}\"\n"));
    // The virtual arm passes its index marks within 3 s.
    let live = place.run("live --config arm.toml --duration 5 --record s --volume v.mha --stats live.json");
    assert_eq!(live.code, 0, "{}", live.stderr);
    let recorded = std::fs::read_dir(place.path("s")).unwrap().next().unwrap().unwrap().path();
    std::fs::create_dir(place.path("p")).unwrap();
    let again = place.run(&format!("replay {} -o again.mha --pictures p --stats again.json", recorded.display()));
    assert_eq!(again.code, 0, "{}", again.stderr);
    assert!(again.stderr.contains("the same as in the live session, bit by bit"), "{}", again.stderr);
    assert!(place.get("v.mha") == place.get("again.mha"), "{compounding}");
    ["live.json", "again.json"].map(|file| place.json(file))
}

/// Runs both sessions at once: they mostly wait for their devices.
fn sessions(compoundings: [&str; 2]) -> [[Value; 2]; 2] {
    std::thread::scope(|scope| {
        let begun = compoundings.map(|compounding| scope.spawn(move || session(compounding)));
        begun.map(|session| session.join().unwrap())
    })
}

#[test]
fn arm_takes_planar_path_by_itself_for_mean_and_decay() {
    let both = sessions(["mean", "decay"]);
    for statistics in both.iter().flatten() {
        assert_eq!(statistics["path"], "planar", "{statistics}");
        assert_eq!(statistics["path_reason"], "all poses are perpendicular to one plane, to 0.000 voxel");
    }
    // The first picture of a box shows all of the volume; the box grows seldom. Decay changes what
    // lies outside the slab, too.
    let [pictures, by_slab] = ["pictures", "pictures_by_slab"].map(|key| both.each_ref().map(|it| it[1][key].clone()));
    let count = |value: &Value| value.as_u64().unwrap();
    assert!(count(&pictures[0]) > 5 && 2 * count(&by_slab[0]) > count(&pictures[0]), "{pictures:?} {by_slab:?}");
    assert_eq!(count(&by_slab[1]), 0);
}

#[test]
fn arm_takes_general_path_for_maximum_and_latest() {
    let compoundings = ["maximum", "latest"];
    for (compounding, both) in compoundings.iter().zip(sessions(compoundings)) {
        for statistics in both {
            assert_eq!(statistics["path"], "general", "{statistics}");
            let why = format!("the planar path has no way for the compounding {compounding}");
            assert_eq!(statistics["path_reason"], why);
        }
    }
}
