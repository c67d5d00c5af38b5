//! Tests of foreign volumes and invalid settings: the correct picture, or an error message with
//! the reason.

use std::io::Write as _;

use glam::{DMat2, DMat3, DVec2, DVec3};

use formats::image::VolumeHeader;
use formats::image::write::VolumeWriter;
use render::camera::View;
use render::classify::light::{Light, Source};
use render::{Picture, RenderSettings, reference};
use sonoweave_core::reading::PixelType;

use crate::figures::{Sheet, Test};
use crate::insertion::turned;
use crate::pictures::{Field, drawn, lattice, millimetres, random_at, rising, sane, whole};
use crate::place::Place;

pub(crate) fn tests() -> Vec<Test> {
    vec![
        Test::new(
            "R3",
            "a body on voxels of 0.2×0.7×1.9 mm, turned and mirrored: its place and its ellipse in the picture",
            body,
        ),
        Test::new("R3", "the same from a file: a ball's place and size in the program's picture", ball_in_a_file),
        Test::new("R4", "light from aside falls on that side of a ball, whatever the lattice", lit_from_aside),
        Test::new("R5", "perspectives up to 170° have their eye outside of the box: the reference", wide_angles),
        Test::new(
            "R6",
            "voxels that are no number, lone voxels, far worlds: the picture of what is there",
            odd_volumes,
        ),
        Test::new(
            "R7",
            "transfer files, sizes and angles that are none: refused by a sentence, nothing written",
            refused,
        ),
    ]
}

/// Axes of a foreign lattice: turned, and left-handed for `mirrored`.
fn directions(mirrored: bool) -> DMat3 {
    let turned = turned(0.5, -0.8, 0.3);
    if mirrored { turned * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)) } else { turned }
}

const SPACING: DVec3 = DVec3::new(0.2, 0.7, 1.9);
const ORIGIN: DVec3 = DVec3::new(31.0, -12.0, 7.5);
const SIZE: [u32; 3] = [110, 34, 14];
/// Index of a body's middle, and its half axes along the lattice, mm.
const MIDDLE: DVec3 = DVec3::new(70.0, 12.0, 8.5);
const HALF_MM: DVec3 = DVec3::new(5.0, 7.0, 9.0);

/// Position at which a view shows a point of the world, computed from angles and the corners of
/// a box. To the right and down, in pixels.
struct Projection {
    axes: [DVec3; 3],
    centre: DVec3,
    pixel: f64,
    /// Distance of the eye from the middle of the box.
    eye: Option<f64>,
    size: [u32; 2],
}

impl Projection {
    fn new(view: &View, size: [u32; 2], direction: DMat3) -> Self {
        let [az, el, roll] = [view.azimuth, view.elevation, view.roll].map(f64::to_radians);
        // The view looks along +y with +z up; it is raised by the elevation about x, turned
        // about z, and about the line of sight.
        let turn = DMat3::from_rotation_z(az) * DMat3::from_rotation_x(-el);
        let (right, forward, up) = (turn * DVec3::X, turn * DVec3::Y, turn * DVec3::Z);
        let (right, up) = (right * roll.cos() - up * roll.sin(), up * roll.cos() + right * roll.sin());
        let of = |index: DVec3| ORIGIN + direction * (index * SPACING);
        let last = DVec3::from_array(SIZE.map(|n| f64::from(n) - 1.0));
        let centre = of(last * 0.5);
        let corners = (0..8).map(|i| {
            let pick = |a: usize| if i >> a & 1 == 1 { last[a] + 1.0 } else { -1.0 };
            of(DVec3::new(pick(0), pick(1), pick(2))) - centre
        });
        let corners: Vec<DVec3> = corners.collect();
        let most = |of: &dyn Fn(DVec3) -> f64| corners.iter().map(|c| of(*c)).fold(0.0, f64::max);
        let [width, height] = size.map(f64::from);
        let (pixel, eye) = match view.perspective {
            None => (2.0 * f64::max(most(&|c| c.dot(right)) / width, most(&|c| c.dot(up)) / height), None),
            Some(angle) => {
                let half = 0.5 * angle.to_radians();
                (2.0 * half.tan() / width.min(height), Some(most(&|c| c.length()) / half.sin()))
            }
        };
        Self { axes: [right, up, forward], centre, pixel, eye, size }
    }

