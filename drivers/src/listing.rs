//! Devices that drivers find.

/// Identifiers of buses that could not be searched.
pub(crate) const SERIAL: &str = "serial";
pub(crate) const USB: &str = "usb";

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

impl Listing {
    /// Whether this stands for a bus that could not be searched, as on a machine without USB.
    pub fn is_bus(&self) -> bool {
        [SERIAL, USB].contains(&self.id.as_str())
    }
}
