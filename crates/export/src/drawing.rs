//! A workshop drawing of a phantom of two plates, at 1:1 on paper: sawing, drilling, wire
//! routing and assembly.
//!
//! All dimensions are the phantom's own ([`Plates`]). Dimensions that are not in its file may be
//! changed: the plates' outline, the rods' holes, the holes' diameter.

mod pen;

use std::fmt::Write as _;

use glam::DVec2;

use calibration::phantom::plates::{Plate, Plates};
use calibration::phantom::{Geometry, Wire};

use self::pen::{Pen, mm, number};
use super::ExportError;
use super::page::escaped;

/// Width and height common to A4 and Letter paper, mm.
const SMALL: DVec2 = DVec2::new(210.0, 279.0);
/// Width and height of A3 paper, mm.
const LARGE: DVec2 = DVec2::new(297.0, 420.0);
/// Margin that printers leave empty, mm.
const RIM: f64 = 10.0;
/// Distance from the outermost hole or landmark to a plate's edge, mm.
const MARGIN: f64 = 10.0;
/// Distance of the rods' holes from a plate's edges, mm.
const ROD_INSET: f64 = 5.0;
/// Diameter of the rods' holes: M4 with clearance, mm.
const ROD_HOLE: f64 = 4.2;
/// Diameter of the wires' holes, mm.
const WIRE_HOLE: f64 = 0.8;
/// Space for dimensions to the left of a plate and below it, mm.
const DIMENSION: f64 = 8.0;
/// Patterns in one row, viewed from above.
const ABREAST: usize = 3;
/// Line height of a table, mm.
const LINE: f64 = 4.3;

/// Returns the drawing as SVG in mm, for A4 and Letter, or for A3 if needed.
///
/// # Errors
/// [`ExportError::Paper`] if it fits neither.
pub fn drawing(geometry: &Geometry, plates: &Plates) -> Result<String, ExportError> {
    let on = |size: DVec2| Sheet::new(geometry, plates, size).drawn();
    on(SMALL).or_else(|| on(LARGE)).ok_or_else(|| ExportError::Paper { size_mm: Outline::of(plates).size().to_array() })
}

/// The rectangle to which both plates are sawn.
#[derive(Debug, Clone, Copy)]
struct Outline {
    low: DVec2,
    high: DVec2,
}

impl Outline {
    fn of(plates: &Plates) -> Self {
        let [low, high] = plates.bounds();
        Self { low: low - MARGIN, high: high + MARGIN }
    }

    fn size(self) -> DVec2 {
        self.high - self.low
    }
}

/// One of the two plates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Side {
    Front,
    Back,
}

impl Side {
    const BOTH: [Self; 2] = [Self::Front, Self::Back];

    fn word(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Back => "back",
        }
    }

    /// Returns the first letter of its holes' names.
    fn letter(self) -> char {
        match self {
            Self::Front => 'F',
            Self::Back => 'B',
        }
    }

    fn of(self, plates: &Plates) -> &Plate {
        &plates.plates[usize::from(self == Self::Back)]
    }

    /// Returns a position on its outer face: to the right and up from the lower left corner,
    /// facing it.
    fn on_face(self, at: DVec2, outline: Outline) -> DVec2 {
        let from = at - outline.low;
        match self {
            Self::Front => from,
            Self::Back => DVec2::new(outline.size().x - from.x, from.y),
        }
    }
}

/// A sheet that is drawn from top to bottom.
struct Sheet<'a> {
    geometry: &'a Geometry,
    plates: &'a Plates,
    outline: Outline,
    size: DVec2,
    /// Lower end of the finished part, mm.
    y: f64,
    pen: Pen,
}

impl<'a> Sheet<'a> {
    fn new(geometry: &'a Geometry, plates: &'a Plates, size: DVec2) -> Self {
        Self { geometry, plates, outline: Outline::of(plates), size, y: RIM, pen: Pen::default() }
    }

