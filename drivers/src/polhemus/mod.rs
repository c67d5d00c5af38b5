//! Polhemus electromagnetic trackers.
//!
//! One file or folder a wire format, without transport and without clock:
//!
//! - [`fastrak`]: FASTRAK, and the text of ISOTRAK and ISOTRAK II.
//! - [`isotrak`]: the binary records of 3SPACE, ISOTRAK and ISOTRAK II.
//! - [`liberty`]: LIBERTY, PATRIOT and Latus, over serial and USB alike.
//! - [`viper`]: VIPER, over USB and RS-422 alike.
//! - [`ladder`]: what is common to setting any of them up, and [`Line`], what they are connected by.

mod counter;
mod driver;
pub mod fastrak;
pub mod isotrak;
pub mod ladder;
pub mod liberty;
mod settings;
pub mod viper;

pub use driver::{Model, Port, TrackerDriver, TrackerSettings, VENDOR};
pub use ladder::Line;
pub use settings::Settings;

/// Whether a tracker can have measured this: finite, near, and an orientation. For records that their decoder lets pass as the unit reports an error with them.
fn is_pose(position_cm: &[f64; 3], quaternion_wxyz: &[f64; 4]) -> bool {
    let square: f64 = quaternion_wxyz.iter().map(|x| x * x).sum();
    position_cm.iter().all(|x| x.abs() < 500.0) && (0.98 * 0.98..=1.02 * 1.02).contains(&square)
}
