//! Credentials: a token from a file, of which only a hash is kept, and cookies. A browser
//! cannot send the token with each request, so it gets a cookie for it.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::Read as _;
use std::net::IpAddr;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;
use tokio_rustls::rustls::crypto::SecureRandom;

use listener::counted_address;

/// Fewest characters of a token.
pub const LEAST: usize = 32;
/// Most bytes of a token file, with the end of line.
const MOST: u64 = 4096;
/// Wrong tokens allowed per address within [`WHILE`].
pub(super) const TRIES: usize = 5;
/// Time for which wrong tokens count.
pub(super) const WHILE: Duration = Duration::from_secs(60);
/// Largest number of wrong tokens remembered, of all addresses.
const REMEMBERED: usize = 4096;
/// Largest number of known browsers.
const BROWSERS: usize = 64;

/// Hash of the token that requests must carry.
#[derive(Clone)]
pub(super) struct Token([u8; 32]);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

impl Token {
    /// Reads the token from a file's first and only line.
    ///
    /// # Errors
    /// The file's fault, as the rest of a sentence.
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        let cannot = |error: std::io::Error| format!("cannot be read: {error}");
        if !path.metadata().map_err(cannot)?.is_file() {
            return Err("is not a file".into());
        }
        let file = File::open(path).map_err(cannot)?;
        // The mode of the opened file, not of a file that has replaced it.
        let mode = file.metadata().map_err(cannot)?.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(format!(
                "other users may read or write it (mode {:o}); run chmod 600, and make a new token if another user has \
                read it",
                mode & 0o777
            ));
        }
        let mut text = String::new();
        file.take(MOST + 1).read_to_string(&mut text).map_err(cannot)?;
        if text.len() as u64 > MOST {
            return Err(format!("holds more than {MOST} bytes, too many for a token"));
        }
        Self::of(text.trim_end_matches(['\n', '\r']))
    }

    /// # Errors
    /// The token's fault, as the rest of a sentence.
    pub(super) fn of(text: &str) -> Result<Self, String> {
        if !text.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err("must hold one line of letters, digits and signs without spaces".into());
        }
        if text.len() < LEAST {
            return Err(format!(
                "holds a token of {} characters, but {LEAST} or more are needed; make one by `openssl rand -hex 32`",
                text.len()
            ));
        }
        Ok(Self(Sha256::digest(text).into()))
    }

    /// Whether both are one token.
    pub(super) fn same(&self, other: &Self) -> bool {
        bool::from(self.0.ct_eq(&other.0))
    }

    /// Whether this is the token. The comparison takes the same time for all wrong ones.
    pub(super) fn is(&self, hash: &str) -> bool {
        let hash: [u8; 32] = Sha256::digest(hash).into();
        bool::from(self.0.ct_eq(&hash))
    }
}

/// Returns the token of an `Authorization: Bearer` header.
pub fn bearer(header: &str) -> Option<&str> {
    let (scheme, token) = header.split_once(' ')?;
    let token = token.trim_matches(' ');
    (scheme.eq_ignore_ascii_case("bearer") && !token.is_empty()).then_some(token)
}

/// Returns the values that a `Cookie` header has for a name.
pub fn cookies<'h>(header: &'h str, name: &str) -> impl Iterator<Item = &'h str> {
    header.split(';').filter_map(move |pair| pair.trim_matches([' ', '\t']).strip_prefix(name)?.strip_prefix('='))
}

/// The recent wrong tokens, by address.
#[derive(Debug, Default)]
pub(super) struct Attempts(VecDeque<(Instant, IpAddr)>);

impl Attempts {
    /// Returns the time for which an address is blocked; `None` if it is not.
    pub(super) fn waits(&mut self, from: IpAddr, now: Instant) -> Option<Duration> {
        while self.0.front().is_some_and(|(at, _)| now.saturating_duration_since(*at) >= WHILE) {
            self.0.pop_front();
        }
        let from = counted_address(from);
        let mut own = self.0.iter().rev().filter(|(_, of)| *of == from);
        let oldest = own.nth(TRIES - 1)?.0;
        Some(WHILE.saturating_sub(now.saturating_duration_since(oldest)))
    }

    /// Records a wrong token. Beyond the limit, the oldest is forgotten.
    pub(super) fn failed(&mut self, from: IpAddr, now: Instant) {
        if self.0.len() == REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((now, counted_address(from)));
    }
}

/// Browsers that have shown the token. The newest are known until the session ends.
#[derive(Debug, Default)]
pub(super) struct Browsers(VecDeque<[u8; 32]>);

impl Browsers {
    /// Creates the identifier of a browser that has shown the token; `None` if no random
    /// numbers are available.
    pub(super) fn admit(&mut self, chance: &dyn SecureRandom) -> Option<String> {
        let mut bytes = [0; 32];
        chance.fill(&mut bytes).ok()?;
        let id = URL_SAFE_NO_PAD.encode(bytes);
        if self.0.len() == BROWSERS {
            self.0.pop_front();
        }
        self.0.push_back(Sha256::digest(&id).into());
        Some(id)
    }

