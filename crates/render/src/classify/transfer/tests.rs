use std::path::Path;

use super::*;

fn grey() -> Colour {
    Colour::grey([0.0, 255.0]).unwrap()
}

fn with(opacity: Opacity, unit_mm: f64) -> Transfer {
    Transfer::new(opacity, unit_mm, grey()).unwrap()
}

fn curve(points: &[(f64, f64)]) -> Curve {
    Curve::new(points).unwrap()
}

#[test]
fn curve_is_exact_at_points_and_constant_beyond() {
    let curve = curve(&[(10.0, 0.3), (20.0, 0.9), (40.0, 0.1)]);
    for (x, expected) in [(-1e30, 0.3), (10.0, 0.3), (20.0, 0.9), (40.0, 0.1), (1e30, 0.1), (f64::NAN, 0.3)] {
        assert_eq!(curve.value(x), expected, "at {x}");
    }
    assert!((curve.value(12.5_f64) - 0.45).abs() < 1e-15);
    assert!((curve.value(35.0_f64) - 0.3).abs() < 1e-15);
    assert_eq!(curve.support(), Some([f64::NEG_INFINITY, f64::INFINITY]));
    assert_eq!(curve.span(), [10.0, 40.0]);
}

#[test]
fn invalid_curve_points_are_refused_by_index() {
    for (points, index, words) in [
        (&[][..], None, "at least one"),
        (&[(0.0, 0.0), (f64::NAN, 0.5)], Some(1), "must be a finite number"),
        (&[(f64::INFINITY, 0.5)], Some(0), "must be a finite number"),
        (&[(5.0, 0.0), (9.0, 0.5), (7.0, 1.0)], Some(2), "sort the points"),
        (&[(5.0, 0.0), (5.0, 1.0)], Some(1), "a small distance"),
        // The same number in f32.
        (&[(100.0, 0.0), (100.000_001, 1.0)], Some(1), "a small distance"),
        (&[(1.0, 0.0), (2.0, 1.01)], Some(1), "from 0 to 1"),
        (&[(1.0, -0.1)], Some(0), "from 0 to 1"),
        (&[(1.0, f64::NAN)], Some(0), "from 0 to 1"),
    ] {
        let error = Curve::new(points).unwrap_err();
        assert_eq!(error.index(), index, "{points:?}");
        assert!(error.to_string().contains(words), "{points:?}: {error}");
    }
}

#[test]
fn isovalue_opacity_follows_levoy() {
    let transfer = with(Opacity::Isovalue { value: 100.0, thickness_mm: 2.0, opacity: 0.8 }, 1.0);
    // Two mm from the surface at 10 grey levels per mm are 20 grey levels.
    for (value, gradient, expected) in [
        (100.0, 10.0, 0.8),
        (110.0, 10.0, 0.4),
        (85.0, 10.0, 0.2),
        (120.0, 10.0, 0.0),
        (200.0, 10.0, 0.0),
        (110.0, 20.0, 0.6),
        (100.0, 0.0, 0.8),
        (100.1, 0.0, 0.0),
        (100.0, 0.5 * FLAT_PER_MM, 0.8),
        (f64::NAN, 10.0, 0.0),
        (110.0, f64::NAN, 0.0),
    ] {
        let alpha: f64 = transfer.alpha(value, gradient);
        assert!((alpha - expected).abs() < 1e-14, "{value} at {gradient} per mm: {alpha}");
    }
    assert!(transfer.uses_gradient());
}

#[test]
fn isosurface_thickness_is_independent_of_slope() {
    let transfer = with(Opacity::Isovalue { value: 100.0, thickness_mm: 1.5, opacity: 1.0 }, 1.0);
    for slope in [2.0, 30.0, 500.0] {
        for mm in [-1.0, -0.25, 0.0, 0.6, 1.4, 1.6] {
            let alpha: f64 = transfer.alpha(100.0 + slope * mm, slope);
            assert!((alpha - (1.0 - mm.abs() / 1.5).max(0.0)).abs() < 1e-13, "{slope} per mm, {mm} mm away: {alpha}");
        }
    }
}

