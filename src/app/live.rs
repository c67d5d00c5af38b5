//! Live sessions: devices to a volume, with a recording, pictures, pages and other programs.

mod app;
mod browser;
pub(crate) mod check;
mod crossings_check;
mod device;
pub(crate) mod ended;
mod foreign;
mod free_space;
pub(crate) mod home;
mod identity;
mod markers;
pub(crate) mod options;
pub(crate) mod outputs;
mod reload;
pub(crate) mod resume;
pub(crate) mod session;
pub(crate) mod stages;
pub(crate) mod status_publisher;
pub(crate) mod viewers;
