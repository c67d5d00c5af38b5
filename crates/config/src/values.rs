//! Parsers for values of flags and keys that hold several numbers or a criterion.

use std::net::{IpAddr, SocketAddr};
use std::ops::Range;

use glam::DVec3;
use ipnet::{IpNet, Ipv4Net};

use drivers::replay::Pace;
use mask::Clip;
use reconstruct::kernel::Support;
use render::classify::light::Source;
use sonoweave_core::keys::numbers;
use sonoweave_core::region::ClipRect;

use super::Error;

/// Parses one positive length for all axes, or three.
pub fn spacing(text: &str) -> Result<DVec3, Error> {
    let spacing =
        if text.contains(',') { DVec3::from_array(numbers::<3>(text)?) } else { DVec3::splat(numbers::<1>(text)?[0]) };
    if spacing.min_element() > 0.0 { Ok(spacing) } else { Err(Error::Value("must be positive, in mm".into())) }
}

/// Parses a point X,Y,Z.
pub fn point(text: &str) -> Result<DVec3, Error> {
    Ok(DVec3::from_array(numbers::<3>(text)?))
}

/// Parses three positive whole numbers.
pub fn size(text: &str) -> Result<[u64; 3], Error> {
    let parts: Vec<&str> = text.split(',').map(str::trim).collect();
    let size: Vec<u64> = parts.iter().filter_map(|p| p.parse().ok()).collect();
    match <[u64; 3]>::try_from(size) {
        Ok(size) if parts.len() == 3 && !size.contains(&0) => Ok(size),
        _ => Err(Error::Value("must hold 3 positive whole numbers NX,NY,NZ".into())),
    }
}

/// Parses a part of an image: its first column and row, and its width and height, in pixels.
pub fn rectangle(text: &str) -> Result<ClipRect, Error> {
    match text.parse() {
        Ok(Clip::Rect(rectangle)) => Ok(rectangle),
        _ => Err(Error::Value("must be X,Y,W,H: four whole numbers of pixels, the last two above 0".into())),
    }
}

/// Parses width x height of a picture, in pixels.
pub fn picture_size(text: &str) -> Result<[u32; 2], Error> {
    let parts: Option<(u32, u32)> =
        text.split_once(['x', '×']).and_then(|(w, h)| Some((w.trim().parse().ok()?, h.trim().parse().ok()?)));
    match parts {
        Some((w, h)) if w > 0 && h > 0 => Ok([w, h]),
        _ => Err(Error::Value("must be WxH, two positive whole numbers".into())),
    }
}

/// Parses azimuth, elevation and, if given, roll, degrees.
pub fn view(text: &str) -> Result<[f64; 3], Error> {
    match text.split(',').count() {
        3 => Ok(numbers::<3>(text)?),
        _ => Ok(numbers::<2>(text).map(|[azimuth, elevation]| [azimuth, elevation, 0.0])?),
    }
}

/// Parses red, green and blue, each 0 to 1.
pub fn colour(text: &str) -> Result<[f32; 3], Error> {
    let colour = numbers::<3>(text)?;
    match colour.iter().all(|c| (0.0..=1.0).contains(c)) {
        true => Ok(colour.map(|c| c as f32)),
        false => Err(Error::Value("must lie between 0 and 1".into())),
    }
}

/// Parses `headlight`, or a direction X,Y,Z towards the light.
pub fn light(text: &str) -> Result<Source, Error> {
    match text.trim() {
        "headlight" => Ok(Source::Headlight),
        numbers => point(numbers)
            .map(Source::Fixed)
            .map_err(|e| Error::Value(format!("must be headlight, or a direction X,Y,Z towards the light: {e}"))),
    }
}

/// Parses the brightness near and far.
pub fn depth_cue(text: &str) -> Result<[f64; 2], Error> {
    Ok(numbers::<2>(text)?)
}

/// Parses an address with a port.
///
/// # Errors
/// A sentence for an invalid one.
pub fn address(text: &str) -> Result<SocketAddr, Error> {
    text.parse().map_err(|_| {
        Error::Value(format!("\"{text}\" is not an address with a port; give one, such as \"127.0.0.1:9110\""))
    })
}

/// Parses an address with a port, on this machine only.
///
/// # Errors
/// A sentence for an invalid one, and for one that other machines can reach.
pub fn loopback(text: &str) -> Result<SocketAddr, Error> {
    let address = address(text)?;
    match address.ip().is_loopback() {
        true => Ok(address),
        false => Err(Error::Value(format!(
            "{} can be reached from other machines, and a demo has no password; give 127.0.0.1 or [::1], or use `live` \
            for other viewers",
            address.ip()
        ))),
    }
}

/// Number of leading bits that IPv4 networks have more if they are written as IPv6.
const MAPPED: u8 = 96;

