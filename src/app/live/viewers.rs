//! All viewers of the growing volume: a display, a picture file, and pages.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use config::bedside::Picture;
use console::FrameBroadcaster;
use console::style::ConfiguredStyle;
use pipeline::session::{Drawn, First, ViewClient};
use render::camera::View;
use render::{Mode, RenderSettings, Renderer};

/// A picture of the growing volume besides those on pages.
pub(crate) trait Display: Send + Sync {
    /// Changes the view settings.
    fn set_picture(&self, picture: &Picture);

    /// Shows a new picture.
    fn shown(&self, drawn: &Drawn);
}

/// Changeable view settings, and the viewers that use them.
pub(crate) struct Viewers {
    picture: Mutex<Picture>,
    display: Option<Arc<dyn Display>>,
    /// Whether a picture file is requested at the end.
    lasting: bool,
    broadcaster: Option<Arc<FrameBroadcaster>>,
}

impl Viewers {
    /// Returns `None` without any viewer.
    pub(crate) fn of(
        picture: &Picture,
        display: Option<&Arc<dyn Display>>,
        lasting: bool,
        broadcaster: Option<&Arc<FrameBroadcaster>>,
    ) -> Option<Arc<Self>> {
        (display.is_some() || lasting || broadcaster.is_some()).then(|| {
            let (display, broadcaster) = (display.cloned(), broadcaster.cloned());
            let viewers = Self { picture: Mutex::new(picture.clone()), display, lasting, broadcaster };
            viewers.configure(picture);
            Arc::new(viewers)
        })
    }

    /// Sends the configured view settings to pages.
    fn configure(&self, picture: &Picture) {
        // If they are invalid, the render thread reports why.
        if let (Some(broadcaster), Ok(settings)) = (&self.broadcaster, picture.settings(None)) {
            let (name, range) = (picture.view.transfer_name().to_owned(), picture.window);
            let uses_opacities = matches!(settings.mode, Mode::Shaded(_) | Mode::Opacity(_));
            broadcaster.configure(ConfiguredStyle { transfer: settings.transfer, name, range, uses_opacities });
        }
    }

    /// Changes the view settings, from the next picture on.
    pub(crate) fn set_picture(&self, picture: &Picture) {
        if let Some(display) = &self.display {
            display.set_picture(picture);
        }
        picture.clone_into(&mut self.picture());
        self.configure(picture);
    }

    fn picture(&self) -> MutexGuard<'_, Picture> {
        self.picture.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl ViewClient for Viewers {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        ViewClient::settings(&*self.picture(), first)
    }

    fn most_hz(&self) -> f64 {
        self.picture().most_hz
    }

    fn style_revision(&self) -> u64 {
        self.broadcaster.as_ref().map_or(0, |broadcaster| broadcaster.style_number())
    }

    fn restyle(&self, settings: &mut RenderSettings) {
        if let Some(broadcaster) = &self.broadcaster {
            broadcaster.apply_style(settings);
        }
    }

    fn view(&self, home: View) -> View {
        self.broadcaster.as_ref().map_or(home, |broadcaster| broadcaster.view(home))
    }

    fn answer(&self, shown: Option<&Renderer>) {
        if let Some(broadcaster) = &self.broadcaster {
            broadcaster.answer(shown);
        }
    }

    fn is_watched(&self) -> bool {
        // Without pages, a requested picture file is rendered all the time, so that it is ready
        // at the end.
        let Some(broadcaster) = &self.broadcaster else { return true };
        self.display.is_some() || broadcaster.is_watched()
    }

    fn keeps_last(&self) -> bool {
        self.display.is_some() || self.lasting
    }

    fn turn(&self) -> Duration {
        self.broadcaster.as_ref().map_or(TURN, |broadcaster| broadcaster.turn())
    }

    fn shown(&self, drawn: &Drawn) {
        if let Some(display) = &self.display {
            display.shown(drawn);
        }
        if let Some(broadcaster) = &self.broadcaster {
            let background = self.picture().background;
            broadcaster.drawn(drawn, background);
        }
    }
}

/// Polling interval for view changes without a page.
const TURN: Duration = Duration::from_millis(100);
