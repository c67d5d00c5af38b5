//! Errors of presets.

/// Reasons why no preset is selected, or a preset does not fit the scanner's settings.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PresetError {
    /// There is none of that name.
    #[error("there is no preset \"{name}\"; {}", advice(known))]
    Unknown {
        /// The requested name.
        name: String,
        /// The existing names.
        known: Vec<String>,
    },
    /// There are several, and no name was given.
    #[error("has several presets; give the name of one (preset): {}", names(known))]
    Unnamed {
        /// The existing names.
        known: Vec<String>,
    },
    /// The images have another size.
    #[error(
        "the preset \"{name}\" is for images of {}×{} pixels, but these have {}×{}; choose another preset, or restore \
        the settings of scanner and grabber",
        expected[0], expected[1], found[0], found[1]
    )]
    Size {
        /// Name of the preset.
        name: String,
        /// Image size of the preset, pixels.
        expected: [u32; 2],
        /// Size of the incoming frames, pixels.
        found: [u32; 2],
    },
    /// The depth or zoom differs.
    #[error(
        "the preset \"{name}\" is for a ruler of {expected:.4} mm a pixel, but the scanner's has {found:.4}; choose \
        the preset of this depth, or restore depth and zoom"
    )]
    Ruler {
        /// Name of the preset.
        name: String,
        /// Scale of the preset's images, mm per pixel.
        expected: f64,
        /// Scale of the incoming frames, mm per pixel.
        found: f64,
    },
}

fn advice(known: &[String]) -> String {
    match known {
        [] => "the file has none: leave the name out".into(),
        _ => format!("give one of {}", names(known)),
    }
}

fn names(known: &[String]) -> String {
    known.iter().map(|name| format!("\"{name}\"")).collect::<Vec<_>>().join(", ")
}