#[test]
fn region_opacity_follows_levoy_in_mm() {
    let transfer = with(Opacity::Region(curve(&[(50.0, 0.2), (150.0, 0.6)])), 2.0);
    // 2 mm · 10 per mm over a span of 100.
    assert!((transfer.alpha(100.0_f64, 10.0) - 0.2 * 0.4).abs() < 1e-15);
    assert!((transfer.alpha(150.0_f64, 25.0) - 0.5 * 0.6).abs() < 1e-15);
    // A rise across the span over one unit length has the curve's own opacities.
    assert!((transfer.alpha(100.0_f64, 50.0) - 0.4).abs() < 1e-15);
    assert_eq!(transfer.alpha(150.0, 1e6), 1.0);
    assert_eq!(transfer.alpha(100.0, 0.0), 0.0);
    assert_eq!(transfer.alpha(100.0, f64::NAN), 0.0);

    // The same border sampled at two pitches has the same gradient per mm, so the same opacity.
    let border = |mm: f64| 100.0 + 30.0 * mm;
    let alpha = |pitch: f64| {
        let slope = crate::classify::gradient::gradient(
            (border(0.0), 1.0),
            [(border(-pitch), 1.0), (border(pitch), 1.0)],
            pitch,
        );
        transfer.alpha(border(0.0), slope)
    };
    assert!((alpha(0.25) - alpha(1.0)).abs() < 1e-15 && alpha(1.0) > 0.1);
}

#[test]
fn gradient_factor_multiplies_opacity() {
    let opacity = Opacity::Curve(curve(&[(0.0, 0.0), (100.0, 0.5)]));
    let plain = with(opacity.clone(), 1.0);
    let weighted = with(opacity, 1.0).with_gradient(curve(&[(0.0, 0.2), (10.0, 1.0)])).unwrap();
    assert!(!plain.uses_gradient() && weighted.uses_gradient());
    for (gradient, factor) in [(0.0, 0.2), (5.0, 0.6), (10.0, 1.0), (99.0, 1.0)] {
        assert!((weighted.alpha(80.0, gradient) - factor * plain.alpha(80.0_f64, gradient)).abs() < 1e-15);
    }
}

#[test]
fn transfer_out_of_range_is_refused() {
    let made = |opacity, unit| Transfer::new(opacity, unit, grey()).unwrap_err().to_string();
    let flat = || Opacity::Curve(curve(&[(0.0, 0.5)]));
    let surface = |value, thickness_mm, opacity| Opacity::Isovalue { value, thickness_mm, opacity };
    for unit in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(made(flat(), unit).contains("positive number of mm"));
    }
    assert!(made(surface(f64::NAN, 1.0, 0.5), 1.0).contains("isovalue must be a finite number"));
    assert!(made(surface(9.0, 0.0, 0.5), 1.0).contains("thickness must be a positive"));
    assert!(made(surface(9.0, 1.0, 1.1), 1.0).contains("opacity must lie between 0 and 1, not 1.1"));
    assert!(made(Opacity::Region(curve(&[(0.0, 0.5)])), 1.0).contains("at least two points"));
    let below = with(flat(), 1.0).with_gradient(curve(&[(-1.0, 0.5)])).unwrap_err().to_string();
    assert!(below.contains("begin at 0 or above, not at -1"), "{below}");
    for window in [[5.0, 5.0], [9.0, 1.0], [f64::NAN, 1.0], [0.0, f64::INFINITY]] {
        assert_eq!(Colour::grey(window).unwrap_err().to_string(), Colour::perceptual(window).unwrap_err().to_string());
    }
}

