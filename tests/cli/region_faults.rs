//! Faults of processes and files while a volume is reconstructed in regions.

use std::process::Stdio;
use std::time::Duration;

use rustix::process::Signal;

use super::batch::signal;
use super::ome_zarr::shards;
use super::regions::{finishes_as_whole, planned};

#[test]
fn damaged_shards_are_found_and_written_again() {
    let place = planned("");
    place.does("regions run v.ome.zarr --part 1/2");
    let said = place.does("regions verify v.ome.zarr --json=before.json");
    assert!(said.contains(" 0 damaged; 4 regions are not written"), "{said}");
    place.does("regions run v.ome.zarr");
    // A bit of a value in one region, and a weight in another. The lengths stay.
    let files = ["weight/0/c/0/0/1", "0/c/0/1/0"].map(|key| format!("v.ome.zarr.part/{key}"));
    for file in &files {
        let mut bytes = place.get(file);
        let middle = bytes.len() / 2;
        bytes[middle] ^= 4;
        place.put(file, bytes);
    }
    let run = place.run("regions finish v.ome.zarr");
    assert!(run.code == 3 && run.stderr.contains("is damaged"), "{} {}", run.code, run.stderr);
    assert!(!place.path("v.ome.zarr").exists());
    let run = place.run("regions verify v.ome.zarr --json=found.json");
    assert!(run.code == 3 && run.stderr.contains("--repair"), "{} {}", run.code, run.stderr);
    let found = place.json("found.json");
    assert_eq!(found["damaged"], serde_json::json!(["0/c/0/1/0", "weight/0/c/0/0/1"]));
    let said = place.does("regions verify v.ome.zarr --repair --json=repaired.json");
    assert!(said.contains("2 regions written again"), "{said}");
    assert_eq!(place.json("repaired.json")["regions"].as_array().unwrap().len(), 2);
    assert_eq!(place.json("before.json")["missing"].as_array().unwrap().len(), 4);
    let said = place.does("regions verify v.ome.zarr");
    assert!(said.contains(" 0 damaged; 0 regions are not written"), "{said}");
    // The work of each region counts once.
    let numbers = finishes_as_whole(&place);
    assert_eq!(numbers["voxels_updated"], place.json("whole.json")["voxels_updated"]);
}

#[test]
fn stopped_process_may_end_after_another_has_done_its_work() {
    let place = planned("");
    let mut command = crate::program();
    command.args(["regions", "run", "v.ome.zarr", "--threads", "1"]).current_dir(place.path("."));
    let mut slow = command.stdout(Stdio::null()).spawn().unwrap();
    let written = || shards(&place.path("v.ome.zarr.part/weight/0/c"));
    while written() < 2 && slow.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    signal(slow.id().into(), Signal::STOP).unwrap();
    let said = place.does("regions run v.ome.zarr");
    assert!(!said.contains("0 regions written"), "it was stopped before its end: {said}");
    let status = place.does("regions status v.ome.zarr");
    assert!(status.contains("8 of 8 regions are written"), "{status}");
    // A process that may still write keeps the volume from being finished.
    let run = place.run("regions finish v.ome.zarr");
    assert!(run.code != 0 && !place.path("v.ome.zarr").exists(), "{}", run.stdout);
    signal(slow.id().into(), Signal::CONT).unwrap();
    assert!(slow.wait().unwrap().success());
    finishes_as_whole(&place);
}
