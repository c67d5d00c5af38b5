//! A program that is killed while it records, at random instants: everything older than a second is there.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use drivers::Description;
use drivers::clock::{Clock, MS, Monotonic, SECOND};
use drivers::recording::session::{Ending, SessionWriter, WriterOptions, repair};

use crate::{frame, pose, read};

/// Names the folder that the child writes into.
const FOLDER: &str = "SONOWEAVE_TEST_SESSION_FOLDER";

/// Not a test of its own: what is killed. It tells the number and time of each message that it has handed over.
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
fn killed_at_random_instants_all_but_the_last_second_is_there() {
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
            let told = |line: String| {
                let mut words = line.strip_prefix("told ")?.split(' ');
                Some((words.next()?.parse::<u64>().ok()?, words.next()?.parse::<i64>().ok()?))
            };
            lines.lines().map_while(Result::ok).filter_map(told).collect::<Vec<_>>()
        });
        std::thread::sleep(Duration::from_millis(random.u64(700..2200)));
        child.kill().unwrap();
        child.wait().unwrap();
        let told = reader.join().unwrap();
        let Some((_, last_ns)) = told.last() else { panic!("round {round}: nothing was written") };
        let old = told.iter().filter(|(_, at)| *at < last_ns - SECOND).count();
        let file = std::fs::read_dir(folder.path()).unwrap().next().unwrap().unwrap().path();
        let bytes = std::fs::read(&file).unwrap();
        let left = read(&bytes).unwrap();
        assert_eq!((left.ending, left.missing), (Some(Ending::BrokenOff), 0));
        // Of each a pose and a frame, in their order, none left out.
        assert!(left.readings.len() >= 2 * old, "round {round}: {} of {old} twice", left.readings.len());
        for (n, pair) in left.readings.chunks(2).enumerate() {
            let (item, at) = told[n];
            assert_eq!(pair[0].3, format!("{:?}", pose(item, at)));
            if let Some(second) = pair.get(1) {
                assert_eq!(second.3, format!("{:?}", frame(item, at, [160, 120])));
            }
        }
        // A chunk was cut at most, which is told as such.
        assert!(left.damage.len() <= 1 && left.damage.iter().all(|part| part.until == bytes.len() as u64));
        let whole = folder.path().join("whole.mcap");
        let repaired = repair(&file, &whole, &drivers::recording::Limits::default()).unwrap();
        assert_eq!(repaired.ending, Some(Ending::BrokenOff));
        let again = read(&std::fs::read(&whole).unwrap()).unwrap();
        assert_eq!((again.ending, again.damage.len()), (Some(Ending::Finished), 0));
        assert_eq!(again.readings, left.readings);
        assert!(again.losses[0].why.contains("broken off"), "{:?}", again.losses);
    }
}
