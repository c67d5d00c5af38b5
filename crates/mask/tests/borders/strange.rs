//! Frames without a picture that could be found, and pictures of unknown shapes: the whole frame
//! counts, with a reason.

use mask::{AutoMask, MaskFound, MaskShape, UnsureReason};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sonoweave_core::region::{ClipRect, Fan};
use sonoweave_core::slice::{Image, Pixels};

use crate::find;
use crate::painter::{Overlays, Scene, Truth};
use crate::truth::error_px;

const EVERYTHING: Overlays = Overlays { text: true, logo: true, ruler: true, wedge: true, ecg: true, clock: true };

/// A plain scene of an analogue grabber.
fn scene(truth: Truth) -> Scene {
    Scene {
        size: [640, 480],
        truth,
        level: 14.0,
        noise: 2.5,
        gain: 60.0,
        dark: 2,
        frozen: false,
        interlaced: false,
        blurred: true,
        blanking: 0,
        overlays: Overlays::default(),
        seed: 5,
    }
}

fn assert_whole(found: &MaskFound, name: &str) {
    assert!(found.mask.is_full() && !found.recognised, "{name}: {found}");
    assert_eq!(found.shape, MaskShape::Whole, "{name}");
    assert!(!found.reasons.is_empty(), "{name}");
}

/// Applies a change to each frame's bytes.
fn changed(frames: &[Image], change: impl Fn(&[u8], usize) -> Vec<u8>) -> Vec<Image> {
    let width = frames[0].width() as usize;
    let frame = |image: &Image| {
        let Pixels::U8(pixels) = image.pixels() else { panic!("8 bits") };
        let bytes = change(pixels, width);
        let height = bytes.len() / image.width() as usize;
        Image::new(image.width(), u32::try_from(height).unwrap(), Pixels::U8(bytes.into()))
    };
    frames.iter().map(frame).collect()
}

#[test]
fn noise_black_and_text_alone_are_whole_frame() {
    for (noise, level) in [(0.0, 0.0), (4.0, 0.0), (1.0, 16.0), (4.0, 24.0)] {
        let empty = Scene { noise, level, ..scene(Truth::Nothing) };
        assert_whole(&find(&empty.frames(8)), &format!("{noise} {level}"));
        let text = Scene { overlays: EVERYTHING, ..empty };
        assert_whole(&find(&text.frames(8)), &format!("text alone {noise} {level}"));
    }
}

#[test]
fn picture_of_full_frame_is_whole_frame() {
    // Smooth regions with straight and round borders everywhere, as in a photograph.
    let mut rng = ChaCha8Rng::seed_from_u64(9);
    for seed in 0..6 {
        let full = Scene { seed, ..scene(Truth::Everything) };
        let patches: Vec<[usize; 5]> = (0..12)
            .map(|_| {
                let (u, v) = (rng.random_range(0..560), rng.random_range(0..400));
                [u, v, rng.random_range(40..300), rng.random_range(40..240), rng.random_range(0..200)]
            })
            .collect();
        let frames = changed(&full.frames(8), |pixels, width| {
            let shade = |at: usize| {
                let (u, v) = (at % width, at / width);
                let inside =
                    patches.iter().rev().find(|[x, y, w, h, _]| (*x..x + w).contains(&u) && (*y..y + h).contains(&v));
                inside.map_or(40 + u / 8, |patch| patch[4])
            };
            pixels.iter().enumerate().map(|(at, p)| (usize::from(*p) / 4 + shade(at)).min(255) as u8).collect()
        });
        let found = find(&frames);
        assert!(found.mask.is_full(), "{seed}: {found}");
    }
    let found = find(&scene(Truth::Everything).frames(8));
    assert!(found.mask.is_full(), "{found}");
}

#[test]
fn upside_down_and_sideways_fans_are_not_accepted() {
    let fan = Fan::new([240.0, -30.0], [80.0, 450.0], [-27.0, 27.0]).unwrap();
    let upright = Scene { size: [480, 480], ..scene(Truth::Fan(fan)) }.frames(8);
    assert!(find(&upright).recognised);
    let flipped = changed(&upright, |pixels, _| pixels.iter().rev().copied().collect());
    assert_whole(&find(&flipped), "upside down");
    let turned = changed(&upright, |pixels, width| {
        (0..pixels.len()).map(|at| pixels[(at % width) * width + at / width]).collect()
    });
    assert_whole(&find(&turned), "sideways");
}

#[test]
fn two_pictures_side_by_side_are_whole_frame() {
    let left = scene(Truth::Rectangle(ClipRect::new(30, 60, 260, 360).unwrap())).frames(8);
    let both = changed(&left, |pixels, width| {
        let mirrored = |at: usize| pixels[at - at % width + (width - 1 - at % width)];
        (0..pixels.len()).map(|at| pixels[at].max(mirrored(at))).collect()
    });
    let found = find(&both);
    assert_whole(&found, "two");
    assert!(found.reasons.iter().any(|reason| matches!(reason, UnsureReason::Outside { .. })), "{found}");
}

