//! Tests of session configurations.

mod documents;
mod presets;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use proptest::prelude::*;
use serde_json::json;

use calibration::file::{CalibrationFile, Latency};
use drivers::OpenSettings;
use drivers::tracker::polhemus::{Model, Port};
use mask::Clip;
use reconstruct::path_choice::PathChoice;
use reconstruct::{Compounding, Decay};
use sonoweave_core::date::Date;
use sonoweave_core::frames::Transform;

use super::*;

/// Example configurations of the project, by name.
const EXAMPLES: [(&str, &str); 6] = [
    ("arm.toml", include_str!("../../../../docs/examples/arm.toml")),
    ("fastrak.toml", include_str!("../../../../docs/examples/fastrak.toml")),
    ("liberty.toml", include_str!("../../../../docs/examples/liberty.toml")),
    ("plus-server.toml", include_str!("../../../../docs/examples/plus-server.toml")),
    ("virtual-arm.toml", include_str!("../../../../docs/examples/virtual-arm.toml")),
    ("virtual.toml", include_str!("../../../../docs/examples/virtual.toml")),
];

fn example_path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/examples").join(name)
}

fn example(name: &str) -> Bedside {
    Bedside::read(&example_path(name)).unwrap_or_else(|e| panic!("{e}"))
}

const LEAST: &str = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\n";

fn parse(text: &str) -> Result<Bedside, String> {
    Bedside::parse(Path::new("bed.toml"), text).map_err(|e| e.to_string())
}

/// Parses the minimal configuration with more text appended.
fn with(more: &str) -> Result<Bedside, String> {
    parse(&format!("{LEAST}{more}"))
}

/// Returns a text's keys by section. For each key that is commented out, also returns the text
/// with that key enabled.
fn keys_of(text: &str) -> (BTreeSet<String>, Vec<(String, String)>) {
    let mut section = String::new();
    // Section and key of each line, if it has one.
    let mut lines = Vec::new();
    for line in text.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|rest| rest.split(']').next()) {
            section = name.to_owned();
        }
        let bare = line.strip_prefix('#').unwrap_or(line);
        let name: String = bare.chars().take_while(|c| c.is_ascii_lowercase() || *c == '_').collect();
        let is_key = !name.is_empty() && bare[name.len()..].starts_with(" = ");
        lines.push((line, bare, is_key.then(|| format!("{section}.{name}"))));
    }
    let commented = lines.iter().enumerate().filter_map(|(at, (line, bare, key))| {
        let key = key.as_ref().filter(|_| line.starts_with('#'))?;
        // The alternative that it replaces is left out.
        let others = lines.iter().enumerate().filter(|(n, (_, _, other))| *n == at || other.as_ref() != Some(key));
        let others = others.map(|(n, (line, _, _))| if n == at { *bare } else { *line });
        Some((key.clone(), others.collect::<Vec<_>>().join("\n")))
    });
    (lines.iter().filter_map(|(_, _, key)| key.clone()).collect(), commented.collect())
}

#[test]
fn examples_parse_and_cover_every_key() {
    let mut shown = BTreeSet::new();
    for (name, text) in EXAMPLES {
        let bedside = example(name);
        assert_eq!((bedside.kind, bedside.notes.as_slice()), (Kind::Bedside, [].as_slice()), "{name}");
        let (keys, commented) = keys_of(text);
        for (key, text) in commented {
            let read = Bedside::parse(&example_path(name), &text);
            match read {
                Ok(_) => {}
                // They belong to another arm, to another commented key, and to other scenes.
                Err(e) => assert!(
                    [
                        ("arm.encoders", "microscribe"),
                        ("virtual.stylus", "there is no stylus"),
                        ("virtual.pressure_mm", "simulated echoes"),
                    ]
                    .iter()
                    .any(|(of, why)| key == *of && e.to_string().contains(why)),
                    "{name}: {key}: {e}"
                ),
            }
        }
        shown.extend(keys);
    }
    for section in schema::SECTIONS.iter() {
        for key in &section.keys {
            assert!(shown.contains(&format!("{}.{}", section.name, key.name)), "{}.{}", section.name, key.name);
            assert!(!key.about.is_empty() && !key.takes.is_empty(), "{}", key.name);
        }
    }
}

