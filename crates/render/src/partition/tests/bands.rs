//! Pictures in bands of rows, folded messages, and plans for a limit of memory.

use super::*;
use crate::RenderMemory;
use crate::partition::Plan;

/// A finished volume, and the region of its sweep.
fn scene(motion: Motion) -> (PathReconstructor, RenderRegion) {
    let (scan, reconstruction, region) = sweep(12, motion, DMat3::from_rotation_x(0.3));
    let mut reconstructor = PathReconstructor::general(reconstruction, scan.mask().clone()).unwrap();
    for frame in 0..scan.frames() {
        reconstructor.insert(&scan.slice(frame)).unwrap();
    }
    (reconstructor, region)
}

/// Renders a volume in parts and bands; returns the picture, and the bytes of the messages.
fn in_bands(
    settings: &RenderSettings,
    region: &RenderRegion,
    volume: &(impl Values + ?Sized),
    (parts, bands): (u32, &[u32]),
    is_folded: bool,
) -> (Picture, usize) {
    let bricks: Vec<BrickIndex> = volume.bricks().collect();
    let (mut pixels, mut bytes) = (Vec::new(), 0);
    for rows in bands.windows(2).map(|ends| ends[0]..ends[1]) {
        let mut compositor = Compositor::of_rows(settings, region, rows.clone()).unwrap();
        for part in 0..parts {
            let part = Part::of_rows(settings, region, (part, parts), rows.clone()).unwrap();
            let mut part = if is_folded { part.folded() } else { part };
            let needed = part.needed(&bricks);
            let volume = Within { volume, region: part.region() };
            // In two readings, as of a volume on the disk.
            let (first, rest) = needed.split_at(needed.len() / 2);
            part.read_on(None, &volume, first);
            part.read_on(None, &volume, rest);
            let message = part.draw_on(None);
            assert_eq!(message.work.bricks_read, needed.len() as u64);
            bytes += message.bytes.len();
            compositor.receive(&message.bytes).unwrap();
        }
        pixels.extend(compositor.picture().pixels);
    }
    (Picture { size: settings.size, pixels }, bytes)
}

#[test]
fn bands_of_parts_give_same_picture_in_every_mode() {
    for (base, motion) in
        all_settings().into_iter().chain(ways()).zip([Motion::Freehand, Motion::Crossing].into_iter().cycle())
    {
        let (reconstructor, region) = scene(motion);
        let mut renderer = Renderer::new(&base, region).unwrap();
        renderer.update_all(reconstructor.volume());
        let height = base.size[1];
        for (parts, bands) in
            [(1, vec![0, height]), (3, vec![0, 1, height / 3, height]), (8, vec![0, height / 2, height])]
        {
            let (picture, _) = in_bands(&base, &region, reconstructor.volume(), (parts, &bands), false);
            let what = format!("{:?}, {parts} parts, rows {bands:?}", base.mode);
            assert!(
                same(&picture, &renderer.picture()),
                "{what}: off by {:?}",
                picture.difference(&renderer.picture())
            );
        }
    }
}

#[test]
fn folded_messages_are_short_and_within_a_grey_level() {
    let mut shorter = 0;
    for base in all_settings().into_iter().chain(ways()) {
        let (reconstructor, region) = scene(Motion::Freehand);
        let mut renderer = Renderer::new(&base, region).unwrap();
        renderer.update_all(reconstructor.volume());
        let bands = [0, base.size[1]];
        let [whole, folded] =
            [false, true].map(|is_folded| in_bands(&base, &region, reconstructor.volume(), (4, &bands), is_folded));
        let exact = renderer.picture();
        let off = folded.0.pixels.iter().zip(&exact.pixels);
        let off = off.flat_map(|(a, b)| (0..4).map(|c| (a[c] - b[c]).abs())).fold(0.0, f32::max);
        assert!(off <= 1.0 / 255.0, "{:?}: {off}", base.mode);
        assert!(folded.1 > 0 && folded.1 <= whole.1);
        shorter += usize::from(folded.1 * 2 < whole.1);
    }
    assert!(shorter > 2, "{shorter} pictures have messages of less than half the length");
}

