//! Encoder arms of three joints.
//!
//! One file or folder a wire format, without transport and without clock. Counts leave as they are; kinematics live in calibration:
//!
//! - [`ea1`]: EA1, a protocol for arms built around a microcontroller; `docs/ea1.md` describes it for those who build one.
//! - [`qsb`]: US Digital QSB, an encoder each.
//! - [`microscribe`]: MicroScribe-3D and the Immersion boxes.

pub mod ea1;
pub mod microscribe;
pub mod qsb;
