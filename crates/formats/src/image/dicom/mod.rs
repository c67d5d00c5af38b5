//! DICOM: ultrasound multi-frame images as sequences, enhanced ultrasound volumes as volumes.
//!
//! - [`private`]: our private elements, which the writer shares: poses and times of frames, and a
//!   volume's place, to the bit.
//! - `walk`: finds the pixel data, and checks all lengths before anything is allocated.
//! - `attributes`: the values before the pixel data.
//! - `pixels`: classes, shape and type of the pixels.
//! - `frames`: per-frame data of an ultrasound multi-frame image.
//! - `planes`: place of an enhanced ultrasound volume.
//! - `read`: opens a file.
//!
//! This crate reads DICOM, and not `export`, which writes it: devices and volumes lie above
//! `export`, and read all image files here.

mod attributes;
mod frames;
mod pixels;
mod planes;
pub mod private;
pub(crate) mod read;
mod walk;

#[cfg(test)]
mod tests;
