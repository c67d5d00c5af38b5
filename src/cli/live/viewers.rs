//! All who look at the volume while it grows: the terminal, a picture that is wanted in the end, and pages.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use super::terminal::Terminal;
use crate::config::bedside::Picture;
use crate::console::Screen;
use crate::console::dress::Ground;
use crate::pipeline::live::{Drawn, First, Looks};
use crate::render::camera::View;
use crate::render::{Mode, RenderSettings, Renderer};

/// Settings that may change, and those who look by them.
pub(in crate::cli) struct Viewers {
    picture: Mutex<Picture>,
    terminal: Option<Arc<Terminal>>,
    /// Whether a picture is wanted in the end.
    lasting: bool,
    screen: Option<Arc<Screen>>,
}

impl Viewers {
    /// `None` where nobody looks at all.
    pub(in crate::cli) fn of(
        picture: &Picture,
        terminal: Option<&Arc<Terminal>>,
        lasting: bool,
        screen: Option<&Arc<Screen>>,
    ) -> Option<Arc<Self>> {
        (terminal.is_some() || lasting || screen.is_some()).then(|| {
            let (terminal, screen) = (terminal.cloned(), screen.cloned());
            let viewers = Self { picture: Mutex::new(picture.clone()), terminal, lasting, screen };
            viewers.ground(picture);
            Arc::new(viewers)
        })
    }

    /// Pages learn what the configuration's look is.
    fn ground(&self, picture: &Picture) {
        // Where it makes no picture, its thread says why.
        if let (Some(screen), Ok(settings)) = (&self.screen, picture.settings(None)) {
            let (name, range) = (picture.look.transfer_name().to_owned(), picture.window);
            let heeded = matches!(settings.mode, Mode::Shaded(_) | Mode::Opacity(_));
            screen.ground(Ground { transfer: settings.transfer, name, range, heeded });
        }
    }

    /// Another way to look, from the next picture on.
    pub(in crate::cli) fn look(&self, picture: &Picture) {
        if let Some(terminal) = &self.terminal {
            terminal.look(picture);
        }
        picture.clone_into(&mut self.picture());
        self.ground(picture);
    }

    fn picture(&self) -> MutexGuard<'_, Picture> {
        self.picture.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Looks for Viewers {
    fn settings(&self, first: &First) -> Result<RenderSettings, Box<dyn std::error::Error + Send + Sync>> {
        Looks::settings(&*self.picture(), first)
    }

    fn most_hz(&self) -> f64 {
        self.picture().most_hz
    }

    fn dressing(&self) -> u64 {
        self.screen.as_ref().map_or(0, |screen| screen.dressing())
    }

    fn dress(&self, settings: &mut RenderSettings) {
        if let Some(screen) = &self.screen {
            screen.put_on(settings);
        }
    }

    fn view(&self, home: View) -> View {
        self.screen.as_ref().map_or(home, |screen| screen.view(home))
    }

    fn answer(&self, shown: Option<&Renderer>) {
        if let Some(screen) = &self.screen {
            screen.answer(shown);
        }
    }

    fn is_watched(&self) -> bool {
        // Without pages a picture that is wanted in the end follows the volume all the time, so that it is there at once then.
        let Some(screen) = &self.screen else { return true };
        self.terminal.is_some() || screen.is_watched()
    }

    fn keeps_last(&self) -> bool {
        self.terminal.is_some() || self.lasting
    }

    fn turn(&self) -> Duration {
        self.screen.as_ref().map_or(TURN, |screen| screen.turn())
    }

    fn shown(&self, drawn: &Drawn) {
        if let Some(terminal) = &self.terminal {
            terminal.shown(drawn);
        }
        if let Some(screen) = &self.screen {
            let background = self.picture().background;
            screen.drawn(drawn, background);
        }
    }
}

/// For how long nobody needs to be asked where no page looks.
const TURN: Duration = Duration::from_millis(100);
