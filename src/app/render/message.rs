//! Messages of parts that other processes composite: the blocks of a part's rays in a file, with
//! the picture to which they belong.
//!
//! A message is a line of JSON, the blocks ordered by pixel, and the SHA-256 of both.

use std::io::{self, BufRead as _, BufReader, Read, Seek, SeekFrom, Write};
use std::time::Instant;

use ome_zarr::ChunkWork;
use render::camera::Camera;
use render::partition::compositor::pixel_of;
use render::{Compositor, Picture, Plan, RenderWork};
use serde::{Deserialize, Serialize};
use sha2::{Digest as _, Sha256};
use statistics::{PartNumbers, PictureNumbers};
use volume::Values as _;

use super::rays::{Finished, Rays};
use super::request::milliseconds;
use super::volume::LevelOnDisk;
use crate::app::part::Part;
use crate::failure::{Failure, FailureKind};

/// Name of the format.
const FORMAT: &str = "sonoweave-part";
const VERSION: u32 = 1;
/// Bytes of the hash at the end.
const HASH: u64 = 32;
/// Longest first line.
const LINE: u64 = 4096;
/// Most bytes of blocks that are composited at once.
const AT_ONCE: usize = 1 << 20;

/// First line of a message.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Head {
    format: String,
    version: u32,
    /// Hash of all that the blocks depend on.
    picture: String,
    part: u64,
    parts: u64,
    folded: bool,
}

/// Numbers of a rendered part.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PartReport {
    part: u64,
    parts: u64,
    folded: bool,
    /// Bands of rows, one rendered after the other.
    bands: u32,
    /// Bytes of the blocks of rays.
    pub(super) message_bytes: u64,
    level: usize,
    reading: ChunkWork,
    /// Most memory of voxels, and of rays, bytes.
    voxel_bytes: u64,
    cache_bytes: u64,
    work: RenderWork,
}

/// Bytes that can be read twice.
pub(crate) trait Source: Read + Seek {}

impl<S: Read + Seek> Source for S {}

/// A message, and its name in sentences.
pub(crate) struct Named {
    pub(crate) name: String,
    pub(crate) source: Box<dyn Source>,
}

