//! The program as its users run it: the built binary, its files, messages and exit codes.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod again;
mod anonymize;
mod arm;
mod arm_sessions;
mod batch;
mod batch_card;
mod batch_kills;
mod calibrate;
mod chain;
mod commands;
mod compare;
mod containers;
mod contours;
mod correct;
mod crops;
mod crossings;
mod daemon;
mod demo;
mod devices;
mod dicom;
mod dicom_in;
mod doctor;
mod drawing;
mod failures;
mod filling;
mod first_moment;
mod gap_weights;
mod guided;
mod igtl;
mod init;
mod inspect;
mod interface;
mod latency;
mod leave_one_out;
mod live;
mod modes;
mod movies;
mod ome_zarr;
mod ome_zarr_conversion;
mod parts;
mod paths;
mod phantom;
mod place;
mod planes;
mod probe;
mod probe_flags;
mod refusals;
mod region;
mod region_faults;
mod regions;
mod render;
mod replay;
mod results;
mod sequence;
mod sessions;
mod settings;
mod several;
mod shadow_weights;
mod shell;
mod smoothing;
mod standard_errors;
mod surface;
mod targets;
mod tracker;
mod tutorials;

/// Returns the program.
fn program() -> std::process::Command {
    std::process::Command::new(env!("CARGO_BIN_EXE_sonoweave"))
}