/// Parses a network of addresses, or a single address. An IPv4 network that is written as IPv6
/// becomes IPv4.
///
/// # Errors
/// A sentence for an invalid one, for an address within the network in place of its first, and
/// for a network of all addresses.
pub fn network(text: &str) -> Result<IpNet, Error> {
    let given = text.trim().parse().or_else(|_| text.trim().parse().map(|address: IpAddr| IpNet::from(address)));
    let given: IpNet = given.map_err(|_| {
        Error::Value(format!(
            "\"{text}\" is not a network; give an address and the number of its leading bits, such as \"192.168.0.0/24\" \
            or \"fd00::/64\""
        ))
    })?;
    let mapped = match given {
        IpNet::V6(wide) => wide.addr().to_ipv4_mapped().zip(wide.prefix_len().checked_sub(MAPPED)),
        IpNet::V4(_) => None,
    };
    let network = match mapped.and_then(|(address, bits)| Ipv4Net::new(address, bits).ok()) {
        Some(network) => IpNet::V4(network),
        None => given,
    };
    if network.prefix_len() == 0 {
        return Err(Error::Value(format!(
            "\"{text}\" holds all addresses, so that everybody would be admitted; give the networks of the clients"
        )));
    }
    if network != network.trunc() {
        let (first, all) = (network.addr(), network.trunc());
        return Err(Error::Value(format!(
            "\"{text}\" begins within its network; give \"{all}\" for the network, or \"{first}\" for the one machine"
        )));
    }
    Ok(network)
}

/// Parses the speed of a replay: `max`, or a multiple of the recorded speed.
pub fn speed(text: &str) -> Result<Pace, Error> {
    match text.trim() {
        "max" => Ok(Pace::Unpaced),
        number => match number.parse() {
            Ok(factor) if (0.001..=1000.0).contains(&factor) => Ok(Pace::Factor(factor)),
            _ => Err(Error::Value(
                "must be max, as fast as possible, or a factor from 0.001 to 1000: 1 is the recorded speed".into(),
            )),
        },
    }
}

/// Choice of the kernel's widths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SigmaChoice {
    /// The default in the plane; across it, by the gaps between slices.
    Auto,
    /// Those that predict slices best from all others.
    LeaveOneOut,
    /// σ along u, v and the slice's normal, mm.
    Given([f64; 3]),
}

/// Parses three positive lengths, `auto` or `leave-one-out`.
pub fn sigma(text: &str) -> Result<SigmaChoice, Error> {
    match text.trim() {
        "auto" => Ok(SigmaChoice::Auto),
        "leave-one-out" => Ok(SigmaChoice::LeaveOneOut),
        text => lengths(text).map(SigmaChoice::Given),
    }
}

/// Parses three positive lengths.
pub fn lengths(text: &str) -> Result<[f64; 3], Error> {
    let lengths = numbers::<3>(text)?;
    if lengths.iter().all(|l| *l > 0.0) { Ok(lengths) } else { Err(Error::Value("must be positive, in mm".into())) }
}

/// Parses LO,HI with LO below HI.
pub fn window(text: &str) -> Result<[f32; 2], Error> {
    let [low, high] = numbers::<2>(text)?.map(|v| v as f32);
    if low < high { Ok([low, high]) } else { Err(Error::Value("LO must lie below HI".into())) }
}

/// Parses a finite number, such as of seconds.
pub fn number(text: &str) -> Result<f64, Error> {
    Ok(numbers::<1>(text).map(|[number]| number)?)
}

/// Parses a number above 0, such as of mm.
pub fn positive(text: &str) -> Result<f64, Error> {
    number(text).and_then(|x| if x > 0.0 { Ok(x) } else { Err(Error::Value(format!("must be above 0, not {x}"))) })
}

/// Parses a share between 0 and 1, both excluded.
pub fn share(text: &str) -> Result<f64, Error> {
    let [share] = numbers::<1>(text)?;
    if share > 0.0 && share < 1.0 { Ok(share) } else { Err(Error::Value("must lie between 0 and 1".into())) }
}

/// Shortest and longest time before and after a frame over which poses are smoothed, ms: six poses
/// of a tracker with 60 a second, and more than any hand keeps its motion.
pub(crate) const SMOOTHING_MS: [f64; 2] = [50.0, 1000.0];

/// Parses the time before and after a frame over which poses are smoothed, ms; 0 for none.
pub fn smoothing(text: &str) -> Result<f64, Error> {
    let [ms] = numbers::<1>(text)?;
    let [least, most] = SMOOTHING_MS;
    if ms == 0.0 || (least..=most).contains(&ms) {
        return Ok(ms);
    }
    Err(Error::Value(format!("must be 0, or from {least} to {most} ms: fewer poses average nothing out")))
}

/// Parses supports in the plane and across it: one criterion for both, or two separated by a
/// comma.
pub fn supports(text: &str) -> Result<[Support; 2], Error> {
    match text.split_once(',') {
        Some((in_plane, across)) => Ok([support(in_plane)?, support(across)?]),
        None => support(text).map(|both| [both; 2]),
    }
}

