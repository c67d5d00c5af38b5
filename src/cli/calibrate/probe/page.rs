//! Report page of a probe's calibration by an N-wire phantom.

use glam::DVec2;

use export::page::Page;
use export::page::plate::{Ink, Plate};

use super::page_parts;
use super::report::{PictureReport, Report, YOU};
use crate::app::calibrate::probe::StoredImage;

impl Report {
    /// Returns the images to show.
    pub(super) fn listed_frames(&self) -> Vec<usize> {
        page_parts::listed_frames(&self.wire_error_mm)
    }

    /// Makes the page; `images` are those of [`Self::listed_frames`].
    pub(super) fn page(&self, images: &[StoredImage]) -> String {
        let shared = &self.shared;
        let mut page = page_parts::begun(&self.inputs, shared, "mean error of the middle wires", self.lag_sd_s);
        if let Some(next) = &self.next_view {
            let seen = if next.helps { format!(" ({YOU})") } else { String::new() };
            page.paragraph(&format!("Next view: {}{seen}.", next.words));
        }
        page_parts::errors(
            &mut page,
            &[
                ("middle wires (PLUS's definition)", Some(&shared.error_mm)),
                ("all wires", Some(&self.wire_error_mm)),
                ("middle wires, validation frames", shared.validation_error_mm.as_ref()),
                ("all wires, validation frames", self.validation_wire_error_mm.as_ref()),
                (
                    "middle wires, validation frames, no lag, registration as given",
                    self.validation_error_as_given_mm.as_ref(),
                ),
            ],
        );
        page.part("Detections");
        let figures: Vec<_> = images.iter().filter_map(|image| self.seen(image)).collect();
        page.figures(&figures);
        page.note("Green rings: used dots, by their wires. Dashed red: dots that the others contradict. Orange crosses: the wires by the calibration.");
        let used = self.pictures.iter().flat_map(|picture| &picture.dots).filter(|dot| dot.used);
        let dots: Vec<[DVec2; 2]> = used.map(|dot| [dot.seen_px, dot.expected_px].map(DVec2::from_array)).collect();
        page_parts::over_the_picture(&mut page, shared, (&dots, "dots"));
        page_parts::frame_by_frame(&mut page, shared, "Mean error of each frame's middle wires.");
        self.wires_table(&mut page);
        self.particulars(&mut page);
        page.html()
    }

    /// Draws one image and its dots.
    fn seen(&self, image: &StoredImage) -> Option<(String, String)> {
        let picture = self.pictures.iter().find(|picture| picture.frame == image.frame)?;
        let mut plate = Plate::new(self.shared.image_size_px);
        plate.picture(&image.grey);
        for dot in &picture.dots {
            let ink = if dot.used { Ink::Used } else { Ink::LeftOut };
            plate.ring(DVec2::from_array(dot.seen_px), ink, &dot.wire);
            plate.cross(DVec2::from_array(dot.expected_px), Ink::Expected);
        }
        let error = mean_off(picture);
        let svg = plate.svg(&format!("frame {} of the recording with its dots", image.frame));
        Some((svg, format!("Frame {}: {error:.2} mm on average.", image.frame)))
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
        page.paragraph(&format!(
            "Noise: sensors {:.3} mm and {:.3}°, dots {:.2} and {:.2} px along u and v. The phantom fits best {:.2} mm and {:.2}° off its registration. Condition {:.1}.",
            scatter.position_mm, scatter.turn_deg, scatter.dot_px[0], scatter.dot_px[1], self.registration_change_mm, self.registration_change_deg, self.shared.condition
        ));
        page_parts::matrix(page, "ImageToProbe, pixels of the image (right, down) to mm:", &self.shared.image_to_probe);
        page_parts::matrix(page, "PhantomToReference, best fit:", &self.phantom_to_reference);
        page_parts::made_from(page, &self.inputs);
    }
}

fn mean_off(picture: &PictureReport) -> f64 {
    let used = || picture.dots.iter().filter(|dot| dot.used);
    used().map(|dot| dot.off_mm).sum::<f64>() / used().count().max(1) as f64
}
