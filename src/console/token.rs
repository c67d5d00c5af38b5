//! What those who ask show that they may: a token in a file, of which only a hash is kept, and for a browser, which cannot be told to say it, a cookie that it gets for it.

use std::collections::VecDeque;
use std::fmt;
use std::fs::File;
use std::io::Read as _;
use std::net::{IpAddr, Ipv6Addr};
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;
use tokio_rustls::rustls::crypto::SecureRandom;

/// Characters of a token at least.
pub const LEAST: usize = 32;
/// And at most, with the file's end of line.
const MOST: u64 = 4096;
/// Wrong tokens that an address may show in [`WHILE`].
pub(super) const TRIES: usize = 5;
/// For how long they count.
pub(super) const WHILE: Duration = Duration::from_secs(60);
/// Wrong tokens that are remembered, of all addresses.
const REMEMBERED: usize = 4096;
/// Browsers that are known at a time.
const BROWSERS: usize = 64;

/// What whoever asks must have.
#[derive(Clone)]
pub(super) struct Token([u8; 32]);

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(…)")
    }
}

impl Token {
    /// Of a file's first and only line.
    ///
    /// # Errors
    /// What is wrong with the file, as the rest of a sentence.
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        let cannot = |error: std::io::Error| format!("cannot be read: {error}");
        if !path.metadata().map_err(cannot)?.is_file() {
            return Err("is no file".into());
        }
        let file = File::open(path).map_err(cannot)?;
        // Of the file that was opened, not of what lies there now.
        let mode = file.metadata().map_err(cannot)?.permissions().mode();
        if mode & 0o077 != 0 {
            return Err(format!(
                "others than its owner may read or write it (mode {:o}): chmod 600, and a new token if somebody has read it",
                mode & 0o777
            ));
        }
        let mut text = String::new();
        file.take(MOST + 1).read_to_string(&mut text).map_err(cannot)?;
        if text.len() as u64 > MOST {
            return Err(format!("holds more than {MOST} bytes, which is no token"));
        }
        Self::of(text.trim_end_matches(['\n', '\r']))
    }

    /// # Errors
    /// What is wrong with it, as the rest of a sentence.
    pub(super) fn of(text: &str) -> Result<Self, String> {
        if !text.bytes().all(|byte| byte.is_ascii_graphic()) {
            return Err("holds more than one line of letters, digits and signs without spaces".into());
        }
        if text.len() < LEAST {
            return Err(format!(
                "holds a token of {} characters, and {LEAST} are the least: `openssl rand -hex 32` makes one",
                text.len()
            ));
        }
        Ok(Self(Sha256::digest(text).into()))
    }

    /// Whether this is it. It takes the same time for all that are not.
    pub(super) fn is(&self, told: &str) -> bool {
        let told: [u8; 32] = Sha256::digest(told).into();
        bool::from(self.0.ct_eq(&told))
    }
}

/// The token of an `Authorization: Bearer` header.
pub fn bearer(header: &str) -> Option<&str> {
    let (scheme, token) = header.split_once(' ')?;
    let token = token.trim_matches(' ');
    (scheme.eq_ignore_ascii_case("bearer") && !token.is_empty()).then_some(token)
}

/// The values that a `Cookie` header has for a name.
pub fn cookies<'h>(header: &'h str, name: &str) -> impl Iterator<Item = &'h str> {
    header.split(';').filter_map(move |pair| pair.trim_matches([' ', '\t']).strip_prefix(name)?.strip_prefix('='))
}

/// The wrong tokens of late, by address.
#[derive(Debug, Default)]
pub(super) struct Attempts(VecDeque<(Instant, IpAddr)>);

impl Attempts {
    /// For how long an address may not try any more; `None` where it may.
    pub(super) fn waits(&mut self, from: IpAddr, now: Instant) -> Option<Duration> {
        while self.0.front().is_some_and(|(at, _)| now.saturating_duration_since(*at) >= WHILE) {
            self.0.pop_front();
        }
        let from = place(from);
        let mut own = self.0.iter().rev().filter(|(_, of)| *of == from);
        let oldest = own.nth(TRIES - 1)?.0;
        Some(WHILE.saturating_sub(now.saturating_duration_since(oldest)))
    }

