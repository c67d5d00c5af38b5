//! Inactive pages, and new pages when all slots are taken.

use super::*;

#[test]
fn inactive_pages_only_are_replaced_by_new_ones() {
    let session = Session::patient_for(Duration::from_millis(50));
    let mut steers = session.page();
    let mut views = session.page();
    views.say(&json!({ "do": "show", "slice": true, "view": false }));
    until("somebody looks", || session.broadcaster.is_viewed(Kind::Slice));
    let mut resting: Vec<Client> = (0..6).map(|_| session.page()).collect();
    std::thread::sleep(Duration::from_millis(100));
    // All slots are taken, and each new page still gets one.
    let mut newcomers: Vec<Client> = (0..6)
        .map(|_| {
            let mut page = session.page();
            page.say(&json!({ "do": "show", "slice": true, "view": false }));
            page.for_a_while();
            page
        })
        .collect();
    assert_eq!(Counts::of(&session.console.counts().evictions), 6);
    assert!(resting.iter_mut().all(ends), "those that rested gave way");
    let stream = TcpStream::connect(session.address()).unwrap();
    let request = format!("ws://{}/v1/stream", session.address()).into_client_request().unwrap();
    assert!(tungstenite::client(request, stream).unwrap_err().to_string().contains("503"), "the others look, or steer");
    for page in newcomers.iter_mut().chain([&mut views, &mut steers]) {
        page.word("account");
    }
}
