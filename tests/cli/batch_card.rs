//! The card of a data set: its numbers are those of the accounts and the recordings.

use std::collections::{BTreeMap, BTreeSet};

use serde_json::Value;
use sha2::{Digest as _, Sha256};

use super::batch::{ends, tree};
use super::place::Place;
use super::sequence::Sequence;

const CALIBRATION: &str = "format = \"sonoweave-calibration\"\nversion = 1\n[image_to_probe]\nmatrix = [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]\n";

/// A batch of five sweeps of two subjects, two of them with a calibration. One has a frame without
/// pose, and one that is cut short fails.
fn batch() -> Place {
    let place = Place::new();
    let small = |frames| Sequence { size: [16, 12], frames, ..Sequence::default() };
    place.put("a.mha", small(3).bytes());
    place.put("b.mha", Sequence { status: |frame| if frame == 1 { "INVALID" } else { "OK" }, ..small(5) }.bytes());
    let pose = |frame| format!("1 0 0 0 0 1 0 0 0 0 1 {frame} 0 0 0 1");
    place.put("c.mha", Sequence { transform: "ProbeToReference", pose, ..small(4) }.bytes());
    place.put("d.mha", Sequence { transform: "ProbeToReference", pose, ..small(6) }.bytes());
    let cut = small(3).bytes();
    place.put("e.mha", &cut[..cut.len() - 5]);
    place.put("probe.toml", CALIBRATION);
    let quick = "--clip none --path general --spacing 1";
    let rows = [
        format!("anna-1,a.mha,,{quick},Anna B.,2026-03-04,L12"),
        format!("anna-2,b.mha,,{quick},Anna B.,2026-03-04,L12"),
        format!("anna-3,c.mha,probe.toml,{quick},Anna B.,follow-up,C5"),
        format!("ben-1,d.mha,probe.toml,{quick},ben,,C5"),
        format!("ben-2,e.mha,,{quick},ben,,C5"),
    ];
    place.put("m.csv", format!("id,recording,config,settings,subject,session,probe\n{}\n", rows.join("\n")));
    place.put("study.key", [7; 32]);
    place
}

/// Rows of a table by their columns' names.
fn rows(place: &Place, name: &str) -> Vec<BTreeMap<String, String>> {
    let text = String::from_utf8(place.get(name)).unwrap();
    let mut lines = text.lines().map(|line| line.split('\t').map(str::to_owned).collect::<Vec<_>>());
    let names = lines.next().unwrap();
    lines.map(|cells| names.iter().cloned().zip(cells).collect()).collect()
}

fn run(place: &Place) {
    ends(place, 0, "batch plan m.csv -o run");
    ends(place, 10, "batch run run --jobs 2 --attempts 1");
}

