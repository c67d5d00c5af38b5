use glam::{DQuat, DVec3};
use proptest::prelude::*;

use sonoweave_core::reading::{Frame, PixelType};

use sonoweave_core::named::StaticTransform;

use super::*;
use crate::ingest::Ingest;

const IDENTITY: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

fn rows(affine: DAffine3) -> [f64; 16] {
    Transform::<World, ImageFrame>::from_affine(affine).to_rows()
}

fn rigid(angle: f64, x: f64) -> DAffine3 {
    let axis = DVec3::new(1.0, 2.0, -0.5).normalize();
    DAffine3::from_rotation_translation(DQuat::from_axis_angle(axis, angle), DVec3::new(x, 2.0 * x, 30.0))
}

fn stamp(item: u64) -> Stamp {
    Stamp { item, source_s: Some(item as f64 * 0.1), ..Stamp::default() }
}

fn named(item: u64, name: &str, matrix: [f64; 16]) -> NamedTransform {
    let (from, to) = name.split_once("To").unwrap();
    NamedTransform { stamp: stamp(item), from: from.into(), to: to.into(), matrix, status: Status::Ok }
}

fn picture_of(item: u64, size: [u32; 2], grey: u8) -> Picture {
    let frame = Frame {
        stamp: stamp(item),
        frame_number: None,
        status: Status::Ok,
        size,
        channels: 1,
        pixel: PixelType::U8,
        orientation: "MF".into(),
        image_type: String::new(),
        pixels: vec![grey; (size[0] * size[1]) as usize].into(),
        fields: Vec::new(),
    };
    Ingest::new().picture(&frame).unwrap()
}

fn picture(item: u64) -> Picture {
    picture_of(item, [4, 3], u8::try_from(item % 250).unwrap())
}

fn calibration() -> DAffine3 {
    // Scale and skew, as in calibrations.
    let mut affine = rigid(0.4, 5.0);
    affine.matrix3.x_axis *= 0.08;
    affine.matrix3.y_axis = affine.matrix3.y_axis * 0.11 + affine.matrix3.x_axis * 0.01;
    affine
}

fn options() -> PairingOptions {
    let statics = vec![StaticTransform::new("Image", "Probe", &rows(calibration())).unwrap()];
    PairingOptions { statics, ..PairingOptions::default() }
}

/// A stage that has processed frame 0 by way of Probe, Tracker and Reference.
fn running() -> StampedPairing {
    let mut pairing = StampedPairing::new(options());
    deliver(&mut pairing, 0);
    pairing.frame(picture(0)).unwrap();
    pairing
}

fn deliver(pairing: &mut StampedPairing, item: u64) {
    let x = item as f64;
    pairing.transform(named(item, "ProbeToTracker", rows(rigid(0.3 + 0.01 * x, x))));
    pairing.transform(named(item, "ReferenceToTracker", rows(rigid(-0.9, 40.0))));
    let mut stylus = named(item, "StylusToTracker", [f64::NAN; 16]);
    stylus.status = Status::Other("INVALID".into());
    pairing.transform(stylus);
}

#[test]
fn slice_pose_is_product_of_transforms() {
    let mut pairing = StampedPairing::new(options());
    deliver(&mut pairing, 0);
    let paired = pairing.frame(picture(0)).unwrap();
    let expected = rigid(-0.9, 40.0).inverse() * rigid(0.3, 0.0) * calibration();
    assert!(paired.slice.world_from_image.affine().abs_diff_eq(expected, 1e-12));
    assert_eq!(paired.slice.time_ns, 0);
    assert_eq!(paired.pose.projected, 0, "rounding is not counted");
    assert_eq!(pairing.route().unwrap().describe(), "Image → Probe → Tracker → Reference");
}

#[test]
fn world_from_option_else_reference_tracker_world() {
    let world = |option: Option<&str>, names: &[&str]| {
        let mut pairing = StampedPairing::new(PairingOptions { world: option.map(str::to_owned), ..options() });
        for name in names {
            pairing.transform(named(0, name, IDENTITY));
        }
        let placed = pairing.frame(picture(0)).map(|_| ()).map_err(|refusal| refusal.reason);
        placed.map(|()| pairing.route().unwrap().world().to_owned())
    };
    let tracked = ["ProbeToTracker", "ReferenceToTracker"];
    assert_eq!(world(None, &tracked).unwrap(), "Reference");
    assert_eq!(world(Some("Tracker"), &tracked).unwrap(), "Tracker");
    assert_eq!(world(None, &tracked[..1]).unwrap(), "Tracker");
    assert_eq!(world(None, &["ImageToWorld"]).unwrap(), "World");
    assert_eq!(world(None, &["ImageToReference"]).unwrap(), "Reference");
    assert_eq!(world(Some("Phantom"), &tracked), Err(Reason::NoPath));
    assert_eq!(world(None, &["StylusToReference", "ProbeToTracker"]).unwrap(), "Tracker", "what can be reached");
    assert_eq!(world(None, &["ProbeToBase"]), Err(Reason::NoPath));
}

