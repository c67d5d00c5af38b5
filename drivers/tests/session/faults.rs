//! A full, slow or broken disk: the fault is reported once and counted, and written data stays
//! intact.

use std::fs;
use std::process::Command;

use formats::Error;
use formats::session::{Ending, SessionWriter, Source, WriterOptions};
use sonoweave_core::Description;
use sonoweave_core::clock::{MS, SECOND};

use crate::{BEGIN, Shared, about, chunks_of, frame, pose, read, writer};

/// Writes one second of frames and poses; returns how many write errors were reported.
fn second(session: &mut SessionWriter, source: Source, from: u64) -> u64 {
    let mut text = 0;
    for n in 0..100 {
        let (item, at) = (from * 100 + n, BEGIN + (from * 100 + n) as i64 * 10 * MS);
        for reading in [pose(item, at), frame(item, at, [64, 64])] {
            match session.write(source, &reading, at) {
                Ok(()) => {}
                Err(Error::Io { .. }) => text += 1,
                Err(other) => panic!("{other}"),
            }
        }
    }
    text
}

fn small() -> WriterOptions {
    WriterOptions { held_bytes: 150_000, ..chunks_of(100 * MS) }
}

#[test]
fn full_disk_loses_excess_and_reports_once() {
    for cannot_cut in [false, true] {
        let (mut session, disk) = writer(small());
        let source = session.device("tracker", None, &Description::default(), None).unwrap();
        assert_eq!(second(&mut session, source, 0), 0);
        let before = disk.bytes().len();
        // Less room than for one more chunk.
        (disk.disk().room, disk.disk().cannot_cut) = (Some(before + 1000), cannot_cut);
        assert_eq!(second(&mut session, source, 1), 1, "said once");
        assert_eq!(second(&mut session, source, 2), 0);
        let account = session.account();
        assert!(account.lost > 0 && account.trouble.contains("memory.mcap: writing the session"), "{account:?}");
        assert!(account.trouble.contains("No space left") && account.held_bytes < 200_000);
        // The file is intact, or ends with a truncated chunk if truncation fails.
        let now = read(&disk.bytes()).unwrap();
        assert_eq!((now.ending, now.missing), (Some(Ending::BrokenOff), 0));
        assert_eq!(now.damage.is_empty(), !cannot_cut, "{:?}", now.damage);
        assert!(now.readings.len() >= 180, "{}", now.readings.len());
        // Once space is free again, writing resumes by itself in the same file, and the losses
        // are recorded.
        (disk.disk().room, disk.disk().cannot_cut) = (None, false);
        session.tick(BEGIN + 4 * SECOND).unwrap();
        assert_eq!(session.account().trouble, "");
        assert_eq!(second(&mut session, source, 5), 0);
        let account = session.finish(BEGIN + 6 * SECOND).unwrap();
        assert_eq!((account.stored + account.lost, account.failures), (account.messages, 1));
        let all = read(&disk.bytes()).unwrap();
        assert_eq!((all.damage.len(), all.ending, all.missing), (0, Some(Ending::Finished), account.lost));
        let reported: u64 = all.losses.iter().map(formats::session::Loss::messages).sum();
        assert_eq!((reported, all.losses.len()), (account.lost, 1));
        let loss = &all.losses[0];
        assert!(loss.why.contains("No space left"), "{}", loss.why);
        assert!(loss.from_ns > BEGIN + SECOND && loss.until_ns < BEGIN + 3 * SECOND && loss.from_ns < loss.until_ns);
        assert_eq!(all.readings.len() as u64, 800 - account.lost);
        // Frames are dropped first, because they fill the memory.
        let lost =
            |topic: &str| loss.lost.iter().filter(|(one, _, _)| one.starts_with(topic)).map(|(_, n, _)| n).sum::<u64>();
        assert!(lost("/tracker/image") > 150 && lost("/tracker/pose") < 60, "{loss:?}");
    }
}

#[test]
fn failing_disk_leaves_whole_chunks() {
    for broken in [0, 1, 8, 9, 30, 500, 5000] {
        let (mut session, disk) = writer(small());
        let source = session.device("tracker", None, &Description::default(), None).unwrap();
        second(&mut session, source, 0);
        disk.disk().broken = Some(broken);
        assert_eq!(second(&mut session, source, 1), 1, "{broken}");
        let error = session.finish(BEGIN + 2 * SECOND).err().unwrap().to_string();
        assert!(error.contains("whole up to its last chunk"), "{error}");
        let left = read(&disk.bytes()).unwrap();
        assert_eq!((left.damage.len(), left.missing, left.ending), (0, 0, Some(Ending::BrokenOff)));
        assert!(left.readings.len() >= 180);
    }
}

