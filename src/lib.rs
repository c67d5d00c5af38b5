//! sonoweave turns an ordinary 2D ultrasound scanner into a 3D one: tracked slices are woven into a regular volume as they arrive.
//!
//! The way of a slice, module by module:
//!
//! - `sharing`: loops that run alone or shared among threads, for all stages.
//! - [`simd`]: the sixteen lanes that the hot loops run on.
//! - [`config`]: the file as written → validated settings.
//! - [`devices`]: a bedside's devices, opened; virtual ones as twins.
//! - [`ingest`]: readings → samples: the one place where units, frames and clocks change.
//! - [`sync`]: pictures and their transforms → posed slices.
//! - [`slice`](mod@slice): a picture, when it was taken and where it lies: what the stages hand on.
//! - [`mask`]: which pixels of the picture are data.
//! - [`path`]: which of its two ways slices go.
//! - [`reconstruct`]: slices into the volume.
//! - [`volume`]: the lattice, and the sparse bricks that hold the volume.
//! - [`render`]: the volume to its picture.
//! - [`annotation`]: what is drawn over finished pictures.
//! - [`export`]: volumes and pictures to files.
//! - [`convert`]: recordings and volumes from one file to another.
//! - [`pipeline`]: the stages in flow order.
//! - [`ledger`], [`refusal`]: what became of every frame, and the reasons.
//! - [`coach`]: what tells whoever scans how to scan better.
//! - [`statistics`]: what a run did, in numbers.
//! - [`measure`]: lengths, areas and volumes with their errors, and the slices that a place was made of.
//! - [`desk`]: what whoever looks at a running session may tell it to do.
//! - [`console`], [`service`]: the same while it runs, over HTTP, and to a service manager.
//! - [`igtl`]: slices, sensors and the volume while it runs, over OpenIGTLink.
//! - [`trace`]: where the time of each frame went.
//! - [`cli`]: the commands.
//! - [`phantom`]: scans of scenes whose truth is known, for demonstration, tests and benches.

pub mod annotation;
pub mod cli;
pub mod coach;
pub mod config;
pub mod console;
pub mod convert;
pub mod desk;
pub mod devices;
pub mod export;
pub mod igtl;
pub mod ingest;
pub mod ledger;
pub mod mask;
pub mod measure;
pub mod path;
pub mod phantom;
pub mod pipeline;
pub mod reconstruct;
pub mod refusal;
pub mod render;
pub mod service;
pub(crate) mod sharing;
pub mod simd;
pub mod slice;
pub mod statistics;
pub mod sync;
pub mod trace;
pub mod volume;
