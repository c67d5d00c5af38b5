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
    ("Calibration", &["image-to-probe", "preset", "world"]),
    ("Volume", &["spacing", "origin", "size", "type", "window", "unseen", "max-memory"]),
    ("Image data", &["clip", "fan", "frames", "crop", "orientation"]),
    ("Insertion", &["path", "departure", "planar-tolerance", "threads", "simd"]),
    ("Outputs", &["weights", "planes", "picture", "pictures", "every", "json", "fill", "fill-radius"]),
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
/// Commands to which the headings apply.
const GROUPED: [&str; 3] = ["reconstruct", "animate", "live"];

/// Puts the flags of all commands into groups.
pub(super) fn grouped(mut command: clap::Command) -> clap::Command {
    for (name, usual) in USUAL {
        command = command.mut_subcommand(name, |sub| {
            sub.mut_args(|arg| {
                let is_usual = arg.get_long().is_none_or(|long| usual.contains(&long) || arg.is_global_set());
                if is_usual { arg } else { arg.hide_short_help(true) }
            })
        });
    }
    for name in GROUPED {
        command = command.mut_subcommand(name, |sub| {
            sub.mut_args(|arg| {
                let long = arg.get_long().unwrap_or_default().to_owned();
                let heading = HEADINGS.iter().find(|(_, flags)| flags.contains(&long.as_str()));
                heading.map_or(arg.clone(), |(heading, _)| arg.help_heading(*heading))
            })
        });
    }
    command
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
            assert!(
                flags.iter().all(|flag| GROUPED.iter().any(|name| has(name, flag)) || has("convert", flag)),
                "{heading}"
            );
        }
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
