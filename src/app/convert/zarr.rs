//! A volume of another format as OME-Zarr, written a layer of shards after the other.

use std::path::Path;

use glam::{DMat3, DVec3};
use rayon::prelude::*;
use sha2::{Digest, Sha256};

use formats::image::{VolumeHeader, VolumeSlices};
use ome_zarr::{Extent, Meta, OmeZarrWriter, Scalar, ShardIndex, ShardWriter};
use sonoweave_core::reading::PixelType;
use volume::dense::{RANGE_FIELD, UNSEEN_FIELD, append};
use volume::placed::{field, slices_box};

use crate::app::input;
use crate::failure::{Failure, FailureKind};

/// The identity of a volume, and its range.
pub(crate) struct Key {
    text: String,
    /// Least and greatest value; `None` without any finite one.
    extremes: Option<[f32; 2]>,
}

impl Key {
    /// Reads a volume once; `settings` is everything else that the output follows from.
    ///
    /// # Errors
    /// [`Failure`] when it cannot be read, or has values that single precision does not hold.
    pub(crate) fn of(
        path: &Path,
        values: &mut dyn VolumeSlices,
        weights: Option<&mut dyn VolumeSlices>,
        settings: &str,
    ) -> Result<Self, Failure> {
        let header = values.header().clone();
        let mut hash = Sha256::new_with_prefix(settings);
        let (mut extremes, mut numbers) = ([f32::INFINITY, f32::NEG_INFINITY], Vec::new());
        while let Some(slice) = values.next_slice()? {
            hash.update(slice);
            numbers.clear();
            append(slice, header.pixel, &mut numbers);
            if !is_exact(slice, header.pixel, &numbers) {
                return Err(Failure::new(format!(
                    "{}: has values of type {} that single precision does not hold exactly; use a format other than \
                     OME-Zarr",
                    path.display(),
                    header.pixel
                ))
                .of(FailureKind::Input));
            }
            for value in numbers.iter().filter(|value| value.is_finite()) {
                extremes = [extremes[0].min(*value), extremes[1].max(*value)];
            }
        }
        if let Some(weights) = weights {
            while let Some(slice) = weights.next_slice()? {
                hash.update(slice);
            }
        }
        let text = hash.finalize().iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Self { text, extremes: (extremes[0] < extremes[1]).then_some(extremes) })
    }
}

/// Writes a volume in memory with its weights, which `both` gives each time from the start.
///
/// # Errors
/// Same as [`Target::write`].
pub(crate) fn write<S: VolumeSlices>(path: &Path, both: impl Fn() -> [S; 2]) -> Result<(), Failure> {
    let [mut values, mut weights] = both();
    let header = values.header().clone();
    let key = Key::of(path, &mut values, Some(&mut weights), &format!("{header:?}"))?;
    let [mut values, mut weights] = both();
    Target { path, header: &header, label: false }.write(&mut values, Some(&mut weights), &key)
}

/// Whether numbers in single precision are the values that bytes hold.
fn is_exact(bytes: &[u8], pixel: PixelType, numbers: &[f32]) -> bool {
    fn all<const N: usize>(bytes: &[u8], numbers: &[f32], same: impl Fn([u8; N], f32) -> bool) -> bool {
        bytes.as_chunks::<N>().0.iter().zip(numbers).all(|(word, number)| same(*word, *number))
    }
    match pixel {
        PixelType::U32 => all(bytes, numbers, |word, x| f64::from(u32::from_ne_bytes(word)) == f64::from(x)),
        PixelType::I32 => all(bytes, numbers, |word, x| f64::from(i32::from_ne_bytes(word)) == f64::from(x)),
        // 128 bits hold both.
        PixelType::U64 => all(bytes, numbers, |word, x| i128::from(u64::from_ne_bytes(word)) == x as i128),
        PixelType::I64 => all(bytes, numbers, |word, x| i128::from(i64::from_ne_bytes(word)) == x as i128),
        PixelType::F64 => all(bytes, numbers, |word, x| {
            let value = f64::from_ne_bytes(word);
            value == f64::from(x) || value.is_nan()
        }),
        PixelType::U8 | PixelType::I8 | PixelType::U16 | PixelType::I16 | PixelType::F32 => true,
    }
}

/// An OME-Zarr volume to be written.
pub(crate) struct Target<'a> {
    pub(crate) path: &'a Path,
    /// Place, type and fields of the volume.
    pub(crate) header: &'a VolumeHeader,
    /// Whether it has the label of seen voxels.
    pub(crate) label: bool,
}

