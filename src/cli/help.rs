//! Help in groups: `-h` shows the usual flags of a command, `--help` all of them under headings.

/// Commands with many flags, and those that `-h` shows. Commands without an entry show all.
const USUAL: &[(&str, &[&str])] = &[
    (
        "reconstruct",
        &[
            "output", "config", "preset", "world", "spacing", "clip", "type", "window", "weights", "planes", "json",
            "fill",
        ],
    ),
    ("render", &["output", "weights", "window", "turntable", "json", "image-size", "view", "mode", "transfer", "at"]),
    (
        "animate",
        &[
            "output", "config", "spacing", "clip", "picture", "pictures", "every", "json", "view", "mode", "transfer",
            "speed",
        ],
    ),
    (
        "live",
        &[
            "config", "check", "example", "keys", "output", "picture", "json", "record", "duration", "console", "igtl",
            "headless",
        ],
    ),
    (
        "phantom",
        &[
            "output",
            "truth",
            "scene",
            "trajectory",
            "frames",
            "spacing",
            "image-size",
            "pixel",
            "seed",
            "calibration",
            "json",
        ],
    ),
    ("twin", &["link", "found", "trajectory", "frames", "rate", "seed", "noise", "duration", "stations"]),
    ("demo", &["output", "duration", "console", "arm", "seed", "headless", "igtl"]),
    ("replay", &["output", "config", "picture", "speed", "console", "keep", "json", "weights", "igtl"]),
];

/// Headings of flags that do not stand under their struct's own.
const HEADINGS: &[(&str, &[&str])] = &[
    ("Calibration", &["image-to-probe", "preset", "world", "smoothing"]),
    ("Volume", &["spacing", "origin", "size", "type", "window", "unseen", "max-memory"]),
    ("Image data", &["clip", "fan", "frames"]),
    ("Insertion", &["path", "departure", "planar-tolerance", "threads", "simd"]),
    (
        "Outputs",
        &["weights", "error", "planes", "picture", "pictures", "every", "json", "fill", "fill-radius", "seen-label"],
    ),
    (
        "Kernel and compounding",
        &[
            "method",
            "sigma",
            "resolution",
            "support",
            "leakage",
            "max-weight",
            "compound",
            "decay",
            "decay-rate",
            "decay-wait",
        ],
    ),
    ("Cache", &["cache", "cache-bytes"]),
];
/// Commands to which these headings apply.
const GROUPED: [&str; 3] = ["reconstruct", "animate", "live"];

/// Headings of the flags of `convert`.
const CONVERSION: &[(&str, &[&str])] = &[
    ("Image data", &["frames", "crop", "orientation"]),
    ("Sequences", &["station", "rate"]),
    ("Volumes", &["weights", "write-weights", "fill", "fill-radius", "seen-label", "max-memory"]),
    ("Outputs", &["json", "compress"]),
    ("Anonymous files", &["anonymize", "clip", "subject", "key", "acquired"]),
];

/// Commands of `calibrate` with many flags, and those that `-h` shows.
const USUAL_OF_CALIBRATE: &[(&str, &[&str])] = &[
    (
        "probe",
        &[
            "method",
            "output",
            "phantom",
            "registration",
            "stylus-tip",
            "sequence",
            "session",
            "validate",
            "live",
            "preset",
            "json",
            "report",
        ],
    ),
    ("latency", &["method", "config", "output", "video", "tracker", "sequence", "session", "live", "duration", "json"]),
    ("pivot", &["output", "sequence", "session", "live", "stylus", "reference", "limit", "json"]),
    ("arm", &["arm", "check", "output", "session", "live", "plate", "point", "distances", "order", "skip", "json"]),
    ("landmarks", &["output", "phantom", "stylus", "stylus-tip", "sequence", "session", "live", "limit", "json"]),
    ("tracker", &["other", "tracker", "output", "sequence", "session", "sensor", "live", "limit", "json"]),
];

/// Headings of the flags of `calibrate`'s commands.
const CALIBRATION: &[(&str, &[&str])] = &[
    ("Recording", &["sequence", "session", "video", "from", "to", "clip", "validate", "sensor"]),
    ("Live", &["live", "record", "duration", "goal"]),
    (
        "Stylus and phantom",
        &["phantom", "registration", "stylus-tip", "stylus", "tip-error", "reference", "plate", "distances", "point"],
    ),
    ("Touches", &["order", "skip", "rest", "still", "tip", "seat"]),
    ("Result", &["limit", "preset", "ruler", "keep", "counts"]),
    ("Outputs", &["json", "report"]),
];

