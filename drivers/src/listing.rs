//! Devices that drivers find.

/// A device found by [`list`](crate::list).
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listing {
    /// Identifier used in settings.
    pub id: String,
    /// Description for the user.
    pub description: String,
    /// Why the device cannot be opened; `None` if it can.
    pub unavailable: Option<String>,
}
