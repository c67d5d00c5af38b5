//! Pictures of OME-Zarr volumes in parts: one after the other, and by several processes.

use std::process::Stdio;

use serde_json::Value;

use super::ome_zarr::{FINE, SWEEP, succeeds, tree};
use super::place::{Place, Run};

/// Ways to look at a volume: all modes by rays, grey and in colour.
const LOOKS: [&str; 9] = [
    "--mode shaded --transfer bone --view 30,20",
    "--mode shaded --transfer tissue --perspective 40 --view -120,35,10",
    "--mode shaded --shading sample --light 1,0,1 --depth-cue 1,0.5",
    "--mode opacity --transfer surface --background 0.2,0.4,0.6",
    "--mode mip --view 200,-40",
    "--mode average --perspective 70",
    "--mode iso --isovalue 90 --transfer phantom",
    "--mode mip --step 0.7 --arity 3 --draw scale,cube",
    "--mode shaded --stop 0 --view 0,90 --draw cube",
];
const SIZE: &str = "--image-size 56x44";

/// A place with the volume `v.ome.zarr`, and the same in `v.mha` and `w.mha`.
fn made(settings: &str) -> Place {
    let place = Place::new();
    place.does(SWEEP);
    succeeds(&place, &format!("reconstruct s.mha -o v.ome.zarr {settings}"));
    succeeds(&place, &format!("reconstruct s.mha -o v.mha --weights w.mha {settings}"));
    place
}

/// Refuses with a code, and a sentence that holds a text; nothing is written.
fn refused(place: &Place, words: &str, code: i32, text: &str) -> Run {
    let run = place.run(words);
    assert!(run.code == code && run.stderr.contains(text), "{words}: {}, {}", run.code, run.stderr);
    assert!(!place.path("refused.png").exists() && !place.path("refused.part").exists(), "{words}");
    run
}

fn count(value: &Value) -> u64 {
    value.as_u64().unwrap_or_else(|| panic!("{value} is no count"))
}

#[test]
fn parts_have_bits_of_dense_volume_in_every_mode() {
    let place = made("--spacing 0.5 --type f32");
    for look in LOOKS {
        succeeds(&place, &format!("render v.mha --weights w.mha -o whole.png {SIZE} {look}"));
        let whole = place.get("whole.png");
        for (parts, threads) in [("", 2), ("--parts 1", 1), ("--parts 2", 2), ("--parts 3", 1), ("--parts 8", 2)] {
            let words = format!("render v.ome.zarr -o p.png {SIZE} {look} {parts} --threads {threads} --json=p.json");
            let said = succeeds(&place, &words);
            assert!(!said.contains("not seen"), "{said}");
            assert!(place.get("p.png") == whole, "{look} {parts}: another picture");
            let picture = &place.json("p.json")["pictures"][0];
            let asked = parts.strip_prefix("--parts ").map_or(1, |n| n.parse().unwrap());
            assert_eq!((count(&picture["parts"]), &picture["bands"]), (asked, &Value::from(1)), "{look} {parts}");
        }
    }
    // More parts than layers.
    let said = succeeds(&place, &format!("render v.ome.zarr -o p.png {SIZE} {} --parts 900", LOOKS[0]));
    assert!(said.contains("900 parts were asked for, and the volume has"), "{said}");
    succeeds(&place, &format!("render v.mha --weights w.mha -o whole.png {SIZE} {}", LOOKS[0]));
    assert!(place.get("p.png") == place.get("whole.png"));
}

#[test]
fn turntable_planes_and_overlay_are_those_of_dense_volume() {
    let place = made("--spacing 0.4 --type f32");
    for look in ["--turntable 3 --mode shaded --perspective 30", "--turntable 2 --mode mip"] {
        succeeds(&place, &format!("render v.mha --weights w.mha -o whole.png {SIZE} {look}"));
        succeeds(&place, &format!("render v.ome.zarr -o p.png {SIZE} {look} --parts 4"));
        for turn in 0..if look.contains('3') { 3 } else { 2 } {
            assert!(
                place.get(&format!("p-00{turn}.png")) == place.get(&format!("whole-00{turn}.png")),
                "{look} {turn}"
            );
        }
    }
    for look in ["", "--overlay weight", "--overlay coverage --window 10,200"] {
        succeeds(&place, &format!("render v.mha --weights w.mha -o whole.png --mode slice {look}"));
        succeeds(&place, &format!("render v.ome.zarr -o p.png --mode slice {look}"));
        assert!(place.get("p.png") == place.get("whole.png"), "{look}: another picture");
    }
    std::fs::remove_dir_all(place.path("v.ome.zarr/weight")).unwrap();
    refused(&place, "render v.ome.zarr -o refused.png --mode slice --overlay weight", 1, "the volume has no weights");
}

