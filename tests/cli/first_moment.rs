//! `--first-moment`: values of uneven sweeps are nearer to the truth, and the files say it.

use super::place::{Place, SMALL_BEDSIDE, Volume};
use super::sequence::Sequence;

pub(crate) const SWEEP: &str = "phantom -o s.mha --scene blobs --trajectory jittered --image-size 128x110 --pixel 0.25 \
                     --frames 60 --gap 0.5 --noise 0 --spacing 0.4 --truth t.mha";
const FLAGS: &str = "--path general --method gaussian4 --sigma 0.35,0.35,0.45 --spacing 0.4 --type f32";

/// Returns the root mean square of a volume's errors where slices are many.
pub(crate) fn error(volume: &Volume, weights: &Volume, truth: &Volume) -> f64 {
    let middle = weights.values.iter().copied().fold(0.0, f32::max) * 0.4;
    let inside = (0..volume.values.len()).filter(|i| weights.values[*i] > middle);
    let squares = inside.filter_map(|i| Some(f64::from(volume.values[i] - volume.of_other(i, truth)?).powi(2)));
    let squares: Vec<f64> = squares.collect();
    assert!(squares.len() > 20_000, "{}", squares.len());
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn corrected_values_are_nearer_to_truth() {
    let place = Place::new();
    place.does(SWEEP);
    place.does(&format!("reconstruct s.mha -o mean.mha --weights w.mha {FLAGS}"));
    let said = place.does(&format!("reconstruct s.mha -o v.mha --weights w1.mha --first-moment --json=s.json {FLAGS}"));
    assert!(said.contains("first moment: slices lie 0."), "{said}");
    let numbers = &place.json("s.json")["first_moment"];
    let number = |name: &str| numbers[name].as_f64().unwrap();
    assert!((0.001..0.1).contains(&number("distance_mm")), "{numbers}");
    assert!(number("change") > 0.0 && number("change_p95") > number("change"), "{numbers}");
    let [mean, corrected, weights, truth] = ["mean.mha", "v.mha", "w.mha", "t.mha"].map(|name| place.volume(name));
    assert!(corrected.field("SonoweaveFirstMoment").starts_with("corrected: 0.0"));
    assert!(place.volume("w1.mha").values == weights.values, "weights stay");
    let [before, after] = [&mean, &corrected].map(|volume| error(volume, &weights, &truth));
    assert!(after < 0.96 * before, "{after} of {before}");
    // Unseen voxels stay unseen; filled ones are filled from corrected ones.
    place.does(&format!("reconstruct s.mha -o f.mha --first-moment --fill nearest {FLAGS}"));
    let filled = place.volume("f.mha");
    let seen = (0..weights.values.len()).filter(|i| weights.values[*i] > 0.0);
    assert!(seen.clone().count() > 20_000 && seen.clone().all(|i| filled.values[i] == corrected.values[i]));
}

#[test]
fn correction_that_is_impossible_is_refused() {
    let place = Place::new();
    place.put("a.mha", Sequence::default().bytes());
    for (flags, says) in [
        ("-o v.mha --compound maximum", "--first-moment: is that of a mean"),
        ("-o v.mha --method nearest", "--first-moment: the kernel nearest weighs all distances alike"),
        ("-o v.ome.zarr --out-of-core", "--first-moment: needs the whole volume in memory"),
    ] {
        place.refuses_with(&format!("reconstruct a.mha --clip none --first-moment {flags}"), &[says]);
    }
    place.refuses("animate a.mha --first-moment --picture p.png", &["--first-moment: ", "none are written"]);
    assert!(!place.path("v.mha").exists() && !place.path("v.ome.zarr").exists());
}

#[test]
fn session_is_corrected_live_and_replayed() {
    let place = Place::new();
    place.put("b.toml", SMALL_BEDSIDE);
    place.refuses("live --config b.toml --duration 1 --first-moment", &["--first-moment: ", "none are written"]);
    let run = place.run("live --config b.toml --duration 2 --record live -o live.mha --first-moment");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(run.stdout.contains("first moment: slices lie "), "{}", run.stdout);
    let session = std::fs::read_dir(place.path("live")).unwrap().next().unwrap().unwrap().path();
    let again = |flags: &str| {
        let run = place.run(&format!("replay {} {flags}", session.display()));
        assert_eq!(run.code, 0, "{}", run.stderr);
        assert!(run.stderr.contains("the same as in the live session, bit by bit"), "{}", run.stderr);
    };
    again("-o again.mha --first-moment");
    again("-o mean.mha");
    assert!(place.volume("live.mha").values == place.volume("again.mha").values);
    assert!(place.volume("live.mha").values != place.volume("mean.mha").values);
}
