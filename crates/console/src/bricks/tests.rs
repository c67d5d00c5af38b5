//! Bricks of pages against plain references.

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use glam::DAffine3;
use pipeline::session::BrickCopy;
use render::classify::transfer::Transfer;
use render::{Mode, RenderRegion, RenderSettings, Renderer};
use sonoweave_core::frames::Transform;
use volume::brick::{BrickIndex, VOXELS};

use super::dirty_set::DirtySet;
use super::drawing::Drawing;
use super::message::{BYTES, MOST, Message, fits, is_empty, weight_code};
use super::*;

const MS: Duration = Duration::from_millis(1);

/// A brick whose voxels have this value, or of which nothing was seen.
fn brick(value: Option<f32>) -> Box<BrickCopy> {
    let (value, weight) = value.map_or((0.0, 0.0), |value| (value, 1.0));
    Box::new(BrickCopy { value: [value; VOXELS], weight: [weight; VOXELS] })
}

fn drawing(low: [i64; 3], high: [i64; 3], mode: Mode) -> Drawing {
    let region = RenderRegion::new(Transform::from_affine(DAffine3::IDENTITY), low, high).unwrap();
    let transfer = Transfer::preset("tissue", [0.0, 255.0]).unwrap();
    let settings = RenderSettings { mode, ..RenderSettings::new([8, 8], transfer) };
    Drawing::of(&Renderer::new(&settings, region).unwrap(), [0.0; 3], [0.0, 255.0], false)
}

/// A brick of a message: values and weights of its voxels, or `None` if nothing was seen.
type Received = (BrickIndex, Option<Vec<u8>>);

/// Reads a message plainly; returns its bricks, and the number of missing ones.
fn read(bytes: &[u8]) -> (Vec<Received>, u32) {
    let number = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap());
    assert_eq!(bytes[0], KIND);
    let (mut at, mut bricks) = (40, Vec::new());
    while at < bytes.len() {
        let index = |n: usize| i32::from(i16::from_le_bytes([bytes[at + 2 * n], bytes[at + 2 * n + 1]]));
        let brick = [index(0), index(1), index(2)];
        let seen = bytes[at + 6] == 0;
        let voxels = seen.then(|| bytes[at + 10..at + 10 + BYTES].to_vec());
        at += if seen { 10 + BYTES } else { 10 };
        bricks.push((brick, voxels));
    }
    assert_eq!((number(4) as usize, at), (bricks.len(), bytes.len()));
    (bricks, number(8))
}

#[test]
fn brick_message_restores_values_and_weights() {
    let mut copy = brick(Some(0.0));
    for n in 0..VOXELS {
        copy.value[n] = n as f32 - 40.25;
        copy.weight[n] = [0.0, 1.0, 0.5, 1.03, 1e-9, 1e9, -1.0, 0.02][n % 8];
    }
    let mut message = Message::new();
    message.add([-3, 0, 32767], &copy, [10.0, 265.0]);
    message.add([1, -32768, 2], &brick(None), [10.0, 265.0]);
    let bytes = message.finish(7, 5, 12.5);
    let (bricks, missing) = read(&bytes);
    assert_eq!((missing, bricks[1].clone()), (7, ([1, -32768, 2], None)));
    assert_eq!(bricks[0].0, [-3, 0, 32767]);
    let voxels = bricks[0].1.clone().unwrap();
    for (n, voxel) in voxels.chunks_exact(4).enumerate() {
        if copy.weight[n] <= 0.0 {
            assert_eq!(voxel, [0; 4], "{n}");
            continue;
        }
        let value = f32::from(u16::from_be_bytes([voxel[0], voxel[1]])) / 256.0;
        assert_eq!(value, (copy.value[n] - 10.0).clamp(0.0, 255.0), "{n}");
        assert_eq!(u16::from_be_bytes([voxel[2], voxel[3]]), weight_code(copy.weight[n]), "{n}");
    }
    let seen = |n: &usize| copy.weight[*n] > 0.0;
    let values: Vec<u8> = (0..VOXELS).filter(seen).map(|n| voxels[4 * n]).collect();
    assert_eq!([bytes[47], bytes[48]], [*values.iter().min().unwrap(), *values.iter().max().unwrap()]);
    assert_eq!(
        [[0.0; 2], [1.0, 2.0]].map(|w| is_empty(&BrickCopy { weight: [w[0]; VOXELS], ..*brick(None) })),
        [true, false]
    );
    assert!(fits([-32768, 32767, 0]) && !fits([0, 32768, 0]) && !fits([0, 0, -32769]));
}

#[test]
fn weights_have_4096_steps_a_doubling() {
    let decoded = |code: u16| f64::exp2(f64::from(code / 4096) - 9.0) * (1.0 + f64::from(code % 4096) / 4096.0);
    for n in 0..2000_u16 {
        let weight = 0.003 * 1.005_f64.powi(i32::from(n));
        let code = weight_code(weight as f32);
        let off = decoded(code) / weight - 1.0;
        assert!(off.abs() < 1.0 / 8191.0 || code == u16::MAX, "{weight}: {code}, off by {off}");
    }
    assert_eq!([f32::MIN_POSITIVE, 1e-4, 1e30, f32::INFINITY].map(weight_code), [1, 1, u16::MAX, u16::MAX]);
}

