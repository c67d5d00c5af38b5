//! Session: devices, a recorded session or a recorded sequence to a volume and its picture, one
//! thread per stage.
//!
//! ```text
//! capture (one per device) ─▶ sequencer ─▶ pairing ─▶ insertion ══ volume ══ picture
//!                                 └─────────┬─┴───────────┘
//!                                       recording ─▶ (replay: the same from pairing on)
//! ```
//!
//! | between | holds | when it is full |
//! |---|---|---|
//! | capture → pairing | 4096 readings; frames of all stages together at most 256 MB | the reading is dropped and counted; it is in the recording |
//! | pairing → insertion | 64 slices | the new slice is dropped and counted: the waiting ones are older, and their content would be lost for good |
//! | insertion → picture | the changed bricks | never: a picture shows all slices present when it is begun |
//! | all → recording | 4096 messages, of which 3072 frames, and 64 MB in the writer | frames are dropped first, then everything; counted, also in the recording |
//!
//! Pairing depends only on the session events, their order and their times. The recording has
//! these, and the decisions. So a replay repeats every decision, compares it, and reproduces the
//! volume bit by bit, at any speed and with any number of threads.
//!
//! - `settings`, `device`: a session's inputs and its results; the roles of its devices.
//! - `run`, `spawn`: the wiring, the only place where threads of a session are started.
//! - `event`, `sequencer`, `capture_thread`: session events, their order, and a device's thread.
//! - `replay`, `sequence`: a recorded session as a source of the same events; a recorded sequence
//!   as a source of slices. `sequence_input`, `posed_frames`: its file, or its frames in memory.
//! - `growing`: a volume that grows by recordings and by single frames. `paired`: a recorded
//!   session's poses without a volume.
//! - `pairing_thread`, `stuck`, `zones`: readings to posed slices; repeated frames; frames taken
//!   where the tracker's field is distorted.
//! - `insertion_thread`, `shared_volume`, `changes`: insertion of slices, the lock on the volume,
//!   and the changes pending for its readers.
//! - `render_thread`, `pacing`, `reach`: the picture, its highest rate, and the box that it shows.
//! - `plane_viewer`, `brick_subset`: planes, and the copied bricks that they sample.
//! - `plane_errors`: their standard errors.
//! - `brick_viewer`: bricks for viewers that draw the volume themselves.
//! - `reader`: export of the volume while it grows.
//! - `ended`: an ended session whose volume is still viewed.
//! - `common`: state shared by all stages.
//! - `decision`, `digest`, `recorded_decisions`: recorded decisions about frames, the digest of the
//!   result, and their comparison in a replay.
//! - `recorder`: the session's file. `unsynced`: its data that a power cut would take.
//! - `walk`, `record_only`: a recorded session's samples by themselves, and a session that only
//!   records.
//! - `priority`: thread priorities.
//! - `status`, `timing`, `turns`, `losses`: the status of the stages. `page_faults`: their waits
//!   for fresh memory.

mod brick_subset;
mod brick_viewer;
mod capture_thread;
mod changes;
mod common;
mod corrected;
mod decision;
mod device;
mod digest;
mod ended;
mod event;
mod every;
mod growing;
mod insertion_thread;
mod losses;
mod memory;
mod pacing;
mod page_faults;
mod paired;
mod pairing_thread;
mod plane_errors;
mod plane_viewer;
mod posed_frames;
mod priority;
mod reach;
mod reader;
mod record_only;
mod recorded_decisions;
mod recorder;
mod render_thread;
mod replay;
mod run;
mod sequence;
mod sequence_input;
mod sequencer;
mod settings;
mod shared_volume;
mod spawn;
mod status;
mod stuck;
mod timing;
mod turns;
mod unsynced;
mod walk;
mod zones;

pub use brick_subset::BrickCopy;
pub use brick_viewer::BrickViewer;
pub use corrected::CorrectedFrames;
pub use device::{DeviceRole, SessionDevice};
pub use digest::ResultDigest;
pub use ended::EndedSession;
pub use every::Every;
pub use growing::{GrowingVolume, Inserted};
pub use memory::MemoryByOwner;
pub use page_faults::PageFaults;
pub use paired::{Paired, PairedFrame};
pub use plane_errors::Readout;
pub use plane_viewer::{Extent, PlaneImage, PlaneRequest, PlaneViewer, PlaneWork};
pub use posed_frames::PosedFrames;
pub use priority::{SchedulingGrant, SchedulingPolicy};
pub use reader::{NoVolume, Reader, Snapshot, VolumeRequest};
pub use record_only::{RecordEvent, record_only};
pub use recorded_decisions::{Differences, RecordedDecisions};
pub use recorder::{Record, Recording, Unwritten};
pub use render_thread::{Drawn, First, ViewClient};
pub use replay::Recorded;
pub use run::run;
pub use sequence::Sequence;
pub use sequence_input::SequenceInput;
pub use settings::{Finished, Session, SessionInputs, Source};
pub use shared_volume::VolumeExtent;
pub use status::{ClockStatus, DeviceStatus, REPLAYED, SessionStatus, Written};
pub use timing::{Quantiles, Spread};
pub use turns::{StallDetector, Turns};
pub use walk::{Latencies, walk};
pub use zones::{InZones, Watch};
