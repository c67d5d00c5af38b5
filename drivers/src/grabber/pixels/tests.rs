use proptest::prelude::*;

use super::reference::reference;
use super::*;

const SCANS: [Scan; 4] = [
    Scan::Progressive,
    Scan::Interlaced,
    Scan::Sequential { first: Field::Top },
    Scan::Sequential { first: Field::Bottom },
];
const TAKES: [Take; 3] = [Take::All, Take::Field(Field::Top), Take::Field(Field::Bottom)];

fn any_rows() -> impl Strategy<Value = Rows> {
    (0..SCANS.len(), 0..TAKES.len()).prop_map(|(scan, take)| Rows { scan: SCANS[scan], take: TAKES[take] })
}

fn any_kind() -> impl Strategy<Value = (PixelFormat, Range, Matrix, Colour)> {
    (0..PixelFormat::ALL.len(), any::<[bool; 3]>()).prop_map(|(format, [limited, hd, rgb])| {
        (
            PixelFormat::ALL[format],
            if limited { Range::Limited } else { Range::Full },
            if hd { Matrix::Bt709 } else { Matrix::Bt601 },
            if rgb { Colour::Rgb } else { Colour::Grey },
        )
    })
}

/// Returns reproducible pseudorandom bytes.
fn noise(seed: u64, bytes: usize) -> Vec<u8> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    (0..bytes)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 32) as u8
        })
        .collect()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    /// Every format, range, matrix, order of lines and choice of field; odd sizes, padded rows,
    /// oversized buffers.
    #[test]
    fn conversion_matches_rounded_equation(
        (format, range, matrix, colour) in any_kind(),
        rows in any_rows(),
        width in 1_u32..70,
        height in 2_u32..12,
        padding in 0_u32..9,
        longer in 0_usize..3,
        seed in any::<u64>(),
    ) {
        prop_assume!(format != PixelFormat::Mjpg);
        // Colour planes have rows of half the length, which must be a whole number of bytes.
        let planar = matches!(format, PixelFormat::I420 | PixelFormat::Yv12 | PixelFormat::Nv12);
        let row_bytes = format.row_bytes(width + if planar { width % 2 } else { 0 }) + padding;
        let layout = Layout { format, size: [width, height], row_bytes, range, matrix };
        let mut converter = Converter::new(layout, rows, colour).unwrap();
        let video = noise(seed, converter.video_bytes() + longer);
        let mut picture = vec![0; converter.picture_bytes()];
        converter.convert(&video, &mut picture).unwrap();
        let expected = reference(&layout, rows, colour, &video);
        let channels = colour.channels();
        prop_assert_eq!(picture.len(), expected.len() * channels);
        prop_assert_eq!(converter.size(), [width, (expected.len() / width as usize) as u32]);
        // Limited grey from RGB is rounded before it is stretched.
        let twice = format.is_rgb() && colour == Colour::Grey && range == Range::Limited;
        let bound = if twice { 0.5 + 0.5 * 255.0 / 219.0 } else { 0.5 } + 1.0 / 32.0;
        for (n, (got, want)) in picture.chunks_exact(channels).zip(&expected).enumerate() {
            for (c, &value) in got.iter().enumerate() {
                let off = (f64::from(value) - want[c]).abs();
                prop_assert!(off <= bound, "pixel {n}, channel {c}: {value} where {} is right", want[c]);
            }
        }
        // One byte less is refused.
        let short = &video[..converter.video_bytes() - 1];
        prop_assert_eq!(
            converter.convert(short, &mut picture),
            Err(Refusal::Short { given: short.len(), needed: short.len() + 1 })
        );
    }

    /// Any layout and any bytes give a frame or a refusal.
    #[test]
    fn any_layout_and_bytes_do_not_panic(
        (format, range, matrix, colour) in any_kind(),
        rows in any_rows(),
        size in prop_oneof![any::<[u32; 2]>(), [0_u32..40, 0_u32..40]],
        row_bytes in prop_oneof![any::<u32>(), 0_u32..130],
        video in proptest::collection::vec(any::<u8>(), 0..4000),
    ) {
        let layout = Layout { format, size, row_bytes, range, matrix };
        if let Ok(mut converter) = Converter::new(layout, rows, colour)
            && converter.picture_bytes() < 1 << 20
        {
            let mut picture = vec![0; converter.picture_bytes()];
            let _ = converter.convert(&video, &mut picture);
        }
    }
}

#[test]
fn format_names_match_kernel_and_unknown_give_none() {
    for format in PixelFormat::ALL {
        assert_eq!(PixelFormat::from_fourcc(format.fourcc()), Some(format));
    }
    assert_eq!(PixelFormat::from_fourcc(*b"JPEG"), Some(PixelFormat::Mjpg));
    assert_eq!(PixelFormat::from_fourcc(*b"H264"), None);
    assert_eq!(PixelFormat::Y10.to_string(), "Y10");
    assert_eq!(name_of([b'A', 0, 0xff, b'B']), "A\\x00\\xffB");
}

