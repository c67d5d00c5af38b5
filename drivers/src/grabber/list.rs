//! Lists the video devices, and why some cannot be opened.

use std::path::{Path, PathBuf};
use std::{fs, io};

use super::v4l2::choose::Offer;
use super::v4l2::setup;
use super::v4l2::system_calls::{Identity, Node, number};
use crate::Listing;

/// Lists every node that captures video, by number. Other nodes (metadata of UVC frames, outputs)
/// are omitted.
pub fn list() -> Vec<Listing> {
    nodes().iter().filter_map(|path| listing(path)).collect()
}

/// Returns `/dev/video0`, `/dev/video1`, …
fn nodes() -> Vec<PathBuf> {
    let mut numbered: Vec<(u32, PathBuf)> = fs::read_dir("/dev")
        .into_iter()
        .flatten()
        .flatten()
        .filter_map(|entry| {
            let number = entry.file_name().to_str()?.strip_prefix("video")?.parse().ok()?;
            Some((number, entry.path()))
        })
        .collect();
    numbered.sort();
    numbered.into_iter().map(|(_, path)| path).collect()
}

fn listing(path: &Path) -> Option<Listing> {
    let id = path.display().to_string();
    let node = match Node::open(path) {
        Ok(node) => node,
        Err(error) => {
            let name = kernel_name(path).unwrap_or_else(|| "video device".into());
            return Some(Listing { id, description: name, unavailable: Some(why_not_opened(&error)) });
        }
    };
    let identity = match node.identity() {
        Ok(identity) => identity,
        Err(error) => {
            return Some(Listing { id, description: "video device".into(), unavailable: Some(error.to_string()) });
        }
    };
    if identity.can & (number::CAN_CAPTURE | number::CAN_CAPTURE_PLANES) == 0 {
        return None;
    }
    let offers = setup::offers(&node);
    let unavailable = unfit(&identity).or_else(|| {
        offers.is_empty().then(|| {
            let names: Vec<String> = node.formats().into_iter().map(super::pixels::name_of).collect();
            format!("none of its formats can be converted ({})", names.join(", "))
        })
    });
    let Identity { driver, card, bus, .. } = identity;
    let inputs: Vec<String> = node.inputs().into_iter().map(|input| input.name).collect();
    let of_inputs = if inputs.len() > 1 { format!("; inputs {}", inputs.join(", ")) } else { String::new() };
    let description = format!("{card} ({driver}, {bus}){}{of_inputs}", best(&offers));
    Some(Listing { id, description, unavailable })
}

/// Returns why an opened node cannot be used, if so.
pub(crate) fn unfit(identity: &Identity) -> Option<String> {
    if identity.can & number::CAN_CAPTURE == 0 {
        return Some(if identity.can & number::CAN_CAPTURE_PLANES == 0 {
            "it captures no video".into()
        } else {
            "it delivers each plane in a buffer of its own, which is not supported".into()
        });
    }
    (identity.can & number::CAN_STREAM == 0).then(|| "it cannot stream into shared memory".into())
}

/// Returns the advice for a node that cannot be opened.
pub(crate) fn why_not_opened(error: &io::Error) -> String {
    match error.kind() {
        io::ErrorKind::NotFound => "is not there; plug it in".into(),
        io::ErrorKind::PermissionDenied => {
            "permission denied; add the user to the group video (sudo usermod -aG video $USER) and log in again".into()
        }
        io::ErrorKind::ResourceBusy => "is in use by another program; close that program".into(),
        _ if is_gone(error) => "is not there any more; plug it in".into(),
        _ => format!("cannot be opened: {error}"),
    }
}

/// Returns whether the kernel reports a missing device.
pub(crate) fn is_gone(error: &io::Error) -> bool {
    let gone = [rustix::io::Errno::NODEV, rustix::io::Errno::NXIO];
    error.raw_os_error().is_some_and(|code| gone.iter().any(|errno| errno.raw_os_error() == code))
}

/// Returns the kernel's name of a device whose node cannot be opened.
fn kernel_name(path: &Path) -> Option<String> {
    let class = Path::new("/sys/class/video4linux").join(path.file_name()?).join("name");
    Some(fs::read_to_string(class).ok()?.trim().to_owned())
}

fn best(offers: &[Offer]) -> String {
    let largest = offers.iter().max_by_key(|offer| u64::from(offer.size[0]) * u64::from(offer.size[1]));
    largest.map_or_else(String::new, |Offer { size: [width, height], .. }| {
        let mut names: Vec<String> = offers.iter().map(|offer| offer.format.to_string()).collect();
        names.dedup();
        format!(": up to {width}×{height}, {}", names.join(", "))
    })
}

/// Returns the node for the settings: a path unchanged, otherwise the first device of that name
/// or bus location.
pub(crate) fn find(device: &str) -> Option<PathBuf> {
    if device.starts_with('/') {
        return Some(device.into());
    }
    nodes().into_iter().find(|path| {
        Node::open(path).and_then(|node| node.identity()).is_ok_and(|identity| {
            identity.can & number::CAN_CAPTURE != 0 && (identity.card == device || identity.bus == device)
        })
    })
}
