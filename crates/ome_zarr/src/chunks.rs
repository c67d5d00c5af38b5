//! Decodes single chunks of an array, with or without shards.
//!
//! The array library decodes parts of a shard without comparing the chunks' checksums. Here each
//! chunk is decoded as a whole, and its place in the shard is checked first.

use std::num::NonZeroU64;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use serde_json::Value;
use zarrs::array::codec::api::{ArrayToBytesCodecTraits as _, CodecError};
use zarrs::array::{Array, BytesRepresentation, CodecChain, CodecOptions, FillValue, data_type};
use zarrs::metadata::v3::MetadataV3;
use zarrs::storage::byte_range::ByteRange;
use zarrs::storage::{Bytes, ReadableStorageTraits as _, StorageError, StoreKey};

use crate::cache::Cache;
use crate::frame::claimed_size;
use crate::store::FolderStore;

/// Name of the codec that makes shards.
const SHARDING: &str = "sharding_indexed";
/// Codec whose frames claim a size.
const ZSTD: &str = "zstd";
/// Bytes that codecs within zstd may add to a chunk.
const ADDED_BYTES: u64 = 1 << 10;
/// Bytes of shards' indices that stay in memory.
const INDEX_BYTES: u64 = 16 << 20;

/// Reason why a chunk cannot be read.
pub(crate) enum Fault {
    /// The operating system's.
    System(std::io::Error),
    /// The data's.
    Damaged(String),
}

impl From<StorageError> for Fault {
    fn from(error: StorageError) -> Self {
        match error {
            StorageError::IOError(error) => {
                let kind = error.kind();
                Self::System(error.raw_os_error().map_or(kind.into(), std::io::Error::from_raw_os_error))
            }
            other => Self::Damaged(other.to_string()),
        }
    }
}

impl From<CodecError> for Fault {
    fn from(error: CodecError) -> Self {
        Self::Damaged(error.to_string())
    }
}

/// Reads the chunks of an array.
pub(crate) struct Chunks {
    array: Array<FolderStore>,
    codecs: Arc<CodecChain>,
    shards: Option<Shards>,
    /// Most bytes that a chunk's zstd frame may have, if it is one.
    most_in_frame: Option<u64>,
    /// Bytes of the chunks read so far, as they are stored.
    bytes_read: AtomicU64,
    /// Elements of a chunk along all axes.
    pub(crate) chunk: Vec<NonZeroU64>,
    /// Elements of a shard along all axes; those of a chunk without shards.
    pub(crate) shard: Vec<NonZeroU64>,
}

/// Position of chunks in a shard's file: offset and length of each, x fastest.
type Index = Vec<[u64; 2]>;

/// The shards' indices.
struct Shards {
    codecs: CodecChain,
    /// Bytes of an encoded index.
    bytes: u64,
    is_at_end: bool,
    /// Chunks of a shard along all axes, and offset and length.
    shape: Vec<NonZeroU64>,
    /// Indices by shard, along z, y, x.
    cache: Cache<Index>,
}

impl Chunks {
    /// Prepares the chunks of an array, given its metadata too. Errors are sentences.
    pub(crate) fn new(array: Array<FolderStore>, metadata: &Value) -> Result<Self, String> {
        let grid = array.chunk_shape(&vec![0; array.dimensionality()]).map_err(|error| error.to_string())?;
        let shard: Vec<NonZeroU64> = grid.to_vec();
        let codecs = list(&metadata["codecs"]);
        // Codecs around the shards are rare: such shards are decoded as whole chunks.
        let [sharding] = codecs else { return Ok(Self::without_shards(array, codecs, shard)) };
        if sharding["name"] != SHARDING {
            return Ok(Self::without_shards(array, codecs, shard));
        }
        let configuration = &sharding["configuration"];
        let chain = |codecs: &Value| {
            let codecs: Vec<MetadataV3> = serde_json::from_value(codecs.clone()).map_err(|error| error.to_string())?;
            CodecChain::from_metadata(&codecs).map_err(|error| error.to_string())
        };
        let chunk: Vec<NonZeroU64> =
            serde_json::from_value(configuration["chunk_shape"].clone()).map_err(|error| error.to_string())?;
        let is_whole = |(shard, chunk): (&NonZeroU64, &NonZeroU64)| shard.get() % chunk.get() == 0;
        if chunk.len() != shard.len() || !shard.iter().zip(&chunk).all(is_whole) {
            return Err("its shards are not multiples of their chunks".to_owned());
        }
        let mut shape: Vec<NonZeroU64> =
            shard.iter().zip(&chunk).filter_map(|(shard, chunk)| NonZeroU64::new(shard.get() / chunk.get())).collect();
        shape.extend(NonZeroU64::new(2));
        let codecs = chain(&configuration["index_codecs"])?;
        let size = codecs.encoded_representation(&shape, &data_type::uint64(), &FillValue::from(u64::MAX));
        let Ok(BytesRepresentation::FixedSize(bytes)) = size else {
            return Err("the index of its shards has no fixed size".to_owned());
        };
        let is_at_end = configuration["index_location"] != "start";
        let shards = Some(Shards { codecs, bytes, is_at_end, shape, cache: Cache::new(INDEX_BYTES) });
        let most_in_frame = most_in_frame(&array, list(&configuration["codecs"]), &chunk);
        let codecs = Arc::new(chain(&configuration["codecs"])?);
        Ok(Self { array, codecs, shards, most_in_frame, bytes_read: AtomicU64::new(0), chunk, shard })
    }