/// Parses `energy=E`, `amplitude=E`, `gradient=E` or `peak=E`.
fn support(text: &str) -> Result<Support, Error> {
    let names = "must be energy=E, amplitude=E, gradient=E or peak=E";
    let (name, value) = text.split_once('=').ok_or_else(|| Error::Value(names.into()))?;
    let [value] = numbers::<1>(value)?;
    let support = match name.trim() {
        "energy" => Support::Energy(value),
        "amplitude" => Support::Amplitude(value),
        "gradient" => Support::Gradient(value),
        "peak" => Support::Peak(value),
        _ => return Err(Error::Value(names.into())),
    };
    // The criterion itself checks the range of E, for which any σ will do.
    match support.half_width_mm(1e-3) {
        Err(e @ reconstruct::kernel::KernelError::Criterion(_)) => Err(Error::Value(e.to_string())),
        _ => Ok(support),
    }
}

/// Parses frames A..B: from A up to but not including B; either may be left out.
pub fn frames(text: &str) -> Result<Range<u64>, Error> {
    let help = "must be A..B: from frame A up to, but not including, frame B";
    let (from, to) = text.split_once("..").ok_or_else(|| Error::Value(help.into()))?;
    let bound = |text: &str, open: u64| match text.trim() {
        "" => Ok(open),
        number => number.parse().map_err(|_| Error::Value(help.into())),
    };
    let range = bound(from, 0)?..bound(to, u64::MAX)?;
    if range.is_empty() { Err(Error::Value("holds no frame".into())) } else { Ok(range) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_parse_as_documented() {
        assert_eq!(spacing("0.5").ok(), Some(DVec3::splat(0.5)));
        assert_eq!(spacing("1,2,3").ok(), Some(DVec3::new(1.0, 2.0, 3.0)));
        assert_eq!(size("10, 20,30").ok(), Some([10, 20, 30]));
        assert_eq!(picture_size("640x480").ok(), Some([640, 480]));
        assert_eq!(rectangle("1, 2,3,4").ok(), Some(ClipRect { x: 1, y: 2, width: 3, height: 4 }));
        assert_eq!(
            (view("30,-20").ok(), view("30, -20, 5").ok()),
            (Some([30.0, -20.0, 0.0]), Some([30.0, -20.0, 5.0]))
        );
        assert_eq!(colour("0,0.5,1").ok(), Some([0.0, 0.5, 1.0]));
        assert_eq!(sigma("auto").ok(), Some(SigmaChoice::Auto));
        assert_eq!(sigma(" leave-one-out").ok(), Some(SigmaChoice::LeaveOneOut));
        assert_eq!(sigma("0.3,0.3,1").ok(), Some(SigmaChoice::Given([0.3, 0.3, 1.0])));
        assert_eq!(window("-10,250").ok(), Some([-10.0, 250.0]));
        assert_eq!(supports("peak=0.01").ok(), Some([Support::Peak(0.01); 2]));
        assert_eq!(supports("energy=0.001, peak=0.1").ok(), Some([Support::Energy(0.001), Support::Peak(0.1)]));
        assert_eq!(
            (frames("2..5").ok(), frames("..7").ok(), frames("3..").ok()),
            (Some(2..5), Some(0..7), Some(3..u64::MAX))
        );
    }

    #[test]
    fn meaningless_values_refused_with_reason() {
        for bad in ["0", "-1", "1,2", "nan", "x", ""] {
            assert!(spacing(bad).is_err(), "{bad}");
        }
        for bad in ["1,2", "0,1,1", "1,2,3,4", "a,b,c", "1,2,3,x", "-1,2,3"] {
            assert!(size(bad).is_err(), "{bad}");
        }
        for bad in ["auto", "none", "1,2,3", "1,2,3,4,5", "1,2,3,0", "1,2,-3,4", "1.5,2,3,4", ""] {
            assert!(rectangle(bad).unwrap_err().to_string().contains("four whole numbers"), "{bad}");
        }
        for bad in ["energy", "energy=0", "energy=1", "width=3", "peak=-1", "gradient=nan"] {
            assert!(supports(bad).is_err(), "{bad}");
        }
        for bad in ["5", "5..5", "6..5", "a..b"] {
            assert!(frames(bad).is_err(), "{bad}");
        }
        assert!(view("1").is_err() && view("1,nan").is_err() && view("1,2,3,4").is_err() && colour("0,0,1.1").is_err());
        assert_eq!((speed("max").ok(), speed(" 2.5 ").ok()), (Some(Pace::Unpaced), Some(Pace::Factor(2.5))));
        for bad in ["", "fast", "0", "-1", "nan", "inf", "1e9"] {
            assert!(speed(bad).unwrap_err().to_string().contains("1 is the recorded speed"), "{bad}");
        }
        assert!(
            window("5,5").is_err() && share("1").is_err() && lengths("1,0,1").is_err() && picture_size("3").is_err()
        );
        assert!(spacing("1,2,x").unwrap_err().to_string().contains("\"x\" is not a number"));
    }
}
