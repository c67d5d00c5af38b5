//! Pseudonyms of subjects by a secret key, and the shift of their dates.
//!
//! Both are HMAC-SHA-256 of the subject's id: without the key nobody can find the id by trying all
//! ids, and with it the same subject has the same pseudonym in every run.

use std::fs::File;
use std::io::Read as _;
use std::path::Path;

use hmac::{Hmac, KeyInit as _, Mac as _};
use sha2::Sha256;

use sonoweave_core::date::Second;

use crate::failure::{Failure, FailureKind};

/// Fewest bytes of a key.
const SHORTEST_KEY: usize = 32;
/// Most bytes of a key's file: a longer one is taken for another file.
const LONGEST_KEY: usize = 4096;
/// Bytes of a pseudonym, of the 32 of the hash.
const BYTES: usize = 8;
/// Dates are moved into the past by one day at least, and ten years at most, s.
const SHIFT_S: std::ops::Range<u64> = 86_400..10 * 365 * 86_400;

/// A secret key, which gives pseudonyms.
pub(crate) struct PseudonymKey(Vec<u8>);

impl PseudonymKey {
    /// Reads a key: the bytes of a file.
    ///
    /// # Errors
    /// [`Failure`] when the file cannot be read, or is too short or too long for a key.
    pub(crate) fn read(path: &Path) -> Result<Self, Failure> {
        let failed = |e: std::io::Error| Failure::io(path, "reading", &e);
        let mut key = Vec::new();
        File::open(path).map_err(failed)?.take(LONGEST_KEY as u64 + 1).read_to_end(&mut key).map_err(failed)?;
        if (SHORTEST_KEY..=LONGEST_KEY).contains(&key.len()) {
            return Ok(Self(key));
        }
        let sentence = format!(
            "{}: has {} bytes, but a key has {SHORTEST_KEY} to {LONGEST_KEY}; make one by `head -c 32 /dev/urandom > FILE`",
            path.display(),
            if key.len() > LONGEST_KEY { "more".to_owned() } else { key.len().to_string() }
        );
        Err(Failure::new(sentence).of(FailureKind::Input))
    }

    /// Returns the hash of an id, for a use.
    fn hash(&self, usage: &str, id: &str) -> [u8; 32] {
        let mut mac = Hmac::<Sha256>::new_from_slice(&self.0).unwrap_or_else(|_| unreachable!("keys have any length"));
        // No use contains a zero, so that no two pairs have the same bytes.
        mac.update(usage.as_bytes());
        mac.update(&[0]);
        mac.update(id.as_bytes());
        mac.finalize().into_bytes().into()
    }

    /// Returns the pseudonym of an id; `usage` says whose it is, such as `subject`.
    pub(crate) fn pseudonym(&self, usage: &str, id: &str) -> String {
        let hash = self.hash(usage, id);
        hash[..BYTES].iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// Returns a time of a subject, moved into the past by the subject's own shift; `None` before
    /// the year 1.
    pub(crate) fn shifted(&self, subject: &str, time: Second) -> Option<Second> {
        let [a, b, c, d, e, f, g, h, ..] = self.hash("shift", subject);
        let number = u64::from_be_bytes([a, b, c, d, e, f, g, h]);
        let seconds = SHIFT_S.start + number % (SHIFT_S.end - SHIFT_S.start);
        time.earlier_by(seconds as i64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn key(byte: u8) -> PseudonymKey {
        PseudonymKey(vec![byte; 32])
    }

    #[test]
    fn pseudonym_is_hmac_sha_256_of_use_and_id() {
        // Computed with Python: hmac.new(bytes([7]) * 32, b"subject\0anna", "sha256").
        assert_eq!(key(7).pseudonym("subject", "anna"), "4380c032e88e4532");
        let others = [
            key(8).pseudonym("subject", "anna"),
            key(7).pseudonym("session", "anna"),
            key(7).pseudonym("subject", "ann"),
        ];
        assert!(others.iter().all(|other| *other != key(7).pseudonym("subject", "anna")), "{others:?}");
    }

    #[test]
    fn intervals_of_a_subject_stay_and_dates_move() {
        let time = |text: &str| Second::parse(text).unwrap();
        let (first, second) = (time("20260101120000"), time("20260315083017"));
        let shift = |subject: &str, byte: u8, time: Second| key(byte).shifted(subject, time).unwrap();
        let [a, b] = [first, second].map(|time| shift("anna", 7, time));
        assert_eq!(b.unix_s() - a.unix_s(), second.unix_s() - first.unix_s());
        let moved = |subject, byte| first.unix_s() - shift(subject, byte, first).unix_s();
        let shifts = [moved("anna", 7), moved("ben", 7), moved("anna", 8)];
        assert!(shifts.iter().all(|s| SHIFT_S.contains(&(*s as u64))), "{shifts:?}");
        assert!(shifts[0] != shifts[1] && shifts[0] != shifts[2], "{shifts:?}");
    }

    #[test]
    fn short_and_long_keys_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        for (bytes, is_good) in [(0, false), (31, false), (32, true), (4096, true), (4097, false)] {
            std::fs::write(&path, vec![1; bytes]).unwrap();
            assert_eq!(PseudonymKey::read(&path).is_ok(), is_good, "{bytes} bytes");
        }
    }
}
