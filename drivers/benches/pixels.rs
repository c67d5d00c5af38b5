//! Measures conversion of video to frames, on one core: `make bench`, or
//! `cargo bench -p sonoweave-drivers --bench pixels -- [--quick]`.
//!
//! Frames of 1920×1080 pixels in every format, grey and in colour, in their usual range. Each
//! time is printed with the largest error against the equations in f64, in levels, over all
//! pixels. An error that is too large fails the run; a missed goal is only printed.
#![allow(clippy::print_stdout, reason = "a bench speaks to its user")]

use std::error::Error;
use std::hint::black_box;
use std::process::ExitCode;
use std::time::Instant;

use drivers::grabber::pixels::reference::reference;
use drivers::grabber::pixels::{Colour, Converter, Layout, Matrix, PixelFormat, Range, Rows};

const SIZE: [u32; 2] = [1920, 1080];
/// Goals: GB of video per second; JPEG frames per second.
const GOAL_GB: f64 = 1.0;
const GOAL_JPEG: f64 = 60.0;

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let rounds = if quick { 3 } else { 60 };
    println!("format range   picture   ms a frame   frames/s   GB/s of video   GB/s in all   largest error");
    let mut right = true;
    for format in PixelFormat::ALL {
        for colour in [Colour::Grey, Colour::Rgb] {
            for range in [Range::Full, Range::Limited] {
                // Grey and RGB usually have full range, video limited range; JPEG always has
                // full range.
                let usual =
                    (range == Range::Full) == (format.is_grey() || format.is_rgb() || format == PixelFormat::Mjpg);
                if usual {
                    right &= measure(format, range, colour, rounds)?;
                }
            }
        }
    }
    Ok(if right { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn measure(format: PixelFormat, range: Range, colour: Colour, rounds: usize) -> Result<bool, Box<dyn Error>> {
    let [width, _] = SIZE;
    let row_bytes = format.row_bytes(width);
    let layout = Layout { format, size: SIZE, row_bytes, range, matrix: Matrix::Bt709 };
    let mut converter = Converter::new(layout, Rows::WHOLE, colour)?;
    let scene = scene();
    let video = if format == PixelFormat::Mjpg { jpeg(&scene)? } else { noise(converter.video_bytes()) };
    let mut picture = vec![0; converter.picture_bytes()];
    let mut times = Vec::new();
    for _ in 0..rounds {
        let start = Instant::now();
        converter.convert(black_box(&video), &mut picture)?;
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    // Other processes lengthen times, so one of the shortest is taken as the conversion time.
    let time = times[times.len() / 10];

    let channels = colour.channels();
    let expected = if format == PixelFormat::Mjpg {
        scene_levels(&scene)
    } else {
        reference(&layout, Rows::WHOLE, colour, &video)
    };
    let error = picture
        .chunks_exact(channels)
        .zip(&expected)
        .flat_map(|(got, want)| got.iter().zip(want).map(|(&got, want)| (f64::from(got) - want).abs()))
        .fold(0.0, f64::max);
    // Errors: half a level of rounding, and the coefficients'. For JPEG, the loss of its
    // encoder at quality 90.
    let (bound, met) = if format == PixelFormat::Mjpg {
        (20.0, 1.0 / time >= GOAL_JPEG)
    } else {
        (0.55, video.len() as f64 / time / 1e9 >= GOAL_GB)
    };
    let gb = |bytes: usize| bytes as f64 / time / 1e9;
    println!(
        "{:<6} {:<7} {:<9} {:>10.3} {:>10.0} {:>15.2} {:>13.2} {:>15.3}{}{}",
        format.to_string(),
        format!("{range:?}").to_lowercase(),
        format!("{colour:?}").to_lowercase(),
        time * 1e3,
        1.0 / time,
        gb(video.len()),
        gb(video.len() + picture.len()),
        error,
        if met { "" } else { "   below the goal" },
        if error <= bound { "" } else { "   WRONG" },
    );
    Ok(error <= bound)
}

/// Returns deterministic bytes: every level occurs at every position.
fn noise(bytes: usize) -> Vec<u8> {
    let mut state = 0x9e37_79b9_7f4a_7c15_u64;
    (0..bytes)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect()
}

/// Returns a frame as demanding for JPEG as ultrasound: speckle of a few pixels in smooth
/// shades, within a fan on black.
fn scene() -> Vec<u8> {
    let [width, height] = SIZE;
    let grain = noise((width * height) as usize);
    let mut pixels = Vec::with_capacity(grain.len());
    for y in 0..height {
        for x in 0..width {
            let (dx, dy) = (f64::from(x) - 960.0, f64::from(y) + 200.0);
            let inside = dx.abs() < 0.6 * dy && dx.hypot(dy) < 1250.0 && dx.hypot(dy) > 350.0;
            let shade = 90.0 + 60.0 * (dx / 90.0).sin() * (dy / 70.0).cos();
            let speckle = 0.25 * f64::from(grain[((y / 3) * width + x / 4) as usize]);
            pixels.push(if inside { (shade + speckle).clamp(0.0, 255.0) as u8 } else { 0 });
        }
    }
    // Averages neighbours, because the speckle has sharper edges than any transducer produces.
    let at = |n: usize| u32::from(pixels[n.min(pixels.len() - 1)]);
    let w = width as usize;
    (0..pixels.len()).map(|n| ((at(n) + at(n + 1) + at(n + w) + at(n + w + 1)) / 4) as u8).collect()
}

fn jpeg(scene: &[u8]) -> Result<Vec<u8>, Box<dyn Error>> {
    let rgb: Vec<u8> = scene.iter().flat_map(|&grey| [grey; 3]).collect();
    let mut out = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut out, 90);
    encoder.set_sampling_factor(jpeg_encoder::SamplingFactor::F_2_1);
    encoder.encode(&rgb, SIZE[0].try_into()?, SIZE[1].try_into()?, jpeg_encoder::ColorType::Rgb)?;
    Ok(out)
}

fn scene_levels(scene: &[u8]) -> Vec<[f64; 3]> {
    scene.iter().map(|&grey| [f64::from(grey); 3]).collect()
}
