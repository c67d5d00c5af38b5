//! Histograms of numbers, as counts and as bars of text.

use serde::Serialize;

/// Characters of the longest bar.
const LONGEST: usize = 40;
/// Largest number of bins of a histogram that begins at 0.
const BINS: usize = 16;
/// Bins of a signed histogram to either side of the middle one.
const SIDE: usize = 8;
/// Smallest width of a bin, standard deviations; it is rounded up to a round number.
const BIN_SPREAD: f64 = 0.3;
/// Tolerance at bin edges, relative to a bin's width.
const ROUNDING: f64 = 1e-9;

/// Counts of numbers in bins of equal width.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Histogram {
    /// Start of the first bin.
    from: f64,
    /// A bin's width; a number on the edge of two bins is in the higher one.
    width: f64,
    counts: Vec<u64>,
    /// Numbers below the first bin.
    below: u64,
    /// Numbers from the end of the last bin on.
    above: u64,
    /// Numbers that are NaN or infinite.
    not_finite: u64,
}

/// Returns the smallest of 1, 2, 5 times a power of ten that is not below `least`; 1 if `least`
/// is not a positive finite number.
pub(crate) fn round_up(least: f64) -> f64 {
    if !(least > 0.0 && least.is_finite()) {
        return 1.0;
    }
    // Parsing the digits gives the nearest number to the power of ten, which also prints as
    // such.
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
            // Edges are meant as decimals: a number within their rounding error of an edge is on
            // it.
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

    /// Makes a histogram of numbers of either sign, with a bin around 0. Numbers beyond about
    /// 2.5 times their root mean square `rms` are counted below or above.
    pub(crate) fn signed(samples: impl Iterator<Item = f64>, rms: f64) -> Self {
        let width = round_up(BIN_SPREAD * rms);
        Self::of(samples, -(SIDE as f64 + 0.5) * width, width, 2 * SIDE + 1)
    }

    /// Makes a histogram of numbers from 0 up to the largest; `None` without numbers.
    pub(crate) fn positive(samples: &[f64]) -> Option<Self> {
        let most = samples.iter().copied().filter(|s| s.is_finite()).fold(0.0, f64::max);
        let width = round_up(most / (BINS - 1) as f64);
        // One more than needed if the largest is on an edge: it is in the bin that begins there.
        let bins = (most / width + ROUNDING).floor() as usize + 1;
        (!samples.is_empty()).then(|| Self::of(samples.iter().copied(), 0.0, width, bins))
    }

    /// Formats a line a bin, the longest bar for the fullest.
    pub(crate) fn lines(&self) -> Vec<String> {
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

    /// Formats an edge with as many decimals as the bins' width needs.
    fn label(&self, edge: usize) -> String {
        let half = if self.from == 0.0 { self.width } else { 0.5 * self.width };
        let decimals = (-half.log10().floor()).max(0.0) as usize;
        format!("{:.decimals$}", self.edge(edge as f64))
    }
}

/// Formats labelled counts with bars: labels right-aligned, counts in one column.
pub(crate) fn bars(rows: &[(String, u64)]) -> Vec<String> {
    let most = rows.iter().map(|(_, count)| *count).max().unwrap_or(0).max(1);
    let widest = rows.iter().map(|(label, _)| label.chars().count()).max().unwrap_or(0);
    let digits = most.to_string().len();
    let line = |(label, count): &(String, u64)| {
        // The length is in eighths of a character, and at least one if the count is not 0.
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
    fn number_on_edge_falls_in_higher_bin() {
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
    fn signed_has_bin_around_zero_and_tails() {
        let samples = [0.0, 0.49, -0.5, -0.51, 0.5, 8.4, 8.5, -100.0, f64::INFINITY];
        let h = Histogram::signed(samples.into_iter(), 3.0);
        assert_eq!((h.from, h.width, h.counts.len()), (-8.5, 1.0, 17));
        assert_eq!((h.counts[8], h.counts[7], h.counts[9], h.counts[16]), (3, 1, 1, 1));
        assert_eq!((h.below, h.above, h.not_finite), (1, 1, 1));
        assert_eq!(h.counts.iter().sum::<u64>() + h.below + h.above + h.not_finite, samples.len() as u64);
    }

    #[test]
    fn round_up_gives_1_2_5_decades() {
        for (least, width) in
            [(0.3, 0.5), (1.0, 1.0), (1.1, 2.0), (0.011, 0.02), (7.0, 10.0), (0.0, 1.0), (f64::NAN, 1.0)]
        {
            assert_eq!(round_up(least), width, "{least}");
        }
    }

    #[test]
    fn bars_lengths_proportional_to_counts() {
        let lines = bars(&[("a".into(), 80), ("bb".into(), 41), ("c".into(), 0), ("d".into(), 1)]);
        assert_eq!(lines[0], format!(" a  80 {}", "█".repeat(40)));
        assert_eq!(lines[1], format!("bb  41 {}▌", "█".repeat(20)));
        assert_eq!(lines[2..], [" c   0".to_owned(), " d   1 ▌".to_owned()]);
        let h = Histogram::positive(&[0.1, 0.25]).unwrap();
        assert_eq!(h.lines()[0].split("  ").next(), Some("0.00 … 0.02"));
        assert_eq!(Histogram::signed([0.0].into_iter(), 3.0).lines()[8], format!(" -0.5 … 0.5  1 {}", "█".repeat(40)));
    }
}
