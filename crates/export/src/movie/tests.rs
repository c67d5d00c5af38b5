use std::fs;
use std::io::BufReader;

use super::*;

const SIZE: [u32; 2] = [37, 22];
const COUNT: u64 = 9;

/// A grey slope on which a square moves; the pictures 4 and 5 are the same. `tint` colours it.
fn picture(number: u64, tint: u8) -> Arc<RgbImage> {
    let left = 3 * if number == 5 { 4 } else { number as u32 };
    Arc::new(RgbImage::from_fn(SIZE[0], SIZE[1], |x, y| {
        let grey = if (left..left + 5).contains(&x) && (4..11).contains(&y) { 240 } else { (2 * x + y) as u8 };
        image::Rgb([grey, grey.saturating_add(tint), grey])
    }))
}

fn written(name: &str, hz: f64, tint: u8) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let rate = Rate::new(hz, Format::of(&path).unwrap()).unwrap();
    let mut movie = Movie::create(&path, SIZE, rate).unwrap();
    (0..COUNT).for_each(|number| movie.push(picture(number, tint)).unwrap());
    assert_eq!(movie.pictures(), COUNT);
    let bytes = movie.finish().unwrap();
    assert_eq!(fs::metadata(&path).unwrap().len(), bytes);
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1, "no temporary file is left");
    (folder, path)
}

/// Puts a rectangle of pixels into a picture.
fn put(whole: &mut RgbImage, at: [u32; 2], [width, height]: [u32; 2], rgb: &[u8]) {
    let pixels = RgbImage::from_raw(width, height, rgb[..(3 * width * height) as usize].to_vec()).unwrap();
    image::imageops::replace(whole, &pixels, at[0].into(), at[1].into());
}

#[test]
fn apng_has_every_picture_to_the_bit_and_its_time() {
    for tint in [0, 30] {
        let (_folder, path) = written("m.apng", 29.97, tint);
        let mut reader = png::Decoder::new(BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
        let control = reader.info().animation_control.unwrap();
        assert_eq!((u64::from(control.num_frames), control.num_plays), (COUNT, 0));
        let mut whole = RgbImage::new(SIZE[0], SIZE[1]);
        for number in 0..COUNT {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            let frame = reader.info().frame_control.unwrap();
            assert_eq!((frame.delay_num, frame.delay_den), (1000, 29970));
            put(&mut whole, [frame.x_offset, frame.y_offset], [frame.width, frame.height], &pixels);
            assert!(whole == *picture(number, tint), "picture {number}");
            if number == 5 {
                assert_eq!([frame.width, frame.height], [1, 1], "nothing has changed");
            } else if number > 0 {
                assert!(frame.height == 7 && frame.width <= 11, "only the square has changed");
            }
        }
    }
}

#[test]
fn gif_has_grey_pictures_to_the_bit_and_its_times_add_up() {
    for (tint, most) in [(0, 0), (30, 24)] {
        let (_folder, path) = written("m.gif", 30.0, tint);
        let mut options = ::gif::DecodeOptions::new();
        options.set_color_output(::gif::ColorOutput::RGBA);
        let mut reader = options.read_info(fs::File::open(path).unwrap()).unwrap();
        assert_eq!([reader.width(), reader.height()].map(u32::from), SIZE);
        let (mut whole, mut hundredths, mut count) = (RgbImage::new(SIZE[0], SIZE[1]), 0, 0);
        while let Some(frame) = reader.read_next_frame().unwrap() {
            let rgb: Vec<u8> = frame.buffer.chunks_exact(4).flat_map(|pixel| &pixel[..3]).copied().collect();
            let size = [frame.width, frame.height].map(u32::from);
            put(&mut whole, [frame.left, frame.top].map(u32::from), size, &rgb);
            let truth = picture(count, tint);
            let worst = whole.as_raw().iter().zip(truth.as_raw()).map(|(a, b)| a.abs_diff(*b)).max().unwrap();
            assert!(worst <= most, "picture {count}: off by {worst}");
            count += 1;
            hundredths += u64::from(frame.delay);
            assert_eq!(hundredths, (100 * count).div_ceil(30), "picture {count} ends");
        }
        assert_eq!(count, COUNT);
    }
}

#[test]
fn avi_has_every_picture_by_its_index() {
    let (_folder, path) = written("m.avi", 12.5, 30);
    let bytes = fs::read(path).unwrap();
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!((&bytes[..4], &bytes[8..16]), (&b"RIFF"[..], &b"AVI LIST"[..]));
    assert_eq!(word(4) as usize, bytes.len() - 8);
    assert_eq!((word(32), word(48)), (80_000, COUNT as u32), "µs a picture, and their number");
    assert_eq!((word(128), word(132), word(140)), (1000, 12_500, COUNT as u32), "the stream's rate and length");
    let list = 212;
    assert_eq!((&bytes[list..list + 4], &bytes[list + 8..list + 12]), (&b"LIST"[..], &b"movi"[..]));
    let index = list + 8 + word(list + 4) as usize;
    assert_eq!((&bytes[index..index + 4], word(index + 4)), (&b"idx1"[..], 16 * COUNT as u32));
    assert_eq!(index + 8 + 16 * COUNT as usize, bytes.len());
    for number in 0..COUNT {
        let entry = index + 8 + 16 * number as usize;
        let (at, length) = (list + 8 + word(entry + 8) as usize, word(entry + 12) as usize);
        assert_eq!((&bytes[at..at + 4], word(at + 4) as usize), (&b"00dc"[..], length));
        assert_eq!(at % 2, 0);
        let jpeg = &bytes[at + 8..at + 8 + length];
        let decoded =
            zune_jpeg::JpegDecoder::new(zune_jpeg::zune_core::bytestream::ZCursor::new(jpeg)).decode().unwrap();
        let truth = picture(number, 30);
        let squares = decoded.iter().zip(truth.as_raw()).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2));
        let rms = (squares.sum::<f64>() / decoded.len() as f64).sqrt();
        assert!(rms < 6.0, "picture {number}: {rms} grey levels");
    }
}

