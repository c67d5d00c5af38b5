//! Choice of format, size and rate from those that a device offers.

use super::super::GrabberSettings;
use super::super::pixels::{Colour, PixelFormat};
use super::setup_error::SetupError;

/// A video mode that a device can deliver.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Offer {
    pub(crate) format: PixelFormat,
    pub(crate) size: [u32; 2],
    /// The shortest time between frames, seconds as a fraction; `None` if the driver does not
    /// report it.
    pub(crate) interval: Option<[u32; 2]>,
}

impl Offer {
    fn rate(&self) -> Option<f64> {
        self.interval.filter(|[numerator, _]| *numerator > 0).map(|[n, d]| f64::from(d) / f64::from(n))
    }
}

/// Minimum frame rate for moving video if no rate is requested, in frames per second.
const FLUENT: f64 = 20.0;
/// Tolerance of a rate: 30 also matches 30000/1001.
const NEARLY: f64 = 0.998;

/// Chooses the best offer that the settings allow. Offers with a fluent (or the requested) rate
/// come first, then the largest frame, then uncompressed formats, then the cheapest conversion.
///
/// # Errors
/// [`SetupError::Unfit`].
pub(crate) fn choose(offers: &[Offer], settings: &GrabberSettings) -> Result<Offer, SetupError> {
    let fits = |offer: &&Offer| {
        settings.format.is_none_or(|format| format == offer.format)
            && settings.size.is_none_or(|size| size == offer.size)
            && (settings.format.is_some() || settings.colour == Colour::Grey || !offer.format.is_grey())
    };
    let least_hz = settings.rate_hz.unwrap_or(FLUENT) * NEARLY;
    let order = |format: PixelFormat| {
        let place = PixelFormat::ALL.iter().position(|&one| one == format).unwrap_or(usize::MAX);
        // Stored RGB gives better colour than formats that must be converted to it.
        if settings.colour == Colour::Rgb && format.is_rgb() { 0 } else { place + 1 }
    };
    let merit = |offer: &Offer| {
        let [width, height] = offer.size.map(u64::from);
        let fluent = offer.rate().is_none_or(|rate| rate >= least_hz);
        let raw = offer.format != PixelFormat::Mjpg;
        (fluent, width * height, raw, std::cmp::Reverse(order(offer.format)))
    };
    offers
        .iter()
        .filter(fits)
        .max_by_key(|offer| merit(offer))
        .copied()
        .ok_or_else(|| SetupError::Unfit(refusal(offers, settings)))
}

fn refusal(offers: &[Offer], settings: &GrabberSettings) -> String {
    if offers.is_empty() {
        return "it offers no format that can be converted; v4l2-ctl lists its formats".into();
    }
    let format = settings.format.map_or_else(|| "any format".into(), |format| format.to_string());
    let size = settings.size.map_or_else(|| "any size".into(), |[w, h]| format!("{w}×{h}"));
    let mut known: Vec<String> =
        offers.iter().map(|Offer { format, size: [w, h], .. }| format!("{format} {w}×{h}")).collect();
    known.dedup();
    let more = known.len().saturating_sub(12);
    known.truncate(12);
    let rest = if more > 0 { format!(" and {more} more") } else { String::new() };
    format!("it does not offer {format} at {size}; it offers {}{rest}", known.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn offer(format: PixelFormat, size: [u32; 2], fps: u32) -> Offer {
        Offer { format, size, interval: Some([1, fps]) }
    }

    fn settings() -> GrabberSettings {
        GrabberSettings::new("/dev/video0")
    }

    /// Offers of MS2109 and MS2130 dongles, a webcam and an analogue grabber.
    #[test]
    fn largest_fluent_then_cheapest_offer_is_chosen() {
        use PixelFormat::{Bgr24, Mjpg, Nv12, Uyvy, Yuyv};
        let hd = [1920, 1080];
        let ms2109 = [
            offer(Mjpg, hd, 30),
            offer(Mjpg, [1280, 720], 60),
            offer(Yuyv, hd, 5),
            offer(Yuyv, [1280, 720], 10),
            offer(Yuyv, [720, 480], 30),
        ];
        let chosen = |offers: &[Offer], settings: &GrabberSettings| choose(offers, settings).unwrap();
        assert_eq!(chosen(&ms2109, &settings()), ms2109[0], "uncompressed is too slow for its size");
        assert_eq!(chosen(&ms2109, &GrabberSettings { format: Some(Yuyv), ..settings() }), ms2109[4]);
        assert_eq!(chosen(&ms2109, &GrabberSettings { size: Some([1280, 720]), ..settings() }), ms2109[1]);
        assert_eq!(chosen(&ms2109, &GrabberSettings { rate_hz: Some(5.0), ..settings() }), ms2109[2]);
        assert_eq!(chosen(&ms2109, &GrabberSettings { rate_hz: Some(60.0), ..settings() }), ms2109[1]);

        let ms2130 = [offer(Mjpg, hd, 60), offer(Bgr24, hd, 30), offer(Nv12, hd, 30), offer(Yuyv, hd, 60)];
        assert_eq!(chosen(&ms2130, &settings()), ms2130[3], "of equal ones the one that costs least");
        assert_eq!(chosen(&ms2130, &GrabberSettings { colour: Colour::Rgb, ..settings() }), ms2130[1]);
        // 59.94 frames per second count as 60.
        let ntsc = [Offer { format: Uyvy, size: [720, 480], interval: Some([1001, 60000]) }];
        assert_eq!(chosen(&ntsc, &GrabberSettings { rate_hz: Some(60.0), ..settings() }), ntsc[0]);
        let silent = [Offer { interval: None, ..ntsc[0] }, offer(Yuyv, [720, 480], 5)];
        assert_eq!(chosen(&silent, &settings()), silent[0], "who says nothing of rates is believed");
        let grey = [offer(PixelFormat::Grey, hd, 30), offer(Mjpg, hd, 30)];
        assert_eq!(chosen(&grey, &settings()), grey[0]);
        assert_eq!(chosen(&grey, &GrabberSettings { colour: Colour::Rgb, ..settings() }), grey[1]);
    }

    #[test]
    fn refusal_lists_offers() {
        let offers = [offer(PixelFormat::Yuyv, [720, 480], 30), offer(PixelFormat::Mjpg, [1280, 720], 30)];
        let of = |settings: &GrabberSettings| choose(&offers, settings).unwrap_err().to_string();
        assert_eq!(
            of(&GrabberSettings { format: Some(PixelFormat::Nv12), ..settings() }),
            "cannot be set up: it does not offer NV12 at any size; it offers YUYV 720×480, MJPG 1280×720"
        );
        assert_eq!(
            of(&GrabberSettings { size: Some([640, 480]), ..settings() }),
            "cannot be set up: it does not offer any format at 640×480; it offers YUYV 720×480, MJPG 1280×720"
        );
        assert!(matches!(choose(&[], &settings()), Err(SetupError::Unfit(_))));
    }
}
