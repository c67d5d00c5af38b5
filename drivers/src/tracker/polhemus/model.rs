//! Models of trackers, their connections, and the settings that open one.

use super::settings::Settings;

/// A tracker model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Model {
    /// ISOTRAK, ISOTRAK II and 3SPACE.
    Isotrak,
    /// FASTRAK, and 3SPACE FASTRAK.
    Fastrak,
    /// LIBERTY, and Latus.
    Liberty,
    /// PATRIOT.
    Patriot,
    /// VIPER.
    Viper,
}

impl Model {
    /// All models that the driver can open.
    pub const ALL: [Self; 5] = [Self::Isotrak, Self::Fastrak, Self::Liberty, Self::Patriot, Self::Viper];

    /// Returns the name in settings.
    pub fn name(self) -> &'static str {
        match self {
            Self::Isotrak => "isotrak",
            Self::Fastrak => "fastrak",
            Self::Liberty => "liberty",
            Self::Patriot => "patriot",
            Self::Viper => "viper",
        }
    }

    /// Returns the USB product numbers of units that wait for their firmware.
    pub(super) fn loaders(self) -> &'static [u16] {
        match self {
            Self::Isotrak | Self::Viper => &[],
            Self::Fastrak => &[0x0001],
            Self::Liberty => &[0xff11, 0xff21],
            Self::Patriot => &[0xef11, 0xef21],
        }
    }

    /// Returns the USB product numbers of running units.
    pub(super) fn products(self) -> &'static [u16] {
        match self {
            // Serial only.
            Self::Isotrak => &[],
            Self::Fastrak => &[0x0002, 0x0003],
            Self::Liberty => &[0xff12, 0xff20],
            Self::Patriot => &[0xef12, 0xef20],
            Self::Viper => &[0xbf01],
        }
    }
}

/// Connection to a tracker.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Port {
    /// A serial line. Without a rate, the driver tries all rates of such units.
    Serial {
        /// Device file.
        path: std::path::PathBuf,
        /// Bits per second.
        baud: Option<u32>,
    },
    /// USB; `None` if only one tracker is connected.
    Usb(Option<String>),
}

/// Settings for opening a tracker.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackerSettings {
    /// Model.
    pub model: Model,
    /// Connection.
    pub port: Port,
    /// Set-up of the unit.
    pub settings: Settings,
    /// Whether received bytes are also delivered as readings.
    pub keeps_raw: bool,
}