#[test]
fn image_transforms_need_no_calibration() {
    let mut pairing = StampedPairing::new(PairingOptions::default());
    pairing.transform(named(0, "ImageToTracker", rows(calibration())));
    let paired = pairing.frame(picture(0)).unwrap();
    assert_eq!(paired.slice.world_from_image.affine(), calibration(), "scale and skew are kept");

    let mut pairing = StampedPairing::new(options());
    pairing.transform(named(0, "ImageToReference", rows(calibration())));
    pairing.frame(picture(0)).unwrap();
    assert_eq!(pairing.notes(), ["ImageToProbe of the configuration is not used: the way is Image → Reference"]);
}

#[test]
fn rounded_rotations_projected_and_counted() {
    let mut pairing = StampedPairing::new(options());
    let printed = rows(rigid(0.3, 1.0)).map(|x| (x * 1e4).round() / 1e4);
    pairing.transform(named(0, "ProbeToTracker", printed));
    let paired = pairing.frame(picture(0)).unwrap();
    assert_eq!(paired.pose.projected, 1);
    assert!(paired.pose.deviation > 1e-6 && paired.pose.deviation < 1e-3);
    let rotation = paired.slice.world_from_image.affine().matrix3 * calibration().matrix3.inverse();
    assert!((rotation.transpose() * rotation).abs_diff_eq(glam::DMat3::IDENTITY, 1e-12));
}

#[test]
fn refusal_names_reason_and_leaves_no_trace() {
    let spoilt = |change: &dyn Fn(&mut NamedTransform)| {
        let mut pairing = running();
        deliver(&mut pairing, 1);
        let mut probe = named(1, "ProbeToTracker", rows(rigid(0.3, 1.0)));
        change(&mut probe);
        pairing.transform(probe);
        let refusal = pairing.frame(picture(1)).unwrap_err();
        assert_eq!(refusal.item, 1);
        assert!(refusal.detail.starts_with("ProbeToTracker "), "{refusal}");
        // Later frames get poses as if this frame had not arrived.
        let mut untouched = running();
        for pairing in [&mut pairing, &mut untouched] {
            deliver(pairing, 2);
        }
        let (after, expected) = (pairing.frame(picture(2)).unwrap(), untouched.frame(picture(2)).unwrap());
        assert_eq!(after.slice.world_from_image, expected.slice.world_from_image);
        assert_eq!(pairing.notes(), untouched.notes());
        refusal.reason
    };
    assert_eq!(spoilt(&|t| t.stamp = stamp(0)), Reason::PoseMissing);
    assert_eq!(spoilt(&|t| t.stamp.source_s = None), Reason::PoseMissing);
    assert_eq!(spoilt(&|t| t.status = Status::Other("INVALID".into())), Reason::PoseInvalid);
    assert_eq!(spoilt(&|t| t.matrix[6] = f64::NAN), Reason::PoseNotFinite);
    assert_eq!(spoilt(&|t| t.matrix[3] = f64::INFINITY), Reason::PoseNotFinite);
    assert_eq!(spoilt(&|t| t.matrix[12] = 1.0), Reason::PoseNotRigid);
    assert_eq!(spoilt(&|t| t.matrix = [0.0; 16]), Reason::PoseNotRigid);
    assert_eq!(spoilt(&|t| t.matrix[..12].fill(0.0)), Reason::PoseSingular);
    assert_eq!(spoilt(&|t| (0..3).for_each(|row| t.matrix[4 * row] *= -1.0)), Reason::PoseMirrored);
    assert_eq!(spoilt(&|t| (0..3).for_each(|row| t.matrix[4 * row] *= 1.02)), Reason::PoseNotRigid);
}

#[test]
fn singular_transform_refused_only_if_in_chain() {
    let mut flat = IDENTITY;
    flat[10] = 0.0;
    let mut pairing = StampedPairing::new(PairingOptions::default());
    pairing.transform(named(0, "ImageToTracker", flat));
    assert_eq!(pairing.frame(picture(0)).unwrap_err().reason, Reason::PoseSingular);
    let mut pairing = StampedPairing::new(options());
    pairing.transform(named(0, "ProbeToTracker", IDENTITY));
    pairing.transform(named(0, "ImageToThumbnailImage", flat));
    assert!(pairing.frame(picture(0)).is_ok());
    assert!(pairing.notes()[0].contains("relates Image and ThumbnailImage"), "{:?}", pairing.notes());
}

