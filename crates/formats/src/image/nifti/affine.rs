//! Position of a NIfTI volume: from its matrix (sform), else from its quaternion (qform).

use crate::image::fault::{Fault, Field};
use crate::image::nifti::field::{Bytes, PIXDIM, QFORM_CODE, QOFFSET, QUATERN, SFORM_CODE, SROW, UNITS};
use crate::image::place::Place;

/// Largest deviation of the axes from a rotation, for which a quaternion is written.
const ORTHONORMAL: f64 = 1e-5;

/// Signs that convert between ITK's and NIfTI's coordinates.
const SIGNS: [f64; 3] = [-1.0, -1.0, 1.0];

/// Columns of the matrix from voxel indices to mm, and the first voxel's position; in ITK's or
/// NIfTI's coordinates.
type Affine = ([[f64; 3]; 3], [f64; 3]);

fn turned((columns, origin): Affine) -> Affine {
    let turn = |v: [f64; 3]| std::array::from_fn(|k| SIGNS[k] * v[k]);
    (columns.map(turn), turn(origin))
}

/// Reads the volume's position; `None` if the header gives none.
pub(super) fn read(header: &Bytes<'_>) -> Result<Option<Place>, Fault> {
    let mm = match header.bytes[UNITS] & 7 {
        1 => 1000.0,
        3 => 1e-3,
        _ => 1.0,
    };
    let (name, at, (columns, origin)) = if header.i16(SFORM_CODE) > 0 {
        let rows: [[f64; 4]; 3] = std::array::from_fn(|row| header.f32s(SROW + 16 * row));
        let columns = std::array::from_fn(|axis| std::array::from_fn(|row| rows[row][axis]));
        ("srow", SROW, (columns, std::array::from_fn(|row| rows[row][3])))
    } else if header.i16(QFORM_CODE) > 0 {
        let pixdim: [f64; 4] = header.f32s(PIXDIM);
        let mut columns = rotation(header.f32s(QUATERN));
        if pixdim[0] < 0.0 {
            columns[2] = columns[2].map(|v| -v);
        }
        let columns = std::array::from_fn(|axis| columns[axis].map(|v| v * pixdim[axis + 1]));
        ("quatern", QUATERN, (columns, header.f32s(QOFFSET)))
    } else {
        return Ok(None);
    };
    let wrong = |problem: &str| Field { name: name.into(), value: "".into(), offset: at as u64 }.fault(problem);
    if columns.as_flattened().iter().chain(&origin).any(|v| !v.is_finite()) {
        return Err(wrong("holds numbers that are not finite; correct them"));
    }
    let (columns, origin) = turned((columns, origin));
    let spacing = columns.map(|[x, y, z]| x.hypot(y).hypot(z));
    if spacing.contains(&0.0) {
        return Err(wrong("gives an axis no length; correct it"));
    }
    Ok(Some(Place {
        spacing: spacing.map(|v| v * mm),
        origin: origin.map(|v| v * mm),
        axes: std::array::from_fn(|axis| columns[axis].map(|v| v / spacing[axis])),
    }))
}

/// Header values for a position: the matrix's rows and the position. If the axes form a
/// rotation, also the quaternion and the sign of the third axis.
pub(super) struct Written {
    pub(super) rows: [[f64; 4]; 3],
    pub(super) quaternion: Option<([f64; 3], f64)>,
    pub(super) origin: [f64; 3],
}

pub(super) fn write(place: &Place) -> Written {
    let (axes, origin) = turned((place.axes, place.origin));
    let rows = std::array::from_fn(|row| {
        std::array::from_fn(|axis| if axis == 3 { origin[row] } else { axes[axis][row] * place.spacing[axis] })
    });
    Written { rows, quaternion: quaternion(axes), origin }
}

/// Returns the columns of the rotation given by a unit quaternion's last three numbers.
fn rotation([b, c, d]: [f64; 3]) -> [[f64; 3]; 3] {
    let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
    [
        [a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c)],
        [2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b)],
        [2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c],
    ]
}

/// Returns the quaternion of the axes, and -1 if the third axis is inverted. `None` if they are
/// not orthonormal.
fn quaternion(mut axes: [[f64; 3]; 3]) -> Option<([f64; 3], f64)> {
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    for i in 0..3 {
        for j in 0..3 {
            if (dot(axes[i], axes[j]) - f64::from(u8::from(i == j))).abs() > ORTHONORMAL {
                return None;
            }
        }
    }
    let [x, y, z] = axes;
    let cross = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    let sign = dot(cross, z).signum();
    axes[2] = z.map(|v| v * sign);
    let m = |row: usize, axis: usize| axes[axis][row];
    let trace = m(0, 0) + m(1, 1) + m(2, 2);
    // Divides by the largest of the four numbers, for numerical stability.
    let [a, b, c, d] = if trace > 0.0 {
        let a = 0.5 * (1.0 + trace).sqrt();
        [a, (m(2, 1) - m(1, 2)) / (4.0 * a), (m(0, 2) - m(2, 0)) / (4.0 * a), (m(1, 0) - m(0, 1)) / (4.0 * a)]
    } else {
        let first = (0..3).max_by(|&i, &j| m(i, i).total_cmp(&m(j, j))).unwrap_or(0);
        let (i, j, k) = (first, (first + 1) % 3, (first + 2) % 3);
        let largest = 0.5 * (1.0 + m(i, i) - m(j, j) - m(k, k)).max(0.0).sqrt();
        let mut q = [(m(k, j) - m(j, k)) / (4.0 * largest), 0.0, 0.0, 0.0];
        q[1 + i] = largest;
        q[1 + j] = (m(j, i) + m(i, j)) / (4.0 * largest);
        q[1 + k] = (m(k, i) + m(i, k)) / (4.0 * largest);
        q
    };
    let positive = if a < 0.0 { -1.0 } else { 1.0 };
    Some(([b, c, d].map(|v| v * positive), sign))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternion_roundtrips_axes() {
        let (c, s) = (0.8, 0.6);
        for axes in [
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
            [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]],
            [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]],
            [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
            [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]],
            [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]],
            [[0.0, c, s], [1.0, 0.0, 0.0], [0.0, s, -c]],
            [[-c, 0.0, s], [0.0, 1.0, 0.0], [s, 0.0, c]],
        ] {
            let (q, sign) = quaternion(axes).unwrap();
            let mut back = rotation(q);
            back[2] = back[2].map(|v| v * sign);
            let off =
                back.as_flattened().iter().zip(axes.as_flattened()).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-12, "{axes:?} came back as {back:?}");
        }
        assert!(quaternion([[1.0, 0.0, 0.0], [0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]).is_none(), "a shear is no rotation");
    }
}
