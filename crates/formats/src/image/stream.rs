//! Reads pixel data frame by frame: raw, compressed or as text, into native byte order.

use std::io::{self, BufRead, Seek};
use std::path::{Path, PathBuf};

use flate2::{Decompress, FlushDecompress, Status};

use sonoweave_core::reading::PixelType;

use crate::Error;
use crate::image::digits;
use crate::image::layout::{Encoding, Layout};

/// Largest gzip window, as a power of two.
const GZIP_WINDOW: u8 = 15;

/// Reads layers (frames or slices) in sequence. Holds no layer itself.
///
/// Calls the decompressor directly: the adapters of `flate2` report a truncated stream like a
/// complete one.
pub struct PixelStream<R> {
    reader: R,
    /// The file, for errors.
    path: PathBuf,
    encoding: Encoding,
    inflate: Option<Decompress>,
    ended: bool,
    pixel: PixelType,
    /// Decompressed bytes still to be skipped.
    skip: u64,
    /// Position of the data in the file, and the number of its bytes consumed.
    data_at: u64,
    consumed: u64,
    data_bytes: u64,
    layers: u64,
    next: u64,
    /// Size of a scalar whose bytes must be reversed; 1 if none.
    swap: usize,
}

impl<R: BufRead> PixelStream<R> {
    /// Creates a stream; `reader` must be at the beginning of the data in the file `path`.
    pub fn new(reader: R, path: &Path, layout: &Layout) -> Self {
        let native = layout.encoding == Encoding::Text || layout.big_endian == cfg!(target_endian = "big");
        let swap = if native { 1 } else { layout.pixel.bytes() };
        Self {
            reader,
            path: path.to_owned(),
            encoding: layout.encoding,
            inflate: decompress(layout.encoding),
            ended: false,
            pixel: layout.pixel,
            skip: layout.skip_bytes,
            data_at: layout.data_at,
            consumed: 0,
            data_bytes: layout.data_bytes,
            layers: layout.layers,
            next: 0,
            swap,
        }
    }

    /// Fills `out`, which has the length of a layer. The last layer also verifies the stream's
    /// end and checksum, so that a damaged stream always gives an error.
    ///
    /// # Errors
    /// [`Error::Data`] when the data do not match the header, [`Error::Io`] when the file cannot be
    /// read.
    pub fn read(&mut self, out: &mut [u8]) -> Result<(), Error> {
        self.leave_out()?;
        if self.encoding == Encoding::Text {
            self.parse(out)?;
        } else if self.inflate.is_some() {
            let filled = self.inflate(out)?;
            if filled < out.len() {
                return Err(self.data(format!(
                    "the compressed data end after {filled} of its {} bytes; the file is damaged or its header promises too much: copy or record it again",
                    out.len()
                )));
            }
        } else {
            self.copy(out)?;
        }
        if self.next + 1 == self.layers {
            self.check_end()?;
        }
        self.next += 1;
        if self.swap > 1 {
            out.chunks_exact_mut(self.swap).for_each(<[u8]>::reverse);
        }
        Ok(())
    }

    /// Skips layers of `bytes` each. Nothing of raw data is read; other data are read as usual.
    ///
    /// # Errors
    /// Same as [`Self::read`].
    pub fn skip(&mut self, layers: u64, bytes: usize) -> Result<(), Error>
    where
        R: Seek,
    {
        if self.encoding != Encoding::Raw {
            let mut layer = vec![0; bytes];
            return (0..layers).try_for_each(|_| self.read(&mut layer));
        }
        let skipped = i64::try_from(layers * bytes as u64).unwrap_or(i64::MAX);
        self.reader.seek_relative(skipped).map_err(|error| self.failed(error))?;
        self.consumed += layers * bytes as u64;
        self.next += layers;
        Ok(())
    }

    /// Skips the data before the first pixel.
    fn leave_out(&mut self) -> Result<(), Error> {
        let mut scratch = [0; 4096];
        while self.skip > 0 {
            let count = usize::try_from(self.skip).unwrap_or(usize::MAX).min(scratch.len());
            let filled = match self.encoding {
                Encoding::Text => self.reader.read(&mut scratch[..count]).map_err(|error| self.failed(error))?,
                _ => self.inflate(&mut scratch[..count])?,
            };
            if filled == 0 {
                return Err(self.data(
                    "the data are shorter than the bytes to be skipped before them; correct the field that gives their number",
                ));
            }
            if self.encoding == Encoding::Text {
                self.consumed += filled as u64;
            }
            self.skip -= filled as u64;
        }
        Ok(())
    }

    /// Reads numbers written as text.
    fn parse(&mut self, out: &mut [u8]) -> Result<(), Error> {
        for scalar in out.chunks_exact_mut(self.pixel.bytes()) {
            let Some(token) = self.token()? else {
                return Err(self.data(
                    "there are fewer numbers than pixels; the file is cut short or its header promises too much: copy it again",
                ));
            };
            if digits::put(&token, self.pixel, scalar).is_none() {
                let (token, pixel): (String, _) = (token.chars().take(40).collect(), self.pixel);
                return Err(self.data(format!("{token:?} is not a value of {pixel:?}; correct it or the type")));
            }
        }
        Ok(())
    }

