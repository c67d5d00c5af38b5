//! Facts about this machine that a live session depends on.

use std::fs;
use std::io::Write as _;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::process::{Resource, getegid, geteuid, getgroups, getrlimit};

use drivers::Listing;
use simd::Simd;

/// udev rules that give local users access to the devices, and set FTDI adapters to low latency.
pub(crate) const UDEV_RULES: &str = include_str!("../../../drivers/udev/70-sonoweave.rules");
/// File of the rules, and folders in which udev looks for it.
const RULES_NAME: &str = "70-sonoweave.rules";
const RULES_FOLDERS: [&str; 4] =
    ["/etc/udev/rules.d", "/run/udev/rules.d", "/usr/lib/udev/rules.d", "/lib/udev/rules.d"];
/// Groups that own serial lines and video devices.
const GROUPS: [&str; 2] = ["dialout", "video"];
/// Ports of the console and of OpenIGTLink in the examples.
const PORTS: [u16; 2] = [9110, 18944];
/// Programs that open pages.
const BROWSERS: [&str; 6] = ["firefox", "firefox-esr", "chromium", "google-chrome", "xdg-open", "epiphany"];
/// Data of the disk test: as many blocks, each followed by a sync, as a second of recording has.
const BLOCKS: usize = 8;
const BLOCK_BYTES: usize = 2 << 20;

/// The state of the udev rules.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Rules {
    Missing,
    /// They differ from those of this program.
    Other,
    Installed,
}

/// A group of users.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Group {
    pub(crate) name: &'static str,
    /// Whether this process is a member; `None` if the group does not exist.
    pub(crate) member: Option<bool>,
}

/// Speed of the disk that recordings are written to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct DiskSpeed {
    /// Rate of writing with syncs, MB/s.
    pub(crate) mb_per_s: f64,
    /// The longest write with its sync, s.
    pub(crate) longest_s: f64,
    /// Free space, bytes.
    pub(crate) free_bytes: u64,
}

/// The facts.
#[derive(Debug, Clone)]
pub(crate) struct Facts {
    pub(crate) devices: Vec<Listing>,
    pub(crate) rules: Rules,
    pub(crate) is_root: bool,
    pub(crate) groups: Vec<Group>,
    pub(crate) sets: Vec<Simd>,
    pub(crate) cores: usize,
    /// Largest realtime priority; `None` for no limit.
    pub(crate) rtprio: Option<u64>,
    /// Largest locked memory, bytes; `None` for no limit.
    pub(crate) memlock: Option<u64>,
    pub(crate) folder: PathBuf,
    /// Speed of its disk, or why it cannot be written.
    pub(crate) disk: Result<DiskSpeed, String>,
    /// Ports, and why each cannot be used.
    pub(crate) ports: Vec<(u16, Option<String>)>,
    pub(crate) browser: Option<&'static str>,
}

impl Facts {
    /// Collects the facts. `folder` is that of the recordings; a file is written there and removed.
    pub(crate) fn gather(folder: &Path) -> Self {
        let mut devices: Vec<Listing> = Vec::new();
        for (_, listings) in drivers::list() {
            devices.extend(listings);
        }
        devices.sort_by(|a, b| a.id.cmp(&b.id));
        devices.dedup_by(|a, b| a.id == b.id);
        Self {
            devices,
            rules: rules(),
            is_root: geteuid().is_root(),
            groups: groups(&fs::read_to_string("/etc/group").unwrap_or_default(), &own_groups()),
            sets: Simd::ALL.into_iter().filter(|set| set.is_available()).collect(),
            cores: std::thread::available_parallelism().map_or(1, usize::from),
            rtprio: getrlimit(Resource::Rtprio).current,
            memlock: getrlimit(Resource::Memlock).current,
            folder: folder.to_owned(),
            disk: disk(folder).map_err(|error| error.to_string()),
            ports: PORTS.map(|port| (port, taken(port))).into(),
            browser: browser(),
        }
    }
}

fn rules() -> Rules {
    let file = RULES_FOLDERS.iter().map(|folder| Path::new(folder).join(RULES_NAME)).find(|path| path.exists());
    match file.map(fs::read_to_string) {
        None => Rules::Missing,
        Some(Ok(text)) if text == UDEV_RULES => Rules::Installed,
        Some(_) => Rules::Other,
    }
}

/// Returns the numbers of this process's groups.
fn own_groups() -> Vec<u32> {
    let others = getgroups().unwrap_or_default();
    std::iter::once(getegid()).chain(others).map(rustix::process::Gid::as_raw).collect()
}

/// Returns the groups by the text of `/etc/group`, and the numbers of this process's groups.
fn groups(text: &str, own: &[u32]) -> Vec<Group> {
    let number = |name: &str| {
        let mut fields = text.lines().map(|line| line.split(':')).find_map(|mut fields| {
            let found = fields.next() == Some(name);
            found.then_some(fields)
        })?;
        fields.nth(1)?.parse::<u32>().ok()
    };
    GROUPS.map(|name| Group { name, member: number(name).map(|number| own.contains(&number)) }).into()
}

/// Writes blocks with a sync after each, into a file without a name.
fn disk(folder: &Path) -> std::io::Result<DiskSpeed> {
    let mut file = tempfile::tempfile_in(folder)?;
    // Compressing file systems would be too fast with equal bytes.
    let mut state = 1_u32;
    let block: Vec<u8> = (0..BLOCK_BYTES)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            state.to_be_bytes()[0]
        })
        .collect();
    let began = Instant::now();
    let mut longest = Duration::ZERO;
    for _ in 0..BLOCKS {
        let began = Instant::now();
        file.write_all(&block)?;
        file.sync_data()?;
        longest = longest.max(began.elapsed());
    }
    let seconds = began.elapsed().as_secs_f64();
    let space = rustix::fs::fstatvfs(&file)?;
    Ok(DiskSpeed {
        mb_per_s: (BLOCKS * BLOCK_BYTES) as f64 / 1e6 / seconds,
        longest_s: longest.as_secs_f64(),
        free_bytes: space.f_bavail.saturating_mul(space.f_frsize),
    })
}

fn taken(port: u16) -> Option<String> {
    TcpListener::bind((Ipv4Addr::LOCALHOST, port)).err().map(|error| error.to_string())
}

fn browser() -> Option<&'static str> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    BROWSERS.into_iter().find(|name| folders.iter().any(|folder| folder.join(name).is_file()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_are_read_by_number() {
        let text = "root:x:0:\ndialout:x:20:ann,ben\nvideoX:x:1:\n";
        let group = |name, member| Group { name, member };
        assert_eq!(groups(text, &[0, 20]), [group("dialout", Some(true)), group("video", None)]);
        assert_eq!(groups(text, &[0]), [group("dialout", Some(false)), group("video", None)]);
    }

    #[test]
    fn disk_test_leaves_no_file_and_refuses_missing_folder() {
        let folder = tempfile::tempdir().unwrap();
        let speed = disk(folder.path()).unwrap();
        assert!(speed.mb_per_s > 0.0 && speed.longest_s > 0.0 && speed.free_bytes > 0, "{speed:?}");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        assert!(disk(&folder.path().join("none")).is_err());
    }

    #[test]
    fn taken_port_has_reason() {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
        assert!(taken(listener.local_addr().unwrap().port()).is_some());
    }
}
