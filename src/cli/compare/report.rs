//! Result of a comparison, in words and as JSON.

use std::path::{Path, PathBuf};

use glam::DVec3;
use serde::Serialize;

use volume::DenseVolume;
use volume::dense::UNSEEN_FIELD;
use volume::difference::Difference;

use super::arguments::Arguments;
use crate::app::histogram::Histogram;
use crate::cli::inspect::text::{Text, point, short, times};

/// The result; its fields are the JSON form.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    first: Side,
    second: Side,
    /// Whether the second volume was interpolated on the first one's lattice.
    resampled: bool,
    voxels: Voxels,
    /// Root of the mean squared difference, first minus second. This and the following numbers
    /// cover the voxels that both volumes saw.
    rmse: f64,
    /// Mean difference.
    mean: f64,
    /// Largest absolute difference.
    max: f64,
    max_at: Option<Place>,
    /// Pearson's.
    correlation: Option<f64>,
    histogram: Histogram,
    /// Header fields on the volumes and their reconstruction that differ.
    settings: Vec<Setting>,
    picture: Option<PathBuf>,
}

/// A volume.
#[derive(Debug, Serialize)]
struct Side {
    path: PathBuf,
    weights: Option<PathBuf>,
    /// Criterion for seen voxels.
    seen_by: &'static str,
    seen: u64,
}

/// Counts of voxels, by the volumes that saw them.
#[derive(Debug, Serialize)]
struct Voxels {
    both: u64,
    only_first: u64,
    only_second: u64,
    /// Within the first volume's box.
    neither: u64,
}

/// A voxel of the first volume.
#[derive(Debug, Serialize)]
struct Place {
    voxel: [u64; 3],
    world_mm: [f64; 3],
}

/// A field of the headers.
#[derive(Debug, PartialEq, Serialize)]
struct Setting {
    name: String,
    first: Option<String>,
    second: Option<String>,
}

impl Side {
    fn new(path: &Path, weights: Option<&PathBuf>, volume: &DenseVolume) -> Self {
        let has_unseen = volume.header().fields.iter().any(|(name, _)| name == UNSEEN_FIELD);
        let seen_by = match weights {
            Some(_) => "weights",
            None if has_unseen => "the header's unseen value",
            None => "nothing: every voxel counts as seen",
        };
        Self { path: path.to_owned(), weights: weights.cloned(), seen_by, seen: volume.seen() }
    }
}

impl Report {
    pub(super) fn new(arguments: &Arguments, volumes: [&DenseVolume; 2], difference: &Difference) -> Self {
        let Arguments { first, second, weights, other_weights, output, .. } = arguments;
        let sums = &difference.sums;
        let seen = difference.values.iter().filter(|d| !d.is_nan()).map(|d| f64::from(*d));
        let max_at = difference.worst.map(|voxel| {
            let world = difference.grid.world_from_volume().point(DVec3::from_array(voxel.map(|i| i as f64)));
            Place { voxel, world_mm: world.to_array() }
        });
        Self {
            first: Side::new(first, weights.as_ref(), volumes[0]),
            second: Side::new(second, other_weights.as_ref(), volumes[1]),
            resampled: difference.resampled,
            voxels: Voxels {
                both: sums.n,
                only_first: difference.only_first,
                only_second: difference.only_second,
                neither: difference.neither,
            },
            rmse: sums.rmse(),
            mean: sums.bias(),
            max: sums.max,
            max_at,
            correlation: sums.correlation(),
            histogram: Histogram::signed(seen, sums.rmse()),
            settings: differing(volumes.map(settings)),
            picture: output.clone(),
        }
    }

    pub(super) fn text(&self) -> String {
        let mut text = Text::default();
        let (first, second) = (self.first.path.display(), self.second.path.display());
        text.heading(&format!("{first} less {second}"));
        for (name, side) in [("first", &self.first), ("second", &self.second)] {
            text.row(name, format!("{} voxels seen, by {}", side.seen, side.seen_by));
        }
        text.row(
            "lattice",
            if self.resampled {
                "different: the second volume is interpolated at the first one's voxels (trilinear), where all \
                neighbours were seen"
            } else {
                "the same, voxel by voxel"
            },
        );
        let Voxels { both, only_first, only_second, neither } = self.voxels;
        text.row("compared", format!("{both} voxels that both saw; {only_first} only the first, {only_second} only the second, {neither} neither"));
        text.row("RMSE", short(self.rmse));
        text.row("mean", short(self.mean));
        let at = self.max_at.as_ref().map_or_else(String::new, |place| {
            format!(
                " at voxel {} ({} mm)",
                place.voxel.map(|i| i.to_string()).join(", "),
                point(place.world_mm.map(|mm| (mm * 1e3).round() / 1e3))
            )
        });
        text.row("largest", format!("{}{at}", short(self.max)));
        if let Some(correlation) = self.correlation {
            text.row("correlation", format!("{correlation:.4}"));
        }
        text.rows("differences", self.histogram.lines());
        if self.settings.is_empty() {
            text.row("settings", "the headers say the same of both");
        }
        let or_none = |value: &Option<String>| value.clone().unwrap_or_else(|| "not said".into());
        text.rows(
            "settings",
            self.settings.iter().map(|s| format!("{}: {} | {}", s.name, or_none(&s.first), or_none(&s.second))),
        );
        if let Some(picture) = &self.picture {
            text.row("picture", picture.display().to_string());
        }
        text.finish()
    }
}

/// Returns a volume's header entries: its lattice, and its reconstruction settings.
fn settings(volume: &DenseVolume) -> Vec<(String, String)> {
    let header = volume.header();
    let axes = header.axes.map(point).join("; ");
    let mut settings = vec![
        ("size".to_owned(), times(header.size)),
        ("spacing".to_owned(), times(header.spacing)),
        ("origin".to_owned(), point(header.origin)),
        ("direction".to_owned(), axes),
        ("type".to_owned(), format!("{:?}", header.pixel).to_lowercase()),
    ];
    settings.extend(header.fields.iter().cloned());
    settings
}

/// Returns the differing entries, in the first one's order.
fn differing([first, second]: [Vec<(String, String)>; 2]) -> Vec<Setting> {
    let find = |of: &[(String, String)], name: &str| of.iter().find(|(n, _)| n == name).map(|(_, value)| value.clone());
    let others = second.iter().filter(|(name, _)| find(&first, name).is_none());
    first
        .iter()
        .chain(others)
        .map(|(name, _)| Setting { name: name.clone(), first: find(&first, name), second: find(&second, name) })
        .filter(|setting| setting.first != setting.second)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differing_lists_only_changed_settings() {
        let list =
            |pairs: &[(&str, &str)]| pairs.iter().map(|(n, v)| ((*n).to_owned(), (*v).to_owned())).collect::<Vec<_>>();
        let found =
            differing([list(&[("a", "1"), ("b", "2"), ("c", "3")]), list(&[("d", "4"), ("c", "0"), ("a", "1")])]);
        let setting = |name: &str, first: Option<&str>, second: Option<&str>| Setting {
            name: name.into(),
            first: first.map(Into::into),
            second: second.map(Into::into),
        };
        assert_eq!(
            found,
            [setting("b", Some("2"), None), setting("c", Some("3"), Some("0")), setting("d", None, Some("4"))]
        );
    }
}
