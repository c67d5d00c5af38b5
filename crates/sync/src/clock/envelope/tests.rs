#![allow(clippy::print_stdout, reason = "figures of the simulation, for who asks with --nocapture")]

use proptest::prelude::*;

use super::*;

/// Brute-force implementation of the documentation: all points of the window, all lines through
/// two of them, all pairs of points and lines.
struct Plain {
    points: Vec<Point>,
    limit_ppb: i64,
}

impl Plain {
    fn blocks(&self) -> Vec<i64> {
        let mut numbers: Vec<i64> = self.points.iter().map(|point| point.x.div_euclid(BLOCK_NS)).collect();
        numbers.sort_unstable();
        numbers.dedup();
        numbers
    }

    /// Inserts a point; returns whether it was accepted.
    fn insert(&mut self, point: Point) -> bool {
        let number = point.x.div_euclid(BLOCK_NS);
        let blocks = self.blocks();
        let begins = blocks.last().is_none_or(|newest| number > *newest);
        if !begins && !blocks.contains(&number) {
            return false;
        }
        self.points.push(point);
        if begins {
            let mut blocks = self.blocks();
            while blocks.len() > KEPT && blocks[0] <= number - BLOCKS as i64 {
                blocks.remove(0);
            }
            if blocks.len() > BLOCKS {
                blocks.remove(0);
            }
            self.points.retain(|point| blocks.contains(&point.x.div_euclid(BLOCK_NS)));
        }
        true
    }

    /// Returns the middle, and the greatest height of a line there, in f64 over all pairs.
    fn highest(&self) -> (i64, f64) {
        let blocks = self.blocks();
        let [least, most] = [self.points.iter().map(|p| p.x).min(), self.points.iter().map(|p| p.x).max()];
        let middle = (blocks[0] + blocks[blocks.len() - 1] + 1) * BLOCK_NS / 2;
        let middle = middle.clamp(least.unwrap(), most.unwrap());
        let limit = self.limit_ppb as f64 * 1e-9;
        let mut slopes = vec![0.0, limit, -limit];
        for a in &self.points {
            for b in self.points.iter().filter(|b| b.x > a.x) {
                let slope = (b.z - a.z) as f64 / (b.x - a.x) as f64;
                if slope.abs() <= limit {
                    slopes.push(slope);
                }
            }
        }
        let height = |slope: f64| {
            let under = self.points.iter().map(|p| p.z as f64 + slope * (middle - p.x) as f64);
            under.fold(f64::INFINITY, f64::min)
        };
        (middle, slopes.into_iter().map(height).fold(f64::NEG_INFINITY, f64::max))
    }
}