    /// Returns the pixel, and the contribution of a piece of thin matter there to the sum of
    /// all pixels, relative to the middle of a parallel view.
    fn at(&self, world: DVec3) -> (DVec2, f64) {
        let [right, up, forward] = self.axes.map(|axis| axis.dot(world - self.centre));
        let middle = DVec2::from_array(self.size.map(|n| 0.5 * (f64::from(n) - 1.0)));
        let Some(eye) = self.eye else { return (middle + DVec2::new(right, -up) / self.pixel, 1.0) };
        let depth = eye + forward;
        let slant = depth / DVec3::new(right, up, depth).length();
        (middle + DVec2::new(right, -up) / (depth * self.pixel), 1.0 / (depth * depth * slant))
    }
}

/// Returns the weighted mean and covariance.
fn moments(points: impl Iterator<Item = (DVec2, f64)> + Clone) -> (DVec2, DMat2) {
    let total: f64 = points.clone().map(|(_, w)| w).sum();
    let mean = points.clone().map(|(p, w)| p * w).sum::<DVec2>() / total;
    let spread = points.map(|(p, w)| DMat2::from_cols((p - mean) * (p - mean).x, (p - mean) * (p - mean).y) * w);
    (mean, spread.fold(DMat2::ZERO, |a, b| a + b) * (1.0 / total))
}

fn pixels(picture: &Picture, of: impl Fn([f64; 4]) -> f64 + Copy) -> impl Iterator<Item = (DVec2, f64)> + Clone {
    let width = picture.size[0];
    let at = move |n: u32| DVec2::new(f64::from(n % width), f64::from(n / width));
    (0_u32..).zip(&picture.pixels).map(move |(n, p)| (at(n), of(p.map(f64::from))))
}

/// Value of a voxel, from 0 to 1, in an ellipsoid with a soft border.
fn soft(at: [i64; 3], half_mm: DVec3) -> f64 {
    let off = (DVec3::from_array(at.map(|x| x as f64)) - MIDDLE) * SPACING / half_mm;
    ((1.3 - off.length()) / 0.6).clamp(0.0, 1.0)
}

fn body(sheet: &mut Sheet) {
    let high = SIZE.map(|n| i64::from(n) - 1);
    for mirrored in [false, true] {
        let direction = directions(mirrored);
        let world = lattice(direction, SPACING, ORIGIN);
        let volume = Field { low: [0; 3], high, value: |at: [i64; 3]| Some((255.0 * soft(at, HALF_MM)) as f32) };
        for (azimuth, elevation, roll, perspective) in [
            (0.0, 0.0, 0.0, None),
            (30.0, 20.0, 0.0, None),
            (-110.0, -35.0, 40.0, None),
            (30.0, 20.0, 15.0, Some(50.0)),
            (200.0, 60.0, -70.0, Some(20.0)),
        ] {
            let view = View { azimuth, elevation, roll, perspective, turns: false, ..View::default() };
            // So thin that the front does not attenuate the back.
            let thin = rising(&[(0.0, 0.0), (255.0, 2e-4)]);
            let settings = RenderSettings { view, step: 0.5, ..whole([72, 60], thin) };
            let picture = drawn(&settings, volume.region(world), &volume);
            let (mean, spread) = moments(pixels(&picture, |p| p[0]));
            // The same computed from the voxels.
            let projection = Projection::new(&view, settings.size, direction);
            let voxels: Vec<(DVec2, f64)> = (0..SIZE.iter().product::<u32>())
                .filter_map(|n| {
                    let at = [n % SIZE[0], n / SIZE[0] % SIZE[1], n / (SIZE[0] * SIZE[1])].map(i64::from);
                    let share = soft(at, HALF_MM);
                    let place = ORIGIN + direction * (DVec3::from_array(at.map(|x| x as f64)) * SPACING);
                    let (pixel, weight) = projection.at(place);
                    (share > 0.0).then_some((pixel, share * weight))
                })
                .collect();
            let (expected, mut around) = moments(voxels.iter().copied());
            // Trilinear interpolation between voxels: tents, whose variance is a sixth of the
            // squared spacing.
            let centre = ORIGIN + direction * (MIDDLE * SPACING);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let [a, b] = [-0.5, 0.5].map(|t| projection.at(centre + direction * (axis * SPACING * t)).0);
                let d = b - a;
                around += DMat2::from_cols(d * d.x, d * d.y) * (1.0 / 6.0);
            }
            let what =
                |said: &str| format!("mirrored {mirrored}, {azimuth}°, {elevation}°, {roll}°, {perspective:?}: {said}");
            sheet.at_most(&what("middle, pixels off"), (mean - expected).length(), 0.03);
            let off = (spread - around).to_cols_array().into_iter().map(f64::abs).fold(0.0, f64::max);
            sheet.at_most(&what("ellipse, share off"), off / (around.x_axis.x + around.y_axis.y), 0.01);
            // Error of a picture with the opposite handedness.
            let other = Projection::new(&view, settings.size, directions(!mirrored));
            let elsewhere = other.at(ORIGIN + directions(!mirrored) * (MIDDLE * SPACING)).0;
            sheet.above(
                &what("from there to where the other hand has it, pixels"),
                (elsewhere - expected).length(),
                1.0,
            );
        }
    }
}

