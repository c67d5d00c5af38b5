//! Report on a volume, and on its difference from another.

use std::path::{Path, PathBuf};

use serde::Serialize;

use export::fill::FILLED;
use formats::image::{VolumeHeader, VolumeSlices};
use sonoweave_core::reading::PixelType;
use volume::brick_volume::SEEN;
use volume::difference::{Overlap, Sums};

use super::super::Failure;
use super::text::{Text, bytes, point, short, times};
use crate::app::volume_input::{VolumeInput, holds_weights};
use crate::cli::progress::progress;

/// A volume's content.
#[derive(Debug, Serialize)]
pub(super) struct VolumeReport {
    path: PathBuf,
    bytes: u64,
    /// Voxels along each index axis.
    size: [u32; 3],
    /// mm.
    spacing: [f64; 3],
    /// World position of the centre of voxel (0, 0, 0), mm.
    origin: [f64; 3],
    /// Direction of each index axis in the world.
    direction: [[f64; 3]; 3],
    /// From the first voxel's centre to the last one's along each index axis, mm.
    extent_mm: [f64; 3],
    scalar: String,
    channels: u32,
    compressed: bool,
    /// Whether the file gives its placement.
    placed: bool,
    values: Values,
    /// By the weights, if they were given.
    coverage: Option<Coverage>,
    /// Further fields of the header: `reconstruct`'s settings, and others.
    fields: Vec<(String, String)>,
    comparison: Option<Comparison>,
}

/// The voxels' values.
#[derive(Debug, Default, Serialize)]
struct Values {
    /// Smallest, largest and mean of the finite values.
    min: Option<f64>,
    max: Option<f64>,
    mean: Option<f64>,
    /// Values that are exactly 0.
    zero: u64,
    /// Values that are NaN or infinite.
    not_finite: u64,
}

/// Counts of seen, filled and unseen voxels.
#[derive(Debug, Default, Serialize)]
struct Coverage {
    seen: u64,
    /// Not seen, but filled from those nearby.
    filled: u64,
    unseen: u64,
}

/// Difference of the volume minus another.
#[derive(Debug, Serialize)]
struct Comparison {
    against: PathBuf,
    weights: Option<PathBuf>,
    /// Voxels that were compared.
    voxels: u64,
    /// Voxels in both volumes.
    overlap: u64,
    /// Root of the mean squared difference.
    rmse: f64,
    /// Largest absolute difference.
    max: f64,
    /// Mean difference.
    bias: f64,
    /// Pearson's.
    correlation: Option<f64>,
}

