//! Volumes that several processes reconstruct, each some of their regions.

use std::os::unix::process::ExitStatusExt as _;
use std::process::Stdio;
use std::time::Duration;

use serde_json::Value;

use super::ome_zarr::{FINE, ONE_SHARD, SWEEP, shards, succeeds, tree};
use super::place::Place;

const PLAN: &str = "v.ome.zarr.part/plan.json";

/// Returns a place with a sweep, its volume `whole.ome.zarr`, and a plan of `v.ome.zarr`.
pub(super) fn planned(rest: &str) -> Place {
    let place = Place::new();
    place.does(SWEEP);
    let words = format!("s.mha {FINE} --path general --type f32 {rest}");
    succeeds(&place, &format!("reconstruct {words} -o whole.ome.zarr --json=whole.json"));
    succeeds(&place, &format!("regions plan {words} {ONE_SHARD} -o v.ome.zarr --json=plan.json"));
    place
}

pub(super) fn finishes_as_whole(place: &Place) -> Value {
    place.does("regions finish v.ome.zarr --json=v.json");
    assert!(tree(&place.path("v.ome.zarr")) == tree(&place.path("whole.ome.zarr")), "other files");
    assert!(!place.path("v.ome.zarr.part").exists());
    place.json("v.json")
}

/// Changes the plan by a function.
fn change(place: &Place, change: impl FnOnce(&mut Value)) {
    let mut plan = place.json(PLAN);
    change(&mut plan);
    place.put(PLAN, plan.to_string());
}

#[test]
fn processes_beside_each_other_make_the_whole() {
    for compounding in ["mean --max-weight 3", "decay --decay exp --decay-rate 0.5", "latest"] {
        let place = planned(&format!("--compound {compounding}"));
        let run = |part: &str| {
            let mut command = crate::program();
            command.args(["regions", "run", "v.ome.zarr", "--threads", "1", "--part", part]);
            command.current_dir(place.path(".")).stdout(Stdio::null()).spawn().unwrap()
        };
        for mut child in ["1/3", "2/3", "3/3"].map(run) {
            assert!(child.wait().unwrap().success());
        }
        let said = place.does("regions status v.ome.zarr --json=status.json");
        assert!(said.contains("8 of 8 regions are written"), "{said}");
        let said = place.does("regions run v.ome.zarr --only 3,0");
        assert!(said.contains("0 regions written, 2 kept"), "{said}");
        let numbers = finishes_as_whole(&place);
        let whole = place.json("whole.json");
        for counter in ["voxels_updated", "w_clamped", "frames", "grid", "times_backwards"] {
            assert_eq!(whole[counter], numbers[counter], "{compounding}: {counter}");
        }
        assert_eq!(whole["work"]["bricks_touched"], numbers["work"]["bricks_touched"]);
        // A slice is filtered once for each region that it meets.
        let pixels = |numbers: &Value| numbers["work"]["pixels_filtered"].as_u64().unwrap();
        let meetings = numbers["regions"]["meetings"].as_u64().unwrap();
        assert_eq!(pixels(&numbers) * 40, pixels(&whole) * meetings);
        let status = place.json("status.json");
        let slices = status["regions"].as_array().unwrap().iter().map(|region| region["slices"].as_u64().unwrap());
        assert_eq!(slices.sum::<u64>(), meetings);
    }
}