    /// Whether this identifier belongs to a known browser.
    pub(super) fn knows(&self, id: &str) -> bool {
        let hash: [u8; 32] = Sha256::digest(id).into();
        self.0.iter().fold(false, |known, own| known | bool::from(own.ct_eq(&hash)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef0123456789abcdef";

    fn file(text: &[u8], mode: u32) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), text).unwrap();
        std::fs::set_permissions(file.path(), std::fs::Permissions::from_mode(mode)).unwrap();
        file
    }

    #[test]
    fn token_file_must_be_private_and_token_strong() {
        let read = |text: &[u8], mode| Token::read(file(text, mode).path()).map_err(|why| why.to_string());
        let token = read(format!("{TOKEN}\r\n").as_bytes(), 0o600).unwrap();
        assert!(token.is(TOKEN) && !token.is("") && !token.is(&TOKEN[1..]) && !token.is(&TOKEN.to_uppercase()));
        assert!(!format!("{token:?}").contains(char::is_numeric), "it is told to nobody");
        assert!(read(TOKEN.as_bytes(), 0o400).is_ok());
        for mode in [0o640, 0o604, 0o620, 0o601, 0o666] {
            assert!(read(TOKEN.as_bytes(), mode).unwrap_err().contains("chmod 600"), "{mode:o}");
        }
        for (text, sentence) in [
            (&b""[..], "of 0 characters"),
            (&TOKEN.as_bytes()[1..], "of 31 characters, but 32 or more are needed"),
            (b"0123456789abcdef 0123456789abcdef", "without spaces"),
            (b"0123456789abcdef0123456789abcdef\nmore", "must hold one line"),
            (&[b'x'; 5000], "too many for a token"),
            (&[0xff; 40], "cannot be read"),
        ] {
            let why = read(text, 0o600).unwrap_err();
            assert!(why.contains(sentence), "{why}");
        }
        let folder = tempfile::tempdir().unwrap();
        assert!(Token::read(folder.path()).unwrap_err().contains("is not a file"));
        assert!(Token::read(&folder.path().join("none")).unwrap_err().contains("cannot be read"));
    }

    #[test]
    fn headers_yield_tokens_and_cookies() {
        assert_eq!(
            [bearer("Bearer x"), bearer("bEARER  y "), bearer("Bearer x y")],
            [Some("x"), Some("y"), Some("x y")]
        );
        assert_eq!([bearer("Basic x"), bearer("Bearer"), bearer("Bearer "), bearer("")], [None; 4]);
        let found = |header| cookies(header, "a").collect::<Vec<_>>();
        assert_eq!(found("a=1"), ["1"]);
        assert_eq!(found("aa=0; a=1;a=2 ; b=3; a; a=="), ["1", "2", "="]);
        assert_eq!(found(""), [""; 0]);
    }

    #[test]
    fn wrong_tokens_block_address_with_bounded_memory() {
        let begun = Instant::now();
        let after = |seconds| begun + Duration::from_secs(seconds);
        let mut attempts = Attempts::default();
        let [one, other]: [IpAddr; 2] = [[10, 0, 0, 1].into(), [10, 0, 0, 2].into()];
        for n in 0..5 {
            assert_eq!(attempts.waits(one, after(n)), None, "{n}");
            attempts.failed(one, after(n));
        }
        assert_eq!(attempts.waits(one, after(10)), Some(Duration::from_secs(50)));
        assert_eq!(attempts.waits("::ffff:10.0.0.1".parse().unwrap(), after(10)), Some(Duration::from_secs(50)));
        assert_eq!(attempts.waits(other, after(10)), None);
        assert_eq!(attempts.waits(one, after(60)), None, "the first is forgotten");
        attempts.failed(one, after(60));
        assert_eq!(attempts.waits(one, after(60)), Some(Duration::from_secs(1)));
        // Another address of the same network counts as the same.
        let six = |n: u16| IpAddr::from([0x2001, 0xdb8, 0, 1, 0, 0, 0, n]);
        (0..5).for_each(|n| attempts.failed(six(n), after(60)));
        assert!(attempts.waits(six(99), after(61)).is_some());
        (0..10_000_u32).for_each(|n| attempts.failed(IpAddr::V4(n.into()), after(61)));
        assert_eq!(attempts.0.len(), REMEMBERED);
    }

    #[test]
    fn newest_browsers_are_known_by_their_identifier() {
        let provider = tokio_rustls::rustls::crypto::ring::default_provider();
        let mut browsers = Browsers::default();
        let first = browsers.admit(provider.secure_random).unwrap();
        assert_eq!(first.len(), 43);
        assert!(browsers.knows(&first) && !browsers.knows("") && !browsers.knows(&first[1..]));
        let more: Vec<String> = (0..64).map(|_| browsers.admit(provider.secure_random).unwrap()).collect();
        assert!(!browsers.knows(&first) && more.iter().all(|id| browsers.knows(id)));
    }
}
