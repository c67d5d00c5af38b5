//! Replays: of sessions, as they ran or with other settings, and of sweeps with a picture that
//! follows.

pub(crate) mod follow;
pub(crate) mod following;
pub(crate) mod planes;
pub(crate) mod reel;
pub(crate) mod series;
pub(crate) mod session;
pub(crate) mod session_movie;
pub(crate) mod showing;
