//! Writers for sequences, sessions, image files and volumes.

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use export::picture::write_stored;
use formats::image::write::{SequenceWriter, VolumeWriter};
use formats::image::{VolumeHeader, VolumeSlices};
use formats::session::{About, SessionWriter, WriterOptions};
use formats::whole::{persist, temporary};
use sonoweave_core::reading::{Frame, Reading, Stamp};
use sonoweave_core::{Description, Device, Next};

use super::ConvertError;
use super::sequence::{Gathered, HOST_FIELD};

/// Progress callback; receives the number of frames or slices done.
pub type OnProgress<'a> = &'a dyn Fn(u64);

/// Writes a sequence; `device` delivers the frames of what was gathered.
///
/// # Errors
/// [`ConvertError`]: no file is left then.
pub fn sequence(
    device: &mut dyn Device,
    gathered: &Gathered,
    to: &Path,
    told: OnProgress<'_>,
) -> Result<(), ConvertError> {
    let mut writer = SequenceWriter::create(to, &gathered.header)?;
    if gathered.arrangement.is_some() {
        each(device, gathered, |n, frame| {
            writer.write_frame(&frame.pixels)?;
            told(n + 1);
            Ok(())
        })?;
    }
    Ok(writer.finish()?)
}

/// Writes a session with one device, which has the sequence's readings.
///
/// # Errors
/// [`ConvertError`]: no file is left then.
pub fn session(
    device: &mut dyn Device,
    gathered: &Gathered,
    to: &Path,
    told: OnProgress<'_>,
) -> Result<(), ConvertError> {
    let io = |source| ConvertError::Io { path: to.to_owned(), source };
    let file = temporary(to).map_err(io)?;
    let program = concat!("sonoweave ", env!("CARGO_PKG_VERSION"));
    let header = &gathered.header;
    let host = |stamp: &Stamp| stamp.host_ns.or_else(|| stamp.source_s.map(|s| (s * 1e9).round() as i64));
    let begins = header.items.iter().find_map(|item| host(&item.stamp)).unwrap_or(0);
    let about = About { monotonic_ns: begins, realtime_ns: About::now(program).realtime_ns, program: program.into() };
    let store = Box::new(file.reopen().map_err(io)?);
    let mut writer = SessionWriter::on(store, to, about, WriterOptions::new(program))?;
    let description = Description {
        name: "sequence".into(),
        items: Some(header.items.len() as u64),
        image_size: gathered.arrangement.as_ref().map(|a| a.size),
        pixel: gathered.arrangement.as_ref().map(|_| (header.pixel, header.channels)),
        fields: header.fields.clone(),
        ..Description::default()
    };
    let source = writer.device("sequence", None, &description, None)?;
    let mut last = begins;
    each(device, gathered, |n, frame| {
        let item = &header.items[n as usize];
        // A session's messages never go back in time.
        last = host(&item.stamp).map_or(last, |at| at.max(last));
        let stamp = Stamp { item: n, ..frame.stamp };
        for transform in &item.transforms {
            let mut transform = transform.clone();
            transform.stamp = stamp;
            writer.write(source, &Reading::NamedTransform(transform), last)?;
        }
        writer.write(source, &Reading::Frame(Frame { stamp, ..frame }), last)?;
        told(n + 1);
        Ok(())
    })?;
    let status = writer.finish(last)?;
    if status.lost > 0 {
        let source = std::io::Error::other("not all frames were written; free some disk space, and convert again");
        return Err(io(source));
    }
    persist(file, to).map_err(io)
}

/// Writes each frame as PNG into a folder, or by a name with a number placeholder (`%04d`).
///
/// # Errors
/// [`ConvertError`]: frames before the one that failed remain.
pub fn pictures(
    device: &mut dyn Device,
    gathered: &Gathered,
    to: &Path,
    told: OnProgress<'_>,
) -> Result<(), ConvertError> {
    let header = &gathered.header;
    if gathered.arrangement.is_none() {
        return Err(ConvertError::Unfit { path: to.to_owned(), why: "the recording holds no frames to write".into() });
    }
    each(device, gathered, |n, frame| {
        write_stored(&frame.pixels, header.size, header.pixel, header.channels, &numbered(to, gathered.first + n))?;
        told(n + 1);
        Ok(())
    })
}

