//! OME-Zarr volumes in and out of the commands, whole and in regions.

use std::collections::BTreeMap;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::time::Duration;

use super::place::Place;

/// A freehand sweep whose volume has several shards at this spacing.
pub(super) const SWEEP: &str =
    "phantom -o s.mha --frames 40 --image-size 48x40 --pixel 0.5 --gap 0.5 --trajectory freehand";
pub(super) const FINE: &str = "--spacing 0.15 --sigma 0.3,0.3,0.3 --clip none";
/// Memory of one region of a shard's size, GiB.
pub(super) const ONE_SHARD: &str = "--max-memory 0.024";

/// All files of a folder by name.
pub(super) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in std::fs::read_dir(inner).unwrap().map(Result::unwrap) {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().display().to_string();
                files.insert(name, std::fs::read(&path).unwrap());
            }
        }
    }
    files
}

/// Number of whole files in a folder that a program is writing.
pub(super) fn shards(folder: &Path) -> usize {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let count = |path: PathBuf| match path.is_dir() {
        true => shards(&path),
        false => usize::from(path.extension().is_none()),
    };
    entries.map(count).sum()
}

/// Runs a command that succeeds, with notes or without.
pub(super) fn succeeds(place: &Place, words: &str) -> String {
    let run = place.run(words);
    assert_eq!(run.code, 0, "{words}: {}", run.stderr);
    run.stderr
}

#[test]
fn volume_is_read_like_that_of_another_format() {
    let place = Place::new();
    place.does(SWEEP);
    for scalar in ["u8", "f32"] {
        let settings = format!("--spacing 0.5 --type {scalar}");
        succeeds(&place, &format!("reconstruct s.mha -o v.ome.zarr {settings}"));
        succeeds(&place, &format!("reconstruct s.mha -o v.mha --weights w.mha {settings}"));
        for mode in ["shaded", "slice", "mip"] {
            succeeds(&place, &format!("render v.ome.zarr -o a.png --mode {mode} --image-size 80x60"));
            succeeds(&place, &format!("render v.mha --weights w.mha -o b.png --mode {mode} --image-size 80x60"));
            assert!(place.get("a.png") == place.get("b.png"), "{scalar}, {mode}: another picture");
        }
        let said = place.does("inspect v.ome.zarr --against v.mha");
        assert!(said.contains("seen") && said.contains("RMSE            0.000"), "{said}");
        succeeds(&place, "inspect v.ome.zarr --against v.mha --json=a.json");
        succeeds(&place, "inspect v.mha --weights w.mha --json=b.json");
        let [own, other] = ["a.json", "b.json"].map(|name| place.json(name));
        assert_eq!(own["coverage"]["seen"], other["coverage"]["seen"]);
        assert_eq!(own["comparison"]["voxels"], other["coverage"]["seen"]);
        assert_eq!(own["scalar"], scalar);
        let said = place.does("compare v.ome.zarr v.mha --other-weights w.mha --limit 0");
        assert!(said.contains("SonoweaveSlicesBox"), "{said}");
        succeeds(&place, "convert v.ome.zarr -o c.nrrd");
        succeeds(&place, "compare c.nrrd v.mha --limit 0");
        assert_eq!(place.volume("c.nrrd").field("SonoweaveInput"), place.volume("v.mha").field("SonoweaveInput"));
    }
    let refused = place.run("render v.ome.zarr --weights w.mha -o p.png");
    assert!(refused.code == 2 && refused.stderr.contains("holds its weights itself"), "{}", refused.stderr);
}

#[test]
fn planar_volume_keeps_its_place_and_says_who_reads_it() {
    let place = Place::new();
    place.does("phantom -o s.mha --frames 12 --image-size 48x40 --pixel 0.5 --gap 0.5 --trajectory parallel");
    let said = succeeds(&place, "reconstruct s.mha -o v.ome.zarr --path planar --type f32");
    assert!(said.contains("OME-Zarr 0.5 has no direction of axes"), "{said}");
    succeeds(&place, "reconstruct s.mha -o v.mha --weights w.mha --path planar --type f32");
    place.does("compare v.ome.zarr v.mha --other-weights w.mha --limit 0");
    let said = succeeds(&place, "reconstruct s.mha -o g.ome.zarr --path general");
    assert!(!said.contains("direction"), "{said}");
}