#[test]
fn step_correction_of_slab_is_independent_of_steps() {
    let transfer = with(Opacity::Curve(curve(&[(0.0, 0.5)])), 1.5);
    for alpha in [1e-8, 1e-3, 0.02, 0.3, 0.9, 0.999] {
        // Transmittance of 12 mm: eight unit lengths.
        let whole = -(8.0 * libm::log1p(-alpha));
        for steps in [3_u32, 8, 17, 100] {
            let step = 12.0 / f64::from(steps);
            let corrected: f64 = transfer.step_corrected(alpha, step);
            let slab = -(f64::from(steps) * libm::log1p(-corrected));
            // In a dense slab the corrected opacity is near 1, so its transmittance is rounded.
            let bound = 1e-13 + 1e-15 / (1.0 - corrected);
            assert!((slab / whole - 1.0).abs() < bound, "{alpha} in {steps} steps");
            let power = (1.0 - corrected).powi(i32::try_from(steps).unwrap());
            assert!(
                (power - (1.0 - alpha).powi(8)).abs() < 1e-14 * f64::from(steps),
                "{alpha} in {steps} steps: {power}"
            );
        }
    }
}

#[test]
fn step_correction_keeps_unit_ends_and_small_opacity() {
    let transfer = with(Opacity::Curve(curve(&[(0.0, 0.5)])), 0.7);
    for alpha in [0.0, 1e-30, 0.123_456_78, 0.999_999, 1.0] {
        assert_eq!(transfer.step_corrected(alpha, 0.7), alpha);
        assert_eq!(transfer.step_corrected(alpha as f32, 0.7), alpha as f32);
    }
    for step in [1e-3, 0.35, 5.0] {
        assert_eq!(transfer.step_corrected(1.0, step), 1.0);
        assert_eq!(transfer.step_corrected(0.0, step), 0.0);
    }
    // 1 − (1 − α)^k = kα + k(1 − k)α²/2 + …; the third term is below 1e-24.
    let (alpha, k) = (1e-8, 0.25);
    let series = k * alpha + 0.5 * k * (1.0 - k) * alpha * alpha;
    let double: f64 = transfer.step_corrected(alpha, 0.175);
    assert!((double / series - 1.0).abs() < 1e-15, "{double}");
    let single = transfer.step_corrected(alpha as f32, 0.175);
    assert!((f64::from(single) / series - 1.0).abs() < 5e-7, "{single}");
}

#[test]
fn step_correction_single_precision_stays_within_5e_7() {
    let transfer = with(Opacity::Curve(curve(&[(0.0, 0.5)])), 1.0);
    let mut worst = 0.0_f64;
    for exponent in 0..400_u16 {
        // From 1e-8 to 0.99.
        let alpha = (libm::pow(10.0, -8.0 + f64::from(exponent) * 0.02) * 0.99) as f32;
        for step in [0.1_f32, 0.25, 0.5, 0.8, 2.0] {
            let reference = transfer.step_corrected(f64::from(alpha), f64::from(step));
            worst = worst.max((f64::from(transfer.step_corrected(alpha, step)) / reference - 1.0).abs());
        }
    }
    assert!(worst < 5e-7, "{worst}");
}

#[test]
fn opacity_and_colour_single_precision_match_double() {
    let mut transfers: Vec<_> =
        Transfer::PRESETS.iter().map(|(name, _)| Transfer::preset(name, [0.0, 255.0]).unwrap()).collect();
    transfers.push(with(Opacity::Region(curve(&[(30.0, 0.1), (90.0, 0.5), (200.0, 1.0)])), 1.0));
    let map = Colour::perceptual([20.0, 230.0]).unwrap();
    transfers.push(Transfer::new(Opacity::Curve(curve(&[(0.0, 0.0), (255.0, 1.0)])), 1.0, map).unwrap());
    for transfer in &transfers {
        let mut worst = 0.0_f64;
        for step in 0..1024_u16 {
            let value = f32::from(step) * 0.25 + 0.013;
            for gradient in [1.0_f32, 7.3, 31.7, 120.1] {
                let reference = transfer.alpha(f64::from(value), f64::from(gradient));
                worst = worst.max((f64::from(transfer.alpha(value, gradient)) - reference).abs());
            }
            for (single, double) in transfer.colour(value).into_iter().zip(transfer.colour(f64::from(value))) {
                worst = worst.max((f64::from(single) - double).abs());
            }
        }
        // Intensities are rounded to 255 · 6e-8; the steepest opacity here is one in an
        // isosurface of 0.7 grey levels.
        assert!(worst < 5e-5, "{transfer:?}: {worst}");
    }
}

