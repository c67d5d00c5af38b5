//! Compares every operation of every instruction set with plain scalar code, bit for bit.
#![allow(unsafe_code, reason = "the operations under test are unsafe to call without their instruction set")]

use super::{LANES, Lanes, Simd};

type Row = [f32; LANES];

/// Runs all operations on three rows and a small table; results in the order of the trait.
#[inline(always)]
unsafe fn everything<L: Lanes>(a: &Row, b: &Row, c: &Row, table: &[u32]) -> Vec<Row> {
    // SAFETY: rows hold sixteen elements; offsets are made to fit the table; the caller
    // guarantees the instruction set.
    unsafe {
        let (x, y, z) = (L::load(a.as_ptr()), L::load(b.as_ptr()), L::load(c.as_ptr()));
        let mut out = Vec::new();
        let mut keep = |v: L| {
            let mut row = [0.0; LANES];
            v.store(row.as_mut_ptr());
            out.push(row);
        };
        keep(x.add(y));
        keep(x.sub(y));
        keep(x.mul(y));
        keep(x.div(y));
        keep(x.mul_add(y, z));
        keep(x.min(y));
        keep(x.max(y));
        keep(x.floor());
        keep(x.abs());
        keep(x.abs().sqrt());
        let (mantissa, exponent) = x.abs().add(L::splat(1e-3)).mantissa_and_exponent();
        keep(mantissa);
        keep(exponent);
        keep(L::select(x.lt(y), y, z));
        keep(x.round_ties_even());
        keep(L::splat(1.25).scale_by_power_of_two(x.round_ties_even().min(L::splat(100.0)).max(L::splat(-100.0))));
        let mask = L::and(x.le(y), y.le(z));
        keep(L::select(mask, x, z));
        keep(L::splat(f32::from(L::bits(mask))));
        let offset = x.floor().min(L::splat(40.0)).max(L::splat(0.0));
        let mut offsets = [0_u32; LANES];
        offset.store_integers(offsets.as_mut_ptr());
        L::prefetch(table.as_ptr().cast());
        // Row weights like a spline's: not negative, sum about 1.
        let t = x.sub(x.floor());
        let s = L::splat(1.0).sub(t);
        let row = [s.mul(L::splat(0.2)), s.mul(L::splat(0.8)), t.mul(L::splat(0.7)), t.mul(L::splat(0.3))];
        keep(L::patch(table.as_ptr(), 9, offsets.as_ptr(), row, [z, y, x, y]));
        keep(L::patch_of_two(table.as_ptr(), offsets.as_ptr(), [s, t], [z, y]));
        let mut stamps: [u32; LANES] = std::array::from_fn(|k| table[k]);
        let old = L::not_above(stamps.as_ptr(), 1 << 31);
        keep(L::splat(f32::from(L::bits(old))));
        L::replace_where(L::and(old, mask), stamps.as_mut_ptr(), 0xFFFF_FFFE);
        let mut halves: [u16; LANES] = std::array::from_fn(|k| table[k] as u16);
        keep(L::load_halves(halves.as_ptr()));
        L::replace_halves_where(mask, halves.as_mut_ptr(), 0xFFFE);
        let mut pairs = [0_u32; LANES];
        L::store_pairs(x, y, pairs.as_mut_ptr());
        out.push(pairs.map(f32::from_bits));
        out.push(stamps.map(f32::from_bits));
        out.push(halves.map(f32::from));
        let mut sums: Row = std::array::from_fn(|k| c[k]);
        L::add_halves(x, y, sums.as_mut_ptr());
        out.push(sums);
        out
    }
}

dispatch!(fn run => everything(a: &Row, b: &Row, c: &Row, table: &[u32]) -> Vec<Row>);

