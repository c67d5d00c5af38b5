//! SHA-256 as text.

use sha2::{Digest as _, Sha256};

/// Characters of the beginning that names something for people.
const SHORT: usize = 12;

/// Returns the hash of bytes, 64 hexadecimal digits, as `sha256sum` prints it.
pub(crate) fn of(bytes: impl AsRef<[u8]>) -> String {
    text(Sha256::new_with_prefix(bytes))
}

/// Returns a finished hash as 64 hexadecimal digits.
pub(crate) fn text(hasher: Sha256) -> String {
    hasher.finalize().iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns the beginning of a hash, which names something for people.
pub(crate) fn short(hash: &str) -> &str {
    hash.get(..SHORT).unwrap_or(hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_is_that_of_sha256sum() {
        let hash = of("abc");
        assert_eq!(hash, "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
        assert_eq!([short(&hash), short("ba")], ["ba7816bf8f01", "ba"]);
    }
}
