//! Bodies between contours: their volumes, files and warnings.

use std::f64::consts::PI;
use std::fmt::Write as _;

use formats::Limits;
use formats::image::VolumeReader;

use super::ome_zarr::succeeds;
use super::place::Place;

/// Returns a file of circles on planes of constant z, from their heights and radii, mm.
fn circles(all: impl IntoIterator<Item = [f64; 2]>) -> String {
    let mut text = "format = \"sonoweave-contours\"\nversion = 1\nframe = \"Reference\"\n".to_owned();
    for [z, radius] in all {
        let angle = |n: i32| PI * f64::from(n) / 8.0;
        let points: Vec<[f64; 2]> =
            (0..16).map(|n| [30.0 + radius * angle(n).cos(), radius * angle(n).sin()]).collect();
        let plane = "across = [2.0, 0.0, 0.0]\nalong = [0.0, 2.0, 0.0]";
        writeln!(text, "[[contour]]\norigin = [-10.0, 5.0, {z:?}]\n{plane}\npoints = {points:?}").unwrap();
    }
    text
}

/// Ten contours of a ball of radius 10 mm about (20, 5, 0).
fn ball() -> String {
    let heights = (0..10).map(|n| 9.7 * (f64::from(n) / 4.5 - 1.0));
    circles(heights.map(|z| [z, (100.0 - z * z).sqrt()]))
}

fn near(value: &serde_json::Value, expected: f64, share: f64) {
    let value = value.as_f64().unwrap();
    assert!((value / expected - 1.0).abs() < share, "{value} for {expected}");
}

#[test]
fn contours_of_ball_have_its_volume_as_mesh_and_labels() {
    let place = Place::new();
    place.put("c.toml", ball());
    let said = place.run("contours c.toml -o b.stl --json=c.json");
    assert_eq!(said.code, 0, "{}", said.stderr);
    assert!(
        said.stderr.contains("105×105×103 voxels of 0.1988 mm take 5 MiB") && !said.stderr.contains("warning"),
        "{}",
        said.stderr
    );
    assert!(said.stdout.contains("b.stl: ") && said.stdout.contains("by their areas 4.179 ml"), "{}", said.stdout);
    let c = place.json("c.json");
    let truth = 4.0 / 3.0 * PI * 1000.0;
    near(&c["mesh"]["volume_mm3"], truth, 0.01);
    near(&c["planimetry_mm3"], truth, 0.01);
    assert_eq!((&c["mesh"]["closed"], &c["mesh"]["parts"], &c["moved_pairs"]), (&true.into(), &1.into(), &0.into()));
    assert_eq!(place.get("b.stl").len() as u64, 84 + 50 * c["mesh"]["triangles"].as_u64().unwrap());
    let text = String::from_utf8_lossy(&place.get("b.stl")[..80]).into_owned();
    assert!(text.contains("body between 10 contours"), "{text}");
    for threads in [1, 3] {
        succeeds(&place, &format!("contours c.toml -o b{threads}.nrrd --spacing 0.5 --threads {threads}"));
    }
    assert_eq!(place.get("b1.nrrd"), place.get("b3.nrrd"));
    let mut reader = VolumeReader::open(&place.path("b1.nrrd"), &Limits::default()).unwrap();
    let header = reader.header().clone();
    let frame = ("SonoweaveFrame".to_owned(), "Reference (mm, not anatomical)".to_owned());
    assert!(header.fields.contains(&frame) && header.spacing == [0.5; 3], "{header:?}");
    let (mut count, mut sums, mut z) = (0.0, [0.0; 3], 0);
    while let Some(slice) = reader.next_slice().unwrap() {
        for n in (0..slice.len() as u32).filter(|n| slice[*n as usize] == 1) {
            let voxel = [n % header.size[0], n / header.size[0], z];
            count += 1.0;
            (0..3).for_each(|a| sums[a] += header.origin[a] + 0.5 * f64::from(voxel[a]));
        }
        z += 1;
    }
    assert!((count * 0.125 / truth - 1.0).abs() < 0.01, "{count}");
    for (sum, centre) in sums.into_iter().zip([20.0, 5.0, 0.0]) {
        assert!((sum / count - centre).abs() < 0.03, "{} for {centre}", sum / count);
    }
}

#[test]
fn contours_of_the_documents_make_a_closed_body() {
    let place = Place::new();
    let page = include_str!("../../docs/regions.md");
    let fence = page.split("```\n").find(|fence| fence.starts_with("format = ")).unwrap();
    place.put("c.toml", fence);
    succeeds(&place, "contours c.toml --json=c.json");
    let c = place.json("c.json");
    assert_eq!((&c["contours"], &c["mesh"]["closed"]), (&2.into(), &true.into()));
}

#[test]
fn volumes_that_differ_are_warned_of() {
    // Between these, the areas of slices do not follow from the widths of the body.
    let place = Place::new();
    place.put("c.toml", circles([[0.0, 10.0], [20.0, 1.0]]));
    let notes = succeeds(&place, "contours c.toml");
    assert!(notes.contains("warning: both volumes are") && notes.contains("% apart"), "{notes}");
}

#[test]
fn impossible_contours_are_refused() {
    let place = Place::new();
    place.put("c.toml", ball());
    place.put("one.toml", circles([[0.0, 10.0]]));
    place.put("order.toml", circles([[0.0, 10.0], [4.0, 10.0], [2.0, 10.0]]));
    for (words, code, says) in [
        ("one.toml", 4, "the number of contours must be 2 or more, not 1"),
        ("order.toml", 4, "contour 3 does not lie after contour 2"),
        ("none.toml", 4, "none.toml"),
        ("c.toml -o b.off", 2, "the name of a region's file must end in"),
        ("c.toml --spacing 0", 2, "the spacing must be above 0 mm"),
        ("c.toml --max-memory 0.001", 6, "raise the limit"),
        ("c.toml -o none/b.stl", 7, "the folder none does not exist"),
    ] {
        let run = place.run(&format!("contours {words}"));
        assert!(run.code == code && run.stderr.contains(says), "{words}: {} {}", run.code, run.stderr);
    }
    assert_eq!(place.names().into_iter().collect::<Vec<_>>(), ["c.toml", "one.toml", "order.toml"]);
}
