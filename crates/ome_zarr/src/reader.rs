//! Reads volumes of this program and others, box by box.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DAffine3, DMat3, DVec3};

use sonoweave_core::frames::{Transform, Volume, World};
use volume::Grid;

use crate::array::{Element, LevelArray};
use crate::attributes::Own;
use crate::error::OmeZarrError;
use crate::image::{Image, NoImage, Place};
use crate::metadata::{FILE, read_json};

/// Files of a group of OME-Zarr 0.4 and earlier.
const EARLIER_FILES: [&str; 2] = [".zattrs", ".zgroup"];
/// Image with the weights.
const WEIGHTS: &str = "weight";
/// Grey range if nothing specifies one.
const GREY_LEVELS: [f32; 2] = [0.0, 255.0];

/// A volume on the disk: its levels, their places, and its provenance.
///
/// ```no_run
/// # fn main() -> Result<(), ome_zarr::OmeZarrError> {
/// let volume = ome_zarr::OmeZarr::open("sweep.ome.zarr".as_ref())?;
/// let coarsest = volume.levels() - 1;
/// let (first, size) = (volume.first(coarsest)?, volume.grid(coarsest)?.size);
/// let (values, weights) = volume.read(coarsest, first, size)?;
/// # Ok(())
/// # }
/// ```
pub struct OmeZarr {
    path: PathBuf,
    own: Option<Own>,
    levels: Vec<Arc<Level>>,
    notes: Vec<String>,
}

/// A pyramid level.
pub(crate) struct Level {
    pub(crate) values: LevelArray,
    pub(crate) weights: Option<LevelArray>,
    pub(crate) grid: Grid,
    pub(crate) world_from_volume: Transform<World, Volume>,
    /// Lattice index of element 0, along x, y, z.
    pub(crate) first: [i64; 3],
    /// Value of unseen voxels where there are no weights.
    pub(crate) unseen: Option<f32>,
}

impl Level {
    /// Reads a box of elements within the array, along z, y, x: values as they are stored, and
    /// weights. Without weights, seen voxels have weight 1. The threads of the pool share the work
    /// if `is_shared`.
    pub(crate) fn read(&self, first: [u64; 3], size: [u64; 3], is_shared: bool) -> Result<[Vec<f32>; 2], OmeZarrError> {
        let values = self.values.read(first, size, is_shared)?;
        let weights = match &self.weights {
            Some(weights) => weights.read(first, size, is_shared)?,
            None => values.iter().map(|value| if self.is_seen(*value) { 1.0 } else { 0.0 }).collect(),
        };
        Ok([values, weights])
    }

    fn is_seen(&self, value: f32) -> bool {
        value.is_finite() && self.unseen != Some(value)
    }
}

impl OmeZarr {
    /// Opens a volume and reads its metadata: an image of OME-Zarr 0.5 with three axes of space,
    /// one time and one channel, of this or another program. Weights are those of the image
    /// `weight` within it, if there is one of the same levels.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such image, or a part of it is not supported or damaged.
    pub fn open(path: &Path) -> Result<Self, OmeZarrError> {
        let (image, own) = read_image(path, FILE)?;
        let own = own.map_err(|(field, problem)| OmeZarrError::Metadata {
            path: path.into(),
            key: FILE.into(),
            field: format!("attributes.{field}"),
            problem,
        })?;
        let mut notes = image.notes.clone();
        let open = |prefix: &str, image: &Image| -> Result<Vec<LevelArray>, OmeZarrError> {
            let levels = image.levels.iter();
            levels.map(|place| LevelArray::open(path, &format!("{prefix}{}", place.path), image.leading)).collect()
        };
        let arrays = open("", &image)?;
        let shapes = |arrays: &[LevelArray]| arrays.iter().map(|array| array.shape).collect::<Vec<_>>();
        let key = format!("{WEIGHTS}/{FILE}");
        let weights = if !path.join(&key).exists() {
            Ok(None)
        } else {
            let weights = read_image(path, &key).and_then(|(image, _)| open(&format!("{WEIGHTS}/"), &image));
            weights.and_then(|weights| {
                let problem = || "differs from that of the values; copy or write the volume again".to_owned();
                let field = "shape".to_owned();
                let other = || OmeZarrError::Metadata { path: path.into(), key, field, problem: problem() };
                if shapes(&weights) == shapes(&arrays) { Ok(Some(weights)) } else { Err(other()) }
            })
        };
        let weights = match weights {
            // Another program's image of that name may be anything.
            Err(error) if own.is_none() => {
                notes.push(format!("the image {WEIGHTS} is no weights of this volume, and is not used ({error})"));
                None
            }
            weights => weights?,
        };
        let mut weights = weights.map(Vec::into_iter);
        let mut levels = Vec::new();
        for (number, (values, place)) in arrays.into_iter().zip(&image.levels).enumerate() {
            let weights = weights.as_mut().and_then(Iterator::next);
            levels.push(Arc::new(level(number, values, weights, place, &image.levels[0], own.as_ref())));
        }
        Ok(Self { path: path.into(), own, levels, notes })
    }