#[test]
fn killed_processes_leave_nothing_half_done() {
    let place = planned("");
    let mut kills = 0;
    for written in 0..12 {
        let mut command = crate::program();
        command.args(["regions", "run", "v.ome.zarr"]).current_dir(place.path("."));
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        while child.try_wait().unwrap().is_none() && shards(&place.path("v.ome.zarr.part/weight/0/c")) <= written / 2 {
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        kills += usize::from(child.wait().unwrap().signal().is_some());
        assert!(!place.path("v.ome.zarr").exists());
    }
    assert!(kills >= 4, "{kills} processes were killed before their end");
    place.does("regions run v.ome.zarr");
    finishes_as_whole(&place);
}

#[test]
fn one_process_goes_on_where_several_stopped() {
    let place = planned("");
    place.does("regions run v.ome.zarr --part 1/2");
    let said = succeeds(
        &place,
        &format!(
            "reconstruct s.mha {FINE} --path general --type f32 {ONE_SHARD} -o v.ome.zarr --out-of-core --json=v.json"
        ),
    );
    assert_eq!(place.json("v.json")["regions"]["kept"], 4, "{said}");
    assert!(tree(&place.path("v.ome.zarr")) == tree(&place.path("whole.ome.zarr")));
    assert!(!place.path("v.ome.zarr.part").exists());
}

#[test]
fn processor_with_other_kernels_is_refused() {
    let place = planned("");
    // The C library's functions without fused products: the same bits, or a refusal.
    let mut command = crate::program();
    command.args(["regions", "run", "v.ome.zarr"]).env("GLIBC_TUNABLES", "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2");
    let run = place.output(&mut command);
    if run.code == 0 {
        finishes_as_whole(&place);
        succeeds(&place, &format!("regions plan s.mha {FINE} --path general --type f32 {ONE_SHARD} -o v.ome.zarr"));
    } else {
        assert!(run.stderr.contains("kernels are not those of the plan"), "{}", run.stderr);
    }
    change(&place, |plan| {
        let kernels = &mut plan["sweep"]["slices"][17]["entered"]["decision"]["kernels"];
        *kernels = (kernels.as_u64().unwrap() ^ 1).into();
    });
    let refused = place.run("regions run v.ome.zarr");
    assert!(refused.code != 0 && refused.stderr.contains("kernels are not those of the plan"), "{}", refused.stderr);
    // The regions that the slice meets are missing.
    place.does("regions status v.ome.zarr --json=status.json");
    let (plan, status) = (place.json(PLAN), place.json("status.json"));
    let at = |corner: &Value, axis: usize| corner[axis].as_i64().unwrap();
    let slice = &plan["sweep"]["slices"][17]["entered"]["bricks"];
    let mut met = 0;
    for (region, state) in plan["regions"].as_array().unwrap().iter().zip(status["regions"].as_array().unwrap()) {
        let meets = (0..3)
            .all(|a| at(&slice["low"], a) <= at(&region["high"], a) && at(&slice["high"], a) >= at(&region["low"], a));
        assert!(!meets || state["done"] == false, "{region}");
        met += usize::from(meets);
    }
    assert!(met > 0, "the slice meets a region");
    let missing = place.run("regions finish v.ome.zarr");
    assert!(missing.code != 0 && missing.stderr.contains("regions are missing"), "{}", missing.stderr);
}

#[test]
fn changed_recording_or_plan_is_refused() {
    let place = planned("");
    let (plan, sweep) = (place.get(PLAN), place.get("s.mha"));
    let refuses = |says: &str| {
        let before = tree(&place.path("v.ome.zarr.part"));
        let run = place.run("regions run v.ome.zarr");
        assert!(run.code != 0 && run.stderr.contains(says), "{says}: {}", run.stderr);
        assert!(tree(&place.path("v.ome.zarr.part")) == before, "{says}");
    };
    let mut other = sweep.clone();
    *other.last_mut().unwrap() ^= 1;
    place.put("s.mha", &other);
    refuses("s.mha: has changed since the plan was made; give back the planned recording, or plan again");
    place.put("s.mha", &sweep[1..]);
    refuses("has changed since the plan was made");
    // Another time of change alone does not matter.
    place.put("s.mha", &sweep);

    place.put(PLAN, &plan[..plan.len() / 2]);
    refuses("plan.json: is no plan");
    let with = |edit: fn(&mut Value)| {
        place.put(PLAN, &plan);
        change(&place, edit);
    };
    with(|plan| plan["program"] = "0.0.1".into());
    refuses("was made by sonoweave 0.0.1, and this is");
    with(|plan| plan["sweep"]["mask"]["rows"][3] = serde_json::json!([{"start": 9, "end": 4}]));
    refuses("spans must ascend within the width");
    with(|plan| plan["sweep"]["slices"][2]["world_from_image"][0] = Value::Null);
    refuses("plan.json: is damaged");
    with(|plan| plan["described"]["meta"]["content_key"] = "other".into());
    refuses("is no unfinished volume of this description; begin it again");
    with(|plan| plan["sweep"]["slices"].as_array_mut().unwrap().swap(4, 5));
    let swapped = place.run("regions run v.ome.zarr");
    assert!(swapped.code != 0 && swapped.stderr.contains("frame"), "{}", swapped.stderr);
    place.put(PLAN, &plan);
    place.does("regions run v.ome.zarr");
    finishes_as_whole(&place);
}

#[test]
fn changed_pixels_beside_their_header_are_refused() {
    let place = Place::new();
    place.does(SWEEP);
    place.does("convert s.mha -o d.mhd");
    let raw = place.names().into_iter().find(|name| name.starts_with("d.") && name != "d.mhd").unwrap();
    succeeds(&place, &format!("regions plan d.mhd {FINE} --path general {ONE_SHARD} -o v.ome.zarr"));
    let mut pixels = place.get(&raw);
    pixels[100] ^= 1;
    place.put(&raw, &pixels);
    let run = place.run("regions run v.ome.zarr");
    assert!(run.code == 3 && run.stderr.contains(&format!("{raw}: has changed since the plan")), "{}", run.stderr);
    // Another plan does not keep what the old pixels have made.
    pixels[100] ^= 1;
    place.put(&raw, &pixels);
    place.does("regions run v.ome.zarr");
    pixels[100] ^= 1;
    place.put(&raw, &pixels);
    succeeds(&place, &format!("regions plan d.mhd {FINE} --path general {ONE_SHARD} -o v.ome.zarr"));
    let said = place.does("regions status v.ome.zarr");
    assert!(said.contains("0 of 8 regions are written"), "{said}");
}

#[test]
fn unusable_requests_of_processes_are_refused() {
    let place = planned("");
    let cases: [(&str, &[&str]); 9] = [
        ("run v.ome.zarr --only 8", &["--only 8", "there are 8 regions; give numbers from 0 to 7"]),
        ("run v.ome.zarr --part 0/3", &["--part", "must be K/N, with K from 1 to N"]),
        ("run v.ome.zarr --part 1/2 --only 1", &["cannot be used with"]),
        ("run whole.ome.zarr", &["whole.ome.zarr: has no plan", "unless this volume is the finished one"]),
        ("status none.ome.zarr", &["none.ome.zarr: has no plan", "sonoweave regions plan"]),
        ("finish v.ome.zarr", &["8 of 8 regions are missing, such as number 0", "sonoweave regions run"]),
        ("plan s.mha -o v.mha", &["writes OME-Zarr only"]),
        ("plan s.mha -o w.ome.zarr --weights w.mha", &["--weights: needs the whole volume in memory"]),
        ("plan none.mha -o w.ome.zarr", &["none.mha"]),
    ];
    for (words, says) in cases {
        let before = (place.names(), tree(&place.path("v.ome.zarr.part")));
        let run = place.run(&format!("regions {words}"));
        assert!(run.code != 0, "{words}");
        assert!(says.iter().all(|part| run.stderr.contains(part)), "{words}: {}", run.stderr);
        assert!((place.names(), tree(&place.path("v.ome.zarr.part"))) == before, "{words}");
    }
}
