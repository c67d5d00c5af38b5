//! Figures as delivered: real text without overlaps, reproducible bytes, and every number in the
//! CSV.

use sonoweave_figures::{Axis, Figure, Ink, Panel, Series, SeriesStyle, drawing, files, lettering};

fn figure() -> Figure {
    let line = (0..50).map(|i| [f64::from(i), (f64::from(i) * 0.2).sin()]).collect();
    let powers = (1..9).map(|i| [10_f64.powi(-i), 10_f64.powi(i - 4)]).collect();
    Figure {
        id: "sample",
        title: "A sample & its <limits>".into(),
        caption: "Words that say what is to be seen, long enough that they need more than one line of the picture to be said at all, as captions do.".into(),
        columns: 2,
        height: 180.0,
        panels: vec![
            Panel::new(
                "Lines",
                Axis::linear("position σ_n, mm"),
                Axis::linear("value"),
                vec![Series::new("a sine, sampled", SeriesStyle::Line, Ink::Blue, line), Series::new("middle", SeriesStyle::Dashed, Ink::Black, vec![[0.0, 0.0], [49.0, 0.0]])],
            ),
            Panel::new("Powers", Axis::log("part"), Axis::log("ms a slice"), vec![Series::new("points", SeriesStyle::Discs, Ink::Vermilion, powers)]),
            Panel::new(
                "Bars",
                Axis::categories("method", ["nearest voxel with holes filled", "trilinear", "Gaussian"]),
                Axis::linear("error").from_to(0.0, 4.0),
                vec![Series::bars("rms", Ink::Green, &[1.0, 2.0, 3.0]), Series::bars("largest", Ink::Purple, &[2.0, 3.0, 9.0])],
            ),
        ],
    }
}

/// Upright texts: left, right, baseline, size and words.
fn texts(svg: &str) -> Vec<([f64; 4], String)> {
    let number = |line: &str, name: &str| -> f64 {
        let from = line.split_once(&format!("{name}=\"")).expect("every text has its place and size").1;
        from.split('"').next().and_then(|digits| digits.parse().ok()).expect("a number in quotes")
    };
    svg.lines()
        .filter(|line| line.starts_with("<text") && !line.contains("rotate"))
        .map(|line| {
            let words = line.split_once('>').expect("an element ends").1.trim_end_matches("</text>").to_owned();
            let (x, size) = (number(line, " x"), number(line, "font-size"));
            let width = lettering::width(&words, size);
            let left = match line {
                l if l.contains("\"middle\"") => x - 0.5 * width,
                l if l.contains("\"end\"") => x - width,
                _ => x,
            };
            ([left, left + width, number(line, " y"), size], words)
        })
        .filter(|(_, words)| !words.contains("tspan"))
        .collect()
}

#[test]
fn texts_are_within_the_figure_and_do_not_overlap() {
    let svg = drawing::svg(&figure());
    let texts = texts(&svg);
    for words in ["A sample &amp; its &lt;limits&gt;", "ms a slice", "a sine, sampled", "10⁻⁷", "trilinear"] {
        assert!(svg.contains(words), "{words}");
    }
    assert!(texts.len() > 30, "{}", texts.len());
    for (i, ([left, right, base, size], words)) in texts.iter().enumerate() {
        assert!(*left >= 0.0 && *right <= drawing::WIDTH, "{words}");
        for ([l, r, b, s], other) in &texts[i + 1..] {
            let apart = right <= l || r <= left || base - 0.75 * size >= *b || b - 0.75 * s >= *base;
            assert!(apart, "{words:?} lies on {other:?}");
        }
    }
}

#[test]
fn bars_are_clipped_to_panel_and_invalid_points_skipped() {
    let mut figure = figure();
    figure.panels[1].series[0].points.extend([[0.0, 1.0], [1.0, -1.0], [f64::NAN, 1.0]]);
    let svg = drawing::svg(&figure);
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
    assert_eq!(svg.matches("<circle").count(), 8 + 1, "the legend has one");
    assert_eq!(svg.matches("clip-path=").count(), 3);
}

#[test]
fn output_is_reproducible_and_png_has_double_resolution() {
    let (a, b) = (drawing::svg(&figure()), drawing::svg(&figure()));
    assert_eq!(a, b);
    let png = files::png(&a).unwrap();
    assert_eq!(png, files::png(&b).unwrap());
    let side = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap());
    assert_eq!(side(16), 1600);
    // Without a font the letters would be missing: an image with them is larger than one
    // without.
    let bare: String = a.lines().filter(|l| !l.starts_with("<text")).collect();
    assert!(png.len() > files::png(&bare).unwrap().len() + 10_000);
}

#[test]
fn csv_has_every_number_with_all_digits() {
    let csv = files::csv(&figure());
    assert_eq!(csv.lines().next(), Some("panel,series,x,y"));
    assert_eq!(csv.lines().count(), 1 + 50 + 2 + 8 + 3 + 3);
    assert!(csv.contains(&format!("Lines,\"a sine, sampled\",7,{}", (7.0 * 0.2_f64).sin())));
    assert!(csv.contains("Bars,largest,Gaussian,9"));
}

#[test]
fn unlisted_series_is_drawn_and_named_in_csv() {
    let mut figure = figure();
    let hidden = Series::new("hidden", SeriesStyle::Crosses, Ink::Purple, vec![[1.0, 0.5]]).unlisted();
    let before = drawing::svg(&figure);
    figure.panels[0].series.push(hidden);
    let after = drawing::svg(&figure);
    let lines = |svg: &str| svg.matches(Ink::Purple.hex()).count();
    assert!(lines(&after) == lines(&before) + 2 && !after.contains("hidden"));
    assert!(files::csv(&figure).contains("Lines,hidden,1,0.5"));
}

#[test]
fn three_files_and_page_are_written() {
    let folder = std::env::temp_dir().join(format!("sonoweave-figures-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    files::write(&figure(), &folder).unwrap();
    for ending in ["svg", "png", "csv"] {
        assert!(std::fs::metadata(folder.join(format!("sample.{ending}"))).unwrap().len() > 100);
    }
    std::fs::remove_dir_all(&folder).unwrap();
    let page = files::page("Figures", "<p>Said before.</p>", &[figure()]);
    assert!(page.contains("src=\"sample.svg\"") && page.contains("A sample &amp; its &lt;limits&gt;"));
}
