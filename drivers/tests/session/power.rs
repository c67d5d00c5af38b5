//! Power cuts: a disk that keeps only synced data, and any part of the rest. At every instant, data
//! recorded more than 1 s ago are in the file.

use std::io;
use std::ops::Range;
use std::path::Path;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use formats::session::{DataSync, SessionWriter, Source, Store, Syncer, WriterOptions, repair};
use formats::{Error, Limits};
use sonoweave_core::Description;
use sonoweave_core::clock::{MS, SECOND};

use crate::{BEGIN, about, frame, pose, read};

/// Longest sync for which the promise holds.
const SYNC_NS: i64 = 250 * MS;
/// Longest pause between two turns of the recorder.
const TURN_NS: i64 = 100 * MS;
/// Smallest part that a disk writes as a whole.
const SECTOR: usize = 512;

#[derive(Clone)]
enum Operation {
    Write(u64, Vec<u8>),
    SyncBegins,
    /// Whether the data before its beginning are on the disk. Otherwise the system forgets them.
    SyncEnds(bool),
}

/// A disk that notes its operations, with the system's memory before it.
#[derive(Default)]
struct Machine {
    operations: Vec<Operation>,
    memory: Vec<u8>,
    rewritten: Vec<Range<u64>>,
    /// Whether syncs end by themselves.
    is_free: bool,
}

/// A handle of the disk. A sync reports its beginning, and waits for its outcome.
#[derive(Clone)]
struct Handle {
    machine: Arc<Mutex<Machine>>,
    begun: Sender<()>,
    outcomes: Arc<Mutex<Receiver<io::Result<()>>>>,
}

impl Handle {
    fn machine(&self) -> std::sync::MutexGuard<'_, Machine> {
        self.machine.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Store for Handle {
    fn write_at(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
        let mut machine = self.machine();
        machine.memory.truncate(at as usize);
        machine.memory.extend_from_slice(bytes);
        machine.operations.push(Operation::Write(at, bytes.to_vec()));
        Ok(())
    }

    fn cut(&mut self, _: u64) -> io::Result<()> {
        unreachable!("every write succeeds")
    }

    fn data_sync(&self) -> io::Result<Box<dyn DataSync>> {
        Ok(Box::new(self.clone()))
    }

    fn free_bytes(&self) -> Option<u64> {
        None
    }
}

impl DataSync for Handle {
    fn sync(&mut self) -> io::Result<()> {
        let mut machine = self.machine();
        machine.operations.push(Operation::SyncBegins);
        let is_free = machine.is_free;
        drop(machine);
        let outcome = if is_free {
            Ok(())
        } else {
            self.begun.send(()).unwrap();
            self.outcomes.lock().unwrap_or_else(PoisonError::into_inner).recv().unwrap()
        };
        self.machine().operations.push(Operation::SyncEnds(outcome.is_ok()));
        outcome
    }

