//! Errors of a probe's calibration.

use std::fmt;

use crate::least_squares::Unsolved;

/// Units that are mistaken for mm.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Units {
    /// 10 mm.
    Centimetres,
    /// 25.4 mm.
    Inches,
    /// 1000 mm.
    Metres,
    /// 0.1 mm: the numbers are ten times too large.
    TenthsOfMillimetres,
}

impl Units {
    /// All of them, the usual mistakes first.
    pub const ALL: [Self; 4] = [Self::Centimetres, Self::Inches, Self::Metres, Self::TenthsOfMillimetres];

    /// Returns one of them in mm.
    pub fn factor(self) -> f64 {
        match self {
            Self::Centimetres => 10.0,
            Self::Inches => 25.4,
            Self::Metres => 1000.0,
            Self::TenthsOfMillimetres => 0.1,
        }
    }
}

impl fmt::Display for Units {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Centimetres => "cm",
            Self::Inches => "inches",
            Self::Metres => "m",
            Self::TenthsOfMillimetres => "tenths of a mm",
        })
    }
}

/// An axis of the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// Along its rows.
    U,
    /// Along its columns.
    V,
    /// Perpendicular to it.
    Normal,
}

impl fmt::Display for Axis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::U => "u",
            Self::V => "v",
            Self::Normal => "the image's normal",
        })
    }
}

impl Axis {
    /// Returns advice for turning a probe about it.
    fn advice(self) -> &'static str {
        match self {
            Self::U => "tilt the probe fore and aft",
            Self::V => "turn the probe about its long axis",
            Self::Normal => "tilt the probe from side to side",
        }
    }
}

