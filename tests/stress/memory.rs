//! Tests of the memory limit, and of bricks as far apart as indices reach.

use glam::DVec3;
use volume::Voxels;

use reconstruct::{Reconstructor, Refused, Settings};
use volume::Brick;

use crate::figures::{Sheet, Test};
use crate::insertion::{Probe, constant, half_mm, noise, state};

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new("36", "memory limit: kept to the brick, a typed refusal, every bit as before", limit),
        Test::new("36", "bricks 4·10⁹ voxels apart: 64-bit voxel indices, memory by what was scanned", far_apart),
        Test::new("36", "a 2048³ lattice scanned in two corners takes what two corners take", sparse),
    ]
}

fn limit(sheet: &mut Sheet) {
    let probe = Probe::oblique([48, 40], 0.25);
    let slices = [0.0, 3.0, 40.0].map(|along| probe.put(&noise(probe.size, 1), along));
    let brick = size_of::<Brick>() as u64;
    let mut free = Reconstructor::new(half_mm(), probe.mask()).unwrap();
    let counts = slices.each_ref().map(|slice| {
        free.insert(slice).unwrap();
        free.volume().len() as u64
    });
    for (name, room, entered) in [
        ("exactly enough for all", counts[2] * brick, 3),
        ("a byte less", counts[2] * brick - 1, 2),
        ("exactly enough for two", counts[1] * brick, 2),
        ("a brick less than for two", (counts[1] - 1) * brick, 1),
        ("a brick less than for one", (counts[0] - 1) * brick, 0),
    ] {
        let mut r = Reconstructor::new(Settings { memory_bytes: room, ..half_mm() }, probe.mask()).unwrap();
        let mut taken = 0;
        let mut clean = true;
        for slice in &slices {
            let (before, work) = (state(r.volume()), r.work());
            match r.insert(slice) {
                Ok(_) => taken += 1,
                Err(Refused::Memory { needed, limit_bytes }) => {
                    clean &= needed > 0 && limit_bytes == room && state(r.volume()) == before && r.work() == work;
                    break;
                }
                Err(other) => panic!("{other}"),
            }
        }
        sheet.equal(&format!("{name}: slices that entered"), taken, entered);
        sheet.holds(&format!("{name}: refused by type, state and counters as before"), clean);
        sheet.holds(&format!("{name}: within the limit"), r.volume().len() as u64 * brick <= room);
        // A slice that needs only existing bricks is still inserted.
        if entered > 0 {
            let again = probe.put(&constant(probe.size, 9.0), 0.0);
            sheet.holds(&format!("{name}: a slice in bricks that exist enters"), r.insert(&again).is_ok());
        }
    }
}

fn far_apart(sheet: &mut Sheet) {
    let probe = Probe::straight([9, 9], 0.5);
    let mut r = Reconstructor::new(half_mm(), probe.mask()).unwrap();
    let picture = noise(probe.size, 4);
    let near = r.insert(&probe.put(&picture, 0.0)).unwrap();
    // Brick indices are 32 bits: voxels to 2³¹, a thousand kilometres at half a millimetre.
    let reach = 1e9;
    for corner in 0..8_u8 {
        let sign = |axis: u8| if corner >> axis & 1 == 0 { reach } else { -reach };
        let there = Probe { centre: DVec3::new(sign(0), sign(1), sign(2)), ..probe };
        let touched = r.insert(&there.put(&picture, 0.0)).unwrap();
        sheet.equal(&format!("corner {corner}: voxels, as many as at the origin"), touched.voxels, near.voxels);
        let middle = there.centre.to_array().map(|x| (x / 0.5) as i64);
        sheet.equal(
            &format!("corner {corner}: its middle holds the origin's bits"),
            r.volume().voxel(middle),
            r.volume().voxel([0; 3]),
        );
        // A brick index truncated to 32 bits would find this same brick again.
        let wrapped = [middle[0] + (1 << 35), middle[1], middle[2]];
        sheet.equal(&format!("corner {corner}: 2³⁵ voxels on there is nothing"), r.volume().voxel(wrapped), (0.0, 0.0));
    }
    let (low, high) = r.volume().seen_bounds().unwrap();
    sheet.holds("bounds span all", (0..3).all(|a| low[a] < -1_999_999_990 && high[a] > 1_999_999_990));
    let bricks = r.volume().len() as u64;
    sheet.at_most("bytes a brick, tables included", r.volume().bytes() as f64 / bricks as f64, 4096.0 + 4096.0);
    let before = state(r.volume());
    for (name, at) in [("x", DVec3::X), ("−y", -DVec3::Y), ("z", DVec3::Z)] {
        // Beyond the last brick along an axis.
        let beyond = Probe { centre: at * 1.08e9, ..probe };
        let result = r.insert(&beyond.put(&picture, 0.0));
        sheet.equal(&format!("beyond the lattice along {name}"), result.err(), Some(Refused::OutOfRange));
    }
    sheet.equal("state after it", state(r.volume()), before);
}

fn sparse(sheet: &mut Sheet) {
    let probe = Probe::straight([64, 64], 0.5);
    let bytes = |corners: &[f64]| {
        // 2048³ voxels would be 64 GiB; 64 MiB must suffice.
        let settings = Settings { memory_bytes: 64 << 20, ..half_mm() };
        let mut r = Reconstructor::new(settings, probe.mask()).unwrap();
        for corner in corners {
            let there = Probe { centre: DVec3::splat(*corner), ..probe };
            for i in 0..4 {
                r.insert(&there.put(&noise(probe.size, i), f64::from(i))).unwrap();
            }
        }
        r.volume().bytes() as f64
    };
    let (one, two) = (bytes(&[0.0]), bytes(&[0.0, 1024.0 - 32.0]));
    sheet.near("memory of two corners / that of one", two / one, 2.0, 0.05);
    // A slice across the whole lattice needs more than allowed, and is refused before any
    // memory is taken.
    let wide = Probe::straight([1024, 1024], 1.0);
    let settings = Settings { memory_bytes: 64 << 20, ..half_mm() };
    let mut r = Reconstructor::new(settings, wide.mask()).unwrap();
    let result = r.insert(&wide.put(&constant(wide.size, 1.0), 0.0));
    sheet.holds("a slice of 2048² voxels in 64 MiB: refused by type", matches!(result, Err(Refused::Memory { .. })));
    sheet.equal("bricks after it", r.volume().len(), 0);
}
