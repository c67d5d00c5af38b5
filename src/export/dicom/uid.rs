//! Unique identifiers, from what is written.

use sha2::{Digest, Sha256};

/// The identifier of some content: 2.25 and a UUID (version 8, of the first 122 bits that are free of its SHA-256) as a number.
///
/// Each part counts with its length, so that no two lists of parts are one content.
pub(super) fn uid<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut hasher = Sha256::new();
    for part in parts {
        hasher.update((part.len() as u64).to_le_bytes());
        hasher.update(part);
    }
    let hash = hasher.finalize();
    let mut number = [0; 16];
    number.copy_from_slice(&hash[..16]);
    (number[6], number[8]) = (number[6] & 0x0f | 0x80, number[8] & 0x3f | 0x80);
    format!("2.25.{}", u128::from_be_bytes(number))
}