    /// Returns the document; `None` if the sheet is too small.
    fn drawn(mut self) -> Option<String> {
        self.title();
        self.both_plates()?;
        self.plans();
        self.tables();
        self.steps();
        self.rule();
        if self.y > self.size.y - RIM {
            return None;
        }
        Some(self.pen.svg(self.size))
    }

    fn title(&mut self) {
        let name = self.geometry.name();
        let name = if name.is_empty() { "Phantom of wires" } else { name };
        self.y += 4.0;
        self.pen.text(DVec2::new(RIM, self.y), 5.0, "start", &format!("font-weight=\"bold\">{}", escaped(name)));
        let DVec2 { x, y } = self.outline.size();
        let thick = self.plates.thickness_mm().map_or(String::new(), |mm| format!(", {} thick", number(mm)));
        self.y += 5.0;
        self.write_line(RIM, &format!(
            "Two plates {} × {} mm{thick}, inner faces {} mm apart; {} wires. All in mm, drawn 1:1: print at 100 %, not \"fit to page\".",
            number(x),
            number(y),
            number(self.plates.apart_mm),
            self.geometry.wires().len()
        ));
        self.y += 5.0;
    }

    /// Draws both plates' outer faces, side by side or, if they do not fit, one below the other.
    fn both_plates(&mut self) -> Option<()> {
        let size = self.outline.size();
        let room = self.size.x - 2.0 * RIM;
        let width = size.x + DIMENSION;
        if width > room {
            return None;
        }
        let beside = 2.0 * width + 4.0 <= room;
        let top = self.y + 7.0;
        for (number, side) in Side::BOTH.into_iter().enumerate() {
            let step = number as f64;
            let at = if beside {
                DVec2::new(RIM + DIMENSION + step * (room - width), top)
            } else {
                DVec2::new(RIM + DIMENSION, top + step * (size.y + DIMENSION + 9.0))
            };
            self.plate(side, at);
            self.y = at.y + size.y + DIMENSION;
        }
        self.y += 3.0;
        Some(())
    }

