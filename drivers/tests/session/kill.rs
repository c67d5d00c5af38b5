//! A program killed at random instants while recording: everything older than a second is in
//! the file.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use formats::session::{Ending, SessionWriter, WriterOptions, repair};
use sonoweave_core::Description;
use sonoweave_core::clock::{Clock, MS, Monotonic, SECOND};

use crate::{frame, pose, read};

/// Environment variable with the folder that the child writes into.
const FOLDER: &str = "SONOWEAVE_TEST_SESSION_FOLDER";

/// Child process that the test below kills; not a separate test. It prints the number and time
/// of each message handed over.
#[test]
#[ignore = "run by the test below, as a process of its own"]
fn child() {
    let Ok(folder) = std::env::var(FOLDER) else { return };
    let mut session = SessionWriter::create(Path::new(&folder), WriterOptions::new("a child")).unwrap();
    let source = session.device("tracker", None, &Description::default(), None).unwrap();
    let mut out = std::io::stdout();
    for item in 0.. {
        let at = Monotonic.now_ns();
        session.write(source, &pose(item, at), at).unwrap();
        session.write(source, &frame(item, at, [160, 120]), at).unwrap();
        writeln!(out, "told {item} {at}").unwrap();
        Monotonic.wait_until(at + 4 * MS);
    }
}

#[test]
fn killed_writer_loses_at_most_last_second() {
    let mut random = fastrand::Rng::with_seed(5);
    for round in 0..6 {
        let folder = tempfile::tempdir().unwrap();
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "kill::child", "--ignored", "--nocapture"])
            .env(FOLDER, folder.path())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stdout.take().unwrap());
        let reader = std::thread::spawn(move || {
            let reported = |line: String| {
                let mut words = line.strip_prefix("told ")?.split(' ');
                Some((words.next()?.parse::<u64>().ok()?, words.next()?.parse::<i64>().ok()?))
            };
            lines.lines().map_while(Result::ok).filter_map(reported).collect::<Vec<_>>()
        });
        std::thread::sleep(Duration::from_millis(random.u64(700..2200)));
        child.kill().unwrap();
        child.wait().unwrap();
        let reported = reader.join().unwrap();
        let Some((_, last_ns)) = reported.last() else { panic!("round {round}: nothing was written") };
        let old = reported.iter().filter(|(_, at)| *at < last_ns - SECOND).count();
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let bytes = std::fs::read(&file).unwrap();
        let left = read(&bytes).unwrap();
        assert_eq!((left.ending, left.missing), (Some(Ending::BrokenOff), 0));
        // Each item gives a pose and a frame, in order and without gaps.
        assert!(left.readings.len() >= 2 * old, "round {round}: {} of {old} twice", left.readings.len());
        for (n, pair) in left.readings.chunks(2).enumerate() {
            let (item, at) = reported[n];
            assert_eq!(pair[0].3, format!("{:?}", pose(item, at)));
            if let Some(second) = pair.get(1) {
                assert_eq!(second.3, format!("{:?}", frame(item, at, [160, 120])));
            }
        }
        // At most one chunk was truncated, and it is reported.
        assert!(left.damage.len() <= 1 && left.damage.iter().all(|part| part.until == bytes.len() as u64));
        let whole = folder.path().join("whole.mcap");
        let repaired = repair(&file, &whole, &formats::Limits::default()).unwrap();
        assert_eq!(repaired.ending, Some(Ending::BrokenOff));
        let again = read(&std::fs::read(&whole).unwrap()).unwrap();
        assert_eq!((again.ending, again.damage.len()), (Some(Ending::Finished), 0));
        assert_eq!(again.readings, left.readings);
        assert!(again.losses[0].why.contains("broken off"), "{:?}", again.losses);
    }
}