#[test]
fn visible_interval_matches_opacity() {
    let tent = || curve(&[(40.0, 0.0), (60.0, 0.0), (80.0, 0.4), (90.0, 0.0), (99.0, 0.0)]);
    let seen = with(Opacity::Curve(tent()), 1.0);
    assert_eq!(seen.visible(), Some([60.0, 90.0]));
    assert_eq!(with(Opacity::Region(tent()), 1.0).visible(), Some([60.0, 90.0]));
    assert_eq!(with(Opacity::Region(tent()), 1.0).visible_below(0.0), None);
    let rising = with(Opacity::Curve(curve(&[(50.0, 0.0), (70.0, 1.0)])), 1.0);
    assert_eq!(rising.visible(), Some([50.0, f64::INFINITY]));
    assert_eq!(with(Opacity::Curve(curve(&[(50.0, 0.0)])), 1.0).visible(), None);
    assert_eq!(seen.clone().with_gradient(curve(&[(0.0, 0.0)])).unwrap().visible(), None);
    let steep = seen.with_gradient(curve(&[(5.0, 0.0), (9.0, 1.0)])).unwrap();
    assert_eq!(steep.visible(), Some([60.0, 90.0]));
    assert_eq!(steep.visible_below(5.0), None);

    let surface = with(Opacity::Isovalue { value: 100.0, thickness_mm: 2.0, opacity: 0.5 }, 1.0);
    assert_eq!(surface.visible(), Some([f64::NEG_INFINITY, f64::INFINITY]));
    let [low, high] = surface.visible_below(7.0).unwrap();
    assert!((low - 86.0).abs() < 2e-4 && (high - 114.0).abs() < 2e-4 && low < 86.0 && high > 114.0);
    let gentle = surface.with_gradient(curve(&[(3.0, 1.0), (7.0, 0.0)])).unwrap();
    assert_eq!(gentle.visible(), Some([low, high]));
    let clear = with(Opacity::Isovalue { value: 100.0, thickness_mm: 2.0, opacity: 0.0 }, 1.0);
    assert_eq!(clear.visible(), None);
}

#[test]
fn visible_interval_holds_in_single_precision() {
    // Points that f32 rounds up and down.
    for low in [0.1, 0.3, 77.7, 100.1] {
        let transfer = with(Opacity::Curve(curve(&[(low, 0.0), (low + 1.0, 1.0)])), 1.0);
        let mut x = (low as f32).next_up().next_up();
        for _ in 0..5 {
            let alpha: f32 = transfer.alpha(x, 1.0);
            assert!(alpha == 0.0 || f64::from(x) > low, "{x} below {low}: {alpha}");
            x = x.next_down();
        }
    }
    let surface = with(Opacity::Isovalue { value: 100.1, thickness_mm: 0.7, opacity: 1.0 }, 1.0);
    for i in 1..2000_u16 {
        let gradient = f32::from(i) * 0.1;
        let [low, high] = surface.visible_below(f64::from(gradient)).unwrap();
        assert_eq!(surface.alpha((low as f32).next_down(), gradient), 0.0, "{gradient}");
        assert_eq!(surface.alpha((high as f32).next_up(), gradient), 0.0, "{gradient}");
    }
}

