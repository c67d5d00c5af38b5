//! Metrics in Prometheus' text format (version 0.0.4):
//! <https://prometheus.io/docs/instrumenting/exposition_formats/>.
//!
//! Names carry base units; counters end in `_total`, and samples with different labels add up.
//! prometheus-client writes OpenMetrics only: other HELP and TYPE lines, `1.0` for 1, and `# EOF`.

use std::fmt::Write as _;

use pipeline::session::{SessionStatus, Spread, Written};
use sonoweave_core::date::Date;
use sonoweave_core::ledger::Queue;
use statistics::{IgtlNumbers, LiveStatistics};
use sync::clock::State;

use super::counts::Counts;
use super::latest::{Basis, Identity};

/// Upper bounds of the latency buckets, ms. They include the project's targets, 20 and 50 ms.
const EDGES_MS: [u64; 14] = [1, 2, 5, 10, 15, 20, 30, 40, 50, 75, 100, 200, 500, 2000];

/// The text of the exposition.
#[derive(Default)]
struct Exposition(String);

impl Exposition {
    /// Begins a metric family. Each name may begin only once.
    fn family(&mut self, name: &'static str, kind: &str, help: &str) -> Family<'_> {
        let help = help.replace('\\', "\\\\").replace('\n', "\\n");
        // Writing to a `String` does not fail.
        let _ = writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}");
        Family { text: &mut self.0, name }
    }

    fn counter(&mut self, name: &'static str, help: &str) -> Family<'_> {
        debug_assert!(name.ends_with("_total"), "{name}");
        self.family(name, "counter", help)
    }

    fn gauge(&mut self, name: &'static str, help: &str) -> Family<'_> {
        self.family(name, "gauge", help)
    }

    fn histogram(&mut self, name: &'static str, help: &str, spread: &Spread) {
        let mut family = self.family(name, "histogram", help);
        for ms in EDGES_MS {
            let edge = (ms as f64 / 1e3).to_string();
            family.of("_bucket", &[("le", &edge)], spread.at_most(ms * 1_000_000) as f64);
        }
        family.of("_bucket", &[("le", "+Inf")], spread.count() as f64);
        family.of("_sum", &[], spread.total_s());
        family.of("_count", &[], spread.count() as f64);
    }
}

struct Family<'t> {
    text: &'t mut String,
    name: &'static str,
}

impl Family<'_> {
    fn sample(&mut self, labels: &[(&str, &str)], value: f64) -> &mut Self {
        self.of("", labels, value)
    }

    fn of(&mut self, suffix: &str, labels: &[(&str, &str)], value: f64) -> &mut Self {
        *self.text += self.name;
        *self.text += suffix;
        for (at, (label, value)) in labels.iter().enumerate() {
            let value = value.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n");
            let _ = write!(self.text, "{}{label}=\"{value}\"", if at == 0 { '{' } else { ',' });
        }
        let close = if labels.is_empty() { "" } else { "}" };
        let _ = writeln!(self.text, "{close} {value}");
        self
    }
}

/// Facts of a session that its statistics lack.
pub(super) struct Facts<'a> {
    pub(super) basis: &'a Basis,
    /// Time since the last frame, or since the session's begin before the first, s.
    pub(super) frame_age_s: f64,
    /// Whether a recording is under way.
    pub(super) is_recorded: bool,
}

/// Returns all metrics of the session.
pub(super) fn text(statistics: &LiveStatistics<'_>, facts: &Facts<'_>) -> String {
    let mut to = Exposition::default();
    to.gauge("sonoweave_build_info", "Version of the running program.").sample(&[("version", statistics.version)], 1.0);
    identity(&mut to, statistics.version, facts);
    to.gauge("sonoweave_uptime_seconds", "Time since the session began.").sample(&[], statistics.wall_s);
    let granted = &statistics.account.scheduling;
    to.gauge("sonoweave_realtime", "1 while threads that receive data have real-time priority.")
        .sample(&[], f64::from(u8::from(granted.realtime)));
    to.gauge("sonoweave_memory_locked", "1 if memory is not paged out.")
        .sample(&[], f64::from(u8::from(granted.memory_locked)));
    let mut memory = to.gauge("sonoweave_memory_bytes", "Memory in use, by owner.");
    for (owner, bytes) in statistics.account.memory.owners() {
        memory.sample(&[("owner", owner)], bytes as f64);
    }
    frames(&mut to, statistics.account);
    readings(&mut to, statistics.account);
    devices(&mut to, statistics.account);
    times(&mut to, statistics.account);
    if let Some(written) = &statistics.account.recording {
        recording(&mut to, written);
    }
    if let Some(numbers) = &statistics.igtl {
        igtl(&mut to, numbers);
    }
    let process = statistics.process;
    to.gauge("process_resident_memory_bytes", "Resident memory of the process.")
        .sample(&[], process.resident_bytes as f64);
    to.counter("process_cpu_seconds_total", "Processor time of all threads, with the kernel's work for them.")
        .sample(&[], process.cpu_s);
    to.gauge("process_threads", "Threads of the process.").sample(&[], process.threads as f64);
    to.gauge("process_open_fds", "Open files, devices and connections of the process.")
        .sample(&[], process.open_files as f64);
    to.0
}

