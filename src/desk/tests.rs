//! What may be wished when, and what is told of it.

use glam::{DMat3, DVec3};

use super::*;
use crate::export::volume::{DenseBox, Scalar};
use crate::volume::Grid;
use crate::volume::dense::DenseVolume;

fn running(folder: Option<PathBuf>, records: bool) -> Desk {
    let desk = Desk::new(folder);
    desk.runs(records, "a test".into());
    desk
}

#[test]
fn what_is_not_possible_now_is_refused_with_what_to_do_and_changes_nothing() {
    let desk = Desk::new(None);
    for deed in [Deed::Record, Deed::Scan, Deed::Stop, Deed::Freeze(true), Deed::Clear] {
        assert!(desk.wish(deed).unwrap_err().contains("wait a moment"), "{deed:?}");
    }
    assert!(desk.wish(Deed::Save).unwrap_err().contains("--keep DIR"));
    desk.runs(false, String::new());
    assert!(desk.wish(Deed::Record).unwrap_err().contains("--keep DIR"));
    assert!(desk.wish(Deed::Scan).unwrap_err().contains("runs already"));
    assert!(!desk.turns().load(Ordering::Relaxed) && !desk.stopped() && desk.orders().is_empty());
    let desk = running(Some("somewhere".into()), true);
    assert!(desk.wish(Deed::Record).unwrap_err().contains("being recorded already"));
    assert_eq!(desk.told().phase, Phase::Running);
    desk.is_over();
    for deed in [Deed::Stop, Deed::Freeze(true), Deed::Clear] {
        assert!(desk.wish(deed).unwrap_err().contains("is over"), "{deed:?}");
    }
}

#[test]
fn a_session_is_stopped_looked_at_and_followed_by_another() {
    let desk = running(Some("somewhere".into()), false);
    assert!(desk.wish(Deed::Stop).is_ok());
    assert!(desk.turns().load(Ordering::Relaxed) && desk.stopped());
    desk.ends();
    assert_eq!(desk.told().phase, Phase::Ending);
    assert_eq!(desk.opens(), None, "nothing was to follow");
    desk.is_over();
    assert!(!desk.turns().load(Ordering::Relaxed));
    assert!(desk.wish(Deed::Record).is_ok());
    assert!(desk.turns().load(Ordering::Relaxed));
    assert_eq!(desk.opens(), Some(Next { records: true }));
    assert_eq!(desk.told().phase, Phase::Opening);
    desk.runs(true, String::new());
    assert!(!desk.turns().load(Ordering::Relaxed) && !desk.stopped());
    let told = desk.told();
    assert!(told.records && told.keeps && told.phase == Phase::Running);
    // One that runs unrecorded is ended by the wish to record.
    let desk = running(Some("somewhere".into()), false);
    assert!(desk.wish(Deed::Record).is_ok() && desk.stopped());
    assert_eq!(desk.opens(), Some(Next { records: true }));
}

#[test]
fn to_freeze_is_ordered_once_and_forgotten_with_the_session() {
    let desk = running(None, false);
    for on in [true, true, false, true] {
        assert!(desk.wish(Deed::Freeze(on)).is_ok());
    }
    assert!(desk.told().frozen);
    let orders = desk.orders();
    let paused = orders.iter().filter_map(|order| if let Order::Pause(on) = order { Some(*on) } else { None });
    assert_eq!(paused.collect::<Vec<_>>(), [true, false, true]);
    assert!(desk.wish(Deed::Clear).is_ok());
    desk.is_over();
    assert!(!desk.told().frozen && desk.orders().is_empty());
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
fn a_volume_is_saved_by_names_of_its_own_and_black_is_told_from_unseen() {
    let place = tempfile::tempdir().unwrap();
    let desk = running(Some(place.path().join("kept")), false);
    desk.goes_on("Tracker", false);
    assert_eq!(desk.wants(), Wants::Nothing);
    for number in 1..=2 {
        assert!(desk.wish(Deed::Save).is_ok());
        assert!(desk.wish(Deed::Save).unwrap_err().contains("just being saved"));
        assert_eq!((desk.wants(), desk.wants()), (Wants::Any, Wants::Nothing), "once");
        desk.taking(0.5);
        assert_eq!(desk.told().saving, Some(0.5));
        desk.volume(Ok(snapshot()));
        let told = desk.told();
        let name = format!("volume-{number:03}.mha");
        assert!(told.saving.is_none() && told.events.last().unwrap().says.contains(&name), "{told:?}");
        let [path, weights] =
            ["", "-weights"].map(|what| place.path().join(format!("kept/volume-{number:03}{what}.mha")));
        let volume = DenseVolume::open(&path, Some(&weights), 1 << 20).unwrap();
        assert_eq!(volume.seen(), 1, "one of two black voxels was seen");
    }
    assert!(desk.wish(Deed::Save).is_ok());
    desk.volume(Err("no voxel was seen yet".into()));
    let last = desk.told().events.pop().unwrap();
    assert_eq!((last.how, last.number), (How::Failed, 3));
    assert!(last.says.contains("no voxel was seen yet"));
}

#[test]
fn what_happened_is_told_a_while() {
    let desk = Desk::new(None);
    for number in 0..20 {
        desk.happened(How::Done, number.to_string());
    }
    let events = desk.told().events;
    assert_eq!(events.iter().map(|event| event.number).collect::<Vec<_>>(), (13..=20).collect::<Vec<_>>());
}

#[test]
fn a_recording_is_run_again_and_looked_at_when_it_is_over() {
    let text = "format = \"sonoweave-bedside\"\nversion = 1\n[tracker]\nmodel = \"fastrak\"\nport = \"virtual\"\n[grabber]\ndevice = \"virtual\"\nsize = \"64x48\"\nrate_hz = 30\n";
    let bedside = crate::config::bedside::Bedside::parse(Path::new("bed.toml"), text).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let desk = Desk::of_recording(None, Replayed::new(bedside, folder.path().to_owned(), 10));
    let replayed = desk.replayed().unwrap();
    let trial = |value: serde_json::Value| Trial::from([("volume.spacing_mm".to_owned(), value)]);
    assert!(desk.again(Trial::new()).unwrap_err().contains("wait a moment"));
    assert!(!replayed.begins().1, "the first run is as it was recorded");
    desk.runs(false, String::new());
    assert!(desk.look(1).unwrap_err().contains("when it is over"));
    for deed in [Deed::Record, Deed::Scan, Deed::Freeze(true), Deed::Clear] {
        assert!(desk.wish(deed).unwrap_err().contains("is a recording"), "{deed:?}");
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
    replayed.sees(Seen { number: 10, frame: 41, time_s: 0.3, posed: true });
    assert_eq!(desk.told().replayed.unwrap().seen.unwrap().frame, 41);
    // While it runs, too: that run ends.
    desk.runs(false, String::new());
    desk.again(trial(2.into())).unwrap();
    assert!(desk.turns().load(Ordering::Relaxed) && desk.opens().is_some());
    let (bedside, is_tried) = replayed.begins();
    assert!(is_tried && bedside.volume.settings.spacing_mm.x == 2.0);
    let told = desk.told().replayed.unwrap();
    assert_eq!((told.tried, told.seen), (trial(2.into()), None));
    assert!(Desk::new(None).look(1).unwrap_err().contains("this session is live"));
}
