//! Colours of a plane's pixels: grey, unseen, seen weakly, and uncertain.

use export::panel::grey;
use pipeline::session::PlaneImage;

use super::encoded_frame::Pixmap;

/// Unseen pixels are not grey but dark blue, hatched with a brighter blue.
const UNSEEN: [u8; 3] = [27, 42, 58];
const HATCH: [u8; 3] = [52, 82, 110];
/// Pixels seen weakly are grey, hatched with violet.
const WEAK: [u8; 3] = [150, 96, 196];
/// Colour and largest opacity of uncertain pixels.
const WASH: [u8; 3] = [255, 122, 0];
const MOST_WASH: f32 = 0.75;
/// Standard error at which it is reached, as a part of the window.
const FULL: f32 = 0.05;
/// Period of the hatch and width of its lines, pixels.
const HATCHED: [u32; 2] = [8, 2];

/// Returns red, green and blue of a plane's pixels, under their standard errors if there are any.
pub(super) fn coloured(image: &PlaneImage<'_>, window: [f32; 2]) -> Pixmap {
    let PlaneImage { sampled, weak, .. } = *image;
    let width = image.request.section.size[0];
    let mut pixels = Vec::with_capacity(3 * sampled.len());
    let (mut i, mut j) = (0, 0);
    let mut errors = image.errors.iter();
    for sampled in sampled {
        let error = errors.next().map_or(0.0, |error| error.value);
        pixels.extend(match sampled.is_seen() {
            true if sampled.weight < weak && is_line(i, j) => WEAK,
            true => washed(grey(sampled.value, window), error, window),
            false => unseen(i, j),
        });
        i += 1;
        if i == width {
            (i, j) = (0, j + 1);
        }
    }
    Pixmap::Colour(pixels.into())
}

/// Returns the colour of a grey pixel: the larger its standard error, the more orange.
fn washed(grey: u8, error: f32, [black, white]: [f32; 2]) -> [u8; 3] {
    let share = (error / (FULL * (white - black))).clamp(0.0, 1.0) * MOST_WASH;
    [0, 1, 2].map(|channel| {
        let (from, to) = (f32::from(grey), f32::from(WASH[channel]));
        (from + share * (to - from)).round() as u8
    })
}

/// Returns the colour of an unseen pixel.
pub(super) fn unseen(i: u32, j: u32) -> [u8; 3] {
    if is_line(i, j) { HATCH } else { UNSEEN }
}

/// Returns whether a pixel lies on a line of the hatch.
fn is_line(i: u32, j: u32) -> bool {
    let [apart, thick] = HATCHED;
    (i + j) % apart < thick
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DVec3};

    use super::*;
    use pipeline::session::{Extent, PlaneRequest, PlaneWork};
    use render::section::{Box3, Sampled, Section};
    use sonoweave_core::frames::Transform;

    fn seen(value: f32) -> Sampled {
        Sampled { value, weight: 1.0, share: 1.0 }
    }

    /// Returns the colours of 10 x 4 pixels.
    fn colours(sampled: &[Sampled], errors: &[Sampled], weak: f32, window: [f32; 2]) -> Vec<[u8; 3]> {
        let section = Section { first: DVec3::ZERO, right: DVec3::X, down: DVec3::Y, size: [10, 4] };
        let image = PlaneImage {
            request: PlaneRequest { number: 0, section, style: 0 },
            extent: Extent {
                place: Box3::new(Transform::from_affine(DAffine3::IDENTITY), [[0; 3], [9, 3, 0]]),
                voxel_mm: 1.0,
                grey_levels: [0.0, 255.0],
            },
            sampled,
            errors,
            keeps_errors: true,
            weighs_shadows: true,
            weak,
            readout: None,
            slices: 1,
            item: 1,
            captured_ns: None,
            work: PlaneWork::default(),
        };
        match coloured(&image, window) {
            Pixmap::Colour(pixels) => pixels.as_chunks().0.to_vec(),
            Pixmap::Grey(_) => panic!("colours"),
        }
    }

    #[test]
    fn plane_colours_seen_grey_and_unseen_hatched() {
        let sampled: Vec<Sampled> =
            (0..40).map(|n| if n % 2 == 0 { seen(n as f32) } else { Sampled::UNSEEN }).collect();
        // A standard error of 5 % of the window is as orange as pixels get.
        let errors: Vec<Sampled> = (0..40).map(|n| seen(if n == 20 { 1.0 } else { 0.0 })).collect();
        let washed = colours(&sampled, &errors, 0.0, [10.0, 30.0]);
        let pixels = colours(&sampled, &[], 0.0, [10.0, 30.0]);
        assert_eq!(washed[20], [223, 124, 32]);
        assert!(washed[..20] == pixels[..20] && washed[21..] == pixels[21..]);
        assert_eq!([0, 10, 20, 30, 38].map(|n: usize| pixels[n]), [[0; 3], [0; 3], [128; 3], [255; 3], [255; 3]]);
        for n in (1..40).step_by(2) {
            let [r, g, b] = pixels[n];
            assert!(b > g && g > r && r > 0, "{n}: blue, and not black");
        }
        assert_eq!((pixels[1], pixels[3]), (HATCH, UNSEEN));
    }

    #[test]
    fn pixels_seen_weakly_are_grey_and_hatched() {
        // The right half has a hundredth of the weight.
        let sampled: Vec<Sampled> =
            (0..40).map(|n| Sampled { weight: if n % 10 < 5 { 1.0 } else { 0.01 }, ..seen(51.0) }).collect();
        let pixels = colours(&sampled, &[], 0.05, [0.0, 255.0]);
        for (n, pixel) in pixels.iter().enumerate() {
            let [i, j] = [n % 10, n / 10];
            let is_hatched = i >= 5 && (i + j) % 8 < 2;
            assert_eq!(*pixel, if is_hatched { WEAK } else { [51; 3] }, "{i} {j}");
        }
        assert!(pixels.contains(&WEAK));
        assert!(colours(&sampled, &[], 0.0, [0.0, 255.0]).iter().all(|pixel| *pixel == [51; 3]), "unless asked");
    }
}