fn put(place: &Place, name: &str, header: &VolumeHeader, bytes: &[u8]) {
    let mut file = VolumeWriter::create(&place.path(name), header).unwrap();
    file.write_all(bytes).unwrap();
    file.finish().unwrap();
}

fn ball_in_a_file(sheet: &mut Sheet) {
    let place = Place::new();
    place.put(
        "t.toml",
        "format = \"sonoweave-transfer\"\nversion = 1\n[opacity]\ncurve = [[100, 0], [150, 0.4]]\n[colour]\ngrey = [0, 200]\n",
    );
    let radius = 6.0;
    for mirrored in [false, true] {
        let direction = directions(mirrored);
        let header = VolumeHeader {
            origin: ORIGIN.to_array(),
            spacing: SPACING.to_array(),
            axes: direction.to_cols_array_2d(),
            ..VolumeHeader::new(SIZE, PixelType::U8)
        };
        let bytes: Vec<u8> = (0..SIZE.iter().product::<u32>())
            .map(|n| {
                let at = [n % SIZE[0], n / SIZE[0] % SIZE[1], n / (SIZE[0] * SIZE[1])].map(f64::from);
                let off = ((DVec3::from_array(at) - MIDDLE) * SPACING).length();
                (125.0 + 60.0 * (radius - off)).clamp(0.0, 250.0) as u8
            })
            .collect();
        put(&place, "v.mha", &header, &bytes);
        for (azimuth, elevation, roll) in [(0.0, 0.0, 0.0), (30.0, 20.0, 0.0), (-110.0, -35.0, 40.0)] {
            let angles = format!("--view {azimuth},{elevation},{roll}");
            place.does(&format!("render v.mha -o p.png --image-size 96x80 --transfer t.toml {angles}"));
            let picture = image::load_from_memory(&place.get("p.png")).unwrap().to_luma8();
            let seen: Vec<(DVec2, f64)> = picture
                .enumerate_pixels()
                .filter(|(_, _, p)| p.0[0] > 30)
                .map(|(i, j, _)| (DVec2::new(f64::from(i), f64::from(j)), 1.0))
                .collect();
            let view = View { azimuth, elevation, roll, ..View::default() };
            let projection = Projection::new(&view, [96, 80], direction);
            let (expected, _) = projection.at(ORIGIN + direction * (MIDDLE * SPACING));
            let (mean, spread) = moments(seen.iter().copied());
            let what = |said: &str| format!("mirrored {mirrored}, {azimuth}°, {elevation}°, {roll}°: {said}");
            sheet.at_most(&what("middle, pixels off"), (mean - expected).length(), 0.5);
            let wanted = radius / projection.pixel;
            // The variance of a disc along any line is a quarter of the squared radius. A voxel
            // of 1.9 mm is a third of the radius.
            for (name, variance) in [("across", spread.x_axis.x), ("down", spread.y_axis.y)] {
                sheet.near(
                    &what(&format!("radius {name}, of that of the ball")),
                    2.0 * variance.sqrt() / wanted,
                    1.0,
                    0.12,
                );
            }
        }
    }
}