impl VolumeReport {
    /// Reads a volume, a slice at a time. If requested, compares it with another volume and
    /// counts its seen voxels by the weights.
    pub(super) fn read(path: &Path, against: Option<&Path>, weights: Option<&Path>) -> Result<Self, Failure> {
        // An impossible comparison is reported before the voxels are read.
        let comparison = against.map(|other| compare(path, other, weights)).transpose()?;
        let coverage = Layers::weights(path, weights)?.map(Coverage::read).transpose()?;
        let mut layers = Layers::open(path)?;
        let bar = progress("reading", u64::from(layers.header().size[2]));
        let mut values = Values::default();
        let (mut sum, mut finite) = (0.0, 0_u64);
        while let Some(layer) = layers.next()? {
            for &value in layer {
                if !value.is_finite() {
                    values.not_finite += 1;
                    continue;
                }
                values.zero += u64::from(value == 0.0);
                values.min = Some(values.min.map_or(value, |m| m.min(value)));
                values.max = Some(values.max.map_or(value, |m| m.max(value)));
                sum += value;
                finite += 1;
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        values.mean = (finite > 0).then(|| sum / finite as f64);
        let header = layers.header().clone();
        Ok(Self {
            path: path.to_owned(),
            bytes: bytes_of(path)?,
            size: header.size,
            spacing: header.spacing,
            origin: header.origin,
            direction: header.axes,
            extent_mm: [0, 1, 2].map(|a| f64::from(header.size[a] - 1) * header.spacing[a]),
            scalar: scalar_name(header.pixel),
            channels: header.channels,
            compressed: header.compressed,
            placed: header.placed,
            values,
            coverage,
            fields: header.fields,
            comparison,
        })
    }

    pub(super) fn write(&self, text: &mut Text) {
        text.heading(&format!("{}: volume, {}", self.path.display(), bytes(self.bytes)));
        let channels = if self.channels == 1 { String::new() } else { format!(", {} channels", self.channels) };
        let packing = if self.compressed { ", compressed" } else { "" };
        text.row("size", format!("{} voxels of {}{channels}{packing}", times(self.size), self.scalar));
        if !self.placed {
            text.row("place", "not given: neither sform nor qform of this NIfTI; what follows is assumed");
        }
        text.row("spacing", format!("{} mm", times(self.spacing)));
        text.row("extent", format!("{} mm between the outermost voxels' centres", times(self.extent_mm.map(short))));
        text.row("origin", format!("{} mm", point(self.origin)));
        let axes = ["x", "y", "z"];
        if self.direction == [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
            text.row("direction", "index axes along the world's");
        } else {
            text.rows("direction", (0..3).map(|a| format!("{} along {}", axes[a], point(self.direction[a]))));
        }
        let values = &self.values;
        if let (Some(min), Some(max), Some(mean)) = (values.min, values.max, values.mean) {
            text.row("values", format!("{min} to {max}, mean {}", short(mean)));
        }
        let all = self.size.map(u64::from).iter().product::<u64>() * u64::from(self.channels);
        text.row("zeros", format!("{} of {all} ({:.1} %)", values.zero, 100.0 * values.zero as f64 / all as f64));
        if values.not_finite > 0 {
            text.row("not finite", format!("{} values are NaN or infinite", values.not_finite));
        }
        if let Some(Coverage { seen, filled, unseen }) = self.coverage {
            let share = |n: u64| 100.0 * n as f64 / all as f64;
            text.row(
                "seen",
                format!("{seen} ({:.1} %); {filled} filled ({:.1} %), {unseen} unseen", share(seen), share(filled)),
            );
        }
        text.rows("header fields", self.fields.iter().map(|(name, value)| format!("{name} = {value}")));
        if let Some(comparison) = &self.comparison {
            comparison.write(text);
        }
    }
}

impl Coverage {
    fn read(mut layers: Layers) -> Result<Self, Failure> {
        let mut this = Self::default();
        while let Some(layer) = layers.next()? {
            for &weight in layer {
                if weight > f64::from(SEEN) {
                    this.seen += 1;
                } else if weight == f64::from(FILLED) {
                    this.filled += 1;
                } else {
                    this.unseen += 1;
                }
            }
        }
        Ok(this)
    }
}

impl Comparison {
    fn write(&self, text: &mut Text) {
        text.heading(&format!("against {}", self.against.display()));
        let which = if self.weights.is_some() { "with a weight" } else { "not 0 in either" };
        text.row("compared", format!("{} of {} voxels in both volumes: those {which}", self.voxels, self.overlap));
        text.row("RMSE", short(self.rmse));
        text.row("bias", short(self.bias));
        text.row("largest", short(self.max));
        if let Some(correlation) = self.correlation {
            text.row("correlation", format!("{correlation:.4}"));
        }
    }
}

/// A volume's layers as f64.
struct Layers {
    reader: Box<dyn VolumeSlices>,
    values: Vec<f64>,
}

impl Layers {
    fn open(path: &Path) -> Result<Self, Failure> {
        Ok(Self { reader: VolumeInput::open(path)?.values, values: Vec::new() })
    }

    /// Opens a volume's weights: those given, or those that it holds itself.
    fn weights(path: &Path, weights: Option<&Path>) -> Result<Option<Self>, Failure> {
        let own = VolumeInput::open(path)?.weights;
        match (own, weights) {
            (Some(_), Some(weights)) => Err(holds_weights(path, weights)),
            (Some(reader), None) => Ok(Some(Self { reader, values: Vec::new() })),
            (None, weights) => weights.map(|weights| Self::of_volume(&Self::open(path)?, path, weights)).transpose(),
        }
    }

    fn header(&self) -> &VolumeHeader {
        self.reader.header()
    }

    /// Opens a volume's weights.
    fn of_volume(volume: &Self, path: &Path, weights: &Path) -> Result<Self, Failure> {
        let this = Self::open(weights)?;
        let (of_volume, own) = (volume.header(), this.header());
        let why = match Overlap::of(of_volume, own) {
            Err(apart) => apart.to_string(),
            Ok(same) if same.size == of_volume.size && same.size == own.size => return Ok(this),
            Ok(_) => "the weights are not those of this volume".into(),
        };
        Err(Failure::new(format!("{} and {} cannot be compared: {why}", path.display(), weights.display())))
    }

    fn next(&mut self) -> Result<Option<&[f64]>, Failure> {
        let pixel = self.header().pixel;
        let Some(bytes) = self.reader.next_slice()? else { return Ok(None) };
        self.values.clear();
        read_values(bytes, pixel, &mut self.values);
        Ok(Some(&self.values))
    }

    fn skip(&mut self, layers: u32) -> Result<(), Failure> {
        for _ in 0..layers {
            self.reader.next_slice()?;
        }
        Ok(())
    }
}

/// Returns the bytes of a file, or of all files in a folder.
fn bytes_of(path: &Path) -> Result<u64, Failure> {
    let about = std::fs::metadata(path)?;
    if !about.is_dir() {
        return Ok(about.len());
    }
    std::fs::read_dir(path)?.try_fold(0, |sum, entry| Ok(sum + bytes_of(&entry?.path())?))
}

/// Returns the value of unseen voxels: the one noted by `reconstruct`, else 0.
fn unseen_value(header: &VolumeHeader) -> f64 {
    let noted = header.fields.iter().find(|(name, _)| name == "SonoweaveUnseen");
    noted.and_then(|(_, value)| value.parse().ok()).unwrap_or(0.0)
}

/// Whether two values are equal, or both NaN.
fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan())
}

