//! The guest's tasks. A task that fails panics, which ends the guest with a code other than 0.

use std::collections::HashMap;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use formats::Limits;
use formats::session::{Ending, Loss, WriterOptions, repair};
use pipeline::session::{Recording, SessionStatus};

use crate::files::{KINDS, Kind, tidy};
use crate::recording::{Content, FRAMES, only_session, read, record};

/// Where the disk is mounted.
const DISK: &str = "/disk";
/// Pause between two files that are saved.
const PAUSE: Duration = Duration::from_millis(30);

/// Carries out the task that the words describe: its name, and `KEY=VALUE`.
pub(crate) fn run(words: &[String]) {
    let values: HashMap<&str, &str> = words.iter().filter_map(|word| word.split_once('=')).collect();
    mount();
    match words[0].as_str() {
        "round" => {
            if values.contains_key("old") {
                check(&values);
            }
            if values.contains_key("cut") {
                until_cut(&values);
            }
        }
        "full" => full(),
        "read-only" => read_only(),
        "slow" => slow(),
        other => panic!("there is no task {other}"),
    }
    shell("umount", &[DISK]);
}

fn shell(program: &str, arguments: &[&str]) {
    let done = Command::new(program).args(arguments).status().unwrap();
    assert!(done.success(), "{program} {arguments:?}: {done}");
}

fn mount() {
    std::fs::create_dir_all(DISK).unwrap();
    shell("mount", &["-t", "ext4", "/dev/vda", DISK]);
}

fn number(values: &HashMap<&str, &str>, key: &str) -> u64 {
    values[key].parse().unwrap()
}

fn sessions(number: u64) -> PathBuf {
    Path::new(DISK).join(format!("sessions-{number}"))
}

/// Folder of the files that are replaced.
fn outputs() -> PathBuf {
    Path::new(DISK).join("files")
}

/// Records session `cut`, and saves files from version `from` on, until the power is cut `after`
/// so many milliseconds.
fn until_cut(values: &HashMap<&str, &str>) {
    let (session, after) = (number(values, "cut"), number(values, "after"));
    let from = number(values, "from");
    std::fs::create_dir_all(outputs()).unwrap();
    shell("sync", &[]);
    std::thread::spawn(move || {
        for version in from.. {
            for kind in KINDS {
                println!("saving {kind:?} {version}");
                kind.save(&outputs(), version).unwrap();
                println!("saved {kind:?} {version}");
                std::thread::sleep(PAUSE);
            }
        }
    });
    let handed_over = |number, at_ns| {
        if number == 0 {
            std::thread::spawn(move || {
                std::thread::sleep(Duration::from_millis(after));
                println!("GUEST-CUT:0");
            });
        }
        println!("frame {number} {at_ns}");
    };
    record(&sessions(session), session, WriterOptions::new("a guest"), handed_over, |_| false);
}

/// Checks what is left of session `of` and of the files: the `old` first frames are there, and each
/// file has a version between the last one that was saved and the one being saved.
fn check(values: &HashMap<&str, &str>) {
    let (session, old) = (number(values, "of"), number(values, "old"));
    let folder = sessions(session);
    let left = only_session(&folder).map(|path| (read(&path, session), path));
    let frames = match left {
        Some((Ok(content), path)) => {
            assert!(content.frames.iter().copied().eq(0..content.frames.len() as u64), "{content:?}");
            assert_eq!(content.missing, 0, "{content:?}");
            let whole = folder.join("whole.mcap");
            repair(&path, &whole, &Limits::default()).unwrap();
            let repaired = read(&whole, session).unwrap();
            assert_eq!((repaired.ending, repaired.damaged_parts), (Some(Ending::Finished), 0));
            assert_eq!(repaired.frames, content.frames);
            content.frames.len() as u64
        }
        // The power was cut before the first sync.
        Some((Err(error), _)) => {
            println!("the session is not readable: {error}");
            0
        }
        None => 0,
    };
    println!("left {frames}");
    assert!(frames >= old, "{frames} frames are left, and {old} are older than a second");
    for kind in KINDS {
        let permitted: Vec<u64> = values[format!("{kind:?}").as_str()].split(',').map(|n| n.parse().unwrap()).collect();
        println!("version {kind:?} {}", kind.version(&outputs(), &permitted));
    }
    println!("temporary {}", tidy(&outputs()));
    std::fs::remove_dir_all(&folder).unwrap();
    shell("sync", &[]);
}

