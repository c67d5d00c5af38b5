//! `--shadow-weights`: pixels in the shadow of bone count little.

use super::place::{Place, SMALL_BEDSIDE};
use super::sequence::{Sequence, pose};

/// Frames nearly at one place, bright but for a shadow from the tenth row on, in every other one.
fn shadowed() -> Sequence {
    let pixel = |u: u32, v: u32, frame: u32| {
        let in_shadow = frame % 2 == 1 && (12..28).contains(&u) && v >= 10;
        vec![if in_shadow { 2 } else { 100 + (u * 7 + v * 5) as u8 % 40 }]
    };
    Sequence { pixel, pose: |frame| pose(0.1 * f64::from(frame)), ..Sequence::default() }
}

#[test]
fn shadowed_pixels_hardly_change_the_mean() {
    let place = Place::new();
    place.put("a.mha", shadowed().bytes());
    place.does("reconstruct a.mha -o mean.mha --clip none --path general --type f32");
    place.does("reconstruct a.mha -o v.mha --clip none --shadow-weights --type f32 --json=s.json");
    let report = place.json("s.json");
    let shadows = &report["shadow_weights"];
    assert_eq!(
        (&shadows["tail_mm"], &shadows["dark_slices"], &report["path"]),
        (&50.0.into(), &0.into(), &"general".into())
    );
    let [mean, volume] = ["mean.mha", "v.mha"].map(|name| place.volume(name));
    assert_eq!(volume.field("SonoweaveShadowWeights"), "tails of 50 mm over 3 of 128 beams, level 0.5, width 0.08");
    // Unseen voxels have 0.
    let dark = |values: &[f32]| values.iter().filter(|value| (1.0..90.0).contains(*value)).count();
    let [before, after] = [&mean, &volume].map(|volume| dark(&volume.values));
    assert!(before > 100 && after * 20 < before, "{after} of {before} voxels are dark");
}

#[test]
fn weights_of_pixels_where_they_make_no_sense_are_refused() {
    let place = Place::new();
    place.put("a.mha", shadowed().bytes());
    for (flags, says) in [
        ("--compound latest", "--shadow-weights: shadow weights are those of a mean"),
        ("--path planar", "the planar path does not support shadow weights"),
        ("--first-moment", "--first-moment: shadow weights change within the image"),
    ] {
        place.refuses_with(&format!("reconstruct a.mha -o v.mha --clip none --shadow-weights {flags}"), &[says]);
    }
    let keys = SMALL_BEDSIDE.replace("[volume]\n", "[volume]\nshadow_weights = true\ncompound = \"maximum\"\n");
    place.put("m.toml", keys);
    place.refuses("live --config m.toml --duration 1", &["shadow_weights", "those of a mean"]);
}

#[test]
fn session_with_shadow_weights_is_the_same_replayed() {
    let place = Place::new();
    let weighted = SMALL_BEDSIDE.replace("[volume]\n", "[volume]\nshadow_weights = true\n");
    let session = place.recorded(&weighted, 2);
    let run = place.run(&format!("replay {session} -o v.mha"));
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stderr.contains("the same as in the live session, bit by bit"), "{}", run.stderr);
    let volume = place.volume("v.mha");
    assert!(volume.field("SonoweaveShadowWeights").starts_with("tails of 50 mm"));
}
