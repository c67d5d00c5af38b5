//! `convert` to and from OME-Zarr, with weights, filled holes and the label of seen voxels.

use super::ome_zarr::{FINE, SWEEP, succeeds, tree};
use super::place::Place;

const COARSE: &str = "--spacing 0.5 --clip none";

/// A volume as OME-Zarr and as files.
fn volumes(place: &Place, flags: &str) {
    place.does(SWEEP);
    let settings = format!("{flags} --path general");
    succeeds(place, &format!("reconstruct s.mha -o v.ome.zarr {settings}"));
    succeeds(place, &format!("reconstruct s.mha -o v.mha --weights w.mha {settings}"));
}

#[test]
fn files_become_ome_zarr_with_the_same_voxels() {
    // The last has several shards and levels.
    for (scalar, settings) in [("u8", COARSE), ("u16", COARSE), ("f32", FINE)] {
        let place = Place::new();
        volumes(&place, &format!("{settings} --type {scalar}"));
        place.does("convert v.mha --weights w.mha -o c.ome.zarr");
        place.does("compare c.ome.zarr v.mha --other-weights w.mha --limit 0");
        // And back: the same values and weights, as other files' bytes.
        place.does("convert c.ome.zarr -o back.mha --write-weights backw.mha");
        for (name, other) in [("back.mha", "v.mha"), ("backw.mha", "w.mha")] {
            let [a, b] = [place.volume(name), place.volume(other)];
            assert_eq!((&a.header.size, a.header.pixel), (&b.header.size, b.header.pixel), "{scalar}: {name}");
            assert!(a.values == b.values, "{scalar}: {name} has other voxels");
            assert_eq!(a.field("SonoweaveInput"), b.field("SonoweaveInput"));
        }
        for mode in ["shaded", "slice"] {
            succeeds(&place, &format!("render c.ome.zarr -o a.png --mode {mode} --image-size 80x60"));
            succeeds(&place, &format!("render v.mha --weights w.mha -o b.png --mode {mode} --image-size 80x60"));
            assert!(place.get("a.png") == place.get("b.png"), "{scalar}, {mode}: another picture");
        }
        place.does("convert v.mha --weights w.mha -o d.ome.zarr");
        let whole = tree(&place.path("c.ome.zarr"));
        assert!(whole == tree(&place.path("d.ome.zarr")), "{scalar}: other bytes at the second time");
        assert_eq!(whole.keys().any(|key| key.starts_with("1/c/")), scalar == "f32", "{:?}", whole.keys());
    }
}

#[test]
fn voxels_without_weights_are_seen_unless_they_are_unseen() {
    let place = Place::new();
    volumes(&place, &format!("{COARSE} --type f32 --unseen -7"));
    place.does("convert v.mha -o c.ome.zarr");
    place.does("convert c.ome.zarr -o back.mha --write-weights backw.mha");
    let [v, w, back, backw] = ["v.mha", "w.mha", "back.mha", "backw.mha"].map(|name| place.volume(name));
    assert!(back.values == v.values);
    let mut seen = 0;
    for (given, found) in w.values.iter().zip(&backw.values) {
        seen += u64::from(*given > 1e-3);
        assert_eq!(*found > 0.0, *given > 1e-3);
    }
    assert!(seen > 10_000 && seen < w.values.len() as u64);
}

#[test]
fn holes_of_read_volumes_are_filled_as_at_reconstruction() {
    let place = Place::new();
    let thin = "--spacing 0.5 --sigma 0.3,0.3,0.1 --clip none --path general --type f32 --unseen -1";
    place.does("phantom -o s.mha --frames 40 --image-size 48x40 --pixel 0.5 --gap 2 --trajectory freehand");
    for law in ["nearest", "gaussian"] {
        let fill = format!("--fill {law} --fill-radius 1.6");
        succeeds(&place, &format!("reconstruct s.mha -o v.mha --weights w.mha {thin}"));
        succeeds(&place, &format!("reconstruct s.mha -o v.ome.zarr {thin}"));
        succeeds(&place, &format!("reconstruct s.mha -o f.mha --weights fw.mha {thin} {fill}"));
        let said = place.does(&format!("convert v.mha --weights w.mha -o a.mha --write-weights aw.mha {fill}"));
        assert!(said.contains("filled: ") && said.contains(law), "{said}");
        place.does(&format!("convert v.ome.zarr -o z.ome.zarr {fill}"));
        place.does("convert z.ome.zarr -o b.mha --write-weights bw.mha");
        let [f, fw, aw] = ["f.mha", "fw.mha", "aw.mha"].map(|name| place.volume(name));
        let filled = fw.values.iter().filter(|weight| **weight == -1.0).count();
        assert!(filled > 1000, "{law}: {filled} voxels are filled");
        assert!(f.values == place.volume("a.mha").values && fw.values == aw.values, "{law}: a file's holes");
        assert_eq!(place.volume("a.mha").field("SonoweaveFilled"), filled.to_string());
        // The OME-Zarr volume begins at a shard, so that it may have more voxels around.
        place.does("compare z.ome.zarr f.mha --other-weights fw.mha --limit 0");
        let in_zarr = place.volume("bw.mha").values.iter().filter(|weight| **weight == -1.0).count();
        assert!(in_zarr >= filled, "{law}: {in_zarr} voxels are filled of {filled}");
    }
}

