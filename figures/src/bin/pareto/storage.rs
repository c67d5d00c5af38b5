//! Cost and benefit of storing sums in 32 or 16 bits.
//!
//! A separate inserter, in which only the storage differs: a dense block of voxels. It loads
//! rows into f32, does one multiply-add for numerator and weight and the default's clamp, and
//! stores the rows. Its times compare only among themselves, since it does not skip work like
//! the reconstructor.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::time::Instant;

use half::f16;
use half::slice::HalfFloatSliceExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use reconstruct::settings::MAX_WEIGHT;

use crate::contestant::default_kernels;
use crate::report::{Report, digits, markdown};
use crate::timing::quantile;

/// Voxels along x, y, z: larger than the nearer caches.
const SIZE: [usize; 3] = [512, 384, 16];
const SPACING_MM: f64 = 0.5;
/// Slices all lie within this distance of the block's middle, mm.
const WANDER_MM: f64 = 1.0;
/// Noise of a slice's values, grey levels.
const NOISE: f64 = 6.0;
/// Numbers of slices after which errors are measured.
const JUDGED: [u32; 3] = [10, 100, 1000];
/// The reconstructor's value, in units of the kernel's peak of 1.
const MOST_WEIGHT: f32 = MAX_WEIGHT as f32;
/// Interval of voxels that are also summed in f64.
const STRIDE: usize = 97;

/// Storage format of a voxel's two numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    SumsF32,
    MeanU16,
    SumsF16,
    MeanF16,
}

impl Format {
    const ALL: [Self; 4] = [Self::SumsF32, Self::MeanU16, Self::SumsF16, Self::MeanF16];

    fn name(self) -> &'static str {
        match self {
            Self::SumsF32 => "f32: Σ weight·value, Σ weight",
            Self::MeanU16 => "u16: mean in 8.8 fixed point, Σ weight in 1/255",
            Self::SumsF16 => "f16: Σ weight·value, Σ weight",
            Self::MeanF16 => "f16: mean, Σ weight",
        }
    }
}

/// A block of voxels in one format: two arrays, x fastest.
enum Store {
    F32([Vec<f32>; 2]),
    U16([Vec<u16>; 2]),
    F16 { arrays: [Vec<f16>; 2], means: bool },
}

/// Steps of a sixteen-bit weight per unit.
const WEIGHT_UNIT: f32 = 255.0;

impl Store {
    fn new(format: Format) -> Self {
        let voxels: usize = SIZE.iter().product();
        match format {
            Format::SumsF32 => Self::F32([vec![0.0; voxels], vec![0.0; voxels]]),
            Format::MeanU16 => Self::U16([vec![0; voxels], vec![0; voxels]]),
            Format::SumsF16 | Format::MeanF16 => {
                let zeros = vec![f16::ZERO; voxels];
                Self::F16 { arrays: [zeros.clone(), zeros], means: format == Format::MeanF16 }
            }
        }
    }

    fn bytes_per_voxel(&self) -> usize {
        match self {
            Self::F32(_) => 8,
            Self::U16(_) | Self::F16 { .. } => 4,
        }
    }

    /// Loads numerators and weights of a row.
    fn load(&self, start: usize, r: &mut [f32], w: &mut [f32]) {
        let row = start..start + r.len();
        match self {
            Self::F32([a, b]) => {
                r.copy_from_slice(&a[row.clone()]);
                w.copy_from_slice(&b[row]);
            }
            Self::U16([a, b]) => {
                for (((r, w), a), b) in r.iter_mut().zip(w).zip(&a[row.clone()]).zip(&b[row]) {
                    *w = f32::from(*b) * (1.0 / WEIGHT_UNIT);
                    *r = f32::from(*a) * (1.0 / 256.0) * *w;
                }
            }
            Self::F16 { arrays: [a, b], means } => {
                a[row.clone()].convert_to_f32_slice(r);
                b[row].convert_to_f32_slice(w);
                if *means {
                    r.iter_mut().zip(w).for_each(|(r, w)| *r *= *w);
                }
            }
        }
    }

    /// Stores a row; all roundings are to nearest.
    fn store(&mut self, start: usize, r: &mut [f32], w: &[f32]) {
        let row = start..start + r.len();
        match self {
            Self::F32([a, b]) => {
                a[row.clone()].copy_from_slice(r);
                b[row].copy_from_slice(w);
            }
            Self::U16([a, b]) => {
                for (((r, w), a), b) in r.iter().zip(w).zip(&mut a[row.clone()]).zip(&mut b[row]) {
                    *a = rounded(mean(*r, *w) * 256.0);
                    *b = rounded(*w * WEIGHT_UNIT);
                }
            }
            Self::F16 { arrays: [a, b], means } => {
                if *means {
                    r.iter_mut().zip(w).for_each(|(r, w)| *r = mean(*r, *w));
                }
                a[row.clone()].convert_from_f32_slice(r);
                b[row].convert_from_f32_slice(w);
            }
        }
    }