    fn rewrite(&mut self, part: Range<u64>) -> io::Result<()> {
        let mut machine = self.machine();
        let bytes = machine.memory[part.start as usize..part.end as usize].to_vec();
        machine.operations.push(Operation::Write(part.start, bytes));
        machine.rewritten.push(part);
        Ok(())
    }
}

/// Returns the file after a power cut that follows these operations. Any sectors of unsynced
/// writes may have reached the disk.
fn after_cut(operations: &[Operation], random: &mut fastrand::Rng) -> Vec<u8> {
    fn apply(disk: &mut Vec<u8>, at: usize, bytes: &[u8]) {
        disk.resize(disk.len().max(at + bytes.len()), 0);
        disk[at..at + bytes.len()].copy_from_slice(bytes);
    }
    let some = |disk: &mut Vec<u8>, writes: &[(u64, &[u8])], random: &mut fastrand::Rng| {
        for (at, bytes) in writes {
            let kept = random.f32();
            for (n, sector) in bytes.chunks(SECTOR).enumerate() {
                if random.f32() < kept {
                    apply(disk, *at as usize + n * SECTOR, sector);
                }
            }
        }
    };
    let (mut disk, mut unsynced, mut before_sync) = (Vec::new(), Vec::<(u64, &[u8])>::new(), 0);
    for operation in operations {
        match operation {
            Operation::Write(at, bytes) => unsynced.push((*at, bytes)),
            Operation::SyncBegins => before_sync = unsynced.len(),
            Operation::SyncEnds(true) => {
                unsynced.drain(..before_sync).for_each(|(at, bytes)| apply(&mut disk, at as usize, bytes));
            }
            Operation::SyncEnds(false) => some(&mut disk, &unsynced.drain(..before_sync).collect::<Vec<_>>(), random),
        }
    }
    some(&mut disk, &unsynced, random);
    disk
}

/// A recorder with its syncing thread, at simulated times.
struct Recorder {
    session: Option<SessionWriter>,
    source: Source,
    disk: Handle,
    syncer: Syncer,
    thread: Option<JoinHandle<()>>,
    begun: Receiver<()>,
    outcomes: Sender<io::Result<()>>,
    /// Whether a sync runs.
    runs: bool,
    /// Number of syncs that have begun.
    syncs: u64,
    /// Errors reported by the writer.
    errors: Vec<Error>,
    /// Messages handed over, and the number of operations on the disk before each.
    messages: u64,
}

impl Recorder {
    fn new(chunk_bytes: usize) -> Self {
        let (begin, begun) = channel();
        let (outcomes, outcome) = channel();
        let machine = Arc::<Mutex<Machine>>::default();
        let disk = Handle { machine, begun: begin, outcomes: Arc::new(Mutex::new(outcome)) };
        let options = WriterOptions { chunk_bytes, ..WriterOptions::new("a test") };
        let path = Path::new("memory.mcap");
        let mut session = SessionWriter::on(Box::new(disk.clone()), path, about(), options).unwrap();
        let source = session.device("tracker", None, &Description::default(), None).unwrap();
        let syncer = session.syncer();
        let of_thread = syncer.clone();
        let thread = Some(std::thread::spawn(move || of_thread.run()));
        let mut recorder = Self {
            session: Some(session),
            source,
            disk,
            syncer,
            thread,
            begun,
            outcomes,
            runs: false,
            syncs: 0,
            errors: Vec::new(),
            messages: 0,
        };
        recorder.wait_for_begin();
        recorder
    }

    fn session(&mut self) -> &mut SessionWriter {
        self.session.as_mut().unwrap()
    }

    /// If a sync is requested, waits until it has begun.
    fn wait_for_begin(&mut self) {
        if !self.runs && self.syncer.is_busy() {
            self.begun.recv().unwrap();
            (self.runs, self.syncs) = (true, self.syncs + 1);
        }
    }

    /// Ends the sync that runs. If another is requested, it begins.
    fn end_sync(&mut self, outcome: io::Result<()>) {
        assert!(self.runs);
        self.outcomes.send(outcome).unwrap();
        self.runs = false;
        while self.syncer.is_busy() {
            if self.begun.try_recv().is_ok() {
                (self.runs, self.syncs) = (true, self.syncs + 1);
                break;
            }
            std::thread::yield_now();
        }
    }

    /// Hands a message over, every tenth a frame.
    fn message(&mut self, at_ns: i64) {
        let (item, source) = (self.messages, self.source);
        let reading = if item % 10 == 0 { frame(item, at_ns, [48, 32]) } else { pose(item, at_ns) };
        let written = self.session().write(source, &reading, at_ns);
        self.errors.extend(written.err());
        self.messages += 1;
        self.wait_for_begin();
    }

    fn tick(&mut self, now_ns: i64) {
        let written = self.session().tick(now_ns);
        self.errors.extend(written.err());
        self.wait_for_begin();
    }