#[test]
fn label_of_seen_voxels_is_written_on_request() {
    let place = Place::new();
    volumes(&place, &format!("{COARSE} --type u8"));
    succeeds(&place, &format!("reconstruct s.mha -o l.ome.zarr {COARSE} --type u8 --path general --seen-label"));
    place.does("convert v.mha --weights w.mha -o c.ome.zarr --seen-label");
    for name in ["l.ome.zarr", "c.ome.zarr"] {
        let files = tree(&place.path(name));
        assert!(files.contains_key("labels/seen/zarr.json"), "{name}: {:?}", files.keys());
        assert!(files.keys().any(|key| key.starts_with("labels/seen/0/c/")));
    }
    assert!(!tree(&place.path("v.ome.zarr")).keys().any(|key| key.starts_with("labels")));
}

#[test]
fn conversions_that_do_not_fit_are_refused() {
    let place = Place::new();
    volumes(&place, &format!("{COARSE} --type u8"));
    let before = tree(&place.path("v.ome.zarr"));
    for (words, code, said) in [
        ("convert v.ome.zarr --weights w.mha -o c.mha", 2, "holds its weights itself"),
        ("convert v.mha -o c.ome.zarr --write-weights x.mha", 2, "holds its weights itself"),
        ("convert v.mha -o c.mha --seen-label", 2, "applies to OME-Zarr volumes only"),
        ("convert v.mha -o c.mha --write-weights x.mha", 1, "has no weights to write"),
        ("convert s.mha -o c.mha --fill nearest", 2, "is a recording"),
        ("convert v.mha --weights v.mha -o v.mha --fill nearest", 2, "is the input"),
        ("convert v.mha --weights w.mha -o c.ome.zarr --fill nearest --fill-radius 99", 2, "--fill-radius"),
        ("convert v.mha --weights w.mha -o c.ome.zarr --fill nearest --max-memory 0.0001", 6, "memory"),
        ("convert v.mha -o no/c.ome.zarr", 7, "does not exist"),
        ("reconstruct s.mha -o c.mha --seen-label", 2, "applies to OME-Zarr volumes only"),
        ("reconstruct s.mha -o c.mha --format nrrd", 2, "is for several sweeps"),
    ] {
        let run = place.run(words);
        assert!(run.code == code && run.stderr.contains(said), "{words}: {} {}", run.code, run.stderr);
        assert!(!place.path("c.mha").exists() && !place.path("c.ome.zarr").exists(), "{words}");
        assert!(!place.path("x.mha").exists(), "{words}");
    }
    assert!(before == tree(&place.path("v.ome.zarr")));
    // Weights of another grid.
    succeeds(&place, "reconstruct s.mha -o o.mha --weights ow.mha --spacing 1 --clip none --path general");
    let run = place.run("convert v.mha --weights ow.mha -o c.ome.zarr");
    assert!(run.code != 0 && run.stderr.contains("these are not the weights of v.mha"), "{}", run.stderr);
}

#[test]
fn several_sweeps_become_ome_zarr_volumes() {
    let place = Place::new();
    place.does("phantom -o a.mha --frames 6 --image-size 24x20 --pixel 0.5 --gap 0.5");
    place.does("phantom -o b.mha --frames 6 --image-size 24x20 --pixel 0.5 --gap 0.5 --seed 2");
    std::fs::create_dir(place.path("out")).unwrap();
    place.does("reconstruct a.mha b.mha -o out --format ome.zarr --clip none --path general");
    place.does("reconstruct b.mha -o alone.ome.zarr --clip none --path general");
    assert!(tree(&place.path("out/b.ome.zarr")) == tree(&place.path("alone.ome.zarr")));
    assert!(place.path("out/a.ome.zarr/zarr.json").is_file());
}

#[test]
fn fields_left_out_have_no_part_in_ome_zarr() {
    let place = Place::new();
    volumes(&place, &format!("{COARSE} --type u8"));
    let volume = place.get("v.mha");
    let data = volume.windows(15).position(|word| word == b"ElementDataFile").unwrap();
    for name in ["Anna", "Bert"] {
        let field = format!("Patient = {name}\n");
        place.put(&format!("{name}.mha"), [&volume[..data], field.as_bytes(), &volume[data..]].concat());
        place.does(&format!("convert {name}.mha -o {name}.ome.zarr --anonymize"));
        place.does(&format!("convert {name}.mha -o named-{name}.ome.zarr"));
    }
    let files = |name: &str| tree(&place.path(name));
    assert!(files("Anna.ome.zarr") == files("Bert.ome.zarr"), "a name could be found by trying");
    assert!(files("named-Anna.ome.zarr") != files("named-Bert.ome.zarr"));
}