#[test]
fn card_has_the_sums_of_all_accounts() {
    let place = batch();
    run(&place);
    let refused = ends(&place, 10, "batch card run -o set");
    assert!(refused.stderr.contains("1 of 5 sweeps are not done; use `batch run`"), "{}", refused.stderr);
    assert!(!place.names().contains("set"), "nothing is written");
    let said =
        ends(&place, 0, "batch card run -o set --partial --name Forearms --license CC0-1.0 --json=card.json").stdout;
    assert!(said.contains("set: 4 of 5 sweeps of 2 subjects, 17 of 18 frames used"), "{said}");
    // Counted here again, from the accounts alone.
    let accounts: Vec<Value> = tree(&place.path("run/sweeps"))
        .into_iter()
        .filter(|(name, _)| name.ends_with("done.json"))
        .map(|(_, text)| serde_json::from_slice(&text).unwrap())
        .collect();
    assert_eq!(accounts.len(), 4);
    let sum = |key: &str| accounts.iter().map(|done| done["report"]["frames"][key].as_u64().unwrap()).sum::<u64>();
    let mut reasons: BTreeMap<String, u64> = BTreeMap::new();
    for done in &accounts {
        for (reason, count) in done["report"]["frames"]["refused"].as_object().unwrap() {
            *reasons.entry(reason.clone()).or_default() += count.as_u64().unwrap();
        }
    }
    assert_eq!((sum("total"), sum("used"), reasons["pose_invalid"]), (18, 17, 1));
    let description = place.json("set/dataset_description.json");
    let card = &description["Sonoweave"];
    assert_eq!(*card, place.json("card.json"));
    assert_eq!(card["sweeps"], serde_json::json!({ "planned": 5, "done": 4, "failed": 1, "waiting": 0 }));
    assert_eq!(
        (card["frames"]["total"].as_u64(), card["frames"]["used"].as_u64()),
        (Some(sum("total")), Some(sum("used")))
    );
    assert_eq!(card["frames"]["refused"], serde_json::to_value(&reasons).unwrap());
    // Frames are 0.1 s apart: 3, 5, 4 and 6 of them.
    let seconds = 0.1 * f64::from(2 + 4 + 3 + 5);
    assert!((card["recorded"]["hours"].as_f64().unwrap() * 3600.0 - seconds).abs() < 1e-9, "{card}");
    let hash: String = Sha256::digest(CALIBRATION).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(card["calibrations"][0]["sha256"], hash.as_str());
    assert_eq!(
        (card["calibrations"].as_array().unwrap().len(), card["calibrations"][0]["sweeps"].as_u64()),
        (1, Some(2))
    );
    let programs: BTreeMap<&str, u64> = BTreeMap::from([(accounts[0]["program"].as_str().unwrap(), 4)]);
    assert_eq!(card["programs"], serde_json::to_value(programs).unwrap());
    assert_eq!(card["probes"], serde_json::json!({ "L12": 2, "C5": 2 }));
    assert_eq!(description["GeneratedBy"][0]["Name"], "sonoweave");
    let participants = rows(&place, "set/participants.tsv");
    let of = |row: &BTreeMap<String, String>| {
        ["participant_id", "sessions", "sweeps", "frames", "frames_used"].map(|name| row[name].clone())
    };
    assert_eq!(
        participants.iter().map(of).collect::<Vec<_>>(),
        [["sub-AnnaB", "2", "3", "12", "11"], ["sub-ben", "0", "1", "6", "6"]]
    );
    let sweeps = rows(&place, "set/sweeps.tsv");
    let stems: Vec<&str> = sweeps.iter().map(|row| row["stem"].as_str()).collect();
    let expected = [
        "sub-AnnaB_ses-20260304_run-01",
        "sub-AnnaB_ses-20260304_run-02",
        "sub-AnnaB_ses-followup_run-01",
        "sub-ben_run-01",
    ];
    assert_eq!(stems, expected);
    assert_eq!(sweeps[3]["folder"], "sub-ben/us");
    for row in &sweeps {
        let account = accounts.iter().find(|done| done["id"] == row["sweep"].as_str()).unwrap();
        assert_eq!(account["outputs"][0]["sha256"], row["volume_sha256"].as_str(), "{row:?}");
    }
    let readme = String::from_utf8(place.get("set/README.md")).unwrap();
    for line in [
        "# Forearms\n",
        "| frames | 18 |",
        "| frames, used | 17 |",
        "- pose_invalid: 1\n",
        "BIDS-style",
        "License: CC0-1.0\n",
        &hash,
    ] {
        assert!(readme.contains(line), "{line}: {readme}");
    }
}