/// Puts the flags of all commands into groups.
pub(super) fn grouped(mut command: clap::Command) -> clap::Command {
    for (name, usual) in USUAL {
        command = command.mut_subcommand(name, |sub| shortened(sub, usual));
    }
    for name in GROUPED {
        command = command.mut_subcommand(name, |sub| headed(sub, HEADINGS));
    }
    command = command.mut_subcommand("regions", |regions| {
        regions.mut_subcommand("plan", |sub| shortened(headed(sub, HEADINGS), USUAL[0].1))
    });
    command = command.mut_subcommand("convert", |sub| headed(sub, CONVERSION));
    command.mut_subcommand("calibrate", |calibrate| {
        USUAL_OF_CALIBRATE.iter().fold(calibrate, |calibrate, (name, usual)| {
            calibrate.mut_subcommand(name, |sub| shortened(headed(sub, CALIBRATION), usual))
        })
    })
}

/// Hides a command's flags from `-h`, except the usual ones.
fn shortened(command: clap::Command, usual: &[&str]) -> clap::Command {
    command.mut_args(|arg| {
        let is_usual = arg.get_long().is_none_or(|long| usual.contains(&long) || arg.is_global_set());
        if is_usual { arg } else { arg.hide_short_help(true) }
    })
}

/// Puts a command's flags under these headings.
fn headed(command: clap::Command, headings: &[(&'static str, &[&str])]) -> clap::Command {
    command.mut_args(|arg| {
        let long = arg.get_long().unwrap_or_default().to_owned();
        let heading = headings.iter().find(|(_, flags)| flags.contains(&long.as_str()));
        heading.map_or(arg.clone(), |(heading, _)| arg.help_heading(*heading))
    })
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory as _;

    use super::super::Arguments;
    use super::*;

    #[test]
    fn every_named_flag_exists() {
        let command = Arguments::command();
        let has = |name: &str, flag: &str| {
            command.find_subcommand(name).is_some_and(|sub| sub.get_arguments().any(|arg| arg.get_long() == Some(flag)))
        };
        for (name, usual) in USUAL {
            assert!(usual.iter().all(|flag| has(name, flag)), "{name}: {usual:?}");
            assert!(usual.len() <= 12, "{name}");
        }
        for (heading, flags) in HEADINGS {
            assert!(flags.iter().all(|flag| GROUPED.iter().any(|name| has(name, flag))), "{heading}");
        }
        for (heading, flags) in CONVERSION {
            assert!(flags.iter().all(|flag| has("convert", flag)), "{heading}");
        }
        let calibrate = command.find_subcommand("calibrate").unwrap();
        let has = |name: &str, flag: &str| {
            let sub = calibrate.find_subcommand(name).unwrap();
            sub.get_arguments().any(|arg| arg.get_long() == Some(flag))
        };
        for (name, usual) in USUAL_OF_CALIBRATE {
            assert!(usual.iter().all(|flag| has(name, flag)), "{name}: {usual:?}");
            assert!(usual.len() <= 12, "{name}");
        }
        for flag in CALIBRATION.iter().flat_map(|(_, flags)| *flags) {
            assert!(USUAL_OF_CALIBRATE.iter().any(|(name, _)| has(name, flag)), "{flag}");
        }
    }

    #[test]
    fn calibration_flags_stand_under_headings() {
        let command = grouped(Arguments::command());
        let sub = command.find_subcommand("calibrate").and_then(|sub| sub.find_subcommand("probe")).unwrap();
        let heading =
            |flag: &str| sub.get_arguments().find(|arg| arg.get_long() == Some(flag)).unwrap().get_help_heading();
        assert_eq!(
            [heading("live"), heading("ruler"), heading("phantom")],
            [Some("Live"), Some("Result"), Some("Stylus and phantom")]
        );
        assert_eq!([heading("output"), heading("method")], [None, None]);
    }

    #[test]
    fn filling_stands_under_outputs_not_under_dicom() {
        let command = grouped(Arguments::command());
        let sub = command.find_subcommand("reconstruct").unwrap();
        let heading =
            |flag: &str| sub.get_arguments().find(|arg| arg.get_long() == Some(flag)).unwrap().get_help_heading();
        assert_eq!([heading("fill"), heading("sigma")], [Some("Outputs"), Some("Kernel and compounding")]);
        assert!(heading("patient-id").unwrap().contains("DICOM"));
        assert!(heading("output").is_none());
    }
}
