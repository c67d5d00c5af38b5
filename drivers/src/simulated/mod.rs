//! Virtual devices: they put given poses on a line, in the real wire format, with the habits and
//! faults of the real units.
//!
//! A virtual device is the [`crate::transport::Peer`] of a driver. In process, on a manual clock,
//! it tests the driver without delay ([`crate::transport::MemoryOpener`]). On a pseudo-terminal
//! it is a program that any other program may open like the real device ([`Pty`]). Its
//! measurements are a [`Motion`] or [`Joints`]: a closure of time, so the caller knows the ground
//! truth. The [`grabber`] has no line: it delivers frames in process.

pub mod ea1;
pub mod fastrak;
mod faults;
pub mod grabber;
pub mod isotrak;
pub mod liberty;
mod machine;
pub mod microscribe;
mod pty;
pub mod qsb;
mod unit;
pub mod viper;
mod wire;

use std::sync::Arc;

use sonoweave_core::reading::AXES;

pub use faults::{Faults, Tally, trembling};
pub use machine::Machine;
pub use pty::Pty;
pub use unit::{Model, Simulated, cosines, euler_deg};
pub use wire::Wire;

/// Pose of a sensor, in the transmitter's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Position in cm.
    pub position_cm: [f64; 3],
    /// Unit quaternion w, x, y, z.
    pub quaternion_wxyz: [f64; 4],
}

/// Pose of the sensor of a station (from 1) at a time (host ns).
pub type Motion = Arc<dyn Fn(u8, i64) -> Placed + Send + Sync>;

/// Encoder counts of an arm's joints at a time (host ns), base first, as if zeroed in its home
/// position.
pub type Joints = Arc<dyn Fn(i64) -> [i64; AXES] + Send + Sync>;
