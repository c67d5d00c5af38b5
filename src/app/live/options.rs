//! Settings of a session that its configuration does not hold, and outlets to the operator.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;

use super::viewers::Display;
use crate::app::igtl::Sharing;
use crate::app::reporter::Reporter;

/// Settings of a session that its configuration does not hold.
#[derive(Debug, Clone)]
pub(crate) struct SessionOptions {
    /// Folder of the recording, instead of the configuration's.
    pub(crate) record: Option<PathBuf>,
    /// End of the session, s; `None` for none.
    pub(crate) duration: Option<f64>,
    /// Recorded session whose slices are inserted first.
    pub(crate) resume: Option<PathBuf>,
    /// Address of the console, instead of the configuration's.
    pub(crate) console: Option<SocketAddr>,
    /// Whether the console's page is opened in a browser.
    pub(crate) opens_browser: bool,
    /// Folder for the files of pages, instead of the recording's.
    pub(crate) keep: Option<PathBuf>,
    /// Whether a calibration that is an example, or of another image size, is accepted.
    pub(crate) accept_example: bool,
    /// Whether sentences about the session's course are left out.
    pub(crate) quiet: bool,
    /// Kind of the session, for pages.
    pub(crate) kind: &'static str,
    /// The OpenIGTLink server.
    pub(crate) sharing: Sharing,
}

/// Outlets to the operator.
pub(crate) struct Operator<'a> {
    pub(crate) reporter: &'a dyn Reporter,
    /// A picture of the growing volume besides those on pages.
    pub(crate) display: Option<Arc<dyn Display>>,
    /// Whether a picture is wanted at the end.
    pub(crate) keeps_picture: bool,
}
