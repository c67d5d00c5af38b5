//! Sources of a reconstruction's settings, and the effect of each flag.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use super::place::Place;

/// Returns statistics of a reconstruction of a small sweep (pixels of 0.5 mm, so that the
/// in-plane σ defaults to 0.375 mm).
fn statistics(place: &Place, flags: &str) -> Value {
    place.does(&format!("reconstruct s.mha -o v.mha --json=s.json {flags}"));
    place.json("s.json")
}

fn sweep(flags: &str) -> Place {
    let place = Place::new();
    place.does(&format!("phantom -o s.mha --image-size 40x36 --pixel 0.5 --frames 9 --gap 0.5 {flags}"));
    place
}

fn numbers(value: &Value) -> [f64; 3] {
    std::array::from_fn(|axis| value[axis].as_f64().unwrap())
}

fn close(value: &Value, expected: [f64; 3]) {
    for (found, expected) in numbers(value).into_iter().zip(expected) {
        assert!((found / expected - 1.0).abs() < 1e-4, "{value} against {expected}");
    }
}

/// A configuration with a resolution and a spacing; the sweep contains its own route to the
/// world.
const CONFIG: &str = "format = \"sonoweave-calibration\"\nversion = 1\n[resolution]\nhwhm_mm = [0.4, 0.4, 2.0]\n\
                      [volume]\nspacing_mm = [0.8, 0.8, 0.8]\n[image]\nclip_px = { x = 4, y = 5, width = 20, height = 10 }\n";

#[test]
fn defaults_follow_spacing_pixel_and_resolution() {
    let place = sweep("");
    let s = statistics(&place, "--clip none");
    close(&s["sigma_mm"], [0.375, 0.375, 1.0]);
    close(&s["support_mm"], [0.375 * 3.290_527, 0.375 * 3.290_527, 2.575_829]);
    assert_eq!((&s["method"], &s["grid"]["spacing"]), (&json!("gaussian-truncated"), &json!([0.5, 0.5, 0.5])));
    assert!(s["decimation_deviation"].as_f64().unwrap() <= 0.002, "{s}");

    place.put("c.toml", CONFIG);
    let s = statistics(&place, "--config c.toml");
    // Off the plane σ is the resolution's, h/√(ln 4); in the plane it follows the voxels.
    close(&s["sigma_mm"], [0.6, 0.6, 2.0 * 0.849_321_8]);
    assert_eq!(s["grid"]["spacing"], json!([0.8, 0.8, 0.8]));
    assert_eq!(s["data_rectangle"], json!([4, 5, 20, 10]));
    // The command line takes precedence.
    let s = statistics(&place, "--config c.toml --spacing 0.5 --clip 0,0,8,8 --sigma 0.5,0.6,0.7");
    close(&s["sigma_mm"], [0.5, 0.6, 0.7]);
    assert_eq!((&s["grid"]["spacing"], &s["data_pixels"]), (&json!([0.5, 0.5, 0.5]), &json!(64)));
}