    /// Returns the path of its folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the number of pyramid levels.
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Returns the grid of a level, by the indices of its elements.
    ///
    /// # Errors
    /// [`OmeZarrError::Level`] when there is no such level.
    pub fn grid(&self, level: usize) -> Result<Grid, OmeZarrError> {
        Ok(self.level(level)?.grid)
    }

    /// Maps indices of a level's elements to world mm.
    ///
    /// # Errors
    /// [`OmeZarrError::Level`] when there is no such level.
    pub fn world_from_volume(&self, level: usize) -> Result<Transform<World, Volume>, OmeZarrError> {
        Ok(self.level(level)?.world_from_volume)
    }

    /// Returns the lattice index of a level's element 0. Other programs' volumes begin at 0.
    ///
    /// # Errors
    /// [`OmeZarrError::Level`] when there is no such level.
    pub fn first(&self, level: usize) -> Result<[i64; 3], OmeZarrError> {
        Ok(self.level(level)?.first)
    }

    /// Returns whether this program has written the volume.
    pub fn is_own(&self) -> bool {
        self.own.is_some()
    }

    /// Returns whether the volume has weights.
    pub fn has_weights(&self) -> bool {
        self.levels.iter().all(|level| level.weights.is_some())
    }

    /// Returns the provenance: fields by name, in order. Empty for other programs' volumes.
    pub fn fields(&self) -> &[(String, String)] {
        self.own.as_ref().map_or(&[], |own| &own.fields)
    }

    /// Returns the name of the content that the writer was given.
    pub fn content_key(&self) -> Option<&str> {
        self.own.as_ref().map(|own| own.content_key.as_str())
    }

    /// Returns first and last voxel of the box that the slices' data reaches, by lattice index of
    /// level 0, if the volume has it.
    pub fn slices_box(&self) -> Option<[[i64; 3]; 2]> {
        self.own.as_ref().and_then(|own| own.slices_box)
    }

    /// Notes for the user: sentences.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns the values of black and white: those of the volume, else of its scalar type, else
    /// the smallest and the largest value seen at the coarsest level.
    ///
    /// # Errors
    /// [`OmeZarrError`] when that level cannot be read.
    pub fn range(&self) -> Result<[f32; 2], OmeZarrError> {
        let own = self.own.as_ref();
        if let Some(range) = own.and_then(|own| own.range) {
            return Ok(range);
        }
        let Some(coarsest) = self.levels.last() else { return Ok(GREY_LEVELS) };
        match coarsest.values.element {
            Element::U8 => return Ok(GREY_LEVELS),
            Element::U16 => return Ok([0.0, f32::from(u16::MAX)]),
            Element::F32 if own.is_some() => return Ok(GREY_LEVELS),
            _ => {}
        }
        let [mut low, mut high] = [f32::INFINITY, f32::NEG_INFINITY];
        let (chunk, shape) = (coarsest.values.chunk, coarsest.values.shape);
        for index in coarsest.values.all_chunks() {
            let first: [u64; 3] = std::array::from_fn(|a| index[a] * chunk[a]);
            let size = std::array::from_fn(|a| chunk[a].min(shape[a] - first[a]));
            let [values, weights] = coarsest.read(first, size, true)?;
            for (value, _) in values.into_iter().zip(weights).filter(|(value, w)| *w > 0.0 && value.is_finite()) {
                (low, high) = (low.min(value), high.max(value));
            }
        }
        Ok(if low < high {
            [low, high]
        } else if low.is_finite() {
            [low, low + 1.0]
        } else {
            GREY_LEVELS
        })
    }