/// The same rules, plainly: a list of bricks that is searched for each.
#[derive(Default)]
struct Plain {
    dirty: Vec<(BrickIndex, Instant)>,
    held: Vec<BrickIndex>,
    sent: Vec<(BrickIndex, Instant)>,
}

impl Plain {
    fn next(&mut self, now: Instant, told: i32, viewed: i32) -> Option<BrickIndex> {
        let is_recent = |brick: BrickIndex, of: &[(BrickIndex, Instant)]| {
            of.iter().any(|(other, at)| *other == brick && now - *at < 200 * MS)
        };
        let mut best: Option<((bool, bool, Instant, BrickIndex), usize)> = None;
        for (n, (brick, changed)) in self.dirty.iter().enumerate() {
            if is_recent(*brick, &self.sent) || brick[0] >= told {
                continue;
            }
            let key = (brick[1] >= viewed, now - *changed < 200 * MS, *changed, *brick);
            if best.is_none_or(|(least, _)| key < least) {
                best = Some((key, n));
            }
        }
        let (brick, _) = self.dirty.remove(best?.1);
        self.sent.push((brick, now));
        Some(brick)
    }
}

#[test]
fn dirty_set_equals_a_plain_list() {
    let (mut set, mut plain) = (DirtySet::default(), Plain::default());
    let mut seed = 1_u32;
    let mut random = |below: u32| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) % below
    };
    let mut now = Instant::now();
    let mut taken_in_all = 0;
    for step in 0..600 {
        now += random(90) * MS;
        let bricks: Vec<BrickIndex> =
            (0..random(9)).map(|_| [random(6) as i32, random(4) as i32, random(3) as i32]).collect();
        if step % 50 == 49 {
            set.note_all(bricks.iter().copied(), now);
            let all: BTreeSet<BrickIndex> = plain.held.iter().chain(&bricks).copied().collect();
            plain.dirty = all.into_iter().map(|brick| (brick, now)).collect();
        } else {
            set.note(bricks.iter().copied(), now);
            for brick in bricks {
                plain.dirty.retain(|(other, _)| *other != brick);
                plain.dirty.push((brick, now));
            }
        }
        let (told, viewed, most) = (2 + random(5) as i32, random(5) as i32, random(12) as usize);
        let taken = set.take(most, now, |brick| brick[0] < told, |brick| brick[1] < viewed);
        let expected: Vec<BrickIndex> = (0..most).map_while(|_| plain.next(now, told, viewed)).collect();
        assert_eq!(taken, expected, "step {step}");
        taken_in_all += taken.len();
        for brick in taken {
            let is_empty = random(4) == 0;
            set.sent(brick, is_empty);
            plain.held.retain(|other| *other != brick);
            if !is_empty {
                plain.held.push(brick);
            }
            assert_eq!(set.holds(brick), !is_empty);
        }
        let missing = plain.dirty.iter().filter(|(brick, _)| brick[0] < told && !plain.held.contains(brick)).count();
        assert_eq!(set.missing(|brick| brick[0] < told), missing, "step {step}");
    }
    assert!(taken_in_all > 500, "{taken_in_all}");
}

/// A volume that changes while a page follows it.
struct Followed {
    pages: BrickPages,
    page: std::sync::Arc<PageBricks>,
    volume: BTreeMap<BrickIndex, Option<f32>>,
    /// The page's bricks.
    got: BTreeMap<BrickIndex, Vec<u8>>,
    runtime: tokio::runtime::Runtime,
    read: usize,
    /// The time at which bricks are chosen.
    now: Instant,
}

impl Followed {
    fn new(drawing: &Drawing) -> Self {
        let pages = BrickPages::default();
        let page = pages.enter();
        page.tell(drawing);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_time().build().unwrap();
        Self { pages, page, volume: BTreeMap::new(), got: BTreeMap::new(), runtime, read: 0, now: Instant::now() }
    }

    fn put(&mut self, bricks: &[BrickIndex], value: Option<f32>) {
        self.volume.extend(bricks.iter().map(|brick| (*brick, value)));
        self.pages.changed(bricks, false);
    }

    fn serve(&mut self) {
        let Self { pages, volume, read, now, .. } = self;
        let copy = |index: &BrickIndex| brick(volume.get(index).copied().flatten());
        pages.serve(
            &mut |bricks| {
                *read += bricks.len();
                bricks.iter().map(copy).collect()
            },
            |_| true,
            *now,
        );
    }

    /// Returns the bricks of the next message and the number of missing ones, if there is one now.
    fn receive(&mut self) -> Option<(usize, u32)> {
        let page = &self.page;
        let next = async { tokio::time::timeout(MS, page.next()).await.ok() };
        let bytes = self.runtime.block_on(next)?;
        assert!(bytes.len() <= 128 << 10);
        let (bricks, missing) = read(&bytes);
        let count = bricks.len();
        for (index, voxels) in bricks {
            match voxels {
                Some(voxels) => drop(self.got.insert(index, voxels)),
                None => assert!(self.got.remove(&index).is_some(), "the page has it"),
            }
        }
        Some((count, missing))
    }