#[test]
fn memory_limit_makes_parts_and_bands_with_same_bits() {
    let place = made(&format!("{FINE} --type f32"));
    for look in [LOOKS[1], LOOKS[2], LOOKS[4]] {
        let look = format!("{look} --image-size 300x240 --arity 4");
        succeeds(&place, &format!("render v.mha --weights w.mha -o whole.png {look} --json=whole.json"));
        let words = format!("render v.ome.zarr -o p.png {look} --max-memory 0.04 --json=p.json");
        let said = succeeds(&place, &words);
        assert!(said.contains("the picture is rendered in"), "{said}");
        assert!(place.get("p.png") == place.get("whole.png"), "{look}: another picture");
        let limit = f64::from(1 << 30) * 0.04;
        let picture = &place.json("p.json")["pictures"][0];
        assert!(count(&picture["parts"]) > 1 && count(&picture["bands"]) > 1, "{picture}");
        let [voxels, rays, compositor] =
            ["voxel_bytes", "cache_bytes", "compositor_bytes"].map(|field| count(&picture[field]) as f64);
        assert!(voxels <= limit / 2.0 && rays + compositor <= limit / 4.0 && compositor > 0.0, "{picture}");
        let whole = &place.json("whole.json")["pictures"][0];
        assert!(count(&whole["voxel_bytes"]) as f64 > limit / 2.0, "{whole}");
        assert_eq!(picture["work"]["pixels_changed"], whole["work"]["pixels_changed"], "{look}");
    }
    let small = "render v.ome.zarr -o refused.png --image-size 300x240";
    refused(&place, &format!("{small} --max-memory 0.012"), 6, "the smallest part of the picture would take");
    refused(&place, &format!("{small} --max-memory 0.0009"), 6, "a chunk takes");
    refused(&place, &format!("{small} --max-memory 0.03 --adaptive 0.01"), 6, "--adaptive: rays are left out only if");
}

#[test]
fn chunks_that_are_not_seen_are_not_read() {
    let place = made(&format!("{FINE} --type f32"));
    let numbers = |words: &str| {
        succeeds(&place, &format!("render v.ome.zarr -o p.png {SIZE} {words} --json=p.json"));
        place.json("p.json")
    };
    let whole = numbers("");
    let chunks = count(&whole["reading"]["chunks"]);
    assert_eq!(count(&whole["reading"]["chunks_read"]), chunks, "each chunk is read once");
    assert_eq!((&whole["level"], &whole["voxels_seen"]), (&Value::from(0), &Value::Null));
    let stored: usize = tree(&place.path("v.ome.zarr"))
        .iter()
        .filter(|(name, _)| name.starts_with("0/c") || name.starts_with("weight/0/c"))
        .map(|(_, bytes)| bytes.len())
        .sum();
    let read = count(&whole["reading"]["bytes_read"]);
    assert!(read > stored as u64 / 2 && read <= stored as u64, "{read} of {stored} bytes");
    // A plane meets some chunks only, and those are read once by any number of threads.
    for threads in [1, 2] {
        let plane = numbers(&format!("--mode slice --plane 0,0,10,0,0,1 --threads {threads}"));
        let read = count(&plane["reading"]["chunks_read"]);
        assert!(read > 0 && read < chunks, "{read} of {chunks}");
    }
    // Several parts share chunks at their cuts, which stay in memory.
    assert_eq!(count(&numbers("--parts 3")["reading"]["chunks_read"]), chunks);
    // Half of the volume is removed: its chunks are empty.
    let shards: Vec<String> =
        tree(&place.path("v.ome.zarr")).into_keys().filter(|name| name.starts_with("weight/0/c/1")).collect();
    assert!(!shards.is_empty());
    shards.iter().for_each(|name| std::fs::remove_file(place.path("v.ome.zarr").join(name)).unwrap());
    let half = &numbers("--parts 3")["reading"];
    assert!(count(&half["chunks"]) < chunks && half["chunks"] == half["chunks_read"], "{half}");
}

#[test]
fn coarser_level_is_rendered_on_request() {
    let place = made(&format!("{FINE} --type f32"));
    let numbers = |level: &str| {
        succeeds(&place, &format!("render v.ome.zarr -o p{level}.png {SIZE} --level {level} --json=p.json --parts 2"));
        place.json("p.json")
    };
    let [fine, coarse] = ["0", "1"].map(numbers);
    assert_eq!(coarse["level"], 1);
    for axis in 0..3 {
        assert_eq!(count(&coarse["size"][axis]), count(&fine["size"][axis]).div_ceil(2), "{coarse}");
    }
    succeeds(&place, &format!("render v.ome.zarr -o whole.png {SIZE} --level 1"));
    assert!(place.get("whole.png") == place.get("p1.png") && place.get("p0.png") != place.get("p1.png"));
    refused(&place, "render v.ome.zarr -o refused.png --level 9", 2, "level 9");
    refused(&place, "render v.mha -o refused.png --level 1", 2, "--level: v.mha has no levels");
}

