//! Status messages for pages.

use std::collections::BTreeMap;
use std::time::Instant;

use serde_json::{Value, json};

use pipeline::session::{DeviceStatus, SessionStatus};
use sync::clock::State;

use super::encoded_frame::Kind;
use super::latest::About;
use super::served::Served;

/// Returns the facts that do not change while the session runs.
pub(super) fn about(served: &Served) -> Value {
    let report = served.session.latest.report();
    let About { name, kind, size, pixel_mm } = &report.basis.about;
    let recording = report.account.recording.as_ref().map(|written| written.path.display().to_string());
    json!({ "about": {
        "version": env!("CARGO_PKG_VERSION"),
        "name": name,
        "kind": kind,
        "size": size,
        "pixel_mm": pixel_mm,
        "marker": "left",
        "recording": recording,
    } })
}

/// Counts from which rates are computed.
#[derive(Debug, Clone, Copy)]
struct Counts {
    at: Instant,
    frames: u64,
    poses: u64,
    views: u32,
}

/// Status publisher of one page.
#[derive(Debug, Default)]
pub(super) struct PagePublisher {
    before: Option<Counts>,
    /// Rates per second, smoothed over about a second.
    rates: [f64; 3],
}

impl PagePublisher {
    /// Returns the present status.
    pub(super) fn status(&mut self, served: &Served) -> Value {
        let report = served.session.latest.report();
        let account = &*report.account;
        let now = Counts {
            at: report.at,
            frames: account.ledger.frames.total,
            poses: account.ledger.readings.iter().map(|readings| readings.used).sum(),
            views: served.session.broadcaster.made(Kind::View),
        };
        self.update(now);
        let [frames, poses, pictures] = self.rates.map(|rate| (rate * 10.0).round() / 10.0);
        let ledger = &account.ledger.frames;
        let refused: BTreeMap<String, u64> =
            ledger.refused.iter().map(|(reason, count)| (reason.name().replace('_', " "), *count)).collect();
        let dropped: u64 = ledger.dropped.values().sum();
        json!({ "account": {
            "desk": served.session.controller.status(),
            "frozen": account.frozen,
            "volume": account.volume,
            "mask": account.mask,
            "slices": ledger.used,
            "frames": ledger.total,
            "refused": refused,
            "dropped": dropped,
            "lost": ledger.lost,
            "rates": { "frames": frames, "poses": poses, "pictures": pictures },
            "capture_to_volume_ms": account.capture_to_volume.quantiles().map(|q| json!({ "median": q.median_ms, "p99": q.p99_ms })),
            "capture_to_picture_ms": account.capture_to_picture.quantiles().map(|q| json!({ "median": q.median_ms, "p99": q.p99_ms })),
            "devices": account.devices.iter().map(device).collect::<Vec<_>>(),
            "frozen_s": account.stuck_s,
            "bent": account.distortion.is_some_and(|found| found.rms_mm.is_some()),
            "recording": recording(account),
            "coach": report.guidance.as_deref(),
            "notes": account.notes,
            "still": report.still,
            "ended": report.ended,
        } })
    }

    fn update(&mut self, now: Counts) {
        let Some(before) = self.before.replace(now) else { return };
        let seconds = now.at.duration_since(before.at).as_secs_f64();
        if seconds <= 0.0 {
            self.before = Some(before);
            return;
        }
        let passed = [
            now.frames.saturating_sub(before.frames) as f64,
            now.poses.saturating_sub(before.poses) as f64,
            f64::from(now.views.wrapping_sub(before.views)),
        ];
        let share = 1.0 - (-seconds).exp();
        for (rate, count) in self.rates.iter_mut().zip(passed) {
            // The first rate is not smoothed.
            let weight = if *rate == 0.0 { 1.0 } else { share };
            *rate += weight * (count / seconds - *rate);
        }
    }
}

fn device(device: &DeviceStatus) -> Value {
    json!({ "name": device.name, "state": device.state, "why": device.why, "clock": worst(device) })
}

/// Returns the state of the device's least reliable clock.
fn worst(device: &DeviceStatus) -> Option<State> {
    let order =
        |state: &State| [State::Locked, State::Holdover, State::Acquiring, State::Lost].iter().position(|s| s == state);
    device.clocks.iter().map(|clock| clock.state).max_by_key(order)
}

fn recording(account: &SessionStatus) -> Option<Value> {
    let written = account.recording.as_ref()?;
    Some(json!({
        "path": written.path.display().to_string(),
        "bytes": written.bytes,
        "minutes_left": written.minutes_left,
        "lost": written.lost,
        "slow_disk": written.slow_disk,
        "trouble": written.trouble,
    }))
}
