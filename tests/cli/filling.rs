//! `--fill`: filled holes in files are distinguishable, and never count as data.

use serde_json::{Value, json};

use super::place::Place;
use super::sequence::{Sequence, pose};

/// Slices 2 mm apart, inserted with a thin kernel: two voxels in three between them are unseen.
fn gaps() -> Place {
    let place = Place::new();
    let sequence = Sequence {
        pixel: |_, _, f| vec![50 + 10 * f as u8],
        pose: |f| pose(2.0 * f64::from(f)),
        ..Sequence::default()
    };
    place.put("s.mha", sequence.bytes());
    place
}

const RECONSTRUCT: &str = "reconstruct s.mha --path general --clip none --spacing 0.5 --sigma 0.4,0.4,0.2";

#[test]
fn filled_voxels_have_weight_minus_one() {
    let place = gaps();
    place.does_narrowly(&format!("{RECONSTRUCT} -o v.mha --weights w.mha"));
    for law in ["nearest", "gaussian"] {
        let said = place.does_narrowly(&format!(
            "{RECONSTRUCT} -o f.mha --weights wf.mha --fill {law} --fill-radius 1 --json=s.json"
        ));
        let [v, w, f, wf] = ["v.mha", "w.mha", "f.mha", "wf.mha"].map(|name| place.volume(name));
        assert_eq!((v.header.size, w.header.size), (f.header.size, wf.header.size));
        let (mut seen, mut filled) = (0, 0);
        for i in 0..v.values.len() {
            match wf.values[i] {
                -1.0 => {
                    filled += 1;
                    assert_eq!((w.values[i], v.values[i]), (0.0, 0.0), "only holes are filled");
                    assert!((50.0..=100.0).contains(&f.values[i]), "{}", f.values[i]);
                }
                weight => {
                    seen += u64::from(weight > 0.0);
                    assert_eq!((weight, f.values[i]), (w.values[i], v.values[i]), "what is not filled is as it was");
                }
            }
        }
        assert!(seen > 1000 && filled > 1000, "{seen} seen, {filled} filled");
        assert_eq!(
            (f.field("SonoweaveFill"), f.field("SonoweaveFilled")),
            (format!("{law} within 1 mm").as_str(), filled.to_string().as_str())
        );
        let fill = &place.json("s.json")["fill"];
        assert_eq!((&fill["law"], &fill["radius_mm"], &fill["filled"]), (&json!(law), &json!(1.0), &json!(filled)));
        assert!(fill["bricks_touched"].as_u64() <= fill["bricks_considered"].as_u64(), "{fill}");
        assert!(said.contains(&format!("filled: {filled} of ")), "{said}");
        // `inspect` counts them, and a comparison with weights excludes them.
        let report: Value =
            serde_json::from_str(&place.does("inspect --json f.mha --weights wf.mha --against v.mha")).unwrap();
        let unseen = v.values.len() as u64 - seen - filled;
        assert_eq!(report["coverage"], json!({ "seen": seen, "filled": filled, "unseen": unseen }));
        assert_eq!((&report["comparison"]["voxels"], &report["comparison"]["max"]), (&json!(seen), &json!(0.0)));
        assert!(place.does("inspect f.mha --weights wf.mha").contains(&format!("; {filled} filled (")));
    }
    assert!(place.json("s.json")["fill"].is_object());
    place.does_narrowly(&format!("{RECONSTRUCT} -o v.mha --json=s.json"));
    assert_eq!(place.json("s.json")["fill"], Value::Null, "off unless asked for");
}

#[test]
fn rendering_treats_filled_voxels_as_unseen() {
    let place = gaps();
    place.does_narrowly(&format!("{RECONSTRUCT} -o v.mha --weights w.mha"));
    place.does_narrowly(&format!("{RECONSTRUCT} -o f.mha --weights wf.mha --fill nearest"));
    for view_flags in ["--mode mip", "--mode slice"] {
        place.does(&format!("render v.mha --weights w.mha -o v.png {view_flags}"));
        place.does(&format!("render f.mha --weights wf.mha -o f.png {view_flags}"));
        assert_eq!(place.get("v.png"), place.get("f.png"), "{view_flags}");
    }
    // Without weights they are indistinguishable, and the program says so.
    let run = place.run("render f.mha -o g.png --mode mip");
    let filled = place.volume("f.mha").field("SonoweaveFilled").to_owned();
    assert!(run.code == 0 && run.stderr.contains(&format!("{filled} voxels were filled")), "{}", run.stderr);
    assert!(place.get("g.png") != place.get("v.png"));
}

#[test]
fn plane_images_tint_filled_voxels() {
    let place = gaps();
    place.does_narrowly(&format!("{RECONSTRUCT} -o v.mha --planes plain.png"));
    place.does_narrowly(&format!("{RECONSTRUCT} -o f.mha --planes filled.png --fill nearest --fill-radius 1"));
    let tinted = |name: &str| {
        let picture = image::load_from_memory(&place.get(name)).unwrap().to_rgb8();
        picture.pixels().filter(|colour| colour.0[0].saturating_sub(colour.0[2]) >= 40).count()
    };
    assert_eq!(tinted("plain.png"), 0);
    assert!(tinted("filled.png") > 1000, "{}", tinted("filled.png"));
}

#[test]
fn filling_is_equal_for_all_threads_and_replay() {
    let place = gaps();
    let fill = "--fill gaussian --fill-radius 2";
    place.does_narrowly(&format!("{RECONSTRUCT} -o 1.mha --weights w1.mha {fill} --threads 1"));
    place.does_narrowly(&format!("{RECONSTRUCT} -o 3.mha --weights w3.mha {fill} --threads 3"));
    assert!(place.get("1.mha") == place.get("3.mha") && place.get("w1.mha") == place.get("w3.mha"));
    let replay = RECONSTRUCT.replace("reconstruct", "animate");
    place.does_narrowly(&format!("{replay} -o r.mha --weights wr.mha {fill} --picture p.png"));
    assert!(place.get("1.mha") == place.get("r.mha") && place.get("w1.mha") == place.get("wr.mha"));
}

#[test]
fn invalid_fill_radius_is_refused_first() {
    let place = gaps();
    place.refuses(
        &format!("{RECONSTRUCT} -o v.mha --fill nearest --fill-radius 0.4"),
        &["--fill-radius: ", "0.4 mm", "0.5 mm apart"],
    );
    place.refuses(&format!("{RECONSTRUCT} -o v.mha --fill nearest --fill-radius -1"), &["-1 mm"]);
    place.refuses(&format!("{RECONSTRUCT} -o v.mha --fill gaussian --fill-radius 17"), &["more than 32 voxels"]);
    place.refuses("animate s.mha --fill nearest --picture p.png", &["--fill: ", "none is written"]);
    assert_eq!(place.run(&format!("{RECONSTRUCT} -o v.mha --fill-radius 2")).code, 2, "a radius without a law");
    place.put("bedside.toml", place.does("live --example virtual"));
    place.refuses("live --config bedside.toml --duration 1 --fill nearest", &["--fill: ", "none is written"]);
}
