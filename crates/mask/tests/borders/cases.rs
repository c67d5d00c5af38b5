//! Random scenes of grabbers, by number.

use rand::{Rng, RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use sonoweave_core::region::{ClipRect, Fan};

use crate::painter::{Overlays, Scene, Truth};

/// Sizes of frames, and how often each occurs.
const SIZES: [([u32; 2], usize); 6] =
    [([640, 480], 6), ([720, 576], 6), ([800, 600], 3), ([1024, 768], 2), ([1280, 720], 2), ([1920, 1080], 1)];

/// Kinds of pictures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    Rectangle,
    /// A convex probe's fan.
    Convex,
    /// A phased array's fan, with its apex near the picture.
    Phased,
}

/// Returns the scene of a number: any level, noise, gain and company that is reasonable.
pub(crate) fn scene(kind: Kind, number: u64) -> Scene {
    let mut rng = ChaCha8Rng::seed_from_u64(1000 * kind as u64 + number);
    let sizes: Vec<[u32; 2]> = SIZES.iter().flat_map(|(size, often)| vec![*size; *often]).collect();
    let size = sizes[rng.random_range(0..sizes.len())];
    let truth = match kind {
        Kind::Rectangle => Truth::Rectangle(rectangle(size, &mut rng)),
        Kind::Convex | Kind::Phased => Truth::Fan(fan(kind, size, &mut rng)),
    };
    let noise = rng.random_range(0.0..4.0);
    Scene {
        size,
        truth,
        level: rng.random_range(0.0..24.0),
        noise,
        gain: [22.0, 50.0, 110.0][rng.random_range(0..3)],
        dark: rng.random_range(0..7),
        frozen: rng.random_bool(0.3),
        interlaced: rng.random_bool(0.4),
        blurred: rng.random(),
        blanking: if rng.random_bool(0.2) { 8 } else { 0 },
        overlays: Overlays {
            text: rng.random(),
            logo: rng.random(),
            ruler: rng.random(),
            wedge: rng.random(),
            ecg: rng.random_bool(0.3),
            clock: rng.random(),
        },
        seed: number,
    }
}

fn rectangle([width, height]: [u32; 2], rng: &mut impl Rng) -> ClipRect {
    let mut part = |most: u32| {
        let length = most * rng.random_range(45..85) / 100;
        [(most - length) * rng.random_range(20..80) / 100, length]
    };
    let ([x, width], [y, height]) = (part(width), part(height));
    ClipRect::new(x, y, width, height).unwrap()
}

fn fan(kind: Kind, [width, height]: [u32; 2], rng: &mut impl Rng) -> Fan {
    let (width, height) = (f64::from(width), f64::from(height));
    let half = rng.random_range(24.0..42.0_f64);
    let (top, bottom) = (height * rng.random_range(0.06..0.12), height * rng.random_range(0.84..0.94));
    let scale = height / 480.0;
    let inner = match kind {
        Kind::Phased => rng.random_range(0.0..10.0),
        _ => scale * rng.random_range(40.0..140.0),
    };
    // Shoulders at the top, the middle of the arc at the bottom, unless that is too wide.
    let most = (0.46 * width) / half.to_radians().sin();
    let apex = top - inner * half.to_radians().cos();
    let outer = (bottom - apex).min(most);
    let middle = width * rng.random_range(0.485..0.515);
    let tilt = rng.random_range(-1.5..1.5);
    Fan::new([middle, apex], [inner, outer], [tilt - half, tilt + half]).unwrap()
}