    /// Returns the mean at a voxel.
    fn value(&self, voxel: usize) -> f64 {
        let (mut r, mut w) = ([0.0], [0.0]);
        self.load(voxel, &mut r, &mut w);
        f64::from(r[0]) / f64::from(w[0])
    }
}

/// Returns the mean without a branch, so that a row is one vectorised loop; 0 without weight.
fn mean(r: f32, w: f32) -> f32 {
    r / w.max(1e-20)
}

/// Rounds 0 ≤ x < 65536 to the nearest integer: adding 2²³ leaves it in the low bits.
fn rounded(x: f32) -> u16 {
    ((x + 8_388_608.0).to_bits() & 0xffff) as u16
}

/// A slice: the value for each column of voxels, and the weight for each layer.
struct Slice {
    values: Vec<f32>,
    weights: [f32; SIZE[2]],
}

/// Draws slices over the same position, one after the other.
struct Slices {
    random: ChaCha8Rng,
    scene: Vec<f64>,
    kernel: reconstruct::kernel::AxisKernel,
}

impl Slices {
    fn new() -> Result<Self, Box<dyn Error>> {
        let [.., kernel] = default_kernels([SPACING_MM; 2], None)?;
        let scene = (0..SIZE[0] * SIZE[1]).map(scene).collect();
        Ok(Self { random: ChaCha8Rng::seed_from_u64(1), scene, kernel })
    }

    /// Returns a uniform random number from −1 to 1.
    fn even(&mut self) -> f64 {
        f64::from(self.random.next_u32()) / f64::from(u32::MAX) * 2.0 - 1.0
    }

    fn draw(&mut self) -> Slice {
        let place = WANDER_MM * self.even();
        let weights = std::array::from_fn(|z| {
            let at = (z as f64 - 0.5 * (SIZE[2] - 1) as f64) * SPACING_MM;
            self.kernel.weight(at - place) as f32
        });
        // Uniform noise of the same standard deviation is enough here.
        let spread = NOISE * 3.0_f64.sqrt();
        let values = (0..self.scene.len()).map(|i| (self.scene[i] + spread * self.even()) as f32).collect();
        Slice { values, weights }
    }
}

/// Returns the true value, between 30 and 225 grey levels.
fn scene(column: usize) -> f64 {
    let (x, y) = ((column % SIZE[0]) as f64, (column / SIZE[0]) as f64);
    127.5 + 90.0 * (0.07 * x).sin() * (0.05 * y).cos()
}

/// Inserts one slice into all layers that it reaches.
fn insert(store: &mut Store, slice: &Slice) {
    let (mut r, mut w) = ([0.0_f32; SIZE[0]], [0.0_f32; SIZE[0]]);
    for (z, weight) in slice.weights.iter().enumerate().filter(|(_, weight)| **weight > 0.0) {
        for (y, values) in slice.values.chunks_exact(SIZE[0]).enumerate() {
            let start = (z * SIZE[1] + y) * SIZE[0];
            store.load(start, &mut r, &mut w);
            for ((r, w), value) in r.iter_mut().zip(&mut w).zip(values) {
                let (sum, total) = (*r + weight * value, *w + weight);
                let scale = (MOST_WEIGHT / total).min(1.0);
                (*r, *w) = (sum * scale, total * scale);
            }
            store.store(start, &mut r, &w);
        }
    }
}

/// The same sums in f64 at some voxels.
struct Exact {
    voxels: Vec<usize>,
    sums: Vec<[f64; 2]>,
}

impl Exact {
    fn new() -> Self {
        let voxels: Vec<usize> = (0..SIZE.iter().product()).step_by(STRIDE).collect();
        let sums = vec![[0.0; 2]; voxels.len()];
        Self { voxels, sums }
    }

    fn insert(&mut self, slice: &Slice) {
        let layer = SIZE[0] * SIZE[1];
        for (voxel, [r, w]) in self.voxels.iter().zip(&mut self.sums) {
            let weight = f64::from(slice.weights[voxel / layer]);
            *r += weight * f64::from(slice.values[voxel % layer]);
            *w += weight;
            let scale = (MAX_WEIGHT / *w).min(1.0);
            (*r, *w) = (*r * scale, *w * scale);
        }
    }

    /// Returns root mean square and mean of a store's deviation, at voxels with a weight of at
    /// least 1.
    fn differences(&self, store: &Store) -> [f64; 2] {
        let (mut squares, mut sum, mut count) = (0.0, 0.0, 0.0);
        for (voxel, [r, w]) in self.voxels.iter().zip(&self.sums).filter(|(_, [_, w])| *w >= 1.0) {
            let error = store.value(*voxel) - r / w;
            squares += error * error;
            sum += error;
            count += 1.0;
        }
        [f64::sqrt(squares / count), sum / count]
    }
}