    fn answer(&self, sequence: u32) {
        self.page.answered(sequence);
    }
}

#[test]
fn page_has_two_messages_unanswered_and_then_newest_bricks() {
    let mut all = Followed::new(&drawing([0; 3], [255; 3], Mode::default()));
    let bricks: Vec<BrickIndex> = (0..600).map(|n| [n / 30, n % 30, 0]).collect();
    all.put(&bricks, Some(50.0));
    let mut messages = Vec::new();
    for _ in 0..5 {
        all.serve();
        messages.extend(all.receive());
    }
    assert_eq!(messages, [(MOST, 600 - MOST as u32), (MOST, 600 - 2 * MOST as u32)]);
    assert_eq!(all.read, 2 * MOST, "bricks are read when there is room");
    // Waiting bricks are sent as they are when the page answers, not as they were.
    all.put(&bricks[500..], Some(90.0));
    all.answer(1);
    let mut sequence = 1;
    while messages.last().is_none_or(|(_, missing)| *missing > 0) {
        all.serve();
        messages.extend(all.receive());
        sequence += 1;
        all.answer(sequence);
    }
    assert_eq!(messages.iter().map(|(count, _)| count).sum::<usize>(), 600, "each once");
    assert!(bricks[500..].iter().all(|brick| all.got[brick][0] == 90));
    all.serve();
    assert_eq!(all.receive(), None, "nothing has changed");
    // A brick of which nothing is left is taken back, once.
    all.put(&bricks[..1], None);
    all.now += 210 * MS;
    all.serve();
    assert_eq!(all.receive(), Some((1, 0)));
    assert!(!all.got.contains_key(&bricks[0]));
    // An answer to a message that was never sent makes no room.
    all.answer(4_000_000);
}

#[test]
fn bricks_outside_the_told_region_wait() {
    let mut all = Followed::new(&drawing([0; 3], [63; 3], Mode::default()));
    let (inside, outside) = ([3, 3, 3], [40, 3, 3]);
    all.put(&[inside, outside, [40_000, 0, 0]], Some(1.0));
    all.serve();
    assert_eq!(all.receive(), Some((1, 0)));
    assert_eq!(Vec::from_iter(all.got.keys()), [&inside]);
    // A message that waits while the region changes is not sent: it may hold bricks outside.
    all.put(&[[2, 2, 2]], Some(2.0));
    all.serve();
    all.page.tell(&drawing([160, 0, 0], [400, 63, 63], Mode::default()));
    all.serve();
    assert_eq!(all.receive(), Some((1, 0)));
    assert!(all.got.contains_key(&outside));
    all.page.tell(&drawing([0; 3], [400; 3], Mode::default()));
    all.now += 210 * MS;
    all.answer(2);
    all.serve();
    all.receive();
    assert!(
        all.got.contains_key(&[2, 2, 2]) && all.got.contains_key(&inside) && !all.got.contains_key(&[40_000, 0, 0])
    );
}

#[test]
fn volume_of_a_million_bricks_is_not_sent() {
    let drawing = drawing([0; 3], [799; 3], Mode::default());
    let mut all = Followed::new(&drawing);
    let bricks: Vec<BrickIndex> = (0..1_000_000).map(|n| [n % 100, n / 100 % 100, n / 10_000]).collect();
    all.put(&bricks, Some(1.0));
    assert!(all.pages.is_too_large());
    all.serve();
    assert_eq!((all.receive(), all.read), (None, 0));
    // A smaller one is.
    all.pages.changed(&bricks[..9], true);
    assert!(!all.pages.is_too_large());
    all.serve();
    assert_eq!(all.receive(), Some((9, 0)));
    all.pages.leave(&all.page);
    assert!(!all.pages.is_watched());
}

#[test]
fn drawing_has_tables_or_the_reason_why_pages_cannot() {
    let lit = drawing([0; 3], [63; 3], Mode::default()).to_json();
    let lit = &lit["drawing"];
    let transfer = Transfer::preset("tissue", [0.0, 255.0]).unwrap();
    for byte in [0_u8, 77, 100, 255] {
        let entry = |table: &serde_json::Value| table[usize::from(byte)].as_f64().unwrap();
        let value = f64::from(byte);
        assert_eq!(entry(&lit["opacities"]), transfer.alpha(value, 1e9), "{byte}");
        assert_eq!(lit["colours"][usize::from(byte)][2].as_f64().unwrap(), transfer.intensity(value), "{byte}");
    }
    assert_eq!(
        (&lit["mode"], &lit["first"], &lit["bricks"]),
        (&"shaded".into(), &serde_json::json!([-8, -8, -8]), &serde_json::json!([10, 10, 10]))
    );
    let none = drawing([0; 3], [63; 3], Mode::Isosurface(9.0)).to_json();
    assert!(none["drawing"]["none"].as_str().unwrap().contains("mode"), "{none}");
}
