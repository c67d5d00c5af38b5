//! Requests of clients, and their answers.

use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use tokio::time::{Instant, sleep};

use drivers::openigtlink::{
    Command as CommandMessage, Content, Datum, Fault, Fixed, Message, Refused, Status, Subject, Text,
};

use pipeline::command::Command;

use super::client::Client;
use super::error::IgtlError;
use super::publish::nothing;
use super::state::ServerState;
use super::{commands, encode};

/// Longest wait for a volume to save.
const PATIENCE: Duration = Duration::from_secs(10);
/// Interval of checks whether the volume has arrived.
const POLL: Duration = Duration::from_millis(20);
/// Prefixes of the number of a STRING command, and of its answer, as in PLUS.
const COMMAND: &str = "CMD_";
const ANSWER: &str = "ACK_";

/// Message types understood.
const TYPES: [&str; 23] = [
    "IMAGE",
    "TRANSFORM",
    "POSITION",
    "TDATA",
    "STATUS",
    "STRING",
    "CAPABILITY",
    "COMMAND",
    "GET_IMAGE",
    "GET_TRANS",
    "GET_POSITION",
    "GET_TDATA",
    "GET_STATUS",
    "GET_STRING",
    "GET_CAPABIL",
    "STT_IMAGE",
    "STT_TRANS",
    "STT_POSITION",
    "STT_TDATA",
    "STP_IMAGE",
    "STP_TRANS",
    "STP_POSITION",
    "STP_TDATA",
];

/// Form of the answer to a command.
#[derive(Clone)]
enum Reply {
    /// Answer to a COMMAND of that device.
    Command(Fixed<20>, CommandMessage),
    /// Answer to a STRING, with the answer's device name.
    Text(Fixed<20>),
}

impl ServerState {
    /// Handles a received message.
    pub(super) fn handle(self: &Rc<Self>, client: &Rc<Client>, message: Message) {
        client.version.set(message.version);
        let device = message.device;
        match message.content {
            Content::Get(of) => self.get(client, of, device),
            Content::Start(of, pace) => {
                let is_known = match of {
                    of if of.is("TDATA") => {
                        let apart = Duration::from_millis(pace.map_or(0, |pace| pace.interval_ms.into()));
                        client.tools.set(Some((apart, Instant::now())));
                        true
                    }
                    of => self.set_subscription(client, of, true),
                };
                self.receipt(client, of, device, is_known);
            }
            Content::Stop(of) => {
                let is_known = match of {
                    of if of.is("TDATA") => {
                        client.tools.set(None);
                        true
                    }
                    of => self.set_subscription(client, of, false),
                };
                self.receipt(client, of, device, is_known);
            }
            Content::Command(command) => {
                let named = commands::named(command.name.as_str());
                let named = named.or_else(|| commands::of_xml(&command.text.as_text()));
                self.execute(client, named, Reply::Command(device, command));
            }
            Content::Text(text) if device.as_str().starts_with(COMMAND) => {
                let answer = encode::device(&device.as_str().replacen(COMMAND, ANSWER, 1));
                self.execute(client, commands::of_xml(&text.as_text()), Reply::Text(answer));
            }
            // Other clients' images and poses are ignored.
            _ => {}
        }
    }

    fn set_subscription(&self, client: &Client, of: Subject, is_on: bool) -> bool {
        let mut subscriptions = client.subscriptions.get();
        let is_known = match of {
            of if of.is("IMAGE") => {
                subscriptions.images = is_on;
                true
            }
            of if of.is("TRANSFORM") => {
                subscriptions.transforms = is_on;
                true
            }
            of if of.is("POSITION") => {
                client.positions.set(is_on);
                true
            }
            _ => false,
        };
        client.subscriptions.set(subscriptions);
        self.count_watchers();
        is_known
    }

    fn receipt(&self, client: &Client, of: Subject, device: Fixed<20>, is_known: bool) {
        let receipt = Content::Receipt(of, u8::from(!is_known));
        self.send(client, Message::new(device, encode::now(), receipt));
    }

    fn get(&self, client: &Client, of: Subject, device: Fixed<20>) {
        let answer = |content| Message::new(device, encode::now(), content);
        match of {
            of if of.is("IMAGE") => self.get_image(client, device),
            of if of.is("TRANSFORM") => {
                let mut published = self.published.borrow_mut();
                let found = published
                    .transforms
                    .iter_mut()
                    .find(|(name, _)| device == Fixed::EMPTY || encode::device(name) == device)
                    .and_then(|(_, both)| both.wire(client.version.get()).ok());
                drop(published);
                match found {
                    Some(wire) => client.answer(wire),
                    None => self.send(client, answer(nothing("TRANSFORM"))),
                }
            }
            of if of.is("POSITION") => {
                let published = self.published.borrow();
                let mut poses = published.poses.iter();
                let found = poses.find(|(name, _)| device == Fixed::EMPTY || encode::device(name) == device);
                let position = found.map(|(name, sample)| encode::position(name, sample));
                self.send(client, position.unwrap_or_else(|| answer(nothing("POSITION"))));
            }
            of if of.is("TDATA") => {
                let mut tools = encode::tools(self.published.borrow().poses.iter());
                tools.device = device;
                self.send(client, tools);
            }
            of if of.is("STATUS") => {
                let mut status = self.status();
                status.device = device;
                self.send(client, status);
            }
            of if of.is("STRING") => {
                let sentence =
                    self.published.borrow().status.as_ref().map_or(String::new(), |(_, sentence)| sentence.clone());
                self.send(client, answer(Content::Text(Text::new(&sentence))));
            }
            of if of.is("CAPABILITY") => {
                let types = TYPES.iter().filter_map(|name| Fixed::new(name).ok()).collect();
                self.send(client, answer(Content::Capability(types)));
            }
            other => {
                let sentence = format!("GET_{} is unknown; ask GET_CAPABIL for the known ones", other.0);
                self.complain(client, Status::UNKNOWN_INSTRUCTION, &sentence);
            }
        }
    }

