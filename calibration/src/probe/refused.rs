//! Why there is no calibration.

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
    /// Ten times too many.
    TenthsOfMillimetres,
}

impl Units {
    /// All of them, the usual mistakes first.
    pub const ALL: [Self; 4] = [Self::Centimetres, Self::Inches, Self::Metres, Self::TenthsOfMillimetres];

    /// One of them in mm.
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

/// Why there is no calibration. The display says what to do.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refused {
    /// All INVALID, or none there.
    #[error(
        "of {pictures} pictures none has valid poses of the probe and of what the phantom is held on; was the tracker on, and its status OK?"
    )]
    NoPoses {
        /// How many there are.
        pictures: usize,
    },
    /// Too dark, or nothing in the water.
    #[error(
        "no wires are seen: half of the {pictures} pictures hold {dots} bright spots or fewer, and {least} are the least that can be told apart; is the phantom in the picture, and the gain high enough?"
    )]
    NoWires {
        /// How many there are.
        pictures: usize,
        /// Median number of spots.
        dots: usize,
        /// As many as a picture is recognised by.
        least: usize,
    },
    /// Spots that are not these wires'.
    #[error(
        "bright spots are seen ({dots} in the median one of {pictures} pictures), but they do not lie as the wires of the phantom {phantom} do; is this the file of the phantom that was scanned?"
    )]
    OtherPhantom {
        /// How many there are.
        pictures: usize,
        /// Median number of spots.
        dots: usize,
        /// What it is called.
        phantom: String,
    },
    /// The other side.
    #[error(
        "the pictures are mirrored: {pictures} of them show the wires from left to right that the phantom's file has from right to left; state the pictures' orientation (MF, UF, …) as it is, or hold the \
         probe with its marked side where the file has it"
    )]
    Mirrored {
        /// How many show it so.
        pictures: usize,
    },
    /// Not enough to be sure of anything.
    #[error(
        "{pictures} pictures with recognised wires and valid poses do not make a calibration; 10 are the least, a hundred from different directions are good"
    )]
    TooFew {
        /// How many there are.
        pictures: usize,
    },
    /// One pose.
    #[error(
        "all pictures are from one pose: the probe moved by {way_mm:.1} mm and turned by {turn_deg:.1}°, so that nothing tells the tracker's error from the calibration; move it, and tilt and turn it"
    )]
    Still {
        /// From the first pose.
        way_mm: f64,
        /// From the first pose.
        turn_deg: f64,
    },
    /// The phantom's file.
    #[error("the wires are seen as the phantom's file has them if its numbers are {units}; it is to be in mm")]
    PhantomUnits {
        /// As they seem to be.
        units: Units,
    },
    /// The recording's poses.
    #[error("the dots and the poses fit together if the poses' positions are in {units}; a sequence's are to be in mm")]
    PoseUnits {
        /// As they seem to be.
        units: Units,
    },
    /// The registration.
    #[error(
        "the dots and the poses fit together if the phantom's place on the reference is in {units}; it is to be in mm"
    )]
    RegistrationUnits {
        /// As they seem to be.
        units: Units,
    },
    /// No one plane.
    #[error(
        "no one place of the picture explains where the wires are seen: half of the dots are {mm:.1} mm or more off; was the phantom moved after it was registered, and is this its file, its registration and its recording?"
    )]
    Contradictory {
        /// Spread of the distances, mm.
        mm: f64,
    },
    /// No point and no line.
    #[error(
        "{} is seen in {seen} of {pictures} pictures with valid poses, and in {least} it has to be, a hundred are good; is it in the picture, and the gain high enough?",
        if *.line { "the line of a plane" } else { "a bright spot" }
    )]
    Unseen {
        /// Of a plane.
        line: bool,
        /// Pictures that show it and have poses.
        seen: usize,
        /// How many there are.
        pictures: usize,
        /// As many as are needed.
        least: usize,
    },
    /// The probe was held one way.
    #[error(
        "no rotation about {}: the probe turned by {deg:.1}° there (root mean square, and {least:.0}° are needed), so that the picture could lie in many places; {}",
        listed(.axes, " or "), .axes.iter().map(|axis| axis.advice()).collect::<Vec<_>>().join(", and ")
    )]
    NoTurn {
        /// About which axes of the picture.
        axes: Vec<Axis>,
        /// How far it turned.
        deg: f64,
        /// As far as it has to.
        least: f64,
    },
    /// The point hardly moved in the picture.
    #[error(
        "the point is seen {} of the picture only: its dots are spread by {px:.0} pixels the way they are spread less, and {least:.0} are needed; bring it to all parts of the picture, left and right, near and far",
        if *.line { "along a line" } else { "in one place" }
    )]
    OnePlace {
        /// Along a line, and not in one place.
        line: bool,
        /// Standard deviation across, pixels.
        px: f64,
        /// As large as it has to be.
        least: f64,
    },
    /// No one plane and target.
    #[error(
        "no one place of the picture explains what is seen: {agreeing} of {pictures} pictures agree; did what is scanned rest, is it all that is bright in the picture (--clip), and are the poses those of these pictures?"
    )]
    Disagree {
        /// Pictures that do.
        agreeing: usize,
        /// Pictures that show something.
        pictures: usize,
    },
    /// Pixels that no scanner has.
    #[error(
        "a pixel would be {:.5} × {:.5} mm large{}; a sequence's positions are to be in mm", .pixel_mm[0], .pixel_mm[1],
        .units.map_or(String::new(), |units| format!(", and of a possible size if the poses' positions are in {units}"))
    )]
    PixelSize {
        /// Along u and v.
        pixel_mm: [f64; 2],
        /// By which they would be possible.
        units: Option<Units>,
    },
    /// Too little of everything.
    #[error(
        "the pictures hardly say where the picture lies: a corner of it is known to {mm:.0} mm (one standard deviation), least of all {weakest}; take more pictures, tilt and turn the probe farther and both ways, and let what is scanned be seen all over the picture"
    )]
    Unsure {
        /// Of the worst corner.
        mm: f64,
        /// The parameters that are known least.
        weakest: String,
    },
    /// Wires that never tell.
    #[error(
        "the dots that were recognised leave the picture's place open; scan so that wires of two N's at least are seen in most pictures"
    )]
    Open,
    /// The least squares say what is lacking.
    #[error(transparent)]
    Unsolved(#[from] Unsolved),
}

fn listed(axes: &[Axis], between: &str) -> String {
    axes.iter().map(ToString::to_string).collect::<Vec<_>>().join(between)
}
