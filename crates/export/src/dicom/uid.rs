//! Unique identifiers, derived from the content.

use sha2::{Digest, Sha256};

/// Returns the identifier of some content: 2.25 and a UUID as a number. The UUID is of version
/// 8, from the first 122 free bits of the content's SHA-256.
///
/// Each part is hashed with its length, so that different lists of parts never give the same
/// content.
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
