use sonoweave_core::frames::{Image, Probe, Tracker, Transform};

fn main() {
    let tracker_from_probe = Transform::<Tracker, Probe>::IDENTITY;
    let probe_from_image = Transform::<Probe, Image>::IDENTITY;
    let _ = probe_from_image * tracker_from_probe;
}