#[test]
fn session_without_space_for_beginning_is_refused() {
    let disk = Shared::default();
    disk.disk().room = Some(100);
    let error = SessionWriter::on(Box::new(disk.clone()), "full.mcap".as_ref(), about(), chunks_of(MS)).err().unwrap();
    assert!(matches!(&error, Error::Io { .. }), "{error}");
    assert!(error.to_string().starts_with("full.mcap: "), "{error}");
    assert!(disk.bytes().is_empty(), "nothing is left behind");
    // The kernel's own always-full device.
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let error = SessionWriter::on(Box::new(full), "/dev/full".as_ref(), about(), chunks_of(MS)).err().unwrap();
    assert!(error.to_string().contains("No space left"), "{error}");
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    fs::write(&file, "").unwrap();
    let error = SessionWriter::create(&file.join("inside"), chunks_of(MS)).err().unwrap().to_string();
    assert!(error.contains("making the folder for sessions failed"), "{error}");
}

#[test]
fn unwritable_folder_is_reported() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    fs::set_permissions(folder.path(), fs::Permissions::from_mode(0o500)).unwrap();
    // Root may write everywhere except where the kernel itself creates no files.
    let place = if fs::write(folder.path().join("x"), "").is_ok() { "/proc/self".as_ref() } else { folder.path() };
    let error = SessionWriter::create(place, chunks_of(MS)).err().unwrap();
    assert!(matches!(&error, Error::Io { doing: "making a session's file", .. }), "{error}");
}

/// A separate file system of `kb` kB; `None` if mounting is not permitted.
struct Small(tempfile::TempDir);

impl Small {
    fn new(kb: u32) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let size = format!("size={kb}k");
        let mounted = Command::new("mount").args(["-t", "tmpfs", "-o", &size, "tmpfs"]).arg(folder.path()).output();
        mounted.is_ok_and(|done| done.status.success()).then_some(Self(folder))
    }
}

impl Drop for Small {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("-l").arg(self.0.path()).status();
    }
}

#[test]
fn real_full_disk_recovers_when_freed() {
    let Some(small_disk) = Small::new(400) else {
        // Without permission to mount, the in-memory disk above must suffice.
        return;
    };
    let folder = small_disk.0.path();
    let filler = folder.join("filler");
    fs::write(&filler, vec![1; 200_000]).unwrap();
    let mut session = SessionWriter::create(folder, small()).unwrap();
    let path = session.path().to_owned();
    let source = session.device("tracker", None, &Description::default(), None).unwrap();
    let free = session.room().unwrap().free_bytes;
    assert!((100_000..250_000).contains(&free), "{free}");
    // The session's clock is the host's; the readings' times are not, so that they wait for no
    // chunk.
    let base = session.account();
    let (mut text, mut wrote) = (0, 0);
    while text == 0 {
        let at = sonoweave_core::clock::Clock::now_ns(&sonoweave_core::clock::Monotonic) + wrote as i64 * 10 * MS;
        text += u64::from(session.write(source, &frame(wrote, at, [64, 64]), at).is_err());
        wrote += 1;
        assert!(wrote < 5000, "{base:?}");
    }
    let left = read(&fs::read(&path).unwrap()).unwrap();
    assert_eq!((left.damage.len(), left.ending), (0, Some(Ending::BrokenOff)));
    assert!(left.readings.len() > 20, "{}", left.readings.len());
    fs::remove_file(&filler).unwrap();
    let later =
        sonoweave_core::clock::Clock::now_ns(&sonoweave_core::clock::Monotonic) + wrote as i64 * 10 * MS + 3 * SECOND;
    session.tick(later).unwrap();
    assert_eq!(session.account().trouble, "");
    let account = session.finish(later).unwrap();
    let all = read(&fs::read(&path).unwrap()).unwrap();
    assert_eq!((all.damage.len(), all.ending), (0, Some(Ending::Finished)));
    assert_eq!(all.readings.len() as u64, wrote - account.lost);
}
