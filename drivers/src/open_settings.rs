//! The settings that open a device.

use std::path::PathBuf;

use crate::{arm, grabber, openigtlink, replay, tracker};

/// Settings of the device to open. One variant per kind.
#[derive(Debug, Clone)]
pub enum OpenSettings {
    /// An encoder arm.
    Arm(arm::ArmSettings),
    /// An electromagnetic tracker.
    Tracker(tracker::polhemus::TrackerSettings),
    /// A sequence file.
    Sequence(replay::SequenceSettings),
    /// A recorded session, or one device in it.
    Session(replay::SessionSettings),
    /// A frame grabber.
    Grabber(grabber::GrabberSettings),
    /// An OpenIGTLink server.
    Remote(openigtlink::RemoteSettings),
}

impl OpenSettings {
    /// Settings for a whole sequence file with default limits.
    pub fn sequence(path: impl Into<PathBuf>) -> Self {
        Self::Sequence(replay::SequenceSettings::new(path))
    }
}
