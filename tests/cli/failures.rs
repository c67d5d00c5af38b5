//! Exit codes of commands, by the kind of their failure.

use super::place::Place;
use super::sequence::Sequence;

/// Runs a command that fails, and returns its exit code.
fn code(place: &Place, words: &str) -> i32 {
    let run = place.run(words);
    assert!(run.stderr.starts_with("sonoweave: ") || run.code == 2, "{words}: {}", run.stderr);
    run.code
}

#[test]
fn exit_code_is_that_of_the_failures_kind() {
    let place = Place::new();
    place.put("s.mha", Sequence::default().bytes());
    let whole = Sequence::default().bytes();
    place.put("cut.mha", &whole[..whole.len() - 100]);
    place.put("text.mha", "a text");
    place.put("far.mha", Sequence { status: |_| "INVALID", ..Sequence::default() }.bytes());
    place.put("probe.mha", Sequence { transform: "ProbeToReference", ..Sequence::default() }.bytes());
    place.put("bad.xml", "<PlusConfiguration");
    place.put("file", "no folder");
    let cases = [
        ("s.mha -o v.mha --spacing x", 2),
        ("s.mha -o v.mha --max-memory 0", 2),
        ("s.mha -o v.mha --fill-radius 2 --fill nearest --clip none --spacing 5", 2),
        ("s.mha -o s.mha", 2),
        ("s.mha -o v.jpg", 2),
        ("none.mha -o v.mha", 3),
        ("cut.mha -o v.mha --clip none", 3),
        ("text.mha -o v.mha", 3),
        ("probe.mha -o v.mha", 4),
        ("s.mha -o v.mha --config none.toml", 4),
        ("s.mha -o v.mha --config bad.xml", 4),
        ("s.mha -o v.mha --clip 100,100,5,5", 4),
        ("far.mha -o v.mha --clip none", 5),
        ("s.mha -o v.mha --frames 90..", 5),
        ("s.mha -o v.mha --clip none --max-memory 0.00001", 6),
        ("s.mha -o none/v.mha", 7),
        ("s.mha -o file/v.mha", 7),
    ];
    let before = place.names();
    for (words, expected) in cases {
        assert_eq!(code(&place, &format!("reconstruct {words}")), expected, "{words}");
        assert_eq!(place.names(), before, "{words}");
    }
    std::fs::create_dir(place.path("out")).unwrap();
    assert_eq!(code(&place, "reconstruct s.mha text.mha -o out --clip none"), 10, "some sweeps failed");
    place.put("volume.mha", place.get("out/s.mha"));
    assert_eq!(code(&place, "render none.mha -o p.png"), 3);
    assert_eq!(code(&place, "inspect text.mha"), 3);
    assert_eq!(code(&place, "convert s.mha -o none/c.mha"), 7);
    assert_eq!(code(&place, "man nothing"), 1);
}

#[test]
fn help_and_manual_list_exit_codes() {
    let place = Place::new();
    for words in ["--help", "man"] {
        let text = place.does(words);
        assert!(text.contains("Exit codes:") && text.contains("the memory limit"), "{words}: {text}");
    }
    assert!(!place.does("-h").contains("Exit codes"));
}
