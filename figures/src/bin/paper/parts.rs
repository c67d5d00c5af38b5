//! C17: the world divided into parts with one worker each; their pictures are composited in view
//! order.

use std::error::Error;

use render::partition::{Compositor, Part};

use crate::doll::Doll;
use crate::report::Report;

/// Numbers of parts.
const PARTS: [u32; 4] = [1, 2, 3, 8];
/// Bytes of a pixel that a part composites by itself: colour and transmittance.
const PIXEL_BYTES: u64 = 8;

/// Data exchanged while a scan is rendered in so many parts.
struct Exchanged {
    parts: u32,
    /// From the parts to the compositor, bytes of all slices.
    bytes: u64,
    /// Samples of the part that interpolated most, and of all.
    samples: [u64; 2],
}

/// Renders the scan with every number of parts.
pub(crate) fn composited(report: &mut Report, doll: &Doll) -> Result<(), Box<dyn Error>> {
    let (exact, _) = doll.at_once(&doll.view_settings)?;
    let mut found = Vec::new();
    for parts in PARTS {
        let mut reconstructor = doll.reconstructor(1)?;
        let mut workers = (0..parts)
            .map(|part| Part::new(&doll.view_settings, &doll.region, part, parts))
            .collect::<Result<Vec<_>, _>>()?;
        let mut compositor = Compositor::new(&doll.view_settings, &doll.region)?;
        let mut bytes = 0;
        let mut samples = vec![0; workers.len()];
        for slice in &doll.slices {
            let touched = reconstructor.insert(slice)?;
            for (worker, samples) in workers.iter_mut().zip(&mut samples) {
                let message = worker.update(reconstructor.volume(), &touched.bricks);
                compositor.receive(&message.bytes)?;
                bytes += message.bytes.len() as u64;
                *samples += message.work.samples;
            }
        }
        report.check(compositor.picture() == exact, format!("C17: {parts} parts make other bits than one renderer"));
        let most = samples.iter().copied().max().unwrap_or(0);
        found.push(Exchanged { parts, bytes, samples: [most, samples.iter().sum()] });
    }
    let slices = doll.slices.len() as u64;
    let [width, height] = doll.view_settings.size.map(u64::from);
    let image = width * height * PIXEL_BYTES;
    let each: Vec<String> = found
        .iter()
        .map(|of| {
            let share = 100.0 * of.samples[0] as f64 / of.samples[1].max(1) as f64;
            format!(
                "{} parts {:.0} kB (busiest {share:.0} % of the samples)",
                of.parts,
                of.bytes as f64 / slices as f64 / 1e3
            )
        })
        .collect();
    for of in &found {
        // The size of whole pictures of all parts, for every slice.
        let whole = u64::from(of.parts) * image * slices;
        report.check(of.bytes < whole, format!("C17: {} bytes where whole pictures are {whole}", of.bytes));
    }
    report.checked_claim(
        ["C17", "z-slabs for regional processors, composited in view order; only 2D images are exchanged", "communication “not expected to be very costly”; not measured"],
        format!(
            "1, 2, 3 and 8 parts make the same bits as one; sent for a slice: {}; whole pictures would be {:.0} kB a part",
            each.join(", "),
            image as f64 / 1e3
        ),
        "confirmed, bit for bit",
    );
    Ok(())
}
