//! Image files read and written: `make bench`, or `cargo bench -p sonoweave-drivers --bench images -- [--quick]`.
//!
//! A zlib sequence through the replay device, beside the inflating of its stream alone, in memory; and a raw volume of single precision into every format, and back. Times are the
//! thread's own, so that others on the machine count for little, and the wall's, which has the disk in it (a file is on the disk before it takes its name). What was read is
//! compared with what was written: a wrong byte ends in an error.
#![allow(clippy::print_stdout, reason = "a bench speaks to its user")]

use std::error::Error;
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;
use std::time::Instant;

use drivers::clock::SECOND;
use drivers::reading::{PixelType, Reading, Stamp, Status};
use drivers::recording::image::write::{SequenceHeader, SequenceItem, SequenceWriter, VolumeWriter};
use drivers::recording::image::{VolumeHeader, VolumeReader};
use drivers::recording::{Limits, Replay, SequenceSettings};
use drivers::{Device, NO_DEADLINE, Next};
use flate2::{Decompress, FlushDecompress};

const SIZE: [u32; 2] = [640, 480];
/// What reading a compressed sequence may take, beside inflating alone; and what writing must do, MB a second.
const RATIO: f64 = 1.3;
const RATE: f64 = 500.0;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../out");
    std::fs::create_dir_all(&folder)?;
    let folder = tempfile::tempdir_in(&folder)?;
    let mut wrong = sequence(folder.path(), if quick { 60 } else { 600 })?;
    println!("volume            written: MB/s   on the disk, MB/s   read: MB/s   bytes wrong");
    for name in ["v.mha", "v.nrrd", "v.nii"] {
        wrong += volume(&folder.path().join(name), if quick { 32 } else { 256 })?;
    }
    Ok(if wrong == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// This thread's time, s.
fn own_s() -> f64 {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    (now.tv_sec * SECOND + now.tv_nsec) as f64 * 1e-9
}

/// Speckle on a smooth ground: about as compressible as a scanner's pictures.
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

fn sequence(folder: &Path, frames: u64) -> Result<u64, Box<dyn Error>> {
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
    let picture = |n: u64| &pictures[(n % 8) as usize];
    let mut writer = SequenceWriter::create(&path, &header)?;
    (0..frames).try_for_each(|n| writer.write_frame(picture(n)))?;
    writer.finish()?;

    let mut device = Replay::open(&SequenceSettings::new(&path))?;
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
                wrong += frame.pixels.iter().zip(picture(n)).filter(|(a, b)| a != b).count() as u64;
                n += 1;
            }
            Next::End => break,
            _ => {}
        }
    }
    wrong += frames - n;

    let bytes = std::fs::read(&path)?;
    let end = b"ElementDataFile = LOCAL\n";
    let at = bytes.windows(end.len()).position(|window| window == end).ok_or("the header has no end")? + end.len();
    let mut frame = vec![0; SIZE[0] as usize * SIZE[1] as usize];
    let mut inflate = Decompress::new(true);
    let began = own_s();
    for _ in 0..frames {
        let mut filled = 0;
        while filled < frame.len() {
            let (taken, made) = (inflate.total_in(), inflate.total_out());
            inflate.decompress(&bytes[at + taken as usize..], &mut frame[filled..], FlushDecompress::None)?;
            if (inflate.total_in(), inflate.total_out()) == (taken, made) {
                return Err("the stream ends early".into());
            }
            filled += (inflate.total_out() - made) as usize;
        }
    }
    let alone_s = own_s() - began;
    let plain = (frames * frame.len() as u64) as f64 / 1e6;
    let ratio = read_s / alone_s;
    println!(
        "zlib .igs.mha, {frames} frames: {:.0} MB/s read, {:.0} MB/s inflated alone: {ratio:.2} times the time (goal {RATIO}); {wrong} bytes wrong",
        plain / read_s,
        plain / alone_s
    );
    Ok(wrong)
}

fn volume(path: &Path, slices: u32) -> Result<u64, Box<dyn Error>> {
    let header = VolumeHeader::new([512, 512, slices], PixelType::F32);
    let slice: Vec<u8> = (0..512 * 512).flat_map(|n: u32| (n as f32 * 0.25).to_ne_bytes()).collect();
    let megabytes = (slice.len() * slices as usize) as f64 / 1e6;
    let (wall, began) = (Instant::now(), own_s());
    let mut writer = VolumeWriter::create(path, &header)?;
    (0..slices).try_for_each(|_| writer.write_all(&slice))?;
    let written = megabytes / (own_s() - began);
    writer.finish()?;
    let on_disk = megabytes / wall.elapsed().as_secs_f64();
    let mut reader = VolumeReader::open(path, &Limits::default())?;
    let (mut read_s, mut wrong, mut left) = (0.0, 0, slices);
    loop {
        let began = own_s();
        let next = reader.next_slice()?;
        read_s += own_s() - began;
        let Some(got) = next else { break };
        wrong += got.iter().zip(&slice).filter(|(a, b)| a != b).count() as u64;
        left -= 1;
    }
    wrong += u64::from(left);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    println!("{name:16}  {written:13.0}   {on_disk:17.0}   {:10.0}   {wrong} (goal {RATE} MB/s)", megabytes / read_s);
    std::fs::remove_file(path)?;
    Ok(wrong)
}