impl Target<'_> {
    /// Returns a note for the user if other programs will show the volume in another place.
    pub(crate) fn note(&self) -> Option<String> {
        let direction = self.direction();
        (direction != DMat3::IDENTITY).then(|| {
            format!(
                "{}: OME-Zarr 0.5 has no direction of axes, so that other programs show the volume turned",
                self.path.display()
            )
        })
    }

    fn direction(&self) -> DMat3 {
        let [x, y, z] = self.header.axes.map(DVec3::from_array);
        DMat3::from_cols(x, y, z)
    }

    /// Writes the volume, its weights and its pyramid. Without weights, voxels of the header's
    /// unseen value, and those that are not finite, are unseen; the others have weight 1.
    ///
    /// # Errors
    /// [`Failure`] when a file cannot be read or written. An earlier volume is unchanged then, and
    /// another run goes on.
    pub(crate) fn write(
        &self,
        values: &mut dyn VolumeSlices,
        mut weights: Option<&mut dyn VolumeSlices>,
        key: &Key,
    ) -> Result<(), Failure> {
        let meta = self.meta(key);
        let extent = meta.extent;
        let (writer, _) = OmeZarrWriter::create(self.path, &meta)?;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(input::threads(None)).build()?;
        let unseen = field::<f32, 1>(self.header, UNSEEN_FIELD).map(|[value]| value);
        let mut layer = Layer::default();
        let [layers, rows, columns] = extent.shards(0);
        for z in 0..layers {
            let [planes, ..] = extent.shard_size(0, [z, 0, 0]).unwrap_or_default();
            layer.read(values, &mut weights, planes, unseen)?;
            let shards: Vec<ShardIndex> = (0..rows).flat_map(|y| (0..columns).map(move |x| [z, y, x])).collect();
            let missing = shards.par_iter().filter(|shard| !writer.shards().is_done(0, **shard));
            pool.install(|| missing.try_for_each(|shard| layer.write(writer.shards(), &extent, *shard)))?;
        }
        Ok(pool.install(|| writer.finish())?)
    }

    fn meta(&self, key: &Key) -> Meta {
        let header = self.header;
        let own = header.fields.iter().any(|(name, _)| name.starts_with("Sonoweave"));
        let scalar = match header.pixel {
            PixelType::U8 => Scalar::U8,
            PixelType::U16 => Scalar::U16,
            _ => Scalar::F32,
        };
        // Other programs' real values have no range by themselves.
        let found = key.extremes.filter(|_| scalar == Scalar::F32 && !own);
        let unseen = field::<f32, 1>(header, UNSEEN_FIELD).map_or(0.0, |[value]| value);
        Meta {
            extent: Extent::around([[0; 3], header.size.map(|n| i64::from(n) - 1)]),
            origin: DVec3::from_array(header.origin),
            spacing: DVec3::from_array(header.spacing),
            direction: self.direction(),
            scalar,
            unseen,
            label: self.label,
            range: field::<f32, 2>(header, RANGE_FIELD).or(found),
            slices_box: slices_box(header),
            fields: header.fields.clone(),
            content_key: key.text.clone(),
        }
    }
}

/// The planes of a layer of shards.
#[derive(Default)]
struct Layer {
    /// Voxels along x, y.
    size: [usize; 2],
    /// x fastest.
    values: Vec<f32>,
    weights: Vec<f32>,
}

impl Layer {
    /// Reads the next planes.
    fn read(
        &mut self,
        values: &mut dyn VolumeSlices,
        weights: &mut Option<&mut dyn VolumeSlices>,
        planes: usize,
        unseen: Option<f32>,
    ) -> Result<(), Failure> {
        let header = values.header();
        self.size = [header.size[0], header.size[1]].map(|n| n as usize);
        fill(values, planes, &mut self.values)?;
        match weights {
            Some(weights) => fill(&mut **weights, planes, &mut self.weights)?,
            None => {
                let is_unseen = |value: f32| unseen.is_some_and(|u| value == u || (value.is_nan() && u.is_nan()));
                self.weights.clear();
                self.weights.extend(self.values.iter().map(|value| if is_unseen(*value) { 0.0 } else { 1.0 }));
            }
        }
        for (value, weight) in self.values.iter().zip(&mut self.weights) {
            if !(value.is_finite() && weight.is_finite()) {
                *weight = 0.0;
            }
        }
        Ok(())
    }

    fn write(&self, writer: &ShardWriter, extent: &Extent, shard: ShardIndex) -> Result<(), Failure> {
        let [planes, rows, columns] = extent.shard_size(0, shard).unwrap_or_default();
        let [nx, ny] = self.size;
        let [_, y0, x0] = shard.map(|index| (index * extent.shard) as usize);
        let of = |voxels: &[f32]| -> Vec<f32> {
            let lines = (0..planes).flat_map(|z| (0..rows).map(move |y| (z * ny + y0 + y) * nx + x0));
            lines.flat_map(|at| voxels[at..at + columns].iter().copied()).collect()
        };
        Ok(writer.write_numbers(shard, &of(&self.values), &of(&self.weights))?)
    }
}

/// Reads so many planes.
fn fill(slices: &mut dyn VolumeSlices, planes: usize, numbers: &mut Vec<f32>) -> Result<(), Failure> {
    let pixel = slices.header().pixel;
    numbers.clear();
    for _ in 0..planes {
        let Some(slice) = slices.next_slice()? else { break };
        append(slice, pixel, numbers);
    }
    Ok(())
}
