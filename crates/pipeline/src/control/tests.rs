//! Commands allowed in each phase, and the status.

use glam::{DMat3, DVec3};

use export::volume::{DenseBox, Scalar};
use mask::{Mask, MaskError, MaskFound, MaskShape};
use sonoweave_core::region::ClipRect;
use volume::Grid;
use volume::dense::DenseVolume;

use super::*;
use crate::MaskOrigin;
use crate::command::Setting;

fn running(folder: Option<PathBuf>, records: bool) -> SessionController {
    let controller = SessionController::new(folder);
    controller.runs(records, "a test".into());
    controller
}

#[test]
fn impossible_command_is_refused_with_advice() {
    let controller = SessionController::new(None);
    for command in [Command::Record, Command::Scan, Command::Stop, Command::Freeze(true), Command::Clear] {
        assert!(matches!(controller.execute(command).unwrap_err(), ControlError::Busy), "{command:?}");
    }
    assert!(matches!(controller.execute(Command::Save).unwrap_err(), ControlError::NoFolder));
    controller.runs(false, String::new());
    assert!(matches!(controller.execute(Command::Record).unwrap_err(), ControlError::NoFolder));
    assert!(matches!(controller.execute(Command::Scan).unwrap_err(), ControlError::AlreadyRunning));
    assert!(!controller.turns().load(Ordering::Relaxed) && !controller.stopped() && controller.commands().is_empty());
    let controller = running(Some("somewhere".into()), true);
    assert!(matches!(controller.execute(Command::Record).unwrap_err(), ControlError::AlreadyRecording));
    assert_eq!(controller.status().phase, Phase::Running);
    controller.is_over();
    for command in [Command::Stop, Command::Freeze(true), Command::Clear] {
        assert!(matches!(controller.execute(command).unwrap_err(), ControlError::Over), "{command:?}");
    }
}

#[test]
fn stopped_session_stays_visible_until_next_begins() {
    let controller = running(Some("somewhere".into()), false);
    assert!(controller.execute(Command::Stop).is_ok());
    assert!(controller.turns().load(Ordering::Relaxed) && controller.stopped());
    controller.ends();
    assert_eq!(controller.status().phase, Phase::Ending);
    assert_eq!(controller.opens(), None, "nothing was to follow");
    controller.is_over();
    assert!(!controller.turns().load(Ordering::Relaxed));
    assert!(controller.execute(Command::Record).is_ok());
    assert!(controller.turns().load(Ordering::Relaxed));
    assert_eq!(controller.opens(), Some(Next { records: true }));
    assert_eq!(controller.status().phase, Phase::Opening);
    controller.runs(true, String::new());
    assert!(!controller.turns().load(Ordering::Relaxed) && !controller.stopped());
    let status = controller.status();
    assert!(status.records && status.keeps && status.phase == Phase::Running);
    // An unrecorded session is ended by the command to record.
    let controller = running(Some("somewhere".into()), false);
    assert!(controller.execute(Command::Record).is_ok() && controller.stopped());
    assert_eq!(controller.opens(), Some(Next { records: true }));
}

#[test]
fn freeze_is_ordered_once_and_reset_with_session() {
    let controller = running(None, false);
    for on in [true, true, false, true] {
        assert!(controller.execute(Command::Freeze(on)).is_ok());
    }
    assert!(controller.status().frozen);
    assert_eq!(controller.commands(), [true, false, true].map(Command::Freeze));
    assert!(controller.execute(Command::Clear).is_ok());
    controller.is_over();
    assert!(!controller.status().frozen && controller.commands().is_empty());
}

#[test]
fn setting_reaches_only_running_live_session() {
    let command = Command::Set(Setting::StuckAfter(7));
    let controller = SessionController::new(None);
    assert!(matches!(controller.execute(command).unwrap_err(), ControlError::Busy));
    controller.runs(false, String::new());
    assert!(controller.execute(command).is_ok());
    assert_eq!((controller.commands(), controller.commands()), (vec![command], vec![]), "once");
    controller.is_over();
    assert!(matches!(controller.execute(command).unwrap_err(), ControlError::Over));
}

