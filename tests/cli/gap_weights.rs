//! `--gap-weights`: slices of uneven sweeps count for the gaps beside them.

use super::first_moment::{SWEEP, error};
use super::place::{Place, SMALL_BEDSIDE};
use super::sequence::Sequence;

const FLAGS: &str = "--method gaussian4 --sigma 0.35,0.35,0.45 --spacing 0.4 --type f32";

#[test]
fn weighted_slices_are_nearer_to_truth() {
    let place = Place::new();
    place.does(SWEEP);
    place.does(&format!("reconstruct s.mha -o mean.mha --weights w.mha --path general {FLAGS}"));
    place.does(&format!("reconstruct s.mha -o v.mha --gap-weights --json=s.json {FLAGS}"));
    let report = place.json("s.json");
    assert_eq!((&report["gap_weights"], &report["path"]), (&true.into(), &"general".into()));
    let [mean, volume, weights, truth] = ["mean.mha", "v.mha", "w.mha", "t.mha"].map(|name| place.volume(name));
    assert_eq!(volume.field("SonoweaveGapWeights"), "half the distance of neighbours, in sigma");
    assert_eq!(report["frames"]["used"], 60, "the last slice is inserted, too");
    let [before, after] = [&mean, &volume].map(|volume| error(volume, &weights, &truth));
    assert!(after < 0.97 * before, "{after} of {before}");
    // In regions, a slice has the same weight.
    place.does(&format!("reconstruct s.mha -o r.ome.zarr --gap-weights --out-of-core {FLAGS}"));
    place.does("convert r.ome.zarr -o r.mha --write-weights rw.mha");
    let parts = place.volume("r.mha");
    let same = (0..volume.values.len()).filter_map(|i| Some(volume.of_other(i, &parts)? == volume.values[i]));
    let same: Vec<bool> = same.collect();
    assert!(same.len() == volume.values.len() && same.iter().all(|same| *same));
}

#[test]
fn weights_where_they_make_no_sense_are_refused() {
    let place = Place::new();
    place.put("a.mha", Sequence::default().bytes());
    for (flags, says) in [
        ("--compound latest", "--gap-weights: gap weights are those of a mean"),
        ("--path planar", "the planar path does not support gap weights"),
    ] {
        place.refuses_with(&format!("reconstruct a.mha -o v.mha --clip none --gap-weights {flags}"), &[says]);
    }
    let keys = |keys: &str| SMALL_BEDSIDE.replace("[volume]\n", &format!("[volume]\ngap_weights = true\n{keys}\n"));
    place.put("m.toml", keys("compound = \"maximum\""));
    place.refuses("live --config m.toml --duration 1", &["gap_weights", "those of a mean"]);
}

#[test]
fn weighted_session_is_the_same_replayed() {
    let place = Place::new();
    let weighted = SMALL_BEDSIDE.replace("[volume]\n", "[volume]\ngap_weights = true\n");
    let session = place.recorded(&weighted, 2);
    let run = place.run(&format!("replay {session} -o v.mha --json=v.json"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("the same as in the live session, bit by bit"), "{}", run.stderr);
    assert_eq!(place.json("v.json")["frames"]["waiting"], 0);
    // Without the key it is another volume of the same frames.
    place.put("plain.toml", SMALL_BEDSIDE);
    let run = place.run(&format!("replay {session} --config plain.toml -o plain.mha --json=plain.json"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    let used = |name: &str| place.json(name)["frames"]["used"].clone();
    assert_eq!(used("v.json"), used("plain.json"));
    assert!(place.volume("v.mha").values != place.volume("plain.mha").values);
}