/// Returns the file name of a frame.
fn numbered(to: &Path, number: u64) -> PathBuf {
    let name = to.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
    let Some((before, digits, after)) = number_in(&name) else { return to.join(format!("frame-{number:04}.png")) };
    to.with_file_name(format!("{before}{number:0digits$}{after}"))
}

/// Returns the text before a number placeholder, its minimal number of digits, and the text
/// behind it.
pub fn number_in(name: &str) -> Option<(&str, usize, &str)> {
    let (before, rest) = name.split_once("%0")?;
    let (digits, after) = rest.split_once('d')?;
    Some((before, digits.parse().ok().filter(|digits| (1..=18).contains(digits))?, after))
}

/// Passes on the chosen frames, as they are to be written, numbered from 0.
fn each(
    device: &mut dyn Device,
    gathered: &Gathered,
    mut with: impl FnMut(u64, Frame) -> Result<(), ConvertError>,
) -> Result<(), ConvertError> {
    let header = &gathered.header;
    let bytes = header.pixel.bytes() * header.channels as usize;
    let (mut number, count) = (0, header.items.len() as u64);
    device.start()?;
    while number < gathered.first + count {
        match device.next(sonoweave_core::NO_DEADLINE)? {
            Next::Reading(Reading::Frame(mut frame)) => {
                if number >= gathered.first {
                    let n = number - gathered.first;
                    if let Some(blackening) = &gathered.blackening {
                        blackening.apply(Arc::make_mut(&mut frame.pixels), bytes);
                    }
                    if let Some(arrangement) = &gathered.arrangement {
                        if let Some(pixels) = arrangement.apply(&frame.pixels, bytes) {
                            frame.pixels = pixels.into();
                        }
                        (frame.size, frame.orientation) = (arrangement.size, arrangement.orientation.clone().into());
                    }
                    let item = &header.items[n as usize];
                    if gathered.anonymous {
                        frame.stamp = Stamp { item: n, ..item.stamp };
                        (frame.frame_number, frame.status) = (item.frame_number, item.status.clone());
                        frame.image_type = header.image_type.clone();
                    }
                    frame.fields = item.fields.iter().filter(|(name, _)| name != HOST_FIELD).cloned().collect();
                    // A time of receipt that once came from a session goes into the new session.
                    let noted = item.fields.iter().find(|(name, _)| name == HOST_FIELD);
                    frame.stamp.host_ns = frame.stamp.host_ns.or_else(|| noted.and_then(|(_, ns)| ns.parse().ok()));
                    with(n, frame)?;
                }
                number += 1;
            }
            Next::Reading(_) | Next::Pending => {}
            Next::End => break,
        }
    }
    Ok(device.stop()?)
}

/// Writes a volume of this header.
///
/// # Errors
/// [`ConvertError`]: no file is left then.
pub fn volume(reader: &mut dyn VolumeSlices, header: &VolumeHeader, to: &Path) -> Result<(), ConvertError> {
    let mut writer = VolumeWriter::create(to, header)?;
    while let Some(slice) = reader.next_slice()? {
        writer.write_all(slice).map_err(|source| ConvertError::Io { path: to.to_owned(), source })?;
    }
    Ok(writer.finish()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn image_files_numbered_in_folder_or_by_name() {
        assert_eq!(numbered("out".as_ref(), 7), PathBuf::from("out/frame-0007.png"));
        assert_eq!(numbered("out/a%03d.png".as_ref(), 7), PathBuf::from("out/a007.png"));
        assert_eq!(number_in("a%d.png"), None, "a number of unsteady length does not sort");
        assert_eq!(number_in("a%099d.png"), None);
    }
}
