//! Creates a session's file: a new file in a folder, named after its begin.

use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

use sonoweave_core::clock::SECOND;

use crate::Error;
use crate::whole::{create_folders, sync_folder};

/// Number of names tried within one second.
const TRIES: u32 = 1000;

/// Creates the folder if it is missing, and a new file in it: `SESSION-20261121-213000.mcap`,
/// in UTC. If that name is taken: `SESSION-20261121-213000-2.mcap`. No file is ever
/// overwritten, and no name identifies the patient.
pub(super) fn create(folder: &Path, realtime_ns: i64) -> Result<(File, PathBuf), Error> {
    let failed = |path: &Path, doing, source| Error::Io { path: path.to_owned(), doing, source };
    create_folders(folder).map_err(|source| failed(folder, "making the folder for sessions", source))?;
    let [year, month, day, hour, minute, second] = utc(realtime_ns);
    let name = format!("SESSION-{year:04}{month:02}{day:02}-{hour:02}{minute:02}{second:02}");
    for nth in 1..=TRIES {
        let path = folder.join(if nth == 1 { format!("{name}.mcap") } else { format!("{name}-{nth}.mcap") });
        // Read too: after a failed sync, data are written again from the system's memory.
        match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
            Ok(file) => {
                sync_folder(folder).map_err(|source| failed(&path, "syncing the name of a session's file", source))?;
                return Ok((file, path));
            }
            Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
            Err(source) => return Err(failed(&path, "making a session's file", source)),
        }
    }
    let taken = io::Error::new(ErrorKind::AlreadyExists, format!("{name}.mcap and {TRIES} names like it are taken"));
    Err(failed(folder, "making a session's file", taken))
}

/// Returns year, month, day, hour, minute and second of the Gregorian calendar, UTC.
pub(super) fn utc(realtime_ns: i64) -> [i64; 6] {
    let seconds = realtime_ns.div_euclid(SECOND);
    let (days, of_day) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Years begin in March, so that the leap day is the last day; eras of 400 years begin on 1
    // March 0000.
    let days = days + 719_468;
    let (era, of_era) = (days.div_euclid(146_097), days.rem_euclid(146_097));
    let year = (of_era - of_era / 1460 + of_era / 36_524 - of_era / 146_096) / 365;
    let of_year = of_era - (365 * year + year / 4 - year / 100);
    let from_march = (5 * of_year + 2) / 153;
    let day = of_year - (153 * from_march + 2) / 5 + 1;
    let month = if from_march < 10 { from_march + 3 } else { from_march - 9 };
    let year = era * 400 + year + i64::from(month <= 2);
    [year, month, day, of_day / 3600, of_day / 60 % 60, of_day % 60]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn utc_matches_calendar() {
        for (seconds, date) in [
            (0, [1970, 1, 1, 0, 0, 0]),
            (951_782_399, [2000, 2, 28, 23, 59, 59]),
            (951_782_400, [2000, 2, 29, 0, 0, 0]),
            (1_709_164_800, [2024, 2, 29, 0, 0, 0]),
            (1_709_251_200, [2024, 3, 1, 0, 0, 0]),
            (1_795_303_817, [2026, 11, 21, 23, 30, 17]),
            (4_107_542_399, [2100, 2, 28, 23, 59, 59]),
            (4_107_542_400, [2100, 3, 1, 0, 0, 0]),
        ] {
            assert_eq!(utc(seconds * SECOND + 5), date);
        }
    }

    #[test]
    fn create_never_overwrites_and_makes_folders() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("a/b");
        let paths: Vec<_> = (0..3).map(|_| create(&inner, 7).unwrap().1).collect();
        assert!(
            paths[0].ends_with("SESSION-19700101-000000.mcap") && paths[2].ends_with("SESSION-19700101-000000-3.mcap")
        );
        let wrong = create(&paths[0], 7).err().unwrap().to_string();
        assert!(wrong.contains("making the folder for sessions failed"), "{wrong}");
    }
}