#[test]
fn reader_reads_exactly_schema_keys() {
    let mut read: BTreeSet<String> = example("virtual.toml").effective.into_keys().collect();
    read.extend(example("arm.toml").effective.into_keys());
    read.extend(example("plus-server.toml").effective.into_keys());
    let sections = schema::SECTIONS.iter();
    let known = sections.flat_map(|section| section.keys.iter().map(|key| format!("{}.{}", section.name, key.name)));
    assert_eq!(read, known.collect());
}

#[test]
fn examples_give_device_settings() {
    let fastrak = example("fastrak.toml");
    let Tracking::Tracker(tracker) = &fastrak.tracking else { panic!("a tracker") };
    let Some(Port::Serial { path, baud: Some(115_200) }) = &tracker.port else { panic!("{:?}", tracker.port) };
    assert!(path.starts_with("/dev/serial/by-id"));
    assert_eq!((tracker.model, tracker.settings.stations.as_slice()), (Model::Fastrak, [1, 2].as_slice()));
    assert_eq!((tracker.roles.frame(2), tracker.roles.frame(3)), (Some("Reference"), None));
    let opened = tracker.open_settings(Port::Usb(None), true);
    assert!(
        matches!(opened, OpenSettings::Tracker(settings) if settings.keeps_raw && settings.port == Port::Usb(None))
    );
    assert_eq!(fastrak.grabber.latency_ns, 40_000_000);
    assert_eq!(fastrak.record.keep_free_bytes, 2_048_000_000);
    assert_eq!(fastrak.status.listen.unwrap().port(), 9110);
    assert_eq!(fastrak.status.access, Access::default());
    let others = with(
        "[status]\nlisten = \"0.0.0.0:9110\"\ntoken_file = \"t\"\nmetrics_token_file = \"m\"\nnames = [\"Bedside-3\", \"192.0.2.1\", \"::1\"]\n",
    )
    .unwrap();
    assert_eq!(others.status.access.token_file.as_deref(), Some(Path::new("t")), "from the file's folder");
    assert_eq!(others.status.access.metrics_token_file.as_deref(), Some(Path::new("m")));
    assert_eq!(others.status.access.names, ["bedside-3", "192.0.2.1", "::1"]);
    // The calibration file's resolution across the plane is the default.
    let across = fastrak.volume.settings.sigma_mm[2].unwrap();
    assert!((across - 1.1 / 1.177_41).abs() < 1e-4, "{across}");
    assert!(matches!(fastrak.mask.clip, Clip::Rect(rect) if rect.width == 480));
    assert_eq!(pixel_mm(&fastrak.calibration), Some([0.2, 0.2]));

    let liberty = example("liberty.toml");
    let Tracking::Tracker(tracker) = &liberty.tracking else { panic!("a tracker") };
    assert_eq!((&tracker.port, tracker.settings.hemisphere), (&Some(Port::Usb(None)), [0.0; 3]));
    let decay = Decay::DeadTime { rate_per_s: 1.0, wait_s: 2.0 };
    assert_eq!(liberty.volume.settings.compounding, Compounding::Decay(decay));
    assert_eq!(liberty.pairing, Pairing { wait_ns: 150_000_000, longest_gap_ns: 50_000_000, smoothing: None });

    let arm = example("arm.toml");
    let Tracking::Arm(own) = &arm.tracking else { panic!("an arm") };
    assert_eq!((own.kind, own.lines()), (ArmKind::Ea1(drivers::arm::ea1::SampleFormat::Lines), 1));
    assert!(arm.calibration.arm.is_some(), "its joints are the calibration file's");
    assert_eq!(arm.tracking.names(), [("Probe".to_owned(), "Tracker".to_owned())]);
    assert_eq!(arm.volume.path, PathChoice::Planar);

    let simulated = example("virtual.toml");
    let virtual_bedside = simulated.virtual_bedside.unwrap();
    assert_eq!((virtual_bedside.scan.settings().image_size, virtual_bedside.rate_hz), ([640, 480], 30.0));
    assert_eq!(virtual_bedside.grabber.latency_ns, 40_000_000);
    assert_eq!(simulated.calibration.transforms[0].name(), "ImageToProbe", "its own");
    assert!(simulated.mask.fan.is_some(), "the scanner's field");
}