#[test]
fn coarser_level_is_compared_if_memory_does_not_suffice() {
    let place = Place::new();
    place.does(SWEEP);
    succeeds(&place, &format!("reconstruct s.mha -o v.ome.zarr {FINE}"));
    let run = place.run("compare v.ome.zarr v.ome.zarr --max-memory 0.03");
    let said = run.stdout + &run.stderr;
    assert!(said.contains("the voxels of 0.3×0.3×0.3 mm are read (level 1)"), "{said}");
}

#[test]
fn regions_have_bytes_of_whole_volume() {
    let place = Place::new();
    place.does(SWEEP);
    let compoundings = ["latest", "decay --decay exp --decay-rate 0.5"];
    for compounding in compoundings {
        let words = format!("reconstruct s.mha {FINE} --compound {compounding} --path general --type f32");
        succeeds(&place, &format!("{words} -o whole.ome.zarr --json=whole.json --threads 1"));
        succeeds(&place, &format!("{words} -o parts.ome.zarr --json=parts.json --out-of-core {ONE_SHARD} --threads 2"));
        let whole = tree(&place.path("whole.ome.zarr"));
        assert!(whole == tree(&place.path("parts.ome.zarr")), "{compounding}: other files");
        assert!(whole.keys().any(|name| name.starts_with("0/c/1/1/1")) || whole.len() > 20, "{:?}", whole.keys());
        let [whole, parts] = ["whole.json", "parts.json"].map(|name| place.json(name));
        let regions = &parts["regions"];
        assert!(regions["count"].as_u64() >= Some(8) && regions["kept"] == 0, "{regions}");
        for counter in ["voxels_updated", "w_clamped", "frames", "grid", "times_backwards"] {
            assert_eq!(whole[counter], parts[counter], "{compounding}: {counter}");
        }
        assert_eq!(whole["work"]["bricks_touched"], parts["work"]["bricks_touched"]);
        // A slice is filtered once for each region that it meets.
        let pixels = |numbers: &serde_json::Value| numbers["work"]["pixels_filtered"].as_u64().unwrap();
        assert_eq!(pixels(&parts) * 40, pixels(&whole) * regions["meetings"].as_u64().unwrap());
        assert!(parts["bytes"].as_u64().unwrap() < whole["bytes"].as_u64().unwrap() / 2);
    }
}

#[test]
fn volume_beyond_memory_is_made_in_regions_by_itself() {
    let place = Place::new();
    place.does(SWEEP);
    succeeds(&place, &format!("reconstruct s.mha -o whole.ome.zarr {FINE}"));
    let said = succeeds(&place, &format!("reconstruct s.mha -o parts.ome.zarr {FINE} {ONE_SHARD}"));
    assert!(said.contains("the volume is reconstructed in regions instead"), "{said}");
    assert!(tree(&place.path("whole.ome.zarr")) == tree(&place.path("parts.ome.zarr")));
    // Other formats need the whole volume.
    let refused = place.run(&format!("reconstruct s.mha -o v.mha {FINE} {ONE_SHARD}"));
    assert!(refused.code == 6 && refused.stderr.contains("--max-memory"), "{}", refused.stderr);
    assert!(!place.path("v.mha").exists());
}

