//! Parses numbers in headers.

/// Parses a non-negative whole number.
pub(crate) fn whole(text: &str) -> Result<u64, String> {
    let digits = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
    match text.parse::<u64>() {
        Ok(number) => Ok(number),
        Err(_) if text.strip_prefix('-').is_some_and(digits) => {
            Err(format!("{text} is negative; it must be a whole number from 0 on"))
        }
        Err(_) if digits(text) => Err(format!("{text} does not fit 64 bits; the header is damaged")),
        Err(_) => Err(format!("{text:?} is not a whole number from 0 on; correct it")),
    }
}

/// Parses exactly `N` numbers. Accepts NaN and infinities, in the spelling of C, MSVC and Rust;
/// callers that need finite numbers check for them.
pub(crate) fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let mut numbers = [0.0; N];
    let mut count = 0;
    for token in text.split_whitespace() {
        let Some(value) = number(token) else {
            return Err(format!("{token:?}, number {} of {N}, is not a number; correct it", count + 1));
        };
        if let Some(slot) = numbers.get_mut(count) {
            *slot = value;
        }
        count += 1;
    }
    if count == N {
        Ok(numbers)
    } else {
        Err(format!("holds {count} numbers, but must hold exactly {N}; the line is damaged or was edited"))
    }
}

/// Parses exactly `N` finite numbers.
pub(crate) fn finite<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let values = numbers::<N>(text)?;
    if values.iter().any(|value| !value.is_finite()) {
        return Err(format!("is {text:?}; its numbers must be finite"));
    }
    Ok(values)
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
        assert!(numbers::<16>(&"1 ".repeat(15)).unwrap_err().contains("holds 15 numbers, but must hold exactly 16"));
        assert!(numbers::<2>("1 2 3").unwrap_err().contains("holds 3 numbers"));
        assert!(numbers::<2>("1 x").unwrap_err().contains("\"x\", number 2 of 2, is not a number"));
    }

    #[test]
    fn whole_refuses_with_reason() {
        assert_eq!(whole("12"), Ok(12));
        assert!(whole("-3").unwrap_err().contains("negative"));
        assert!(whole("99999999999999999999").unwrap_err().contains("64 bits"));
        for odd in ["", "-", "1.5", "x", "é"] {
            assert!(whole(odd).unwrap_err().contains("not a whole number"), "{odd}");
        }
    }
}