    /// Answers with the slice under its name, or the volume under its own name or none. The
    /// volume is exported anew.
    fn get_image(&self, client: &Client, device: Fixed<20>) {
        if device == Fixed::EMPTY || device.as_str().starts_with("Volume") {
            client.volume_request.set(Some((Instant::now(), device)));
            return self.hub.request_volume();
        }
        let mut published = self.published.borrow_mut();
        let is_it = encode::device(&format!("Image_{}", published.world)) == device;
        let found = published.slice.as_mut().filter(|_| is_it).and_then(|both| both.wire(client.version.get()).ok());
        drop(published);
        match found {
            Some(wire) => client.answer(wire),
            None => self.send(client, Message::new(device, encode::now(), nothing("IMAGE"))),
        }
    }

    fn complain(&self, client: &Client, code: u16, sentence: &str) {
        self.send(client, encode::status(code, sentence));
    }

    /// Answers a refused message.
    pub(super) fn refuse(&self, client: &Client, why: &Refused) {
        let code = match why.fault {
            Fault::Checksum => Status::CHECKSUM,
            Fault::TooLarge => Status::OVERFLOW,
            Fault::Header | Fault::Length | Fault::Field => Status::UNKNOWN_INSTRUCTION,
        };
        self.complain(client, code, &why.to_string());
    }

    fn execute(self: &Rc<Self>, client: &Rc<Client>, command: Option<Command>, reply: Reply) {
        if !client.is_local() {
            return self.reply(client, reply, Err(IgtlError::NotLocal));
        }
        match command {
            Some(Command::Scan) => self.reply(client, reply, self.commands.start()),
            Some(Command::Stop) => self.reply(client, reply, Ok(self.commands.stop())),
            Some(Command::Save) => {
                let (state, client) = (Rc::clone(self), Rc::clone(client));
                tokio::task::spawn_local(async move {
                    let saved = state.save().await;
                    state.reply(&client, reply, saved);
                });
            }
            Some(command @ (Command::Freeze(_) | Command::Clear)) => {
                self.reply(client, reply, self.commands.execute(command));
            }
            _ => self.reply(client, reply, Err(IgtlError::UnknownCommand)),
        }
    }

    /// Saves the volume in its present state.
    async fn save(&self) -> Result<String, IgtlError> {
        self.commands.folder()?;
        let before = self.hub.volumes.load(Ordering::Relaxed);
        self.hub.request_volume();
        let requested_at = Instant::now();
        while self.hub.volumes.load(Ordering::Relaxed) == before {
            if requested_at.elapsed() > PATIENCE {
                return Err(IgtlError::NoVolume);
            }
            sleep(POLL).await;
        }
        // The volume was announced, and is available within one publishing interval.
        sleep(POLL).await;
        let (world, snapshot) = {
            let published = self.published.borrow();
            (published.world.clone(), published.snapshot.clone())
        };
        let snapshot = snapshot.ok_or(IgtlError::NoVolume)?.map_err(IgtlError::Volume)?;
        let commands = Arc::clone(&self.commands);
        let written = tokio::task::spawn_blocking(move || commands.write(&world, &snapshot)).await;
        let path = written.map_err(|error| IgtlError::Volume(format!("cannot write the volume: {error}")))??;
        Ok(format!("the volume is written to {}", path.display()))
    }

    /// Reports the result of a command. The answer's name is the error, as in the reference
    /// library, or else the command's name.
    fn reply(&self, client: &Client, reply: Reply, outcome: Result<String, IgtlError>) {
        let is_done = outcome.is_ok();
        let sentence = outcome.unwrap_or_else(|error| error.to_string());
        let quoted = quoted(&sentence);
        let message = match reply {
            Reply::Text(device) => {
                let status = if is_done { "SUCCESS" } else { "FAIL" };
                let text = Text::new(&format!("<CommandReply Status=\"{status}\" Message=\"{quoted}\" />"));
                Message::new(device, encode::now(), Content::Text(text))
            }
            Reply::Command(device, command) => {
                let text =
                    Text::new(&format!("<Command><Result>{is_done}</Result><Message>{quoted}</Message></Command>"));
                let end = (0..=sentence.len().min(128)).rev().find(|at| sentence.is_char_boundary(*at)).unwrap_or(0);
                let name = if is_done { command.name } else { Fixed::new(&sentence[..end]).unwrap_or(Fixed::EMPTY) };
                let answer = Content::Answer(CommandMessage { id: command.id, name, text });
                let mut message = Message::new(device, encode::now(), answer);
                message.metadata = vec![
                    Datum::new("Result", if is_done { "true" } else { "false" }),
                    Datum::new("Message", &sentence),
                ];
                message
            }
        };
        self.send(client, message);
    }
}

/// Escapes a text for XML.
fn quoted(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
