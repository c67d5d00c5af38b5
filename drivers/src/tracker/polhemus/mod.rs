//! Polhemus electromagnetic trackers.
//!
//! One file or folder per wire format, independent of transport and clock:
//!
//! - [`fastrak`]: FASTRAK, and the text of ISOTRAK and ISOTRAK II.
//! - [`isotrak`]: the binary records of 3SPACE, ISOTRAK and ISOTRAK II.
//! - [`liberty`]: LIBERTY, PATRIOT and Latus, over serial and USB alike.
//! - [`viper`]: VIPER, over USB and RS-422 alike.
//! - [`setup_sequence`]: the set-up sequence that they share, and [`Line`], their physical
//!   connection.

mod counter;
mod driver;
pub mod fastrak;
pub mod isotrak;
pub mod liberty;
mod model;
mod settings;
pub mod setup_sequence;
pub mod viper;

pub(crate) use driver::open_on;
pub use driver::{VENDOR, list, open};
pub use model::{Model, Port, TrackerSettings};
pub use settings::Settings;
pub use setup_sequence::Line;

/// Reason why a list of output items is invalid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum ListError {
    /// The model does not know the code.
    #[error("output item {code} is unknown; known are {known}")]
    Unknown {
        /// The code.
        code: u8,
        /// Codes of the model.
        known: &'static str,
    },
    /// The list has more entries than a unit accepts.
    #[error("{given} output items are more than the limit of {most}; request fewer")]
    TooMany {
        /// Entries of the list.
        given: usize,
        /// The limit.
        most: usize,
    },
    /// The records would be longer than a unit sends.
    #[error("records of {bytes} bytes are longer than the limit of {most}; request fewer output items")]
    TooLong {
        /// Bytes of a record.
        bytes: usize,
        /// The limit.
        most: usize,
    },
    /// Extended precision exists in text only.
    #[error("output item {0} is extended precision, which exists in text only; request {plain} in binary", plain = .0 - 50)]
    ExtendedBinary(u8),
    /// The 14-bit items are binary only.
    #[error("output item {0} packs numbers into 14 bits, which exists in binary only; request it in binary")]
    PackedText(u8),
}

/// Returns whether a pose is plausible: finite, near, and with a unit quaternion. For records
/// that the decoder accepts only because the unit reports an error with them.
fn is_pose(position_cm: &[f64; 3], quaternion_wxyz: &[f64; 4]) -> bool {
    let square: f64 = quaternion_wxyz.iter().map(|x| x * x).sum();
    position_cm.iter().all(|x| x.abs() < 500.0) && (0.98 * 0.98..=1.02 * 1.02).contains(&square)
}
