//! A volume of random voxels with holes, and the files of a folder.

use std::collections::BTreeMap;
use std::path::Path;

use glam::{DMat3, DVec3};
use ome_zarr::{Extent, Meta, OmeZarr, OmeZarrWriter, Samples, Scalar, ShardIndex, ShardWriter};

/// Voxels along a shard's and a chunk's edge: small, so that small volumes have many.
pub(crate) const EDGES: [u64; 2] = [16, 8];

/// A volume in memory; weights and values of a dense array, x fastest.
pub(crate) struct Scene {
    pub(crate) meta: Meta,
    pub(crate) values: Vec<f32>,
    pub(crate) weights: Vec<f32>,
}

pub(crate) fn meta(first: [i64; 3], size: [u64; 3], scalar: Scalar) -> Meta {
    let [shard, chunk] = EDGES;
    Meta {
        extent: Extent { first, size, shard, chunk },
        origin: DVec3::new(-3.25, 17.5, 0.1),
        spacing: DVec3::new(0.5, 0.25, 0.3),
        direction: DMat3::IDENTITY,
        scalar,
        unseen: if scalar == Scalar::F32 { -1.5 } else { 3.0 },
        label: true,
        range: Some([0.0, 255.0]),
        slices_box: None,
        fields: vec![("SonoweaveVersion".into(), "1".into()), ("Kernel".into(), "gaussian, σ = 0.5 mm".into())],
        content_key: "key".into(),
    }
}

impl Scene {
    /// Returns a scene of blocks of seen and unseen voxels.
    pub(crate) fn new(meta: Meta, seed: u64) -> Self {
        let mut random = fastrand::Rng::with_seed(seed);
        let [nx, ny, nz] = meta.extent.size.map(|n| n as usize);
        let blocks: Vec<bool> = (0..nx.div_ceil(6) * ny.div_ceil(6) * nz.div_ceil(6)).map(|_| random.bool()).collect();
        let (mut values, mut weights) = (Vec::new(), Vec::new());
        for z in 0..nz {
            for y in 0..ny {
                for x in 0..nx {
                    let block = (z / 6 * ny.div_ceil(6) + y / 6) * nx.div_ceil(6) + x / 6;
                    let is_seen = blocks[block] && random.u8(..) > 20;
                    weights.push(if is_seen { 0.002 + 3.0 * random.f32() } else { 0.0 });
                    values.push(match meta.scalar {
                        _ if !is_seen => meta.unseen,
                        Scalar::U8 => f32::from(random.u8(..)),
                        Scalar::U16 => f32::from(random.u16(..)),
                        Scalar::F32 => 300.0 * random.f32() - 20.0,
                    });
                }
            }
        }
        Self { meta, values, weights }
    }

    /// Returns values and weights of a box of elements within the volume, along z, y, x.
    pub(crate) fn cut(&self, first: [usize; 3], size: [usize; 3]) -> (Vec<f32>, Vec<f32>) {
        let [nx, ny, _] = self.meta.extent.size.map(|n| n as usize);
        let (mut values, mut weights) = (Vec::new(), Vec::new());
        for z in first[0]..first[0] + size[0] {
            for y in first[1]..first[1] + size[1] {
                let at = (z * ny + y) * nx + first[2];
                values.extend(&self.values[at..at + size[2]]);
                weights.extend(&self.weights[at..at + size[2]]);
            }
        }
        (values, weights)
    }

    /// Writes a shard of level 0.
    pub(crate) fn write_shard(&self, writer: &ShardWriter, index: ShardIndex) -> Result<(), ome_zarr::OmeZarrError> {
        let edge = self.meta.extent.shard;
        let size = self.meta.extent.shard_size(0, index).unwrap();
        let (values, weights) = self.cut(index.map(|at| (at * edge) as usize), size);
        match self.meta.scalar {
            Scalar::U8 => {
                let values: Vec<u8> = values.iter().map(|v| *v as u8).collect();
                writer.write_shard(index, Samples::U8(&values), &weights)
            }
            Scalar::U16 => {
                let values: Vec<u16> = values.iter().map(|v| *v as u16).collect();
                writer.write_shard(index, Samples::U16(&values), &weights)
            }
            Scalar::F32 => writer.write_shard(index, Samples::F32(&values), &weights),
        }
    }

    /// Writes the whole volume.
    pub(crate) fn write(&self, path: &Path) {
        let (writer, _) = OmeZarrWriter::create(path, &self.meta).unwrap();
        for index in self.meta.extent.shard_indices(0) {
            self.write_shard(writer.shards(), index).unwrap();
        }
        writer.finish().unwrap();
    }
}

/// Reads a whole level.
pub(crate) fn read_level(volume: &OmeZarr, level: usize) -> (Vec<f32>, Vec<f32>) {
    volume.read(level, volume.first(level).unwrap(), volume.grid(level).unwrap().size).unwrap()
}

/// Returns the bits of numbers.
pub(crate) fn bits(numbers: &[f32]) -> Vec<u32> {
    numbers.iter().map(|number| number.to_bits()).collect()
}

/// Returns all files below a folder, by their paths.
pub(crate) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut files = BTreeMap::new();
    walk(folder, "", &mut files);
    files
}

fn walk(folder: &Path, prefix: &str, files: &mut BTreeMap<String, Vec<u8>>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let key = format!("{prefix}{}", path.file_name().unwrap().to_str().unwrap());
        if path.is_dir() {
            walk(&path, &format!("{key}/"), files);
        } else {
            files.insert(key, std::fs::read(path).unwrap());
        }
    }
}