#[test]
fn errors_name_file_line_key_and_valid_values() {
    let cases = [
        ("[grabber]\n", "bed.toml: line 9: "),
        (
            "[picture]\nmode = \"mipp\"\n",
            "bed.toml: picture.mode (line 10): \"mipp\" is none of shaded, mip, average, iso and opacity",
        ),
        ("[picture]\nmodes = 1\n", "bed.toml: picture.modes (line 10): unknown key; did you mean mode?"),
        ("[volum]\n", "bed.toml: volum (line 9): unknown key; did you mean volume?"),
        ("[virtual.lines]\n", "bed.toml: virtual.lines (line 9): unknown key; did you mean line?"),
        (
            "[virtual.line]\njitter = 3\n",
            "bed.toml: virtual.line.jitter (line 10): unknown key; did you mean jitter_ms?",
        ),
        ("[volume]\nspacing_mm = 0\n", "volume.spacing_mm (line 10): must be positive, in mm"),
        ("[volume]\nspacing_mm = [1, 2]\n", "volume.spacing_mm (line 10): must hold 3 numbers, not 2"),
        (
            "[volume]\nspacing_mm = true\n",
            "volume.spacing_mm (line 10): must be a number or [x, y, z], not true or false",
        ),
        (
            "[volume]\nsupport = \"width=3\"\n",
            "volume.support (line 10): must be energy=E, amplitude=E, gradient=E or peak=E",
        ),
        (
            "[volume]\nsigma_mm = [1,1,1]\nhwhm_mm = [1,1,1]\n",
            "volume.sigma_mm (line 10): the kernel's width is given twice",
        ),
        (
            "[volume]\nmethod = \"bspline3\"\nsupport = \"peak=0.1\"\n",
            "volume.support (line 11): the kernel bspline3 has a fixed support",
        ),
        (
            "[volume]\ncompound = \"mean\"\ndecay_per_s = 2\n",
            "volume.decay_per_s (line 11): needs the compounding decay",
        ),
        (
            "[volume]\ncompound = \"decay\"\ndecay = \"exp\"\ndecay_wait_s = 2\n",
            "volume.decay_wait_s (line 12): has no effect",
        ),
        (
            "[volume]\npath = \"planar\"\nmethod = \"linear\"\n",
            "volume.path (line 10): the planar path does not support the kernel linear",
        ),
        (
            "[volume]\nmax_memory_gib = 0\n",
            "volume.max_memory_gib (line 10): must lie above 0 and not above 1000000, not at 0",
        ),
        ("[volume]\nthreads = 0\n", "volume.threads (line 10): must lie between 1 and 1024, not at 0"),
        ("[picture]\nstop = 1.5\n", "picture.stop (line 10): must lie between 0 and 1, not at 1.5"),
        (
            "[picture]\nmode = \"mip\"\nambient = 0.5\n",
            "picture.ambient (line 11): has no effect in the mode mip, which uses no light",
        ),
        ("[picture]\nisovalue = 80\n", "picture.isovalue (line 10): has no effect in the mode shaded"),
        ("[picture]\ntransfer = \"muscle\"\n", "picture.transfer (line 10): no transfer function is called \"muscle\""),
        (
            "[picture]\ndraw = [\"none\"]\n",
            "picture.draw[0] (line 10): \"none\" is none of slice, probe, scale and cube",
        ),
        ("[picture]\ndepth_cue = [0.2, 0.5]\n", "picture.depth_cue (line 10): "),
        ("[record]\nfull_frame = \"yes\"\n", "record.full_frame (line 10): must be true or false, not a text"),
        ("[process]\nrealtime = true\n", "process.realtime (line 10): must be a text, not true or false"),
        (
            "[process]\nrealtime = \"yes\"\n",
            "process.realtime (line 10): \"yes\" is none of if-permitted, never and required",
        ),
        (
            "[status]\nnames = [\"a.b\", \"b:80\"]\n",
            "\"b:80\" is not a machine's name; give the name in the browser's address, without a port",
        ),
        (
            "[status]\nlisten = \"9110\"\n",
            "status.listen (line 10): \"9110\" is not an address with a port; give one, such as \"127.0.0.1:9110\"",
        ),
        ("[scanner]\nfrozen_s = 0\n", "scanner.frozen_s (line 10): must lie between 0.05 and 60, not at 0"),
        ("[pairing]\nwait_ms = -1\n", "pairing.wait_ms (line 10): must lie between 0 and 10000, not at -1"),
        ("[virtual]\nscene = \"cat\"\n", "virtual.scene (line 10): \"cat\" is none of constant, ramp, blobs"),
        ("[virtual]\ntrajectory = \"fan\"\ngap_mm = 5\n", "[virtual] (line 9): the fan would turn"),
        (
            "[calibration]\nfile = \"gone.toml\"\n",
            "calibration.file (line 10): names gone.toml, but reading failed: No such file",
        ),
        (
            "[calibration]\nimage_to_probe = [1, 2]\n",
            "calibration.image_to_probe (line 10): must hold 16 numbers, not 2",
        ),
        ("[calibration]\nclip_px = [1, 2, 3]\n", "calibration.clip_px (line 10): must hold 4 whole numbers, not 3"),
        ("[calibration]\nclip_px = \"all\"\n", "calibration.clip_px (line 10): \"all\" must be auto, none"),
        (
            "[calibration]\nfan = { origin_px = [0, 0], radii_px = [5, 2], angles_deg = [-1, 1] }\n",
            "calibration.fan (line 10): a fan's radii must grow",
        ),
        ("[arm]\nkind = \"ea1\"\n", "arm (line 9): [tracker] is there too"),
    ];
    for (more, expected) in cases {
        let error = with(more).err().unwrap_or_else(|| panic!("{more} was read"));
        assert!(error.contains(expected), "{more}\n{error}");
    }
}