#[test]
fn kernel_flags_take_effect() {
    let place = sweep("");
    let plain = "--clip none --sigma 1,1,1";
    let cases = [
        ("--resolution 1,2,3", [0.849_321_8, 1.698_643_6, 2.547_965_4], None),
        ("--sigma 1,1,1 --leakage 0.001", [1.0; 3], Some(3.290_527)),
        ("--sigma 1,1,1 --support energy=0.1", [1.0; 3], Some(1.644_854)),
        ("--sigma 1,1,1 --support amplitude=0.01", [1.0; 3], Some(2.715_2)),
        ("--sigma 1,1,1 --support gradient=0.01", [1.0; 3], Some(3.104_5)),
        ("--sigma 1,1,1 --support peak=0.135335283", [1.0; 3], Some(2.0)),
    ];
    for (flags, sigma, support) in cases {
        let s = statistics(&place, &format!("--clip none {flags}"));
        close(&s["sigma_mm"], sigma);
        if let Some(support) = support {
            close(&s["support_mm"], [support; 3]);
        }
    }
    let cut = statistics(&place, plain);
    let lowered = statistics(&place, &format!("{plain} --method gaussian"));
    assert_eq!(lowered["method"], "gaussian");
    // In the plane both have the same support.
    close(&lowered["sigma_effective_mm"], [0.978_389, 0.978_389, 0.905_65]);
    close(&cut["sigma_effective_mm"], [0.978_389, 0.978_389, 0.961_642]);
    let ends = statistics(&place, "--clip none --sigma 1,1,1 --support energy=0.01,peak=0.135335283");
    close(&ends["support_mm"], [2.575_829, 2.575_829, 2.0]);
    // Half the 90th-percentile gap of a parallel sweep is half its gap.
    let place = sweep("--trajectory parallel");
    close(&statistics(&place, "--clip none --sigma auto --path general")["sigma_mm"], [0.375, 0.375, 0.25]);
    place.refuses("reconstruct s.mha -o w.mha --sigma 5,5,5 --support gradient=0.01", &["gradient of 0.01"]);
}

#[test]
fn methods_and_compounding_affect_volume_and_header() {
    let place = sweep("--scene ramp --noise 0 --type f32");
    // In the plane the interpolating methods have the pixels' own widths, independent of the
    // settings.
    let cases = [
        ("bspline3", [0.8, 0.9, 1.0], [2.0 * 3.0_f64.sqrt(); 3].map(|z| z * 0.8)),
        ("linear", [0.5 / 6.0_f64.sqrt(), 0.5 / 6.0_f64.sqrt(), 1.0], [0.5, 0.5, 2.575_829]),
        ("nearest", [0.5 / 12.0_f64.sqrt(), 0.5 / 12.0_f64.sqrt(), 1.0], [0.25, 0.25, 3.0_f64.sqrt()]),
    ];
    for (method, sigma, support) in cases {
        let said = place
            .run(&format!("reconstruct s.mha -o v.mha --json=s.json --clip none --sigma 0.8,0.9,1 --method {method}"));
        assert_eq!(said.code, 0, "{}", said.stderr);
        let s = place.json("s.json");
        close(&s["sigma_mm"], sigma);
        assert!((numbers(&s["support_mm"])[0] / support[0] - 1.0).abs() < 1e-6, "{s}");
        assert_eq!((&s["method"], &s["compounding"]), (&json!(method), &json!("mean")));
        let notes = s["notes"].to_string();
        assert_eq!(notes.contains("only the last of the three widths"), method != "bspline3", "{notes}");
        assert_eq!(place.volume("v.mha").field("SonoweaveMethod"), method);
    }
    for compound in ["maximum", "latest"] {
        let s = statistics(&place, &format!("--clip none --compound {compound}"));
        assert_eq!(s["compounding"], compound);
        assert!((numbers(&s["support_mm"])[2] - 1.177_41).abs() < 1e-5, "the kernel's half width at half maximum: {s}");
        assert_eq!(place.volume("v.mha").field("SonoweaveCompounding"), compound);
    }
    // For a planar scan these use the general path.
    place.does("phantom -o p.mha --image-size 40x36 --pixel 0.5 --frames 9 --gap 0.5 --trajectory parallel");
    for (flags, what) in [("--method nearest", "the kernel nearest"), ("--compound maximum", "the compounding maximum")]
    {
        place.does(&format!("reconstruct p.mha -o v.mha --json=s.json --clip none {flags}"));
        assert_eq!(place.json("s.json")["path"], "general");
        let says = [format!("the planar path does not support {what}: choose the general path")];
        place.refuses(&format!("reconstruct p.mha -o w.mha --path planar --clip none {flags}"), &[&says[0]]);
    }
    let says = &["--support, --leakage: the kernel bspline3 has a fixed support", "choose the method gaussian"];
    place.refuses("reconstruct s.mha -o w.mha --method bspline3 --leakage 0.01", says);
}