/// Returns the metrics of the console's clients.
pub(super) fn of_console(counts: &Counts) -> String {
    let mut to = Exposition::default();
    for (name, help, count) in [
        ("sonoweave_console_connections_total", "Connections that were accepted.", &counts.connections),
        (
            "sonoweave_console_gave_way_total",
            "Idle connections that were closed in favour of new ones.",
            &counts.evictions,
        ),
        ("sonoweave_console_no_tls_total", "Connections that failed before TLS was established.", &counts.no_tls),
        (
            "sonoweave_console_pages_sent_away_total",
            "Pages that were refused because all viewer slots were in use.",
            &counts.pages_refused,
        ),
        (
            "sonoweave_console_pages_cut_off_total",
            "Pages that were disconnected because they were too slow, sent too much, or stopped responding.",
            &counts.pages_cut_off,
        ),
        (
            "sonoweave_console_packed_pictures_total",
            "Pictures that were compressed for slow connections, once for all pages.",
            &counts.pictures_packed,
        ),
        ("sonoweave_console_wrong_tokens_total", "Wrong tokens that were received.", &counts.tokens_wrong),
        (
            "sonoweave_console_unheard_tokens_total",
            "Tokens that were not checked, because too many wrong ones came from their address.",
            &counts.tokens_unchecked,
        ),
    ] {
        to.counter(name, help).sample(&[], Counts::of(count) as f64);
    }
    to.0
}

fn identity(to: &mut Exposition, version: &str, facts: &Facts<'_>) {
    let Basis { identity, calibrated, .. } = facts.basis;
    let Identity { session, configuration, calibration } = identity;
    let labels = [
        ("session", session.as_str()),
        ("configuration", configuration),
        ("calibration", calibration),
        ("version", version),
    ];
    to.gauge(
        "sonoweave_session_info",
        "Hashes of the recording's name, the configuration file and the calibration file, and the version.",
    )
    .sample(&labels, 1.0);
    if let Some(made) = calibrated {
        // The file has a day; another time zone may be a day ahead.
        let days = Date::today().days_since(*made).max(0);
        to.gauge(
            "sonoweave_calibration_age_seconds",
            "Time since the day of the probe's calibration, in steps of a day.",
        )
        .sample(&[], days as f64 * 86_400.0);
    }
    to.gauge("sonoweave_recording_active", "1 while the session is recorded.")
        .sample(&[], f64::from(u8::from(facts.is_recorded)));
    to.gauge(
        "sonoweave_frame_age_seconds",
        "Time since the last frame, or since the session's begin before the first.",
    )
    .sample(&[], facts.frame_age_s);
}

fn frames(to: &mut Exposition, account: &SessionStatus) {
    let frames = &account.ledger.frames;
    to.counter("sonoweave_frames_arrived_total", "Frames that were received from grabbers.")
        .sample(&[], frames.total as f64);
    let mut outcomes =
        to.counter("sonoweave_frames_total", "Frames by result; with the pending ones, all frames that were received.");
    outcomes.sample(&[("fate", "used"), ("reason", "")], frames.used as f64);
    for (reason, count) in &frames.refused {
        outcomes.sample(&[("fate", "refused"), ("reason", reason.name())], *count as f64);
    }
    // Rates need samples from before the first drop.
    for queue in Queue::ALL {
        let count = frames.dropped.get(&queue).copied().unwrap_or(0);
        outcomes.sample(&[("fate", "dropped"), ("reason", queue.name())], count as f64);
    }
    to.gauge("sonoweave_frames_waiting", "Frames that were received and are pending.")
        .sample(&[], frames.waiting as f64);
    to.counter("sonoweave_frames_lost_total", "Frames that were lost before reception, by the grabbers' count.")
        .sample(&[], frames.lost as f64);
    to.counter(
        "sonoweave_poses_projected_total",
        "Poses whose matrix was no rotation and was replaced by the nearest rotation.",
    )
    .sample(&[], account.ledger.poses_projected as f64);
    let smoothing = account.smoothing.as_ref();
    let mut poses = to.counter(
        "sonoweave_frames_smoothed_total",
        "Frames whose poses were to be smoothed: smoothed, or not for a reason.",
    );
    poses.sample(&[("fate", "smoothed"), ("reason", "")], smoothing.map_or(0.0, |found| found.smoothed as f64));
    for (reason, frames) in smoothing.iter().flat_map(|found| &found.not_smoothed) {
        poses.sample(&[("fate", "not smoothed"), ("reason", reason)], *frames as f64);
    }
    to.gauge(
        "sonoweave_scanner_frozen_seconds",
        "Time for which the scanner has sent the same frame while the probe moved; else 0.",
    )
    .sample(&[], account.stuck_s.unwrap_or(0.0));
}

