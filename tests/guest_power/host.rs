//! The tests. Each boots the guest with a disk of its own.

use std::collections::HashMap;
use std::io::{BufRead as _, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use sonoweave_core::clock::SECOND;

use crate::files::{KINDS, Kind};
use crate::loss::{self, Requests};

/// Name and function of a test, which receives the folder of the guest's scripts.
type Test = (&'static str, fn(&Path));

pub(crate) const TESTS: &[Test] = &[
    ("power_cut_takes_at_most_last_second", power_cut_takes_at_most_last_second),
    ("full_disk_loses_counted_frames_only", full_disk_loses_counted_frames_only),
    ("read_only_disk_keeps_what_was_synced", read_only_disk_keeps_what_was_synced),
    ("slow_disk_holds_up_no_capture", slow_disk_holds_up_no_capture),
];

/// Kernel modules of the guest: its disk, and the file system.
const MODULES: &str = "virtio_pci\nvirtio_blk\ncrc32c_generic\next4";
/// Numbers of power cuts, and with `SONOWEAVE_STRESS=quick`.
const CUTS: [u64; 2] = [20, 7];
/// Seed of their instants.
const SEED: u64 = 20;
/// Time from the first frame to a cut, ms.
const AFTER_MS: std::ops::Range<u64> = 300..4000;

/// Longest usual time between two frames, ns.
const USUAL_NS: i64 = SECOND / 5;

/// A disk of the guest, in a folder that is deleted afterwards.
struct Disk<'a> {
    scripts: &'a Path,
    folder: tempfile::TempDir,
}

impl<'a> Disk<'a> {
    fn new(scripts: &'a Path, megabytes: u32) -> Self {
        let disk = Self { scripts, folder: tempfile::tempdir().unwrap() };
        let made = Command::new(scripts.join("ext4.sh")).arg(disk.path("disk")).arg(megabytes.to_string()).status();
        assert!(made.unwrap().success());
        disk
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Boots the guest with options of QEMU for its disk, and returns what it prints. Fails if the
    /// guest's task fails.
    fn boot(&self, options: &[String], task: &str) -> Vec<String> {
        let mut run = Command::new(self.scripts.join("run.sh"));
        for option in options {
            run.args(["--qemu", option]);
        }
        run.arg(MODULES).arg(std::env::current_exe().unwrap()).args(task.split(' '));
        let mut run = run.stdout(Stdio::piped()).spawn().unwrap();
        let lines = BufReader::new(run.stdout.take().unwrap()).lines();
        let lines: Vec<String> = lines.map(|line| line.unwrap().trim_end().to_owned()).collect();
        let done = run.wait().unwrap();
        assert!(done.success(), "{task}: {done}\n{}", lines.join("\n"));
        lines
    }

    /// Returns options for a plain disk, with further properties. QEMU need not wait for the host's
    /// disk: the host's power is not cut.
    fn plain(&self, properties: &str) -> Vec<String> {
        let drive = format!("file={},format=raw,if=virtio,cache=unsafe{properties}", self.path("disk").display());
        vec!["-drive".into(), drive]
    }

    /// Returns options for a disk whose requests are logged.
    fn logged(&self) -> Vec<String> {
        std::fs::write(self.path("log"), "").unwrap();
        let file = |name: &str| {
            let path = self.path(name);
            format!("driver=file,node-name={name},filename={},cache.no-flush=on", path.display())
        };
        let log = "driver=blklogwrites,node-name=logged,file=copy,log=log".to_owned();
        let options = [file("copy"), file("log"), log].map(|node| ["-blockdev".to_owned(), node]);
        let mut options: Vec<String> = options.into_iter().flatten().collect();
        options.extend(["-device".into(), "virtio-blk-pci,drive=logged".into()]);
        // The guest's clock counts instructions, 4 ns each. The host's speed does not change
        // the work that it does in a second.
        options.extend(["-icount".into(), "shift=2".into()]);
        options
    }
}

/// The guest's lines before a cut: times of its frames, and versions of its files.
#[derive(Default)]
struct GuestLog {
    frames: Vec<i64>,
    /// The last versions that were saved and whose saving began, by kind.
    saved: HashMap<String, u64>,
    saving: HashMap<String, u64>,
    /// From the check of the cut before: the number of frames left, and each file's version.
    left: u64,
    versions: HashMap<String, u64>,
    temporary: u64,
}

impl GuestLog {
    fn of(lines: &[String]) -> Self {
        let mut log = Self::default();
        for line in lines {
            let words: Vec<&str> = line.split(' ').collect();
            let last = words.last().and_then(|word| word.parse::<i64>().ok());
            let (Some(last), kind) = (last, words.get(1).copied().unwrap_or_default().to_owned()) else { continue };
            match (words[0], words.len()) {
                // The cut may break the last line off.
                ("frame", 3) if log.frames.last().is_none_or(|before| *before < last) => log.frames.push(last),
                ("saved", 3) => drop(log.saved.insert(kind, last as u64)),
                ("saving", 3) => drop(log.saving.insert(kind, last as u64)),
                ("version", 3) => drop(log.versions.insert(kind, last as u64)),
                ("left", 2) => log.left = last as u64,
                ("temporary", 2) => log.temporary = last as u64,
                _ => {}
            }
        }
        log
    }
}

/// A power cut: when it came, the guest's lines, and what became of the disk's cache.
struct Cut {
    number: u64,
    after_ms: u64,
    log: GuestLog,
    requests: Requests,
}

impl Cut {
    /// Returns the time of the frame that was handed over last, ns.
    fn last_ns(&self) -> i64 {
        self.log.frames[self.log.frames.len() - 1]
    }

    /// Returns for how long the guest had no processor shortly before, ns: a busy host may take it
    /// away, and the guest can sync nothing then.
    fn stood_still_ns(&self) -> i64 {
        let recent = self.log.frames.windows(2).filter(|two| two[1] > self.last_ns() - 2 * SECOND);
        recent.map(|two| two[1] - two[0]).max().filter(|longest| *longest > USUAL_NS).unwrap_or(0)
    }

    /// Returns the number of frames that must be on the disk.
    fn old(&self) -> usize {
        let until_ns = self.last_ns() - SECOND - self.stood_still_ns();
        self.log.frames.iter().filter(|at_ns| **at_ns < until_ns).count()
    }

    /// Returns the words by which the next boot checks the disk. `versions` are those of the files
    /// before the recording.
    fn check(&self, versions: &HashMap<String, u64>) -> String {
        let mut words = format!(" of={} old={}", self.number, self.old());
        for (kind, before) in versions {
            let saved = self.log.saved.get(kind).unwrap_or(before);
            let saving = self.log.saving.get(kind).unwrap_or(saved);
            words += &format!(" {kind}={saved},{saving}");
            // A pair has no header while it is replaced.
            if *kind == format!("{:?}", Kind::Pair) && saving > saved {
                words += ",0";
            }
        }
        words
    }

    /// Prints what the next boot found.
    fn report(&self, found: &GuestLog) {
        let (frames, left) = (&self.log.frames, found.left as usize);
        let newest_ns = frames.get(left.saturating_sub(1)).copied().unwrap_or_else(|| self.last_ns());
        println!(
            "cut after {} ms: {} frames handed over, {left} on the disk, the last {:.2} s missing; {:?}; \
             {} temporary files{}",
            self.after_ms,
            frames.len(),
            (self.last_ns() - newest_ns) as f64 * 1e-9,
            self.requests,
            found.temporary,
            if self.stood_still_ns() > 0 { "; the guest had stood still" } else { "" }
        );
    }
}

fn power_cut_takes_at_most_last_second(scripts: &Path) {
    let is_quick = std::env::var("SONOWEAVE_STRESS").is_ok_and(|length| length == "quick");
    let cuts = CUTS[usize::from(is_quick)];
    let mut random = fastrand::Rng::with_seed(SEED);
    println!("{cuts} power cuts, seed {SEED}");
    let disk = Disk::new(scripts, 64);
    let mut versions: HashMap<String, u64> = KINDS.map(|kind| (format!("{kind:?}"), 0)).into();
    let (mut before, mut from, mut long) = (None::<Cut>, 1, 0);
    for number in 0..=cuts {
        let after_ms = random.u64(AFTER_MS);
        let check = before.as_ref().map_or(String::new(), |cut| cut.check(&versions));
        let record = if number < cuts { format!(" cut={number} after={after_ms} from={from}") } else { String::new() };
        // The guest writes to a copy. The disk is then made of what it has kept.
        std::fs::copy(disk.path("disk"), disk.path("copy")).unwrap();
        let lines = disk.boot(&disk.logged(), &format!("round{check}{record}"));
        let log = GuestLog::of(&lines);
        if let Some(before) = &before {
            before.report(&log);
        }
        if number == cuts {
            break;
        }
        assert!(!log.frames.is_empty(), "nothing was recorded\n{}", lines.join("\n"));
        versions.extend(log.versions.clone());
        from = log.saving.values().max().map_or(from, |saving| saving + 1);
        // With a generator of its own: the number of requests is another one each time.
        let mut lost = fastrand::Rng::with_seed(SEED + number);
        let requests = loss::apply(&disk.path("log"), &disk.path("disk"), &mut lost);
        assert!(requests.flushes > 0, "{requests:?}");
        let cut = Cut { number, after_ms, log, requests };
        long += u64::from(cut.old() > 0);
        before = Some(cut);
    }
    assert!(long >= cuts / 2, "most recordings are longer than a second: {long}");
}

fn full_disk_loses_counted_frames_only(scripts: &Path) {
    let disk = Disk::new(scripts, 16);
    report(&disk.boot(&disk.plain(""), "full"));
}

fn read_only_disk_keeps_what_was_synced(scripts: &Path) {
    let disk = Disk::new(scripts, 64);
    report(&disk.boot(&disk.plain(""), "read-only"));
}

fn slow_disk_holds_up_no_capture(scripts: &Path) {
    let disk = Disk::new(scripts, 64);
    // Five writes a second.
    report(&disk.boot(&disk.plain(",throttling.iops-write=5"), "slow"));
}

/// Prints the guest's figures.
fn report(lines: &[String]) {
    lines.iter().filter(|line| line.contains("frames")).for_each(|line| println!("{line}"));
}
