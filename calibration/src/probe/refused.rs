//! Reasons why there is no calibration.

use std::fmt;

use super::target::Axis;
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

/// Reasons why there is no calibration. The display includes advice.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refused {
    /// All poses are INVALID or missing.
    #[error(
        "of {pictures} pictures none has valid poses of the probe and of what the phantom is held on; was the tracker on, and its status OK?"
    )]
    NoPoses {
        /// Number of images.
        pictures: usize,
    },
    /// The images are too dark, or nothing is in the water.
    #[error(
        "no wires are seen: half of the {pictures} pictures hold {dots} bright spots or fewer, and {least} are the least that can be told apart; is the phantom in the picture, and the gain high enough?"
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
        "bright spots are seen ({dots} in the median one of {pictures} pictures), but they do not lie as the wires of the phantom {phantom} do; is this the file of the phantom that was scanned?"
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
        "the pictures are mirrored: {pictures} of them show the wires from left to right that the phantom's file has from right to left; state the pictures' orientation (MF, UF, …) as it is, or hold the \
         probe with its marked side where the file has it"
    )]
    Mirrored {
        /// Number of images that show it.
        pictures: usize,
    },
    /// Too few images.
    #[error(
        "{pictures} pictures with recognised wires and valid poses do not make a calibration; 10 are the least, a hundred from different directions are good"
    )]
    TooFew {
        /// Number of images.
        pictures: usize,
    },
    /// All images are from one pose.
    #[error(
        "all pictures are from one pose: the probe moved by {way_mm:.1} mm and turned by {turn_deg:.1}°, so that nothing tells the tracker's error from the calibration; move it, and tilt and turn it"
    )]
    Still {
        /// Distance from the first pose, mm.
        way_mm: f64,
        /// Rotation from the first pose, degrees.
        turn_deg: f64,
    },
    /// The phantom's file is in other units.
    #[error("the wires are seen as the phantom's file has them if its numbers are {units}; it is to be in mm")]
    PhantomUnits {
        /// The apparent units.
        units: Units,
    },
    /// The recording's poses are in other units.
    #[error("the dots and the poses fit together if the poses' positions are in {units}; a sequence's are to be in mm")]
    PoseUnits {
        /// The apparent units.
        units: Units,
    },
    /// The registration is in other units.
    #[error(
        "the dots and the poses fit together if the phantom's place on the reference is in {units}; it is to be in mm"
    )]
    RegistrationUnits {
        /// The apparent units.
        units: Units,
    },
    /// No single plane fits.
    #[error(
        "no one place of the picture explains where the wires are seen: half of the dots are {mm:.1} mm or more off; was the phantom moved after it was registered, and is this its file, its registration and its recording?"
    )]
    Contradictory {
        /// Spread of the distances, mm.
        mm: f64,
    },
    /// Too few images show the point or the line.
    #[error(
        "{} is seen in {seen} of {pictures} pictures with valid poses, and in {least} it has to be, a hundred are good; is it in the picture, and the gain high enough?",
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
        "no rotation about {}: the probe turned by {deg:.1}° there (root mean square, and {least:.0}° are needed), so that the picture could lie in many places; {}",
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
        "the point is seen {} of the picture only: its dots are spread by {px:.0} pixels the way they are spread less, and {least:.0} are needed; bring it to all parts of the picture, left and right, near and far",
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
        "no one place of the picture explains what is seen: {agreeing} of {pictures} pictures agree; did what is scanned rest, is it all that is bright in the picture (--clip), and are the poses those of these pictures?"
    )]
    Disagree {
        /// Number of images that agree.
        agreeing: usize,
        /// Number of images that show something.
        pictures: usize,
    },
    /// The pixel size is impossible.
    #[error(
        "a pixel would be {:.5} × {:.5} mm large{}; a sequence's positions are to be in mm", .pixel_mm[0], .pixel_mm[1],
        .units.map_or(String::new(), |units| format!(", and of a possible size if the poses' positions are in {units}"))
    )]
    PixelSize {
        /// Size along u and v, mm.
        pixel_mm: [f64; 2],
        /// Units with which it would be possible.
        units: Option<Units>,
    },
    /// The data leave the plane too uncertain.
    #[error(
        "the pictures hardly say where the picture lies: a corner of it is known to {mm:.0} mm (one standard deviation), least of all {weakest}; take more pictures, tilt and turn the probe farther and both ways, and let what is scanned be seen all over the picture"
    )]
    Unsure {
        /// Standard deviation of the worst corner, mm.
        mm: f64,
        /// The least determined parameters.
        weakest: String,
    },
    /// The visible wires leave the plane open.
    #[error(
        "the dots that were recognised leave the picture's place open; scan so that wires of two N's at least are seen in most pictures"
    )]
    Open,
    /// The solver names the missing information.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

fn listed(axes: &[Axis], between: &str) -> String {
    axes.iter().map(ToString::to_string).collect::<Vec<_>>().join(between)
}