fn readings(to: &mut Exposition, account: &SessionStatus) {
    let all = &account.ledger.readings;
    let mut arrived =
        to.counter("sonoweave_readings_arrived_total", "Readings that were received from trackers and arms.");
    for of in all {
        arrived.sample(&[("device", &of.device)], of.total as f64);
    }
    let mut outcomes = to.counter(
        "sonoweave_readings_total",
        "Readings by result; with the pending ones, all readings that were received.",
    );
    for of in all {
        let device = ("device", of.device.as_str());
        outcomes.sample(&[device, ("fate", "used"), ("reason", "")], of.used as f64);
        for (reason, count) in &of.refused {
            outcomes.sample(&[device, ("fate", "refused"), ("reason", reason)], *count as f64);
        }
        if of.dropped > 0 {
            outcomes.sample(&[device, ("fate", "dropped"), ("reason", "pairing")], of.dropped as f64);
        }
    }
    let mut waiting = to.gauge("sonoweave_readings_waiting", "Readings that were received and are pending.");
    for of in all {
        waiting.sample(&[("device", &of.device)], of.waiting() as f64);
    }
}

fn devices(to: &mut Exposition, account: &SessionStatus) {
    let devices = &account.devices;
    let mut up = to.gauge("sonoweave_device_up", "1 while the device delivers data.");
    for device in devices {
        up.sample(&[("device", &device.name)], f64::from(u8::from(device.state == "running")));
    }
    let mut state = to.gauge("sonoweave_device_state", "1 for the present state of the device.");
    for device in devices {
        state.sample(&[("device", &device.name), ("state", device.state)], 1.0);
    }
    type Count = fn(&pipeline::session::DeviceStatus) -> u64;
    let counts: [(&'static str, &str, Count); 4] = [
        ("sonoweave_device_received_bytes_total", "Bytes received.", |device| device.bytes),
        ("sonoweave_device_readings_total", "Readings, or frames, that the device delivered.", |device| {
            device.readings
        }),
        (
            "sonoweave_device_lost_total",
            "Readings, or frames, that were lost before reception, by the device's count.",
            |device| device.lost,
        ),
        ("sonoweave_device_set_up_total", "Times that the device was set up.", |device| device.set_up),
    ];
    for (name, help, of) in counts {
        let mut family = to.counter(name, help);
        for device in devices {
            family.sample(&[("device", &device.name)], of(device) as f64);
        }
    }
    let mut age = to.gauge("sonoweave_device_last_reading_age_seconds", "Time since the last data from the device.");
    for device in devices {
        if let Some(seconds) = device.last_reading_s_ago {
            age.sample(&[("device", &device.name)], seconds);
        }
    }
    let clocks = || {
        devices.iter().flat_map(|device| {
            device.clocks.iter().enumerate().map(move |(at, clock)| (device.name.as_str(), at.to_string(), clock))
        })
    };
    let mut locked =
        to.gauge("sonoweave_clock_locked", "1 while the device's times can be converted to this machine's clock.");
    for (device, at, clock) in clocks() {
        let is = clock.state == State::Locked;
        locked.sample(&[("device", device), ("clock", &at)], f64::from(u8::from(is)));
    }
    let mut bound = to.gauge("sonoweave_clock_bound_seconds", "Uncertainty of the device's times.");
    for (device, at, clock) in clocks() {
        bound.sample(&[("device", device), ("clock", &at)], clock.bound_ms / 1e3);
    }
    let mut drift =
        to.gauge("sonoweave_clock_drift_ratio", "Excess rate of this machine's clock over the device's clock.");
    for (device, at, clock) in clocks() {
        drift.sample(&[("device", device), ("clock", &at)], clock.drift_ppm / 1e6);
    }
}

fn times(to: &mut Exposition, account: &SessionStatus) {
    to.histogram(
        "sonoweave_capture_to_volume_seconds",
        "Latency from a frame's capture to its insertion into the volume.",
        &account.capture_to_volume,
    );
    to.histogram(
        "sonoweave_pose_to_volume_seconds",
        "Latency from the reading that completes a frame's pose to the frame's insertion.",
        &account.pose_to_volume,
    );
    to.histogram(
        "sonoweave_capture_to_picture_seconds",
        "Latency from the newest frame's capture to the finished picture.",
        &account.capture_to_picture,
    );
    to.histogram("sonoweave_draw_seconds", "Time to draw a picture of the volume.", &account.draw);
    to.counter("sonoweave_pictures_total", "Pictures drawn.").sample(&[], account.pictures as f64);
    to.counter("sonoweave_pictures_in_parts_total", "Pictures drawn in parts of the volume.")
        .sample(&[], account.pictures_in_parts as f64);
    to.counter(
        "sonoweave_pictures_skipped_slices_total",
        "Slices that were inserted during the drawing of a picture and appeared in the next one.",
    )
    .sample(&[], account.pictures_skipped as f64);
}

fn igtl(to: &mut Exposition, numbers: &IgtlNumbers) {
    to.counter("sonoweave_igtl_clients_total", "OpenIGTLink clients that were served.")
        .sample(&[], numbers.served as f64);
    to.counter("sonoweave_igtl_refused_connections_total", "OpenIGTLink connections that were closed at once.")
        .sample(&[("reason", "not_allowed")], numbers.not_allowed as f64)
        .sample(&[("reason", "no_slot")], numbers.turned_away as f64);
    to.counter("sonoweave_igtl_disconnected_clients_total", "OpenIGTLink clients that were disconnected.")
        .sample(&[("reason", "too_slow")], numbers.cut_off as f64)
        .sample(&[("reason", "too_many_messages")], numbers.too_many as f64)
        .sample(&[("reason", "invalid_data")], numbers.nonsense as f64);
    to.counter(
        "sonoweave_igtl_replaced_messages_total",
        "OpenIGTLink messages that newer ones replaced before they were sent.",
    )
    .sample(&[], numbers.replaced as f64);
}

fn recording(to: &mut Exposition, written: &Written) {
    to.counter("sonoweave_recording_written_bytes_total", "Size of the session's file.")
        .sample(&[], written.bytes as f64);
    to.counter("sonoweave_recording_stored_messages_total", "Messages that were written to disk.")
        .sample(&[], written.stored as f64);
    to.counter(
        "sonoweave_recording_lost_messages_total",
        "Messages that are missing in the session's file, by the full buffer or disk.",
    )
    .sample(&[("queue", "writer"), ("kind", "any")], (written.lost - written.lost_before_writer.total()) as f64)
    .sample(&[("queue", "before_writer"), ("kind", "frame")], written.lost_before_writer.frames as f64)
    .sample(&[("queue", "before_writer"), ("kind", "other")], written.lost_before_writer.others as f64);
    to.counter("sonoweave_recording_synced_bytes_total", "Bytes of the session's file that survive a power cut.")
        .sample(&[], written.synced_bytes as f64);
    to.gauge("sonoweave_recording_unsynced_seconds", "Age of the oldest message that may not survive a power cut.")
        .sample(&[], written.unsynced_s);
    to.gauge("sonoweave_recording_unsynced_max_seconds", "Largest such age so far.")
        .sample(&[], written.unsynced_most_s);
    to.gauge("sonoweave_recording_in_trouble", "1 while the recording cannot be written or synced.")
        .sample(&[], f64::from(u8::from(!written.trouble.is_empty())));
    if let Some(bytes) = written.free_bytes {
        to.gauge("sonoweave_recording_disk_free_bytes", "Space on the disk that the recording may still take.")
            .sample(&[], bytes as f64);
    }
    if let Some(minutes) = written.minutes_left {
        to.gauge("sonoweave_recording_disk_left_seconds", "Time until the disk is full, at the present rate.")
            .sample(&[], minutes * 60.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_and_help_are_escaped_and_counts_are_integers() {
        let mut to = Exposition::default();
        to.gauge("x", "a \\ b\nc").sample(&[("device", "say \"x\\y\"\nz"), ("k", "")], 1e15).sample(&[], f64::NAN);
        let expected = "# HELP x a \\\\ b\\nc\n# TYPE x gauge\nx{device=\"say \\\"x\\\\y\\\"\\nz\",k=\"\"} 1000000000000000\nx NaN\n";
        assert_eq!(to.0, expected);
    }

    #[test]
    fn histogram_buckets_accumulate() {
        let (mut to, mut spread) = (Exposition::default(), Spread::default());
        for ms in [3, 18, 18, 90, 5000] {
            spread.add_ns(ms * 1_000_000);
        }
        to.histogram("t_seconds", "Times.", &spread);
        for (line, count) in [
            ("le=\"0.002\"", 0),
            ("le=\"0.005\"", 1),
            ("le=\"0.02\"", 3),
            ("le=\"0.1\"", 4),
            ("le=\"2\"", 4),
            ("le=\"+Inf\"", 5),
        ] {
            assert!(to.0.contains(&format!("t_seconds_bucket{{{line}}} {count}\n")), "{line}: {}", to.0);
        }
        assert!(to.0.ends_with("t_seconds_sum 5.129\nt_seconds_count 5\n"), "{}", to.0);
    }
}
