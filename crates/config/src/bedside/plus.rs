//! The devices of a PLUS device set, if there are drivers for them.
//!
//! The supported parts are converted to the text of a session configuration, so the same rules
//! apply to them:
//!
//! - `V4L2Video`: its node, size, format and image orientation;
//! - a device whose type names a Polhemus model (PLUS itself has none; forks do): its line and
//!   its tools' stations;
//! - both: `LocalTimeOffsetSec`, which PLUS adds to a device's times. It is a latency with the
//!   opposite sign.
//!
//! The notes name everything else.
//!
//! A video source's clip rectangle crops the images that PLUS's transforms and regions refer to.
//! Here they refer to the whole image, so they are shifted.

use std::fmt::Write as _;
use std::path::Path;

use glam::{DAffine3, DVec3};
use roxmltree::Node;

use drivers::grabber::pixels::PixelFormat;
use drivers::tracker::polhemus::Model;
use mask::Clip;
use sonoweave_core::named::StaticTransform;
use sonoweave_core::region::{ClipRect, Fan};

use super::file::Bedside;
use super::frames::{PROBE_FRAME, REFERENCE_FRAME, STYLUS_FRAME, TRACKER_FRAME};
use super::schema::{FORMAT, VERSION};
use crate::plus::{Reader, document, is};
use crate::texts::Texts;
use crate::{Error, Kind, Settings};

/// Attributes that every device has for PLUS's own use.
const OWN: [&str; 6] = ["Id", "Type", "Name", "LocalTimeOffsetSec", "ToolReferenceFrame", "Description"];

/// Data found in a device set.
#[derive(Default)]
struct Found {
    tracker: Option<String>,
    grabber: Option<String>,
    /// The frame that is called Tracker here.
    tracker_frame: Option<String>,
    crop: Option<ClipRect>,
    notes: Vec<String>,
}

/// Makes a session configuration from a device set's text.
pub(super) fn parse(path: &Path, text: &str) -> Result<Bedside, Error> {
    let mut calibration = crate::plus::parse(path, text)?;
    let document = document(path, text)?;
    let reader = Reader { path, document: &document };
    let mut found = Found::default();
    let mut seen = Vec::new();
    for device in
        document.descendants().filter(|n| is(n, "Device") && n.parent().is_some_and(|p| is(&p, "DataCollection")))
    {
        seen.push(called(&device));
        found.device(&reader, &device)?;
    }
    let lacking = match (&found.tracker, &found.grabber) {
        (None, None) => Some("a tracker and a frame grabber"),
        (None, Some(_)) => Some("a tracker"),
        (Some(_), None) => Some("a frame grabber"),
        (Some(_), Some(_)) => None,
    };
    if let Some(lacking) = lacking {
        let seen = if seen.is_empty() { "it names no device".into() } else { format!("it names {}", seen.join(", ")) };
        let file = path.file_name().map_or("…".into(), |name| name.to_string_lossy());
        return Err(Error::DeviceSet {
            path: path.to_owned(),
            problem: format!(
                "the device set lacks {lacking} with a driver in this program: {seen}. To use its transforms, write a \
                session configuration with file = \"{file}\" in [calibration]"
            ),
        });
    }
    let mut own = format!(
        "format = \"{FORMAT}\"\nversion = {VERSION}\n[calibration]\nimage_to_probe = [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]\n"
    );
    for section in [&found.tracker, &found.grabber].into_iter().flatten() {
        own.push_str(section);
    }
    if let Some([x, y, z]) = calibration.spacing_mm {
        line(&mut own, format_args!("[volume]\nspacing_mm = [{x:?}, {y:?}, {z:?}]"));
    }
    let mut bedside = Bedside::parse_own(path, &own, &Texts::on_disk())?;
    if let Some(frame) = found.tracker_frame.filter(|frame| frame != TRACKER_FRAME) {
        rename(&mut calibration.transforms, &frame);
    }
    if let Some(crop) = found.crop {
        uncrop(&mut calibration, crop).map_err(|problem| Error::DeviceSet { path: path.to_owned(), problem })?;
    }
    let others = document.root_element().children().filter(Node::is_element).map(|n| n.tag_name().name());
    let others: Vec<&str> = others
        .filter(|name| !matches!(*name, "DataCollection" | "CoordinateDefinitions" | "VolumeReconstruction"))
        .collect();
    if !others.is_empty() {
        found.notes.push(format!("not taken over: {}", others.join(", ")));
    }
    bedside.kind = Kind::Plus;
    bedside.mask = calibration.mask();
    if let (Some(crop), Clip::Auto | Clip::RectOrAuto(_)) = (found.crop, bedside.mask.clip) {
        let within = calibration.clip.filter(|clip| !clip.covers(crop.width, crop.height));
        bedside.mask.clip = Clip::Rect(within.unwrap_or(crop));
    }
    bedside.notes.extend(calibration.notes.iter().cloned().chain(found.notes));
    for key in ["file", "image_to_probe"] {
        bedside.effective.insert(format!("calibration.{key}"), serde_json::Value::Null);
    }
    bedside.effective.insert("calibration.file".into(), path.to_string_lossy().into());
    bedside.calibration = calibration;
    Ok(bedside)
}