fn lit_from_aside(sheet: &mut Sheet) {
    let high = SIZE.map(|n| i64::from(n) - 1);
    let view = View { azimuth: 30.0, elevation: 20.0, roll: 10.0, ..View::default() };
    let axes = view.axes();
    for mirrored in [false, true] {
        let direction = directions(mirrored);
        let volume =
            Field { low: [0; 3], high, value: |at: [i64; 3]| Some((255.0 * soft(at, DVec3::splat(6.0))) as f32) };
        for (right, up) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.6, -0.8)] {
            // Partly from the eye's side, so that the lit side is visible.
            let towards = axes.right * right + axes.up * up - axes.forward * 0.5;
            let light = Light::default().with_parts(0.0, 1.0, 0.0, 1).unwrap().with_two_sided(false);
            let light = light.with_source(Source::Fixed(towards)).unwrap();
            let look = whole([72, 60], rising(&[(0.0, 0.0), (255.0, 0.3)]));
            let settings = RenderSettings { view, light, step: 0.5, ..look };
            let picture = drawn(&settings, volume.region(lattice(direction, SPACING, ORIGIN)), &volume);
            let (bright, _) = moments(pixels(&picture, |p| p[0]));
            let (all, _) = moments(pixels(&picture, |p| 1.0 - p[3]));
            let off = bright - all;
            let angle = off.angle_to(DVec2::new(right, -up)).to_degrees().abs();
            let what = |said: &str| format!("mirrored {mirrored}, light from {right}, {up}: {said}");
            sheet.above(&what("brightness lies aside, pixels"), off.length(), 2.0);
            sheet.at_most(&what("degrees off the light's side"), angle, 3.0);
        }
    }
}

fn wide_angles(sheet: &mut Sheet) {
    let value = |at: [i64; 3]| (random_at(6, at) < 0.8).then(|| (255.0 * random_at(7, at)) as f32);
    let volume = Field { low: [0; 3], high: [25, 19, 30], value };
    let region = volume.region(millimetres());
    for degrees in [1.0, 90.0, 150.0, 170.0] {
        let view = View { azimuth: 50.0, elevation: -35.0, perspective: Some(degrees), ..View::default() };
        let settings = RenderSettings { view, step: 0.7, ..whole([40, 32], rising(&[(60.0, 0.0), (255.0, 0.3)])) };
        let picture = drawn(&settings, region, &volume);
        let what = |said: &str| format!("{degrees}°: {said}");
        sheet.holds(&what("all within 0 and 1"), sane(&picture, 1e-6));
        let exact = reference::render(&volume, &settings, &region).unwrap();
        sheet.at_most(&what("off the reference"), exact.difference(&picture)[0], 3e-5);
        let seen = picture.pixels.iter().filter(|p| p[3] < 0.9).count();
        sheet.above(&what("pixels that see it"), seen as f64, 4.0);
        let corner = render::camera::Camera::new(&view, settings.size, 1.0, &region).unwrap().ray(0, 0).base;
        sheet.holds(&what("a ray's first sample is finite"), corner.is_finite());
    }
}

