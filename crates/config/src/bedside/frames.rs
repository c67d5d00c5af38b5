//! Names of the frames of reference that a session's devices relate.

/// Frame of the tracker's transmitter, or of the arm's base.
pub const TRACKER_FRAME: &str = "Tracker";
/// Frame of the sensor on the transducer, or of the arm's last link.
pub const PROBE_FRAME: &str = "Probe";
/// Frame of the sensor on the patient.
pub const REFERENCE_FRAME: &str = "Reference";
/// Frame of the stylus.
pub const STYLUS_FRAME: &str = "Stylus";