#[test]
fn damaged_chunk_ends_render_without_picture() {
    let place = made("--spacing 0.5 --type f32");
    for name in tree(&place.path("v.ome.zarr")).into_keys().filter(|name| name.starts_with("0/c")) {
        let shard = place.path("v.ome.zarr").join(name);
        let mut bytes = std::fs::read(&shard).unwrap();
        // In all chunks, but not in their index at the end.
        let chunks = bytes.len() - 1100;
        bytes[..chunks].iter_mut().step_by(50).for_each(|byte| *byte ^= 1);
        std::fs::write(&shard, &bytes).unwrap();
    }
    for look in ["--mode mip", "--mode slice", "--mode shaded --parts 3"] {
        refused(&place, &format!("render v.ome.zarr -o refused.png {look}"), 3, "0 is damaged");
    }
    refused(&place, "render v.ome.zarr -o refused.part --part 1/1", 3, "0 is damaged");
}

/// Renders all parts of a picture, each by a process of its own, at the same time.
fn in_processes(place: &Place, parts: u32, words: &str) -> Vec<String> {
    let run = |part: u32| {
        let mut command = crate::program();
        command.args(["render", "v.ome.zarr", "-o", &format!("{part}.part"), "--part", &format!("{part}/{parts}")]);
        command.args(words.split_whitespace()).current_dir(place.path(".")).stdout(Stdio::null()).spawn().unwrap()
    };
    for mut child in (1..=parts).map(run).collect::<Vec<_>>() {
        assert!(child.wait().unwrap().success(), "{words}");
    }
    (1..=parts).map(|part| format!("{part}.part")).collect()
}

#[test]
fn processes_render_parts_of_the_same_picture() {
    let place = made("--spacing 0.5 --type f32");
    for look in [LOOKS[0], LOOKS[5], LOOKS[7]] {
        let look = format!("{look} {SIZE}");
        succeeds(&place, &format!("render v.mha --weights w.mha -o whole.png {look}"));
        let messages = in_processes(&place, 3, &look).join(" ");
        succeeds(&place, &format!("render v.ome.zarr -o p.png {look} --composite {messages} --json=p.json"));
        assert!(place.get("p.png") == place.get("whole.png"), "{look}: another picture");
        let numbers = place.json("p.json");
        assert_eq!((count(&numbers["pictures"][0]["parts"]), count(&numbers["reading"]["chunks_read"])), (3, 0));
        // In bands of rows, both the parts and the compositor.
        let bands = format!("{look} --max-memory 0.02");
        let messages = in_processes(&place, 3, &bands).join(" ");
        succeeds(&place, &format!("render v.ome.zarr -o p.png {bands} --composite {messages} --json=p.json"));
        assert!(place.get("p.png") == place.get("whole.png"), "{look}: another picture");
    }
}

#[test]
fn folded_messages_are_shorter_and_within_a_grey_level() {
    let place = made("--spacing 0.5 --type f32");
    for look in [LOOKS[0], LOOKS[3], LOOKS[4], LOOKS[5]] {
        let look = format!("{look} {SIZE} --arity 4");
        succeeds(&place, &format!("render v.ome.zarr -o whole.png {look}"));
        let length = |messages: &[String]| messages.iter().map(|name| place.get(name).len()).sum::<usize>();
        let whole = length(&in_processes(&place, 4, &look));
        let messages = in_processes(&place, 4, &format!("{look} --fold"));
        assert!(length(&messages) * 2 < whole, "{look}: {} of {whole} bytes", length(&messages));
        succeeds(&place, &format!("render v.ome.zarr -o p.png {look} --composite {}", messages.join(" ")));
        let [a, b] = ["p.png", "whole.png"].map(|name| image::open(place.path(name)).unwrap().to_rgb8());
        let off = a.iter().zip(b.iter()).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(off <= Some(1), "{look}: {off:?}");
    }
}

