//! A probe's calibration as a page to look at.

use glam::DVec2;

use super::recording::Shown;
use super::report::{Report, Told, ToldPicture, YOU};
use crate::export::page::Page;
use crate::export::page::chart::Bars;
use crate::export::page::plate::{Ink, Plate};

/// Residuals are drawn so many times as long as they are.
const LONGER: f64 = 10.0;

impl Report {
    /// Pictures worth looking at: the one in the middle of all by its error, and the worst.
    pub(super) fn telling(&self) -> Vec<usize> {
        let mut by_error: Vec<(f64, usize)> =
            self.wire_error_mm.per_frame.iter().copied().zip(self.wire_error_mm.frame.iter().copied()).collect();
        by_error.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut frames: Vec<usize> = [by_error.len() / 2, by_error.len().saturating_sub(1)]
            .into_iter()
            .filter_map(|place| by_error.get(place).map(|(_, frame)| *frame))
            .collect();
        frames.dedup();
        frames
    }

    /// The page; `shown` are the pictures of [`Self::telling`].
    pub(super) fn page(&self, shown: &[Shown], limit_mm: f64) -> String {
        let mut page = Page::new(&format!("Calibration of a probe: {}", self.input.name()));
        self.verdict(&mut page, limit_mm);
        self.numbers(&mut page);
        page.part("What was seen");
        let figures: Vec<_> = shown.iter().filter_map(|shown| self.seen(shown)).collect();
        page.figures(&figures);
        page.note("Green rings: dots that were used, by their wires. Dashed red: dots that the others contradict. Orange crosses: where the calibration has the wires.");
        page.part("How far dots lie from where the calibration has them");
        page.figures(&[
            (self.vectors(), format!("Every dot that was used and how far it is off, drawn {LONGER:.0} times as long. Vectors that point alike somewhere are an error of the calibration; those that point anywhere are noise.")),
            (self.predicted(), "Predicted error of where a point lies, one standard deviation, by the covariance of what was fitted: small where dots are, larger away from them.".into()),
        ]);
        self.bars(&mut page, limit_mm);
        self.wires_table(&mut page);
        self.particulars(&mut page);
        page.html()
    }

    fn verdict(&self, page: &mut Page, limit_mm: f64) {
        let [centre, corner] = self.predicted_ends_mm;
        let held = self.validation_error_mm.as_ref().map(|told| {
            let of = if self.validation_is_split { "the last third, by a calibration from the others" } else { "a second recording" };
            format!("{:.2} mm mean error of the middle wires on pictures that had no part in it ({of}; limit {limit_mm} mm)", told.mean)
        });
        let held = held.unwrap_or_else(|| "nothing was held out".into());
        let good = self.validation_error_mm.as_ref().is_some_and(|told| told.mean <= limit_mm);
        let word = if good { "Accepted" } else { "Not proven" };
        page.verdict(good, &format!("{word}: {held}. A point is known to {centre:.2} mm in the middle of the picture and {corner:.2} mm in its worst corner (one standard deviation)."));
        let frames = &self.frames;
        let reasons: Vec<String> = frames.reasons.iter().map(|(reason, count)| format!("{count} {reason}")).collect();
        let reasons = if reasons.is_empty() { String::new() } else { format!("; not used: {}", reasons.join(", ")) };
        page.say(&format!(
            "{} of {} pictures were used{reasons}. A pixel is {:.5} × {:.5} mm.",
            frames.used, frames.total, self.pixel_mm[0], self.pixel_mm[1]
        ));
        if self.lag_sd_s > 0.0 {
            let side = if self.lag_s > 0.0 { "later" } else { "earlier" };
            page.say(&format!(
                "The tracker's poses come {:.1} ± {:.1} ms {side} than the pictures.",
                1e3 * self.lag_s.abs(),
                1e3 * self.lag_sd_s
            ));
        }
        if let Some(again) = &self.reproducibility_mm {
            page.say(&format!(
                "Calibrated {} times with a part of the pictures left out, the middle of the picture moves by {:.2} mm at most, its corners by {:.2} mm.",
                again.subsets, again.centre, again.corner
            ));
        }
        if let Some(next) = &self.next_view {
            let seen = if next.helps { format!(" ({YOU})") } else { String::new() };
            page.say(&format!("Next view: {}{seen}.", next.words));
        }
    }

    fn numbers(&self, page: &mut Page) {
        page.part("Errors, mm");
        let row = |what: &str, told: &Told| {
            let numbers = [told.mean, told.sd, told.rms, told.max, told.mean_of_95].map(|x| format!("{x:.3}"));
            [what.to_owned()].into_iter().chain(numbers).chain([told.count.to_string()]).collect::<Vec<_>>()
        };
        let mut rows =
            vec![row("middle wires (PLUS's definition)", &self.error_mm), row("all wires", &self.wire_error_mm)];
        let held = [
            ("middle wires, pictures held out", &self.validation_error_mm),
            ("all wires, pictures held out", &self.validation_wire_error_mm),
            ("middle wires, held out, no lag, registration as given", &self.validation_error_as_given_mm),
        ];
        rows.extend(held.into_iter().filter_map(|(what, told)| told.as_ref().map(|told| row(what, told))));
        page.table(&["", "mean", "sd", "rms", "largest", "best 95 %", "of"], &rows);
    }

