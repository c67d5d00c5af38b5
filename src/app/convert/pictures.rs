//! Numbered image files (PNG) as a device: recordings exported by other programs, one frame per
//! file.
//!
//! The files contain neither times nor poses. The user can give the frame rate. A sequence of
//! them has no poses; it is for programs that need only images, or that have the poses from
//! elsewhere.

use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::codecs::png::PngDecoder;
use image::{ColorType, ImageDecoder as _};

use formats::Limits;
use sonoweave_core::reading::{Frame, PixelType, Stamp, Status};
use sonoweave_core::{Description, Device, Error, Health, Next, Reading};

use super::ConvertError;
use super::write::number_in;

/// Numbered image files, in the order of their numbers.
pub struct Pictures {
    /// The files.
    paths: Vec<PathBuf>,
    /// Frame rate, Hz; without it the frames have no times.
    rate_hz: Option<f64>,
    images: bool,
    limits: Limits,
    description: Description,
    health: Health,
    /// Index of the next file; `None` while stopped.
    next: Option<usize>,
}

impl Pictures {
    /// Returns whether a path names numbered image files: a folder, or a file name with a
    /// placeholder for the number (`frame%04d.png`).
    pub fn are_at(path: &Path) -> bool {
        path.is_dir() || file_name(path).is_some_and(|name| is_png(&name) && number_in(&name).is_some())
    }

    /// Finds the files; `images` chooses between reading pixels and reading the description
    /// only.
    ///
    /// # Errors
    /// [`ConvertError`] if there are none, or a number is missing between others.
    pub fn open(path: &Path, images: bool, rate_hz: Option<f64>) -> Result<Self, ConvertError> {
        let unfit = |why: String| ConvertError::Unfit { path: path.to_owned(), why };
        let name = file_name(path).unwrap_or_default();
        let (folder, pattern) = if path.is_dir() {
            (path, None)
        } else {
            (path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(".".as_ref()), number_in(&name))
        };
        let listing = std::fs::read_dir(folder).map_err(|e| unfit(format!("cannot list the folder: {e}")))?;
        let mut found: Vec<(u64, PathBuf)> = Vec::new();
        for entry in listing {
            let file = entry.map_err(|e| unfit(format!("cannot list the folder: {e}")))?.path();
            let Some(name) = file_name(&file).filter(|name| is_png(name)) else { continue };
            let number = match pattern {
                Some((before, digits, after)) => {
                    name.strip_prefix(before).and_then(|rest| rest.strip_suffix(after)).filter(|n| n.len() >= digits)
                }
                None => name.rsplit_once('.').map(|(stem, _)| last_number(stem)),
            };
            let number = number.filter(|n| n.bytes().all(|b| b.is_ascii_digit())).and_then(|n| n.parse().ok());
            match (number, pattern) {
                (Some(number), _) => found.push((number, file)),
                (None, Some(_)) => {}
                (None, None) => {
                    return Err(unfit(format!(
                        "{name} in it has no number; name the others by a pattern, as in frame%04d.png"
                    )));
                }
            }
        }
        found.sort();
        if found.is_empty() {
            return Err(unfit("matches no file; give the name of numbered PNG files, such as frame%04d.png".into()));
        }
        if found.len() as u64 > Limits::default().items {
            return Err(unfit(format!(
                "{} files are more than {}; convert fewer at a time",
                found.len(),
                Limits::default().items
            )));
        }
        if let Some(two) = found.windows(2).find(|two| two[1].0 != two[0].0 + 1) {
            let (after, before) = (two[0].1.display(), two[1].1.display());
            return Err(unfit(format!(
                "{after} and {before} do not have successive numbers; add the missing frame, or remove the second one"
            )));
        }
        let paths: Vec<PathBuf> = found.into_iter().map(|(_, file)| file).collect();
        let description =
            Description { name: path.display().to_string(), items: Some(paths.len() as u64), ..Description::default() };
        Ok(Self {
            paths,
            rate_hz,
            images,
            limits: Limits::default(),
            description,
            health: Health::default(),
            next: None,
        })
    }

    fn frame(&self, number: usize) -> Result<Frame, formats::Error> {
        let path = &self.paths[number];
        let frame = number as u64;
        let problem = |problem: String| formats::Error::Data { path: path.clone(), frame, offset: 0, problem };
        let failed = |source| formats::Error::Io { path: path.clone(), doing: "opening", source };
        let file = File::open(path).map_err(failed)?;
        let broken = |e: image::ImageError| problem(format!("cannot be read as PNG: {e}"));
        let decoder = PngDecoder::new(BufReader::new(file)).map_err(broken)?;
        let (width, height) = decoder.dimensions();
        let (pixel, channels) = match decoder.color_type() {
            ColorType::L8 => (PixelType::U8, 1),
            ColorType::La8 => (PixelType::U8, 2),
            ColorType::Rgb8 => (PixelType::U8, 3),
            ColorType::Rgba8 => (PixelType::U8, 4),
            ColorType::L16 => (PixelType::U16, 1),
            ColorType::La16 => (PixelType::U16, 2),
            ColorType::Rgb16 => (PixelType::U16, 3),
            ColorType::Rgba16 => (PixelType::U16, 4),
            other => return Err(problem(format!("has unsupported pixels of {other:?}; convert it to 8 or 16 bits"))),
        };
        let bytes = decoder.total_bytes();
        if bytes > self.limits.frame_bytes {
            return Err(problem(format!(
                "has {bytes} bytes of pixels, more than the limit of {}",
                self.limits.frame_bytes
            )));
        }
        let mut pixels = vec![0; if self.images { bytes as usize } else { 0 }];
        if self.images {
            decoder.read_image(&mut pixels).map_err(broken)?;
        }
        Ok(Frame {
            stamp: Stamp {
                item: number as u64,
                source_s: self.rate_hz.map(|hz| number as f64 / hz),
                ..Stamp::default()
            },
            frame_number: None,
            status: Status::Ok,
            size: [width, height],
            channels,
            pixel,
            orientation: "MF".into(),
            image_type: String::new(),
            pixels: Arc::from(pixels),
            fields: Vec::new(),
        })
    }
}

fn file_name(path: &Path) -> Option<String> {
    Some(path.file_name()?.to_string_lossy().into_owned())
}

fn is_png(name: &str) -> bool {
    name.to_ascii_lowercase().ends_with(".png")
}

/// Returns the digits at the end of a file name without its extension.
fn last_number(stem: &str) -> &str {
    &stem[stem.trim_end_matches(|c: char| c.is_ascii_digit()).len()..]
}

impl Device for Pictures {
    fn start(&mut self) -> Result<(), Error> {
        self.next = Some(0);
        Ok(())
    }

    fn next(&mut self, _deadline_ns: i64) -> Result<Next, Error> {
        let Some(number) = self.next else {
            return Err(Error::Stopped(self.description.name.clone()));
        };
        if number == self.paths.len() {
            return Ok(Next::End);
        }
        // After an error, the device must be started again.
        self.next = None;
        let frame = self.frame(number)?;
        self.next = Some(number + 1);
        Ok(Next::Reading(Reading::Frame(frame)))
    }

    fn stop(&mut self) -> Result<(), Error> {
        self.next = None;
        Ok(())
    }

    fn describe(&self) -> &Description {
        &self.description
    }

    fn health(&self) -> &Health {
        &self.health
    }
}