fn odd_volumes(sheet: &mut Sheet) {
    let place = Place::new();
    let size = [12_u32, 9, 10];
    let floats = VolumeHeader::new(size, PixelType::F32);
    let count = size.iter().product::<u32>();
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 0.0];
    let bytes = |of: &dyn Fn(u32) -> f32| -> Vec<u8> { (0..count).flat_map(|n| of(n).to_ne_bytes()).collect() };
    let value = |n: u32| if n % 13 == 3 { bad[(n / 13) as usize % 4] } else { (n % 251) as f32 };
    let flags = "--image-size 31x27 --transfer xray --window 0,255 -o p.png";
    put(&place, "v.mha", &floats, &bytes(&|n| if n % 13 == 3 && (n / 13) % 4 == 3 { 9.0 } else { value(n) }));
    let run = place.run(&format!("render v.mha {flags}"));
    sheet.equal("values that are no number: exit code", run.code, 0);
    let with = place.get("p.png");
    put(&place, "v.mha", &floats, &bytes(&|n| if value(n).is_finite() && n % 13 != 3 { value(n) } else { 9.0 }));
    put(&place, "w.mha", &floats, &bytes(&|n| if n % 13 == 3 && (n / 13) % 4 != 3 { 0.0 } else { 1.0 }));
    place.run(&format!("render v.mha --weights w.mha {flags}"));
    sheet.holds(
        "values that are no number: the picture of a volume in which they were not seen",
        place.get("p.png") == with,
    );
    put(&place, "v.mha", &floats, &bytes(&|_| f32::NAN));
    let run = place.run(&format!("render v.mha {flags} --background 1,0,0"));
    let red =
        |name: &str| image::load_from_memory(&place.get(name)).unwrap().to_rgb8().pixels().all(|p| p.0 == [255, 0, 0]);
    sheet.holds(
        "none but such: said, and background",
        run.code == 0 && run.stderr.contains("no voxel was seen") && red("p.png"),
    );

    for size in [[1, 1, 1], [1, 1, 60], [60, 1, 1]] {
        put(
            &place,
            "v.mha",
            &VolumeHeader::new(size, PixelType::U8),
            &vec![200; size.iter().product::<u32>() as usize],
        );
        for flags in ["--image-size 1x1", "--image-size 1x91", "--image-size 91x1 --perspective 60"] {
            let run = place.run(&format!("render v.mha -o p.png --transfer phantom {flags}"));
            let brightest =
                image::load_from_memory(&place.get("p.png")).unwrap().to_luma8().pixels().map(|p| p.0[0]).max();
            let what = format!("{size:?} voxels, {flags}: exit code and whether it is seen");
            sheet.equal(&what, (run.code, brightest > Some(20)), (0, true));
        }
    }
    // The same volume a kilometre away has the same picture, except for the rounding of its
    // position.
    let near = VolumeHeader { spacing: [0.5, 0.4, 0.3], ..VolumeHeader::new(size, PixelType::U8) };
    let speckle: Vec<u8> = (0..count).map(|n| (n * 37 % 251) as u8).collect();
    let draw = |header: &VolumeHeader| {
        put(&place, "v.mha", header, &speckle);
        place.does("render v.mha -o p.png --image-size 40x40 --transfer phantom --view 40,30 --perspective 30");
        image::load_from_memory(&place.get("p.png")).unwrap().to_luma8()
    };
    let (here, there) = (draw(&near), draw(&VolumeHeader { origin: [1e6, -1e6, 3e5], ..near.clone() }));
    let off = here.pixels().zip(there.pixels()).map(|(a, b)| a.0[0].abs_diff(b.0[0])).max().unwrap_or(255);
    sheet.at_most("a kilometre away, grey levels off", f64::from(off), 1.0);
    // One axis is so much finer than another that rays would have 10⁵ samples.
    put(&place, "flat.mha", &VolumeHeader { spacing: [0.001, 1.0, 100.0], ..near }, &speckle);
    place.refuses("render flat.mha -o none.png", &["samples a ray", "--step"]);
    sheet.holds("voxels of 0.001×1×100 mm: refused, and --step is named", true);
}

