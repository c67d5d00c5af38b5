//! Sets input, standard or timings, format and rate.

use std::io;

use super::super::interlace::Order;
use super::super::pixels::{Layout, Matrix, PixelFormat, Range, name_of};
use super::super::{GrabberSettings, Standard};
use super::choose::{Offer, choose};
use super::setup_error::SetupError;
use super::system_calls::{Format, Input, Node, Sizes, number};

/// The current settings of a device, and their meaning.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Setup {
    pub(crate) input: Option<u32>,
    pub(crate) layout: Layout,
    pub(crate) field: u32,
    /// Whether the standard has 525 lines (NTSC), which decides the older field.
    pub(crate) lines_525: bool,
    /// Frames per second, as the driver reports them.
    pub(crate) rate_hz: Option<f64>,
}

impl Setup {
    /// Returns the interlacing of a buffer with this `field`.
    pub(crate) const fn order(&self, field: u32) -> Order {
        Order::new(field, self.lines_525)
    }
}

/// Adapts a kernel error for `map_err`.
pub(crate) fn doing(doing: &'static str) -> impl Fn(io::Error) -> SetupError {
    move |source| SetupError::Refused { doing, source }
}

/// Applies the settings to a node that does not stream.
pub(crate) fn set_up(node: &Node, settings: &GrabberSettings) -> Result<Setup, SetupError> {
    let input = choose_input(node, settings)?;
    let mut lines_525 = false;
    let mut rate_hz = None;
    if let Some(input) = &input {
        if input.can & number::INPUT_HAS_STANDARDS != 0 {
            lines_525 = set_standard(node, input, settings)?;
            rate_hz = Some(if lines_525 { 30000.0 / 1001.0 } else { 25.0 });
        }
        if input.can & number::INPUT_HAS_TIMINGS != 0 {
            rate_hz = set_timings(node)?;
        }
    }
    let offer = choose(&offers(node), settings)?;
    // The driver chooses the field order, because it knows its source.
    let format = node.set_format(offer.format.fourcc(), offer.size, 0).map_err(doing("setting the format"))?;
    if PixelFormat::from_fourcc(format.fourcc) != Some(offer.format) {
        return Err(SetupError::Unfit(format!(
            "it offered {} and gives {}; choose another format",
            offer.format,
            name_of(format.fourcc)
        )));
    }
    if settings.size.is_some_and(|size| size != format.size) {
        let [width, height] = format.size;
        return Err(SetupError::Unfit(format!("it gives {width}×{height} instead of the requested size")));
    }
    if let Some(rate) = set_rate(node, &offer, settings) {
        rate_hz = Some(rate);
    }
    Ok(Setup {
        input: input.map(|input| input.index),
        layout: layout(offer.format, &format, settings),
        field: format.field,
        lines_525,
        rate_hz,
    })
}

fn choose_input(node: &Node, settings: &GrabberSettings) -> Result<Option<Input>, SetupError> {
    let inputs = node.inputs();
    let Some(requested) = &settings.input else {
        let current = node.input().ok();
        return Ok(inputs.into_iter().find(|input| Some(input.index) == current));
    };
    let is_it = |input: &&Input| input.name.eq_ignore_ascii_case(requested) || input.index.to_string() == *requested;
    let Some(input) = inputs.iter().find(is_it).cloned() else {
        let names: Vec<String> = inputs.iter().map(|input| format!("{} ({})", input.name, input.index)).collect();
        return Err(SetupError::Unfit(format!("it has no input {requested}; its inputs are {}", names.join(", "))));
    };
    if node.input().ok() != Some(input.index) {
        node.set_input(input.index).map_err(doing("choosing the input"))?;
    }
    Ok(Some(input))
}

/// Sets the standard; returns whether the current standard has 525 lines.
fn set_standard(node: &Node, input: &Input, settings: &GrabberSettings) -> Result<bool, SetupError> {
    let requested = match settings.standard {
        Some(Standard::Ntsc) => number::STANDARD_NTSC,
        Some(Standard::Pal) => number::STANDARD_PAL,
        Some(Standard::Secam) => number::STANDARD_SECAM,
        // Uses the detected standard, if any; a device that cannot detect it reports all or none.
        None => {
            let seen = node.query_standard().unwrap_or(0) & input.standards;
            let one_system = (seen & number::STANDARD_525 == 0) != (seen & !number::STANDARD_525 == 0);
            if one_system { seen } else { 0 }
        }
    };
    if requested != 0 && node.standard().ok() != Some(requested) {
        node.set_standard(requested).map_err(doing("setting the video standard"))?;
    }
    let standard = node.standard().map_err(doing("reading the video standard"))?;
    Ok(standard & number::STANDARD_525 != 0)
}