#[test]
fn bricks_outside_of_rows_and_of_picture_are_not_needed() {
    let base = &all_settings()[0];
    let (reconstructor, region) = scene(Motion::Freehand);
    let bricks: Vec<BrickIndex> = reconstructor.volume().bricks().collect();
    let needed =
        |settings: &RenderSettings, rows| Part::of_rows(settings, &region, (0, 1), rows).unwrap().needed(&bricks).len();
    let height = base.size[1];
    assert_eq!(needed(base, 0..height), bricks.len());
    let [above, below] = [0..height / 2, height / 2..height].map(|rows| needed(base, rows));
    assert!(above < bricks.len() && below < bricks.len() && above + below >= bricks.len(), "{above} {below}");
    let zoomed = RenderSettings { view: View { zoom: 3.0, ..base.view }, ..base.clone() };
    assert!((1..bricks.len()).contains(&needed(&zoomed, 0..height)));
    let mut renderer = Renderer::new(&zoomed, region).unwrap();
    renderer.update_all(reconstructor.volume());
    let (picture, _) = in_bands(&zoomed, &region, reconstructor.volume(), (2, &[0, height]), false);
    assert!(same(&picture, &renderer.picture()));
}

#[test]
fn plan_keeps_limits_and_names_what_is_needed() {
    for base in all_settings() {
        // Long blocks would reach through all parts of this small volume.
        let base = RenderSettings { arity: Some(2), ..base };
        let (reconstructor, region) = scene(Motion::Crossing);
        let bricks: Vec<BrickIndex> = reconstructor.volume().bricks().collect();
        let plan = |parts, limits| Plan::new(&base, &region, &bricks, parts, limits);
        let whole = plan(None, [u64::MAX; 2]).unwrap();
        assert_eq!((whole.parts, whole.bands), (1, 1));
        assert_eq!(plan(Some(3), [u64::MAX; 2]).unwrap().parts, 3);
        let limits = [whole.voxel_bytes * 4 / 5, whole.ray_bytes / 3];
        let cut = plan(None, limits).unwrap();
        assert!(cut.bands >= 3 && cut.voxel_bytes <= limits[0] && cut.ray_bytes <= limits[1], "{cut:?}");
        let rows: Vec<_> = cut.rows().collect();
        assert_eq!((rows.len() as u32, rows[0].start, rows[rows.len() - 1].end), (cut.bands, 0, base.size[1]));
        assert!(rows.windows(2).all(|pair| pair[0].end == pair[1].start));
        for plan in [whole, cut] {
            for (part, rows) in plan.rows().flat_map(|rows| (0..plan.parts).map(move |part| (part, rows.clone()))) {
                let mut part = Part::of_rows(&base, &region, (part, plan.parts), rows.clone()).unwrap();
                let message = part.update(reconstructor.volume(), &bricks);
                let RenderMemory { voxels, rays } = part.memory();
                let rays =
                    rays + message.bytes.len() as u64 + Compositor::of_rows(&base, &region, rows).unwrap().bytes();
                assert!(voxels <= plan.voxel_bytes && rays <= plan.ray_bytes, "{voxels} {rays} {plan:?}");
            }
        }
        let refused = plan(None, [1000, u64::MAX]).unwrap_err();
        assert!(matches!(refused, RenderError::Memory { needed_bytes, .. } if needed_bytes > 1000), "{refused}");
        assert!(matches!(plan(None, [u64::MAX, 1000]), Err(RenderError::Memory { .. })));
        assert!(matches!(plan(Some(1000), [u64::MAX; 2]), Err(RenderError::Part { .. })));
    }
}

#[test]
fn messages_and_rows_of_other_bands_are_refused() {
    let base = &all_settings()[0];
    let (reconstructor, region) = scene(Motion::Freehand);
    let (height, bricks) = (base.size[1], reconstructor.volume().bricks().collect::<Vec<_>>());
    let mut part = Part::of_rows(base, &region, (0, 1), 0..height).unwrap();
    let message = part.update(reconstructor.volume(), &bricks);
    let mut compositor = Compositor::of_rows(base, &region, height / 2..height).unwrap();
    assert!(matches!(compositor.receive(&message.bytes), Err(RenderError::Message { .. })));
    assert!(compositor.picture().pixels.iter().all(|pixel| *pixel == [0.0, 0.0, 0.0, 1.0]), "unchanged");
    for rows in [height..height + 1, 3..3] {
        assert!(matches!(Compositor::of_rows(base, &region, rows.clone()), Err(RenderError::Rows { .. })));
        assert!(matches!(Part::of_rows(base, &region, (0, 1), rows), Err(RenderError::Rows { .. })));
    }
}
