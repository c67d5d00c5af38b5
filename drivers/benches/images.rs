//! Measures reading and writing of image files: `make bench`, or
//! `cargo bench -p sonoweave-drivers --bench images -- [--quick]`.
//!
//! Two cases. A zlib sequence is read by the replay device, compared with inflating its stream
//! alone, in memory. A raw volume of single precision is written in every format and read back.
//! The bench measures the thread's CPU time, which other processes hardly affect, and the wall
//! time, which includes the disk (a file is on the disk before it is renamed). Data read is
//! compared with data written; a wrong byte is an error. All cases are repeated in turns; the
//! output is the median, followed by the quartiles.
#![allow(clippy::print_stdout, reason = "a bench speaks to its user")]

use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use flate2::{Decompress, FlushDecompress};

use drivers::replay::{Replay, SequenceSettings};
use formats::Limits;
use formats::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use formats::image::{VolumeHeader, VolumeReader};
use sonoweave_core::clock::SECOND;
use sonoweave_core::reading::{PixelType, Reading, Stamp, Status};
use sonoweave_core::{Device, NO_DEADLINE, Next};

const SIZE: [u32; 2] = [640, 480];
/// Goals: time to read a compressed sequence, relative to inflating alone; and write rate, MB
/// per second.
const RATIO: f64 = 1.3;
const RATE: f64 = 500.0;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../out");
    std::fs::create_dir_all(&folder)?;
    let folder = tempfile::tempdir_in(&folder)?;
    let rounds = if quick { 3 } else { 9 };
    let mut wrong = sequence(folder.path(), if quick { 60 } else { 300 }, rounds)?;
    println!("{:16}  {:>20}  {:>20}  {:>20}  bytes wrong", "volume, MB/s", "written", "on the disk", "read");
    for name in ["v.mha", "v.nrrd", "v.nii"] {
        wrong += volume(&folder.path().join(name), if quick { 32 } else { 128 }, rounds)?;
    }
    Ok(if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Quartiles of the rounds, the median in the middle.
struct Spread([f64; 3]);

impl Spread {
    fn of(mut rounds: Vec<f64>) -> Self {
        rounds.sort_by(f64::total_cmp);
        Self([0.25, 0.5, 0.75].map(|q| rounds[((rounds.len() - 1) as f64 * q).round() as usize]))
    }

    fn text(&self, decimals: usize) -> String {
        let [low, median, high] = self.0.map(|value| format!("{value:.decimals$}"));
        format!("{median} ({low} to {high})")
    }
}

/// Returns this thread's CPU time, s.
fn own_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    (now.tv_sec * SECOND + now.tv_nsec) as f64 * 1e-9
}

/// Returns speckle on a smooth background, about as compressible as ultrasound frames.
fn painted(frame: u64) -> Vec<u8> {
    let mut state = frame.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    let [width, height] = SIZE.map(u64::from);
    let mut pixel = |n: u64| {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        if n % width < width / 4 { 0 } else { (40 + n / width / 8 + (state >> 60)) as u8 }
    };
    (0..width * height).map(&mut pixel).collect()
}

fn sequence(folder: &Path, frames: u64, rounds: usize) -> Result<u64, Box<dyn Error>> {
    let path = folder.join("s.igs.mha");
    let items = (0..frames).map(|item| SequenceItem {
        stamp: Stamp { source_s: Some(item as f64 / 30.0), ..Stamp::default() },
        frame_number: Some(item),
        status: Status::Ok,
        transforms: Vec::new(),
        fields: Vec::new(),
    });
    let header = SequenceHeader {
        size: SIZE,
        pixel: PixelType::U8,
        channels: 1,
        orientation: "MFA".into(),
        image_type: "BRIGHTNESS".into(),
        compressed: true,
        fields: Vec::new(),
        items: items.collect(),
    };
    let pictures: Vec<Vec<u8>> = (0..8).map(painted).collect();
    let mut writer = SequenceWriter::create(&path, &header)?;
    (0..frames).try_for_each(|n| writer.write_frame(&pictures[(n % 8) as usize]))?;
    writer.finish()?;

    let bytes = std::fs::read(&path)?;
    let end = b"ElementDataFile = LOCAL\n";
    let at = bytes.windows(end.len()).position(|window| window == end).ok_or("the header has no end")? + end.len();
    let (mut read, mut alone, mut ratios, mut wrong) = (Vec::new(), Vec::new(), Vec::new(), 0);
    let plain = frames as f64 * f64::from(SIZE[0]) * f64::from(SIZE[1]) / 1e6;
    for _ in 0..rounds {
        let (read_s, bad) = read_frames(&path, frames, &pictures)?;
        let alone_s = inflate(&bytes[at..], frames)?;
        wrong += bad;
        read.push(plain / read_s);
        alone.push(plain / alone_s);
        ratios.push(read_s / alone_s);
    }
    println!(
        "zlib .igs.mha, {frames} frames: {} MB/s read, {} MB/s inflated alone: {} times the time (goal {RATIO}); {wrong} bytes wrong",
        Spread::of(read).text(0),
        Spread::of(alone).text(0),
        Spread::of(ratios).text(2),
    );
    Ok(wrong)
}

