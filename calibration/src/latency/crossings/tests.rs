//! Lags of simulated scans of an analytic body, and scans that determine no lag.

use glam::{DQuat, DVec3};

use super::*;
use crate::tests::crossing_scans::{Way, both_ways, scan};
use crate::tests::noise::Noise as Random;

fn one_way(time: f64) -> (DQuat, DVec3) {
    (DQuat::IDENTITY, DVec3::new(0.0, 0.0, 3.0 * time - 18.0))
}

#[test]
fn lag_of_crossing_scan_is_found_within_standard_error() {
    let seeds: u32 = 16;
    let (mut squares, mut sum) = (0.0, 0.0);
    for seed in 0..seeds {
        let mut random = Random::new(u64::from(seed));
        let lag = 0.12 * (random.uniform() - 0.5);
        let found = scan(both_ways, lag, 6.0, &mut random).lag(0.25).unwrap();
        let off = found.lag_s - lag;
        println!(
            "{seed}: {:.2} ms off, se {:.2} ms, {} crossings, r {:.3} from {:.3}",
            1e3 * off,
            1e3 * found.se_s,
            found.crossings,
            found.correlation,
            found.correlation_at_zero
        );
        assert!(off.abs() < 4e-3 && found.se_s < 3e-3, "{seed}: {off} {}", found.se_s);
        assert!(found.correlation >= found.correlation_at_zero - 0.01);
        squares += (off / found.se_s).powi(2);
        sum += off / found.se_s;
    }
    let n = f64::from(seeds);
    println!("mean {:.2}, mean square {:.2}", sum / n, squares / n);
    // The mean square of so few normal numbers is 1 ± 0.35.
    assert!((sum / n).abs() < 0.7 && (0.3..2.0).contains(&(squares / n)), "{} {}", sum / n, squares / n);
}

#[test]
fn undetermined_lag_is_refused_by_name() {
    let mut random = Random::new(77);
    let none = scan(one_way, 0.05, 3.0, &mut random).lag(0.25).unwrap_err();
    let few = LatencyError::FewCrossings { slices: 150, crossings: 0, least: super::LEAST_CROSSINGS };
    assert_eq!(none, few.into());
    // Too slow for the lag to show.
    let slow: Way = |time| {
        let (turn, place) = both_ways(6.0 + time / 12.0);
        (turn * DQuat::from_rotation_y(0.1 * time), 0.02 * place)
    };
    let slow = scan(slow, 0.05, 3.0, &mut random).lag(0.25);
    assert!(slow.is_err(), "{slow:?}");
    let edge = scan(both_ways, 0.2, 3.0, &mut random).lag(0.1);
    assert!(matches!(edge, Err(CalibrationError::Latency(LatencyError::AtEdge { .. }))), "{edge:?}");
    // Images of another scan.
    let mut other = scan(both_ways, 0.0, 3.0, &mut random);
    let mut pictures: Vec<Vec<u16>> = other.pixels.iter().map(|(_, pixels)| pixels.clone()).collect();
    for i in (1..pictures.len()).rev() {
        pictures.swap(i, (random.uniform() * (i + 1) as f64) as usize);
    }
    other.pixels.iter_mut().zip(pictures).for_each(|(own, picture)| own.1 = picture);
    let other = other.lag(0.25);
    assert!(other.is_err(), "{other:?}");
}

#[test]
fn vertex_finds_minimum_or_lower_end() {
    let places = [-2.0, -1.0, 0.0, 1.0, 2.0];
    assert!((vertex(&places, &places.map(|x: f64| 3.0 * (x - 0.7).powi(2) + 5.0)) - 0.7).abs() < 1e-12);
    assert_eq!(vertex(&places, &places.map(|x: f64| -x)), 2.0);
    assert_eq!(vertex(&places, &places.map(|x: f64| 9.0 * x)), -2.0);
}