fn compare(path: &Path, other: &Path, weights: Option<&Path>) -> Result<Comparison, Failure> {
    let (mut a, mut b) = (Layers::open(path)?, Layers::open(other)?);
    let refused = |other: &Path, why: String| {
        Failure::new(format!("{} and {} cannot be compared: {why}", path.display(), other.display()))
    };
    let overlap = Overlap::of(a.header(), b.header()).map_err(|apart| refused(other, apart.to_string()))?;
    let mut w = Layers::weights(path, weights)?;
    a.skip(overlap.first[0][2])?;
    b.skip(overlap.first[1][2])?;
    if let Some(w) = &mut w {
        w.skip(overlap.first[0][2])?;
    }
    let width = [a.header(), b.header()].map(|header| header.size[0] as usize);
    let unseen = [a.header(), b.header()].map(unseen_value);
    let mut sums = Sums::default();
    for _ in 0..overlap.size[2] {
        let (Some(a), Some(b)) = (a.next()?, b.next()?) else { break };
        let w = match &mut w {
            Some(w) => w.next()?,
            None => None,
        };
        for y in 0..overlap.size[1] {
            let start = |side: usize| {
                let [x, first, _] = overlap.first[side];
                (first + y) as usize * width[side] + x as usize
            };
            for x in 0..overlap.size[0] as usize {
                let (at, value, reference) = (start(0) + x, a[start(0) + x], b[start(1) + x]);
                let seen = || !same(value, unseen[0]) && !same(reference, unseen[1]);
                if w.map_or_else(seen, |w| w[at] > 0.0) {
                    sums.add(value, reference);
                }
            }
        }
    }
    if sums.n == 0 {
        return Err(refused(other, "no voxel was seen in both; compare volumes of the same place".into()));
    }
    Ok(Comparison {
        against: other.to_owned(),
        weights: weights.map(Path::to_owned),
        voxels: sums.n,
        overlap: overlap.size.map(u64::from).iter().product(),
        rmse: sums.rmse(),
        max: sums.max,
        bias: sums.bias(),
        correlation: sums.correlation(),
    })
}

/// Returns a type's name on the command line.
pub(super) fn scalar_name(pixel: PixelType) -> String {
    format!("{pixel:?}").to_lowercase()
}

fn read_values(bytes: &[u8], pixel: PixelType, values: &mut Vec<f64>) {
    fn each<const N: usize>(bytes: &[u8], values: &mut Vec<f64>, read: impl Fn([u8; N]) -> f64) {
        values.extend(bytes.as_chunks::<N>().0.iter().map(|word| read(*word)));
    }
    match pixel {
        PixelType::U8 => each(bytes, values, |b| f64::from(u8::from_ne_bytes(b))),
        PixelType::I8 => each(bytes, values, |b| f64::from(i8::from_ne_bytes(b))),
        PixelType::U16 => each(bytes, values, |b| f64::from(u16::from_ne_bytes(b))),
        PixelType::I16 => each(bytes, values, |b| f64::from(i16::from_ne_bytes(b))),
        PixelType::U32 => each(bytes, values, |b| f64::from(u32::from_ne_bytes(b))),
        PixelType::I32 => each(bytes, values, |b| f64::from(i32::from_ne_bytes(b))),
        PixelType::U64 => each(bytes, values, |b| u64::from_ne_bytes(b) as f64),
        PixelType::I64 => each(bytes, values, |b| i64::from_ne_bytes(b) as f64),
        PixelType::F32 => each(bytes, values, |b| f64::from(f32::from_ne_bytes(b))),
        PixelType::F64 => each(bytes, values, f64::from_ne_bytes),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn read_values_converts_every_type() {
        let mut values = Vec::new();
        read_values(&(-2.5_f64).to_ne_bytes(), PixelType::F64, &mut values);
        read_values(&(-3_i64).to_ne_bytes(), PixelType::I64, &mut values);
        read_values(&65_535_u16.to_ne_bytes(), PixelType::U16, &mut values);
        read_values(&[255, 1], PixelType::I8, &mut values);
        assert_eq!(values, [-2.5, -3.0, 65535.0, -1.0, 1.0]);
    }
}
