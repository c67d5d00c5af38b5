//! The command line as shells and terminals see it: help, completions, manual, version, colours,
//! and flags of earlier versions.

use std::process::Command;

use serde_json::Value;

use super::place::Place;

/// Most lines of the short help of a command.
const SHORT: usize = 60;

#[test]
fn pipes_get_no_escape_sequences() {
    let place = Place::new();
    // The log has a line at this level, and clap an error with styles.
    let help = place.run("replay --help");
    let wrong = place.run("replay --wrong");
    place.does("phantom -o s.mha --image-size 40x30 --frames 8");
    let logged = place.run("reconstruct s.mha -o v.mha -vv");
    assert_eq!((help.code, wrong.code, logged.code), (0, 2, 0));
    assert!(logged.stderr.contains("INFO") || logged.stderr.contains("DEBUG"), "{}", logged.stderr);
    for text in [help.stdout, wrong.stderr, logged.stdout, logged.stderr] {
        assert!(!text.contains('\u{1b}'), "{text:?}");
    }
}

#[test]
fn terminals_have_colours_unless_no_color_is_set() {
    let place = Place::new();
    let program = crate::program().get_program().to_str().unwrap().to_owned();
    // `script` gives the program a terminal, of which standard output is a copy.
    let in_terminal = |name: &str, value: &str| {
        let session = format!("stty rows 40 cols 100; exec {program} demo -vv --duration 0.5 -o {name}");
        let mut command = Command::new("script");
        command.args(["-qec", &session, "/dev/null"]).env("TERM", "xterm").env("NO_COLOR", value);
        let run = place.output(&mut command);
        assert!(run.code == 0 && run.stdout.contains("INFO"), "{}", run.stdout);
        // Sequences of colours end with an m, those that move the cursor do not.
        let sequences: Vec<&str> = run.stdout.split("\u{1b}[").skip(1).collect();
        let colours = |text: &&&str| text.trim_start_matches(|c: char| c.is_ascii_digit() || c == ';').starts_with('m');
        sequences.iter().filter(colours).count()
    };
    // An empty value counts as none.
    assert!(in_terminal("coloured", "") > 2);
    assert_eq!(in_terminal("plain", "1"), 0);
}

#[test]
fn log_filter_is_checked_before_work() {
    let place = Place::new();
    place.refuses("devices --log bogus", &["--log bogus: ", "give error, warn, info"]);
    place.does("devices --log warn,drivers=debug");
    let run = place.run("devices -v -q");
    assert_eq!(run.code, 2, "{}", run.stderr);
}

#[test]
fn short_help_is_short_and_long_help_has_examples() {
    let place = Place::new();
    let plain = ["reconstruct", "render", "replay", "animate", "live", "phantom", "twin", "init", "doctor"];
    let calibrate = ["probe", "latency", "pivot", "arm", "landmarks", "tracker"].map(|of| format!("calibrate {of}"));
    for command in plain.map(str::to_owned).into_iter().chain(calibrate) {
        let (short, long) = (place.does(&format!("{command} -h")), place.does(&format!("{command} --help")));
        assert!(short.lines().count() <= SHORT, "{command}: {} lines", short.lines().count());
        assert!(long.contains("Example") && !short.contains("Example"), "{command}");
        assert!(short.contains("--quiet") && long.contains("--trace"), "{command}");
    }
}

#[test]
fn completions_and_pages_go_to_stdout_or_files() {
    let place = Place::new();
    let bash = place.does("completions bash");
    place.does("completions bash -o c");
    assert_eq!(place.get("c"), bash.as_bytes());
    assert!(bash.contains("animate"), "{bash}");
    let live = place.does("man live");
    place.does("man --all -o pages");
    assert_eq!(place.get("pages/sonoweave-live.1"), live.as_bytes());
    assert!(live.starts_with(".ie") || live.contains(".TH"), "{live}");
    assert!(
        place.path("pages/sonoweave-bedside.5").exists() && place.path("pages/sonoweave-calibrate-probe.1").exists()
    );
    let unknown = place.run("man nothing");
    assert!(unknown.code == 1 && unknown.stderr.contains("nothing: has no page; give one of"), "{}", unknown.stderr);
}

#[test]
fn version_names_commit_and_instruction_sets() {
    let place = Place::new();
    let (short, long) = (place.does("-V"), place.does("--version"));
    assert_eq!(short, format!("sonoweave {}\n", env!("CARGO_PKG_VERSION")));
    assert!(long.starts_with(short.trim_end()), "{long}");
    for line in ["\ncommit: ", "\nfeatures: ", "\ninstruction sets: ", "portable"] {
        assert!(long.contains(line), "{long}");
    }
}

#[test]
fn earlier_flags_name_present_ones() {
    let place = Place::new();
    for (words, advice) in [
        ("live --volume v.mha", "--volume: was renamed; use -o"),
        ("reconstruct s.mha --stats s.json", "--stats: was renamed; use --json=FILE"),
        ("demo --out d", "--out: was renamed; use -o"),
        ("inspect s.mcap --repair w.mcap", "sonoweave repair SESSION -o OUTPUT"),
        ("calibrate pivot --report r.json", "--report: was renamed; use --json=FILE"),
        ("convert a.mha b.mha", "sonoweave convert INPUT -o OUTPUT"),
        ("dicom a.mha b.dcm", "sonoweave dicom INPUT -o OUTPUT"),
    ] {
        let run = place.run(words);
        assert!(run.code == 2 && run.stderr.contains(advice), "{words}: {}", run.stderr);
    }
}

#[test]
fn json_is_one_document_or_a_file_beside_text() {
    let place = Place::new();
    let document = |words: &str| -> Value {
        let out = place.run(words).stdout;
        serde_json::from_str(&out).unwrap_or_else(|e| panic!("{words}: {e}: {out}"))
    };
    let phantom = "phantom -o s.mha --frames 8 --image-size 40x30 --pixel 0.5 --gap 0.6";
    assert_eq!(document(&format!("{phantom} --json"))["output"], "s.mha");
    let reconstruct = "reconstruct s.mha -o v.mha --clip none";
    let printed = document(&format!("{reconstruct} --json"));
    let text = place.does(&format!("{reconstruct} --json=r.json"));
    assert!(text.contains("v.mha: "), "{text}");
    assert_eq!(place.json("r.json")["input_sha256"], printed["input_sha256"]);
    std::fs::create_dir(place.path("out")).unwrap();
    place.put("t.mha", place.get("s.mha"));
    let both = document("reconstruct s.mha t.mha -o out --clip none --json");
    assert_eq!(both.as_array().unwrap().len(), 2);
    let drawing = "--image-size 20x20";
    assert_eq!(document(&format!("render v.mha -o p.png {drawing} --json"))["pictures"][0]["path"], "p.png");
    assert!(document(&format!("animate s.mha --clip none --picture q.png {drawing} --json"))["grid"].is_object());
    assert_eq!(document("convert s.mha -o c.nrrd --json")["output"], "c.nrrd");
    assert_eq!(document("dicom s.mha -o c.dcm --json")["output"], "c.dcm");
    assert_eq!(document("inspect v.mha --json")["kind"], "volume");
    assert!(document("compare v.mha v.mha --json").is_object());
    assert!(document("devices --json").is_array());
}
