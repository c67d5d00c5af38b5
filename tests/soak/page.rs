//! A page of the console as a program: it views everything, turns the view and answers pictures.

use std::net::{SocketAddr, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use serde_json::{Value, json};
use tungstenite::client::IntoClientRequest as _;
use tungstenite::{Error, Message, WebSocket};

/// A connected page. Dropping it breaks its connection.
pub(crate) struct Page {
    ends: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
    /// Pictures received.
    pub(crate) pictures: Arc<AtomicU64>,
}

impl Page {
    /// Opens a page on a session, and takes control.
    pub(crate) fn open(address: SocketAddr) -> Self {
        let (ends, pictures) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicU64::new(0)));
        let (ended, count) = (Arc::clone(&ends), Arc::clone(&pictures));
        let thread = std::thread::spawn(move || view(address, &ended, &count));
        Self { ends, thread: Some(thread), pictures }
    }
}

impl Drop for Page {
    fn drop(&mut self) {
        self.ends.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take()
            && thread.join().is_err()
            && !std::thread::panicking()
        {
            panic!("the page has failed");
        }
    }
}

/// Receives until the session or the test ends.
fn view(address: SocketAddr, ends: &AtomicBool, pictures: &AtomicU64) {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
    let request = format!("ws://{address}/v1/stream").into_client_request().unwrap();
    let Ok((mut socket, _)) = tungstenite::client(request, stream) else { return };
    let say = |socket: &mut WebSocket<TcpStream>, message: Value| {
        socket.send(Message::Text(message.to_string().into())).is_ok()
    };
    let mut goes_on = say(&mut socket, json!({ "do": "control" }))
        && say(&mut socket, json!({ "do": "show", "slice": true, "view": true, "planes": true }));
    while goes_on && !ends.load(Ordering::Relaxed) {
        goes_on = match socket.read() {
            Ok(Message::Binary(bytes)) => {
                let shown = pictures.fetch_add(1, Ordering::Relaxed);
                let sequence = u32::from_le_bytes(bytes[12..16].try_into().unwrap());
                let answer = json!({ "do": "shown", "kind": bytes[0], "sequence": sequence, "had_ms": 1 });
                // The view turns all the time.
                let turn = json!({ "do": "turn", "right": 3.0, "up": 0.5, "clockwise": 0.0 });
                say(&mut socket, answer) && (!shown.is_multiple_of(8) || say(&mut socket, turn))
            }
            Err(Error::Io(error)) => {
                matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut)
            }
            Ok(Message::Close(_)) | Err(_) => false,
            Ok(_) => true,
        };
    }
}
