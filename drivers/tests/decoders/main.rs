//! Guarantees of every decoder, on streams of every wire format: hand-written vectors, division
//! anywhere, garbage, arbitrary bytes, encoding and decoding.

#![allow(clippy::unwrap_used, reason = "a test that cannot be set up has failed")]

mod ea1;
mod ea1_sketch;
mod fastrak;
mod isotrak;
mod liberty;
mod microscribe;
mod openigtlink;
mod openigtlink_vectors;
mod qsb;
mod stream;
mod viper;

/// Three records, or VIPER's longest reply and two frames. A false beginning of a reply may not
/// delay records any longer.
#[test]
fn lock_bytes_match_documented_bounds() {
    use drivers::arm::{ea1, microscribe, qsb};
    use drivers::framing::Format as _;
    use drivers::tracker::polhemus::{fastrak, isotrak, liberty, viper};

    let fastrak = |mode, codes| fastrak::Fastrak::uniform(2, fastrak::Layout::new(mode, codes).unwrap()).lock_bytes();
    assert_eq!(fastrak(fastrak::Mode::Ascii, &[2, 11, 1]), 3 * 54);
    assert_eq!(fastrak(fastrak::Mode::Ascii, &[2, 11, 0]), 3 * 53);
    assert_eq!(fastrak(fastrak::Mode::Binary, &[2, 11, 0]), 3 * 32);
    assert_eq!(fastrak(fastrak::Mode::Ascii, &[52, 61, 1]), 3 * (3 + 7 * 13 + 2));
    // Shorter than half a status reply, which must still be distinguished from garbage.
    assert_eq!(fastrak(fastrak::Mode::Binary, &[2, 1]), 17 + 56);
    assert_eq!(isotrak::Isotrak::new(1, isotrak::Layout::new(&[2, 11]).unwrap()).lock_bytes(), 3 * 20);
    assert_eq!(liberty::Liberty::new(4, liberty::Layout::new(&[8, 9, 2, 7]).unwrap()).lock_bytes(), 3 * 44);
    assert_eq!(viper::Viper::new(4).lock_bytes(), 1024 + 2 * 156);
    assert_eq!(ea1::Ea1::new().lock_bytes(), 3 * ea1::LONGEST_SAMPLE);
    assert_eq!(qsb::Qsb.lock_bytes(), 3 * 26);
    let request = microscribe::Request::new(microscribe::Family::MicroScribe, 6, false).unwrap();
    assert_eq!(microscribe::Samples::new(request).lock_bytes(), 3 * 14);
}