#[test]
fn impossible_devices_refused_by_key() {
    let head = "format = \"sonoweave-bedside\"\nversion = 1\n";
    let grabber = "[grabber]\ndevice = \"virtual\"\n";
    let cases = [
        ("", "[tracker] (line 1): neither [tracker] nor [arm] nor [remote] is there"),
        ("[tracker]\n", "tracker.model (line 3): is missing: give isotrak, fastrak, liberty, patriot or viper"),
        ("[tracker]\nmodel = \"aurora\"\n", "tracker.model (line 4): \"aurora\" is none of isotrak, fastrak"),
        ("[tracker]\nmodel = \"viper\"\n", "tracker.port (line 3): is missing: give a serial line's path, \"usb\""),
        (
            "[tracker]\nmodel = \"viper\"\nport = \"COM3\"\n",
            "tracker.port (line 5): \"COM3\" is not a port: give a serial line's path",
        ),
        (
            "[tracker]\nmodel = \"viper\"\nport = \"usb\"\nbaud = 9600\n",
            "tracker.baud (line 6): applies to serial lines only",
        ),
        (
            "[tracker]\nmodel = \"viper\"\nport = \"usb\"\nbinary = false\n",
            "tracker.binary (line 6): VIPER has no text",
        ),
        (
            "[tracker]\nmodel = \"fastrak\"\nport = \"usb\"\nprobe_station = 7\n",
            "tracker.probe_station (line 6): [7] are not stations of this unit",
        ),
        (
            "[tracker]\nmodel = \"fastrak\"\nport = \"usb\"\nreference_station = 1\n",
            "tracker.reference_station (line 6): station 1 belongs to another sensor",
        ),
        (
            "[tracker]\nmodel = \"fastrak\"\nport = \"usb\"\nhemisphere = \"up\"\n",
            "tracker.hemisphere (line 6): \"up\" is not a direction",
        ),
        (
            "[tracker]\nmodel = \"fastrak\"\nport = \"usb\"\nlatency_ms = 5000\n",
            "tracker.latency_ms (line 6): must lie between -1000 and 1000, not at 5000",
        ),
        (
            "[arm]\nkind = \"qsb\"\nport = \"/dev/ttyUSB0\"\n",
            "arm.port (line 5): this arm has 3 lines, base first, not 1",
        ),
        ("[arm]\nkind = \"ea1\"\nport = [\"/dev/a\", \"/dev/b\"]\n", "arm.port (line 5): this arm has one line, not 2"),
        (
            "[arm]\nkind = \"qsb\"\nport = [\"/dev/a\", \"b\", \"/dev/c\"]\n",
            "arm.port[1] (line 5): \"b\" is not a serial line's path",
        ),
        (
            "[arm]\nkind = \"lines\"\nport = \"/dev/a\"\nblocks = true\n",
            "arm.blocks (line 6): applies to kind = \"ea1\" only",
        ),
        (
            "[arm]\nkind = \"ea1\"\nport = \"/dev/a\"\nencoders = 5\n",
            "arm.encoders (line 6): applies to kind = \"microscribe\"",
        ),
        ("[arm]\nkind = \"immersion\"\nport = \"/dev/a\"\nencoders = 3\n", "arm.encoders (line 6): 3 is not possible"),
        (
            "[arm]\nkind = \"microscribe\"\nport = \"/dev/a\"\nbaud = 4800\n",
            "arm.baud (line 6): a MicroScribe does not have the rate 4800",
        ),
        ("[arm]\nkind = \"ea1\"\nport = \"/dev/a\"\nfastest_counts_per_s = 5\n", "arm.fastest_counts_per_s (line 6): "),
    ];
    for (device, expected) in cases {
        let error = parse(&format!("{head}{device}{grabber}")).err().unwrap_or_else(|| panic!("{device} was read"));
        assert!(error.contains(expected), "{device}\n{error}");
    }
    let tracker = "[tracker]\nmodel = \"fastrak\"\nport = \"usb\"\n";
    let cases = [
        ("", "[grabber] (line 1): [grabber] is missing"),
        ("[grabber]\nsize = \"1x1\"\n", "grabber.device (line 6): is missing: give a video node, a grabber's name"),
        (
            "[grabber]\ndevice = \"/dev/video0\"\nsize = \"big\"\n",
            "grabber.size (line 8): must be WxH, two positive whole numbers",
        ),
        (
            "[grabber]\ndevice = \"/dev/video0\"\nformat = \"H264\"\n",
            "grabber.format (line 8): the format \"H264\" cannot be read; give one of GREY, ",
        ),
        (
            "[grabber]\ndevice = \"/dev/video0\"\nbuffers = 1\n",
            "grabber.buffers (line 8): must lie between 2 and 32, not at 1",
        ),
        (
            "[grabber]\ndevice = \"/dev/video0\"\norientation = \"XY\"\n",
            "grabber.orientation (line 8): \"XY\" is none of MF, MN",
        ),
    ];
    for (device, expected) in cases {
        let error = parse(&format!("{head}{tracker}{device}")).err().unwrap_or_else(|| panic!("{device} was read"));
        assert!(error.contains(expected), "{device}\n{error}");
    }
    // Calibration runs without a transform from image to probe; reconstruction does not.
    let text = format!("{head}{tracker}[grabber]\ndevice = \"/dev/video0\"\n");
    let bedside = Bedside::parse(Path::new("bedside.toml"), &text).unwrap();
    let missing = bedside.calibrated().unwrap_err().to_string();
    assert!(
        missing.contains("[calibration] (line 1): is missing: give file = \"…\" with a calibration file"),
        "{missing}"
    );
}

