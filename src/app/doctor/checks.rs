//! Judges the facts of a machine, item by item, and says what to do.

use drivers::transport::DENIED;
use simd::Simd;

use super::facts::{DiskSpeed, Facts, Group, Rules};
use super::{Finding, fine, problem, warning};

/// Realtime priority that capture asks for, as the package's service allows.
const PRIORITY: u64 = 20;
/// Rate below which a disk may not take all frames, MB/s: 30 grey frames of 720×576 a second.
const FRAMES_MB_PER_S: f64 = 12.4;
/// Longest write with its sync, s: a power cut should take at most the last second.
const LONGEST_S: f64 = 1.0;
/// Free space for about ten minutes of recording, bytes.
const FREE_BYTES: u64 = 4 << 30;

/// Returns the findings, one for each item.
pub(crate) fn judge(facts: &Facts) -> Vec<Finding> {
    let mut findings = of_devices(facts);
    findings.push(of_rules(facts));
    findings.extend(of_groups(facts));
    findings.push(of_processor(facts));
    findings.extend(of_limits(facts));
    findings.push(of_disk(facts));
    findings.extend(facts.ports.iter().map(|(port, taken)| match taken {
        None => fine("port", format!("{port} is free")),
        Some(why) => warning("port", format!("{port}: {why}"), "end the program that has it, or give another port"),
    }));
    findings.push(match facts.browser {
        Some(name) => fine("browser", name),
        None => warning("browser", "none is installed", "install one, or open the page on another machine"),
    });
    findings
}

fn of_devices(facts: &Facts) -> Vec<Finding> {
    if facts.devices.is_empty() {
        let advice = "plug in tracker and grabber; `sonoweave demo` needs none";
        return vec![warning("device", "no serial line, tracker on USB or frame grabber", advice)];
    }
    let of_device = |device: &drivers::Listing| match &device.unavailable {
        None => fine("device", format!("{}: {}", device.id, device.description)),
        Some(why) if why.contains(DENIED) => problem(
            "device",
            format!("{}: {why}", device.id),
            "install the udev rules and join the groups, as stated below",
        ),
        Some(why) if device.is_bus() => warning(
            "device",
            format!("{}: {why}", device.id),
            "if a device is plugged in there, give this machine or container access to it; otherwise, do nothing",
        ),
        Some(why) => problem("device", format!("{}: {why}", device.id), "end the program that has it, or replug it"),
    };
    facts.devices.iter().map(of_device).collect()
}

fn of_rules(facts: &Facts) -> Finding {
    let install = "sonoweave devices --udev | sudo tee /etc/udev/rules.d/70-sonoweave.rules";
    match facts.rules {
        Rules::Installed => fine("udev rules", "installed"),
        Rules::Other => warning("udev rules", "installed, but of another version", install),
        Rules::Missing => warning("udev rules", "not installed", install),
    }
}

fn of_groups(facts: &Facts) -> Vec<Finding> {
    let of_group = |group: &Group| match group.member {
        _ if facts.is_root => fine("group", format!("{}: not needed by root", group.name)),
        Some(true) => fine("group", format!("{}: a member", group.name)),
        Some(false) => warning(
            "group",
            format!("{}: not a member", group.name),
            format!("sudo adduser $USER {}, and log in again", group.name),
        ),
        None => {
            warning("group", format!("{}: does not exist", group.name), "use the system's own group of the devices")
        }
    };
    facts.groups.iter().map(of_group).collect()
}

fn of_processor(facts: &Facts) -> Finding {
    let sets: Vec<&str> = facts.sets.iter().map(|set| set.name()).collect();
    let found = format!("{} threads; {}", facts.cores, sets.join(", "));
    let has_vectors = cfg!(target_arch = "aarch64") || facts.sets.iter().any(|set| *set != Simd::Portable);
    if !has_vectors {
        return warning("processor", found, "use a processor with AVX2 and FMA: it is several times as fast");
    }
    if facts.cores < 2 {
        return warning("processor", found, "use two threads or more: one inserts slices while another draws");
    }
    fine("processor", found)
}

fn of_limits(facts: &Facts) -> [Finding; 2] {
    let advice = |name: &str, value: &str| {
        format!("add the line `@audio - {name} {value}` with your group to /etc/security/limits.conf, and log in again")
    };
    let priority = match facts.rtprio {
        _ if facts.is_root => fine("realtime", "not limited for root"),
        Some(limit) if limit < PRIORITY => {
            warning("realtime", format!("priorities up to {limit}"), advice("rtprio", &PRIORITY.to_string()))
        }
        Some(limit) => fine("realtime", format!("priorities up to {limit}")),
        None => fine("realtime", "not limited"),
    };
    let memory = match facts.memlock {
        _ if facts.is_root => fine("locked memory", "not limited for root"),
        Some(limit) => {
            warning("locked memory", format!("up to {:.1} MB", limit as f64 / 1e6), advice("memlock", "unlimited"))
        }
        None => fine("locked memory", "not limited"),
    };
    [priority, memory]
}

