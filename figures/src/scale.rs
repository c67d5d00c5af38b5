//! Map from numbers to positions along an axis, and its ticks.

/// Scale of an axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// Equal differences are equally far apart.
    Linear,
    /// Equal ratios are equally far apart.
    Log,
}

/// A tick and its text; without text it is a minor one.
#[derive(Debug, Clone, PartialEq)]
pub struct Tick {
    /// Its position.
    pub at: f64,
    /// Its text.
    pub text: Option<String>,
}

impl Scale {
    /// Returns whether a number has a position.
    pub fn places(self, value: f64) -> bool {
        value.is_finite() && (self == Self::Linear || value > 0.0)
    }

    /// Returns the position of `value` between `low` (0) and `high` (1).
    pub fn place(self, value: f64, [low, high]: [f64; 2]) -> f64 {
        match self {
            Self::Linear => (value - low) / (high - low),
            Self::Log => (value / low).log10() / (high / low).log10(),
        }
    }

    /// Returns a range with round ends that contains all values with a position; [0, 1], or [1,
    /// 10], if none has.
    pub fn range(self, values: impl Iterator<Item = f64>) -> [f64; 2] {
        let (low, high) = values
            .filter(|v| self.places(*v))
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)));
        match self {
            _ if low > high => [f64::from(u8::from(self == Self::Log)), if self == Self::Log { 10.0 } else { 1.0 }],
            Self::Linear => {
                let (low, high) = if low == high { (low - 0.5, high + 0.5) } else { (low, high) };
                let step = step((high - low) / 5.0);
                [(low / step + 1e-9).floor() * step, (high / step - 1e-9).ceil() * step]
            }
            Self::Log => {
                let low = 10_f64.powf((low.log10() + 1e-9).floor());
                let high = 10_f64.powf((high.log10() - 1e-9).ceil());
                [low, if high > low { high } else { low * 10.0 }]
            }
        }
    }

    /// Returns ticks within a range, the low end first; about `count` of them are labelled.
    pub fn ticks(self, [low, high]: [f64; 2], count: f64) -> Vec<Tick> {
        match self {
            Self::Linear => {
                let step = step((high - low) / count.clamp(2.0, 8.0));
                // Just enough digits that neighbouring ticks differ.
                let decimals =
                    (0..9).find(|d| ((step * 10_f64.powi(*d)).round() - step * 10_f64.powi(*d)).abs() < 1e-6);
                let decimals = usize::try_from(decimals.unwrap_or(9)).unwrap_or(9);
                let (first, last) = ((low / step - 1e-9).ceil() as i64, (high / step + 1e-9).floor() as i64);
                (first..=last)
                    .map(|i| Tick {
                        at: i as f64 * step,
                        text: Some(minus(&format!("{:.decimals$}", i as f64 * step))),
                    })
                    .collect()
            }
            Self::Log => {
                let (first, last) = ((low.log10() + 1e-9).floor() as i32, (high.log10() - 1e-9).ceil() as i32);
                let every = ((f64::from(last - first) / count.clamp(2.0, 8.0)).ceil() as i32).max(1);
                let decades = first..=last;
                // Over a smaller range, more digits are labelled, but without overlapping texts.
                let digits: &[u8] = match last - first {
                    _ if high <= low * 4.0 => &[2, 3, 4, 5, 6, 8],
                    _ if high <= low * 10.0 => &[2, 3, 5],
                    ..=2 => &[2, 5],
                    _ => &[],
                };
                let mut ticks = Vec::new();
                for decade in decades {
                    for digit in 1..10_u8 {
                        let at = f64::from(digit) * 10_f64.powi(decade);
                        let named = if digit == 1 { decade % every == 0 } else { digits.contains(&digit) };
                        if at >= low * (1.0 - 1e-9) && at <= high * (1.0 + 1e-9) && (digit == 1 || every == 1) {
                            ticks.push(Tick { at, text: named.then(|| power(digit, decade)) });
                        }
                    }
                }
                ticks
            }
        }
    }
}

/// Returns the round tick distance next to this one.
fn step(distance: f64) -> f64 {
    let decade = 10_f64.powf(distance.log10().floor());
    decade
        * match distance / decade {
            part if part < 1.5 => 1.0,
            part if part < 3.5 => 2.0,
            part if part < 7.5 => 5.0,
            _ => 10.0,
        }
}

/// Returns a number with a minus sign in place of a hyphen; a rounded zero has no sign.
fn minus(text: &str) -> String {
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| matches!(c, '0' | '.')) => digits.to_owned(),
        Some(digits) => format!("−{digits}"),
        None => text.to_owned(),
    }
}

/// Formats a number by its first digit and order of magnitude: 5·10⁻¹⁵.
pub fn order(value: f64) -> String {
    let decade = value.log10().floor();
    match (value / 10_f64.powf(decade)).round() {
        _ if value == 0.0 => "0".to_owned(),
        // Rounded up to the next decade.
        10.0 => power(1, decade as i32 + 1),
        digit => power(digit as u8, decade as i32),
    }
}

/// Formats digit·10^decade: written out from a thousandth to ten thousand, as a power beyond.
fn power(digit: u8, decade: i32) -> String {
    if (-3..=4).contains(&decade) {
        let decimals = usize::try_from(-decade).unwrap_or(0);
        return format!("{:.decimals$}", f64::from(digit) * 10_f64.powi(decade));
    }
    let raised: String = decade
        .to_string()
        .chars()
        .map(|c| match c {
            '-' => '⁻',
            digit => ['⁰', '¹', '²', '³', '⁴', '⁵', '⁶', '⁷', '⁸', '⁹'][digit.to_digit(10).unwrap_or(0) as usize],
        })
        .collect();
    let factor = if digit == 1 { String::new() } else { format!("{digit}·") };
    format!("{factor}10{raised}")
}