/// Converts sRGB to OKLab: the inverse of the map's construction.
fn oklab(colour: [f64; 3]) -> [f64; 3] {
    let [r, g, b] = colour.map(|x| if x <= 0.040_45 { x / 12.92 } else { libm::pow((x + 0.055) / 1.055, 2.4) });
    let l = libm::cbrt(0.412_221_470_8 * r + 0.536_332_536_3 * g + 0.051_445_992_9 * b);
    let m = libm::cbrt(0.211_903_498_2 * r + 0.680_699_545_1 * g + 0.107_396_956_6 * b);
    let s = libm::cbrt(0.088_302_461_9 * r + 0.281_718_837_6 * g + 0.629_978_700_5 * b);
    [
        0.210_454_255_3 * l + 0.793_617_785_0 * m - 0.004_072_046_8 * s,
        1.977_998_495_1 * l - 2.428_592_205_0 * m + 0.450_593_709_9 * s,
        0.025_904_037_1 * l + 0.782_771_766_2 * m - 0.808_675_766_0 * s,
    ]
}

#[test]
fn perceptual_map_has_even_lightness_steps() {
    let map = Colour::perceptual([0.0, 1.0]).unwrap();
    let colours: Vec<_> = (0..=256_u16).map(|i| oklab(map.at(f64::from(i) / 256.0))).collect();
    let steps: Vec<_> = colours
        .windows(2)
        .map(|pair| {
            assert!(pair[1][0] > pair[0][0], "lightness falls: {pair:?}");
            (0..3).map(|c| (pair[1][c] - pair[0][c]).powi(2)).sum::<f64>().sqrt()
        })
        .collect();
    let mean = steps.iter().sum::<f64>() / 256.0;
    let (least, most) = steps.iter().fold((f64::MAX, 0.0_f64), |(a, b), &s| (a.min(s), b.max(s)));
    assert!(least > 0.98 * mean && most < 1.02 * mean, "{least} {mean} {most}");
    assert!((colours[0][0] - 0.15).abs() < 1e-6 && (colours[256][0] - 0.97).abs() < 1e-6);
}

#[test]
fn colour_greyness_is_detected() {
    let map =
        Transfer::new(Opacity::Curve(curve(&[(0.0, 0.5)])), 1.0, Colour::perceptual([0.0, 9.0]).unwrap()).unwrap();
    let plain = with(Opacity::Curve(curve(&[(0.0, 0.5)])), 1.0);
    let listed = Colour::list(&[(10.0, [0.0, 0.5, 1.0]), (20.0, [1.0, 0.5, 0.0])]).unwrap();
    let sepia = Colour::list(&[(10.0, [0.2; 3]), (20.0, [0.6; 3])]).unwrap();
    assert!(plain.is_grey() && sepia.is_grey() && !map.is_grey() && !listed.is_grey());
    assert_eq!(plain.colour(51.0), [plain.intensity(51.0_f64); 3]);
    assert!((plain.intensity(51.0_f64) - 0.2).abs() < 1e-15);
    assert!((sepia.intensity(15.0_f64) - 0.4).abs() < 1e-15);
    let [r, g, b] = listed.at(12.5_f64);
    assert!((r - 0.25).abs() < 1e-15 && (g - 0.5).abs() < 1e-15 && (b - 0.75).abs() < 1e-15);
    assert!((listed.intensity(10.0_f64) - (0.5 * 0.7152 + 0.0722)).abs() < 1e-15);
}

