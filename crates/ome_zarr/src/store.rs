//! Read access to the files of a volume, for the array library.

use std::fs::File;
use std::io::ErrorKind;
use std::os::unix::fs::FileExt as _;
use std::path::PathBuf;

use zarrs::storage::byte_range::{ByteRange, ByteRangeIterator, InvalidByteRangeError};
use zarrs::storage::{Bytes, MaybeBytesIterator, ReadableStorageTraits, StorageError, StoreKey};

/// The folder of a volume.
#[derive(Debug)]
pub(crate) struct FolderStore(pub(crate) PathBuf);

impl FolderStore {
    /// Opens the file of a key; `None` if there is none.
    fn open(&self, key: &StoreKey) -> Result<Option<(File, u64)>, StorageError> {
        let path = self.0.join(key.as_str());
        let opened = File::open(&path).and_then(|file| Ok((file.metadata()?, file)));
        match opened {
            Ok((about, file)) if about.is_file() => Ok(Some((file, about.len()))),
            Ok(_) => Err(ErrorKind::IsADirectory.into()).map_err(|error: std::io::Error| error.into()),
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error.into()),
        }
    }
}

/// Reads a part of a file. Offsets come from the file itself, and may be anything.
fn read(file: &File, length: u64, range: ByteRange) -> Result<Bytes, StorageError> {
    let within = match range {
        ByteRange::FromStart(start, None) => length.checked_sub(start).map(|count| (start, count)),
        ByteRange::FromStart(start, Some(count)) => {
            start.checked_add(count).filter(|end| *end <= length).map(|_| (start, count))
        }
        ByteRange::Suffix(count) => length.checked_sub(count).map(|start| (start, count)),
    };
    let (start, count) = within.ok_or(InvalidByteRangeError::new(range, length))?;
    let mut bytes = vec![0; usize::try_from(count).map_err(|_| InvalidByteRangeError::new(range, length))?];
    file.read_exact_at(&mut bytes, start)?;
    Ok(bytes.into())
}

impl ReadableStorageTraits for FolderStore {
    fn get_partial_many<'a>(
        &'a self,
        key: &StoreKey,
        byte_ranges: ByteRangeIterator<'a>,
    ) -> Result<MaybeBytesIterator<'a>, StorageError> {
        let Some((file, length)) = self.open(key)? else { return Ok(None) };
        Ok(Some(Box::new(byte_ranges.map(move |range| read(&file, length, range)))))
    }

    fn size_key(&self, key: &StoreKey) -> Result<Option<u64>, StorageError> {
        Ok(self.open(key)?.map(|(_, length)| length))
    }

    fn supports_get_partial(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_beyond_the_file_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a"), "0123456789").unwrap();
        std::fs::create_dir(folder.path().join("b")).unwrap();
        let store = FolderStore(folder.path().into());
        let key = |name: &str| StoreKey::new(name).unwrap();
        let text = |range| store.get_partial(&key("a"), range).map(|bytes| bytes.unwrap().to_vec());
        assert_eq!(text(ByteRange::FromStart(2, Some(3))).unwrap(), b"234");
        assert_eq!(text(ByteRange::FromStart(8, None)).unwrap(), b"89");
        assert_eq!(text(ByteRange::Suffix(2)).unwrap(), b"89");
        for range in [
            ByteRange::FromStart(8, Some(3)),
            ByteRange::FromStart(u64::MAX, Some(2)),
            ByteRange::FromStart(11, None),
            ByteRange::Suffix(11),
        ] {
            assert!(matches!(text(range), Err(StorageError::InvalidByteRangeError(_))), "{range}");
        }
        assert_eq!(store.get(&key("c")).unwrap(), None);
        assert_eq!(store.size_key(&key("a")).unwrap(), Some(10));
        assert!(matches!(store.size_key(&key("b")), Err(StorageError::IOError(_))));
    }
}
