//! Names of the frames of reference that a session's devices relate.

/// Frame of the tracker's transmitter, or of the arm's base.
pub(super) const TRACKER_FRAME: &str = "Tracker";
/// Frame of the sensor on the transducer, or of the arm's last link.
pub(super) const PROBE_FRAME: &str = "Probe";
/// Frame of the sensor on the patient.
pub(super) const REFERENCE_FRAME: &str = "Reference";
/// Frame of the stylus.
pub(super) const STYLUS_FRAME: &str = "Stylus";