fn refused(sheet: &mut Sheet) {
    let place = Place::new();
    put(&place, "v.mha", &VolumeHeader::new([4, 4, 4], PixelType::U8), &[99; 64]);
    let head = "format = \"sonoweave-transfer\"\nversion = 1\n";
    for (name, body) in [
        ("NaN intensity", "opacity.curve = [[nan, 0.5]]"),
        ("NaN opacity", "opacity.curve = [[0, 0], [9, nan]]"),
        ("infinite intensity", "opacity.curve = [[0, 0], [inf, 1]]"),
        ("opacity above 1", "opacity.curve = [[0, 0], [9, 1.5]]"),
        ("opacity below 0", "opacity.curve = [[0, -0.1], [9, 1]]"),
        ("no points", "opacity.curve = []"),
        ("points backwards", "opacity.curve = [[9, 0], [0, 1]]"),
        ("NaN border", "opacity.region = [[0, nan], [9, 1]]"),
        ("NaN isovalue", "opacity.isovalue = {value = nan, thickness_mm = 1, opacity = 1}"),
        ("thickness 0", "opacity.isovalue = {value = 9, thickness_mm = 0, opacity = 1}"),
        ("NaN unit", "unit_mm = nan\nopacity.curve = [[0, 1]]"),
        ("unit 0", "unit_mm = 0\nopacity.curve = [[0, 1]]"),
        ("NaN gradient", "gradient = [[nan, 1]]\nopacity.curve = [[0, 1]]"),
        ("gradient below 0", "gradient = [[-1, 1]]\nopacity.curve = [[0, 1]]"),
        ("NaN colour", "colour.list = [[0, nan, 0, 0]]\nopacity.curve = [[0, 1]]"),
        ("NaN window", "colour.grey = [0, nan]\nopacity.curve = [[0, 1]]"),
        ("window backwards", "colour.grey = [9, 0]\nopacity.curve = [[0, 1]]"),
    ] {
        place.put("t.toml", format!("{head}{body}\n"));
        let run = place.run("render v.mha -o p.png --transfer t.toml --image-size 8x8");
        let sentence =
            run.stderr.lines().count() >= 1 && run.stderr.contains("t.toml") && !run.stderr.contains("panicked");
        sheet.equal(
            &format!("{name}: exit code, sentence, no picture"),
            (run.code, sentence, place.names().contains("p.png")),
            (2, true, false),
        );
    }
    for (words, code, says) in [
        ("--image-size 0x0", 2, "--image-size"),
        ("--image-size 5x-3", 2, "--image-size"),
        ("--image-size 10", 2, "--image-size"),
        ("--image-size 10x10x10", 2, "--image-size"),
        ("--image-size 4294967296x1", 2, "--image-size"),
        ("--image-size 8193x1", 2, "8192"),
        ("--image-size 1x4294967295", 2, "8192"),
        ("--view inf,0", 2, "must be finite"),
        ("--view 1e300,0", 2, "azimuth"),
        ("--perspective 0", 2, "170"),
        ("--perspective 171", 2, "170"),
        ("--perspective nan", 2, "170"),
        ("--step inf", 2, "--step"),
        ("--stop nan", 2, "--stop"),
    ] {
        let run = place.run(&format!("render v.mha -o p.png {words}"));
        let said = run.stderr.contains(says) && !run.stderr.contains("panicked");
        sheet.equal(
            &format!("{words}: exit code, sentence, no picture"),
            (run.code, said, place.names().contains("p.png")),
            (code, true, false),
        );
    }
    // A volume with an empty box.
    let empty = "ObjectType = Image\nNDims = 3\nBinaryData = True\nDimSize = 0 4 4\nElementType = MET_UCHAR\nElementDataFile = LOCAL\n";
    place.put("empty.mha", empty);
    let run = place.run("render empty.mha -o p.png");
    let said = run.stderr.contains("empty.mha") && run.stderr.contains("DimSize");
    sheet.equal(
        "a volume of 0×4×4 voxels: exit code, sentence, no picture",
        (run.code, said, place.names().contains("p.png")),
        (3, true, false),
    );
    let run = place.run("render v.mha -o p.png --image-size 8x8 --perspective 170");
    sheet.equal("what is left is drawn: exit code, picture", (run.code, place.names().contains("p.png")), (0, true));
}