#[test]
fn unfinished_movie_leaves_earlier_file() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["m.apng", "m.gif", "m.avi"] {
        let path = folder.path().join(name);
        fs::write(&path, "before").unwrap();
        let rate = Rate::new(10.0, Format::of(&path).unwrap()).unwrap();
        let mut movie = Movie::create(&path, SIZE, rate).unwrap();
        movie.push(picture(0, 0)).unwrap();
        drop(movie);
        assert!(matches!(Movie::create(&path, SIZE, rate).unwrap().finish(), Err(ExportError::NoPicture { .. })));
        assert_eq!(fs::read_to_string(&path).unwrap(), "before");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
}

#[test]
fn impossible_movies_are_refused() {
    for (hz, format, most) in
        [(0.05, Format::Apng, 60), (60.5, Format::Avi, 60), (51.0, Format::Gif, 50), (f64::NAN, Format::Gif, 50)]
    {
        assert!(matches!(Rate::new(hz, format), Err(ExportError::MovieRate { most_hz, .. }) if most_hz == most));
    }
    let rate = Rate::new(25.0, Format::Avi).unwrap();
    assert!(matches!(Movie::create(Path::new("m.mp4"), SIZE, rate), Err(ExportError::MovieName { .. })));
    let folder = tempfile::tempdir().unwrap();
    assert!(matches!(Movie::create(&folder.path().join("none/m.avi"), SIZE, rate), Err(ExportError::Write { .. })));
    // 65536 pixels along an edge are one more than these files count.
    for name in ["m.gif", "m.avi"] {
        let path = folder.path().join(name);
        let mut movie = Movie::create(&path, [65536, 1], rate).unwrap();
        let pushed = (0..8).try_for_each(|_| movie.push(Arc::new(RgbImage::new(65536, 1))));
        let failed = pushed.and_then(|()| movie.finish().map(drop)).unwrap_err();
        assert!(failed.to_string().contains("65535 pixels along an edge"), "{failed}");
        assert!(!path.exists());
    }
}

#[test]
fn pictures_start_at_multiples_of_their_duration() {
    let rate = Rate::new(29.97, Format::Avi).unwrap();
    assert_eq!(rate.hz(), 29.97);
    assert_eq!([0, 1, 2997].map(|number| rate.start_ns(number)), [0, 33_366_700, 100_000_000_000]);
}