#[test]
fn killed_part_runs_again_to_the_same_bytes() {
    let place = made("--spacing 0.3 --type f32");
    let look = format!("{} --image-size 400x300", LOOKS[2]);
    let messages = in_processes(&place, 2, &look);
    let second = place.get("2.part");
    std::fs::remove_file(place.path("2.part")).unwrap();
    let mut command = crate::program();
    command.args(["render", "v.ome.zarr", "-o", "2.part", "--part", "2/2"]).args(look.split_whitespace());
    let mut child = command.current_dir(place.path(".")).stdout(Stdio::null()).spawn().unwrap();
    // It works for some time once it has begun its file.
    while child.try_wait().unwrap().is_none()
        && !std::fs::read_dir(place.path("."))
            .unwrap()
            .any(|entry| entry.unwrap().file_name().to_string_lossy().starts_with(".sonoweave-"))
    {
        std::thread::yield_now();
    }
    child.kill().unwrap();
    assert!(!child.wait().unwrap().success() && !place.path("2.part").exists(), "it was killed on its way");
    let composite = format!("render v.ome.zarr {look} --composite {}", messages.join(" "));
    refused(&place, &format!("{composite} -o refused.png"), 3, "2.part: opening failed");
    succeeds(&place, &format!("render v.ome.zarr {look} -o 2.part --part 2/2"));
    assert!(place.get("2.part") == second);
    succeeds(&place, &format!("{composite} -o p.png"));
    succeeds(&place, &format!("render v.ome.zarr {look} -o whole.png"));
    assert!(place.get("p.png") == place.get("whole.png"));
}

#[test]
fn wrong_mixed_and_damaged_messages_are_refused() {
    let place = made("--spacing 0.5 --type f32");
    let look = format!("--mode mip {SIZE}");
    in_processes(&place, 3, &look);
    let composite = |messages: &str| format!("render v.ome.zarr {look} -o refused.png --composite {messages}");
    refused(&place, &composite("1.part 3.part"), 3, "part 2/3 is missing; give the messages of all 3 parts");
    refused(&place, &composite("1.part 2.part 2.part 3.part"), 3, "are the same part 2");
    refused(&place, &composite("1.part s.mha 3.part"), 3, "s.mha: is no message of a part");
    let good = place.get("2.part");
    for (name, change) in [("cut", good.len() - 40), ("cut", good.len() - 1), ("cut", 100), ("cut", 0), ("bit", 500)] {
        let mut bytes = good.clone();
        match name {
            "cut" => bytes.truncate(change),
            _ => bytes[change] ^= 4,
        }
        place.put("x.part", bytes);
        let run = place.run(&composite("1.part x.part 3.part"));
        assert!(run.code == 3 && run.stderr.contains("x.part: is "), "{name} {change}: {}", run.stderr);
        assert!(!place.path("refused.png").exists());
    }
    // Other settings, another division, and another volume.
    for other in ["--mode average", "--mode mip --view 1,2", "--mode mip --window 0,100", "--mode mip --step 0.5"] {
        succeeds(&place, &format!("render v.ome.zarr -o x.part --part 2/3 {SIZE} {other}"));
        refused(&place, &composite("1.part x.part 3.part"), 3, "x.part: is of another picture");
    }
    succeeds(&place, &format!("render v.ome.zarr -o x.part --part 2/4 {look}"));
    refused(&place, &composite("1.part x.part 3.part"), 3, "of other numbers of parts");
    succeeds(&place, &format!("render v.ome.zarr -o x.part --part 2/3 {look} --fold"));
    refused(&place, &composite("1.part x.part 3.part"), 3, "only one is folded");
    place.does("reconstruct s.mha -o v.ome.zarr --spacing 0.5 --type f32 --sigma 0.4,0.4,0.4");
    refused(&place, &composite("1.part 2.part 3.part"), 3, "1.part: is of another picture");
}

#[test]
fn flags_of_parts_that_do_not_fit_are_refused() {
    let place = made("--spacing 0.5");
    let part = "render v.ome.zarr -o refused.part --part";
    for (words, text) in [
        (format!("{part} 4/3"), "must be K/N, with K from 1 to N"),
        (format!("{part} 1/900"), "give at most"),
        (format!("{part} 1/2 --mode slice"), "--part: does not apply to --mode slice"),
        (format!("{part} 1/2 --turntable 3"), "cannot be used with"),
        (format!("{part} 1/2 --parts 2"), "cannot be used with"),
        (format!("{part} 1/2 --adaptive 0.1"), "--adaptive: a picture in parts casts every ray"),
        ("render v.ome.zarr -o refused.png --part 1/2".into(), "--part writes a message"),
        ("render v.ome.zarr -o refused.png --fold".into(), "--part"),
        ("render v.mha -o refused.part --part 1/2".into(), "apply to OME-Zarr volumes"),
    ] {
        refused(&place, &words, 2, text);
    }
}