    /// Reads a box of a level, from the lattice index `first` on, along x, y, z. Returns values and
    /// weights, x fastest. Voxels are seen if their weight is above 0; filled ones have a negative
    /// weight. Beyond the volume, and where nothing was seen, the weight is 0.
    ///
    /// # Errors
    /// [`OmeZarrError`] when there is no such level, the box does not fit into memory, or data is
    /// damaged.
    pub fn read(&self, level: usize, first: [i64; 3], size: [u64; 3]) -> Result<(Vec<f32>, Vec<f32>), OmeZarrError> {
        let of = self.level(level)?;
        let voxels = size.iter().try_fold(1_u64, |n, s| n.checked_mul(*s)).and_then(|n| usize::try_from(n).ok());
        let filled = |value: f32| {
            let mut all = Vec::new();
            voxels.and_then(|voxels| {
                all.try_reserve_exact(voxels).ok()?;
                all.resize(voxels, value);
                Some(all)
            })
        };
        let memory = || OmeZarrError::Memory { path: self.path.clone(), level, size };
        let (mut values, mut weights) =
            filled(of.unseen.unwrap_or(of.values.fill)).zip(filled(0.0)).ok_or_else(memory)?;
        // The part within the array, along z, y, x.
        let (mut inner, mut count, mut skipped) = ([0; 3], [0; 3], [0; 3]);
        for (a, axis) in [2, 1, 0].into_iter().enumerate() {
            let start = i128::from(first[axis]) - i128::from(of.first[axis]);
            let clamp = |at: i128| at.clamp(0, i128::from(of.values.shape[a])) as u64;
            let (from, to) = (clamp(start), clamp(start + i128::from(size[axis])));
            (inner[a], count[a]) = (from, to - from);
            skipped[a] = (i128::from(from) - start).max(0) as usize;
        }
        if count.contains(&0) {
            return Ok((values, weights));
        }
        let [read_values, read_weights] = of.read(inner, count, true)?;
        let ([nx, ny, _], [_, rows, row]) = (size.map(|n| n as usize), count.map(|n| n as usize));
        for (line, (from_values, from_weights)) in
            read_values.chunks_exact(row).zip(read_weights.chunks_exact(row)).enumerate()
        {
            let (z, y) = (skipped[0] + line / rows, skipped[1] + line % rows);
            let at = (z * ny + y) * nx + skipped[2];
            values[at..at + row].copy_from_slice(from_values);
            weights[at..at + row].copy_from_slice(from_weights);
        }
        Ok((values, weights))
    }

    /// Returns a level.
    pub(crate) fn level(&self, level: usize) -> Result<&Arc<Level>, OmeZarrError> {
        let levels = self.levels.len();
        self.levels.get(level).ok_or_else(|| OmeZarrError::Level { path: self.path.clone(), level, levels })
    }
}

/// An image, and this program's own attributes, or the fault in one.
type Described = (Image, Result<Option<Own>, (String, String)>);

/// Reads the metadata of an image.
fn read_image(path: &Path, key: &str) -> Result<Described, OmeZarrError> {
    let key_of = || key.to_owned();
    let Some(json) = read_json(path, key)? else {
        if EARLIER_FILES.iter().any(|file| path.join(file).exists()) {
            let found = "0.4 or earlier (Zarr version 2)".to_owned();
            return Err(OmeZarrError::Version { path: path.into(), found });
        }
        return Err(OmeZarrError::NoVolume { path: path.into(), key: key_of() });
    };
    let attributes = &json["attributes"];
    let image = Image::read(attributes).map_err(|reason| match reason {
        NoImage::Absent => OmeZarrError::NoImage { path: path.into(), key: key_of() },
        NoImage::Version(found) => OmeZarrError::Version { path: path.into(), found },
        NoImage::Field(field, problem) => {
            let field = format!("attributes.{field}");
            OmeZarrError::Metadata { path: path.into(), key: key_of(), field, problem }
        }
    })?;
    Ok((image, Own::read(attributes)))
}

/// Places a level in the world.
fn level(
    number: usize,
    values: LevelArray,
    weights: Option<LevelArray>,
    place: &Place,
    finest: &Place,
    own: Option<&Own>,
) -> Level {
    let xyz = |[z, y, x]: [f64; 3]| DVec3::new(x, y, z);
    let [nz, ny, nx] = values.shape;
    let spacing = xyz(place.scale);
    let mut grid = Grid { origin: xyz(place.translation), spacing, direction: DMat3::IDENTITY, size: [nx, ny, nz] };
    let mut world_from_volume = grid.world_from_volume();
    if let Some(affine) = own.and_then(|own| own.world_from_volume) {
        // The matrix is that of level 0; the scales of the other levels stretch its axes.
        let factor = spacing / xyz(finest.scale);
        let origin = affine.transform_point3((factor - 1.0) / 2.0);
        let matrix3 = affine.matrix3 * DMat3::from_diagonal(factor);
        world_from_volume = Transform::from_affine(DAffine3 { matrix3, translation: origin });
        grid.origin = origin;
        grid.direction = matrix3 * DMat3::from_diagonal(1.0 / spacing);
    }
    let first = own.map_or([0; 3], |own| own.first.map(|at| at.div_euclid(1 << number.min(62))));
    let unseen = own.is_some().then_some(values.fill);
    Level { values, weights, grid, world_from_volume, first, unseen }
}