#[test]
fn tables_are_described_as_croissant() {
    let place = batch();
    run(&place);
    ends(&place, 0, "batch card run -o bare --partial --name Forearms");
    for (file, key) in [("croissant.json", "license"), ("dataset_description.json", "License")] {
        assert!(place.json(&format!("bare/{file}"))[key].is_null(), "nobody has stated one");
    }
    let refused = ends(&place, 2, "batch card run -o set --partial --license=");
    assert!(refused.stderr.contains("--license \"\": must be one line of text"), "{}", refused.stderr);
    ends(&place, 0, "batch card run -o set --partial --name Forearms --license CC0-1.0");
    assert_eq!(place.json("set/dataset_description.json")["License"], "CC0-1.0");
    let described = place.json("set/croissant.json");
    assert_eq!((described["name"].as_str(), described["license"].as_str()), (Some("Forearms"), Some("CC0-1.0")));
    let (files, sets) = (described["distribution"].as_array().unwrap(), described["recordSet"].as_array().unwrap());
    assert_eq!((files.len(), sets.len()), (2, 2));
    for (file, set) in files.iter().zip(sets) {
        let text = place.get(&format!("set/{}", file["contentUrl"].as_str().unwrap()));
        let hash: String = Sha256::digest(&text).iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(file["sha256"], hash.as_str());
        let text = String::from_utf8(text).unwrap();
        let columns: Vec<&str> = text.lines().next().unwrap().split('\t').collect();
        let fields = set["field"].as_array().unwrap();
        let named: Vec<&str> = fields.iter().map(|field| field["name"].as_str().unwrap()).collect();
        assert_eq!(named, columns);
        assert!(fields.iter().all(|field| field["source"]["fileObject"]["@id"] == file["@id"]));
    }
}

#[test]
fn names_pass_through_the_pseudonyms() {
    let place = batch();
    run(&place);
    ends(&place, 0, "batch card run -o set --partial --key study.key --json=card.json");
    let files = ["README.md", "dataset_description.json", "croissant.json", "participants.tsv", "sweeps.tsv"];
    for name in files.map(|name| format!("set/{name}")).into_iter().chain(["card.json".to_owned()]) {
        let text = String::from_utf8(place.get(&name)).unwrap();
        for secret in ["anna", "Anna", "ben", "2026-03-04", "20260304", "follow", "probe.toml", "/tmp", "L12"] {
            assert!(!text.contains(secret), "{name} holds {secret}: {text}");
        }
    }
    let participants: BTreeSet<String> =
        rows(&place, "set/participants.tsv").iter().map(|row| row["participant_id"].clone()).collect();
    assert_eq!(participants.len(), 2);
    // The pseudonym is that of a converted file.
    place.put("s.mha", Sequence::default().bytes());
    place.does("convert s.mha -o x.mha --anonymize --clip none --subject ben --key study.key --json=x.json");
    let ben = place.json("x.json")["subject"].as_str().unwrap().to_owned();
    assert!(participants.contains(&format!("sub-{ben}")), "{participants:?}");
    std::fs::copy(place.path("study.key"), place.path("run/study.key")).unwrap();
    let refused = ends(&place, 2, "batch card run -o other --partial --key run/study.key");
    assert!(refused.stderr.contains("lies among the data"), "{}", refused.stderr);
}

#[test]
fn subjects_of_one_label_are_refused() {
    let place = Place::new();
    place.put("a.mha", Sequence { size: [16, 12], frames: 3, ..Sequence::default() }.bytes());
    place.put("m.csv", "id,recording,settings,subject\nx,a.mha,--clip none,a-1\ny,a.mha,--clip none,a1\n");
    ends(&place, 0, "batch plan m.csv -o run");
    ends(&place, 0, "batch run run --jobs 1");
    let refused = ends(&place, 3, "batch card run -o set");
    assert!(refused.stderr.contains("\"a-1\" and \"a1\" both become sub-a1"), "{}", refused.stderr);
    assert!(!place.names().contains("set"));
}

#[test]
fn side_file_of_a_sweep_names_no_file() {
    let place = batch();
    place.does("inspect c.mha --config probe.toml --sidecar c.json");
    let side = place.json("c.json");
    assert_eq!(
        (side["Frames"].as_u64(), side["World"].as_str(), side["FramesWithPose"].as_u64()),
        (Some(4), Some("Reference"), Some(4))
    );
    assert!((side["FrameRateHz"].as_f64().unwrap() - 10.0).abs() < 1e-9, "{side}");
    let hash: String = Sha256::digest(CALIBRATION).iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(side["Calibration"]["Sha256"], hash.as_str());
    let text = side.to_string();
    assert!(!text.contains("c.mha") && !text.contains("probe.toml"), "{text}");
    place.refuses_with(
        "inspect probe.toml --sidecar x.json",
        &["is not a sequence; leave out --config, --world and --sidecar"],
    );
}
