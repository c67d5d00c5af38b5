//! Provenance of a volume, as fields of its file. The fields distinguish unseen voxels from
//! black ones, and the settings of different files.

use export::volume::{DenseBox, Encoding};
use pipeline::{Outcome, PixelKind};
use reconstruct::kernel::AxisKernel;
use volume::dense::{RANGE_FIELD, SLICE_AXES_FIELD, SLICES_BOX_FIELD, UNSEEN_FIELD};

/// A volume's facts that its voxels do not contain.
pub(crate) struct Made<'a> {
    pub(crate) outcome: &'a Outcome,
    pub(crate) space: &'a DenseBox,
    pub(crate) encoding: &'a Encoding,
    /// The recording or the devices.
    pub(crate) input: String,
    pub(crate) calibration: String,
    /// Whether the box was given, so that it may be smaller than the slices' extent.
    pub(crate) cropped: bool,
}

impl Made<'_> {
    pub(crate) fn fields(&self) -> Vec<(String, String)> {
        let Self { outcome, space, encoding, .. } = self;
        let reconstructor = &outcome.reconstructor;
        let three = |values: [f64; 3]| values.map(|v| format!("{v}")).join(" ");
        let kernels = reconstructor.kernels();
        let per_axis = |f: fn(&AxisKernel) -> f64| kernels.map(|k| three(k.each_ref().map(f)));
        let line = |key: &str, value: &str| (format!("Sonoweave{key}"), one_line(value));
        let mut fields = vec![
            line("Version", env!("CARGO_PKG_VERSION")),
            line("Frame", &format!("{} (mm, not anatomical)", outcome.world)),
            line("Input", &self.input),
            line("Calibration", &self.calibration),
            line("Route", &outcome.route),
            line("Method", reconstructor.settings().method.name()),
            line("Compounding", &reconstructor.settings().compounding.to_string()),
            line("Path", reconstructor.path().name()),
        ];
        if let (Some(sigma), Some(support)) = (per_axis(|k| k.sigma_mm), per_axis(|k| k.support_mm)) {
            fields.push(line("SigmaMm", &sigma));
            fields.push(line("SupportMm", &support));
        }
        if reconstructor.settings().gap_weights {
            fields.push(line("GapWeights", "half the distance of neighbours, in sigma"));
        }
        if let Some(shadows) = reconstructor.settings().shadow_weights {
            fields.push(line("ShadowWeights", &shadows.to_string()));
        }
        if let Some(smoothing) = &outcome.smoothing {
            fields.push(line("Smoothing", &smoothing.words()));
        }
        if let Some(corrections) = &outcome.corrections {
            fields.push(line("Corrections", corrections));
        }
        fields.push((UNSEEN_FIELD.into(), format!("{}", encoding.unseen)));
        fields.push((RANGE_FIELD.into(), range(outcome.pixels, encoding).map(|v| v.to_string()).join(" ")));
        // In a cropped volume, the image covers only what is left.
        if let (Some(bounds), false) = (outcome.reached, self.cropped) {
            let relative =
                bounds.map(|corner| std::array::from_fn::<_, 3, _>(|a| (corner[a] - space.first[a]).to_string()));
            fields.push((SLICES_BOX_FIELD.into(), relative.map(|corner| corner.join(" ")).join(" ")));
        }
        if let Some([u, v]) = outcome.slice_axes {
            fields.push((SLICE_AXES_FIELD.into(), format!("{} {}", three(u.to_array()), three(v.to_array()))));
        }
        fields.push(line("Frames", &format!("{} of {}", outcome.ledger.frames.used, outcome.ledger.frames.total)));
        fields
    }
}

/// Returns the identity of this program: its version and its commit.
pub(crate) fn program() -> String {
    let (version, commit) = (env!("CARGO_PKG_VERSION"), env!("SONOWEAVE_BUILT_FROM"));
    if commit.is_empty() { version.to_owned() } else { format!("{version} {commit}") }
}

/// Returns the grey values that mean black and white in the file.
pub(crate) fn range(pixels: PixelKind, encoding: &Encoding) -> [f32; 2] {
    match (encoding.window, pixels) {
        (Some(_), _) => [0.0, encoding.scalar.top()],
        (None, kind) => kind.grey_levels(),
    }
}

/// Removes line ends, which would end a header field.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect::<String>().trim().to_owned()
}
