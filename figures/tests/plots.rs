//! Plots' axes, letters and pictures, and the end of a run with a failed check. They are no unit
//! tests, so that they use the same build of the library as the programs.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use skrifa::{FontRef, MetadataProvider};

use sonoweave_figures::lettering::{width, wrap};
use sonoweave_figures::scale::Scale;
use sonoweave_figures::{Findings, Raster, order};

fn written(scale: Scale, range: [f64; 2]) -> Vec<String> {
    scale.ticks(range, 6.0).into_iter().filter_map(|t| t.text).collect()
}

#[test]
fn linear_ticks_are_round_with_proper_minus() {
    assert_eq!(written(Scale::Linear, [-0.5, 0.5]), ["−0.4", "−0.2", "0.0", "0.2", "0.4"]);
    assert_eq!(written(Scale::Linear, [0.0, 50.0]), ["0", "10", "20", "30", "40", "50"]);
    for width in [0.013, 0.7, 1.0, 3.3, 99.0, 12_345.0] {
        let count = Scale::Linear.ticks([0.0, width], 5.0).len();
        assert!((3..=9).contains(&count), "{count} ticks over {width}");
    }
}

#[test]
fn log_ticks_label_decades_and_also_two_and_five_if_few() {
    assert_eq!(written(Scale::Log, [0.1, 10.0]), ["0.1", "0.2", "0.5", "1", "2", "5", "10"]);
    assert_eq!(written(Scale::Log, [0.3, 0.62]), ["0.3", "0.4", "0.5", "0.6"]);
    assert_eq!(written(Scale::Log, [1e-6, 1e-3]), ["10⁻⁶", "10⁻⁵", "10⁻⁴", "0.001"]);
    assert!(written(Scale::Log, [1e-16, 1.0]).len() <= 8);
    assert_eq!(Scale::Log.place(1.0, [0.01, 100.0]), 0.5);
}

#[test]
fn orders_of_magnitude_have_one_digit() {
    let labels = [5.3e-15, 9.7e-8, 0.0, 0.0042, 1e-9].map(order);
    assert_eq!(labels, ["5·10⁻¹⁵", "10⁻⁷", "0", "0.004", "10⁻⁹"]);
}

#[test]
fn ranges_contain_all_placeable_values() {
    let [low, high] = Scale::Linear.range([0.13, f64::NAN, 7.9].into_iter());
    assert!(low <= 0.13 && high >= 7.9 && high - low < 12.0);
    assert_eq!(Scale::Log.range([0.02, 0.0, -3.0, 30.0].into_iter()), [0.01, 100.0]);
    for scale in [Scale::Linear, Scale::Log] {
        for values in [vec![], vec![5.0], vec![f64::NAN]] {
            let [low, high] = scale.range(values.clone().into_iter());
            assert!(low < high && scale.places(low), "{scale:?} {values:?}");
        }
    }
}

#[test]
fn one_failed_check_fails_the_run() {
    let mut findings = Findings::default();
    findings.check(true, "two and two are four");
    findings.counted();
    assert!(findings.report());
    findings.check(false, "two and two are five");
    assert!(!findings.report());
}

#[test]
fn image_with_wrong_byte_count_is_none() {
    assert!(Raster::grey([2, 2], &[0; 3]).is_none() && Raster::rgb([1, 1], vec![0; 4]).is_none());
    assert!(Raster::grey([0, 2], &[]).is_none() && Raster::grey([2, 1], &[0, 255]).is_some());
}

#[test]
fn font_has_all_used_characters_and_their_widths() {
    let font = FontRef::new(dejavu::sans::regular()).unwrap();
    for c in "aZ09 −×·±≤≥≈√σπ∞µ⁻⁰¹²³⁴⁵⁶⁷⁸⁹–→ΣφΔ°′".chars() {
        assert!(font.charmap().map(c).is_some(), "{c}");
    }
    assert!(width("iiii", 12.0) < 0.5 * width("MMMM", 12.0));
    assert!(width("σ_eff", 12.0) < width("σeff", 12.0) && width("σ_eff", 12.0) > width("σe", 12.0));
    assert!((width("ab", 20.0) - 2.0 * width("ab", 10.0)).abs() < 1e-9);
}

#[test]
fn wrapped_lines_fit_and_keep_all_words() {
    let text = "Samples are taken at irregular distances, as by a hand, and each counts by its distance.";
    let lines = wrap(text, 12.0, 150.0);
    assert!(lines.len() > 2 && lines.iter().all(|line| width(line, 12.0) <= 150.0));
    assert_eq!(lines.join(" "), text);
}
