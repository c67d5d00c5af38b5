use std::collections::BTreeMap;

use fastrand::Rng;

use volume::brick::VOXELS;

use super::*;

/// Voxels of bricks: value and weight.
#[derive(Default)]
struct Bricks(BTreeMap<BrickIndex, Vec<(f32, f32)>>);

impl Values for Bricks {
    fn values(&self, start: [i64; 3], value: &mut [f32], weight: &mut [f32]) {
        for (x, (value, weight)) in value.iter_mut().zip(weight).enumerate() {
            let at = [start[0] + x as i64, start[1], start[2]];
            let brick = self.0.get(&at.map(|a| a.div_euclid(EDGE as i64) as i32));
            let inside = at.map(|a| a.rem_euclid(EDGE as i64) as usize);
            (*value, *weight) =
                brick.map_or((0.0, 0.0), |voxels| voxels[(inside[2] * EDGE + inside[1]) * EDGE + inside[0]]);
        }
    }

    fn bricks(&self) -> Box<dyn Iterator<Item = BrickIndex> + '_> {
        Box::new(self.0.keys().copied())
    }
}

impl Bricks {
    /// Changes some voxels of some bricks near each other; returns these. Most values are too dark
    /// to be seen.
    fn change(&mut self, rng: &mut Rng) -> Vec<BrickIndex> {
        let low: [i32; 3] = std::array::from_fn(|_| rng.i32(0..4));
        let mut changed = Vec::new();
        for _ in 0..rng.u32(1..6) {
            let brick = low.map(|at| at + rng.i32(0..2));
            let voxels = self.0.entry(brick).or_insert_with(|| vec![(0.0, 0.0); VOXELS]);
            let value: f32 = if rng.u8(0..4) == 0 { 90.0 + 165.0 * rng.f32() } else { 40.0 * rng.f32() };
            let first = rng.usize(0..VOXELS);
            for voxel in voxels.iter_mut().skip(first).take(rng.usize(1..200)) {
                *voxel = (value, 0.5 + rng.f32());
            }
            changed.push(brick);
        }
        changed
    }
}

/// Bricks change while others are read, as in a session, where insertion goes on. Each is read
/// again after its last change, before the picture is drawn.
#[test]
fn picture_has_same_bits_however_reading_and_changes_take_turns() {
    let region = RenderRegion::new(half_mm(), [0; 3], [39; 3]).unwrap();
    for seed in 0..12 {
        let mut rng = Rng::with_seed(seed);
        let settings = RenderSettings {
            threads: 1 + seed as usize % 2,
            ..RenderSettings::new([40, 40], Transfer::preset("phantom", [0.0, 255.0]).unwrap())
        };
        let mut renderer = Renderer::new(&settings, region).unwrap();
        let mut volume = Bricks::default();
        for step in 0..40 {
            let mut listed = Vec::new();
            for _ in 0..rng.u32(1..5) {
                listed.extend(volume.change(&mut rng));
                rng.shuffle(&mut listed);
                let read: Vec<BrickIndex> = listed.split_off(rng.usize(0..=listed.len()));
                renderer.read(&volume, &read);
            }
            renderer.read(&volume, &listed);
            renderer.draw();
            let mut whole = Renderer::new(&settings, region).unwrap();
            whole.update_all(&volume);
            let (a, b) = (renderer.picture(), whole.picture());
            assert!(a == b, "seed {seed}, step {step}: off by {:?}", a.difference(&b));
        }
        assert!(renderer.picture().pixels.iter().any(|pixel| pixel[3] < 0.9), "something is seen");
    }
}
