//! How numbers are spread, as counts and as bars of text.

use serde::Serialize;

/// Characters of the longest bar.
const LONGEST: usize = 40;
/// Bins that a histogram of what begins at 0 has at most.
const BINS: usize = 16;
/// Bins of a signed histogram to either side of the middle one.
const SIDE: usize = 8;
/// A bin is so many standard deviations wide, or the next longer round length.
const BIN_SPREAD: f64 = 0.3;
/// Of a bin's width.
const ROUNDING: f64 = 1e-9;

/// Counts of numbers in bins of equal width.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(in crate::cli) struct Histogram {
    /// Where the first bin begins.
    from: f64,
    /// A bin's width; a number on the edge of two bins is in the higher one.
    width: f64,
    counts: Vec<u64>,
    /// Numbers below the first bin.
    below: u64,
    /// Numbers from the end of the last bin on.
    above: u64,
    /// Numbers that are none, or infinite.
    not_finite: u64,
}

/// The shortest of 1, 2, 5 times a power of ten that is not shorter than `least`; 1 where that is no length.
pub(in crate::cli) fn round_up(least: f64) -> f64 {
    if !(least > 0.0 && least.is_finite()) {
        return 1.0;
    }
    // A power of ten by its digits is the nearest number to it, and prints as such.
    let decade: f64 = format!("1e{}", least.log10().floor()).parse().unwrap_or(1.0);
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|n| n * decade).find(|width| *width >= least * (1.0 - 1e-12)).unwrap_or(least)
}

impl Histogram {
    fn of(samples: impl Iterator<Item = f64>, from: f64, width: f64, bins: usize) -> Self {
        let mut this = Self { from, width, counts: vec![0; bins], below: 0, above: 0, not_finite: 0 };
        for sample in samples {
            if !sample.is_finite() {
                this.not_finite += 1;
                continue;
            }
            // Edges are meant in decimals: what is nearer to one than their rounding is on it.
            let guess = ((sample - from) / width).floor();
            let bin = [guess - 1.0, guess, guess + 1.0]
                .into_iter()
                .rfind(|bin| this.edge(*bin) <= sample + ROUNDING * width)
                .unwrap_or(guess);
            match bin {
                _ if bin < 0.0 => this.below += 1,
                _ if bin >= bins as f64 => this.above += 1,
                _ => this.counts[bin as usize] += 1,
            }
        }
        this
    }

    fn edge(&self, bin: f64) -> f64 {
        self.from + bin * self.width
    }

    /// Of numbers of either sign, with a bin around 0; what is farther than about 2.5 times their root mean square `rms` is counted below or above.
    pub(in crate::cli) fn signed(samples: impl Iterator<Item = f64>, rms: f64) -> Self {
        let width = round_up(BIN_SPREAD * rms);
        Self::of(samples, -(SIDE as f64 + 0.5) * width, width, 2 * SIDE + 1)
    }

    /// Of numbers from 0 on, up to the largest; `None` of none.
    pub(in crate::cli) fn positive(samples: &[f64]) -> Option<Self> {
        let most = samples.iter().copied().filter(|s| s.is_finite()).fold(0.0, f64::max);
        let width = round_up(most / (BINS - 1) as f64);
        // One more than needed where the largest is on an edge: it is in the bin that begins there.
        let bins = (most / width + ROUNDING).floor() as usize + 1;
        (!samples.is_empty()).then(|| Self::of(samples.iter().copied(), 0.0, width, bins))
    }

    /// A line a bin, the longest bar for the fullest.
    pub(in crate::cli) fn lines(&self) -> Vec<String> {
        let mut rows: Vec<(String, u64)> = Vec::new();
        if self.below > 0 {
            rows.push((format!("< {}", self.label(0)), self.below));
        }
        for (bin, count) in self.counts.iter().enumerate() {
            rows.push((format!("{} … {}", self.label(bin), self.label(bin + 1)), *count));
        }
        if self.above > 0 {
            rows.push((format!("≥ {}", self.label(self.counts.len())), self.above));
        }
        if self.not_finite > 0 {
            rows.push(("no number".into(), self.not_finite));
        }
        bars(&rows)
    }