fn scalar(a: &Row, b: &Row, c: &Row, table: &[u32]) -> Vec<Row> {
    let lanes = |f: &dyn Fn(usize) -> f32| -> Row { std::array::from_fn(f) };
    let mask = |k: usize| a[k] <= b[k] && b[k] <= c[k];
    let bits = (0..LANES).map(|k| u16::from(mask(k)) << k).sum::<u16>();
    vec![
        lanes(&|k| a[k] + b[k]),
        lanes(&|k| a[k] - b[k]),
        lanes(&|k| a[k] * b[k]),
        lanes(&|k| a[k] / b[k]),
        lanes(&|k| a[k].mul_add(b[k], c[k])),
        lanes(&|k| if a[k] < b[k] { a[k] } else { b[k] }),
        lanes(&|k| if a[k] > b[k] { a[k] } else { b[k] }),
        lanes(&|k| a[k].floor()),
        lanes(&|k| a[k].abs()),
        lanes(&|k| a[k].abs().sqrt()),
        lanes(&|k| {
            let x = a[k].abs() + 1e-3;
            x / 2.0_f32.powi((x.log2() + 0.5).floor() as i32)
        }),
        lanes(&|k| ((a[k].abs() + 1e-3).log2() + 0.5).floor()),
        lanes(&|k| if a[k] < b[k] { b[k] } else { c[k] }),
        lanes(&|k| a[k].round_ties_even()),
        lanes(&|k| 1.25 * 2.0_f32.powi(a[k].round_ties_even().clamp(-100.0, 100.0) as i32)),
        lanes(&|k| if mask(k) { a[k] } else { c[k] }),
        [f32::from(bits); LANES],
        lanes(&|k| {
            let base = a[k].floor().clamp(0.0, 40.0) as usize;
            let t = a[k] - a[k].floor();
            let row = [(1.0 - t) * 0.2, (1.0 - t) * 0.8, t * 0.7, t * 0.3];
            let column = [c[k], b[k], a[k], b[k]];
            let mut units = row.map(|w| (w * 32768.0).round_ties_even() as i64);
            units[2] = 32768 - units[0] - units[1] - units[3];
            let sum = |i: usize| {
                let node = |j: usize| {
                    let pair = table[base + 9 * (j / 2 * 2) + i];
                    i64::from((pair >> (16 * (j % 2))) as u16 as i16)
                };
                (0..4).map(|j| node(j) * units[j]).sum::<i64>() as f32
            };
            sum(3).mul_add(column[3], sum(2).mul_add(column[2], sum(1).mul_add(column[1], sum(0) * column[0])))
        }),
        lanes(&|k| {
            let base = a[k].floor().clamp(0.0, 40.0) as usize;
            let units = ((1.0 - (a[k] - a[k].floor())) * 16384.0).round_ties_even() as i64;
            let sum = |i: usize| {
                let [above, below] =
                    [table[base + i] as u16, (table[base + i] >> 16) as u16].map(|h| i64::from(h as i16));
                (above * units + below * (16384 - units)) as f32
            };
            sum(1).mul_add(b[k], sum(0) * c[k])
        }),
        [f32::from((0..LANES).map(|k| u16::from(table[k] <= 1 << 31) << k).sum::<u16>()); LANES],
        lanes(&|k| f32::from(table[k] as u16)),
        lanes(&|k| {
            let half = |x: f32| u32::from((x.round_ties_even() as i16).cast_unsigned());
            f32::from_bits(half(a[k]) | half(b[k]) << 16)
        }),
        lanes(&|k| f32::from_bits(if table[k] <= 1 << 31 && mask(k) { 0xFFFF_FFFE } else { table[k] })),
        lanes(&|k| f32::from(if mask(k) { 0xFFFE } else { table[k] as u16 })),
        lanes(&|k| {
            let of = [a, b][k / 2 % 2];
            let at = |lane: usize| (of[lane] + of[lane + 8]) + (of[lane + 4] + of[lane + 12]);
            if k < 4 { c[k] + (at(k % 2 * 2) + at(k % 2 * 2 + 1)) } else { c[k] }
        }),
    ]
}