/// Inserts the same slices into each format in turns; reports errors and times.
///
/// # Errors
/// If a file cannot be written.
pub(crate) fn measure(most: u32, report: &mut Report, folder: &Path) -> Result<(), Box<dyn Error>> {
    let mut slices = Slices::new()?;
    let mut stores = Format::ALL.map(Store::new);
    let mut times = [const { Vec::new() }; Format::ALL.len()];
    let mut exact = Exact::new();
    let mut errors = [const { Vec::new() }; Format::ALL.len()];
    for number in 1..=most {
        let slice = slices.draw();
        exact.insert(&slice);
        for turn in 0..stores.len() {
            // The order alternates, so that each format finds the caches in varying states.
            let i = if number % 2 == 0 { turn } else { stores.len() - 1 - turn };
            let start = Instant::now();
            insert(&mut stores[i], &slice);
            times[i].push(start.elapsed().as_secs_f64() * 1e3);
        }
        if JUDGED.contains(&number) {
            errors.iter_mut().zip(&stores).for_each(|(errors, store)| errors.push(exact.differences(store)));
        }
    }
    let mut lines = Vec::new();
    let mut csv = String::from("format,bytes_per_voxel,ms_p25,ms_median,ms_p75,slices,rms_from_f64,mean_from_f64\n");
    for (((format, store), times), errors) in Format::ALL.iter().zip(&stores).zip(&times).zip(&errors) {
        let ms = [0.25, 0.5, 0.75].map(|q| quantile(times, q));
        let name = format.name();
        let mut line = vec![name.to_owned(), store.bytes_per_voxel().to_string()];
        line.push(format!("{} ({}–{})", digits(ms[1], 3), digits(ms[0], 3), digits(ms[2], 3)));
        line.extend(JUDGED.iter().enumerate().map(|(i, _)| errors.get(i).map_or("–".into(), |e| digits(e[0], 2))));
        lines.push(line);
        for (slices, [rms, bias]) in JUDGED.iter().zip(errors) {
            let fields = [ms[0], ms[1], ms[2], f64::from(*slices), *rms, *bias].map(|v| v.to_string()).join(",");
            csv += &format!("\"{name}\",{},{fields}\n", store.bytes_per_voxel());
        }
        // Sums in 16 bits are inaccurate, but the value must be between the scene's extremes.
        let bound = if *format == Format::SumsF32 { 1e-3 } else { 20.0 };
        report.findings.check(
            !errors.is_empty() && errors.iter().all(|e| e[0] <= bound),
            format!("storage, {name}: {errors:?} grey levels from f64"),
        );
    }
    fs::write(folder.join("storage.csv"), csv)?;
    let columns = ["kept as", "bytes a voxel", "ms a slice", "rms error after 10 slices", "after 100", "after 1000"];
    report.section(format!(
        "## What a voxel is kept in\n\nA plain dense reconstructor of its own ({}×{}×{} voxels, every slice over the same place within ±{WANDER_MM} mm), in which only \
         the storage differs: its times compare among themselves and with nothing else. Errors are from sums in f64 of the same slices, grey levels; the slices' \
         noise of {NOISE} levels is not part of them.\n\n{}",
        SIZE[0],
        SIZE[1],
        SIZE[2],
        markdown(&columns, &lines)
    ));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_return_stored_values_to_their_precision() {
        let bounds = [1e-6, 1.0 / 512.0 + 1e-4, 0.2, 0.07];
        for (format, bound) in Format::ALL.into_iter().zip(bounds) {
            let mut store = Store::new(format);
            let w = [0.5_f32, 1.0, 3.0, 40.0];
            let mut r = [0.5 * 17.3_f32, 201.77, 3.0 * 128.4, 40.0 * 77.7];
            let expected: Vec<f64> = r.iter().zip(w).map(|(r, w)| f64::from(*r) / f64::from(w)).collect();
            store.store(512, &mut r, &w);
            for (i, expected) in expected.iter().enumerate() {
                let found = store.value(512 + i);
                // A weight of 16 bits does not change the mean that is stored beside it.
                assert!((found - expected).abs() <= bound, "{format:?} {i}: {found} for {expected}");
            }
        }
    }

    #[test]
    fn rounding_is_to_the_nearest() {
        for (x, n) in [(0.0, 0), (0.4, 0), (0.6, 1), (254.7, 255), (65279.6, 65280), (65535.0, 65535)] {
            assert_eq!(rounded(x), n);
        }
    }

    #[test]
    fn f32_sums_match_f64_through_the_clamp() {
        let (mut slices, mut store, mut exact) = (Slices::new().unwrap(), Store::new(Format::SumsF32), Exact::new());
        for _ in 0..3 {
            let slice = slices.draw();
            insert(&mut store, &slice);
            exact.insert(&slice);
        }
        let [rms, bias] = exact.differences(&store);
        assert!(rms < 1e-4 && bias.abs() < 1e-4, "{rms} {bias}");
    }
}