/// Samples at a rate, with mostly small and sometimes large delays, and a clock drift.
fn samples(hz: i64, drift_ppm: i64) -> impl Strategy<Value = Vec<Point>> {
    let one = (0_i64..4_000_000, prop_oneof![9 => Just(0_i64), 1 => 0_i64..200_000_000], 0_i64..30);
    prop::collection::vec(one, 1..400).prop_map(move |delays| {
        let mut x = 0;
        let place = |(delay, burst, lost): (i64, i64, i64)| {
            // Records are missing now and then, sometimes many.
            x += 1_000_000_000 / hz * if lost == 0 { 25 } else { 1 };
            Point { x, z: delay + burst + x / 1_000_000 * drift_ppm }
        };
        delays.into_iter().map(place).collect()
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn line_matches_brute_force(
        points in samples(20, 100), limit_ppm in prop_oneof![Just(500_i64), Just(50), Just(50_000)],
    ) {
        let mut envelope = Envelope::new(limit_ppm * 1000);
        let mut plain = Plain { points: Vec::new(), limit_ppb: limit_ppm * 1000 };
        for (n, point) in points.iter().enumerate() {
            let change = envelope.insert(*point);
            plain.insert(*point);
            if change == Change::Shift {
                // Points of which the line is made now.
                let kept = plain.blocks().len() - 1 - SHIFT_BLOCKS;
                let first = plain.blocks()[kept];
                plain.points.retain(|p| p.x.div_euclid(BLOCK_NS) >= first);
            }
            if n % 7 != 0 && n + 1 != points.len() {
                continue;
            }
            let line = envelope.line().unwrap();
            // The given rate may have been found wrong.
            plain.limit_ppb = envelope.limit_ppb();
            let (middle, height) = plain.highest();
            prop_assert!(line.slope().abs() <= plain.limit_ppb as f64 * 1e-9 + 1e-15);
            prop_assert!((line.at(middle) as f64 - height).abs() < 2.0, "{} {height}", line.at(middle));
            prop_assert!(plain.points.iter().all(|p| line.below(*p) >= 0));
        }
        prop_assert_eq!(envelope.work().coarsened, 0);
    }

    #[test]
    fn arrival_order_within_window_does_not_matter(points in samples(40, -200), turn in 0_usize..40) {
        let mut envelope = Envelope::new(500_000);
        let mut other = Envelope::new(500_000);
        // The first sample creates the block; the last state has seen the same samples in both.
        let points = &points[..points.len().min(8)];
        let mut turned = points.to_vec();
        turned[1..].rotate_left(turn % points.len().max(1) % points.len().saturating_sub(1).max(1));
        let same_block = |p: &&Point| p.x.div_euclid(BLOCK_NS) == points[0].x.div_euclid(BLOCK_NS);
        points.iter().filter(same_block).for_each(|p| { envelope.insert(*p); });
        turned.iter().filter(same_block).for_each(|p| { other.insert(*p); });
        prop_assert_eq!(envelope.line(), other.line());
    }
}

#[test]
fn work_per_sample_independent_of_rate() {
    let mut random = crate::clock::simulation::Draws::new(5);
    for hz in [30_i64, 240, 960] {
        let mut envelope = Envelope::new(500_000);
        let (mut n, mut most) = (0, 0);
        while n < 60 * hz {
            let x = n * 1_000_000_000 / hz;
            let before = envelope.work();
            envelope.insert(Point { x, z: (random.unit() * 4e6) as i64 + x / 10_000 });
            let after = envelope.work();
            most = most.max(after.insert_steps - before.insert_steps + after.refit_steps - before.refit_steps);
            n += 1;
        }
        let work = envelope.work();
        let steps = (work.insert_steps + work.refit_steps) as f64 / work.samples as f64;
        println!("{hz} Hz: {steps:.1} steps a sample, {} refits in 60 s, at most {most} steps at once", work.refits);
        assert!(steps < 2500.0 / hz as f64 + 20.0, "{hz} Hz: {steps}");
        assert!(most < 3 * (BLOCKS * crate::clock::hull::CORNERS) as u64, "{most}");
        assert_eq!(work.coarsened, 0);
    }
}

#[test]
fn two_seconds_of_later_samples_shift_line() {
    let mut envelope = Envelope::new(500_000);
    let mut shifted_at = None;
    for n in 0..1200_i64 {
        let x = n * 10_000_000;
        let late = if n >= 800 { 30_000_000 } else { 0 };
        let z = (n * 7919 % 101) * 10_000 + late;
        if envelope.insert(Point { x, z }) == Change::Shift {
            assert!(shifted_at.replace(x).is_none(), "once");
        }
    }
    let after = shifted_at.unwrap() - 8_000_000_000;
    assert_eq!(after, SHIFT_BLOCKS as i64 * BLOCK_NS);
    let there = envelope.line().unwrap().at(envelope.end());
    assert!((there - 30_000_000).abs() < 100_000, "{there}");
}

#[test]
fn bound_is_unknown_until_enough_blocks() {
    let mut envelope = Envelope::new(500_000);
    assert_eq!(envelope.doubt().bound_ns, UNKNOWN_NS);
    for n in 0..100_i64 {
        envelope.insert(Point { x: n * 10_000_000, z: n * 37 % 11 * 1_000_000 });
        if envelope.complete() < 4 {
            assert_eq!(envelope.doubt().bound_ns, UNKNOWN_NS);
        }
    }
}
