//! Reads the position of an NRRD volume in space, in ITK's coordinates: left, posterior,
//! superior, if the file gives its orientation.

use crate::image::fault::{Fault, Field};
use crate::image::header::Header;
use crate::image::numbers::{finite, number};
use crate::image::place::Place;

pub(super) fn place(header: &Header) -> Result<Place, Fault> {
    let signs = signs(header)?;
    let turned = |v: [f64; 3]| std::array::from_fn(|k| signs[k] * v[k]);
    let mut place = Place::PLAIN;
    if let Some(field) = header.get("space directions") {
        let vectors = vectors(field)?;
        let Ok(steps) = <[[f64; 3]; 3]>::try_from(vectors) else {
            return Err(
                field.fault(format!("is {:?}; a volume has three directions of three numbers each", &*field.value))
            );
        };
        for (axis, step) in steps.into_iter().enumerate() {
            let spacing = length(step);
            if !(spacing > 0.0 && spacing.is_finite()) {
                return Err(field.fault(format!("is {:?}; a direction must have a length", &*field.value)));
            }
            place.spacing[axis] = spacing;
            place.axes[axis] = turned(step.map(|v| v / spacing));
        }
    } else if let Some(field) = header.get("spacings") {
        let numbers: Option<Vec<f64>> = field.value.split_whitespace().map(number).collect();
        let last = numbers.as_deref().and_then(<[f64]>::last_chunk::<3>);
        match last.filter(|spacing| spacing.iter().all(|mm| *mm > 0.0 && mm.is_finite())) {
            Some(spacing) => place.spacing = *spacing,
            None => {
                return Err(field.fault(format!("is {:?}; a volume has three spacings, all positive", &*field.value)));
            }
        }
    }
    if let Some(field) = header.get("space origin") {
        match vectors(field)?[..] {
            [origin] => place.origin = turned(origin),
            _ => return Err(field.fault(format!("is {:?}; it must be one point of three numbers", &*field.value))),
        }
    }
    Ok(place)
}

/// Reads the spacing of a sequence's pixels, mm, and of the images' single slice. Uses the
/// space directions of the axes, of which there may be two, else their spacings.
pub(super) fn spacing(header: &Header) -> Option<[f64; 3]> {
    let lengths: Vec<f64> = if let Some(field) = header.get("space directions") {
        let vectors = field.value.split('(').skip(1).map(|rest| {
            let inside = rest.split_once(')')?.0;
            inside.split(',').try_fold(0.0, |sum: f64, token| Some(sum.hypot(number(token.trim())?)))
        });
        vectors.collect::<Option<_>>()?
    } else {
        let numbers: Option<Vec<f64>> = header.get("spacings")?.value.split_whitespace().map(number).collect();
        // Axes outside space have no spacing.
        numbers?.into_iter().filter(|mm| !mm.is_nan()).collect()
    };
    match lengths[..] {
        [x, y] => Some([x, y, 1.0]),
        [x, y, z] => Some([x, y, z]),
        _ => None,
    }
}

/// Returns the vector's length, exactly if it lies along an axis.
fn length(v: [f64; 3]) -> f64 {
    match v {
        [x, 0.0, 0.0] => x.abs(),
        [0.0, y, 0.0] => y.abs(),
        [0.0, 0.0, z] => z.abs(),
        [x, y, z] => x.hypot(y).hypot(z),
    }
}

/// Returns the sign of each coordinate in ITK's space.
fn signs(header: &Header) -> Result<[f64; 3], Fault> {
    let Some(field) = header.get("space") else {
        return match header.get("space dimension").filter(|field| &*field.value != "3") {
            Some(field) if header.get("space directions").is_some() => {
                Err(field.fault(format!("is {}; a volume lies in a space of 3", &*field.value)))
            }
            _ => Ok([1.0; 3]),
        };
    };
    match field.value.to_ascii_lowercase().as_str() {
        "right-anterior-superior" | "ras" => Ok([-1.0, -1.0, 1.0]),
        "left-anterior-superior" | "las" => Ok([1.0, -1.0, 1.0]),
        "left-posterior-superior" | "lps" | "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => Ok([1.0; 3]),
        other => Err(field.fault(format!(
            "is {other:?}, which is not a supported space of three dimensions; use left-posterior-superior"
        ))),
    }
}