#[test]
fn other_file_kind_recognised_by_content() {
    let calibration = "format = \"sonoweave-calibration\"\nversion = 1\n";
    let message = parse(calibration).unwrap_err();
    assert!(
        message.starts_with("bed.toml: is a calibration file") && message.contains("file = \"bed.toml\""),
        "{message}"
    );
    let message = Settings::parse(Path::new("x.toml"), LEAST, None).unwrap_err().to_string();
    assert!(
        message.starts_with("x.toml: is a session configuration, for `live`; a calibration is wanted"),
        "{message}"
    );
    assert!(parse("").unwrap_err().contains("bed.toml: format (line 1): is missing"));
    assert!(parse("colour = 1\n").unwrap_err().contains("format (line 1): is missing"));
    assert!(parse("format = \"other\"\n").unwrap_err().contains("must be \"sonoweave-bedside\""));
    assert!(parse("format = \"sonoweave-bedside\"\nversion = 2\n").unwrap_err().contains("version 2 is newer"));
    assert!(parse("format = ").unwrap_err().starts_with("bed.toml: line 1: "));
}

#[test]
fn changes_split_at_once_from_next_session() {
    let before = with("[picture]\nmode = \"mip\"\n").unwrap();
    assert!(before.changes(&before.clone()).is_empty());
    // The same values in another notation.
    assert!(
        before
            .changes(&with("[picture]\nmode = \"mip\"\nimage_size = [512, 512]\n[pairing]\nwait_ms = 500\n").unwrap())
            .is_empty()
    );
    let text = LEAST.replace("device", "latency_ms = 12.5\ndevice");
    let more = "[picture]\nmode = \"average\"\n[volume]\nspacing_mm = 0.4\n[record]\nkeep_free_mb = 5\nfolder = \"r\"\n[scanner]\nfrozen_s = 1\n";
    let after = parse(&format!("{text}{more}")).unwrap();
    let changes = before.changes(&after);
    let keys = |changes: &[Change]| changes.iter().map(|change| change.key.clone()).collect::<Vec<_>>();
    assert_eq!(
        keys(&changes.at_once),
        ["grabber.latency_ms", "picture.mode", "record.keep_free_mb", "scanner.frozen_s"]
    );
    assert_eq!(keys(&changes.next_session), ["record.folder", "volume.spacing_mm"]);
    assert_eq!(changes.at_once[1].to_string(), "picture.mode: \"mip\" → \"average\"");
    assert_eq!(changes.next_session[0].to_string(), "record.folder: nothing said → \"r\"");
    let mut running = before.clone();
    running.adopt(&after);
    assert_eq!((running.grabber.latency_ns, running.record.keep_free_bytes), (12_500_000, 5_000_000));
    assert_eq!((running.picture.view.mode, running.scanner), (after.picture.view.mode, after.scanner));
    assert_eq!((running.volume.settings.spacing_mm, running.record.folder.clone()), (DVec3::splat(0.5), None));
    let left = running.changes(&after);
    assert!(left.at_once.is_empty() && left.next_session == changes.next_session, "{left:?}");
}