    fn token(&mut self) -> Result<Option<String>, Error> {
        digits::token(&mut self.reader, &mut self.consumed).map_err(|error| self.failed(error))
    }

    fn data(&self, problem: impl Into<String>) -> Error {
        let (path, offset) = (self.path.clone(), self.data_at + self.consumed);
        Error::Data { path, frame: self.next, offset, problem: problem.into() }
    }

    fn failed(&self, source: io::Error) -> Error {
        Error::Io { path: self.path.clone(), doing: "reading pixels", source }
    }

    fn copy(&mut self, out: &mut [u8]) -> Result<(), Error> {
        match self.reader.read_exact(out) {
            Ok(()) => {
                self.consumed += out.len() as u64;
                Ok(())
            }
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                Err(self.data("the file has become shorter since it was opened; copy or record it again"))
            }
            Err(error) => Err(self.failed(error)),
        }
    }

    /// Fills as much of `out` as the stream provides; less only when the compressed stream has
    /// ended.
    fn inflate(&mut self, out: &mut [u8]) -> Result<usize, Error> {
        let mut filled = 0;
        while filled < out.len() && !self.ended {
            let Some(inflate) = &mut self.inflate else { break };
            let input = match self.reader.fill_buf() {
                Ok(input) => input,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(self.failed(error)),
            };
            let left = usize::try_from(self.data_bytes - self.consumed).unwrap_or(usize::MAX);
            let input = &input[..input.len().min(left)];
            let nothing_left = input.is_empty();
            let (before_in, before_out) = (inflate.total_in(), inflate.total_out());
            let outcome = inflate.decompress(input, &mut out[filled..], FlushDecompress::None);
            let (taken, made) = (inflate.total_in() - before_in, inflate.total_out() - before_out);
            self.reader.consume(taken as usize);
            self.consumed += taken;
            filled += made as usize;
            match outcome {
                // Gzip may continue with a further member, as written by parallel compressors.
                Ok(Status::StreamEnd) if self.encoding == Encoding::Gzip && self.consumed < self.data_bytes => {
                    self.inflate = decompress(self.encoding);
                }
                Ok(Status::StreamEnd) => self.ended = true,
                Ok(_) if taken == 0 && made == 0 => {
                    let why = if nothing_left {
                        "the file ends within the compressed data"
                    } else {
                        "the compressed data make no progress"
                    };
                    return Err(self.data(format!("{why}; copy or record it again")));
                }
                Ok(_) => {}
                Err(error) => {
                    return Err(
                        self.data(format!("the compressed data are damaged ({error}); copy or record the file again"))
                    );
                }
            }
        }
        Ok(filled)
    }

    fn check_end(&mut self) -> Result<(), Error> {
        if self.encoding == Encoding::Text && self.token()?.is_some() {
            return Err(self.data(
                "more numbers follow the last frame that the header promises; correct it or write the file again",
            ));
        }
        if self.inflate.is_some() {
            if self.inflate(&mut [0])? != 0 {
                return Err(
                    self.data("more pixels follow the last frame that the header promises; correct it or record again")
                );
            }
            if self.consumed != self.data_bytes {
                let after = self.data_bytes - self.consumed;
                return Err(
                    self.data(format!("{after} bytes follow the compressed data; remove them or copy the file again"))
                );
            }
        }
        Ok(())
    }
}