/// Reasons why there is no calibration of a probe.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ProbeError {
    /// The phantom's dots are indistinguishable.
    #[error(
        "no three of the phantom's {wires} wires make an N (two parallel wires, and one aslant between them in their \
        plane); give the file of an N-wire phantom"
    )]
    NoN {
        /// Number of wires.
        wires: usize,
    },
    /// All poses are INVALID or missing.
    #[error(
        "none of {pictures} frames has valid poses of probe and reference; check that the tracker was on, and its \
        status OK"
    )]
    NoPoses {
        /// Number of images.
        pictures: usize,
    },
    /// The images are too dark, or nothing is in the water.
    #[error(
        "no wires are visible: half of the {pictures} frames have {dots} bright spots or fewer, but {least} are \
        needed; bring the phantom into the image, and raise the gain"
    )]
    NoWires {
        /// Number of images.
        pictures: usize,
        /// Median number of spots.
        dots: usize,
        /// Minimum for recognition.
        least: usize,
    },
    /// The spots do not match these wires.
    #[error(
        "the bright spots ({dots} in the median of {pictures} frames) do not match the wires of the phantom {phantom}; \
        give the file of the scanned phantom"
    )]
    OtherPhantom {
        /// Number of images.
        pictures: usize,
        /// Median number of spots.
        dots: usize,
        /// Name of the phantom.
        phantom: String,
    },
    /// The images show the other side.
    #[error(
        "{pictures} frames are mirrored: they show the wires in reverse order, from left to right; correct the frames' \
        orientation (MF, UF, …), or turn the probe's marked side to the phantom's marked side"
    )]
    Mirrored {
        /// Number of images that show it.
        pictures: usize,
    },
    /// Too few images.
    #[error(
        "{pictures} frames with recognised wires and valid poses are too few; record at least 10, better a hundred \
        from different directions"
    )]
    TooFew {
        /// Number of images.
        pictures: usize,
    },
    /// All images are from one pose.
    #[error(
        "all frames are from one pose: the probe moved by {way_mm:.1} mm and turned by {turn_deg:.1}°; move, tilt and \
        turn the probe during the scan"
    )]
    Still {
        /// Distance from the first pose, mm.
        way_mm: f64,
        /// Rotation from the first pose, degrees.
        turn_deg: f64,
    },
    /// The phantom's file is in other units.
    #[error("the phantom's file matches if its numbers are in {units}; give them in mm")]
    PhantomUnits {
        /// The apparent units.
        units: Units,
    },
    /// The recording's poses are in other units.
    #[error("dots and poses match if the poses' positions are in {units}; record them in mm")]
    PoseUnits {
        /// The apparent units.
        units: Units,
    },
    /// The registration is in other units.
    #[error("dots and poses match if the phantom's registration is in {units}; give it in mm")]
    RegistrationUnits {
        /// The apparent units.
        units: Units,
    },
    /// No single plane fits.
    #[error(
        "no image plane explains the wires' dots: half of them are {mm:.1} mm or more off; check that phantom file, \
        registration and recording belong together, and that the phantom was not moved after its registration"
    )]
    Contradictory {
        /// Spread of the distances, mm.
        mm: f64,
    },
    /// Too few images show the point or the line.
    #[error(
        "{} is visible in {seen} of {pictures} frames with valid poses, but {least} are needed; bring it into the \
        image, and raise the gain",
        if *.line { "the line of a plane" } else { "a bright spot" }
    )]
    Unseen {
        /// Whether the target is a plane.
        line: bool,
        /// Number of images that show it and have poses.
        seen: usize,
        /// Number of images.
        pictures: usize,
        /// Number required.
        least: usize,
    },
    /// The probe was not turned about some axes.
    #[error(
        "the probe hardly turned about {} ({deg:.1}° root mean square, but {least:.0}° are needed); {}",
        listed(.axes, " or "), .axes.iter().map(|axis| axis.advice()).collect::<Vec<_>>().join(", and ")
    )]
    NoTurn {
        /// The axes of the image.
        axes: Vec<Axis>,
        /// Rotation of the probe, degrees.
        deg: f64,
        /// Rotation required, degrees.
        least: f64,
    },
    /// The point hardly moved in the image.
    #[error(
        "the point is visible {} of the image only: its dots spread by {px:.0} pixels across, but {least:.0} are \
        needed; bring it to all parts of the image, left and right, near and far",
        if *.line { "along a line" } else { "in one place" }
    )]
    OnePlace {
        /// Whether the dots are spread along a line, and not in one place.
        line: bool,
        /// Standard deviation across, pixels.
        px: f64,
        /// Standard deviation required, pixels.
        least: f64,
    },
    /// No single plane and target fit.
    #[error(
        "no image plane explains the frames: {agreeing} of {pictures} agree; keep the target at rest and the only \
        bright thing in the image, and check that the poses belong to the frames"
    )]
    Disagree {
        /// Number of images that agree.
        agreeing: usize,
        /// Number of images that show something.
        pictures: usize,
    },
    /// The pixel size is impossible.
    #[error(
        "the pixel size of {:.5} × {:.5} mm is impossible{}; record positions in mm", .pixel_mm[0], .pixel_mm[1],
        .units.map_or(String::new(), |units| format!(", unless the poses' positions are in {units}"))
    )]
    PixelSize {
        /// Size along u and v, mm.
        pixel_mm: [f64; 2],
        /// Units with which it would be possible.
        units: Option<Units>,
    },
    /// The data leave the plane too uncertain.
    #[error(
        "the frames determine a corner of the image to {mm:.0} mm only (one standard deviation), and {weakest} least; \
        record more frames with the target all over the image, and tilt and turn the probe farther, both ways"
    )]
    Unsure {
        /// Standard deviation of the worst corner, mm.
        mm: f64,
        /// The least determined parameters.
        weakest: String,
    },
    /// The visible wires leave the plane open.
    #[error("the recognised dots do not determine the image plane; scan so that most frames show wires of two N's")]
    Open,
    /// The solver names the missing information.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

fn listed(axes: &[Axis], between: &str) -> String {
    axes.iter().map(ToString::to_string).collect::<Vec<_>>().join(between)
}
