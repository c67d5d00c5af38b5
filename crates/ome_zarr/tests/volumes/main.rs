//! Volumes written and read: bits, pyramid, interruptions, damage, other programs' files.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod bits;
mod damage;
mod foreign;
mod interruptions;
mod kills;
mod order;
mod pyramid;
mod refusals;
mod regions;
mod scene;
mod views;