    /// Draws a plate's outer face; `corner` is its upper left corner.
    fn plate(&mut self, side: Side, corner: DVec2) {
        let (plates, outline, size) = (self.plates, self.outline, self.outline.size());
        let to_page = |at: DVec2| {
            let from = side.on_face(at, outline);
            corner + DVec2::new(from.x, size.y - from.y)
        };
        let seen = if side == Side::Front { "the front" } else { "behind" };
        self.pen.text(
            corner - DVec2::new(0.0, 2.2),
            3.1,
            "start",
            &format!("font-weight=\"bold\">{} PLATE: outer face, seen from {seen}", side.word().to_uppercase()),
        );
        self.lattice(corner, to_page);
        self.pen.put(format_args!(
            "<rect x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" fill=\"none\" stroke=\"#000\" stroke-width=\".35\"/>\n",
            mm(corner.x),
            mm(corner.y),
            mm(size.x),
            mm(size.y)
        ));
        for inset in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]].map(DVec2::from_array) {
            self.pen.ring(corner + inset * (size - 2.0 * ROD_INSET) + ROD_INSET, ROD_HOLE, 0.2, 3.2);
        }
        // Courses of the oblique wires.
        for (wire, holes) in self.geometry.wires().iter().zip(&plates.wires) {
            let [front, back] = [0, 1].map(|plate| plates.plates[plate].holes[holes[plate]]);
            if front.distance(back) > 0.5 {
                let [from, to] = [to_page(front), to_page(back)];
                self.pen.line(from, to, 0.12, "stroke-dasharray=\"1.2 .8\"");
                self.pen.text(
                    0.5 * (from + to) - DVec2::new(0.0, 0.7),
                    2.0,
                    "middle",
                    &format!(">{}", escaped(&wire.name)),
                );
            }
        }
        let plate = side.of(plates);
        for (number, hole) in plate.holes.iter().enumerate() {
            let at = to_page(*hole);
            self.pen.ring(at, WIRE_HOLE, 0.15, 1.4);
            let name = format!("font-weight=\"bold\">{}{}", side.letter(), number + 1);
            self.pen.text(at + DVec2::new(0.0, 3.4), 2.3, "middle", &name);
        }
        for divot in &plate.divots {
            let at = to_page(divot.at);
            self.pen.ring(at, 2.4, 0.3, 1.8);
            let name = &self.geometry.landmarks()[divot.landmark].name;
            self.pen.text(at + DVec2::new(2.2, 0.9), 2.6, "start", &format!(">{}", escaped(name)));
        }
        let middle = corner + DVec2::new(0.5 * size.x, 4.2);
        self.pen.text(middle, 2.3, "middle", ">▲ up, towards the probe");
        let (word, place) = match side {
            Side::Front => ("probe's marked side ▶", "end"),
            Side::Back => ("◀ probe's marked side", "start"),
        };
        let x = if side == Side::Front { size.x - 10.0 } else { 10.0 };
        self.pen.text(corner + DVec2::new(x, size.y - 3.4), 2.3, place, &format!(">{word}"));
        self.dimension(corner + DVec2::new(0.0, size.y + 4.0), corner + DVec2::new(size.x, size.y + 4.0));
        self.dimension(corner + DVec2::new(-4.0, size.y), corner + DVec2::new(-4.0, 0.0));
    }

    /// Draws lines 5 mm apart, through the phantom's own origin.
    fn lattice(&mut self, corner: DVec2, to_page: impl Fn(DVec2) -> DVec2) {
        const STEP: f64 = 5.0;
        let Outline { low, high } = self.outline;
        let size = self.outline.size();
        let multiples = |low: f64, high: f64| {
            std::iter::successors(Some((low / STEP).ceil() * STEP), |at| Some(at + STEP))
                .take_while(move |at| *at < high)
        };
        let mut path = String::new();
        for x in multiples(low.x, high.x) {
            let _ = write!(path, "M{} {}v{}", mm(to_page(DVec2::new(x, 0.0)).x), mm(corner.y), mm(size.y));
        }
        for y in multiples(low.y, high.y) {
            let _ = write!(path, "M{} {}h{}", mm(corner.x), mm(to_page(DVec2::new(0.0, y)).y), mm(size.x));
        }
        self.pen.put(format_args!("<path d=\"{path}\" stroke=\"#bcd\" stroke-width=\".08\"/>\n"));
    }

    /// Draws each pattern viewed from above, the front plate below.
    fn plans(&mut self) {
        let patterns: Vec<_> = self.geometry.patterns().collect();
        let (size, low, plates) = (self.outline.size(), self.outline.low, self.plates);
        let apart = plates.apart_mm;
        let abreast = patterns.len().clamp(1, ABREAST);
        let gap = 6.0;
        let cell = (self.size.x - 2.0 * RIM - gap * (abreast - 1) as f64) / abreast as f64;
        let scale = (cell / size.x).min(48.0 / apart).min(1.0);
        self.y += 1.0;
        self.heading("From above, pattern by pattern from the top: which hole leads to which");
        for row in patterns.chunks(abreast) {
            let top = self.y + 3.5;
            for (column, pattern) in row.iter().enumerate() {
                let left = RIM + column as f64 * (cell + gap) + 0.5 * (cell - scale * size.x);
                let x = |at: DVec2| left + scale * (at.x - low.x);
                let (back, front) = (top, top + scale * apart);
                for y in [back, front] {
                    self.pen.line(DVec2::new(left, y), DVec2::new(left + scale * size.x, y), 0.7, "");
                }
                for wire in pattern.clone() {
                    let holes = self.plates.wires[wire];
                    let [from, to] =
                        [(0, front), (1, back)].map(|(n, y)| DVec2::new(x(plates.plates[n].holes[holes[n]]), y));
                    self.pen.line(from, to, 0.25, "");
                    self.pen.text(from + DVec2::new(0.0, 3.0), 2.0, "middle", &format!(">F{}", holes[0] + 1));
                    self.pen.text(to - DVec2::new(0.0, 1.2), 2.0, "middle", &format!(">B{}", holes[1] + 1));
                    let word = format!(
                        "stroke=\"#fff\" stroke-width=\"1\" paint-order=\"stroke\" font-weight=\"bold\">{}",
                        escaped(&self.geometry.wires()[wire].name)
                    );
                    self.pen.text(from.lerp(to, 0.36) + DVec2::new(0.0, 0.8), 2.5, "middle", &word);
                }
                if column == 0 {
                    self.pen.text(DVec2::new(left + 0.8, back + 3.0), 2.0, "start", ">back plate");
                    self.pen.text(DVec2::new(left + 0.8, front - 1.2), 2.0, "start", ">front plate");
                    let right = left + scale * size.x - 3.0;
                    self.pen.dimension_of(DVec2::new(right, front), DVec2::new(right, back), apart);
                }
            }
            self.y = top + scale * apart + 5.0;
        }
        self.y += 1.0;
    }

    /// Draws the tables of wires and landmarks.
    fn tables(&mut self) {
        let top = self.y;
        let middle = RIM + 0.52 * (self.size.x - 2.0 * RIM);
        self.heading("Wires: holes from the left and lower edge as drawn");
        let ends = [RIM, RIM + 20.0, RIM + 36.0, RIM + 48.0, RIM + 64.0, RIM + 88.0];
        let head = ["wire", "front", "right, up", "back", "right, up", "free length"];
        let rows: Vec<Vec<String>> = self
            .geometry
            .wires()
            .iter()
            .zip(&self.plates.wires)
            .map(|(wire, holes)| self.wire_row(wire, *holes))
            .collect();
        self.table(&ends, &head, &rows);
        let below = self.y;
        if !self.geometry.landmarks().is_empty() {
            self.y = top;
            self.pen.text(
                DVec2::new(middle, self.y + 3.0),
                3.0,
                "start",
                "font-weight=\"bold\">Landmarks ⊕ for the stylus",
            );
            self.y += 4.5;
            let ends = [0.0, 11.0, 31.0, 87.0].map(|x| middle + x);
            let head = ["", "plate", "right, up", "x, y, z in the file"];
            let rows: Vec<Vec<String>> =
                (0..self.geometry.landmarks().len()).map(|landmark| self.landmark_row(landmark)).collect();
            self.table(&[ends[0], ends[1], ends[2] + 8.0, ends[3]], &head, &rows);
        }
        self.y = self.y.max(below) + 1.5;
    }

    fn wire_row(&self, wire: &Wire, holes: [usize; 2]) -> Vec<String> {
        let mut row = vec![wire.name.clone()];
        for (side, hole) in Side::BOTH.into_iter().zip(holes) {
            let at = side.on_face(side.of(self.plates).holes[hole], self.outline);
            row.extend([format!("{}{}", side.letter(), hole + 1), both(at)]);
        }
        row.push(format!("{:.1}", wire.length_mm()));
        row
    }

    fn landmark_row(&self, landmark: usize) -> Vec<String> {
        let about = &self.geometry.landmarks()[landmark];
        let on = |side: Side| {
            side.of(self.plates).divots.iter().find(|divot| divot.landmark == landmark).map(|divot| (side, divot))
        };
        let (plate, at) = match Side::BOTH.into_iter().find_map(on) {
            Some((side, divot)) => (side.word().to_owned(), both(side.on_face(divot.at, self.outline))),
            None => ("neither".to_owned(), String::new()),
        };
        vec![about.name.clone(), plate, at, about.position_mm.to_array().map(number).join(", ")]
    }

    fn steps(&mut self) {
        self.heading("To build it");
        let thick = self.plates.thickness_mm().map_or(String::new(), |mm| format!(", {} mm thick", number(mm)));
        let DVec2 { x, y } = self.outline.size();
        let steps = [
            "Print at 100 % and measure the rule below. Cut both faces out.".to_owned(),
            format!("Saw two plates of acrylic, {} × {} mm{thick}. Stick the drawings on: these are the OUTER faces.", number(x), number(y)),
            format!("Drill the numbered holes {WIRE_HOLE} mm and those in the corners {ROD_HOLE} mm, square to the plate."),
            "Punch the landmarks ⊕ just so deep that the stylus' tip rests in them.".to_owned(),
            format!("Join the plates with four M4 rods and nuts, both ▲ up, inner faces {} mm apart: measure at all four corners.", number(self.plates.apart_mm)),
            "Thread nylon line of 0.3 mm as the table says (F1 to B1, …), straight and taut, and glue it into its holes.".to_owned(),
            "Fix the reference sensor to it. What came out otherwise than drawn is to be changed in the phantom's file.".to_owned(),
            "Touch the landmarks (sonoweave calibrate landmarks), then scan the wires from above (sonoweave calibrate probe).".to_owned(),
        ];
        for (number, step) in steps.iter().enumerate() {
            self.y += 4.0;
            self.write_line(RIM, &format!("{}.", number + 1));
            self.write_line(RIM + 5.0, step);
        }
        self.y += 3.0;
    }

    /// Draws a scale of 100 mm to check the print size.
    fn rule(&mut self) {
        let left = DVec2::new(RIM, self.y + 5.0);
        self.pen.line(left, left + DVec2::new(100.0, 0.0), 0.25, "");
        for tick in 0..=20_u32 {
            let at = left + DVec2::new(5.0 * f64::from(tick), 0.0);
            let length = if tick % 2 == 0 { 3.0 } else { 1.8 };
            self.pen.line(at, at - DVec2::new(0.0, length), 0.2, "");
        }
        self.pen.text(left + DVec2::new(0.0, 3.2), 2.4, "start", ">0");
        self.pen.text(left + DVec2::new(100.0, 3.2), 2.4, "end", ">100 mm");
        self.pen.text(
            left + DVec2::new(104.0, 0.0),
            2.8,
            "start",
            ">These are 100 mm if it was printed as large as drawn.",
        );
        self.y = left.y + 4.0;
    }

    fn heading(&mut self, text: &str) {
        self.y += 3.0;
        self.pen.text(DVec2::new(RIM, self.y), 3.0, "start", &format!("font-weight=\"bold\">{}", escaped(text)));
        self.y += 1.5;
    }

    /// Draws a table. `at` gives the left edge of a column (the first, and of four the second),
    /// or its right edge.
    fn table(&mut self, at: &[f64], head: &[&str], rows: &[Vec<String>]) {
        let head: Vec<String> = head.iter().map(|cell| (*cell).to_owned()).collect();
        self.cells(self.y + 3.0, at, &head);
        for (number, row) in rows.iter().enumerate() {
            self.cells(self.y + 3.4 + LINE * (number + 1) as f64, at, row);
        }
        let (left, right) = (at[0], at[at.len() - 1]);
        self.pen.line(DVec2::new(left, self.y + 4.2), DVec2::new(right, self.y + 4.2), 0.15, "");
        self.y += 5.0 + LINE * rows.len() as f64;
    }

    fn cells(&mut self, y: f64, at: &[f64], cells: &[String]) {
        for (column, (x, cell)) in at.iter().zip(cells).enumerate() {
            let place = if column == 0 || (column == 1 && at.len() == 4) { "start" } else { "end" };
            self.pen.text(DVec2::new(*x, y), 2.7, place, &format!(">{}", escaped(cell)));
        }
    }

    /// Draws the distance between two places, measured on the drawing.
    fn dimension(&mut self, from: DVec2, to: DVec2) {
        self.pen.dimension_of(from, to, from.distance(to));
    }

    /// Writes a line of text.
    fn write_line(&mut self, x: f64, text: &str) {
        self.pen.text(DVec2::new(x, self.y), 2.8, "start", &format!(">{}", escaped(text)));
    }
}

fn both(at: DVec2) -> String {
    at.to_array().map(number).join(", ")
}
