//! TRANSFORM, POSITION and TDATA: poses.

use super::cursor::{Cursor, Fault, Trouble};
use super::fixed::Fixed;

/// The upper three rows of a 4×4 matrix, column by column as on the wire; the fourth column is a
/// position in mm.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Matrix(
    /// Elements, column by column.
    pub [f32; 12],
);

impl Matrix {
    /// Converts a 4×4 matrix, row major; its last row is dropped, because it is 0, 0, 0, 1.
    pub fn of(rows: &[f64; 16]) -> Self {
        Self(std::array::from_fn(|at| rows[4 * (at % 3) + at / 3] as f32))
    }

    /// Returns the 4×4 matrix, row major.
    pub fn rows(&self) -> [f64; 16] {
        std::array::from_fn(|at| match (at / 4, at % 4) {
            (3, column) => f64::from(u8::from(column == 3)),
            (row, column) => f64::from(self.0[3 * column + row]),
        })
    }

    pub(super) fn read(fields: &mut Cursor<'_>) -> Result<Self, Trouble> {
        let mut matrix = Self::default();
        for number in &mut matrix.0 {
            *number = fields.f32("the matrix")?;
        }
        Ok(matrix)
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        for number in self.0 {
            out.extend_from_slice(&number.to_be_bytes());
        }
    }
}

/// A position and an orientation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    /// Position, mm.
    pub position: [f32; 3],
    /// Quaternion x, y, z, w; 0, 0, 0, 1 for a message with a position only.
    pub quaternion_xyzw: [f32; 4],
}

impl Position {
    /// Reads a position alone (12 bytes), with three of the quaternion's numbers (24), or with
    /// all (28).
    pub(super) fn read(mut fields: Cursor<'_>) -> Result<Self, Trouble> {
        let numbers = match fields.left() {
            12 => 3,
            24 => 6,
            28 => 7,
            other => {
                let problem = format!("a position takes 12, 24 or 28 bytes, not {other}");
                return fields.trouble(Fault::Length, problem);
            }
        };
        let mut all = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0];
        for number in &mut all[..numbers] {
            *number = fields.f32("the position")?;
        }
        let [px, py, pz, x, y, z, mut w] = all;
        if numbers == 6 {
            w = (1.0 - (x * x + y * y + z * z)).max(0.0).sqrt();
        }
        Ok(Self { position: [px, py, pz], quaternion_xyzw: [x, y, z, w] })
    }

    /// Writes all numbers.
    pub(super) fn write(&self, out: &mut Vec<u8>) {
        for number in self.position.iter().chain(&self.quaternion_xyzw) {
            out.extend_from_slice(&number.to_be_bytes());
        }
    }

    /// Returns the pose as a 4×4 matrix, row major. A quaternion of length 0 gives no rotation;
    /// others are normalised.
    pub fn rows(&self) -> [f64; 16] {
        let [mut x, mut y, mut z, mut w] = self.quaternion_xyzw.map(f64::from);
        let length = (x * x + y * y + z * z + w * w).sqrt();
        if length > 0.0 {
            (x, y, z, w) = (x / length, y / length, z / length, w / length);
        } else {
            w = 1.0;
        }
        let [px, py, pz] = self.position.map(f64::from);
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
            px,
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
            py,
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
            pz,
            0.0,
            0.0,
            0.0,
            1.0,
        ]
    }
}

/// Kind of a tracked tool.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ToolKind {
    /// The tracker itself.
    Tracker = 1,
    /// Position and orientation.
    Six = 2,
    /// Its tip only.
    Three = 3,
    /// Tip and handle.
    Five = 4,
}

/// One tracked tool of a TDATA message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tool {
    /// Name.
    pub name: Fixed<20>,
    /// Kind of tool.
    pub kind: ToolKind,
    /// Pose.
    pub matrix: Matrix,
}

/// Bytes of a tool.
const TOOL: usize = 70;

impl Tool {
    pub(super) fn read_all(mut fields: Cursor<'_>) -> Result<Vec<Self>, Trouble> {
        let bytes = fields.left();
        if !bytes.is_multiple_of(TOOL) {
            let problem = format!("a tool takes {TOOL} bytes, and {bytes} is not a multiple of it");
            return fields.trouble(Fault::Length, problem);
        }
        let mut tools = Vec::with_capacity(bytes / TOOL);
        while fields.left() > 0 {
            let name = fields.name("the name")?;
            let offset = fields.offset();
            let kind = match fields.u8("the kind")? {
                1 => ToolKind::Tracker,
                2 => ToolKind::Six,
                3 => ToolKind::Three,
                4 => ToolKind::Five,
                other => {
                    let problem = format!("the kind of a tool is {other}; it must be 1 to 4");
                    return Err(Trouble { fault: Fault::Field, offset, problem });
                }
            };
            fields.u8("the reserved byte")?;
            tools.push(Self { name, kind, matrix: Matrix::read(&mut fields)? });
        }
        Ok(tools)
    }

    pub(super) fn write(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(self.name.bytes());
        out.extend_from_slice(&[self.kind as u8, 0]);
        self.matrix.write(out);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn matrix_is_stored_by_columns_and_returned_by_rows() {
        let rows = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0, 0.0, 0.0, 0.0, 1.0];
        let matrix = Matrix::of(&rows);
        assert_eq!(matrix.0, [1.0, 5.0, 9.0, 2.0, 6.0, 10.0, 3.0, 7.0, 11.0, 4.0, 8.0, 12.0]);
        assert_eq!(matrix.rows(), rows);
    }

    #[test]
    fn quaternion_gives_its_rotation() {
        // A quarter turn about z, of length 2√2.
        let turned = Position { position: [1.0, 2.0, 3.0], quaternion_xyzw: [0.0, 0.0, 2.0, 2.0] }.rows();
        let expected = [0.0, -1.0, 0.0, 1.0, 1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 3.0, 0.0, 0.0, 0.0, 1.0];
        assert!(turned.iter().zip(&expected).all(|(a, b)| (a - b).abs() < 1e-12), "{turned:?}");
        let none = Position { position: [0.0; 3], quaternion_xyzw: [0.0; 4] }.rows();
        assert_eq!([none[0], none[5], none[10]], [1.0; 3]);
    }
}
