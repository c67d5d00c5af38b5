//! Virtual twins: devices that put given poses on a line, in the real wire format, with the real units' habits and failings.
//!
//! A twin is the [`crate::transport::Peer`] of a driver. In process, on a clock that is turned by hand, it tests the driver in no time ([`crate::transport::MemoryOpener`]);
//! on a pseudo-terminal it is a program that any other program may open as it would the real thing ([`Pty`]). What it measures is a [`Motion`]
//! or [`Joints`]: a closure of time, so that truth is known to whoever gave it. The [`grabber`] has no line: it delivers pictures in process.

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

use crate::reading::AXES;

pub use faults::{Faults, Tally, trembling};
pub use machine::Machine;
pub use pty::Pty;
pub use unit::{Model, Simulated, cosines, euler_deg};
pub use wire::Wire;

/// Where a sensor is, in the transmitter's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Position in cm.
    pub position_cm: [f64; 3],
    /// Unit quaternion w, x, y, z.
    pub quaternion_wxyz: [f64; 4],
}

/// Where the sensor of a station (from 1) is at a time (host ns).
pub type Motion = Arc<dyn Fn(u8, i64) -> Placed + Send + Sync>;

/// What the encoders of an arm's joints would show at a time (host ns), base first, had they been zeroed in its home position.
pub type Joints = Arc<dyn Fn(i64) -> [i64; AXES] + Send + Sync>;