    fn operations(&self) -> Vec<Operation> {
        self.disk.machine().operations.clone()
    }

    /// Ends the session; further syncs take no time.
    fn finish(&mut self, now_ns: i64) -> Result<formats::session::Account, Error> {
        self.disk.machine().is_free = true;
        if self.runs {
            self.end_sync(Ok(()));
        }
        let done = self.session.take().unwrap().finish(now_ns);
        self.thread.take().unwrap().join().unwrap();
        done
    }
}

impl Drop for Recorder {
    fn drop(&mut self) {
        if self.session.is_some() {
            let _ = self.finish(i64::MAX);
        }
    }
}

/// Returns the numbers of the messages in a file, which may be broken off. An unreadable one has
/// none.
fn numbers(bytes: &[u8]) -> Vec<u32> {
    read(bytes).map_or(Vec::new(), |read| {
        let mut numbers: Vec<u32> = read.readings.iter().map(|(_, _, _, text)| number(text)).collect();
        numbers.sort_unstable();
        numbers
    })
}

/// Returns the item number of a reading, from its text.
fn number(text: &str) -> u32 {
    let digits = text.split("item: ").nth(1).unwrap();
    digits.split(|c: char| !c.is_ascii_digit()).next().unwrap().parse().unwrap()
}

#[test]
fn cut_at_any_instant_takes_at_most_last_second() {
    let mut random = fastrand::Rng::with_seed(9);
    let (mut cuts, mut unreadable, mut longest_ns) = (0, 0, 0);
    for round in 0..6 {
        // Chunks are closed by their age or by their size.
        let mut recorder = Recorder::new([4 << 20, 3000, 20_000][round % 3]);
        let (mut now_ns, mut ends_ns) = (BEGIN, BEGIN + SYNC_NS);
        // Hand-over time of each message, and the operations at each instant.
        let (mut times, mut instants) = (Vec::new(), Vec::new());
        while now_ns < BEGIN + 8 * SECOND {
            if recorder.runs && now_ns >= ends_ns {
                recorder.end_sync(Ok(()));
                ends_ns = now_ns + random.i64(MS..SYNC_NS);
            }
            let ran = recorder.runs;
            // At times there is no message.
            if (now_ns - BEGIN) / SECOND % 4 == 2 {
                recorder.tick(now_ns);
                instants.push((now_ns, recorder.disk.machine().operations.len()));
                now_ns += random.i64(MS..TURN_NS);
            } else {
                times.push(now_ns);
                recorder.message(now_ns);
                instants.push((now_ns, recorder.disk.machine().operations.len()));
                now_ns += random.i64(MS..20 * MS);
            }
            if recorder.runs && !ran {
                ends_ns = now_ns + random.i64(MS..SYNC_NS);
            }
            let since_ns = recorder.session().account().unsynced_since_ns;
            longest_ns = longest_ns.max(since_ns.map_or(0, |since_ns| now_ns - since_ns));
        }
        let operations = recorder.operations();
        for _ in 0..60 {
            let (at_ns, count) = instants[random.usize(..instants.len())];
            let left = after_cut(&operations[..count], &mut random);
            let old = times.iter().filter(|time_ns| **time_ns < at_ns - SECOND).count() as u32;
            let there = numbers(&left);
            let whole = there.iter().copied().filter(|number| *number < old);
            assert!(whole.eq(0..old), "round {round}: {} of {old} at {at_ns}", there.len());
            cuts += 1;
            unreadable += u32::from(read(&left).is_err());
            // A repaired file is whole, and has the same messages.
            if !there.is_empty() && random.u8(..) < 64 {
                let folder = tempfile::tempdir().unwrap();
                let [cut, whole] = ["cut.mcap", "whole.mcap"].map(|name| folder.path().join(name));
                std::fs::write(&cut, &left).unwrap();
                repair(&cut, &whole, &Limits::default()).unwrap();
                let whole = read(&std::fs::read(&whole).unwrap()).unwrap();
                assert_eq!((whole.damage.len(), whole.readings.len()), (0, there.len()));
            }
        }
    }
    assert!(cuts == 360 && unreadable < 20, "{unreadable} of {cuts} cuts, all before the first sync");
    // The period, a turn, and two syncs.
    assert!((400 * MS..=400 * MS + TURN_NS + 2 * SYNC_NS).contains(&longest_ns), "{longest_ns}");
}

#[test]
fn writes_continue_while_sync_takes_five_seconds() {
    let mut recorder = Recorder::new(4 << 20);
    assert!(recorder.runs, "the beginning is synced");
    recorder.end_sync(Ok(()));
    for n in 0..600 {
        recorder.message(BEGIN + n * 10 * MS);
    }
    // The first period's sync has run since then.
    assert_eq!(recorder.syncs, 2);
    let account = recorder.session().account();
    assert!(account.stored > 550 && account.lost == 0 && account.trouble.is_empty(), "{account:?}");
    assert_eq!(account.unsynced_since_ns, Some(BEGIN));
    recorder.end_sync(Ok(()));
    // The newest request counts.
    assert!(recorder.runs && recorder.syncs == 3);
    // The ended sync covers what was written before it began, no more.
    let since_ns = recorder.session().account().unsynced_since_ns.unwrap();
    assert!((BEGIN + 300 * MS..BEGIN + SECOND).contains(&since_ns), "{since_ns}");
    recorder.end_sync(Ok(()));
    assert!(!recorder.runs);
    let account = recorder.session().account();
    assert_eq!(account.synced_bytes, account.file_bytes);
    assert!(account.unsynced_since_ns.unwrap() > BEGIN + 5 * SECOND);
    let account = recorder.finish(BEGIN + 6 * SECOND).unwrap();
    assert_eq!((account.synced_bytes, account.unsynced_since_ns), (account.file_bytes, None));
    // All writes before the end came before the second sync's end.
    let operations = recorder.operations();
    let ends: Vec<usize> = (0..operations.len()).filter(|n| matches!(operations[*n], Operation::SyncEnds(_))).collect();
    let writes = |from: usize, until: usize| {
        operations[from..until].iter().filter(|operation| matches!(operation, Operation::Write(..))).count()
    };
    assert_eq!(ends.len(), 4);
    assert!(writes(ends[0], ends[1]) >= 14 && writes(ends[1], ends[2]) == 0, "{ends:?}");
    assert!(matches!(operations[operations.len() - 1], Operation::SyncEnds(true)), "a sync ends the file");
}

#[test]
fn failed_sync_is_reported_once_and_repeated() {
    let mut recorder = Recorder::new(4 << 20);
    recorder.end_sync(Ok(()));
    for n in 0..300 {
        if recorder.runs {
            // Syncs fail for two seconds.
            let fails = (50..250).contains(&n);
            recorder.end_sync(if fails { Err(io::Error::from_raw_os_error(5)) } else { Ok(()) });
        }
        if n == 249 {
            let account = recorder.session().account();
            assert!(account.trouble.contains("syncing the session") && account.lost == 0, "{account:?}");
            assert_eq!(account.failures, 1);
        }
        recorder.message(BEGIN + n * 10 * MS);
    }
    assert!(matches!(&recorder.errors[..], [Error::Io { doing, .. }] if doing.starts_with("syncing")));
    assert_eq!(recorder.session().account().trouble, "");
    // The system forgets data whose sync failed, so they were written again.
    let rewritten = recorder.disk.machine().rewritten.clone();
    let account = recorder.session().account();
    assert!(matches!(&rewritten[..], [part] if part.start > 0 && part.end < account.synced_bytes), "{rewritten:?}");
    let left = after_cut(&recorder.operations(), &mut fastrand::Rng::with_seed(1));
    let there = numbers(&left);
    assert!(there.len() >= 240 && there.iter().copied().take(240).eq(0..240), "{}", there.len());
    let account = recorder.finish(BEGIN + 3 * SECOND).unwrap();
    assert_eq!((account.lost, account.stored), (0, account.messages));
    let whole = after_cut(&recorder.operations(), &mut fastrand::Rng::with_seed(2));
    assert_eq!(numbers(&whole).len(), 300);
}

#[test]
fn idle_recorder_retries_failed_sync() {
    let mut recorder = Recorder::new(4 << 20);
    let fails = || Err(io::Error::from_raw_os_error(5));
    recorder.end_sync(fails());
    // This sync is due anyway: it is the first one of the device's description.
    recorder.tick(BEGIN + SECOND);
    assert_eq!(recorder.errors.len(), 1);
    assert!(recorder.runs && recorder.syncs == 2, "{}", recorder.syncs);
    recorder.end_sync(fails());
    let stored = recorder.session().account().file_bytes;
    recorder.tick(BEGIN + 2 * SECOND);
    assert_eq!(recorder.session().account().file_bytes, stored, "nothing is written meanwhile");
    assert!(recorder.runs && recorder.syncs == 3, "{}", recorder.syncs);
    // The fourth one follows the data that were written again.
    recorder.end_sync(Ok(()));
    assert!(recorder.runs && recorder.syncs == 4, "{}", recorder.syncs);
    recorder.end_sync(Ok(()));
    recorder.tick(BEGIN + 3 * SECOND);
    assert_eq!((recorder.session().account().trouble.as_str(), recorder.errors.len()), ("", 1));
    // That turn requested one more before it saw the success; then there is no need.
    recorder.end_sync(Ok(()));
    recorder.tick(BEGIN + 4 * SECOND);
    assert!(!recorder.runs && recorder.syncs == 5, "{}", recorder.syncs);
}

#[test]
fn end_that_cannot_be_synced_is_error() {
    struct Failing;
    impl DataSync for Failing {
        fn sync(&mut self) -> io::Result<()> {
            Err(io::Error::from_raw_os_error(5))
        }

        fn rewrite(&mut self, _: Range<u64>) -> io::Result<()> {
            Ok(())
        }
    }
    #[derive(Clone)]
    struct Unsyncable(crate::Shared);
    impl Store for Unsyncable {
        fn write_at(&mut self, bytes: &[u8], at: u64) -> io::Result<()> {
            self.0.write_at(bytes, at)
        }

        fn cut(&mut self, length: u64) -> io::Result<()> {
            self.0.cut(length)
        }

        fn data_sync(&self) -> io::Result<Box<dyn DataSync>> {
            Ok(Box::new(Failing))
        }

        fn free_bytes(&self) -> Option<u64> {
            None
        }
    }
    let store = Box::new(Unsyncable(crate::Shared::default()));
    let session = SessionWriter::on(store, Path::new("memory.mcap"), about(), WriterOptions::new("a test")).unwrap();
    assert!(matches!(session.finish(BEGIN), Err(Error::Io { doing, .. }) if doing.starts_with("ending the session")));
}

#[test]
fn file_rewrites_its_own_bytes() {
    use std::os::unix::fs::FileExt;
    let bytes: Vec<u8> = (0..3_000_000_u32).map(|n| (n.wrapping_mul(n) >> 7) as u8).collect();
    let mut file = tempfile::tempfile().unwrap();
    file.write_all_at(&bytes, 0).unwrap();
    DataSync::rewrite(&mut file, 12_345..2_900_001).unwrap();
    DataSync::sync(&mut file).unwrap();
    let mut again = vec![0; bytes.len() + 1];
    assert_eq!(file.read_at(&mut again, 0).unwrap(), bytes.len());
    assert!(again[..bytes.len()] == bytes);
    assert!(DataSync::rewrite(&mut file, 0..3_000_001).is_err(), "past the end");
}