/// Little memory to wait in, so that losses begin soon.
fn tight() -> WriterOptions {
    WriterOptions { held_bytes: 200_000, ..WriterOptions::new("a guest") }
}

/// Checks that every frame is in the file, or counted and named as lost.
fn agrees(recording: &Recording, status: &SessionStatus, content: &Content) {
    assert_eq!((content.ending, content.damaged_parts), (Some(Ending::Finished), 0));
    let lost = |topic: &str| -> u64 {
        let losses = content.losses.iter().flat_map(|loss| &loss.lost);
        losses.filter(|(of, ..)| of.contains(topic)).map(|(_, count, _)| count).sum()
    };
    let in_file = content.frames.len() as u64;
    assert_eq!(status.ledger.frames.total, in_file + lost("/image") + recording.lost.frames, "{recording:?}");
    let account = &recording.status;
    assert_eq!(account.messages, account.stored + account.lost, "{account:?}");
    assert_eq!(account.stored, content.messages);
    assert_eq!(account.lost, content.losses.iter().map(Loss::messages).sum::<u64>());
    assert_eq!((account.synced_bytes, account.trouble.as_str()), (account.file_bytes, ""));
    holds_up_nothing(status);
}

/// Checks that no device lost a reading, as nothing held up the capture.
fn holds_up_nothing(status: &SessionStatus) {
    assert!(status.devices.iter().all(|device| device.lost == 0), "{:?}", status.devices);
    assert_eq!(status.ledger.frames.total, status.ledger.frames.used, "{}", status.ledger);
}

/// Appends to a file until the disk has no room, even after a sync: ext4 reserves more blocks for
/// data in memory than they need on the disk.
fn fill(path: &Path) {
    let mut file = std::fs::File::options().create(true).append(true).open(path).unwrap();
    loop {
        let mut pieces = 0;
        // In small pieces, so that nothing is left.
        while file.write_all(&[7; 512]).is_ok() {
            pieces += 1;
        }
        if pieces == 0 {
            return;
        }
        file.sync_all().unwrap();
    }
}

/// Records on a disk that is full for a while. The files stay old meanwhile, and are saved
/// afterwards.
fn full() {
    const WHY: &str = "No space left";
    let filler = Path::new(DISK).join("filler");
    std::fs::create_dir_all(outputs()).unwrap();
    for kind in KINDS {
        kind.save(&outputs(), 1).unwrap();
    }
    let folder = sessions(1);
    let versions = |version: u64| KINDS.map(|kind: Kind| kind.version(&outputs(), &[version])) == [version; 3];
    // Frames when the disk refused and accepted again.
    let (mut from, mut until) = (None, None);
    let (recording, status) = record(
        &folder,
        1,
        tight(),
        |_, _| {},
        |status| {
            let Some(written) = &status.recording else { return false };
            let total = status.ledger.frames.total;
            if from.is_none() && total >= 30 {
                from = Some(total);
            }
            // Blocks of other files may become free later, so that the disk is filled up each time.
            if from.is_some() && until.is_none() {
                fill(&filler);
            }
            if let (Some(from), None) = (from, until)
                && written.lost > 0
                && !written.trouble.is_empty()
                && total >= from + 60
            {
                assert!(written.trouble.contains(WHY), "{}", written.trouble);
                for kind in KINDS {
                    let refused = kind.save(&outputs(), 2).unwrap_err();
                    assert!(refused.contains(WHY), "{refused}");
                }
                assert!(versions(1));
                std::fs::remove_file(&filler).unwrap();
                assert_eq!(tidy(&outputs()), 0, "no temporary file is left");
                until = Some(total);
            }
            until.is_some_and(|until| total >= until + 60) && written.trouble.is_empty()
        },
    );
    let content = read(&only_session(&folder).unwrap(), 1).unwrap();
    agrees(&recording, &status, &content);
    assert!(recording.status.lost > 0 && content.losses[0].why.contains(WHY), "{:?}", content.losses);
    println!("{} of {} frames are in the file", content.frames.len(), status.ledger.frames.total);
    for kind in KINDS {
        kind.save(&outputs(), 3).unwrap();
    }
    assert!(versions(3));
}

