//! What clients ask, and what they are answered.

use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

use drivers::openigtlink::{Command, Content, Datum, Fault, Fixed, Message, Refused, Status, Subject, Text};
use tokio::time::{Instant, sleep};

use super::client::Client;
use super::commands::Deed;
use super::encode;
use super::publish::nothing;
use super::server::House;

/// For so long a volume that is to be saved may take.
const PATIENCE: Duration = Duration::from_secs(10);
/// Between two looks at whether it is there.
const LOOK: Duration = Duration::from_millis(20);
/// Before the number of a command that is a STRING, and of its answer, as PLUS has them.
const COMMAND: &str = "CMD_";
const ANSWER: &str = "ACK_";

/// What is understood.
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

/// How a command is answered.
#[derive(Clone)]
enum Reply {
    /// To a COMMAND of that device.
    Command(Fixed<20>, Command),
    /// To a STRING, by the answer's device.
    Text(Fixed<20>),
}

impl House {
    /// A message has come.
    pub(super) fn hear(self: &Rc<Self>, client: &Rc<Client>, message: Message) {
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
                    of => self.wish(client, of, true),
                };
                self.receipt(client, of, device, is_known);
            }
            Content::Stop(of) => {
                let is_known = match of {
                    of if of.is("TDATA") => {
                        client.tools.set(None);
                        true
                    }
                    of => self.wish(client, of, false),
                };
                self.receipt(client, of, device, is_known);
            }
            Content::Command(command) => {
                let deed = Deed::named(command.name.as_str()).or_else(|| Deed::of_xml(&command.text.as_text()));
                self.act(client, deed, Reply::Command(device, command));
            }
            Content::Text(text) if device.as_str().starts_with(COMMAND) => {
                let answer = encode::device(&device.as_str().replacen(COMMAND, ANSWER, 1));
                self.act(client, Deed::of_xml(&text.as_text()), Reply::Text(answer));
            }
            // What others show is theirs.
            _ => {}
        }
    }

    fn wish(&self, client: &Client, of: Subject, wanted: bool) -> bool {
        let mut wants = client.wants.get();
        let is_known = match of {
            of if of.is("IMAGE") => {
                wants.images = wanted;
                true
            }
            of if of.is("TRANSFORM") => {
                wants.transforms = wanted;
                true
            }
            of if of.is("POSITION") => {
                client.positions.set(wanted);
                true
            }
            _ => false,
        };
        client.wants.set(wants);
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
                let mut shown = self.shown.borrow_mut();
                let found = shown
                    .transforms
                    .iter_mut()
                    .find(|(name, _)| device == Fixed::EMPTY || encode::device(name) == device)
                    .and_then(|(_, both)| both.wire(client.version.get()).ok());
                drop(shown);
                match found {
                    Some(wire) => client.answer(wire),
                    None => self.send(client, answer(nothing("TRANSFORM"))),
                }
            }
            of if of.is("POSITION") => {
                let shown = self.shown.borrow();
                let mut poses = shown.poses.iter();
                let found = poses.find(|(name, _)| device == Fixed::EMPTY || encode::device(name) == device);
                let position = found.map(|(name, sample)| encode::position(name, sample));
                self.send(client, position.unwrap_or_else(|| answer(nothing("POSITION"))));
            }
            of if of.is("TDATA") => {
                let mut tools = encode::tools(self.shown.borrow().poses.iter());
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
                    self.shown.borrow().status.as_ref().map_or(String::new(), |(_, sentence)| sentence.clone());
                self.send(client, answer(Content::Text(Text::new(&sentence))));
            }
            of if of.is("CAPABILITY") => {
                let types = TYPES.iter().filter_map(|name| Fixed::new(name).ok()).collect();
                self.send(client, answer(Content::Capability(types)));
            }
            other => {
                let sentence = format!("GET_{} is not understood; ask GET_CAPABIL for what is", other.0);
                self.complain(client, Status::UNKNOWN_INSTRUCTION, &sentence);
            }
        }
    }

    /// The slice by its name, and the volume by its own or without one; a volume is made anew.
    fn get_image(&self, client: &Client, device: Fixed<20>) {
        if device == Fixed::EMPTY || device.as_str().starts_with("Volume") {
            client.asked.set(Some((Instant::now(), device)));
            return self.hub.ask();
        }
        let mut shown = self.shown.borrow_mut();
        let is_it = encode::device(&format!("Image_{}", shown.world)) == device;
        let found = shown.slice.as_mut().filter(|_| is_it).and_then(|both| both.wire(client.version.get()).ok());
        drop(shown);
        match found {
            Some(wire) => client.answer(wire),
            None => self.send(client, Message::new(device, encode::now(), nothing("IMAGE"))),
        }
    }

    fn complain(&self, client: &Client, code: u16, sentence: &str) {
        self.send(client, encode::status(code, sentence));
    }

    /// A message that was not taken.
    pub(super) fn refuse(&self, client: &Client, why: &Refused) {
        let code = match why.fault {
            Fault::Checksum => Status::CHECKSUM,
            Fault::TooLarge => Status::OVERFLOW,
            Fault::Header | Fault::Length | Fault::Field => Status::UNKNOWN_INSTRUCTION,
        };
        self.complain(client, code, &why.to_string());
    }

    fn act(self: &Rc<Self>, client: &Rc<Client>, deed: Option<Deed>, reply: Reply) {
        if !client.is_local {
            let why = "commands are taken from this machine only; run the client here, or through a tunnel".into();
            return self.reply(client, reply, Err(why));
        }
        match deed {
            None => self.reply(client, reply, Err("no such command; there are start, stop and save".into())),
            Some(Deed::Start) => self.reply(client, reply, self.commands.start()),
            Some(Deed::Stop) => self.reply(client, reply, Ok(self.commands.stop())),
            Some(Deed::Save) => {
                let (house, client) = (Rc::clone(self), Rc::clone(client));
                tokio::task::spawn_local(async move {
                    let saved = house.save().await;
                    house.reply(&client, reply, saved);
                });
            }
        }
    }

    /// Saves the volume as it is now.
    async fn save(&self) -> Result<String, String> {
        self.commands.folder()?;
        let before = self.hub.volumes.load(Ordering::Relaxed);
        self.hub.ask();
        let asked = Instant::now();
        while self.hub.volumes.load(Ordering::Relaxed) == before {
            if asked.elapsed() > PATIENCE {
                return Err("there is no volume; does the session run?".into());
            }
            sleep(LOOK).await;
        }
        // It was told, and is shown within a turn.
        sleep(LOOK).await;
        let (world, snapshot) = {
            let shown = self.shown.borrow();
            (shown.world.clone(), shown.snapshot.clone())
        };
        let snapshot = snapshot.unwrap_or_else(|| Err("there is no volume yet".into()))?;
        let commands = Arc::clone(&self.commands);
        let written = tokio::task::spawn_blocking(move || commands.write(&world, &snapshot)).await;
        let path = written.unwrap_or_else(|_| Err("the volume could not be written".into()))?;
        Ok(format!("{} is written", path.display()))
    }

    /// What became of a command. In the answer's name there is what went wrong, as the reference library has it, else the command's.
    fn reply(&self, client: &Client, reply: Reply, outcome: Result<String, String>) {
        let is_done = outcome.is_ok();
        let sentence = outcome.unwrap_or_else(|why| why);
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
                let answer = Content::Answer(Command { id: command.id, name, text });
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

/// A text within XML.
fn quoted(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