fn decompress(encoding: Encoding) -> Option<Decompress> {
    match encoding {
        Encoding::Zlib => Some(Decompress::new(true)),
        Encoding::Gzip => Some(Decompress::new_gzip(GZIP_WINDOW)),
        Encoding::Raw | Encoding::Text => None,
    }
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::io::{BufReader, Read, Write};
    use std::rc::Rc;

    use super::*;
    use crate::image::Content;
    use crate::image::fault::Field;
    use sonoweave_core::reading::PixelType;

    fn layout(layers: u64, layer_bytes: usize, pixel: PixelType, big_endian: bool, zlib: bool, data: &[u8]) -> Layout {
        Layout {
            content: Content::Sequence,
            shape: Field { name: "DimSize".into(), value: "".into(), offset: 0 },
            size: [u32::try_from(layer_bytes / pixel.bytes()).unwrap(), 1],
            layers,
            pixel,
            channels: 1,
            layer_bytes,
            big_endian,
            encoding: if zlib { Encoding::Zlib } else { Encoding::Raw },
            list: crate::image::layout::ListAxis::Last,
            data_file: None,
            skip_bytes: 0,
            data_at: 1000,
            data_bytes: data.len() as u64,
        }
    }

    fn deflated(bytes: &[u8]) -> Vec<u8> {
        let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(bytes).unwrap();
        encoder.finish().unwrap()
    }

    fn all(data: &[u8], layout: &Layout) -> Result<Vec<u8>, Error> {
        let mut stream = PixelStream::new(data, Path::new("f.mha"), layout);
        let mut whole = Vec::new();
        let mut layer = vec![0; layout.layer_bytes];
        for _ in 0..layout.layers {
            stream.read(&mut layer)?;
            whole.extend_from_slice(&layer);
        }
        Ok(whole)
    }

    /// The values are hand-made, so that the same wrong swap in reader and writer is detected.
    #[test]
    fn byte_order_becomes_native_for_every_width() {
        use PixelType::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        let big: [(PixelType, &[u8], &[u8]); 10] = [
            (U8, &[1, 2], &[1, 2]),
            (I8, &[0xff, 2], &[0xff, 2]),
            (U16, &[1, 2], &0x0102_u16.to_ne_bytes()),
            (I16, &[0xff, 0xfe], &(-2_i16).to_ne_bytes()),
            (U32, &[0, 0, 1, 2], &258_u32.to_ne_bytes()),
            (I32, &[0xff, 0xff, 0xff, 0xfe], &(-2_i32).to_ne_bytes()),
            (U64, &[0, 0, 0, 0, 0, 0, 1, 2], &258_u64.to_ne_bytes()),
            (I64, &[0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xfe], &(-2_i64).to_ne_bytes()),
            (F32, &[0x3f, 0xc0, 0, 0], &1.5_f32.to_ne_bytes()),
            (F64, &[0x3f, 0xf8, 0, 0, 0, 0, 0, 0], &1.5_f64.to_ne_bytes()),
        ];
        for (pixel, data, native) in big {
            let mut little = data.to_vec();
            little.chunks_exact_mut(pixel.bytes()).for_each(<[u8]>::reverse);
            for (stored, big_endian) in [(data, true), (&little[..], false)] {
                for zlib in [false, true] {
                    let packed = if zlib { deflated(stored) } else { stored.to_vec() };
                    let got = all(&packed, &layout(1, data.len(), pixel, big_endian, zlib, &packed)).unwrap();
                    assert_eq!(got, native, "{pixel:?} {big_endian} {zlib}");
                }
            }
        }
    }

    #[test]
    fn stream_of_wrong_length_is_refused() {
        let pixels: Vec<u8> = (0..200_u16).map(|n| (n * 37 % 251) as u8).collect();
        let whole = deflated(&pixels);
        let promised = layout(4, 50, PixelType::U8, false, true, &whole);
        assert_eq!(all(&whole, &promised).unwrap(), pixels);
        for cut in 0..whole.len() {
            let cut = &whole[..cut];
            let error = all(cut, &Layout { data_bytes: cut.len() as u64, ..promised.clone() }).unwrap_err();
            let Error::Data { offset, problem, .. } = error else { panic!("{error}") };
            assert!(offset <= 1000 + cut.len() as u64);
            assert!(problem.contains("ends within the compressed data"), "{problem}");
        }
        let check = |read: Result<Vec<u8>, Error>, frame: u64, text: &str| match read.unwrap_err() {
            Error::Data { frame: f, problem, .. } => assert!(f == frame && problem.contains(text), "{f} {problem}"),
            other => panic!("{other}"),
        };
        check(all(&whole, &Layout { layers: 5, ..promised.clone() }), 4, "end after 0 of its 50 bytes");
        check(all(&whole, &Layout { layers: 3, ..promised.clone() }), 2, "more pixels follow the last frame");
        let mut longer = whole.clone();
        longer.push(0);
        check(all(&longer, &Layout { data_bytes: longer.len() as u64, ..promised.clone() }), 3, "1 bytes follow");
        let mut flipped = whole.clone();
        *flipped.last_mut().unwrap() ^= 1;
        check(all(&flipped, &promised), 3, "damaged");
        check(all(&pixels[..120], &layout(4, 50, PixelType::U8, false, false, &pixels)), 2, "has become shorter");
    }

    struct Counting<R>(R, Rc<Cell<usize>>);

    impl<R: Read> Read for Counting<R> {
        fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
            let got = self.0.read(out)?;
            self.1.set(self.1.get() + got);
            Ok(got)
        }
    }

    #[test]
    fn stream_reads_no_further_than_needed() {
        let frame = 10_000;
        let pixels: Vec<u8> = (0..100 * frame).map(|n: usize| n as u8).collect();
        let count = Rc::new(Cell::new(0));
        let reader = BufReader::with_capacity(512, Counting(&pixels[..], Rc::clone(&count)));
        let mut stream =
            PixelStream::new(reader, Path::new("f.mha"), &layout(100, frame, PixelType::U8, false, false, &pixels));
        let mut out = vec![0; frame];
        for frames in 1..=100 {
            stream.read(&mut out).unwrap();
            assert!(count.get() <= frames * frame + 512, "{} bytes for {frames} frames", count.get());
        }
    }
}
