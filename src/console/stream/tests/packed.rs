//! Slow lines: what is packed for them, and what comes whole.

use super::*;

/// A page that looks at the scanner's picture, number 0.
fn looking(session: &Session) -> Client {
    let mut page = session.page();
    page.say(&json!({ "do": "show", "slice": true, "view": false }));
    until("it looks", || {
        session.shows(0);
        session.screen.made(Kind::Slice) > 0
    });
    page
}

#[test]
fn pages_whose_answers_come_late_get_jpegs_packed_once_and_whole_pictures_again_when_they_do_not() {
    let session = Session::new();
    let mut pages = [session.page(), session.page(), session.page()];
    let look = json!({ "do": "show", "slice": true, "view": false });
    pages.iter_mut().for_each(|page| page.say(&look));
    let mut shown = 0;
    // A picture to all, the first of which answers at once, and the others after so long.
    let mut round = |late: u64| {
        shown += 1;
        until("all look", || {
            session.shows(shown);
            session.screen.made(Kind::Slice) > 0
        });
        let pictures = pages.each_mut().map(Client::picture);
        for (n, (page, picture)) in pages.iter_mut().zip(&pictures).enumerate() {
            if n == 1 {
                std::thread::sleep(Duration::from_millis(late));
            }
            page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(picture) }));
        }
        // They have come to the server before the next picture does.
        std::thread::sleep(Duration::from_millis(20));
        pictures.map(|picture| (picture[1], picture[40..42] == [0xff, 0xd8]))
    };
    let [raw, jpeg] = [(0, false), (2, true)];
    // That all look is known when each has got one.
    std::thread::sleep(Duration::from_millis(300));
    // The second until the sixth late one make a second.
    for _ in 0..6 {
        assert_eq!(round(200), [raw; 3]);
    }
    assert_eq!(round(200), [raw, jpeg, jpeg]);
    let counts = session.console.counts();
    assert_eq!(Counts::of(&counts.pictures_packed), 1, "once for both");
    let rounds = (0..600).position(|_| round(0) == [raw; 3]);
    assert!(rounds.is_some_and(|rounds| (25..200).contains(&rounds)), "{rounds:?}");
    let before = Counts::of(&counts.pictures_packed);
    (0..5).for_each(|_| assert_eq!(round(0), [raw; 3]));
    assert_eq!(Counts::of(&counts.pictures_packed), before, "nobody wants any");
}

#[test]
fn a_picture_that_was_packed_is_sent_whole_when_none_newer_comes() {
    let session = Session::new();
    let mut page = looking(&session);
    let mut shown = 0;
    let mut next = |page: &mut Client, late: u64| {
        let picture = page.picture();
        std::thread::sleep(Duration::from_millis(late));
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&picture) }));
        std::thread::sleep(Duration::from_millis(20));
        shown += 1;
        session.shows(shown);
        picture
    };
    while next(&mut page, 200)[1] == 0 {}
    // The last one is answered at once, and nothing comes after it.
    let last = page.picture();
    page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&last) }));
    let begun = Instant::now();
    let again = page.picture();
    assert!(begun.elapsed() > Duration::from_millis(800), "{:?}", begun.elapsed());
    assert_eq!((last[1], again[1], sequence(&again)), (2, 0, sequence(&last)));
    assert_eq!(again[2] & 2, 2, "when it was captured tells nothing of the line");
    page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&again) }));
    session.shows(99);
    assert_eq!(page.picture()[1], 2, "the next one is packed as before");
}

#[test]
fn a_page_that_is_slow_itself_gets_whole_pictures() {
    let session = Session::new();
    let mut page = looking(&session);
    // Of 200 ms it has had it for most: unpacking a JPEG would make it slower still.
    for shown in 1..10 {
        let picture = page.picture();
        assert_eq!(picture[1], 0);
        std::thread::sleep(Duration::from_millis(200));
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&picture), "had_ms": 190 }));
        std::thread::sleep(Duration::from_millis(20));
        session.shows(shown);
    }
    assert_eq!(Counts::of(&session.console.counts().pictures_packed), 0, "skipped work");
}

#[test]
fn a_line_that_was_slow_is_asked_once_more_and_what_stands_still_comes_whole() {
    let session = Session::new();
    let mut page = looking(&session);
    let mut answered = |late: u64| {
        let picture = page.picture();
        std::thread::sleep(Duration::from_millis(late));
        page.say(&json!({ "do": "shown", "kind": 1, "sequence": sequence(&picture) }));
        std::thread::sleep(Duration::from_millis(20));
        (picture[1], sequence(&picture))
    };
    // The last one is answered late, too: it comes as it was, and is answered at once; then it comes whole.
    let mut shown = 0;
    let (kind, last) = loop {
        let picture = answered(200);
        if picture.0 == 2 {
            break picture;
        }
        shown += 1;
        session.shows(shown);
    };
    let begun = Instant::now();
    assert_eq!([(kind, last), answered(0), answered(0)], [(2, last), (2, last), (0, last)]);
    assert!(begun.elapsed() > Duration::from_millis(4500), "{:?}", begun.elapsed());
}
