//! Report page of a probe's calibration by a point, a stylus or a plane.

use glam::DVec2;

use export::page::Page;
use export::page::plate::{Ink, Plate};

use super::super::page_parts;
use super::report::{PictureReport, Report, Rests};
use crate::app::calibrate::probe::StoredImage;

impl Report {
    /// Returns the images to show.
    pub(super) fn listed_frames(&self) -> Vec<usize> {
        page_parts::listed_frames(&self.shared.error_mm)
    }

    /// Makes the page; `images` are those of [`Self::listed_frames`].
    pub(super) fn page(&self, images: &[StoredImage]) -> String {
        let shared = &self.shared;
        let mut page = page_parts::begun(&self.inputs, shared, "mean error", self.lag_se_s);
        page.paragraph(&format!("Next view: {}.", self.next_view));
        page_parts::errors(
            &mut page,
            &[
                ("distance from the target", Some(&shared.error_mm)),
                ("validation frames", shared.validation_error_mm.as_ref()),
            ],
        );
        page.part("Detections");
        let figures: Vec<_> = images.iter().filter_map(|image| self.seen(image)).collect();
        page.figures(&figures);
        let (what, seen) = match self.target {
            Rests::PointMm(_) => ("dots", "the detected point"),
            Rests::Plane { .. } => ("lines' points", "two points of the detected line"),
        };
        page.note(&format!("Green rings: {seen}. Orange crosses: its position by the calibration."));
        let used = || self.pictures.iter().filter(|picture| picture.used);
        let dots: Vec<[DVec2; 2]> = used().flat_map(PictureReport::pairs).collect();
        page_parts::over_the_picture(&mut page, shared, (&dots, what));
        page_parts::frame_by_frame(&mut page, shared, "Mean error of each frame.");
        self.particulars(&mut page);
        page.html()
    }

    /// Draws one image and the detections in it.
    fn seen(&self, image: &StoredImage) -> Option<(String, String)> {
        let picture = self.pictures.iter().find(|picture| picture.frame == image.frame)?;
        let mut plate = Plate::new(self.shared.image_size_px);
        plate.picture(&image.grey);
        for [seen, expected] in picture.pairs() {
            plate.ring(seen, if picture.used { Ink::Used } else { Ink::LeftOut }, "");
            plate.cross(expected, Ink::Expected);
        }
        let error = picture.off_mm.iter().sum::<f64>() / picture.off_mm.len().max(1) as f64;
        let svg = plate.svg(&format!("frame {} of the recording with its detections", image.frame));
        Some((svg, format!("Frame {}: {error:.2} mm off.", image.frame)))
    }

    fn particulars(&self, page: &mut Page) {
        page.part("Particulars");
        page.paragraph(&format!(
            "Noise: {}. Position: {}. Condition {:.1}.",
            self.scatter.words(),
            self.target.words(&self.frame),
            self.shared.condition
        ));
        page.paragraph("The least known combinations of numbers, each in its typical size:");
        let least: Vec<_> = self.least_known.iter().map(|(what, sd)| vec![what.clone(), format!("{sd:.4}")]).collect();
        page.table(&["combination", "standard deviation"], &least);
        page_parts::matrix(page, "ImageToProbe, pixels of the image (right, down) to mm:", &self.shared.image_to_probe);
        page_parts::made_from(page, &self.inputs);
    }
}

impl PictureReport {
    /// Returns pairs of seen and expected position.
    fn pairs(&self) -> impl Iterator<Item = [DVec2; 2]> {
        self.seen_px.iter().zip(&self.expected_px).map(|(a, b)| [*a, *b].map(DVec2::from_array))
    }
}