/// Parses the vectors of a field, without those that are `none`.
fn vectors(field: &Field) -> Result<Vec<[f64; 3]>, Fault> {
    let wrong =
        || field.fault(format!("is {:?}; it must hold vectors such as (1,0,0) and the word none", &*field.value));
    let mut found = Vec::new();
    let mut rest = field.value.trim();
    while !rest.is_empty() {
        if let Some(after) = rest.strip_prefix("none") {
            rest = after.trim_start();
            continue;
        }
        let (inside, after) = rest.strip_prefix('(').and_then(|rest| rest.split_once(')')).ok_or_else(wrong)?;
        found.push(finite::<3>(&inside.replace(',', " ")).map_err(|problem| field.fault(problem))?);
        rest = after.trim_start();
    }
    Ok(found)
}

/// Returns the quoted texts of a field.
pub(super) fn quoted(value: &str) -> Vec<&str> {
    value.split('"').skip(1).step_by(2).collect()
}

#[cfg(test)]
mod tests {
    use super::super::grammar::GRAMMAR;
    use super::*;
    use crate::Limits;
    use crate::image::header::Parser;

    fn of(lines: &str) -> Result<Place, Fault> {
        let mut parser = Parser::new(&GRAMMAR, Limits::default());
        for line in "NRRD0004\n".split_inclusive('\n').chain(lines.split_inclusive('\n')) {
            parser.line(line.as_bytes())?;
        }
        place(&parser.finish()?)
    }

    #[test]
    fn place_matches_itk() {
        let lines = |space: &str| {
            format!("space: {space}\nspace directions: none (0,-2,0) (0.5, 0, 0) (0,0,3)\nspace origin: (1,2,-3)\n")
        };
        let lps = of(&lines("left-posterior-superior")).unwrap();
        assert_eq!(lps.spacing, [2.0, 0.5, 3.0]);
        assert_eq!(lps.axes, [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(lps.origin, [1.0, 2.0, -3.0]);
        let ras = of(&lines("RAS")).unwrap();
        assert_eq!(ras.axes, [[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
        assert_eq!(ras.origin, [-1.0, -2.0, -3.0]);
        assert_eq!(of(&lines("LAS")).unwrap().origin, [1.0, -2.0, -3.0]);
        assert_eq!(of(&lines("3D-right-handed")).unwrap(), lps);
        assert_eq!(of("spacings: nan 1 2 3\n").unwrap().spacing, [1.0, 2.0, 3.0]);
        assert_eq!(of("").unwrap(), Place::PLAIN);
    }

    #[test]
    fn invalid_place_is_refused() {
        for (lines, expected) in [
            ("space directions: (1,0,0) (0,1,0)\n", "three directions"),
            ("space directions: (1,0,0) (0,1,0) (0,0,0)\n", "must have a length"),
            ("space directions: (1,0,0) (0,1,0) (0,0,nan)\n", "must be finite"),
            ("space directions: (1,0,0) (0,1,0) (0,0,1\n", "must hold vectors"),
            ("space dimension: 2\nspace directions: (1,0) (0,1) none\n", "a space of 3"),
            ("space: here\n", "not a supported space of three"),
            ("spacings: 1 0 1\n", "all positive"),
            ("space origin: (1,2)\n", "holds 2 numbers"),
            ("space origin: none\n", "one point"),
        ] {
            let problem = of(lines).unwrap_err().sentence();
            assert!(problem.contains(expected), "{problem:?} does not contain {expected:?}");
        }
    }
}