/// Returns the hash of all that the blocks of a picture depend on: the volume, the settings, and
/// the program that computes them.
fn key(rays: &Rays<'_>, level: &LevelOnDisk) -> String {
    let of = rays.settings;
    let settings = (&of.view, of.size, of.step, of.mode, &of.transfer, &of.crop, of.light, of.arity, of.stop);
    let all = (env!("CARGO_PKG_VERSION"), &level.key, level.number, rays.region, settings);
    hex(&Sha256::digest(format!("{all:?}")))
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Writes what passes, and hashes it.
struct Hashing<W> {
    inner: W,
    hash: Sha256,
}

impl<W: Write> Write for Hashing<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.inner.write(bytes)?;
        self.hash.update(&bytes[..count]);
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Renders a part of a picture, and writes its message. `failed` words an error of `output`.
///
/// # Errors
/// [`Failure`] when there is no such part, memory does not suffice, a chunk cannot be read, or the
/// message cannot be written.
pub(super) fn write_part(
    rays: &Rays<'_>,
    level: &LevelOnDisk,
    part: Part,
    is_folded: bool,
    output: &mut dyn Write,
    failed: impl Fn(io::Error) -> Failure,
) -> Result<PartReport, Failure> {
    let layers = u64::from(rays.region.bricks()[2]);
    if part.of > layers {
        fail_usage!(
            "--part {}/{}: the volume has {layers} layers of 8 voxels; give at most {layers} parts",
            part.number,
            part.of
        );
    }
    let bricks: Vec<_> = level.values.bricks().collect();
    // Neither exceeds the layers.
    let [number, parts] = [part.number - 1, part.of].map(|n| n as u32);
    let plan = Plan::new(rays.settings, &rays.region, &bricks, Some(parts), rays.limits())?;
    let head = Head {
        format: FORMAT.into(),
        version: VERSION,
        picture: key(rays, level),
        part: part.number,
        parts: part.of,
        folded: is_folded,
    };
    let mut report = PartReport {
        part: part.number,
        parts: part.of,
        folded: is_folded,
        bands: plan.bands,
        message_bytes: 0,
        level: level.number,
        reading: ChunkWork::default(),
        voxel_bytes: 0,
        cache_bytes: 0,
        work: RenderWork::default(),
    };
    let mut output = Hashing { inner: output, hash: Sha256::new() };
    output.write_all(format!("{}\n", serde_json::to_string(&head)?).as_bytes()).map_err(&failed)?;
    for rows in plan.rows() {
        let band = rays.part(level, &bricks, (number, parts), rows, is_folded)?;
        output.write_all(&band.message.bytes).map_err(&failed)?;
        report.message_bytes += band.message.bytes.len() as u64;
        report.work += band.message.work;
        report.voxel_bytes = report.voxel_bytes.max(band.memory.voxels);
        report.cache_bytes = report.cache_bytes.max(band.memory.rays);
    }
    report.reading = level.values.work();
    let hash = output.hash.finalize();
    output.inner.write_all(&hash).map_err(&failed)?;
    Ok(report)
}

/// A message whose hash is right, at its blocks.
struct Checked {
    name: String,
    blocks: io::Take<BufReader<Box<dyn Source>>>,
    head: Head,
    /// A block that was read, of a later band.
    next: Option<Vec<u8>>,
}

impl Checked {
    /// Checks a message's hash, and that it belongs to the picture of that key.
    fn open(Named { name, mut source }: Named, key: &str) -> Result<Self, Failure> {
        let failed = |error: io::Error| Failure::io(name.as_ref(), "reading", &error);
        let refuse = |problem: &str| Err(Failure::new(format!("{name}: {problem}")).of(FailureKind::Input));
        let length = source.seek(SeekFrom::End(0)).map_err(failed)?;
        source.rewind().map_err(failed)?;
        let mut line = Vec::new();
        let mut source = BufReader::new(source);
        (&mut source).take(LINE).read_until(b'\n', &mut line).map_err(failed)?;
        let Ok(head) = serde_json::from_slice::<Head>(&line) else {
            return refuse("is no message of a part; make it by `sonoweave render --part`");
        };
        if (head.format.as_str(), head.version) != (FORMAT, VERSION) {
            return refuse("is a message of another version; make it by this version of `sonoweave render --part`");
        }
        let damaged = "is damaged or incomplete; make it again by `sonoweave render --part`";
        let Some(blocks) = length.checked_sub(line.len() as u64 + HASH) else { return refuse(damaged) };
        let mut hash = Sha256::new();
        hash.update(&line);
        let mut rest = (&mut source).take(blocks);
        let mut buffer = vec![0; AT_ONCE];
        loop {
            match rest.read(&mut buffer).map_err(failed)? {
                0 => break,
                count => hash.update(&buffer[..count]),
            }
        }
        let mut expected = Vec::new();
        source.read_to_end(&mut expected).map_err(failed)?;
        if *hash.finalize() != *expected {
            return refuse(damaged);
        }
        if head.picture != key {
            return refuse(
                "is of another picture; give the volume and the settings with which it was made, or make it again",
            );
        }
        source.seek(SeekFrom::Start(line.len() as u64)).map_err(failed)?;
        Ok(Self { name, blocks: source.take(blocks), head, next: None })
    }

    /// Hands the blocks of pixels before `end` to the compositor.
    fn composite(&mut self, compositor: &mut Compositor, end: u32) -> Result<(), Failure> {
        let mut block = vec![0; compositor.block_bytes()];
        let mut blocks = Vec::new();
        loop {
            match self.next.take() {
                Some(next) => block = next,
                None => match self.blocks.read_exact(&mut block) {
                    Ok(()) => {}
                    Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => break,
                    Err(error) => return Err(Failure::io(self.name.as_ref(), "reading", &error)),
                },
            }
            if pixel_of(&block).is_none_or(|pixel| pixel >= end) {
                self.next = Some(block);
                break;
            }
            blocks.extend_from_slice(&block);
            if blocks.len() >= AT_ONCE {
                compositor.receive(&blocks)?;
                blocks.clear();
            }
        }
        compositor.receive(&blocks)?;
        Ok(())
    }
}

/// Composites the messages of all parts of a picture.
///
/// # Errors
/// [`Failure`] for messages that are damaged, of another picture, given twice or missing.
pub(super) fn composite(rays: &Rays<'_>, level: &LevelOnDisk, messages: Vec<Named>) -> Result<Finished, Failure> {
    let began = Instant::now();
    let key = key(rays, level);
    let mut checked = Vec::new();
    for message in messages {
        checked.push(Checked::open(message, &key)?);
    }
    checked.sort_by_key(|message| message.head.part);
    let Some(first) = checked.first().map(|first| first.head.clone()) else {
        fail_usage!("--composite: gives no message; give those of all parts");
    };
    let refuse = |sentence: String| Err(Failure::new(sentence).of(FailureKind::Input));
    for pair in checked.windows(2) {
        let [a, b] = [&pair[0], &pair[1]];
        if (a.head.parts, a.head.folded) != (b.head.parts, b.head.folded) {
            return refuse(format!(
                "{}, {}: are of other numbers of parts, or only one is folded; give the messages of one division",
                a.name, b.name
            ));
        }
        if a.head.part == b.head.part {
            return refuse(format!("{}, {}: are the same part {}; leave one out", a.name, b.name, a.head.part));
        }
    }
    let is_there = |part: &u64| checked.iter().any(|message| message.head.part == *part);
    if let Some(missing) = (1..=first.parts).find(|part| !is_there(part)) {
        let parts = first.parts;
        return refuse(format!("part {missing}/{parts} is missing; give the messages of all {parts} parts"));
    }
    let [_, ray_bytes] = rays.limits();
    let plan = Plan::new(rays.settings, &rays.region, &[], Some(1), [u64::MAX, ray_bytes])?;
    let (mut pixels, mut compositor_bytes, mut arity) = (Vec::new(), 0, 0);
    for rows in plan.rows() {
        let mut compositor = Compositor::of_rows(rays.settings, &rays.region, rows.clone())?;
        (compositor_bytes, arity) = (compositor_bytes.max(compositor.bytes()), compositor.arity());
        for message in &mut checked {
            message.composite(&mut compositor, rows.end * rays.settings.size[0])?;
        }
        pixels.extend(compositor.picture().pixels);
    }
    let camera = Camera::new(&rays.settings.view, rays.settings.size, rays.settings.step, &rays.region)?;
    let parts = PartNumbers { parts: first.parts as u32, samples: camera.samples(), arity, ..PartNumbers::default() };
    Ok(Finished {
        soft: None,
        picture: Picture { size: rays.settings.size, pixels },
        camera,
        numbers: PictureNumbers::of_parts(rays.settings, parts),
        bands: plan.bands,
        compositor_bytes: Some(compositor_bytes),
        prepare_ms: 0.0,
        shade_ms: 0.0,
        rays_ms: milliseconds(began),
        notes: Vec::new(),
        renderer: None,
    })
}