    /// An edge with as many decimals as the bins' width needs.
    fn label(&self, edge: usize) -> String {
        let half = if self.from == 0.0 { self.width } else { 0.5 * self.width };
        let decimals = (-half.log10().floor()).max(0.0) as usize;
        format!("{:.decimals$}", self.edge(edge as f64))
    }
}

/// Labelled counts with bars, the labels to the right, the counts below each other.
pub(in crate::cli) fn bars(rows: &[(String, u64)]) -> Vec<String> {
    let most = rows.iter().map(|(_, count)| *count).max().unwrap_or(0).max(1);
    let widest = rows.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
    let digits = most.to_string().len();
    let line = |(label, count): &(String, u64)| {
        // In eighths of a character, and at least one where there is anything.
        let eighths =
            ((*count as f64 / most as f64 * (8 * LONGEST) as f64).round() as usize).max(usize::from(*count > 0));
        let part = ["", "▏", "▎", "▍", "▌", "▋", "▊", "▉"][eighths % 8];
        format!("{label:>widest$}  {count:>digits$} {}{part}", "█".repeat(eighths / 8)).trim_end().to_owned()
    };
    rows.iter().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_is_in_one_bin_and_those_on_an_edge_in_the_higher() {
        let samples = [0.0, 0.1, 0.3, 0.7, 1.2, 1.5, 1.5];
        let h = Histogram::positive(&samples).unwrap();
        assert_eq!((h.from, h.width), (0.0, 0.1));
        assert_eq!(h.counts, [1, 1, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 2]);
        assert_eq!((h.below, h.above, h.not_finite), (0, 0, 0));
        let h = Histogram::positive(&[0.0, f64::NAN, 0.0]).unwrap();
        assert_eq!((h.counts, h.not_finite), (vec![2], 1));
        assert_eq!(Histogram::positive(&[]), None);
    }

    #[test]
    fn signed_numbers_have_a_bin_around_zero_and_tails() {
        let samples = [0.0, 0.49, -0.5, -0.51, 0.5, 8.4, 8.5, -100.0, f64::INFINITY];
        let h = Histogram::signed(samples.into_iter(), 3.0);
        assert_eq!((h.from, h.width, h.counts.len()), (-8.5, 1.0, 17));
        assert_eq!((h.counts[8], h.counts[7], h.counts[9], h.counts[16]), (3, 1, 1, 1));
        assert_eq!((h.below, h.above, h.not_finite), (1, 1, 1));
        assert_eq!(h.counts.iter().sum::<u64>() + h.below + h.above + h.not_finite, samples.len() as u64);
    }

    #[test]
    fn widths_are_round() {
        for (least, width) in
            [(0.3, 0.5), (1.0, 1.0), (1.1, 2.0), (0.011, 0.02), (7.0, 10.0), (0.0, 1.0), (f64::NAN, 1.0)]
        {
            assert_eq!(round_up(least), width, "{least}");
        }
    }

    #[test]
    fn bars_are_as_long_as_counts_are_large() {
        let lines = bars(&[("a".into(), 80), ("bb".into(), 41), ("c".into(), 0), ("d".into(), 1)]);
        assert_eq!(lines[0], format!(" a  80 {}", "█".repeat(40)));
        assert_eq!(lines[1], format!("bb  41 {}▌", "█".repeat(20)));
        assert_eq!(lines[2..], [" c   0".to_owned(), " d   1 ▌".to_owned()]);
        let h = Histogram::positive(&[0.1, 0.25]).unwrap();
        assert_eq!(h.lines()[0].split("  ").next(), Some("0.00 … 0.02"));
        assert_eq!(Histogram::signed([0.0].into_iter(), 3.0).lines()[8], format!(" -0.5 … 0.5  1 {}", "█".repeat(40)));
    }
}
