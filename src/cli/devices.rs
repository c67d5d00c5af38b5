//! `sonoweave devices`: lists the connected devices, their drivers, and problems in opening
//! them.

use std::collections::BTreeSet;
use std::time::Duration;

use clap::Args;
use serde::Serialize;

use drivers::Listing;
use drivers::transport::DENIED;

use super::Failure;
use super::print::print;
use crate::app::doctor::facts::UDEV_RULES;
use crate::app::json::JsonFlag;

/// Polling interval of --watch. `nusb::watch_devices` depends on udev events, which are missing
/// in containers and small systems. It also covers USB only, while lines and grabbers use other
/// buses too.
const WATCH: Duration = Duration::from_millis(500);

/// Flags of `devices`.
#[derive(Debug, Args)]
#[command(after_long_help = "\
A serial line does not identify its device; the session configuration names it.

Examples: sonoweave devices
          sonoweave devices --watch
          sonoweave devices --udev | sudo tee /etc/udev/rules.d/70-sonoweave.rules")]
pub struct Arguments {
    /// Keep running and report connected and disconnected devices, until interrupted
    #[arg(long)]
    watch: bool,
    #[command(flatten)]
    json: JsonFlag,
    /// Print the udev rules to install, and nothing else
    #[arg(long, conflicts_with_all = ["watch", "json"])]
    udev: bool,
}

/// A device, and the drivers that could open it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize)]
struct Found {
    /// Its name in settings.
    id: String,
    /// The drivers, by name.
    drivers: Vec<&'static str>,
    description: String,
    /// Reason why it cannot be opened, and the remedy; `null` if it can.
    unavailable: Option<String>,
}

/// Runs the command.
///
/// # Errors
/// [`Failure`] when the list cannot be written.
pub fn run(arguments: &Arguments) -> Result<(), Failure> {
    if arguments.udev {
        return print(UDEV_RULES);
    }
    arguments.json.check([])?;
    let mut before = None;
    loop {
        let found = merged(drivers::list().into_iter());
        if before.as_ref() != Some(&found) {
            print(&before.as_ref().map_or_else(|| whole(&found), |before| changes(before, &found)))?;
            arguments.json.write(&found)?;
            before = Some(found);
        }
        if !arguments.watch {
            return Ok(());
        }
        std::thread::sleep(WATCH);
    }
}

/// Merges the lists into one entry per device, even if several drivers see it.
fn merged(lists: impl Iterator<Item = (&'static str, Vec<Listing>)>) -> Vec<Found> {
    let mut all: Vec<Found> = Vec::new();
    for (driver, list) in lists {
        for Listing { id, description, unavailable } in list {
            match all.iter_mut().find(|found| found.id == id) {
                Some(found) => found.drivers.push(driver),
                None => all.push(Found { id, drivers: vec![driver], description, unavailable }),
            }
        }
    }
    all.sort();
    all
}

/// Formats a device's lines.
fn entry(found: &Found) -> String {
    let Found { id, drivers, description, unavailable } = found;
    let mark = if unavailable.is_some() { "✗" } else { "✓" };
    let mut text = format!("{mark} {id}\n    {description}; for: {}\n", drivers.join(", "));
    if let Some(why) = unavailable {
        text += &format!("    cannot be opened: {why}\n");
    }
    text
}

/// Formats the whole list.
fn whole(all: &[Found]) -> String {
    if all.is_empty() {
        return "No serial line, tracker on USB or frame grabber is plugged in.\n".into();
    }
    let mut text: String = all.iter().map(entry).collect();
    let closed = all.iter().filter(|found| found.unavailable.is_some()).count();
    text += &match closed {
        0 => format!("{} found; all can be opened.\n", all.len()),
        _ => format!("{} found; {closed} of them cannot be opened.\n", all.len()),
    };
    if all.iter().any(|found| found.unavailable.as_ref().is_some_and(|why| why.contains(DENIED))) {
        text += "The udev rules give access to the user at this machine: sonoweave devices --udev | sudo tee \
            /etc/udev/rules.d/70-sonoweave.rules\n";
    }
    text
}

/// Formats added, removed and changed devices.
fn changes(before: &[Found], now: &[Found]) -> String {
    let ids = |all: &[Found]| all.iter().map(|found| found.id.clone()).collect::<BTreeSet<_>>();
    let (old, new) = (ids(before), ids(now));
    let gone =
        before.iter().filter(|found| !new.contains(&found.id)).map(|found| format!("- {}\n    unplugged\n", found.id));
    let come = now.iter().filter(|found| !old.contains(&found.id)).map(|found| format!("+ {}", entry(found)));
    let other = now.iter().filter(|found| old.contains(&found.id) && !before.contains(found)).map(entry);
    gone.chain(come).chain(other).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::failure::with_remedy;

    fn listing(id: &str, unavailable: Option<&str>) -> Listing {
        Listing { id: id.into(), description: format!("a thing at {id}"), unavailable: unavailable.map(Into::into) }
    }

    #[test]
    fn line_seen_by_two_drivers_is_one_device() {
        let found = merged(
            [
                ("tracker", vec![listing("/dev/ttyB", None), listing("usb:1-2", Some(DENIED))]),
                ("arm", vec![listing("/dev/ttyB", None)]),
            ]
            .into_iter(),
        );
        assert_eq!(found.len(), 2);
        assert_eq!(found[0].drivers, ["tracker", "arm"]);
        let text = whole(&found);
        assert!(text.contains("✓ /dev/ttyB\n    a thing at /dev/ttyB; for: tracker, arm\n"), "{text}");
        assert!(text.contains("✗ usb:1-2") && text.contains("2 found; 1 of them cannot be opened"), "{text}");
        assert!(text.contains("--udev") && with_remedy(DENIED).contains("--udev"), "{text}");
    }

    #[test]
    fn changes_lists_only_differences() {
        let all = |lists: Vec<Listing>| merged([("tracker", lists)].into_iter());
        let before = all(vec![listing("a", None), listing("b", None), listing("c", None)]);
        let now = all(vec![listing("b", Some("busy")), listing("c", None), listing("d", None)]);
        let text = changes(&before, &now);
        assert_eq!(
            text,
            "- a\n    unplugged\n+ ✓ d\n    a thing at d; for: tracker\n✗ b\n    a thing at b; for: tracker\n    cannot be opened: busy\n"
        );
        assert!(whole(&[]).contains("No serial line"));
    }
}