/// Reads the frames through the device. Returns the device's own time, s, and the number of
/// wrong bytes.
fn read_frames(path: &Path, frames: u64, pictures: &[Vec<u8>]) -> Result<(f64, u64), Box<dyn Error>> {
    let mut device = Replay::open(&SequenceSettings::new(path))?;
    let (mut wrong, mut read_s, mut n) = (0, 0.0, 0);
    let began = own_s();
    device.start()?;
    read_s += own_s() - began;
    loop {
        let began = own_s();
        let next = device.next(NO_DEADLINE)?;
        read_s += own_s() - began;
        match next {
            Next::Reading(Reading::Frame(frame)) => {
                let picture = &pictures[(n % 8) as usize];
                wrong += frame.pixels.iter().zip(picture).filter(|(a, b)| a != b).count() as u64;
                n += 1;
            }
            Next::End => break,
            _ => {}
        }
    }
    Ok((read_s, wrong + frames - n))
}

/// Inflates the stream from memory; returns the time, s.
fn inflate(stream: &[u8], frames: u64) -> Result<f64, Box<dyn Error>> {
    let mut frame = vec![0; SIZE[0] as usize * SIZE[1] as usize];
    let mut inflate = Decompress::new(true);
    let began = own_s();
    for _ in 0..frames {
        let mut filled = 0;
        while filled < frame.len() {
            let (taken, made) = (inflate.total_in(), inflate.total_out());
            inflate.decompress(&stream[taken as usize..], &mut frame[filled..], FlushDecompress::None)?;
            if (inflate.total_in(), inflate.total_out()) == (taken, made) {
                return Err("the stream ends early".into());
            }
            filled += (inflate.total_out() - made) as usize;
        }
    }
    Ok(own_s() - began)
}

fn volume(path: &Path, slices: u32, rounds: usize) -> Result<u64, Box<dyn Error>> {
    let header = VolumeHeader::new([512, 512, slices], PixelType::F32);
    let slice: Vec<u8> = (0..512 * 512).flat_map(|n: u32| (n as f32 * 0.25).to_ne_bytes()).collect();
    let megabytes = (slice.len() * slices as usize) as f64 / 1e6;
    let (mut written, mut on_disk, mut read, mut wrong) = (Vec::new(), Vec::new(), Vec::new(), 0);
    for _ in 0..rounds {
        let (wall, began) = (Instant::now(), own_s());
        let mut writer = VolumeWriter::create(path, &header)?;
        (0..slices).try_for_each(|_| writer.write_all(&slice))?;
        written.push(megabytes / (own_s() - began));
        writer.finish()?;
        on_disk.push(megabytes / wall.elapsed().as_secs_f64());
        let mut reader = VolumeReader::open(path, &Limits::default())?;
        let (mut read_s, mut left) = (0.0, slices);
        loop {
            let began = own_s();
            let next = reader.next_slice()?;
            read_s += own_s() - began;
            let Some(got) = next else { break };
            wrong += got.iter().zip(&slice).filter(|(a, b)| a != b).count() as u64;
            left -= 1;
        }
        wrong += u64::from(left);
        read.push(megabytes / read_s);
        std::fs::remove_file(path)?;
    }
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let [written, on_disk, read] = [written, on_disk, read].map(|rates| Spread::of(rates).text(0));
    println!("{name:16}  {written:>20}  {on_disk:>20}  {read:>20}  {wrong} (goal {RATE} MB/s)");
    Ok(wrong)
}