    fn without_shards(array: Array<FolderStore>, codecs: &[Value], chunk: Vec<NonZeroU64>) -> Self {
        let most_in_frame = most_in_frame(&array, codecs, &chunk);
        let bytes_read = AtomicU64::new(0);
        Self { codecs: array.codecs(), array, shards: None, most_in_frame, bytes_read, shard: chunk.clone(), chunk }
    }

    /// Returns the bytes of the value that chunks have where they are not stored.
    pub(crate) fn fill(&self) -> &[u8] {
        self.array.fill_value().as_ne_bytes()
    }

    /// Returns a chunk's elements in native byte order; `None` if it is not stored. `index` is the
    /// chunk's along all axes.
    pub(crate) fn read(&self, index: &[u64]) -> Result<Option<Vec<u8>>, Fault> {
        let Some((key, range)) = self.locate(index)? else { return Ok(None) };
        let Some(bytes) = self.array.storage().get_partial(&key, range)? else { return Ok(None) };
        self.bytes_read.fetch_add(bytes.len() as u64, Ordering::Relaxed);
        if claimed_size(&bytes).zip(self.most_in_frame).is_some_and(|(claimed, most)| claimed > most) {
            return Err(Fault::Damaged("a chunk claims to be larger than all others".to_owned()));
        }
        let options = CodecOptions::default().with_concurrent_target(1);
        let (data_type, fill) = (self.array.data_type(), self.array.fill_value());
        let decode = || self.codecs.decode(bytes.to_vec().into(), &self.chunk, data_type, fill, &options);
        // Shards within shards have offsets that are not checked.
        let decoded = catch_unwind(AssertUnwindSafe(decode));
        let decoded = decoded.map_err(|_| Fault::Damaged("an index within is out of range".to_owned()))??;
        let elements = decoded.into_fixed().map_err(|error| Fault::Damaged(error.to_string()))?;
        Ok(Some(elements.into_owned()))
    }

    /// Returns the bytes of the chunks read so far, as they are stored; without indices.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// Returns whether a chunk is stored.
    pub(crate) fn is_stored(&self, index: &[u64]) -> Result<bool, Fault> {
        match self.locate(index)? {
            Some((key, _)) => Ok(self.shards.is_some() || self.array.storage().size_key(&key)?.is_some()),
            None => Ok(false),
        }
    }

    /// Returns the file of a chunk and its part there; `None` if an index has none.
    fn locate(&self, index: &[u64]) -> Result<Option<(StoreKey, ByteRange)>, Fault> {
        let Some(shards) = &self.shards else {
            return Ok(Some((self.array.chunk_key(index), ByteRange::FromStart(0, None))));
        };
        let per_shard = shards.shape.iter().map(|n| n.get());
        let (shard, within): (Vec<u64>, Vec<u64>) =
            index.iter().zip(per_shard.clone()).map(|(at, n)| (at / n, at % n)).unzip();
        let key = self.array.chunk_key(&shard);
        let Some(positions) = self.positions(shards, &shard, &key)? else { return Ok(None) };
        let at = within.iter().zip(per_shard).fold(0, |at, (within, n)| at * n + within);
        match positions.get(at as usize) {
            None | Some([u64::MAX, u64::MAX]) => Ok(None),
            Some([offset, length]) => Ok(Some((key, ByteRange::FromStart(*offset, Some(*length))))),
        }
    }

    /// Returns a shard's index; `None` if there is no such shard.
    fn positions(&self, shards: &Shards, shard: &[u64], key: &StoreKey) -> Result<Option<Arc<Index>>, Fault> {
        let place: [u64; 3] = std::array::from_fn(|a| shard[shard.len() - 3 + a]);
        if let Some(index) = shards.cache.get(place) {
            return Ok(Some(index));
        }
        let range = if shards.is_at_end {
            ByteRange::Suffix(shards.bytes)
        } else {
            ByteRange::FromStart(0, Some(shards.bytes))
        };
        let Some(bytes) = self.array.storage().get_partial(key, range)? else { return Ok(None) };
        let index = Arc::new(shards.decode(&bytes)?);
        shards.cache.put(place, index.clone(), size_of_val(&**index) as u64);
        Ok(Some(index))
    }
}

fn list(value: &Value) -> &[Value] {
    value.as_array().map_or(&[], Vec::as_slice)
}

/// Returns the most bytes of a zstd frame, if zstd is the last codec.
fn most_in_frame(array: &Array<FolderStore>, codecs: &[Value], chunk: &[NonZeroU64]) -> Option<u64> {
    let element = array.fill_value().as_ne_bytes().len() as u64;
    let bytes = chunk.iter().try_fold(element, |n, edge| n.checked_mul(edge.get()));
    bytes.and_then(|n| n.checked_add(ADDED_BYTES)).filter(|_| codecs.last().is_some_and(|last| last["name"] == ZSTD))
}

impl Shards {
    fn decode(&self, bytes: &Bytes) -> Result<Index, Fault> {
        let (data_type, fill) = (data_type::uint64(), FillValue::from(u64::MAX));
        let options = CodecOptions::default().with_concurrent_target(1);
        let decoded = self.codecs.decode(bytes.to_vec().into(), &self.shape, &data_type, &fill, &options)?;
        let decoded = decoded.into_fixed().map_err(|error| Fault::Damaged(error.to_string()))?;
        let number = |bytes: &[u8; 8]| u64::from_ne_bytes(*bytes);
        Ok(decoded.as_chunks::<8>().0.as_chunks::<2>().0.iter().map(|pair| pair.each_ref().map(number)).collect())
    }
}