    /// One more. Beyond what is remembered the oldest is forgotten.
    pub(super) fn failed(&mut self, from: IpAddr, now: Instant) {
        if self.0.len() == REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((now, place(from)));
    }
}

/// What counts as one address: of IPv6 a network, whose machines have as many addresses as they like.
fn place(address: IpAddr) -> IpAddr {
    match address.to_canonical() {
        IpAddr::V6(address) => Ipv6Addr::from_bits(address.to_bits() >> 64 << 64).into(),
        address @ IpAddr::V4(_) => address,
    }
}

/// The browsers that have shown the token. They are known until the session ends, the newest ones of them.
#[derive(Debug, Default)]
pub(super) struct Browsers(VecDeque<[u8; 32]>);

impl Browsers {
    /// What a browser that has shown the token is known by from now on; `None` where there is no chance to be had.
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

    /// Whether a browser is known by this.
    pub(super) fn knows(&self, id: &str) -> bool {
        let told: [u8; 32] = Sha256::digest(id).into();
        self.0.iter().fold(false, |known, own| known | bool::from(own.ct_eq(&told)))
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
    fn a_token_s_file_is_for_its_owner_s_eyes_and_holds_one_that_nobody_guesses() {
        let read = |text: &[u8], mode| Token::read(file(text, mode).path()).map_err(|why| why.to_string());
        let token = read(format!("{TOKEN}\r\n").as_bytes(), 0o600).unwrap();
        assert!(token.is(TOKEN) && !token.is("") && !token.is(&TOKEN[1..]) && !token.is(&TOKEN.to_uppercase()));
        assert!(!format!("{token:?}").contains(char::is_numeric), "it is told to nobody");
        assert!(read(TOKEN.as_bytes(), 0o400).is_ok());
        for mode in [0o640, 0o604, 0o620, 0o601, 0o666] {
            assert!(read(TOKEN.as_bytes(), mode).unwrap_err().contains("chmod 600"), "{mode:o}");
        }
        for (text, says) in [
            (&b""[..], "of 0 characters"),
            (&TOKEN.as_bytes()[1..], "of 31 characters, and 32 are the least"),
            (b"0123456789abcdef 0123456789abcdef", "without spaces"),
            (b"0123456789abcdef0123456789abcdef\nmore", "more than one line"),
            (&[b'x'; 5000], "no token"),
            (&[0xff; 40], "cannot be read"),
        ] {
            let why = read(text, 0o600).unwrap_err();
            assert!(why.contains(says), "{why}");
        }
        let folder = tempfile::tempdir().unwrap();
        assert!(Token::read(folder.path()).unwrap_err().contains("is no file"));
        assert!(Token::read(&folder.path().join("none")).unwrap_err().contains("cannot be read"));
    }

    #[test]
    fn tokens_and_cookies_are_found_in_their_headers() {
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
    fn an_address_may_be_wrong_five_times_a_minute_and_all_of_them_take_bounded_memory() {
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
        // Another address of the same network is no other.
        let six = |n: u16| IpAddr::from([0x2001, 0xdb8, 0, 1, 0, 0, 0, n]);
        (0..5).for_each(|n| attempts.failed(six(n), after(60)));
        assert!(attempts.waits(six(99), after(61)).is_some());
        (0..10_000_u32).for_each(|n| attempts.failed(IpAddr::V4(n.into()), after(61)));
        assert_eq!(attempts.0.len(), REMEMBERED);
    }

    #[test]
    fn browsers_are_known_by_what_they_got_the_newest_of_them() {
        let provider = tokio_rustls::rustls::crypto::ring::default_provider();
        let mut browsers = Browsers::default();
        let first = browsers.admit(provider.secure_random).unwrap();
        assert_eq!(first.len(), 43);
        assert!(browsers.knows(&first) && !browsers.knows("") && !browsers.knows(&first[1..]));
        let more: Vec<String> = (0..64).map(|_| browsers.admit(provider.secure_random).unwrap()).collect();
        assert!(!browsers.knows(&first) && more.iter().all(|id| browsers.knows(id)));
    }
}