#[test]
fn presets_scale_to_any_range() {
    for (name, purpose) in Transfer::PRESETS {
        assert!(!purpose.is_empty());
        let eight = Transfer::preset(name, [0.0, 255.0]).unwrap();
        let shifted = Transfer::preset(name, [-1.0, 3.0]).unwrap();
        let mut most = 0.0_f64;
        for step in 0..=100_u16 {
            let share = f64::from(step) / 100.0;
            for slope in [0.0, 0.01, 0.05, 0.3, 2.0] {
                let alpha = eight.alpha(255.0 * share, 255.0 * slope);
                assert!((0.0..=1.0).contains(&alpha), "{name} at {share}, {slope} per mm: {alpha}");
                assert!((shifted.alpha(4.0 * share - 1.0, 4.0 * slope) - alpha).abs() < 1e-9, "{name} at {share}");
                most = most.max(alpha);
            }
        }
        assert!(most > 0.0, "{name} shows nothing");
        assert_eq!(eight.intensity(255.0), 1.0);
    }
    // Black is clear in presets that hide anything; the phantom of blobs has a background of 60.
    for name in ["tissue", "bone", "surface", "phantom"] {
        let preset = Transfer::preset(name, [0.0, 255.0]).unwrap();
        assert_eq!(preset.alpha(0.0, 0.0), 0.0, "{name}");
        assert_eq!(preset.alpha(0.0, 50.0), 0.0, "{name}");
    }
    let tissue = Transfer::preset(Transfer::PRESETS[0].0, [0.0, 255.0]).unwrap();
    assert!(tissue.alpha(220.0, 40.0) > 10.0 * tissue.alpha(75.0_f64, 2.0) && tissue.alpha(60.0, 50.0) == 0.0);
    assert_eq!(Transfer::preset("phantom", [0.0, 255.0]).unwrap().alpha(60.0, 5.0), 0.0);
    let xray = Transfer::preset("xray", [0.0, 255.0]).unwrap();
    assert!(!xray.uses_gradient() && xray.alpha(0.0_f64, 0.0) == xray.alpha(255.0, 9.0));
}

#[test]
fn unknown_preset_lists_known_ones() {
    let error = Transfer::preset("tisue", [0.0, 255.0]).unwrap_err().to_string();
    assert_eq!(error, "no transfer function is called \"tisue\"; give one of tissue, bone, surface, xray and phantom");
    for range in [[1.0, 1.0], [2.0, 1.0], [f64::NAN, 1.0], [0.0, f64::INFINITY]] {
        let error = Transfer::preset("tissue", range).unwrap_err();
        assert!(matches!(error, TransferError::Range(_)), "{error}");
    }
}

fn parse(text: &str) -> Result<Transfer, String> {
    Transfer::parse(Path::new("look.toml"), text).map_err(|e| e.to_string())
}

fn file(body: &str) -> Result<Transfer, String> {
    parse(&format!("format = \"sonoweave-transfer\"\nversion = 1\n{body}"))
}

#[test]
fn documented_example_parses() {
    let example: String = include_str!("file.rs")
        .lines()
        .skip_while(|line| *line != "//! ```toml")
        .skip(1)
        .take_while(|line| *line != "//! ```")
        .map(|line| line.trim_start_matches("//!").trim_start().to_owned() + "\n")
        .collect();
    let expected = Transfer::new(
        Opacity::Curve(curve(&[(40.0, 0.0), (120.0, 0.2), (255.0, 0.8)])),
        1.0,
        Colour::perceptual([0.0, 255.0]).unwrap(),
    )
    .and_then(|transfer| transfer.with_gradient(curve(&[(0.0, 0.1), (25.0, 1.0)])))
    .unwrap();
    assert_eq!(parse(&example).unwrap(), expected);

    // The alternatives that the example comments out.
    let mut alternatives = 0;
    for line in example.lines().filter(|line| line.starts_with("# ") && line.contains(" = ")) {
        let line = &line[2..];
        let table = if ["grey", "list"].iter().any(|kind| line.starts_with(kind)) {
            format!("[opacity]\ncurve = [[0, 0.5]]\n[colour]\n{line}")
        } else {
            format!("[opacity]\n{line}")
        };
        assert!(file(&table).is_ok(), "{line}: {:?}", file(&table));
        alternatives += 1;
    }
    assert_eq!(alternatives, 4);
}

#[test]
fn short_file_uses_defaults_and_allows_bom() {
    let text = "\u{feff}format = \"sonoweave-transfer\"\nversion = 1\n[opacity]\ncurve = [[0, 0], [255, 1]]\n";
    assert_eq!(parse(text).unwrap(), with(Opacity::Curve(curve(&[(0.0, 0.0), (255.0, 1.0)])), 1.0));
}