/// Describes a device by its name and type.
fn called(device: &Node<'_, '_>) -> String {
    format!("{} ({})", device.attribute("Id").unwrap_or("a device"), device.attribute("Type").unwrap_or("type unknown"))
}

impl Found {
    fn device(&mut self, reader: &Reader<'_>, device: &Node<'_, '_>) -> Result<(), Error> {
        let kind = device.attribute("Type").unwrap_or_default();
        let lower = kind.to_ascii_lowercase();
        let model = Model::ALL.into_iter().find(|model| lower.contains(model.name()));
        match (kind, model) {
            ("V4L2Video", _) if self.grabber.is_none() => self.grabber(reader, device),
            (_, Some(model)) if self.tracker.is_none() => self.tracker(reader, device, model),
            ("V4L2Video", _) | (_, Some(_)) => {
                self.notes
                    .push(format!("{}: not taken over, because one of its kind is already in use", called(device)));
                Ok(())
            }
            ("VirtualMixer", _) => Ok(()),
            ("VirtualCapture", _) => {
                self.notes.push(format!("{}: not taken over; this program has its own recording", called(device)));
                Ok(())
            }
            _ => {
                self.notes.push(format!("{}: not taken over, because there is no driver for it", called(device)));
                Ok(())
            }
        }
    }

    fn grabber(&mut self, reader: &Reader<'_>, device: &Node<'_, '_>) -> Result<(), Error> {
        let Some(node) = device.attribute("DeviceName") else {
            return Err(reader.error(device, "DeviceName", "is missing: give the video device"));
        };
        let mut text = format!("[grabber]\ndevice = {}\n", quoted(node));
        let mut taken = vec!["DeviceName", "FrameSize", "PixelFormat"];
        if device.attribute("FrameSize").is_some() {
            // The last of three numbers is the number of images in a stack.
            let size = reader.numbers::<3>(device, "FrameSize").map(|size| size.map(|[w, h, _]| [w, h]));
            let size = size.or_else(|_| reader.numbers::<2>(device, "FrameSize"))?;
            let Some(size) = size.filter(|size| size.iter().all(|x| x.fract() == 0.0 && (1.0..=65_536.0).contains(x)))
            else {
                return Err(reader.error(device, "FrameSize", "must hold two positive whole numbers of pixels"));
            };
            line(&mut text, format_args!("size = [{}, {}]", size[0], size[1]));
        }
        if let Some(name) = device.attribute("PixelFormat") {
            // Formats are named as in V4L2's header, for example V4L2_PIX_FMT_YUYV.
            let short = name.trim_start_matches("V4L2_PIX_FMT_").replace("YUV420", "YU12").replace("MJPEG", "MJPG");
            let short = short.replace("RGB24", "RGB3").replace("BGR24", "BGR3");
            match PixelFormat::ALL.into_iter().find(|format| format.to_string().eq_ignore_ascii_case(&short)) {
                Some(format) => line(&mut text, format_args!("format = \"{format}\"")),
                None => taken.retain(|taken| *taken != "PixelFormat"),
            }
        }
        latency(reader, device, &mut text)?;
        for source in sources(device).filter(|source| source.attribute("Type") == Some("Video")) {
            let orientation = source.attribute("PortUsImageOrientation").unwrap_or("MF").to_ascii_uppercase();
            let orientation = orientation.get(..2).unwrap_or(&orientation);
            line(&mut text, format_args!("orientation = {}", quoted(orientation)));
            if source.attribute("ImageType").is_some_and(|kind| kind != "BRIGHTNESS") {
                self.notes.push(format!(
                    "{}: ImageType: grey frames are taken, because only grey frames can be inserted",
                    called(device)
                ));
            }
            if let Some(crop) = reader.clip(&source)? {
                if orientation != "MF" {
                    let problem = format!(
                        "crops frames of orientation {orientation}, and the order of cropping and turning is not \
                        known; crop in the calibration instead"
                    );
                    return Err(reader.error(&source, "ClipRectangleSize", problem));
                }
                self.crop = Some(crop);
            }
        }
        self.left(device, &taken);
        self.grabber = Some(text);
        Ok(())
    }

