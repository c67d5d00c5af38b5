//! One region of a planned sweep.

use std::sync::Arc;

use reconstruct::{Reconstructor, Settings};
use sonoweave_core::slice::Slice;
use sonoweave_core::{NO_DEADLINE, Next};
use sync::ingest::{Ingest, Sample};
use volume::brick::BrickBox;

use super::plan::{PlannedSlice, SweepPlan};
use crate::PipelineError;

impl SweepPlan {
    /// Reconstructs one region. Reads only the frames whose slices may change a brick of it, one
    /// at a time. Each brick has the bits of a reconstruction of the whole.
    ///
    /// # Errors
    /// [`PipelineError`] if the recording cannot be read, is not the planned one, or memory does
    /// not suffice.
    pub fn reconstruct(&self, region: &BrickBox) -> Result<Reconstructor, PipelineError> {
        let settings = Settings { region: Some(*region), ..self.settings.clone() };
        let mut reconstructor = Reconstructor::new(settings, self.mask.clone())?;
        let meets = |slice: &&PlannedSlice| !slice.entered.bricks.within(region).is_empty();
        let only: Arc<[u64]> = self.slices.iter().filter(meets).map(|slice| slice.item).collect();
        let mut slices = self.slices.iter().filter(meets);
        let mut device = self.input.open_only(only)?;
        let mut ingest = Ingest::new();
        device.start()?;
        loop {
            let reading = match device.next(NO_DEADLINE)? {
                Next::Reading(reading) => reading,
                Next::Pending => continue,
                Next::End => break,
            };
            let item = reading.stamp().item;
            let image = match ingest.take(reading) {
                Sample::Picture(picture) => picture.image,
                Sample::Transform(_) | Sample::Unused(_) => continue,
                Sample::Refused(_) => return Err(PipelineError::OtherRecording { item }),
            };
            let Some(PlannedSlice { time_ns, world_from_image, entered, .. }) =
                slices.next().filter(|slice| slice.item == item)
            else {
                return Err(PipelineError::OtherRecording { item });
            };
            let slice = Slice { image, time_ns: *time_ns, world_from_image: *world_from_image };
            let inserted = reconstructor.insert_decided(&slice, &entered.decision);
            inserted.map_err(|source| PipelineError::Planned { item, source })?;
        }
        device.stop()?;
        match slices.next() {
            Some(missing) => Err(PipelineError::OtherRecording { item: missing.item }),
            None => Ok(reconstructor),
        }
    }
}
