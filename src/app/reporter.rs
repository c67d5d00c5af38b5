//! Outlets for sentences and progress while the application works; the command line prints them.

/// Outlet of a session.
pub(crate) trait Reporter {
    /// Says a sentence.
    fn say(&self, sentence: &str);

    /// Shows the session's status; a newer one replaces it, and not every one is shown.
    fn status(&self, line: &dyn Fn() -> String);
}

/// Begins to show the progress of an activity with so many steps. The returned function takes the
/// number of finished steps; the progress disappears when it is dropped.
pub(crate) type Steps<'a> = &'a dyn Fn(&'static str, u64) -> Box<dyn Fn(u64)>;
