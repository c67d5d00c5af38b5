//! All pages that draw the volume themselves.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use volume::brick::BrickIndex;

use super::page_bricks::{PageBricks, Read};

/// Most bricks of a volume that pages draw: 512 voxels a side.
const MOST_BRICKS: usize = 1 << 18;

/// The pages that draw the volume, and the bricks that it has.
#[derive(Debug, Default)]
pub(crate) struct BrickPages {
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    known: BTreeSet<BrickIndex>,
    pages: Vec<Arc<PageBricks>>,
}

impl BrickPages {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds a page that has no bricks.
    pub(crate) fn enter(&self) -> Arc<PageBricks> {
        let State { known, pages } = &mut *self.state();
        let page = PageBricks::new(known.iter().copied(), Instant::now());
        pages.push(Arc::clone(&page));
        page
    }

    /// Removes a page.
    pub(crate) fn leave(&self, page: &Arc<PageBricks>) {
        self.state().pages.retain(|other| !Arc::ptr_eq(other, page));
    }

    /// Returns whether there is any such page.
    pub(crate) fn is_watched(&self) -> bool {
        !self.state().pages.is_empty()
    }

    /// Returns whether the volume has more bricks than pages draw.
    pub(crate) fn is_too_large(&self) -> bool {
        self.state().known.len() > MOST_BRICKS
    }

    /// Notes changed bricks; or, if any may have changed, all of the volume's.
    pub(crate) fn changed(&self, bricks: &[BrickIndex], all: bool) {
        let State { known, pages } = &mut *self.state();
        if all {
            known.clear();
        }
        known.extend(bricks);
        let now = Instant::now();
        pages.iter().for_each(|page| page.note(bricks.iter().copied(), all, now));
    }

    /// Reads and encodes bricks for each page with room.
    pub(crate) fn serve(&self, read: Read, is_in_view: impl Fn(BrickIndex) -> bool, now: Instant) {
        let pages = {
            let state = self.state();
            if state.known.len() > MOST_BRICKS { Vec::new() } else { state.pages.clone() }
        };
        pages.iter().for_each(|page| page.serve(&mut *read, &is_in_view, now));
    }
}