#[test]
fn operations_match_scalar_code_bit_for_bit() {
    // All sixteen bits of both halves are in use.
    let table: Vec<u32> = (0..80_u32).map(|i| i.wrapping_mul(2_654_435_761)).collect();
    let mut compared = Vec::new();
    for simd in Simd::ALL.into_iter().filter(|s| s.is_available()) {
        compared.push(simd.name());
        for seed in 0..50_u16 {
            let row = |salt: u16| -> Row {
                std::array::from_fn(|k| {
                    let x = (f32::from(seed * 31 + salt * 7 + k as u16) * 1.618).sin();
                    // Implementations differ for ties, negative zero and equal lanes.
                    match (seed + k as u16) % 7 {
                        0 => (x * 8.0).round() + 0.5,
                        1 => -0.0,
                        2 => f32::from(seed) * 0.5,
                        _ => x * 40.0,
                    }
                })
            };
            let (a, b, c) = (row(1), row(2), row(3));
            for (operation, (got, want)) in
                run(simd, &a, &b, &c, &table).iter().zip(scalar(&a, &b, &c, &table)).enumerate()
            {
                assert_eq!(
                    got.map(f32::to_bits),
                    want.map(f32::to_bits),
                    "{} operation {operation}, seed {seed}",
                    simd.name()
                );
            }
        }
    }
    // All sets that the kernel lists for this processor. An emulated one has the host's list.
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap();
    let flags = told.lines().find(|line| line.starts_with("flags")).unwrap_or_default();
    let has = |all: [&str; 2]| {
        cfg!(target_arch = "x86_64") && all.iter().all(|flag| flags.split_whitespace().any(|word| word == *flag))
    };
    let listed = [(has(["avx512f", "avx512bw"]), "avx512"), (has(["avx2", "fma"]), "avx2"), (true, "portable")];
    assert_eq!(compared, listed.iter().filter(|(is, _)| *is).map(|(_, name)| *name).collect::<Vec<_>>());
}

#[inline(always)]
unsafe fn fused<L: Lanes>([a, b, c]: &[Row; 3]) -> Row {
    let mut row = [0.0; LANES];
    // SAFETY: rows hold sixteen elements; the caller guarantees the instruction set.
    unsafe { L::load(a.as_ptr()).mul_add(L::load(b.as_ptr()), L::load(c.as_ptr())).store(row.as_mut_ptr()) };
    row
}

dispatch!(fn fuse => fused(rows: &[Row; 3]) -> Row);

#[test]
fn multiply_add_of_any_operands_rounds_once() {
    let mut state = 1_u64;
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 32) as u32
    };
    let sets: Vec<Simd> = Simd::ALL.into_iter().filter(|s| s.is_available()).collect();
    let (mut midway, mut subnormal) = (0, 0);
    for trial in 0..40_000 {
        let mut operand = |exponents: [u32; 2]| {
            let bits = next();
            f32::from_bits((bits & 0x807F_FFFF) | (exponents[0] + next() % exponents[1]) << 23)
        };
        let rows: [Row; 3] = match trial % 4 {
            // Any bits, similar sizes, and sums that are subnormal.
            0 => [[0, 256]; 3].map(|range| std::array::from_fn(|_| operand(range))),
            1 => [[110, 34]; 3].map(|range| std::array::from_fn(|_| operand(range))),
            2 => [[54, 20], [54, 20], [0, 8]].map(|range| std::array::from_fn(|_| operand(range))),
            // Products of half a unit of the summand's last place, but for 2⁻⁴⁰ of it: the exact
            // sum is hardly beyond or before the middle between two f32, where f64 puts it.
            _ => {
                let is_normal = trial % 8 == 3;
                let summand: Row = std::array::from_fn(|_| operand(if is_normal { [100, 100] } else { [0, 1] }));
                let part = 1.0 / 1_048_576.0_f32;
                let scale = |k: usize| {
                    let unit = f32::from_bits(summand[k].to_bits() & 0x7F80_0000) / 16_777_216.0;
                    if is_normal { [1.0, unit] } else { [2.0_f32.powi(-75); 2] }
                };
                let factor = std::array::from_fn(|k| ((1.0 + part) * scale(k)[0]).copysign(summand[LANES - 1 - k]));
                [factor, std::array::from_fn(|k| (1.0 - part) * scale(k)[1]), summand]
            }
        };
        let want: Row = std::array::from_fn(|k| rows[0][k].mul_add(rows[1][k], rows[2][k]));
        for k in 0..LANES {
            let sum = f64::from(rows[0][k]) * f64::from(rows[1][k]) + f64::from(rows[2][k]);
            midway += u32::from(sum.to_bits() & 0x1FFF_FFFF == 0x1000_0000 && want[k].is_normal());
            subnormal += u32::from(want[k].is_subnormal());
        }
        for simd in &sets {
            let got = fuse(*simd, &rows);
            for k in 0..LANES {
                assert!(
                    got[k].to_bits() == want[k].to_bits() || got[k].is_nan() && want[k].is_nan(),
                    "{} {:?}: {:e}, not {:e}",
                    simd.name(),
                    rows.map(|row| row[k]),
                    got[k],
                    want[k]
                );
            }
        }
    }
    assert!(midway > 1000 && subnormal > 1000, "{midway} midway, {subnormal} subnormal");
}
