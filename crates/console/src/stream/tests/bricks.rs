//! Pages that draw the volume themselves.

use pipeline::session::{BrickCopy, BrickViewer};
use volume::brick::VOXELS;

use super::*;
use crate::bricks::KIND;

fn draws(session: &Session) -> bool {
    BrickViewer::is_watched(&*session.broadcaster)
}

/// Serves pages from a volume in which all voxels have one value; returns the bricks read.
fn serve(session: &Session) -> usize {
    let mut count = 0;
    BrickViewer::serve(&*session.broadcaster, &mut |bricks| {
        count += bricks.len();
        bricks.iter().map(|_| Box::new(BrickCopy { value: [9.0; VOXELS], weight: [1.0; VOXELS] })).collect()
    });
    count
}

/// Returns the settings and the view, which come in any order.
fn described(page: &mut Client) -> (Value, Value) {
    let (mut drawing, mut view) = (None, None);
    while drawing.is_none() || view.is_none() {
        let word = page.next_word();
        drawing = word.get("drawing").cloned().or(drawing);
        view = word.get("view").cloned().or(view);
    }
    (drawing.unwrap(), view.unwrap())
}

#[test]
fn page_that_draws_gets_settings_view_and_bricks() {
    let session = Session::new();
    // The last picture's settings are known, although nobody looked.
    session.broadcaster.drawn(&drawn(1), [0.25; 3]);
    let mut page = session.page();
    page.say(&json!({ "do": "show", "slice": false, "view": true }));
    until("somebody looks", || session.broadcaster.is_watched());
    assert!(!draws(&session), "a page that does not ask gets no bricks");
    page.say(&json!({ "do": "show", "slice": false, "view": false, "bricks": true }));
    let (drawing, view) = described(&mut page);
    assert_eq!((&drawing["size"], &drawing["background"]), (&json!([80, 60]), &json!([0.25, 0.25, 0.25])));
    assert_eq!((&view["steered"], &view["azimuth"]), (&json!(0), &json!(0.0)));
    assert!(draws(&session) && session.broadcaster.is_watched() && !session.broadcaster.is_viewed(Kind::View));
    session.broadcaster.changed(&[[0, 0, 0], [1, 0, 0], [99, 0, 0]], true);
    assert_eq!(serve(&session), 2, "one lies outside of the region");
    session.broadcaster.drawn(&drawn(2), [0.25; 3]);
    let bricks = page.picture();
    let number = |at: usize| u32::from_le_bytes(bricks[at..at + 4].try_into().unwrap());
    assert_eq!((bricks[0], number(4), number(8), sequence(&bricks)), (KIND, 2, 0, 1), "no picture is before them");
    assert_eq!(serve(&session), 0, "nothing has changed");
    // Two messages are on their way, until the page answers.
    for z in 1..=3 {
        session.broadcaster.changed(&[[0, 0, z]], false);
        serve(&session);
        if z == 1 {
            assert_eq!(sequence(&page.picture()), 2);
        }
    }
    page.say(&json!({ "do": "shown", "kind": KIND, "sequence": 2 }));
    page.is_understood();
    until("there is room again", || serve(&session) > 0);
    assert_eq!(sequence(&page.picture()), 3);
    page.say(&json!({ "do": "show", "slice": false, "view": false, "bricks": false }));
    until("nobody draws", || !draws(&session));
    page.say(&json!({ "do": "show", "slice": false, "view": false, "bricks": true }));
    until("somebody draws", || draws(&session));
    drop(page);
    until("nobody is there", || !draws(&session));
}

#[test]
fn view_counts_commands_of_its_page() {
    let session = Session::new();
    session.broadcaster.drawn(&drawn(1), [0.0; 3]);
    let mut pages = [session.page(), session.page()];
    for page in &mut pages {
        page.say(&json!({ "do": "show", "slice": false, "view": false, "bricks": true }));
        assert_eq!(described(page).1["steered"], 0);
    }
    let turn = json!({ "do": "turn", "right": 5, "up": 0, "clockwise": 0 });
    let views = |page: &mut Client, steered: u64| {
        let begun = Instant::now();
        loop {
            let view = page.word("view");
            if view["steered"] == steered {
                return view["azimuth"].as_f64().unwrap();
            }
            assert!(begun.elapsed() < HANGS, "{view}");
        }
    };
    pages[0].say(&turn);
    let first = views(&mut pages[0], 1);
    assert!(first != 0.0 && views(&mut pages[1], 0) == first, "all pages are told");
    // A refused command counts, too: it is not in the view, and never will be.
    pages[1].say(&turn);
    pages[1].word("refused");
    pages[0].say(&turn);
    assert_eq!(views(&mut pages[0], 2), views(&mut pages[1], 1));
}
