//! Errors of OME-Zarr volumes.

use std::path::PathBuf;

/// Error of an OME-Zarr volume. Nothing has changed on disk beyond the unfinished volume.
#[derive(Debug, thiserror::Error)]
pub enum OmeZarrError {
    /// The operating system refused something: no space, no permission, no such folder.
    #[error("{path}: {doing} failed: {source}", path = .path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// Operation that failed.
        doing: &'static str,
        /// The operating system's reason.
        #[source]
        source: std::io::Error,
    },
    /// A file where a folder is needed.
    #[error("{path}: is a file, and an OME-Zarr volume is a folder; give another name, or move the file", path = .path.display())]
    IsFile {
        /// The file.
        path: PathBuf,
    },
    /// A folder that this program does not replace.
    #[error("{path}: is a folder, but not of an OME-Zarr volume, and is not replaced; give another name, or move it", path = .path.display())]
    NotReplaced {
        /// The folder.
        path: PathBuf,
    },
    /// Another writer has the unfinished volume.
    #[error("{path}: is being written by another program; wait until it ends, or give another name", path = .path.display())]
    Busy {
        /// The folder of the unfinished volume.
        path: PathBuf,
    },
    /// No unfinished volume of this description.
    #[error("{path}: is no unfinished volume of this description; begin it again", path = .path.display())]
    NotBegun {
        /// The folder of the unfinished volume.
        path: PathBuf,
    },
    /// A description that cannot be written.
    #[error("{path}: {source}", path = .path.display())]
    Unwritable {
        /// The volume.
        path: PathBuf,
        /// Fault and remedy.
        source: BadMeta,
    },
    /// A shard that is not as it must be, or a call in the wrong order.
    #[error("{path}: shard {key}: {source}", path = .path.display())]
    Shard {
        /// The volume.
        path: PathBuf,
        /// The shard: its file in the volume.
        key: String,
        /// Fault and remedy.
        source: BadShard,
    },
    /// No OME-Zarr volume.
    #[error("{path}: has no {key}, and is no OME-Zarr volume; give the folder that holds this file", path = .path.display())]
    NoVolume {
        /// The folder.
        path: PathBuf,
        /// The missing file.
        key: String,
    },
    /// A group without an image, such as the root of a plate.
    #[error("{path}: {key} describes no image (no multiscales); give the folder of an image within it", path = .path.display())]
    NoImage {
        /// The folder.
        path: PathBuf,
        /// The metadata file.
        key: String,
    },
    /// Another version of OME-Zarr.
    #[error("{path}: is OME-Zarr {found}, of which only 0.5 is read; convert it to 0.5", path = .path.display())]
    Version {
        /// The folder.
        path: PathBuf,
        /// Version found.
        found: String,
    },
    /// A field of the metadata that is missing, malformed, or not supported.
    #[error("{path}: {key}: field {field}: {problem}", path = .path.display())]
    Metadata {
        /// The folder.
        path: PathBuf,
        /// The metadata file.
        key: String,
        /// The field.
        field: String,
        /// Fault and remedy.
        problem: String,
    },
    /// Metadata that is no JSON.
    #[error("{path}: {key}: is not valid JSON ({problem}); copy or write the volume again", path = .path.display())]
    Json {
        /// The folder.
        path: PathBuf,
        /// The metadata file.
        key: String,
        /// The fault, with line and column.
        problem: String,
    },
    /// An array that cannot be opened: no metadata, or codecs that are not read.
    #[error("{path}: array {key} cannot be read: {problem}; copy or convert the volume again", path = .path.display())]
    Array {
        /// The folder.
        path: PathBuf,
        /// The array.
        key: String,
        /// The fault.
        problem: String,
    },
    /// Data that does not match its checksum or its length.
    #[error("{path}: {key} is damaged: {problem}; delete it and write the volume again, or copy a whole one", path = .path.display())]
    Damaged {
        /// The folder.
        path: PathBuf,
        /// The array or shard.
        key: String,
        /// The fault.
        problem: String,
    },
    /// A level that the volume does not have.
    #[error("{path}: has no level {level}; give one below {levels}", path = .path.display())]
    Level {
        /// The folder.
        path: PathBuf,
        /// Level asked for.
        level: usize,
        /// Number of levels.
        levels: usize,
    },
    /// More voxels than may be read at once.
    #[error("{path}: {} voxels of level {level} do not fit into memory; read a smaller box, or a coarser level",
        size.map(|n| n.to_string()).join("×"), path = .path.display())]
    Memory {
        /// The folder.
        path: PathBuf,
        /// The level.
        level: usize,
        /// Voxels along x, y, z.
        size: [u64; 3],
    },
}

/// Reason why a volume cannot be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadMeta {
    /// No voxels.
    #[error("a volume must have at least one voxel along each axis, and at most 2⁶² in all")]
    Size,
    /// Edges of shard and chunk that do not fit.
    #[error(
        "a shard has {shard} voxels along its edge and a chunk {chunk}; the first must be even, and a multiple of the second"
    )]
    Edges {
        /// Edge of a shard.
        shard: u64,
        /// Edge of a chunk.
        chunk: u64,
    },
    /// Element 0 not at the beginning of a shard.
    #[error(
        "element 0 has the lattice index {index} along {axis}, which must be a multiple of {edge}, the shard's edge"
    )]
    Unaligned {
        /// `x`, `y` or `z`.
        axis: char,
        /// Its lattice index.
        index: i64,
        /// Voxels along a shard's edge.
        edge: u64,
    },
    /// Spacing, origin or direction without meaning.
    #[error("the spacing must be positive, the origin finite, and the direction three axes that span space")]
    Place,
    /// An unseen value that the scalar type does not have.
    #[error("the value {value} of unseen voxels is none of {scalar}; give one that is")]
    Unseen {
        /// The value.
        value: f32,
        /// Name of the scalar type.
        scalar: &'static str,
    },
}

/// Reason why a shard cannot be written.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum BadShard {
    /// No such shard.
    #[error("the volume has no such shard; give one within its extent")]
    Outside,
    /// Slices of another length.
    #[error("{given} {what} were given, but there must be {expected}")]
    Length {
        /// Values or weights.
        what: &'static str,
        /// Number given.
        given: usize,
        /// Voxels of the shard.
        expected: usize,
    },
    /// Values of another type.
    #[error("values of type {given} were given, but they must be {expected}")]
    Type {
        /// Type given.
        given: &'static str,
        /// Type of the volume.
        expected: &'static str,
    },
    /// A value or weight that is not finite.
    #[error("voxel {at} has {what} that is not finite; leave it unseen (weight 0)")]
    NotFinite {
        /// A value or a weight.
        what: &'static str,
        /// Index in the given slice.
        at: usize,
    },
    /// A child of a parent that is not written.
    #[error("its child {child} is not written yet; write it before its parent")]
    Pending {
        /// The child's file in the volume.
        child: String,
    },
}

impl OmeZarrError {
    /// Returns a closure that makes an error of one of the operating system.
    pub(crate) fn io(path: impl Into<PathBuf>, doing: &'static str) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.into();
        move |source| Self::Io { path, doing, source }
    }
}
