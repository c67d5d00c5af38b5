//! Descriptions of the volume's view.

use super::*;

#[test]
fn projection_precedes_picture_and_is_resent_on_change() {
    let session = Session::new();
    let mut page = session.page();
    page.say(&json!({ "do": "show", "slice": false, "view": true }));
    until("somebody looks", || session.broadcaster.is_watched());
    let mut picture = drawn(1);
    session.broadcaster.drawn(&picture, [0.0; 3]);
    assert_eq!(page.word("sight")["projection"], json!(picture.renderer.camera().projection()));
    assert!(page.pictures.is_empty(), "before the picture");
    page.picture();
    let reported = |page: &mut Client| {
        let (mut reported, mut accounts) = (0, 0);
        while accounts < 3 {
            let word = page.next_word();
            reported += u32::from(word.get("sight").is_some());
            accounts += u32::from(word.get("account").is_some());
        }
        (reported, page.pictures.len())
    };
    page.say(&json!({ "do": "shown", "kind": 2, "sequence": 1 }));
    session.broadcaster.drawn(&picture, [0.0; 3]);
    assert_eq!(reported(&mut page), (0, 1), "it is the same view");
    page.say(&json!({ "do": "shown", "kind": 2, "sequence": 2 }));
    picture.renderer.set_view(render::camera::View { azimuth: 70.0, ..Default::default() }).unwrap();
    session.broadcaster.drawn(&picture, [0.0; 3]);
    assert_eq!(reported(&mut page), (1, 2));
}
