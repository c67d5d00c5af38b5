//! What may go wrong between a device and the host, on request.

use crate::clock::MS;

/// Faults of a twin. None by default; the same seed makes the same ones.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// Of the random choices.
    pub seed: u64,
    /// Share of bytes that are lost on the wire.
    pub drop: f64,
    /// Share of bytes that arrive as another.
    pub noise: f64,
    /// Share of records that the device does not send.
    pub dropout: f64,
    /// The device's clock runs so much faster, parts in a million.
    pub drift_ppm: f64,
    /// What arrives is held back for so long, ns.
    pub latency_ns: i64,
    /// And for up to this much longer, each time anew, ns. Order stays.
    pub jitter_ns: i64,
    /// Bytes arrive in packets that end at multiples of this time, ns, as from an adapter that collects them; 0 for at once.
    pub packet_ns: i64,
}

impl Default for Faults {
    fn default() -> Self {
        Self { seed: 1, drop: 0.0, noise: 0.0, dropout: 0.0, drift_ppm: 0.0, latency_ns: 0, jitter_ns: 0, packet_ns: 0 }
    }
}

impl Faults {
    /// An FTDI adapter that was not told to hurry: packets every 16 ms.
    pub fn slow_adapter() -> Self {
        Self { packet_ns: 16 * MS, ..Self::default() }
    }
}