fn of_disk(facts: &Facts) -> Finding {
    let folder = facts.folder.display();
    let DiskSpeed { mb_per_s, longest_s, free_bytes } = match &facts.disk {
        Ok(speed) => speed,
        Err(why) => {
            return problem("disk", format!("{folder}: {why}"), "give a folder that you may write, by --record");
        }
    };
    let free_gb = *free_bytes as f64 / 1e9;
    let found =
        format!("{folder}: {mb_per_s:.0} MB/s with syncs, {:.0} ms at most; {free_gb:.1} GB free", longest_s * 1e3);
    if *mb_per_s < FRAMES_MB_PER_S {
        return problem("disk", found, "record on a faster disk: this one loses frames");
    }
    if *longest_s > LONGEST_S {
        return warning("disk", found, "record on a faster disk: a power cut may take more than the last second");
    }
    if *free_bytes < FREE_BYTES {
        return warning("disk", found, "free some space: a recording ends before the disk is full");
    }
    fine("disk", found)
}

#[cfg(test)]
mod tests {
    use drivers::Listing;

    use super::super::Verdict;
    use super::*;

    fn good() -> Facts {
        Facts {
            devices: vec![Listing { id: "usb:1-2".into(), description: "LIBERTY".into(), unavailable: None }],
            rules: Rules::Installed,
            is_root: false,
            groups: vec![Group { name: "dialout", member: Some(true) }],
            sets: vec![Simd::Avx2, Simd::Portable],
            cores: 4,
            rtprio: Some(PRIORITY),
            memlock: None,
            folder: "rec".into(),
            disk: Ok(DiskSpeed { mb_per_s: 100.0, longest_s: 0.1, free_bytes: 100 << 30 }),
            ports: vec![(9110, None)],
            browser: Some("firefox"),
        }
    }

    /// Asserts the verdict on an item, and that advice comes with everything but ok.
    fn has(facts: &Facts, item: &str, verdict: Verdict) {
        let finding = judge(facts).into_iter().find(|finding| finding.item == item).unwrap();
        assert_eq!((finding.verdict, finding.advice.is_some()), (verdict, verdict != Verdict::Ok), "{finding:?}");
    }

    #[test]
    fn good_machine_has_no_advice() {
        let findings = judge(&good());
        assert!(
            findings.iter().all(|finding| finding.verdict == Verdict::Ok && finding.advice.is_none()),
            "{findings:?}"
        );
        let items: Vec<&str> = findings.iter().map(|finding| finding.item).collect();
        assert_eq!(
            items,
            ["device", "udev rules", "group", "processor", "realtime", "locked memory", "disk", "port", "browser"]
        );
    }

    #[test]
    fn devices_and_permissions_are_judged() {
        let denied = Listing { unavailable: Some(DENIED.into()), ..good().devices.remove(0) };
        has(&Facts { devices: vec![denied], ..good() }, "device", Verdict::Problem);
        let busy = Listing { unavailable: Some("busy".into()), ..good().devices.remove(0) };
        has(&Facts { devices: vec![busy.clone()], ..good() }, "device", Verdict::Problem);
        has(&Facts { devices: vec![Listing { id: "usb".into(), ..busy }], ..good() }, "device", Verdict::Warning);
        has(&Facts { devices: Vec::new(), ..good() }, "device", Verdict::Warning);
        has(&Facts { rules: Rules::Missing, ..good() }, "udev rules", Verdict::Warning);
        has(&Facts { rules: Rules::Other, ..good() }, "udev rules", Verdict::Warning);
        let groups = vec![Group { name: "dialout", member: Some(false) }];
        has(&Facts { groups: groups.clone(), ..good() }, "group", Verdict::Warning);
        has(&Facts { groups, is_root: true, ..good() }, "group", Verdict::Ok);
        has(&Facts { groups: vec![Group { name: "video", member: None }], ..good() }, "group", Verdict::Warning);
    }

    #[test]
    fn processor_and_limits_are_judged() {
        has(&Facts { sets: vec![Simd::Portable], ..good() }, "processor", Verdict::Warning);
        has(&Facts { cores: 1, ..good() }, "processor", Verdict::Warning);
        has(&Facts { rtprio: Some(PRIORITY - 1), ..good() }, "realtime", Verdict::Warning);
        has(&Facts { rtprio: Some(0), is_root: true, ..good() }, "realtime", Verdict::Ok);
        has(&Facts { memlock: Some(8 << 20), ..good() }, "locked memory", Verdict::Warning);
    }

    #[test]
    fn disk_port_and_browser_are_judged() {
        let disk = good().disk.unwrap();
        has(&Facts { disk: Err("read-only".into()), ..good() }, "disk", Verdict::Problem);
        has(&Facts { disk: Ok(DiskSpeed { mb_per_s: 5.0, ..disk }), ..good() }, "disk", Verdict::Problem);
        has(&Facts { disk: Ok(DiskSpeed { longest_s: 1.5, ..disk }), ..good() }, "disk", Verdict::Warning);
        has(&Facts { disk: Ok(DiskSpeed { free_bytes: 1 << 30, ..disk }), ..good() }, "disk", Verdict::Warning);
        has(&Facts { ports: vec![(9110, Some("in use".into()))], ..good() }, "port", Verdict::Warning);
        has(&Facts { browser: None, ..good() }, "browser", Verdict::Warning);
    }
}