    fn tracker(&mut self, reader: &Reader<'_>, device: &Node<'_, '_>, model: Model) -> Result<(), Error> {
        let mut text = format!("[tracker]\nmodel = \"{}\"\n", model.name());
        let serial = device.attribute("SerialPort").filter(|port| port.starts_with('/'));
        match serial {
            Some(path) => line(&mut text, format_args!("port = {}", quoted(path))),
            None if model == Model::Isotrak => {
                return Err(reader.error(device, "SerialPort", "must be the serial line's path, such as /dev/ttyUSB0"));
            }
            None => {
                self.notes.push(format!(
                    "{}: no serial line's path is given; the program looks for it on USB",
                    called(device)
                ));
                line(&mut text, format_args!("port = \"usb\""));
            }
        }
        if let (Some(_), Some([baud])) = (serial, reader.numbers::<1>(device, "BaudRate")?) {
            line(&mut text, format_args!("baud = {baud}"));
        }
        latency(reader, device, &mut text)?;
        let roles =
            [(PROBE_FRAME, "probe_station"), (REFERENCE_FRAME, "reference_station"), (STYLUS_FRAME, "stylus_station")];
        for tool in sources(device).filter(|source| source.attribute("Type") == Some("Tool")) {
            let id = tool.attribute("Id").unwrap_or_default();
            let station = reader.numbers::<1>(&tool, "PortName")?.map(|[station]| station);
            match (roles.iter().find(|(frame, _)| *frame == id), station) {
                (Some((_, key)), Some(station)) => line(&mut text, format_args!("{key} = {station}")),
                (Some(_), None) => {
                    return Err(reader.error(&tool, "PortName", "is missing: give the station's number"));
                }
                (None, _) => self.notes.push(format!(
                    "{}: tool {id} is not taken over; the known tools are Probe, Reference and Stylus",
                    called(device)
                )),
            }
        }
        self.tracker_frame = device.attribute("ToolReferenceFrame").map(str::to_owned);
        self.left(device, &["SerialPort", "BaudRate"]);
        self.tracker = Some(text);
        Ok(())
    }

    /// Notes the attributes of a device that were not taken over.
    fn left(&mut self, device: &Node<'_, '_>, taken: &[&str]) {
        let left = device.attributes().filter(|a| !taken.contains(&a.name()) && !OWN.contains(&a.name()));
        let left: Vec<String> = left.map(|a| format!("{}=\"{}\"", a.name(), a.value())).collect();
        if !left.is_empty() {
            self.notes.push(format!("{}: not taken over: {}", called(device), left.join(", ")));
        }
    }
}

fn sources<'n, 'i>(device: &Node<'n, 'i>) -> impl Iterator<Item = Node<'n, 'i>> {
    device.descendants().filter(|node| is(node, "DataSource"))
}

/// Converts the time offset. PLUS adds it to a device's times; a latency is subtracted.
fn latency(reader: &Reader<'_>, device: &Node<'_, '_>, text: &mut String) -> Result<(), Error> {
    let Some([offset_s]) = reader.numbers::<1>(device, "LocalTimeOffsetSec")? else { return Ok(()) };
    if offset_s.abs() > 1.0 {
        return Err(reader.error(
            device,
            "LocalTimeOffsetSec",
            format!("must lie between -1 and 1, not at {offset_s}"),
        ));
    }
    // Whole nanoseconds, and no minus zero.
    let latency_ms = (0.0 - offset_s * 1e9).round() / 1e6;
    line(text, format_args!("latency_ms = {latency_ms:?}"));
    Ok(())
}

/// Renames a frame to Tracker.
fn rename(transforms: &mut [StaticTransform], frame: &str) {
    for name in transforms.iter_mut().flat_map(|t| [&mut t.from, &mut t.to]).filter(|name| *name == frame) {
        TRACKER_FRAME.clone_into(name);
    }
}

