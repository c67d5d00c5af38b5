//! Map of stored pixels to written ones, for crops and changes of orientation.

use formats::image::ELEMENT_SPACING;
use sonoweave_core::region::ClipRect;
use sync::ingest::{mf_size, stored, to_mf};

/// Map from frames as stored to frames as requested.
#[derive(Debug, Clone, PartialEq)]
pub struct Arrangement {
    /// Requested size along the first and second axis, pixels.
    pub size: [u32; 2],
    /// Requested orientation; empty if unknown.
    pub orientation: String,
    /// Whether the axes are exchanged.
    transposed: bool,
    /// Index of the stored pixel for each requested one; `None` if all stay in place.
    places: Option<Vec<u32>>,
}

impl Arrangement {
    /// Returns the map for frames of a size and orientation. An empty orientation means MF; the
    /// crop is in MF pixels.
    ///
    /// # Errors
    /// A sentence: an invalid orientation, or a crop outside the frame.
    pub fn new(size: [u32; 2], code: &str, crop: Option<ClipRect>, wanted: Option<&str>) -> Result<Self, String> {
        if crop.is_none() && wanted.is_none_or(|wanted| wanted == code) {
            return Ok(Self { size, orientation: code.to_owned(), transposed: false, places: None });
        }
        let none = |code: &str| format!("the orientation {code:?} is unknown; give MF, MN, UF, UN, FM, FU, NM or NU");
        let given = if code.trim().is_empty() { "MF" } else { code };
        let wanted = wanted.unwrap_or(given);
        let [width, height] = mf_size(size, given).ok_or_else(|| none(given))?;
        let rect = crop.unwrap_or(ClipRect { x: 0, y: 0, width, height });
        let inside =
            |from: u32, extent: u32, of: u32| from.checked_add(extent).is_some_and(|to| extent > 0 && to <= of);
        if !(inside(rect.x, rect.width, width) && inside(rect.y, rect.height, height)) {
            return Err(format!(
                "the crop of {}×{} pixels from ({}, {}) is not within the frame of {width}×{height} pixels in MF orientation",
                rect.width, rect.height, rect.x, rect.y
            ));
        }
        let number =
            u32::try_from(u64::from(width) * u64::from(height)).map_err(|_| "the frame has more than 2³² pixels")?;
        let mf = to_mf((0..number).collect(), size, given).ok_or_else(|| none(given))?;
        let row = |v: u32| {
            let from = (v * width + rect.x) as usize;
            mf[from..from + rect.width as usize].iter().copied()
        };
        let cropped: Vec<u32> = (rect.y..rect.y + rect.height).flat_map(row).collect();
        let mf_of_crop = [rect.width, rect.height];
        // Transposed orientations transpose the size of an MF frame, too.
        let size = mf_size(mf_of_crop, wanted).ok_or_else(|| none(wanted))?;
        let places = stored(&cropped, mf_of_crop, wanted);
        let turns = |code: &str| mf_size([1, 2], code) == Some([2, 1]);
        let transposed = turns(given) != turns(wanted);
        Ok(Self { size, orientation: wanted.to_owned(), transposed, places: Some(places) })
    }

    /// Returns the index of the stored pixel for a requested one.
    pub fn stored(&self, requested: u32) -> u32 {
        self.places.as_ref().map_or(requested, |places| places[requested as usize])
    }

    /// Exchanges the pixel spacings in a file's fields if the axes are exchanged.
    pub fn turn_spacing(&self, fields: &mut [(String, String)]) {
        let spacing = fields.iter_mut().filter(|(name, _)| self.transposed && name == ELEMENT_SPACING);
        for (_, text) in spacing {
            let mut numbers: Vec<&str> = text.split_whitespace().collect();
            if let [x, y, ..] = &mut numbers[..] {
                std::mem::swap(x, y);
            }
            *text = numbers.join(" ");
        }
    }

    /// Returns the requested pixels, for stored pixels of `bytes` bytes each; `None` if nothing
    /// changes.
    pub fn apply(&self, pixels: &[u8], bytes: usize) -> Option<Vec<u8>> {
        let places = self.places.as_ref()?;
        Some(places.iter().flat_map(|at| &pixels[*at as usize * bytes..][..bytes]).copied().collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PART: ClipRect = ClipRect { x: 1, y: 0, width: 2, height: 2 };

    #[test]
    fn crop_is_in_mf_pixels_for_all_orientations() {
        // The frame that MF stores as rows 1 2 3 / 4 5 6.
        for (code, size, pixels) in [
            ("MFA", [3, 2], [1_u8, 2, 3, 4, 5, 6]),
            ("UN", [3, 2], [6, 5, 4, 3, 2, 1]),
            ("FM", [2, 3], [1, 4, 2, 5, 3, 6]),
        ] {
            for (wanted, expected) in [("MF", [2_u8, 3, 5, 6]), ("UF", [3, 2, 6, 5]), ("NM", [5, 2, 6, 3])] {
                let arrangement = Arrangement::new(size, code, Some(PART), Some(wanted)).unwrap();
                assert_eq!((arrangement.size, arrangement.orientation.as_str()), ([2, 2], wanted));
                assert_eq!(arrangement.apply(&pixels, 1).unwrap(), expected, "{code} to {wanted}");
            }
            let turned = Arrangement::new(size, code, None, Some("FM")).unwrap();
            let pixels = turned.apply(&pixels, 1).unwrap_or(pixels.to_vec());
            assert_eq!((turned.size, pixels), ([2, 3], vec![1, 4, 2, 5, 3, 6]));
            let mut fields = [("Other", "1 2"), (ELEMENT_SPACING, "0.1 0.2 3")].map(|(a, b)| (a.into(), b.into()));
            turned.turn_spacing(&mut fields);
            let expected = if code == "FM" { "0.1 0.2 3" } else { "0.2 0.1 3" };
            assert_eq!((&*fields[0].1, &*fields[1].1), ("1 2", expected), "{code}");
        }
        let wide = Arrangement::new([3, 2], "", Some(PART), None).unwrap();
        assert_eq!(wide.orientation, "MF", "what was assumed is said");
        let pixels: Vec<u8> = (0..12).collect();
        assert_eq!(wide.apply(&pixels, 2).unwrap(), [2, 3, 4, 5, 8, 9, 10, 11]);
    }

    #[test]
    fn invalid_crop_or_orientation_is_refused() {
        let outside = ClipRect { x: 2, ..PART };
        assert!(
            Arrangement::new([3, 2], "MF", Some(outside), None)
                .unwrap_err()
                .contains("not within the frame of 3×2 pixels in MF orientation")
        );
        assert!(
            Arrangement::new([3, 2], "XX", Some(PART), None).unwrap_err().contains("orientation \"XX\" is unknown")
        );
        assert!(
            Arrangement::new([3, 2], "MF", None, Some("MU")).unwrap_err().contains("orientation \"MU\" is unknown")
        );
        assert_eq!(Arrangement::new([3, 2], "XX", None, None).unwrap().orientation, "XX", "left as it is");
    }
}