    /// One picture and its dots.
    fn seen(&self, shown: &Shown) -> Option<(String, String)> {
        let picture = self.pictures.iter().find(|picture| picture.frame == shown.frame)?;
        let mut plate = Plate::new(self.image_size_px);
        plate.picture(&shown.grey);
        for dot in &picture.dots {
            let ink = if dot.used { Ink::Used } else { Ink::LeftOut };
            plate.ring(DVec2::from_array(dot.seen_px), ink, &dot.wire);
            plate.cross(DVec2::from_array(dot.expected_px), Ink::Expected);
        }
        let error = mean_off(picture);
        let svg = plate.svg(&format!("picture {} of the recording with its dots", shown.frame));
        Some((svg, format!("Picture {}: {error:.2} mm on average.", shown.frame)))
    }

    fn vectors(&self) -> String {
        let mut plate = Plate::new(self.image_size_px);
        let [u, v] = self.image_size_px.map(|n| f64::from(n) - 1.0);
        plate.outline(&[DVec2::ZERO, DVec2::new(u, 0.0), DVec2::new(u, v), DVec2::new(0.0, v)]);
        for dot in self.pictures.iter().flat_map(|picture| &picture.dots).filter(|dot| dot.used) {
            let [seen, expected] = [dot.seen_px, dot.expected_px].map(DVec2::from_array);
            plate.vector(expected, (seen - expected) * LONGER, Ink::Used);
        }
        plate.svg("residuals of all dots over the image plane")
    }

    fn predicted(&self) -> String {
        let down = self.predicted_error_mm.len();
        let across = self.predicted_error_mm.first().map_or(0, Vec::len);
        let mut plate = Plate::new(self.image_size_px);
        let values: Vec<f64> = self.predicted_error_mm.iter().flatten().copied().collect();
        plate.map([across, down], &values, "mm");
        for dot in self.pictures.iter().flat_map(|picture| &picture.dots).filter(|dot| dot.used) {
            plate.speck(DVec2::from_array(dot.seen_px));
        }
        plate.svg("predicted error over the image plane, and where dots were")
    }

    fn bars(&self, page: &mut Page, limit_mm: f64) {
        page.part("Picture by picture");
        let told = |told: &Told, about: &str| {
            let limit = (told.max * 4.0 > limit_mm).then_some((limit_mm, "limit of the mean"));
            Bars { values: &told.per_frame, unit: "mm", along: "pictures", limit }.svg(about)
        };
        page.figure(&told(&self.error_mm, "error of each picture"), "Mean error of each picture's middle wires.");
        if let Some(held) = self.validation_error_mm.as_ref().filter(|_| !self.validation_is_split) {
            page.figure(
                &told(held, "error of each picture that was held out"),
                "The same of the second recording, which had no part in the calibration.",
            );
        }
    }

    fn wires_table(&self, page: &mut Page) {
        page.part("Wire by wire");
        let rows: Vec<Vec<String>> = self
            .wires
            .iter()
            .map(|wire| {
                let [u, v] = wire.bias_px.map(|x| format!("{x:+.2}"));
                vec![
                    wire.wire.clone(),
                    wire.dots.to_string(),
                    format!("{:.3}", wire.mean_mm),
                    format!("{:.3}", wire.rms_mm),
                    format!("{:.3}", wire.max_mm),
                    u,
                    v,
                ]
            })
            .collect();
        page.table(&["wire", "dots", "mean, mm", "rms", "largest", "bias along u, px", "along v"], &rows);
    }

    fn particulars(&self, page: &mut Page) {
        page.part("Particulars");
        let scatter = &self.scatter;
        page.say(&format!(
            "Noise: sensors {:.3} mm and {:.3}°, dots {:.2} and {:.2} px along u and v. The phantom fits best {:.2} mm and {:.2}° from where it was registered. Condition {:.1}.",
            scatter.position_mm, scatter.turn_deg, scatter.dot_px[0], scatter.dot_px[1], self.registration_change_mm, self.registration_change_deg, self.condition
        ));
        let matrix = |rows: &[f64; 16]| {
            rows.chunks_exact(4)
                .map(|row| row.iter().map(|x| format!("{x:.6}")).collect())
                .collect::<Vec<Vec<String>>>()
        };
        page.say("ImageToProbe, pixels of the picture (right, down) to mm:");
        page.table(&["", "", "", ""], &matrix(&self.image_to_probe));
        page.say("PhantomToReference, as it fits best:");
        page.table(&["", "", "", ""], &matrix(&self.phantom_to_reference));
        let inputs = [Some(&self.input), Some(&self.phantom), self.validation.as_ref()];
        let rows: Vec<Vec<String>> = inputs.into_iter().flatten().map(|input| vec![input.name()]).collect();
        page.table(&["made from"], &rows);
        page.note(concat!("sonoweave ", env!("CARGO_PKG_VERSION")));
    }
}

fn mean_off(picture: &ToldPicture) -> f64 {
    let used = || picture.dots.iter().filter(|dot| dot.used);
    used().map(|dot| dot.off_mm).sum::<f64>() / used().count().max(1) as f64
}