#[test]
fn picture_that_fades_out_has_no_edge_there() {
    let rect = ClipRect::new(100, 60, 440, 380).unwrap();
    let frames = Scene { dark: 0, noise: 0.5, ..scene(Truth::Rectangle(rect)) }.frames(8);
    for rows in [25.0_f32, 45.0, 60.0] {
        let faded = changed(&frames, |pixels, width| {
            let fade = |at: usize| (-((at / width) as f32 - 60.0).max(0.0) / rows).exp();
            pixels
                .iter()
                .enumerate()
                .map(|(at, p)| (14.0 + (f32::from(*p) - 14.0) * fade(at)).round().max(0.0) as u8)
                .collect()
        });
        assert_whole(&find(&faded), &format!("faded to a third in {rows} rows"));
    }
}

#[test]
fn small_picture_is_whole_frame() {
    let small = scene(Truth::Rectangle(ClipRect::new(250, 180, 120, 100).unwrap()));
    let found = find(&small.frames(8));
    assert_whole(&found, "small");
    assert!(matches!(found.reasons[..], [UnsureReason::Small { .. }]), "{found}");
}

#[test]
fn one_frame_is_enough_for_a_plain_picture() {
    let rect = Scene { noise: 1.0, ..scene(Truth::Rectangle(ClipRect::new(80, 50, 400, 380).unwrap())) };
    let mut auto = AutoMask::new(640, 480);
    assert!(auto.push(&rect.frames(1)[0]).is_none());
    let found = auto.finish();
    assert!(error_px(&rect, found.shape).unwrap() <= 2.0, "{found}");
    // It begins again.
    assert_eq!(find(&rect.frames(8)), {
        let frames = rect.frames(8);
        frames.iter().find_map(|frame| auto.push(frame)).unwrap()
    });
}

#[test]
fn deeper_pixels_give_the_same_picture() {
    let scene = scene(Truth::Fan(Fan::new([320.0, -30.0], [80.0, 450.0], [-30.0, 31.0]).unwrap()));
    let frames = scene.frames(8);
    let found = find(&frames);
    assert!(error_px(&scene, found.shape).unwrap() <= 2.0);
    for depth in 0..2 {
        let converted: Vec<Image> = frames
            .iter()
            .map(|image| {
                let Pixels::U8(pixels) = image.pixels() else { panic!("8 bits") };
                let pixels = match depth {
                    0 => Pixels::U16(pixels.iter().map(|p| u16::from(*p) * 16).collect()),
                    _ => Pixels::F32(pixels.iter().map(|p| f32::from(*p) / 255.0).collect()),
                };
                Image::new(image.width(), image.height(), pixels)
            })
            .collect();
        let found = find(&converted);
        assert!(error_px(&scene, found.shape).unwrap() <= 2.0, "{depth}: {found}");
    }
}

#[test]
fn zero_border_keeps_its_mask_and_gets_a_shape() {
    let fan = Fan::new([320.0, -30.0], [80.0, 450.0], [-30.0, 31.0]).unwrap();
    let scene = Scene { level: 0.0, noise: 0.0, blurred: false, ..scene(Truth::Fan(fan)) };
    let frames = scene.frames(8);
    let found = find(&frames);
    let mut earlier = AutoMask::of_zero_borders(640, 480);
    let before = frames.iter().find_map(|frame| earlier.push(frame)).unwrap();
    // The shape also tells where the beams come from.
    let MaskShape::Fan(shape) = found.shape else { panic!("no fan: {found}") };
    let same_pixels = (*before.mask).clone().with_beams_of(&shape);
    assert!(*found.mask == same_pixels && found.recognised, "{found}");
    assert_eq!((before.shape, before.mask.apex_px()), (MaskShape::Outline, None));
    assert!(error_px(&scene, found.shape).unwrap() <= 2.0, "{found}");
}

#[test]
fn blanking_around_a_noisy_border_is_not_the_border() {
    // A picture of 4:3 in frames of 16:9, with black bars of exact zeros.
    let scene = Scene {
        size: [1280, 720],
        blanking: 160,
        level: 16.0,
        ..scene(Truth::Rectangle(ClipRect::new(320, 80, 600, 560).unwrap()))
    };
    let found = find(&scene.frames(8));
    assert!(error_px(&scene, found.shape).unwrap() <= 2.0, "{found}");
    assert!(found.border.is_some_and(|border| (border.level - 16.0).abs() < 1.0 && (border.noise - 2.5).abs() < 0.6));
}