/// Converts transforms and regions of the cropped image to refer to the whole image.
fn uncrop(settings: &mut Settings, crop: ClipRect) -> Result<(), String> {
    let image = settings.image_frame.as_deref().unwrap_or("Image");
    let corner = DVec3::new(crop.x.into(), crop.y.into(), 0.0);
    let cropped_from_whole = DAffine3::from_translation(-corner);
    for transform in &mut settings.transforms {
        if transform.from == image {
            transform.affine *= cropped_from_whole;
        } else if transform.to == image {
            transform.affine = cropped_from_whole.inverse() * transform.affine;
        }
    }
    if let Some(clip) = &mut settings.clip {
        let [right, low] = [crop.x.saturating_add(crop.width), crop.y.saturating_add(crop.height)];
        let [x, y] = [crop.x.saturating_add(clip.x), crop.y.saturating_add(clip.y)];
        let rect = ClipRect::new(x, y, clip.width.min(right.saturating_sub(x)), clip.height.min(low.saturating_sub(y)));
        *clip = rect.map_err(|e| {
            format!("VolumeReconstruction ClipRectangleSize lies outside the video source's clip rectangle: {e}")
        })?;
    }
    if let Some(fan) = &mut settings.fan {
        let [u, v] = fan.origin_px();
        let moved = Fan::new([u + corner.x, v + corner.y], fan.radii_px(), fan.angles_deg());
        *fan = moved.map_err(|e| e.to_string())?;
    }
    Ok(())
}

/// Quotes a text for TOML.
fn quoted(text: &str) -> String {
    // JSON's escapes are TOML's.
    serde_json::Value::from(text).to_string()
}

fn line(text: &mut String, content: std::fmt::Arguments<'_>) {
    // Writing to a String cannot fail.
    let _ = writeln!(text, "{content}");
}

#[cfg(test)]
mod tests {
    use drivers::tracker::polhemus::Port;

    use super::super::Tracking;
    use super::*;

    const VIDEO: &str = r#"<Device Id="VideoDevice" Type="V4L2Video" DeviceName="/dev/video2" FrameSize="800 600" PixelFormat="V4L2_PIX_FMT_YUYV"
        IOMethod="IO_METHOD_MMAP" LocalTimeOffsetSec="-0.2976">
        <DataSources><DataSource Type="Video" Id="Video" PortUsImageOrientation="MFA" CROP/></DataSources>
    </Device>"#;
    const TRACKER: &str = r#"<Device Id="TrackerDevice" Type="PolhemusLiberty" ToolReferenceFrame="Transmitter" LocalTimeOffsetSec="0.010" AcquisitionRate="60">
        <DataSources>
            <DataSource Type="Tool" Id="Probe" PortName="2"/><DataSource Type="Tool" Id="Reference" PortName="1"/>
            <DataSource Type="Tool" Id="Needle" PortName="4"/>
        </DataSources>
    </Device>"#;

    fn set(devices: &str, reconstruction: &str) -> Result<Bedside, String> {
        let text = format!(
            "<PlusConfiguration version=\"2.9\">\n<DataCollection StartupDelaySec=\"1.0\">\n<DeviceSet Name=\"x\"/>\n{devices}\n</DataCollection>\n<CoordinateDefinitions>\n\
             <Transform From=\"Image\" To=\"Probe\" Matrix=\"0.2 0 0 1 0 0.2 0 2 0 0 0.2 3 0 0 0 1\"/>\n\
             <Transform From=\"Bed\" To=\"Transmitter\" Matrix=\"1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1\"/>\n</CoordinateDefinitions>\n{reconstruction}\n\
             <PlusOpenIGTLinkServer/><fCal/>\n</PlusConfiguration>"
        );
        Bedside::parse(Path::new("set.xml"), &text).map_err(|e| e.to_string())
    }