/// The ends and middles of both ranges, calculated by hand from the standards.
#[test]
fn known_colours_convert_as_in_standards() {
    let one = |format, range, matrix, colour, video: &[u8]| {
        let layout = Layout { format, size: [2, 2], row_bytes: 6, range, matrix };
        let mut converter = Converter::new(layout, Rows::WHOLE, colour).unwrap();
        let mut picture = vec![0; converter.picture_bytes()];
        converter.convert(video, &mut picture).unwrap();
        picture[..colour.channels()].to_vec()
    };
    use PixelFormat::{Rgb24, Yuyv};
    let yuv = |y: u8, u: u8, v: u8| [y, u, y, v, 0, 0].repeat(2);
    let rgb = |range, matrix, [y, u, v]: [u8; 3]| one(Yuyv, range, matrix, Colour::Rgb, &yuv(y, u, v));
    // White, black, and below black.
    assert_eq!(rgb(Range::Limited, Matrix::Bt601, [235, 128, 128]), [255, 255, 255]);
    assert_eq!(rgb(Range::Limited, Matrix::Bt601, [16, 128, 128]), [0, 0, 0]);
    assert_eq!(rgb(Range::Limited, Matrix::Bt601, [0, 128, 128]), [0, 0, 0]);
    assert_eq!(rgb(Range::Full, Matrix::Bt709, [255, 128, 128]), [255, 255, 255]);
    // The pure red of colour bars: Y'CbCr 81 90 240 (BT.601), 63 102 240 (BT.709), rounded as in
    // these standards.
    assert_eq!(rgb(Range::Limited, Matrix::Bt601, [81, 90, 240]), [254, 0, 0]);
    assert_eq!(rgb(Range::Limited, Matrix::Bt709, [63, 102, 240]), [255, 1, 0]);
    // Grey of pure green: 0.587 and 0.7152 of white.
    let green = [0, 255, 0].repeat(4);
    assert_eq!(one(Rgb24, Range::Full, Matrix::Bt601, Colour::Grey, &green), [150]);
    assert_eq!(one(Rgb24, Range::Full, Matrix::Bt709, Colour::Grey, &green), [182]);
    // Grey is unchanged, whatever the weights.
    for level in 0..=255 {
        let grey = [level; 12];
        assert_eq!(one(Rgb24, Range::Full, Matrix::Bt709, Colour::Grey, &grey), [level]);
        assert_eq!(one(Rgb24, Range::Full, Matrix::Bt601, Colour::Grey, &grey), [level]);
    }
}

fn encoded(width: u16, height: u16, rgb: bool, sampling: jpeg_encoder::SamplingFactor) -> (Vec<u8>, Vec<u8>) {
    let pixel = |x: u32, y: u32| {
        let wave = |a: f64, b: f64| (127.5 + 120.0 * (f64::from(x) * a + f64::from(y) * b).sin()).round() as u8;
        if rgb { vec![wave(0.03, 0.05), wave(0.04, -0.02), wave(-0.01, 0.06)] } else { vec![wave(0.03, 0.05)] }
    };
    let pixels: Vec<u8> =
        (0..u32::from(height)).flat_map(|y| (0..u32::from(width)).flat_map(move |x| pixel(x, y))).collect();
    let mut jpeg = Vec::new();
    let mut encoder = jpeg_encoder::Encoder::new(&mut jpeg, 95);
    encoder.set_sampling_factor(sampling);
    let kind = if rgb { jpeg_encoder::ColorType::Rgb } else { jpeg_encoder::ColorType::Luma };
    encoder.encode(&pixels, width, height, kind).unwrap();
    (pixels, jpeg)
}

/// Returns the JPEG without the segments of `marker`.
fn without(jpeg: &[u8], marker: u8) -> Vec<u8> {
    let mut out = jpeg[..2].to_vec();
    let mut at = 2;
    while jpeg[at + 1] != 0xda {
        let end = at + 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
        if jpeg[at + 1] != marker {
            out.extend_from_slice(&jpeg[at..end]);
        }
        at = end;
    }
    out.extend_from_slice(&jpeg[at..]);
    out
}

fn mjpg(size: [u32; 2], rows: Rows, colour: Colour) -> Converter {
    let layout = Layout { format: PixelFormat::Mjpg, size, row_bytes: 0, range: Range::Full, matrix: Matrix::Bt601 };
    Converter::new(layout, rows, colour).unwrap()
}

