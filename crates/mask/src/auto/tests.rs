use std::sync::Arc;

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use sonoweave_core::region::Fan;
use sonoweave_core::slice::Pixels;

use super::*;
use crate::UnsureReason;

const W: u32 = 820;
const H: u32 = 616;

fn image(width: u32, height: u32, mut pixel: impl FnMut(u32, u32) -> u8) -> Image {
    let pixels: Vec<u8> = (0..height).flat_map(|v| (0..width).map(move |u| (u, v))).map(|(u, v)| pixel(u, v)).collect();
    Image::new(width, height, Pixels::U8(Arc::from(pixels)))
}

/// Speckle that is zero in a tenth of the pixels of each frame.
fn speckle(rng: &mut impl Rng) -> u8 {
    if rng.random_bool(0.1) { 0 } else { rng.random_range(1..=255) }
}

fn found(frames: u8, mut frame: impl FnMut(u8) -> Image) -> MaskFound {
    let mut auto = None;
    for index in 0..frames {
        let image = frame(index);
        let auto = auto.get_or_insert_with(|| AutoMask::new(image.width(), image.height()));
        if let Some(found) = auto.push(&image) {
            assert_eq!(index + 1, FRAMES);
            return found;
        }
    }
    auto.unwrap().finish()
}

#[test]
fn linear_image_found_to_the_pixel() {
    for frames in [8, 5, 1] {
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let found = found(frames, |_| {
            image(W, H, |u, v| {
                if (187..=631).contains(&u) && (12..=601).contains(&v) {
                    speckle(&mut rng).max(u8::from(frames == 1))
                } else {
                    0
                }
            })
        });
        assert!(found.recognised && found.reasons.is_empty());
        assert_eq!(found.mask.area(), (631 - 187 + 1) * (601 - 12 + 1), "{frames}");
        assert!(found.mask.contains(187, 12) && found.mask.contains(631, 601));
    }
}

#[test]
fn curvilinear_image_keeps_concave_top() {
    let fan = Fan::new([400.0, -60.0], [120.0, 600.0], [-38.0, 38.0]).unwrap();
    let truth = Mask::fan(W, H, &fan);
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let found = found(8, |_| image(W, H, |u, v| if truth.contains(u, v) { speckle(&mut rng) } else { 0 }));
    assert!(found.recognised, "{:?}", found.reasons);
    assert_eq!(found.mask.intersect(&truth).area(), truth.area(), "nothing of the picture is lost");
    assert!(found.mask.area() < truth.area() * 1005 / 1000, "{} {}", found.mask.area(), truth.area());
    assert!(!found.mask.contains(400, 55), "above the transducer's face");
}

#[test]
fn text_beside_image_does_not_widen_mask() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let found = found(8, |_| {
        image(W, H, |u, v| {
            if (200..600).contains(&u) && (50..550).contains(&v) {
                speckle(&mut rng)
            } else if (20..120).contains(&u) && (20..60).contains(&v) && (u / 3 + v / 5) % 2 == 0 {
                200
            } else {
                0
            }
        })
    });
    assert!(found.recognised);
    assert_eq!(found.mask.area(), 400 * 500);
}

#[test]
fn dark_columns_at_top_not_cut() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let found = found(8, |_| {
        image(W, H, |u, v| {
            let inside = (200..600).contains(&u) && (50..550).contains(&v);
            let dead_element = (300..309).contains(&u) && v < 200;
            if inside && !dead_element { speckle(&mut rng) } else { 0 }
        })
    });
    assert!(found.recognised);
    assert_eq!(found.mask.area(), 400 * 500);
}

#[test]
fn bright_dots_in_black_water_cut_nothing() {
    let dots = |shift: u32| {
        image(W, H, move |u, v| {
            let dot = |x: u32, y: u32| u.abs_diff(x + shift) < 6 && v.abs_diff(y) < 3;
            if dot(580, 286) || dot(446, 276) || dot(267, 264) || dot(200, 400) || dot(401, 410) { 180 } else { 0 }
        })
    };
    let found = found(8, |index| dots(u32::from(index) * 5));
    assert!(!found.recognised);
    assert!(found.mask.is_full());
    assert_eq!(
        found.notes(),
        [
            "no picture edge found on the left, right, top, bottom: the frame's edge counts; set a clip, or none, otherwise"
        ]
    );
}

