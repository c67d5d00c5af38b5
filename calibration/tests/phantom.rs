//! The phantom file that ships with the project can be built. Its dots are recognised for any
//! hold of the probe.

use std::path::Path;

use glam::{DQuat, DVec3};

use calibration::phantom::Plates;
use calibration::phantom::file::PhantomFile;
use calibration::probe::dots::Dot;
use calibration::probe::plane::ImagePlane;
use calibration::probe::{Layout, Matcher};

const SIZE_PX: [u32; 2] = [640, 480];

#[test]
fn shipped_phantom_is_buildable_and_recognised() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../docs/phantom/nwire.toml");
    let geometry = PhantomFile::read(&path).unwrap().geometry;
    let plates = Plates::of(&geometry).unwrap();
    assert_eq!((plates.apart_mm, plates.thickness_mm(), plates.elsewhere.len()), (60.0, Some(5.0), 0));
    assert!(geometry.landmarks().len() >= 6 && geometry.nwires().len() == 3);
    let layout = Layout::new(geometry.clone()).unwrap();
    assert_eq!(layout.rightwards(), DVec3::X);
    let mut matcher = Matcher::new();
    let turns = [[0.0; 3], [0.3, 0.0, 0.0], [-0.3, 0.1, 0.0], [0.0, 0.25, 0.0], [0.1, -0.2, 0.2], [0.0, 0.0, -0.4]];
    for (number, [about_u, about_n, about_v]) in turns.into_iter().enumerate() {
        // u to the right, v down, the normal away from the viewer.
        let turn = DQuat::from_euler(glam::EulerRot::XYZ, about_u, about_n, about_v);
        let (u, v) = (turn * DVec3::X * 0.1, turn * DVec3::NEG_Z * 0.1);
        let middle = DVec3::new(28.0, 22.0 + 3.0 * number as f64, 30.0);
        let plane = ImagePlane { u, v, origin: middle - u * 320.0 - v * 240.0 };
        let cuts: Vec<_> = geometry.wires().iter().filter_map(|wire| plane.cut(wire)).collect();
        assert!(cuts.len() == 9 && cuts.iter().all(|(_, share)| (0.0..=1.0).contains(share)), "{cuts:?}");
        let dots: Vec<Dot> =
            cuts.iter().map(|(at_px, _)| Dot { at_px: *at_px, contrast: 100.0, area_px: 40 }).collect();
        let reading = matcher.read(&dots, SIZE_PX, &layout).unwrap();
        assert!(reading.best.rightwards && reading.best.marks.len() == 9, "{number}: {reading:?}");
        for mark in &reading.best.marks {
            assert!(mark.at_px.distance(cuts[mark.wire].0) < 1e-9, "{number}: {mark:?}");
        }
    }
}