#[test]
fn jpeg_decodes_with_and_without_tables_and_by_field() {
    use jpeg_encoder::SamplingFactor::{F_1_1, F_2_1, F_2_2};
    for (rgb, sampling) in [(true, F_1_1), (true, F_2_1), (true, F_2_2), (false, F_1_1)] {
        let (pixels, jpeg) = encoded(120, 80, rgb, sampling);
        let bare = without(&jpeg, 0xc4);
        assert!(bare.len() < jpeg.len() - 200, "the encoder wrote no tables");
        for colour in [Colour::Grey, Colour::Rgb] {
            let mut converter = mjpg([120, 80], Rows::WHOLE, colour);
            let mut picture = vec![0; converter.picture_bytes()];
            converter.convert(&jpeg, &mut picture).unwrap();
            let mut worst = 0.0_f64;
            for (n, got) in picture.chunks_exact(colour.channels()).enumerate() {
                let want = match (rgb, colour) {
                    (true, Colour::Rgb) => pixels[3 * n..3 * n + 3].iter().map(|&v| f64::from(v)).collect(),
                    (true, Colour::Grey) => {
                        let [r, g, b] = [0, 1, 2].map(|c| f64::from(pixels[3 * n + c]));
                        vec![0.299 * r + 0.587 * g + 0.114 * b]
                    }
                    (false, _) => vec![f64::from(pixels[n]); colour.channels()],
                };
                for (&got, want) in got.iter().zip(want) {
                    worst = worst.max((f64::from(got) - want).abs());
                }
            }
            assert!(worst < 9.0, "{sampling:?} {colour:?}: {worst}");
            let mut again = vec![0; picture.len()];
            converter.convert(&bare, &mut again).unwrap();
            assert_eq!(again, picture, "without tables");
            // Grabbers deliver buffers with extra bytes after the JPEG.
            converter.convert(&[&bare[..], &[0; 700]].concat(), &mut again).unwrap();
            assert_eq!(again, picture, "with padding");
            for field in [Field::Top, Field::Bottom] {
                let rows = Rows { scan: Scan::Interlaced, take: Take::Field(field) };
                let mut half = mjpg([120, 80], rows, colour);
                let mut lines = vec![0; half.picture_bytes()];
                half.convert(&jpeg, &mut lines).unwrap();
                let stride = 120 * colour.channels();
                for (k, line) in lines.chunks_exact(stride).enumerate() {
                    let n = 2 * k + usize::from(field == Field::Bottom);
                    assert_eq!(line, &picture[n * stride..(n + 1) * stride]);
                }
            }
        }
    }
}

/// A flat grey row has the fewest bytes: fewer than a decoder reads ahead.
#[test]
fn flat_jpeg_decodes_at_any_width() {
    use jpeg_encoder::SamplingFactor::{F_1_1, F_2_1, F_2_2};
    for sampling in [F_1_1, F_2_1, F_2_2] {
        for width in (1..100).chain([127, 128, 720, 1920]) {
            let mut jpeg = Vec::new();
            let mut encoder = jpeg_encoder::Encoder::new(&mut jpeg, 60);
            encoder.set_sampling_factor(sampling);
            let pixels = vec![77; 3 * 40 * usize::from(width)];
            encoder.encode(&pixels, width, 40, jpeg_encoder::ColorType::Rgb).unwrap();
            let mut converter = mjpg([width.into(), 40], Rows::WHOLE, Colour::Rgb);
            let mut picture = vec![0; pixels.len()];
            converter.convert(&jpeg, &mut picture).unwrap_or_else(|refusal| panic!("{width} {sampling:?}: {refusal}"));
            assert!(picture.iter().all(|value| value.abs_diff(77) <= 2), "{width} {sampling:?}");
        }
    }
}

#[test]
fn truncated_jpeg_is_refused_with_reason() {
    let (_, jpeg) = encoded(96, 64, true, jpeg_encoder::SamplingFactor::F_2_1);
    let mut converter = mjpg([96, 64], Rows::WHOLE, Colour::Grey);
    let mut picture = vec![0; converter.picture_bytes()];
    let mut refused = 0;
    for cut in 0..jpeg.len() - 2 {
        let broken = converter.convert(&jpeg[..cut], &mut picture);
        let Err(Refusal::Jpeg(problem)) = &broken else { panic!("cut at {cut} of {}: {broken:?}", jpeg.len()) };
        assert!(!problem.is_empty() && !problem.contains('\n'));
        // Data was lost in transmission, but the next packet brought the end marker.
        let closed = [&jpeg[..cut], &[0xff, 0xd9], &[0; 9]].concat();
        refused += usize::from(converter.convert(&closed, &mut picture).is_err());
    }
    assert!(refused >= jpeg.len() * 9 / 10, "{refused} of {} cut pictures with an end refused", jpeg.len());
    let other = mjpg([96, 66], Rows::WHOLE, Colour::Grey).convert(&jpeg, &mut vec![0; 96 * 66]).unwrap_err();
    assert_eq!(other.to_string(), "the frame is not a complete JPEG image: it has 96×64 pixels instead of 96×66");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    /// A real JPEG with changed bytes, with or without its tables.
    #[test]
    fn changed_jpeg_does_not_panic(
        changes in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..12),
        rgb in any::<bool>(),
        bare in any::<bool>(),
    ) {
        let (_, mut jpeg) = encoded(48, 32, true, jpeg_encoder::SamplingFactor::F_2_2);
        if bare {
            jpeg = without(&jpeg, 0xc4);
        }
        for (at, value) in changes {
            let n = at.index(jpeg.len());
            jpeg[n] = value;
        }
        let mut converter = mjpg([48, 32], Rows::WHOLE, if rgb { Colour::Rgb } else { Colour::Grey });
        let mut picture = vec![0; converter.picture_bytes()];
        let _ = converter.convert(&jpeg, &mut picture);
    }
}
