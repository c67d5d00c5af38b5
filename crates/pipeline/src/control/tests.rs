//! Commands allowed in each phase, and the status.

use glam::{DMat3, DVec3};

use export::volume::{DenseBox, Scalar};
use volume::Grid;
use volume::dense::DenseVolume;

use super::*;
use crate::command::Setting;

fn running(folder: Option<PathBuf>, records: bool) -> SessionController {
    let desk = SessionController::new(folder);
    desk.runs(records, "a test".into());
    desk
}

#[test]
fn impossible_command_is_refused_with_advice() {
    let desk = SessionController::new(None);
    for command in [Command::Record, Command::Scan, Command::Stop, Command::Freeze(true), Command::Clear] {
        assert!(desk.execute(command).unwrap_err().contains("wait a moment"), "{command:?}");
    }
    assert!(desk.execute(Command::Save).unwrap_err().contains("--keep DIR"));
    desk.runs(false, String::new());
    assert!(desk.execute(Command::Record).unwrap_err().contains("--keep DIR"));
    assert!(desk.execute(Command::Scan).unwrap_err().contains("already running"));
    assert!(!desk.turns().load(Ordering::Relaxed) && !desk.stopped() && desk.commands().is_empty());
    let desk = running(Some("somewhere".into()), true);
    assert!(desk.execute(Command::Record).unwrap_err().contains("already being recorded"));
    assert_eq!(desk.status().phase, Phase::Running);
    desk.is_over();
    for command in [Command::Stop, Command::Freeze(true), Command::Clear] {
        assert!(desk.execute(command).unwrap_err().contains("is over"), "{command:?}");
    }
}

#[test]
fn stopped_session_stays_visible_until_next_begins() {
    let desk = running(Some("somewhere".into()), false);
    assert!(desk.execute(Command::Stop).is_ok());
    assert!(desk.turns().load(Ordering::Relaxed) && desk.stopped());
    desk.ends();
    assert_eq!(desk.status().phase, Phase::Ending);
    assert_eq!(desk.opens(), None, "nothing was to follow");
    desk.is_over();
    assert!(!desk.turns().load(Ordering::Relaxed));
    assert!(desk.execute(Command::Record).is_ok());
    assert!(desk.turns().load(Ordering::Relaxed));
    assert_eq!(desk.opens(), Some(Next { records: true }));
    assert_eq!(desk.status().phase, Phase::Opening);
    desk.runs(true, String::new());
    assert!(!desk.turns().load(Ordering::Relaxed) && !desk.stopped());
    let status = desk.status();
    assert!(status.records && status.keeps && status.phase == Phase::Running);
    // An unrecorded session is ended by the command to record.
    let desk = running(Some("somewhere".into()), false);
    assert!(desk.execute(Command::Record).is_ok() && desk.stopped());
    assert_eq!(desk.opens(), Some(Next { records: true }));
}

#[test]
fn freeze_is_ordered_once_and_reset_with_session() {
    let desk = running(None, false);
    for on in [true, true, false, true] {
        assert!(desk.execute(Command::Freeze(on)).is_ok());
    }
    assert!(desk.status().frozen);
    assert_eq!(desk.commands(), [true, false, true].map(Command::Freeze));
    assert!(desk.execute(Command::Clear).is_ok());
    desk.is_over();
    assert!(!desk.status().frozen && desk.commands().is_empty());
}

#[test]
fn setting_reaches_only_running_live_session() {
    let command = Command::Set(Setting::StuckAfter(7));
    let desk = SessionController::new(None);
    assert!(desk.execute(command).unwrap_err().contains("wait a moment"));
    desk.runs(false, String::new());
    assert!(desk.execute(command).is_ok());
    assert_eq!((desk.commands(), desk.commands()), (vec![command], vec![]), "once");
    desk.is_over();
    assert!(desk.execute(command).unwrap_err().contains("is over"));
}

fn snapshot() -> Snapshot {
    let grid =
        Grid { origin: DVec3::new(1.0, 2.0, 3.0), spacing: DVec3::ONE, direction: DMat3::IDENTITY, size: [2, 1, 1] };
    let weights: Vec<u8> = [0.0_f32, 2.5].iter().flat_map(|weight| weight.to_ne_bytes()).collect();
    Snapshot {
        space: DenseBox { first: [0; 3], grid },
        scalar: Scalar::U8,
        bytes: vec![0, 0].into(),
        weights: Some(weights.into()),
        slices: 7,
        grey_levels: [0.0, 255.0],
    }
}

