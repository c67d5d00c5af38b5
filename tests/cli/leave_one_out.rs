//! `--sigma leave-one-out`: the kernel's width in the plane follows the noise of the images.

use super::first_moment::error;
use super::place::Place;
use super::sequence::Sequence;

/// Returns σ along u of a report.
fn width(place: &Place, report: &str) -> f64 {
    place.json(report)["sigma_mm"][0].as_f64().unwrap()
}

#[test]
fn noisy_images_get_a_wider_kernel_and_a_smaller_error() {
    let place = Place::new();
    let flags = "--path general --spacing 0.4 --type f32 --quiet";
    for (noise, name) in [(0, "clean"), (20, "noisy")] {
        place.does(&format!(
            "phantom -o s.mha --scene blobs --trajectory jittered --image-size 96x80 --pixel 0.3 --frames 50 --gap 0.5 \
             --noise {noise} --spacing 0.4 --truth t.mha"
        ));
        place.does(&format!("reconstruct s.mha -o auto.mha --sigma auto --weights w.mha --json=auto.json {flags}"));
        let run = place.run(&format!(
            "reconstruct s.mha -o v.mha --sigma leave-one-out --weights wv.mha --json={name}.json {flags}"
        ));
        assert_eq!(run.code, 0, "{}", run.stderr);
        assert!(run.stderr.contains("by leave-one-out of 23 slices"), "{}", run.stderr);
        let [auto, best, truth] = ["auto.mha", "v.mha", "t.mha"].map(|name| place.volume(name));
        let [of_auto, of_best] = ["w.mha", "wv.mha"].map(|name| place.volume(name));
        let [before, after] =
            [(&auto, of_auto), (&best, of_best)].map(|(volume, weights)| error(volume, &weights, &truth));
        if noise == 0 {
            // Images without noise keep the default, which is the narrowest.
            assert!(auto.values == best.values && width(&place, "clean.json") == width(&place, "auto.json"));
        } else {
            assert!(after < 0.7 * before, "{after} of {before}");
        }
        // Across the plane the width is that of the gaps.
        let [across, of_gaps] = [name, "auto"].map(|name| place.json(&format!("{name}.json"))["sigma_mm"][2].clone());
        assert_eq!(across, of_gaps);
    }
    assert!(width(&place, "noisy.json") > 1.4 * width(&place, "clean.json"));
    // The same width as three numbers gives the same volume, and so does one thread.
    let sigma: Vec<String> =
        place.json("noisy.json")["sigma_mm"].as_array().unwrap().iter().map(ToString::to_string).collect();
    place.does(&format!("reconstruct s.mha -o given.mha --sigma {} {flags}", sigma.join(",")));
    assert_eq!(place.run(&format!("reconstruct s.mha -o one.mha --sigma leave-one-out --threads 1 {flags}")).code, 0);
    let best = place.volume("v.mha").values;
    assert!(["given.mha", "one.mha"].iter().all(|name| place.volume(name).values == best));
}

#[test]
fn sweeps_that_do_not_tell_a_width_are_refused() {
    let place = Place::new();
    place.put("a.mha", Sequence::default().bytes());
    for (flags, says) in [
        ("--compound latest", "takes slices out of a mean; choose the compounding mean instead of latest"),
        ("--gap-weights", "weights of gaps and shadows are not taken out"),
        ("--shadow-weights", "weights of gaps and shadows are not taken out"),
        ("--method linear", "the kernel linear has no width in the plane"),
        ("", "slices are too few; give three numbers"),
    ] {
        place.refuses_with(&format!("reconstruct a.mha -o v.mha --clip none --sigma leave-one-out {flags}"), &[says]);
    }
    place.does("phantom -o s.mha --scene blobs --image-size 64x48 --frames 20");
    place.refuses_with(
        "reconstruct s.mha -o v.mha --sigma leave-one-out --max-weight 1",
        &["the largest weight was reached"],
    );
}