    #[test]
    fn supported_parts_converted_rest_noted() {
        let mixer = "<Device Id=\"Mixer\" Type=\"VirtualMixer\"/><Device Id=\"Cap\" Type=\"VirtualCapture\"/><Device Id=\"Arm\" Type=\"Stepper\"/>";
        let bedside = set(&format!("{}{TRACKER}{mixer}", VIDEO.replace("CROP", "")), "").unwrap();
        assert_eq!(bedside.kind, Kind::Plus);
        let grabber = &bedside.grabber;
        assert_eq!((grabber.settings.device.as_str(), grabber.settings.size), ("/dev/video2", Some([800, 600])));
        assert_eq!((grabber.settings.format, grabber.settings.orientation), (Some(PixelFormat::Yuyv), "MF"));
        assert_eq!(grabber.latency_ns, 297_600_000, "what PLUS adds is what a latency takes away");
        let Tracking::Tracker(tracker) = &bedside.tracking else { panic!("a tracker") };
        assert_eq!(
            (tracker.model, &tracker.port, tracker.latency_ns),
            (Model::Liberty, &Some(Port::Usb(None)), -10_000_000)
        );
        assert_eq!((tracker.roles.probe, tracker.roles.reference, tracker.roles.stylus), (2, Some(1), None));
        assert_eq!(bedside.calibration.transforms[1].name(), "BedToTracker", "the transmitter is called Tracker here");
        let message = bedside.notes.join("\n");
        for expected in [
            "VideoDevice (V4L2Video): not taken over: IOMethod=\"IO_METHOD_MMAP\"",
            "TrackerDevice (PolhemusLiberty): not taken over: AcquisitionRate=\"60\"",
            "TrackerDevice (PolhemusLiberty): tool Needle is not taken over",
            "the program looks for it on USB",
            "Cap (VirtualCapture): not taken over; this program has its own recording",
            "Arm (Stepper): not taken over, because there is no driver for it",
            "not taken over: PlusOpenIGTLinkServer, fCal",
        ] {
            assert!(message.contains(expected), "{expected}\n{message}");
        }
        assert!(!message.contains("Mixer"), "{message}");
    }

    #[test]
    fn cropped_image_transforms_shifted_to_whole_image() {
        let video = VIDEO.replace("CROP", "ClipRectangleOrigin=\"100 50\" ClipRectangleSize=\"640 480\"");
        let devices = format!("{video}{TRACKER}");
        let clipped = "<VolumeReconstruction ClipRectangleOrigin=\"10 20\" ClipRectangleSize=\"600 400\" FanAnglesDeg=\"-30 30\" FanOriginPixel=\"320 5\" FanRadiusStopPixel=\"400\"/>";
        let bedside = set(&devices, clipped).unwrap();
        let corner = bedside.calibration.transforms[0].affine.transform_point3(DVec3::new(100.0, 50.0, 0.0));
        assert!((corner - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-9, "the cropped picture's first pixel: {corner}");
        assert_eq!(bedside.mask.clip, Clip::Rect(ClipRect::new(110, 70, 600, 400).unwrap()));
        assert_eq!(bedside.mask.fan.unwrap().origin_px(), [420.0, 55.0]);
        let whole =
            set(&devices, "<VolumeReconstruction ClipRectangleOrigin=\"0 0\" ClipRectangleSize=\"640 480\"/>").unwrap();
        assert_eq!(
            whole.mask.clip,
            Clip::Rect(ClipRect::new(100, 50, 640, 480).unwrap()),
            "what was cropped is no data"
        );
        let turned = video.replace("MFA", "UN");
        assert!(
            set(&format!("{turned}{TRACKER}"), "")
                .unwrap_err()
                .contains("ClipRectangleSize (line 6): crops frames of orientation UN")
        );
    }

    #[test]
    fn incomplete_set_error_lists_its_devices() {
        let video = VIDEO.replace("CROP", "");
        let message = set(&video, "").unwrap_err();
        assert!(
            message.contains(
                "set.xml: the device set lacks a tracker with a driver in this program: it names VideoDevice (V4L2Video)"
            ),
            "{message}"
        );
        assert!(message.contains("file = \"set.xml\""), "{message}");
        assert!(
            set("", "")
                .unwrap_err()
                .contains("lacks a tracker and a frame grabber with a driver in this program: it names no device")
        );
        for (from, to, expected) in [
            ("DeviceName=\"/dev/video2\"", "", "Device DeviceName (line 4): is missing: give the video device"),
            ("800 600", "800.5 600", "Device FrameSize (line 4): must hold two positive whole numbers"),
            ("-0.2976", "-3", "LocalTimeOffsetSec (line 5): must lie between -1 and 1, not at -3"),
            ("PortName=\"2\"", "", "DataSource PortName (line "),
            ("PolhemusLiberty", "PolhemusIsotrak", "Device SerialPort (line "),
        ] {
            let message = set(&format!("{video}{TRACKER}").replace(from, to), "")
                .err()
                .unwrap_or_else(|| panic!("{to} was read"));
            assert!(message.contains(expected), "{message}");
        }
    }
}