#[test]
fn invalid_file_entries_are_reported_by_line() {
    let opacity = "[opacity]\ncurve = [[0, 0], [255, 1]]\n";
    for (body, words) in [
        ("[opacity]\ncurv = [[0, 0]]", "look.toml: opacity.curv (line 4): unknown key; did you mean curve?"),
        ("colur = 3\n[opacity]\ncurve = [[0, 0]]", "colur (line 3): unknown key; did you mean colour?"),
        ("", "opacity (line 1): is missing"),
        ("[opacity]", "opacity (line 3): is empty; give one of curve, region, isovalue"),
        (
            "[opacity]\ncurve = [[0, 0]]\nregion = [[0, 0], [1, 1]]",
            "opacity.region (line 5): curve is given already; keep curve or region",
        ),
        ("[opacity]\ncurve = []", "opacity.curve (line 4): holds no points: give at least one"),
        ("[opacity]\ncurve = [\n  [0, 0],\n  [9, nan],\n]", "opacity.curve[1][1] (line 6): is not a finite number"),
        ("[opacity]\ncurve = [\n  [0, 0],\n  [inf, 1],\n]", "opacity.curve[1][0] (line 6): is not a finite number"),
        (
            "[opacity]\ncurve = [\n  [9, 0],\n  [3, 1],\n]",
            "opacity.curve[1] (line 6): stands at 3, after a point at 9: sort",
        ),
        ("[opacity]\ncurve = [[9, 0],\n  [10, 1.5]]", "opacity.curve[1] (line 5): holds 1.5: give values from 0 to 1"),
        ("[opacity]\ncurve = [[9, 0, 1]]", "opacity.curve[0] (line 4): must hold 2 numbers, not 3"),
        (
            "[opacity]\ncurve = 3",
            "opacity.curve (line 4): must be a list of points [intensity, opacity], not a whole number",
        ),
        ("[opacity]\nregion = [[9, 0]]", "opacity (line 3): borders between regions must have at least two points"),
        ("[opacity]\nisovalue = { value = 9, opacity = 0.5 }", "opacity.isovalue.thickness_mm (line 4): is missing"),
        (
            "[opacity]\nisovalue = { value = 9, thickness_mm = 1, opacity = 2 }",
            "opacity (line 3): the surface's opacity must lie between 0 and 1, not 2",
        ),
        (
            &format!("unit_mm = 0\n{opacity}"),
            "unit_mm (line 3): the length that opacities are meant for must be a positive",
        ),
        (&format!("gradient = [[-4, 1]]\n{opacity}"), "gradient (line 3): a gradient's magnitude is never below 0"),
        (&format!("{opacity}[colour]\ngrey = [9, 3]"), "colour.grey (line 6): the window must rise"),
        (&format!("{opacity}[colour]\nlist = [[0, 1, 1, 2]]"), "colour.list[0] (line 6): holds 2: give values"),
        ("[opacity", "look.toml: line 3: "),
    ] {
        let error = file(body).unwrap_err();
        assert!(error.contains(words) && error.starts_with("look.toml: "), "{body:?}: {error}");
    }
    let format = parse("format = \"sonoweave-calibration\"\nversion = 1").unwrap_err();
    assert!(format.contains("format (line 1): must be \"sonoweave-transfer\""), "{format}");
    let version = parse("format = \"sonoweave-transfer\"\nversion = 2").unwrap_err();
    assert!(version.contains("version (line 2): this program reads version 1, not 2"), "{version}");
}

#[test]
fn missing_file_is_reported_by_path() {
    let error = Transfer::read(Path::new("/nowhere/look.toml")).unwrap_err().to_string();
    assert!(error.starts_with("/nowhere/look.toml: reading failed"), "{error}");
}