/// Records on a disk that the kernel makes read-only after an error, as it does by default. The
/// kernel still takes what is written, and refuses to sync it.
fn read_only() {
    const WHY: &str = "Read-only file system";
    shell("mount", &["-o", "remount,errors=remount-ro", DISK]);
    std::fs::create_dir_all(outputs()).unwrap();
    KINDS.iter().for_each(|kind| kind.save(&outputs(), 1).unwrap());
    let folder = sessions(1);
    let (mut from, mut is_reported) = (None, false);
    let (recording, status) = record(
        &folder,
        1,
        WriterOptions::new("a guest"),
        |_, _| {},
        |status| {
            let Some(written) = &status.recording else { return false };
            let total = status.ledger.frames.total;
            if from.is_none() && total >= 60 {
                from = Some(total);
                std::fs::write("/sys/fs/ext4/vda/trigger_fs_error", "a test").unwrap();
            }
            if !is_reported && written.trouble.contains(WHY) {
                assert!(written.trouble.contains("syncing the session"), "{}", written.trouble);
                for kind in KINDS {
                    let refused = kind.save(&outputs(), 2).unwrap_err();
                    assert!(refused.contains(WHY), "{refused}");
                }
                is_reported = true;
            }
            is_reported && from.is_some_and(|from| total >= from + 60)
        },
    );
    assert!(recording.status.trouble.contains("ending the session"), "{:?}", recording.status);
    holds_up_nothing(&status);
    // Mounted again, the disk has what was synced.
    shell("umount", &[DISK]);
    mount();
    let (path, whole) = (only_session(&folder).unwrap(), folder.join("whole.mcap"));
    let content = read(&path, 1).unwrap();
    let left = content.frames.len() as u64;
    assert!(content.frames.iter().copied().eq(0..left) && content.missing == 0, "{content:?}");
    assert_eq!(content.ending, Some(Ending::BrokenOff));
    let from = from.unwrap();
    assert!((from - FRAMES..=from).contains(&left), "{left} of {from} frames before the error");
    println!("{left} of {from} frames before the error are on the disk, of {} in all", status.ledger.frames.total);
    repair(&path, &whole, &Limits::default()).unwrap();
    assert_eq!(read(&whole, 1).unwrap().frames, content.frames);
    KINDS.iter().for_each(|kind| assert_eq!(kind.version(&outputs(), &[1]), 1));
    assert_eq!(tidy(&outputs()), 0);
}

/// Records on a disk that takes 200 ms for each request.
fn slow() {
    let is_reported = AtomicBool::new(false);
    let folder = sessions(1);
    let (recording, status) = record(
        &folder,
        1,
        WriterOptions::new("a guest"),
        |_, _| {},
        |status| {
            let slow =
                status.recording.as_ref().is_some_and(|written| written.slow_disk && written.unsynced_most_s > 1.0);
            is_reported.fetch_or(slow, Ordering::Relaxed);
            status.ledger.frames.total >= 300
        },
    );
    let content = read(&only_session(&folder).unwrap(), 1).unwrap();
    agrees(&recording, &status, &content);
    assert!(is_reported.into_inner(), "{recording:?}");
    assert_eq!((recording.status.lost, recording.lost.total(), content.missing), (0, 0, 0));
    println!(
        "{} frames; up to {:.1} s were not synced",
        content.frames.len(),
        recording.unsynced.most_ns as f64 * 1e-9
    );
}