#[test]
fn mask_command_needs_mask_room_and_general_path() {
    let whole = Mask::full(64, 48);
    let found = MaskFound::certain(whole, MaskShape::Whole);
    let status = SessionStatus {
        mask: Some(MaskStatus::new(found, MaskOrigin::Found, None)),
        path: Some("general"),
        ..SessionStatus::default()
    };
    let mask = |x, width| Command::Mask(MaskChange::Rectangle(ClipRect { x, y: 0, width, height: 48 }));
    let refused = |controller: &SessionController, command| match controller.execute(command).unwrap_err() {
        ControlError::Mask(refusal) => refusal,
        other => panic!("{other}"),
    };
    let controller = running(None, false);
    assert_eq!(refused(&controller, mask(0, 8)), MaskRefusal::Undecided);
    controller.update(&status);
    assert!(matches!(refused(&controller, mask(60, 8)), MaskRefusal::Mask(MaskError::Leaves { .. })));
    assert!(controller.commands().is_empty(), "nothing has changed");
    let keep = Command::Mask(MaskChange::Keep);
    assert!(controller.execute(mask(0, 8)).unwrap().contains("a rectangle of 8×48 pixels at 0,0"));
    assert!(controller.execute(keep).is_ok());
    assert_eq!(controller.commands(), [mask(0, 8), keep]);
    controller.update(&SessionStatus { path: Some("planar"), ..status });
    assert_eq!(refused(&controller, mask(0, 8)), MaskRefusal::Planar);
    assert!(controller.execute(keep).is_ok(), "a mask that stays");
    controller.is_over();
    assert!(matches!(controller.execute(keep).unwrap_err(), ControlError::Over));
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
    let controller = running(Some(place.path().join("kept")), false);
    controller.update(&SessionStatus { world: "Tracker".into(), ..SessionStatus::default() });
    assert_eq!(controller.request(), VolumeRequest::None);
    for number in 1..=2 {
        assert!(controller.execute(Command::Save).is_ok());
        assert!(matches!(controller.execute(Command::Save).unwrap_err(), ControlError::Saving));
        assert_eq!((controller.request(), controller.request()), (VolumeRequest::Now, VolumeRequest::None), "once");
        controller.progress(0.5);
        assert_eq!(controller.status().saving, Some(0.5));
        controller.volume(Ok(snapshot()));
        let status = controller.status();
        let name = format!("volume-{number:03}.mha");
        assert!(status.saving.is_none() && status.events.last().unwrap().text.contains(&name), "{status:?}");
        let [path, weights] =
            ["", "-weights"].map(|what| place.path().join(format!("kept/volume-{number:03}{what}.mha")));
        let volume = DenseVolume::open(&path, Some(&weights), 1 << 20).unwrap();
        assert_eq!(volume.seen(), 1, "one of two black voxels was seen");
    }
    assert!(controller.execute(Command::Save).is_ok());
    controller.volume(Err(NoVolume::Unseen));
    let last = controller.status().events.pop().unwrap();
    assert_eq!((last.how, last.number), (Progress::Failed, 3));
    assert!(last.text.contains("no voxel was seen yet; wait for the first slices"));
}

#[test]
fn events_keep_last_eight() {
    let controller = SessionController::new(None);
    for number in 0..20 {
        controller.report(Progress::Done, number.to_string());
    }
    let events = controller.status().events;
    assert_eq!(events.iter().map(|event| event.number).collect::<Vec<_>>(), (13..=20).collect::<Vec<_>>());
}

#[test]
fn recording_is_replayed_and_viewed_after_end() {
    let text = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\nrate_hz = 30\n";
    let bedside = config::bedside::Bedside::parse(Path::new("bed.toml"), text).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let controller = SessionController::of_recording(None, Replayed::new(bedside, folder.path().to_owned(), 10));
    let replayed = controller.replayed().unwrap();
    let trial = |value: serde_json::Value| SettingsOverride::from([("volume.spacing_mm".to_owned(), value)]);
    assert!(matches!(controller.again(SettingsOverride::new()).unwrap_err(), ControlError::ReplayBusy));
    assert!(!replayed.begins().1, "the first run is as it was recorded");
    controller.runs(false, String::new());
    assert!(matches!(controller.show_frame(1).unwrap_err(), ControlError::ReplayRunning));
    for command in
        [Command::Record, Command::Scan, Command::Freeze(true), Command::Clear, Command::Mask(MaskChange::Keep)]
    {
        assert!(matches!(controller.execute(command).unwrap_err(), ControlError::Recorded), "{command:?}");
    }
    assert!(controller.again(trial((-1).into())).unwrap_err().to_string().starts_with("volume.spacing_mm"));
    assert!(!controller.turns().load(Ordering::Relaxed) && !controller.stopped(), "nothing has changed");
    controller.is_over();
    for number in [0, 11] {
        assert!(matches!(controller.show_frame(number).unwrap_err(), ControlError::NoFrame { frames: 10, .. }));
    }
    assert_eq!(replayed.requested(), None);
    controller.show_frame(3).unwrap();
    controller.show_frame(10).unwrap();
    assert_eq!((replayed.requested(), replayed.requested()), (Some(9), None), "the newest, once");
    replayed.set_viewed(ViewedFrame { number: 10, frame: 41, time_s: 0.3, posed: true });
    assert_eq!(controller.status().replayed.unwrap().seen.unwrap().frame, 41);
    // A replay command also ends a running replay.
    controller.runs(false, String::new());
    controller.again(trial(2.into())).unwrap();
    assert!(controller.turns().load(Ordering::Relaxed) && controller.opens().is_some());
    let (bedside, is_tried) = replayed.begins();
    assert!(is_tried && bedside.volume.settings.spacing_mm.x == 2.0);
    let status = controller.status().replayed.unwrap();
    assert_eq!((status.settings, status.seen), (trial(2.into()), None));
    assert!(matches!(SessionController::new(None).show_frame(1).unwrap_err(), ControlError::Live));
}