/// Applies the timings of the source; keeps the current ones if there is no source. Returns
/// frames per second.
fn set_timings(node: &Node) -> Result<Option<f64>, SetupError> {
    let timings = match node.query_timings() {
        Ok(seen) => {
            node.set_timings(&seen).map_err(doing("setting the timings"))?;
            Some(seen)
        }
        // No link, no lock, or out of range: the device determines the video until the source
        // changes.
        Err(_) => node.timings().ok(),
    };
    Ok(timings.map(|timings| timings.rate).filter(|&rate| rate > 0.0))
}

/// Returns every convertible format at every listed size; for a range, the current size within
/// it.
pub(crate) fn offers(node: &Node) -> Vec<Offer> {
    let current = node.format().map(|format| format.size).unwrap_or_default();
    let mut offers = Vec::new();
    for fourcc in node.formats() {
        let Some(format) = PixelFormat::from_fourcc(fourcc) else { continue };
        let mut sizes: Vec<[u32; 2]> = node
            .sizes(fourcc)
            .into_iter()
            .map(|sizes| match sizes {
                Sizes::One(size) => size,
                Sizes::Steps { least, most, .. } => {
                    std::array::from_fn(|side| current[side].clamp(least[side], most[side].max(least[side])))
                }
            })
            .collect();
        if sizes.is_empty() {
            sizes.push(current);
        }
        for size in sizes {
            let shortest = |a: &[u32; 2], b: &[u32; 2]| {
                // Compares a0/a1 with b0/b1.
                (u64::from(a[0]) * u64::from(b[1])).cmp(&(u64::from(b[0]) * u64::from(a[1])))
            };
            let interval = node.intervals(fourcc, size).into_iter().min_by(shortest);
            offers.push(Offer { format, size, interval });
        }
    }
    offers
}

/// Requests the rate; returns the current one, if the driver reports it.
fn set_rate(node: &Node, offer: &Offer, settings: &GrabberSettings) -> Option<f64> {
    let (_, settable) = node.interval().ok()?;
    if settable {
        // Frames per second, in thousandths. If no rate is requested, the highest: devices may
        // default to as little as five.
        let interval = settings.rate_hz.map(|rate| [1000, (rate.clamp(0.1, 1000.0) * 1000.0).round() as u32]);
        if let Some(interval) = interval.or(offer.interval) {
            // A driver that refuses keeps its own rate, which is read below.
            let _ = node.set_interval(interval);
        }
    }
    let ([numerator, denominator], _) = node.interval().ok()?;
    (numerator > 0 && denominator > 0).then(|| f64::from(denominator) / f64::from(numerator))
}

fn layout(format: PixelFormat, given: &Format, settings: &GrabberSettings) -> Layout {
    let range = match given.quantization {
        number::QUANTIZATION_FULL => Range::Full,
        number::QUANTIZATION_LIMITED => Range::Limited,
        // If unspecified, the rules of the interface apply; grey formats count as full range.
        _ if format.is_rgb() || format.is_grey() || given.space == number::SPACE_JPEG => Range::Full,
        _ => Range::Limited,
    };
    let matrix = match given.encoding {
        number::ENCODING_601 => Matrix::Bt601,
        number::ENCODING_709 => Matrix::Bt709,
        _ if given.space == number::SPACE_709 => Matrix::Bt709,
        _ => Matrix::Bt601,
    };
    // A missing row length means rows without padding.
    let row_bytes = if given.row_bytes == 0 { format.row_bytes(given.size[0]) } else { given.row_bytes };
    Layout {
        format,
        size: given.size,
        row_bytes,
        range: settings.range.unwrap_or(range),
        matrix: settings.matrix.unwrap_or(matrix),
    }
}