#[test]
fn killed_run_goes_on_to_the_same_bytes() {
    let place = Place::new();
    place.does(SWEEP);
    let words = format!("reconstruct s.mha -o v.ome.zarr {FINE} --out-of-core {ONE_SHARD} --json=v.json");
    succeeds(&place, &words);
    let whole = tree(&place.path("v.ome.zarr"));
    let mut kills = 0;
    for finished in [0, 1, 3, 5] {
        std::fs::remove_dir_all(place.path("v.ome.zarr")).unwrap();
        let mut command = crate::program();
        command.args(words.split_whitespace()).current_dir(place.path(".")).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.spawn().unwrap();
        // A shard's weights are written last. One region after the other is, and each is a shard.
        while child.try_wait().unwrap().is_none() && shards(&place.path("v.ome.zarr.part/weight/0/c")) <= finished {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        let was_killed = child.wait().unwrap().signal().is_some();
        assert_eq!(place.path("v.ome.zarr").exists(), !was_killed, "a volume appears whole or not at all");
        succeeds(&place, &words);
        assert!(whole == tree(&place.path("v.ome.zarr")), "{finished} finished: other files");
        assert!(!place.path("v.ome.zarr.part").exists());
        let kept = place.json("v.json")["regions"]["kept"].as_u64().unwrap() as usize;
        assert!(kept >= finished && was_killed || !was_killed && kept == 0, "{kept} of {finished} finished are kept");
        kills += usize::from(was_killed);
    }
    assert!(kills > 0, "no run was killed before its end");
}

#[test]
fn run_does_not_go_on_with_other_slices_or_mask() {
    let place = Place::new();
    place.does(SWEEP);
    let words =
        |rest: &str| format!("reconstruct s.mha -o v.ome.zarr --spacing 0.15 --sigma 0.3,0.3,0.3 {ONE_SHARD} {rest}");
    // The fan leaves out the lower corners alone, so that the box is the same.
    let unlike = ["--frames 20..40 --clip none", "--frames 0..20 --clip none --fan 24,-20,20,61,-60,60"];
    succeeds(&place, &words("--frames 0..20 --clip none --out-of-core"));
    let whole = tree(&place.path("v.ome.zarr"));
    for other in unlike {
        std::fs::remove_dir_all(place.path("v.ome.zarr")).unwrap();
        let mut command = crate::program();
        command.current_dir(place.path(".")).stdout(Stdio::null()).stderr(Stdio::null());
        let mut child = command.args(words(&format!("{other} --out-of-core")).split_whitespace()).spawn().unwrap();
        while child.try_wait().unwrap().is_none() && shards(&place.path("v.ome.zarr.part/weight/0/c")) == 0 {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let words = words("--frames 0..20 --clip none --out-of-core --json=v.json");
        succeeds(&place, &words);
        assert_eq!(place.json("v.json")["regions"]["kept"], 0, "{other}");
        assert!(whole == tree(&place.path("v.ome.zarr")), "{other}: other files");
    }
}

#[test]
fn unusable_requests_of_regions_are_refused() {
    let place = Place::new();
    place.does(SWEEP);
    let cases: [(&str, &[&str]); 7] = [
        ("-o v.mha --out-of-core", &["--out-of-core: writes OME-Zarr only", "sonoweave convert"]),
        ("-o v.ome.zarr --out-of-core --weights w.mha", &["--weights: needs the whole volume in memory"]),
        ("-o v.ome.zarr --out-of-core --planes p.png", &["--planes: needs the whole volume in memory"]),
        ("-o v.ome.zarr --out-of-core --size 9,9,9", &["--size: begins at the lowest voxel seen", "--origin"]),
        (
            "-o v.ome.zarr --out-of-core --max-memory 0.01",
            &["a region of 128×128×128 voxels", "raise the memory limit"],
        ),
        ("-o none/v.ome.zarr", &["none/v.ome.zarr: the folder none does not exist"]),
        ("-o v.ome.zarr --out-of-core --path planar", &["planar"]),
    ];
    for (flags, says) in cases {
        let before = place.names();
        let run = place.run(&format!("reconstruct s.mha {flags}"));
        assert!((1..=10).contains(&run.code), "{flags}: {}", run.code);
        assert!(says.iter().all(|part| run.stderr.contains(part)), "{flags}: {}", run.stderr);
        assert_eq!(place.names(), before, "{flags}");
    }
    place.put("file.ome.zarr", "no folder");
    let run = place.run("reconstruct s.mha -o file.ome.zarr");
    assert!(run.code == 7 && run.stderr.contains("file.ome.zarr"), "{}", run.stderr);
    assert_eq!(place.get("file.ome.zarr"), b"no folder");
    place.refuses_with("inspect none.ome.zarr", &["none.ome.zarr"]);
}
