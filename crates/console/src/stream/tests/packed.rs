//! Slow connections: JPEG and lossless pictures.

use super::*;

/// A page's answer with this time of its own counts as fast, on a loaded machine too: all of the
/// time is the page's, none is the line's.
const OWN_MS: u64 = 600_000;

/// Opens a page that views the B-mode image, frame 0.
fn viewing(session: &Session) -> Client {
    let mut page = session.page();
    page.say(&json!({ "do": "show", "slice": true, "view": false }));
    until("it looks", || {
        session.shows(0);
        session.broadcaster.made(Kind::Slice) > 0
    });
    page
}

#[test]
fn slow_pages_get_shared_jpegs_until_fast_again() {
    let session = Session::new();
    let mut pages = [session.page(), session.page(), session.page()];
    let subscription = json!({ "do": "show", "slice": true, "view": false });
    for page in &mut pages {
        page.say(&subscription);
        page.is_understood();
    }
    let mut shown = 0;
    // Sends a picture to all pages. The first answers fast, the others after 200 ms or fast.
    let mut round = |late: bool| {
        shown += 1;
        until("all look", || {
            session.shows(shown);
            session.broadcaster.made(Kind::Slice) > 0
        });
        let pictures = pages.each_mut().map(Client::picture);
        for (n, (page, picture)) in pages.iter_mut().zip(&pictures).enumerate() {
            if n == 1 && late {
                std::thread::sleep(Duration::from_millis(200));
            }
            let own = if n > 0 && late { 0 } else { OWN_MS };
            page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(picture), "had_ms": own }));
        }
        // The next picture is made by these answers.
        pages.iter_mut().for_each(Client::is_understood);
        pictures.map(|picture| (picture[1], picture[40..42] == [0xff, 0xd8]))
    };
    let [raw, jpeg] = [(0, false), (2, true)];
    // Three late answers in a row, and a second of them: six, of more than 200 ms each, or fewer if
    // they are later still. The two pages' answers may be a round apart.
    let late: Vec<_> = (0..10).map(|_| round(true)).take_while(|kinds| *kinds != [raw, jpeg, jpeg]).collect();
    assert!((3..=7).contains(&late.len()), "{late:?}");
    assert!(late[..3].iter().all(|kinds| *kinds == [raw; 3]), "{late:?}");
    assert!(late.iter().all(|kinds| kinds[0] == raw), "{late:?}");
    let counts = session.console.counts();
    let apart = late.iter().filter(|kinds| kinds.contains(&jpeg)).count() as u64;
    assert_eq!(Counts::of(&counts.pictures_packed), apart + 1, "once for both");
    // Thirty fast answers after the last late one.
    let rounds = (0..60).position(|_| round(false) == [raw; 3]);
    assert_eq!(rounds, Some(30));
    let before = Counts::of(&counts.pictures_packed);
    (0..5).for_each(|_| assert_eq!(round(false), [raw; 3]));
    assert_eq!(Counts::of(&counts.pictures_packed), before, "nobody wants any");
}

#[test]
fn last_jpeg_is_followed_by_lossless_picture() {
    let session = Session::new();
    let mut page = viewing(&session);
    let mut shown = 0;
    let mut next = |page: &mut Client, late: u64| {
        let picture = page.picture();
        std::thread::sleep(Duration::from_millis(late));
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&picture) }));
        page.is_understood();
        shown += 1;
        session.shows(shown);
        picture
    };
    while next(&mut page, 200)[1] == 0 {}
    // The last one is answered fast, and nothing follows it.
    let last = page.picture();
    let begun = Instant::now();
    page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&last), "had_ms": OWN_MS }));
    let again = page.picture();
    assert!(begun.elapsed() > Duration::from_millis(800), "{:?}", begun.elapsed());
    assert_eq!((last[1], again[1], sequence(&again)), (2, 0, sequence(&last)));
    assert_eq!(again[2] & 2, 2, "when it was captured tells nothing of the line");
    page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&again), "had_ms": OWN_MS }));
    session.shows(99);
    assert_eq!(page.picture()[1], 2, "the next one is packed as before");
}

#[test]
fn page_slow_by_itself_gets_lossless_pictures() {
    let session = Session::new();
    let mut page = viewing(&session);
    // The page had the picture for all of the 200 ms: decoding a JPEG would make it slower still.
    for shown in 1..10 {
        let picture = page.picture();
        assert_eq!(picture[1], 0);
        std::thread::sleep(Duration::from_millis(200));
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&picture), "had_ms": OWN_MS }));
        page.is_understood();
        session.shows(shown);
    }
    assert_eq!(Counts::of(&session.console.counts().pictures_packed), 0, "skipped work");
}

#[test]
fn slow_line_is_probed_and_static_picture_sent_lossless() {
    let session = Session::new();
    let mut page = viewing(&session);
    // Answers the next picture after 200 ms or fast; returns its kind, number and time of answer.
    let mut answered = |late: bool| {
        let picture = page.picture();
        if late {
            std::thread::sleep(Duration::from_millis(200));
        }
        let begun = Instant::now();
        let own = if late { 0 } else { OWN_MS };
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&picture), "had_ms": own }));
        page.is_understood();
        (picture[1], sequence(&picture), begun)
    };
    // The last one is answered late, too. It is sent again unchanged and answered fast; then it is
    // sent lossless.
    let mut shown = 0;
    let (last, begun) = loop {
        let (kind, last, begun) = answered(true);
        if kind == 2 {
            break (last, begun);
        }
        shown += 1;
        session.shows(shown);
    };
    let [again, lossless] = [answered(false), answered(false)];
    assert_eq!([(again.0, again.1), (lossless.0, lossless.1)], [(2, last), (0, last)]);
    // Five seconds after the session sent it, which a busy machine may have delivered late.
    assert!(lossless.2 - begun > Duration::from_millis(2500), "{:?}", lossless.2 - begun);
}