#[test]
fn save_uses_free_names_and_separates_black_from_unseen() {
    let place = tempfile::tempdir().unwrap();
    let desk = running(Some(place.path().join("kept")), false);
    desk.update("Tracker");
    assert_eq!(desk.wants(), Wants::Nothing);
    for number in 1..=2 {
        assert!(desk.execute(Command::Save).is_ok());
        assert!(desk.execute(Command::Save).unwrap_err().contains("being saved"));
        assert_eq!((desk.wants(), desk.wants()), (Wants::Any, Wants::Nothing), "once");
        desk.taking(0.5);
        assert_eq!(desk.status().saving, Some(0.5));
        desk.volume(Ok(snapshot()));
        let status = desk.status();
        let name = format!("volume-{number:03}.mha");
        assert!(status.saving.is_none() && status.events.last().unwrap().says.contains(&name), "{status:?}");
        let [path, weights] =
            ["", "-weights"].map(|what| place.path().join(format!("kept/volume-{number:03}{what}.mha")));
        let volume = DenseVolume::open(&path, Some(&weights), 1 << 20).unwrap();
        assert_eq!(volume.seen(), 1, "one of two black voxels was seen");
    }
    assert!(desk.execute(Command::Save).is_ok());
    desk.volume(Err("no voxel was seen yet".into()));
    let last = desk.status().events.pop().unwrap();
    assert_eq!((last.how, last.number), (Progress::Failed, 3));
    assert!(last.says.contains("no voxel was seen yet"));
}

#[test]
fn events_keep_last_eight() {
    let desk = SessionController::new(None);
    for number in 0..20 {
        desk.happened(Progress::Done, number.to_string());
    }
    let events = desk.status().events;
    assert_eq!(events.iter().map(|event| event.number).collect::<Vec<_>>(), (13..=20).collect::<Vec<_>>());
}

#[test]
fn recording_is_replayed_and_viewed_after_end() {
    let text = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\nrate_hz = 30\n";
    let bedside = config::bedside::Bedside::parse(Path::new("bed.toml"), text).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let desk = SessionController::of_recording(None, Replayed::new(bedside, folder.path().to_owned(), 10));
    let replayed = desk.replayed().unwrap();
    let trial = |value: serde_json::Value| SettingsOverride::from([("volume.spacing_mm".to_owned(), value)]);
    assert!(desk.again(SettingsOverride::new()).unwrap_err().contains("wait a moment"));
    assert!(!replayed.begins().1, "the first run is as it was recorded");
    desk.runs(false, String::new());
    assert!(desk.look(1).unwrap_err().contains("after its end"));
    for command in [Command::Record, Command::Scan, Command::Freeze(true), Command::Clear] {
        assert!(desk.execute(command).unwrap_err().contains("is a recording"), "{command:?}");
    }
    assert!(desk.again(trial((-1).into())).unwrap_err().starts_with("volume.spacing_mm"));
    assert!(!desk.turns().load(Ordering::Relaxed) && !desk.stopped(), "nothing has changed");
    desk.is_over();
    for number in [0, 11] {
        assert!(desk.look(number).unwrap_err().contains("1 to 10"));
    }
    assert_eq!(replayed.wanted(), None);
    desk.look(3).unwrap();
    desk.look(10).unwrap();
    assert_eq!((replayed.wanted(), replayed.wanted()), (Some(9), None), "the newest, once");
    replayed.sees(ViewedFrame { number: 10, frame: 41, time_s: 0.3, posed: true });
    assert_eq!(desk.status().replayed.unwrap().seen.unwrap().frame, 41);
    // A replay command also ends a running replay.
    desk.runs(false, String::new());
    desk.again(trial(2.into())).unwrap();
    assert!(desk.turns().load(Ordering::Relaxed) && desk.opens().is_some());
    let (bedside, is_tried) = replayed.begins();
    assert!(is_tried && bedside.volume.settings.spacing_mm.x == 2.0);
    let status = desk.status().replayed.unwrap();
    assert_eq!((status.tried, status.seen), (trial(2.into()), None));
    assert!(SessionController::new(None).look(1).unwrap_err().contains("this session is live"));
}
