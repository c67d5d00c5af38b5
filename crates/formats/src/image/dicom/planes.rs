//! Place of an enhanced ultrasound volume, from its functional groups.

use dicom_core::Tag;
use dicom_dictionary_std::tags;
use glam::DVec3;

use super::attributes::Attributes;
use super::private;
use crate::image::fault::Fault;
use crate::image::layout::Layout;
use crate::image::place::Place;
use crate::image::volume_header::VolumeHeader;

/// Largest deviation of a plane from its even place, as a fraction of the planes' distance.
const EVEN: f64 = 1e-3;
/// Largest difference of directions that count as the same.
const SAME: f64 = 1e-4;

/// Returns the header of an image's volume.
///
/// # Errors
/// [`Fault`] for planes that make no box of evenly spaced voxels.
pub(super) fn header(attributes: &Attributes<'_>, layout: &Layout) -> Result<VolumeHeader, Fault> {
    let slices = u32::try_from(layout.layers)
        .map_err(|_| attributes.fault(tags::NUMBER_OF_FRAMES, "counts more than 2³² planes; the file is damaged"))?;
    let count = slices as usize;
    let stated = place(attributes, count)?;
    let Place { spacing, origin, axes } = match own_place(attributes, &stated)? {
        Some(own) => own,
        None => stated,
    };
    let mut fields = Vec::new();
    if let Some(world) = attributes.private_text(private::WORLD).filter(|world| !world.is_empty()) {
        fields.push(("SonoweaveFrame".to_owned(), format!("{world} (mm, not anatomical)")));
    }
    let lines = attributes.private_text(private::FIELDS).unwrap_or_default();
    fields.extend(
        lines.lines().filter_map(|line| line.split_once(" = ")).map(|(name, value)| (name.into(), value.into())),
    );
    Ok(VolumeHeader {
        spacing,
        origin,
        axes,
        channels: layout.channels,
        fields,
        ..VolumeHeader::new([layout.size[0], layout.size[1], slices], layout.pixel)
    })
}

/// Returns the place of our private element. It holds all bits, but is ignored when another
/// program has moved or cut the planes.
fn own_place(attributes: &Attributes<'_>, stated: &Place) -> Result<Option<Place>, Fault> {
    let Some(numbers) = attributes.private_doubles(private::PLACE, 15)? else { return Ok(None) };
    let triple = |n: usize| -> [f64; 3] { std::array::from_fn(|axis| numbers[3 * n + axis]) };
    let own = Place { origin: triple(0), spacing: triple(1), axes: [triple(2), triple(3), triple(4)] };
    let flat = |place: &Place| {
        let triples = [place.origin, place.spacing].into_iter().chain(place.axes);
        triples.flatten().collect::<Vec<f64>>()
    };
    // The standard's decimal strings have at least ten digits.
    let is_same = flat(&own).iter().zip(flat(stated)).all(|(a, b)| (a - b).abs() <= 1e-6 * b.abs().max(1.0));
    Ok((is_same && own.spacing.iter().all(|mm| *mm > 0.0)).then_some(own))
}

/// Returns the place of the planes by the standard's attributes.
fn place(attributes: &Attributes<'_>, count: usize) -> Result<Place, Fault> {
    let needed = |frame: usize, group: Tag, tag: Tag| {
        let missing = move || {
            let problem = format!("is missing for plane {frame}, so that the volume has no place; export it again");
            attributes.fault(tag, problem)
        };
        attributes.group(frame, group).ok_or_else(missing).map(|group| (group, missing))
    };
    let position = |frame: usize| {
        let tag = tags::IMAGE_POSITION_VOLUME;
        let (group, missing) = needed(frame, tags::PLANE_POSITION_VOLUME_SEQUENCE, tag)?;
        group.array::<3>(tag)?.map(DVec3::from_array).ok_or_else(missing)
    };
    let orientation = |frame: usize| {
        let tag = tags::IMAGE_ORIENTATION_VOLUME;
        let (group, missing) = needed(frame, tags::PLANE_ORIENTATION_VOLUME_SEQUENCE, tag)?;
        let [a, b, c, d, e, f] = group.array::<6>(tag)?.ok_or_else(missing)?;
        Ok([DVec3::new(a, b, c), DVec3::new(d, e, f)])
    };
    let [x, y] = orientation(0)?;
    let is_unit = |axis: DVec3| (axis.length() - 1.0).abs() < SAME;
    if !(is_unit(x) && is_unit(y) && x.dot(y).abs() < SAME) {
        let problem = "holds no two directions of length 1 at right angles; the file is damaged: copy it again";
        return Err(attributes.fault(tags::IMAGE_ORIENTATION_VOLUME, problem));
    }
    let (measures, missing) = needed(0, tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING)?;
    let [row_mm, column_mm] = measures.array::<2>(tags::PIXEL_SPACING)?.ok_or_else(missing)?;
    let origin = position(0)?;
    let (z, slice_mm) = match count {
        1 => {
            let thickness = match measures.array::<1>(tags::SPACING_BETWEEN_SLICES)? {
                Some(spacing) => Some(spacing),
                None => measures.array::<1>(tags::SLICE_THICKNESS)?,
            };
            (x.cross(y), thickness.map_or(1.0, |[mm]| mm))
        }
        _ => {
            let step = (position(count - 1)? - origin) / (count - 1) as f64;
            (step.normalize_or_zero(), step.length())
        }
    };
    let spacing = [column_mm, row_mm, slice_mm];
    if spacing.iter().any(|mm| !(*mm > 0.0 && mm.is_finite())) {
        let problem = format!(
            "gives voxels of {column_mm}×{row_mm} mm at distances of {slice_mm} mm; a volume needs planes at different places: extract one volume"
        );
        return Err(attributes.fault(tags::PIXEL_SPACING, problem));
    }
    for frame in 0..count {
        let expected = origin + z * (slice_mm * frame as f64);
        if position(frame)?.distance(expected) > EVEN * slice_mm {
            let problem = format!(
                "of plane {frame} is not at an even distance from the others; resample the volume to parallel planes, or extract one volume"
            );
            return Err(attributes.fault(tags::IMAGE_POSITION_VOLUME, problem));
        }
        let [u, v] = orientation(frame)?;
        if u.distance(x) > SAME || v.distance(y) > SAME {
            let problem = format!("of plane {frame} differs from the first; resample the volume to parallel planes");
            return Err(attributes.fault(tags::IMAGE_ORIENTATION_VOLUME, problem));
        }
    }
    Ok(Place { spacing, origin: origin.to_array(), axes: [x, y, z].map(|axis| axis.to_array()) })
}
