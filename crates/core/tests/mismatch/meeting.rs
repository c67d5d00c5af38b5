use sonoweave_core::frames::{Image, Probe, Tracker, Transform};

fn main() {
    let tracker_from_probe = Transform::<Tracker, Probe>::IDENTITY;
    let probe_from_image = Transform::<Probe, Image>::IDENTITY;
    let _: Transform<Tracker, Image> = tracker_from_probe * probe_from_image;
    let _: Transform<Image, Tracker> = probe_from_image.inverse() * tracker_from_probe.inverse();
}
