//! Faults between a device and the host, on request.

use std::f64::consts::TAU;
use std::sync::Arc;

use sonoweave_core::clock::MS;

use super::{Motion, Placed};

/// Faults of a virtual device. None by default; the same seed gives the same faults.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Faults {
    /// Seed of the random choices.
    pub seed: u64,
    /// Share of bytes that are lost on the wire.
    pub drop: f64,
    /// Share of bytes that arrive corrupted.
    pub noise: f64,
    /// Share of records that the device does not send.
    pub dropout: f64,
    /// Rate error of the device's clock, parts per million; positive is fast.
    pub drift_ppm: f64,
    /// Delay of everything that arrives, ns.
    pub latency_ns: i64,
    /// Maximum additional random delay of each piece, ns. The order is kept.
    pub jitter_ns: i64,
    /// Bytes arrive in packets that end at multiples of this time, ns, as from an adapter that
    /// collects them; 0 for no packets.
    pub packet_ns: i64,
}

impl Default for Faults {
    fn default() -> Self {
        Self { seed: 1, drop: 0.0, noise: 0.0, dropout: 0.0, drift_ppm: 0.0, latency_ns: 0, jitter_ns: 0, packet_ns: 0 }
    }
}

impl Faults {
    /// Returns the faults of an FTDI adapter with its default latency: packets every 16 ms.
    pub fn slow_adapter() -> Self {
        Self { packet_ns: 16 * MS, ..Self::default() }
    }
}

/// Statistics of what a virtual device sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Bytes put on the wire, including those that did not arrive.
    pub bytes: u64,
    /// Bytes lost on the wire.
    pub dropped: u64,
    /// Bytes that arrived corrupted.
    pub garbled: u64,
    /// Records that were measured but not sent.
    pub withheld: u64,
}

impl std::ops::Add for Tally {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            bytes: self.bytes + other.bytes,
            dropped: self.dropped + other.dropped,
            garbled: self.garbled + other.garbled,
            withheld: self.withheld + other.withheld,
        }
    }
}

/// Adds sensor noise to a motion: white and Gaussian, with these standard deviations along each
/// axis and about each axis. The same seed, station and time give the same noise.
pub fn trembling(motion: Motion, position_mm: f64, rotation_degrees: f64, seed: u64) -> Motion {
    Arc::new(move |station, at_ns| {
        let Placed { position_cm, quaternion_wxyz: [w, x, y, z] } = motion(station, at_ns);
        let of_this = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ (u64::from(station) << 56) ^ at_ns.cast_unsigned();
        let mut random = fastrand::Rng::with_seed(scattered(of_this));
        let mut normal = || {
            let radius = (-2.0 * (1.0 - random.f64()).ln()).sqrt();
            radius * (TAU * random.f64()).cos()
        };
        let position_cm = position_cm.map(|cm| cm + 0.1 * position_mm * normal());
        // Half of the small rotation about each axis of the sensor.
        let [a, b, c] = [(); 3].map(|()| 0.5 * rotation_degrees.to_radians() * normal());
        let turned = [
            w - x * a - y * b - z * c,
            x + w * a + y * c - z * b,
            y + w * b + z * a - x * c,
            z + w * c + x * b - y * a,
        ];
        let length = turned.iter().map(|q| q * q).sum::<f64>().sqrt();
        Placed { position_cm, quaternion_wxyz: turned.map(|q| q / length) }
    })
}

/// Scatters neighbouring seeds, which alone give similar numbers (the finaliser of Steele, Lea &
/// Flood's SplitMix64, 2014).
fn scattered(mut x: u64) -> u64 {
    x = (x ^ x >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ x >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
    x ^ x >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensor_noise_has_given_size_and_is_reproducible() {
        let still: Motion =
            Arc::new(|_, _| Placed { position_cm: [10.0, -5.0, 30.0], quaternion_wxyz: [0.5, -0.5, 0.5, -0.5] });
        let noisy = trembling(Arc::clone(&still), 0.3, 0.2, 7);
        let (mut square_mm, mut square_deg, mut neighbours) = (0.0, 0.0, 0.0);
        let mut before = 0.0;
        for n in 0..20_000_i64 {
            // Sample times of a unit at 120 Hz.
            let placed = noisy(1, n * 25_000_000 / 3);
            let off = placed.position_cm[0] * 10.0 - 100.0;
            square_mm += off * off;
            neighbours += off * before;
            before = off;
            let dot: f64 = placed.quaternion_wxyz.iter().zip([0.5, -0.5, 0.5, -0.5]).map(|(a, b)| a * b).sum();
            // The mean over three axes.
            square_deg += (2.0 * (1.0 - dot * dot).max(0.0).sqrt().asin()).to_degrees().powi(2) / 3.0;
            let length: f64 = placed.quaternion_wxyz.iter().map(|q| q * q).sum();
            assert!((length - 1.0).abs() < 1e-12);
        }
        // Standard error for 20000 samples: 0.5 %; of the product of neighbours 0.7 %.
        let [mm, degrees] = [square_mm, square_deg].map(|sum| (sum / 20_000.0_f64).sqrt());
        assert!((mm / 0.3 - 1.0).abs() < 0.02 && (degrees / 0.2 - 1.0).abs() < 0.02, "{mm} {degrees}");
        assert!((neighbours / square_mm).abs() < 0.03, "white: {}", neighbours / square_mm);
        assert_eq!(noisy(1, 5), noisy(1, 5));
        assert_ne!(noisy(1, 5), noisy(2, 5));
        assert_ne!(noisy(1, 5), trembling(Arc::clone(&still), 0.3, 0.2, 8)(1, 5));
        assert_eq!(trembling(Arc::clone(&still), 0.0, 0.0, 8)(1, 5), still(1, 5));
    }
}
