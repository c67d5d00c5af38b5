//! Polhemus electromagnetic trackers.
//!
//! One file or folder a wire format, without transport and without clock:
//!
//! - [`fastrak`]: FASTRAK, and the text of ISOTRAK and ISOTRAK II.

pub mod fastrak;
mod settings;

pub use settings::Settings;