#[test]
fn only_plain_edge_is_cut() {
    // Bright near field over the full width, sparse echoes below: only the top edge is plain.
    let found = found(8, |_| {
        image(W, H, |u, v| {
            let near = (100..700).contains(&u) && (40..48).contains(&v);
            if near || (u.abs_diff(400) < 5 && v.abs_diff(500) < 5) { 100 } else { 0 }
        })
    });
    assert!(!found.recognised);
    assert_eq!(found.mask.bounds().map(|b| (b.x, b.y, b.width, b.height)), Some((0, 40, W, H - 40)));
    assert!(found.notes()[0].contains("left, right, bottom:"), "{:?}", found.reasons);
}

#[test]
fn growing_object_is_not_an_image() {
    let found = found(8, |index| {
        let radius = 150.0 + 12.0 * f64::from(index);
        image(W, H, |u, v| u8::from((f64::from(u) - 400.0).hypot(f64::from(v) - 300.0) < radius) * 200)
    });
    assert!(!found.recognised);
    assert!(found.mask.is_full(), "{:?}", found.mask.bounds());
}

#[test]
fn small_bright_spot_is_not_an_image() {
    let found = found(3, |_| image(W, H, |u, v| u8::from(u.abs_diff(400) < 50 && v.abs_diff(300) < 50)));
    assert!(!found.recognised);
    assert!(found.mask.is_full() && found.notes()[0].contains("left, right, top, bottom"), "{:?}", found.reasons);
}

#[test]
fn black_and_full_frames_are_all_data() {
    let black = found(8, |_| image(40, 30, |_, _| 0));
    assert!(black.mask.is_full() && !black.recognised && black.notes()[0].contains("all black"));
    let full = found(8, |_| image(40, 30, |_, _| 7));
    assert!(full.mask.is_full() && full.reasons == [UnsureReason::Nothing], "nothing but one level");
    assert!(AutoMask::new(40, 30).finish().mask.is_full());
}

#[test]
fn u16_and_f32_pixels_work_and_other_sizes_are_ignored() {
    let inside = |i: usize| (10..30).contains(&(i % 40)) && (5..25).contains(&(i / 40));
    let u16s: Vec<u16> = (0..1200).map(|i| if inside(i) { 256 } else { 0 }).collect();
    let f32s: Vec<f32> = (0..1200).map(|i| if inside(i) { -0.25 } else { -0.0 }).collect();
    for pixels in [Pixels::U16(Arc::from(u16s)), Pixels::F32(Arc::from(f32s))] {
        let mut auto = AutoMask::new(40, 30);
        assert!(auto.push(&Image::new(30, 40, Pixels::U8(Arc::from(vec![1; 1200])))).is_none());
        auto.push(&Image::new(40, 30, pixels));
        assert_eq!(auto.finish().mask.area(), 400);
    }
}

#[test]
fn two_images_side_by_side_not_taken_for_one() {
    // The smaller holds a quarter of the live pixels: cutting it away would lose it.
    let found = found(8, |_| {
        image(W, H, |u, v| u8::from((50..550).contains(&v) && ((20..500).contains(&u) || (600..760).contains(&u))) * 90)
    });
    assert!(!found.recognised);
    assert!(found.mask.contains(700, 300) && found.mask.contains(100, 300));
}

#[test]
fn hollow_outline_is_not_an_image() {
    // Connected and large, but hardly filled: a graticule, or a vessel's outline in black
    // water.
    let found = found(8, |_| {
        image(W, H, |u, v| {
            let radius = (f64::from(u) - 400.0).hypot(f64::from(v) - 300.0);
            u8::from((200.0..204.0).contains(&radius)) * 90
        })
    });
    assert!(!found.recognised);
    assert!(found.mask.is_full());
}
