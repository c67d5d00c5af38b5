//! A program that is killed while it writes: the next one goes on.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use ome_zarr::{OmeZarr, OmeZarrWriter, Scalar};

use crate::scene::{Scene, meta, tree};

/// Variable with the volume that the child is to write.
const VOLUME: &str = "OME_ZARR_TEST_VOLUME";

fn scene() -> Scene {
    Scene::new(meta([-32, 0, 16], [290, 30, 20], Scalar::F32), 11)
}

/// Writes what is missing.
fn write(path: &Path) {
    let scene = scene();
    let (writer, _) = OmeZarrWriter::create(path, &scene.meta).unwrap();
    for index in scene.meta.extent.shard_indices(0).filter(|index| !writer.shards().is_done(0, *index)) {
        scene.write_shard(writer.shards(), index).unwrap();
    }
    writer.finish().unwrap();
}

/// The program that is killed: this test, called by the other with a volume to write.
#[test]
fn child_writes_its_volume() {
    if let Some(path) = std::env::var_os(VOLUME) {
        write(Path::new(&path));
    }
}

#[test]
fn volume_of_killed_programs_is_that_of_one() {
    let folder = tempfile::tempdir().unwrap();
    let whole = folder.path().join("whole.ome.zarr");
    let begun = Instant::now();
    write(&whole);
    let (expected, takes) = (tree(&whole), begun.elapsed());
    let path = folder.path().join("a.ome.zarr");
    let (mut killed, mut unfinished) = (0, 0);
    for moment in 0..20 {
        // Each program gets further than its part of the whole time, as earlier ones did some.
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "kills::child_writes_its_volume"])
            .env(VOLUME, &path)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        std::thread::sleep(Duration::from_millis(5) + takes * moment / 25);
        child.kill().unwrap();
        killed += u32::from(!child.wait().unwrap().success());
        match OmeZarr::open(&path) {
            Ok(_) => assert!(tree(&path) == expected),
            Err(_) => {
                unfinished += 1;
                assert!(!path.exists(), "a volume appears as a whole");
            }
        }
        if moment % 4 == 3 {
            write(&path);
            assert!(tree(&path) == expected, "after {killed} kills");
            std::fs::remove_dir_all(&path).unwrap();
        } else if path.exists() {
            std::fs::remove_dir_all(&path).unwrap();
        }
    }
    assert!(killed > 5 && unfinished > 5, "{killed} killed, {unfinished} unfinished");
}