#[test]
fn decay_flags_take_effect() {
    let place = sweep("");
    let mean = statistics(&place, "--clip none");
    assert_eq!(mean["decay"], Value::Null);
    let plain = place.get("v.mha");
    let s = statistics(&place, "--clip none --compound decay");
    assert_eq!(s["decay"]["mode"], "dead-time");
    assert_eq!((&s["decay"]["rate_per_s"], &s["decay"]["wait_s"]), (&json!(1.0), &json!(2.0)));
    // 2 bytes of age per voxel, and times that ran forwards.
    assert!(s["bytes"].as_u64().unwrap() > mean["bytes"].as_u64().unwrap() * 6 / 5);
    assert_eq!((&s["times_backwards"], &s["times_absurd"]), (&json!(0), &json!(0)));
    let modes = [("exp --decay-rate 9", "exp"), ("paper-literal --decay-rate 9 --decay-wait 0.1", "paper-literal")];
    for (flags, mode) in modes {
        let s = statistics(&place, &format!("--clip none --compound decay --decay {flags}"));
        assert_eq!((&s["decay"]["mode"], &s["decay"]["rate_per_s"]), (&json!(mode), &json!(9.0)));
        let says = format!("decay {mode} 9.0 1/s after {} s", s["decay"]["wait_s"]);
        assert_eq!(place.volume("v.mha").field("SonoweaveCompounding"), says);
    }
    statistics(&place, "--clip none --compound decay --decay none");
    assert_eq!(place.volume("v.mha").field("SonoweaveCompounding"), "mean");
    assert!(place.get("v.mha") == plain, "no decay is the mean");
    for (flags, says) in [
        ("--decay exp", "--decay: needs the compounding decay; choose it"),
        ("--compound mean --decay-rate 2", "--decay-rate: needs the compounding decay"),
        ("--compound decay --decay exp --decay-wait 2", "--decay-wait: has no effect with this decay"),
        ("--compound decay --decay-rate 0", "the decay's rate must lie between 1e-6 and 1e6 per second, not at 0"),
        ("--compound decay --decay-wait -1", "the decay's wait must lie between 0 and 1e6 seconds, not at -1"),
    ] {
        place.refuses(&format!("reconstruct s.mha -o w.mha --clip none {flags}"), &[says]);
    }
}

#[test]
fn region_and_weight_flags_take_effect() {
    let place = sweep("");
    let s = statistics(&place, "--clip none --fan 20,-10,15,40,-20,20");
    let pixels = (0..36).flat_map(|v| (0..40).map(move |u| (f64::from(u) - 20.0, f64::from(v) + 10.0)));
    let inside = pixels.filter(|(x, y)| (15.0..=40.0).contains(&x.hypot(*y)) && x.atan2(*y).to_degrees().abs() <= 20.0);
    assert_eq!(s["data_pixels"], inside.count());
    assert_eq!(statistics(&place, "--clip none")["w_clamped"], 0);
    let clamped = statistics(&place, "--clip none --max-weight 1")["w_clamped"].as_u64().unwrap();
    assert!(clamped > 1000, "slices 0.5 mm apart overlap: {clamped}");
    place.refuses(
        "reconstruct s.mha -o w.mha --clip none --max-weight 2e6",
        &["between 1 and 1e6 slices", "not at 2000000"],
    );
    place.refuses(
        "reconstruct s.mha -o w.mha --clip none --max-memory 0.0001",
        &["more bricks", "raise the memory limit", "--max-memory"],
    );
    let names = place.names();
    assert_eq!(names, BTreeSet::from(["s.json", "s.mha", "v.mha"].map(str::to_owned)));
}

#[test]
fn volume_can_use_any_reachable_frame() {
    let place = sweep("--calibration c.toml");
    for (flags, world) in [("", "Reference"), ("--world Tracker", "Tracker"), ("--world Probe", "Probe")] {
        let s = statistics(&place, &format!("--config c.toml --clip none --path general {flags}"));
        assert_eq!(s["world"], world);
        assert!(place.volume("v.mha").field("SonoweaveFrame").starts_with(world), "{flags}");
    }
}
