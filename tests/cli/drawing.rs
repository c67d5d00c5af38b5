//! `calibrate drawing`: a phantom of two plates on paper, at 1:1.

use std::path::Path;

use roxmltree::Document;

use super::place::Place;

/// Returns a file of the shipped phantom.
fn shipped(name: &str) -> String {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/phantom").join(name);
    std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn drawn(place: &Place) -> String {
    let said = place.does("calibrate drawing --phantom phantom.toml -o drawing.svg");
    assert_eq!(
        said,
        "drawing.svg: 9 wires between 9 holes in the front plate and 9 in the back one; print it at 100 %\n"
    );
    String::from_utf8(place.get("drawing.svg")).unwrap()
}

/// Returns middles and diameters of circles, mm.
fn circles(svg: &str) -> Vec<[f64; 3]> {
    let document = Document::parse(svg).unwrap();
    let number = |node: &roxmltree::Node<'_, '_>, key: &str| node.attribute(key).unwrap().parse::<f64>().unwrap();
    let circle = |node: roxmltree::Node<'_, '_>| [number(&node, "cx"), number(&node, "cy"), 2.0 * number(&node, "r")];
    document.descendants().filter(|node| node.has_tag_name("circle")).map(circle).collect()
}

#[test]
fn shipped_drawing_matches_the_shipped_file() {
    let place = Place::new();
    place.put("phantom.toml", shipped("nwire.toml"));
    let same = drawn(&place) == shipped("nwire.svg");
    assert!(
        same,
        "make it anew: sonoweave calibrate drawing --phantom docs/phantom/nwire.toml -o docs/phantom/nwire.svg"
    );
}

#[test]
fn holes_are_at_the_wire_ends() {
    let place = Place::new();
    place.put("phantom.toml", shipped("nwire.toml"));
    let svg = drawn(&place);
    let root = Document::parse(&svg).unwrap();
    let root = root.root_element();
    assert_eq!([root.attribute("width"), root.attribute("height")], [Some("210mm"), Some("279mm")]);
    assert_eq!(root.attribute("viewBox"), Some("0 0 210 279"), "a unit is a mm");
    let all = circles(&svg);
    let [wires, rods, landmarks] = [0.8, 4.2, 2.4].map(|wide: f64| {
        all.iter().filter(move |circle| (circle[2] - wide).abs() < 1e-9).map(|[x, y, _]| [*x, *y]).collect::<Vec<_>>()
    });
    assert_eq!([wires.len(), rods.len(), landmarks.len()], [18, 8, 8]);
    // x and z of the wires' ends in the file, at y = 0 and at y = 60: the back plate is seen
    // from behind.
    let front = [
        [40.0, 40.0],
        [35.0, 40.0],
        [15.0, 40.0],
        [45.0, 30.0],
        [20.0, 30.0],
        [15.0, 30.0],
        [45.0, 20.0],
        [40.0, 20.0],
        [10.0, 20.0],
    ];
    let back = [
        [40.0, 40.0],
        [20.0, 40.0],
        [15.0, 40.0],
        [45.0, 30.0],
        [40.0, 30.0],
        [15.0, 30.0],
        [45.0, 20.0],
        [15.0, 20.0],
        [10.0, 20.0],
    ];
    for (holes, ends, right) in [(&wires[..9], front, 1.0), (&wires[9..], back, -1.0)] {
        for (hole, end) in holes.iter().zip(ends) {
            let [dx, dy] = [0, 1].map(|axis| hole[axis] - holes[0][axis]);
            assert!(
                (dx - right * (end[0] - 40.0)).abs() < 1e-9 && (dy + end[1] - 40.0).abs() < 1e-9,
                "{hole:?} {end:?}"
            );
        }
    }
    // All text is on the paper, and the ruler is 100 mm long.
    assert!(svg.contains("M10 ") && svg.contains(">100 mm<") && all.iter().all(|[x, y, _]| *x < 200.0 && *y < 269.0));
}

#[test]
fn other_phantoms_are_refused() {
    let place = Place::new();
    let whole = shipped("nwire.toml");
    let refused = |from: &str, to: &str, says: &[&str]| {
        assert!(whole.contains(from), "{from}");
        place.put("other.toml", whole.replace(from, to));
        place.refuses("calibrate drawing --phantom other.toml -o other.svg", says);
    };
    refused(
        "[20.0, 60.0, 40.0]",
        "[20.0, 58.0, 40.0]",
        &["other.toml: the wire 1b ends 2.00 mm off the plates that the wire 1a defines"],
    );
    refused(
        "position_mm = [0.0, -5.0, 15.0]",
        "position_mm = [0.0, -5.0, 800.0]",
        &["other.toml: the phantom's plates of 75 × 805 mm", "A3"],
    );
    place.put("phantom.toml", &whole);
    place.refuses("calibrate drawing --phantom phantom.toml -o phantom.toml", &["phantom.toml: is the input"]);
    // A landmark between the plates is on neither, and the drawing says so.
    place.put("phantom.toml", whole.replace("[55.0, -5.0, 35.0]", "[55.0, 30.0, 35.0]"));
    let svg = drawn(&place);
    assert!(svg.contains(">neither<") && svg.contains(">55, 30, 35<"), "{svg}");
}
