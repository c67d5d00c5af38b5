//! Writes an intact session from the readable parts of a damaged one.

use std::fs::File;
use std::io::ErrorKind;
use std::path::Path;

use mcap::records::MessageHeader;

use crate::session::about::{About, Loss};
use crate::session::reader::{Ending, Event, SessionReader};
use crate::session::schema;
use crate::session::walk::Damage;
use crate::session::writer::{SessionWriter, WriterOptions};
use crate::whole::{persist_new, temporary};
use crate::{Error, Limits};

/// Result of a repair.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repaired {
    /// Number of messages copied.
    pub messages: u64,
    /// Topics with missing messages, and a lower bound of their number: messages after the last
    /// one read cannot be counted.
    pub missing: Vec<(String, u64)>,
    /// Parts of the file that could not be read.
    pub damage: Vec<Damage>,
    /// State of the file's end.
    pub ending: Option<Ending>,
}

/// Copies every readable message into a new file, in order and with times and numbers. Adds the
/// missing messages to `/losses`.
///
/// # Errors
/// [`Error::Io`] when a file cannot be read or written, or the new one exists already.
/// [`Error::NoSession`] when the old one is no session. There is no new file then.
pub fn repair(from: &Path, to: &Path, limits: &Limits) -> Result<Repaired, Error> {
    let mut reader = SessionReader::open(from, limits)?;
    let failed = |source| Error::Io { path: to.to_owned(), doing: "making the repaired session", source };
    if to.symlink_metadata().is_ok() {
        return Err(failed(ErrorKind::AlreadyExists.into()));
    }
    // An incomplete session could be mistaken for a complete one.
    let file = temporary(to).map_err(failed)?;
    let repaired = copy(&mut reader, file.reopen().map_err(failed)?, to)?;
    persist_new(file, to).map_err(failed)?;
    Ok(repaired)
}

fn copy(reader: &mut SessionReader, file: File, to: &Path) -> Result<Repaired, Error> {
    let about = reader.about().clone();
    let options = WriterOptions::new(&about.program);
    let mut writer = SessionWriter::on(Box::new(file), to, about.clone(), options)?;
    let (mut messages, mut damage, mut span) = (0, Vec::new(), [about.monotonic_ns; 2]);
    while let Some(event) = reader.next_event()? {
        match event {
            Event::Damage(part) => damage.push(part),
            Event::Message(message) => {
                let Some(schema) = message.channel.known else {
                    let (topic, schema) = (message.channel.topic.clone(), message.channel.schema.clone());
                    return Err(Error::UnknownMessages { path: reader.path().to_owned(), topic, schema });
                };
                let log_ns = message.log_ns();
                span = [if span[0] == 0 { log_ns } else { span[0] }, log_ns];
                messages += 1;
                // The writer has already written it.
                let is_beginning =
                    schema.name == schema::SESSION.name && About::read(message.bytes).is_ok_and(|one| one == about);
                if !is_beginning {
                    writer.copy(&message.channel.topic, schema, &message.header, message.bytes)?;
                }
            }
        }
    }
    let missing: Vec<(String, u64)> = reader
        .channels()
        .iter()
        .filter(|channel| channel.missing > 0)
        .map(|channel| (channel.topic.clone(), channel.missing))
        .collect();
    let ending = reader.ending();
    if damage.iter().any(|part: &Damage| part.is_loss) || ending == Some(Ending::BrokenOff) {
        // A truncated end is the normal end of an interrupted session.
        let length = std::fs::metadata(reader.path()).map_or(u64::MAX, |file| file.len());
        let broken_off = (ending == Some(Ending::BrokenOff)).then(|| "the session was broken off".to_owned());
        let left_out = match damage.iter().filter(|part| part.is_loss && part.until < length).count() {
            0 => None,
            1 => Some("1 damaged part is left out".to_owned()),
            parts => Some(format!("{parts} damaged parts are left out")),
        };
        let why: Vec<String> = [broken_off, left_out].into_iter().flatten().collect();
        let why = format!("repaired: {}", why.join("; "));
        let lost = missing.iter().map(|(topic, count)| (topic.clone(), *count, 0)).collect();
        let loss = Loss { from_ns: span[0], until_ns: span[1], why, lost };
        let mut bytes = Vec::new();
        loss.write(&mut bytes);
        let log_time = u64::try_from(span[1]).unwrap_or(0);
        let known = reader.channels().into_iter().find(|channel| channel.topic == LOSSES);
        let sequence = known.map_or(0, |channel| channel.next_number());
        let header = MessageHeader { channel_id: 0, sequence, log_time, publish_time: log_time };
        writer.copy(LOSSES, &schema::LOSS, &header, &bytes)?;
    }
    writer.finish_copy()?;
    Ok(Repaired { messages, missing, damage, ending })
}

/// Topic of a session's losses.
const LOSSES: &str = "/losses";
