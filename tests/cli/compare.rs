//! `compare`: the difference of two volumes at the voxels that both have seen.

use serde_json::{Value, json};

use super::place::Place;
use super::sequence::{Sequence, pose};

const RECONSTRUCT: &str = "reconstruct s.mha --path general --clip none --spacing 0.5";

/// Two volumes of constant grey, 3 apart, the second shifted by 2 mm, made with different
/// kernels.
fn two() -> Place {
    let place = Place::new();
    place.put("s.mha", Sequence { pixel: |_, _, _| vec![103], ..Sequence::default() }.bytes());
    place.does(&format!("{RECONSTRUCT} -o a.mha --weights wa.mha"));
    let moved = Sequence { pixel: |_, _, _| vec![100], pose: |f| pose(f64::from(f) + 2.0), ..Sequence::default() };
    place.put("s.mha", moved.bytes());
    place.does(&format!("{RECONSTRUCT} -o b.mha --weights wb.mha --sigma 0.5,0.5,0.8"));
    place
}

fn report(place: &Place, words: &str) -> Value {
    serde_json::from_str(&place.does(&format!("compare --json {words}"))).unwrap()
}

#[test]
fn volumes_on_one_lattice_are_compared_where_both_seen() {
    let place = two();
    let r = report(&place, "a.mha b.mha --weights wa.mha --other-weights wb.mha");
    assert_eq!(
        (&r["rmse"], &r["mean"], &r["max"], &r["resampled"]),
        (&json!(3.0), &json!(3.0), &json!(3.0), &json!(false))
    );
    let seen = |name: &str| place.volume(name).values.iter().filter(|w| **w > 0.0).count() as u64;
    let count = |name: &str| r["voxels"][name].as_u64().unwrap();
    assert_eq!(
        (count("both") + count("only_first"), count("both") + count("only_second")),
        (seen("wa.mha"), seen("wb.mha"))
    );
    assert!(count("only_first") > 0 && count("only_second") > 0, "{r}");
    let all: u64 = place.volume("a.mha").header.size.map(u64::from).iter().product();
    assert!(count("both") + count("only_first") + count("neither") <= all);
    let counts: u64 = r["histogram"]["counts"].as_array().unwrap().iter().map(|n| n.as_u64().unwrap()).sum();
    assert_eq!(counts + r["histogram"]["above"].as_u64().unwrap(), count("both"));
    // The kernels differ, the routes do not.
    let settings: Vec<&str> = r["settings"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert!(settings.contains(&"SonoweaveSigmaMm") && settings.contains(&"SonoweaveInput"), "{settings:?}");
    assert!(!settings.contains(&"SonoweaveRoute") && !settings.contains(&"spacing"), "{settings:?}");

    let text = place.does("compare a.mha b.mha --weights wa.mha --other-weights wb.mha");
    for line in ["  RMSE            3.000\n", "  lattice         the same, voxel by voxel\n", "SonoweaveSigmaMm: ", "█"]
    {
        assert!(text.contains(line), "{text} lacks {line:?}");
    }
    let r = report(&place, "a.mha a.mha --weights wa.mha --other-weights wa.mha");
    assert_eq!((&r["rmse"], &r["settings"], &r["max"]), (&json!(0.0), &json!([]), &json!(0.0)));
}

#[test]
fn other_lattices_are_refused_or_resampled() {
    let place = two();
    place.does(&format!("{RECONSTRUCT} -o c.mha --weights wc.mha --origin 0.2,0.1,0.3 --sigma 0.5,0.5,0.8"));
    let both = "a.mha c.mha --weights wa.mha --other-weights wc.mha";
    place
        .refuses(&format!("compare {both}"), &["a.mha and c.mha cannot be compared", "of a voxel apart", "--resample"]);
    let r = report(&place, &format!("{both} --resample"));
    assert_eq!((&r["resampled"], &r["rmse"]), (&json!(true), &json!(3.0)));
    assert!(r["voxels"]["both"].as_u64().unwrap() > 1000, "{r}");
    assert!(place.does(&format!("compare {both} --resample")).contains("interpolated at the first one's voxels"));
}

#[test]
fn limit_sets_exit_code_and_result_is_printed() {
    let place = two();
    let within = "compare a.mha b.mha --weights wa.mha --other-weights wb.mha --limit";
    assert!(place.does(&format!("{within} 3.0")).contains("RMSE"));
    let run = place.run(&format!("{within} 2.9"));
    assert_eq!(run.code, 1);
    assert!(run.stdout.contains("RMSE") && run.stderr.contains("more than --limit 2.9"), "{}", run.stderr);
    place.refuses(&format!("{within} -1"), &["--limit -1"]);
}

#[test]
fn difference_is_drawn_and_bad_input_writes_nothing() {
    let place = two();
    let both = "compare a.mha b.mha --weights wa.mha --other-weights wb.mha";
    assert!(place.does(&format!("{both} -o d.png")).contains("picture         d.png"));
    let picture = image::load_from_memory(&place.get("d.png")).unwrap().to_rgb8();
    // The first is 3 higher everywhere: orange, and blue only in the legend's scale.
    let count = |is: fn(&[u8; 3]) -> bool| picture.pixels().filter(|p| is(&p.0)).count();
    let (orange, grey) = (count(|[r, _, b]| i32::from(*r) > i32::from(*b) + 60), count(|p| *p == [72, 72, 74]));
    assert!(orange > 5000 && grey > 100, "{orange} {grey}");
    place.refuses(&format!("{both} -o d.jpg"), &["d.jpg"]);
    place.refuses(&format!("{both} -o none/d.png"), &["none"]);
    place.refuses("compare a.mha none.mha", &["none.mha"]);
    place.refuses("compare a.mha s.mha", &["s.mha", "sequence"]);
    place.refuses("compare a.mha b.mha --weights wb.mha", &["not the weights of a.mha"]);
    place.refuses("compare a.mha b.mha --max-memory 1e-6", &["GiB"]);
    let far = Sequence { pose: |f| pose(f64::from(f) + 200.0), ..Sequence::default() };
    place.put("s.mha", far.bytes());
    place.does(&format!("{RECONSTRUCT} -o far.mha"));
    place.refuses("compare a.mha far.mha", &["do not overlap"]);
}
