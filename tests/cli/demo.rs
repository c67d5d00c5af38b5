//! `demo`: its files and settings, the order in which its devices start, and its console.

use std::fs::Permissions;
use std::net::TcpListener;
use std::os::unix::fs::PermissionsExt as _;
use std::process::Stdio;
use std::time::{Duration, Instant};

use serde_json::Value;

use super::place::Place;
use super::program;

/// Checks that the first frames were used: none came before a pose. At a session's end, the last
/// frame may lack the pose after it; on a busy machine, poses may lie too far apart at any time.
fn begins_together(stats: &Value) {
    assert!(stats["frames"]["used"].as_u64().unwrap() > 5, "{stats}");
    let is_late =
        |first: &Value| first["item"].as_u64().unwrap() > 5 || first["detail"].as_str().unwrap().ends_with(" ms apart");
    let refusals = stats["first_refusals"].as_object().unwrap();
    assert!(refusals.values().all(is_late), "{refusals:?}");
}

#[test]
fn demo_writes_its_outputs_begins_together_and_uses_the_seed() {
    let place = Place::new();
    let run = place.run("demo --duration 1.5 -o demo --seed 7 --headless");
    assert_eq!(run.code, 0, "{}", run.stderr);
    for name in ["bedside.toml", "picture.png", "statistics.json", "volume.mha"] {
        assert!(place.path("demo").join(name).is_file(), "{name}");
    }
    let stats = place.json("demo/statistics.json");
    assert_eq!(stats["config"]["virtual.seed"], 7);
    begins_together(&stats);
}

#[test]
fn demo_with_arm_takes_planar_path_by_itself() {
    let place = Place::new();
    let run = place.run("demo --arm --duration 5 -o demo --seed 7 --headless");
    assert_eq!(run.code, 0, "{}", run.stderr);
    assert!(!run.stderr.contains("not homed"), "{}", run.stderr);
    let stats = place.json("demo/statistics.json");
    assert_eq!((&stats["path"], &stats["config"]["virtual.seed"]), (&"planar".into(), &7.into()));
    assert!(stats["pictures"].as_u64() > Some(0), "{stats}");
    begins_together(&stats);
}

#[test]
fn console_takes_next_port_and_opens_in_browser() {
    let place = Place::new();
    place.put("xdg-open", "#!/bin/sh\necho \"$1\" > opened.part && mv opened.part opened\n");
    std::fs::set_permissions(place.path("xdg-open"), Permissions::from_mode(0o755)).unwrap();
    // Another program may have the port, too.
    let taken = TcpListener::bind("127.0.0.1:9110");
    let demo = |display: &str| {
        let mut command = program();
        let path = format!("{}:{}", place.path(".").display(), std::env::var("PATH").unwrap());
        command.args(["demo", "--duration", "1", "--headless", "--open"]).env("PATH", path);
        place.output(command.env("DISPLAY", display).env_remove("WAYLAND_DISPLAY"))
    };
    let run = demo("");
    assert_eq!(run.code, 0, "{}", run.stderr);
    let says = |run: &str| run.split_once("console: ").map(|(_, rest)| rest.lines().next().unwrap().to_owned());
    let url = says(&run.stderr).unwrap();
    assert!(run.stderr.contains("port 9110 is in use") && !url.contains(":9110/"), "{}", run.stderr);
    assert!(run.stderr.contains(&format!("there is no display here; open {url} in a browser")), "{}", run.stderr);
    assert!(!place.path("opened").exists());
    // Other tests' programs take ports beside it: which one is free may have changed.
    let run = demo(":0");
    assert_eq!(run.code, 0, "{}", run.stderr);
    let url = says(&run.stderr).unwrap();
    assert!(!url.contains(":9110/"), "{}", run.stderr);
    assert_eq!(String::from_utf8(place.get("opened")).unwrap().trim(), url);
    drop(taken);
}

#[test]
fn session_ends_though_standard_error_is_closed() {
    let place = Place::new();
    let mut command = program();
    command.args(["demo", "--duration", "2.5", "-o", "demo", "--headless", "-vv"]).current_dir(place.path(""));
    let mut demo = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    drop(demo.stderr.take());
    let begun = Instant::now();
    let ended = loop {
        if let Some(ended) = demo.try_wait().unwrap() {
            break ended;
        }
        if begun.elapsed() > Duration::from_secs(120) {
            demo.kill().unwrap();
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    assert_eq!(ended.code(), Some(0));
    begins_together(&place.json("demo/statistics.json"));
}
