//! The frames of a recorded session with their poses, as its replay pairs them, without a volume.

use std::collections::BTreeMap;
use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crossbeam_channel::bounded;

use sonoweave_core::clock::Monotonic;
use sonoweave_core::frames::{Image, Transform, World};
use sonoweave_core::slice::Slice;

use super::common::{Common, InFlight};
use super::device::DeviceRole;
use super::pairing_thread::SliceSink;
use super::priority::{Role, SchedulingPolicy};
use super::recorder::Recorder;
use super::replay::{self, FromRecording, Recorded};
use super::run::RECORDED;
use super::settings::Session;
use super::spawn::{joined, spawn};
use super::status::StatusCollector;
use crate::smoothing::SmoothingStatus;
use crate::{Observer, PipelineError};

/// Time, host ns, and pose of a frame; or the name of the reason why it has none.
pub type PairedFrame = Result<(i64, Transform<World, Image>), &'static str>;

/// The frames of a session with their poses.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Paired {
    /// The frames by their numbers.
    pub frames: BTreeMap<u64, PairedFrame>,
    /// Width and height of the last frame with a pose, pixels; `None` without any.
    pub size: Option<[u32; 2]>,
    /// Account of the smoothing, if poses are smoothed.
    pub smoothing: Option<SmoothingStatus>,
}

/// Collects the frames.
#[derive(Default)]
struct Frames(Mutex<Paired>);

impl Frames {
    fn lock(&self) -> MutexGuard<'_, Paired> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Observer for Frames {
    fn slice(&self, _world: &str, item: u64, slice: &Slice) {
        let mut paired = self.lock();
        paired.frames.insert(item, Ok((slice.time_ns, slice.world_from_image)));
        paired.size = Some([slice.image.width(), slice.image.height()]);
    }

    fn lost(&self, item: u64, reason: &'static str) {
        self.lock().frames.insert(item, Err(reason));
    }
}

impl Session {
    /// Returns the name of the world of these devices' slices, and the route to it.
    ///
    /// # Errors
    /// [`PipelineError`] if there is no route.
    pub fn world(&self, roles: &[DeviceRole]) -> Result<[String; 2], PipelineError> {
        let timed = self.timed(roles.iter())?;
        Ok([timed.route().world().to_owned(), timed.route().describe()])
    }

    /// Pairs the frames of a recorded session with poses, as its replay does.
    ///
    /// # Errors
    /// [`PipelineError`] if there is no route to the world, or the recording is damaged.
    pub fn pair(&self, recorded: Recorded) -> Result<Paired, PipelineError> {
        let Recorded { replay, decisions, roles } = recorded;
        let names: Vec<String> = roles.iter().map(|role| role.name.clone()).collect();
        let frames = Arc::new(Frames::default());
        let observers = [Arc::clone(&frames) as Arc<dyn Observer>];
        let status = StatusCollector::new(&roles, i64::MAX);
        let common = Common {
            clock: &Monotonic,
            status: &status,
            recorder: &Recorder::nowhere(),
            in_flight: &InFlight::new(u64::MAX),
            decisions: Some(&decisions),
            observers: &observers,
        };
        let stage = self.pairing_stage(roles, common, SliceSink::Nowhere)?;
        let (deliver, delivered) = bounded(RECORDED);
        let names = &names;
        std::thread::scope(|scope| {
            let reading = spawn(scope, "replay", (&SchedulingPolicy::default(), Role::Usual), move || {
                replay::run(replay, names, common, &AtomicBool::new(false), &deliver)
            });
            stage.run(&mut FromRecording(delivered));
            joined(reading)
        })?;
        let paired = std::mem::take(&mut *frames.lock());
        let smoothing = status.lock().smoothing.take();
        Ok(Paired { smoothing, ..paired })
    }
}