#[test]
fn new_device_or_calibration_waits_for_next_session() {
    let tracker = example("virtual.toml");
    let arm = example("arm.toml");
    let changes = tracker.changes(&arm);
    assert!(changes.next_session.iter().any(|c| c.key == "arm.kind"), "{changes:?}");
    assert!(
        changes.at_once.iter().all(|c| !c.key.starts_with("arm.") && !c.key.starts_with("tracker.")),
        "{changes:?}"
    );
    let mut anew = arm.clone();
    anew.calibration.transforms[0].affine.translation.x += 1.0;
    let changes = arm.changes(&anew);
    assert_eq!((changes.at_once.len(), changes.next_session[0].key.as_str()), (0, "calibration.file"));
}

#[test]
fn effective_contains_given_and_default_values() {
    let bedside = with("[picture]\nview_deg = [30, -20]\n").unwrap();
    let held = |key: &str| &bedside.effective[key];
    assert_eq!((held("picture.view_deg"), held("picture.mode")), (&json!("30,-20"), &json!("shaded")));
    assert_eq!((held("volume.spacing_mm"), held("picture.perspective_deg")), (&json!([0.5, 0.5, 0.5]), &json!(null)));
    assert_eq!(bedside.picture.settings(None).unwrap().size, [512, 512]);
    assert_eq!(bedside.picture.view.view, Some([30.0, -20.0, 0.0]));
}

proptest! {
    #[test]
    fn any_text_parses_without_panic(text in "\\PC{0,80}", at in 0_usize..900) {
        let _ = with(&text);
        let whole = EXAMPLES[3].1;
        let at = (at..whole.len()).find(|at| whole.is_char_boundary(*at)).unwrap_or(whole.len());
        let _ = parse(&format!("{}{text}{}", &whole[..at], &whole[at..]));
    }
}