#[test]
fn other_size_refused_without_effect() {
    let mut pairing = running();
    deliver(&mut pairing, 1);
    let refusal = pairing.frame(picture_of(1, [3, 4], 9)).unwrap_err();
    assert_eq!(refusal.reason, Reason::SizeChanged);
    assert_eq!(refusal.detail, "3×4 pixels after frames of 4×3");
    deliver(&mut pairing, 2);
    assert!(pairing.frame(picture_of(2, [4, 3], 0)).is_ok());
}

#[test]
fn frames_refused_until_chain_known() {
    let mut pairing = StampedPairing::new(PairingOptions::default());
    pairing.transform(named(0, "ProbeToTracker", IDENTITY));
    let refusal = pairing.frame(picture(0)).unwrap_err();
    assert_eq!(refusal.reason, Reason::NoPath);
    let error = pairing.finish().unwrap_err();
    assert_eq!(
        error.to_string(),
        "no way from Image to Tracker: the sequence holds ProbeToTracker, the configuration holds no transform; give a \
         configuration with ImageToProbe"
    );
    pairing.transform(named(1, "ProbeToTracker", IDENTITY));
    pairing.transform(named(1, "ImageToProbe", rows(calibration())));
    assert!(pairing.frame(picture(1)).is_ok());
    assert!(pairing.finish().is_ok());
    assert!(StampedPairing::with_names(PairingOptions::default(), &[("Probe".into(), "Tracker".into())]).is_err());
}

#[test]
fn dropout_never_changes_chain() {
    // The configuration also has a constant ReferenceToTracker; a frame whose own is invalid
    // must not fall back on it.
    let mut options = options();
    options.statics.push(StaticTransform::new("Reference", "Tracker", &IDENTITY).unwrap());
    let mut pairing = StampedPairing::new(options);
    deliver(&mut pairing, 0);
    pairing.frame(picture(0)).unwrap();
    deliver(&mut pairing, 1);
    let mut reference = named(1, "ReferenceToTracker", rows(rigid(-0.9, 40.0)));
    reference.status = Status::Other("INVALID".into());
    pairing.transform(reference);
    assert_eq!(pairing.frame(picture(1)).unwrap_err().reason, Reason::PoseInvalid);
}

#[test]
fn number_of_names_is_bounded() {
    let mut pairing = StampedPairing::new(options());
    for item in 0..5_000 {
        pairing.transform(named(item, &format!("Tool{item}ToBase"), IDENTITY));
    }
    assert_eq!(pairing.held.len(), MAX_NAMES);
    assert_eq!(pairing.notes().len(), 1);
}

proptest! {
    #[test]
    fn transform_direction_does_not_matter(angle in -3.0..3.0_f64, x in -100.0..100.0_f64, flips in 0_u8..8) {
        let edges = [("Image", "Probe", calibration()), ("Probe", "Tracker", rigid(angle, x)), ("Reference", "Tracker", rigid(x, angle))];
        let mut pairing = StampedPairing::new(PairingOptions::default());
        for (bit, (from, to, affine)) in edges.into_iter().enumerate() {
            let (name, affine) = if flips >> bit & 1 == 1 {
                (format!("{to}To{from}"), affine.inverse())
            } else {
                (format!("{from}To{to}"), affine)
            };
            pairing.transform(named(0, &name, rows(affine)));
        }
        let slice = pairing.frame(picture(0)).unwrap().slice;
        let expected = rigid(x, angle).inverse() * rigid(angle, x) * calibration();
        prop_assert!(slice.world_from_image.affine().abs_diff_eq(expected, 1e-9));
    }
}

#[test]
fn world_fixed_by_first_slice() {
    let mut pairing = StampedPairing::new(options());
    pairing.transform(named(0, "ProbeToTracker", IDENTITY));
    let first = pairing.frame(picture(0)).unwrap();
    pairing.transform(named(1, "ProbeToTracker", IDENTITY));
    pairing.transform(named(1, "ReferenceToTracker", rows(rigid(-0.9, 40.0))));
    let second = pairing.frame(picture(1)).unwrap();
    assert_eq!(pairing.route().unwrap().world(), "Tracker");
    assert_eq!(first.slice.world_from_image, second.slice.world_from_image);
}
