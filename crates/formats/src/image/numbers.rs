//! Parses numbers in headers.

/// Reason why a field does not hold the expected numbers.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum BadNumber {
    #[error("{0} is negative; it must be a whole number from 0 on")]
    Negative(String),
    #[error("{0} does not fit 64 bits; correct it, or copy the file again")]
    TooLarge(String),
    #[error("{0:?} is not a whole number from 0 on; correct it")]
    NotWhole(String),
    #[error("{word:?}, number {position} of {expected}, is not a number; correct it")]
    NotNumber { word: String, position: usize, expected: usize },
    #[error("holds {found} numbers, but must hold exactly {expected}; the line is damaged or was edited")]
    Count { found: usize, expected: usize },
    #[error("is {0:?}; its numbers must be finite")]
    NotFinite(String),
    #[error("is {0:?}; it must be a finite number of seconds")]
    NotSeconds(String),
}

/// Parses a non-negative whole number.
pub(crate) fn whole(text: &str) -> Result<u64, BadNumber> {
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    text.parse::<u64>().map_err(|_| match text.strip_prefix('-') {
        Some(magnitude) if digits(magnitude) => BadNumber::Negative(text.to_owned()),
        _ if digits(text) => BadNumber::TooLarge(text.to_owned()),
        _ => BadNumber::NotWhole(text.to_owned()),
    })
}

/// Parses exactly `N` numbers. Accepts NaN and infinities, in the spelling of C, MSVC and Rust;
/// callers that need finite numbers check for them.
pub(crate) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], BadNumber> {
    let mut numbers = [0.0; N];
    let mut found = 0;
    for word in text.split_whitespace() {
        let Some(value) = number(word) else {
            return Err(BadNumber::NotNumber { word: word.to_owned(), position: found + 1, expected: N });
        };
        if let Some(slot) = numbers.get_mut(found) {
            *slot = value;
        }
        found += 1;
    }
    if found == N { Ok(numbers) } else { Err(BadNumber::Count { found, expected: N }) }
}

/// Parses exactly `N` finite numbers.
pub(crate) fn finite<const N: usize>(text: &str) -> Result<[f64; N], BadNumber> {
    let values = numbers::<N>(text)?;
    if values.iter().all(|value| value.is_finite()) { Ok(values) } else { Err(BadNumber::NotFinite(text.to_owned())) }
}

/// Parses a time, s.
pub(crate) fn seconds(text: &str) -> Result<f64, BadNumber> {
    number(text).filter(|seconds| seconds.is_finite()).ok_or_else(|| BadNumber::NotSeconds(text.to_owned()))
}

/// Parses a number in decimal notation.
pub(crate) fn number(token: &str) -> Option<f64> {
    token.parse().ok().or_else(|| {
        let magnitude = token.trim_start_matches(['+', '-']).to_ascii_lowercase();
        let negative = token.starts_with('-');
        if magnitude.starts_with("1.#inf") {
            Some(if negative { f64::NEG_INFINITY } else { f64::INFINITY })
        } else if magnitude.starts_with("1.#") || (magnitude.starts_with("nan(") && magnitude.ends_with(')')) {
            Some(f64::NAN)
        } else {
            None
        }
    })
}

/// Formats the numbers as the shortest decimals that read back the same.
pub(crate) fn list(values: &[f64]) -> String {
    let values: Vec<String> = values.iter().map(f64::to_string).collect();
    values.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_checks_count_and_accepts_c_spelling() {
        assert_eq!(numbers::<3>(" 1  -2.5e-005 3 "), Ok([1.0, -2.5e-5, 3.0]));
        assert_eq!(numbers::<2>("-inf -1.#INF"), Ok([f64::NEG_INFINITY; 2]));
        for nan in ["nan", "-nan", "NaN", "-nan(ind)", "1.#QNAN", "-1.#IND"] {
            assert!(numbers::<1>(nan).unwrap()[0].is_nan(), "{nan}");
        }
        assert_eq!(numbers::<16>(&"1 ".repeat(15)), Err(BadNumber::Count { found: 15, expected: 16 }));
        assert_eq!(numbers::<2>("1 2 3"), Err(BadNumber::Count { found: 3, expected: 2 }));
        assert_eq!(numbers::<2>("1 x"), Err(BadNumber::NotNumber { word: "x".into(), position: 2, expected: 2 }));
    }

    #[test]
    fn whole_refuses_with_reason() {
        assert_eq!(whole("12"), Ok(12));
        assert_eq!(whole("-3"), Err(BadNumber::Negative("-3".into())));
        assert!(matches!(whole("99999999999999999999"), Err(BadNumber::TooLarge(_))));
        for odd in ["", "-", "1.5", "x", "é"] {
            assert_eq!(whole(odd), Err(BadNumber::NotWhole(odd.into())));
        }
    }
}
