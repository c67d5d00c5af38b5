//! The size that a zstd frame claims, before memory of that size is taken.

/// First bytes of a frame.
const MAGIC: [u8; 4] = [0x28, 0xb5, 0x2f, 0xfd];

/// Returns the size of a frame's content by its header; `None` if the header has none, or is not
/// one of zstd.
pub(crate) fn claimed_size(bytes: &[u8]) -> Option<u64> {
    let rest = bytes.strip_prefix(&MAGIC)?;
    let (descriptor, rest) = rest.split_first()?;
    let is_single = descriptor >> 5 & 1 == 1;
    let window = usize::from(!is_single);
    let dictionary = [0, 1, 2, 4][usize::from(descriptor & 3)];
    let size = [usize::from(is_single), 2, 4, 8][usize::from(descriptor >> 6)];
    let size = rest.get(window + dictionary..)?.get(..size).filter(|size| !size.is_empty())?;
    let number = size.iter().rev().fold(0, |number, byte| number << 8 | u64::from(*byte));
    // Sizes of two bytes begin at 256.
    Some(if size.len() == 2 { number + 256 } else { number })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_of_all_lengths_are_read() {
        let of = |header: &[u8]| claimed_size(&[&MAGIC, header].concat());
        assert_eq!(of(&[0x20, 77]), Some(77));
        assert_eq!(of(&[0x60, 1, 2]), Some(0x201 + 256));
        assert_eq!(of(&[0x80, 9, 1, 2, 3, 4]), Some(0x0403_0201));
        assert_eq!(of(&[0xe3, 9, 9, 9, 9, 0, 0, 0, 0, 0, 0, 0, 0x80]), Some(1 << 63));
        assert_eq!(of(&[0x00, 9, 1, 2]), None, "no size");
        assert_eq!(of(&[0xe0, 1, 2]), None, "cut off");
        assert_eq!(claimed_size(b"text"), None);
    }
}
