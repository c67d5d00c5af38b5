//! The numbers in Prometheus' text form (version 0.0.4): <https://prometheus.io/docs/instrumenting/exposition_formats/>.
//!
//! Names carry base units; what only grows ends in `_total`, and what is told apart by labels adds up over them.

use std::fmt::Write as _;

use super::Counts;
use crate::pipeline::live::{Account, Spread, Written};
use crate::statistics::LiveStatistics;
use crate::sync::clock::State;

/// Upper edges of the latencies' buckets, ms. The project's aims, 20 and 50 ms, are among them.
const EDGES_MS: [u64; 14] = [1, 2, 5, 10, 15, 20, 30, 40, 50, 75, 100, 200, 500, 2000];

/// A family of samples, or what stands before them.
#[derive(Default)]
struct Exposition(String);

impl Exposition {
    /// A family begins. Its name must not have begun before.
    fn family(&mut self, name: &'static str, kind: &str, help: &str) -> Family<'_> {
        let help = help.replace('\\', "\\\\").replace('\n', "\\n");
        // Writing to a text does not fail.
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

/// All of them.
pub(super) fn text(statistics: &LiveStatistics<'_>) -> String {
    let mut to = Exposition::default();
    to.gauge("sonoweave_build_info", "The program that runs.").sample(&[("version", statistics.version)], 1.0);
    to.gauge("sonoweave_uptime_seconds", "Time since the session began.").sample(&[], statistics.wall_s);
    let granted = &statistics.account.scheduling;
    to.gauge("sonoweave_realtime", "1 while threads that take in data run before all others.")
        .sample(&[], f64::from(u8::from(granted.realtime)));
    to.gauge("sonoweave_memory_locked", "1 if memory is not paged out.")
        .sample(&[], f64::from(u8::from(granted.memory_locked)));
    frames(&mut to, statistics.account);
    readings(&mut to, statistics.account);
    devices(&mut to, statistics.account);
    times(&mut to, statistics.account);
    if let Some(written) = &statistics.account.recording {
        recording(&mut to, written);
    }
    let process = statistics.process;
    to.gauge("process_resident_memory_bytes", "Memory that the process holds.")
        .sample(&[], process.resident_bytes as f64);
    to.counter("process_cpu_seconds_total", "Time that its threads have run, the kernel's work for them included.")
        .sample(&[], process.cpu_s);
    to.gauge("process_threads", "Its threads.").sample(&[], process.threads as f64);
    to.gauge("process_open_fds", "Its open files, devices and connections.").sample(&[], process.open_files as f64);
    to.0
}

/// What became of those who asked.
pub(super) fn of_console(counts: &Counts) -> String {
    let mut to = Exposition::default();
    for (name, help, count) in [
        ("sonoweave_console_connections_total", "Connections that were taken.", &counts.connections),
        (
            "sonoweave_console_gave_way_total",
            "Connections that gave way to others as they asked for nothing.",
            &counts.gave_way,
        ),
        ("sonoweave_console_no_tls_total", "Connections that did not come as far as to speak TLS.", &counts.no_tls),
        (
            "sonoweave_console_pages_sent_away_total",
            "Pages that were sent away as all places were taken.",
            &counts.pages_sent_away,
        ),
        (
            "sonoweave_console_pages_cut_off_total",
            "Pages that were cut off as they took nothing, said too much, or fell silent.",
            &counts.pages_cut_off,
        ),
        (
            "sonoweave_console_packed_pictures_total",
            "Pictures that were packed for slow lines, once for all pages.",
            &counts.pictures_packed,
        ),
        ("sonoweave_console_wrong_tokens_total", "Wrong tokens that were shown.", &counts.tokens_wrong),
        (
            "sonoweave_console_unheard_tokens_total",
            "Tokens that were not looked at, as too many wrong ones came from their address.",
            &counts.tokens_unheard,
        ),
    ] {
        to.counter(name, help).sample(&[], Counts::of(count) as f64);
    }
    to.0
}

fn frames(to: &mut Exposition, account: &Account) {
    let frames = &account.ledger.frames;
    to.counter("sonoweave_frames_arrived_total", "Frames that came from grabbers.").sample(&[], frames.total as f64);
    let mut fates =
        to.counter("sonoweave_frames_total", "Frames by what became of them; with those that wait, all that arrived.");
    fates.sample(&[("fate", "used"), ("reason", "")], frames.used as f64);
    for (reason, count) in &frames.refused {
        fates.sample(&[("fate", "refused"), ("reason", reason.name())], *count as f64);
    }
    for (queue, count) in &frames.dropped {
        fates.sample(&[("fate", "dropped"), ("reason", queue.name())], *count as f64);
    }
    to.gauge("sonoweave_frames_waiting", "Frames that arrived and are not decided upon.")
        .sample(&[], frames.waiting as f64);
    to.counter("sonoweave_frames_lost_total", "Frames lost before they came, by the grabbers' own count.")
        .sample(&[], frames.lost as f64);
    to.counter("sonoweave_poses_projected_total", "Poses that were off a rotation, and were replaced by the nearest.")
        .sample(&[], account.ledger.poses_projected as f64);
    to.gauge(
        "sonoweave_scanner_frozen_seconds",
        "For how long the scanner has shown one picture while the probe moved; 0 while it does not.",
    )
    .sample(&[], account.frozen_s.unwrap_or(0.0));
}

fn readings(to: &mut Exposition, account: &Account) {
    let all = &account.ledger.readings;
    let mut arrived = to.counter("sonoweave_readings_arrived_total", "Readings that came from trackers and arms.");
    for of in all {
        arrived.sample(&[("device", &of.device)], of.total as f64);
    }
    let mut fates = to.counter(
        "sonoweave_readings_total",
        "Readings by what became of them; with those that wait, all that arrived.",
    );
    for of in all {
        let device = ("device", of.device.as_str());
        fates.sample(&[device, ("fate", "used"), ("reason", "")], of.used as f64);
        for (reason, count) in &of.refused {
            fates.sample(&[device, ("fate", "refused"), ("reason", reason)], *count as f64);
        }
        if of.dropped > 0 {
            fates.sample(&[device, ("fate", "dropped"), ("reason", "pairing")], of.dropped as f64);
        }
    }
    let mut waiting = to.gauge("sonoweave_readings_waiting", "Readings that arrived and are not decided upon.");
    for of in all {
        waiting.sample(&[("device", &of.device)], of.waiting() as f64);
    }
}

fn devices(to: &mut Exposition, account: &Account) {
    let devices = &account.devices;
    let mut up = to.gauge("sonoweave_device_up", "1 while the device delivers.");
    for device in devices {
        up.sample(&[("device", &device.name)], f64::from(u8::from(device.state == "running")));
    }
    let mut state = to.gauge("sonoweave_device_state", "1 for the state that the device is in.");
    for device in devices {
        state.sample(&[("device", &device.name), ("state", device.state)], 1.0);
    }
    type Count = fn(&crate::pipeline::live::DeviceBoard) -> u64;
    let counts: [(&'static str, &str, Count); 4] = [
        ("sonoweave_device_received_bytes_total", "Bytes received.", |device| device.bytes),
        ("sonoweave_device_readings_total", "Readings, or frames, that the device delivered.", |device| {
            device.readings
        }),
        (
            "sonoweave_device_lost_total",
            "Readings, or frames, lost before they came, by the device's own count.",
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
    let mut age =
        to.gauge("sonoweave_device_last_reading_age_seconds", "For how long nothing has come from the device.");
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
        to.gauge("sonoweave_clock_locked", "1 while the device's times can be told on this machine's clock.");
    for (device, at, clock) in clocks() {
        let is = clock.state == State::Locked;
        locked.sample(&[("device", device), ("clock", &at)], f64::from(u8::from(is)));
    }
    let mut bound = to.gauge("sonoweave_clock_bound_seconds", "How far the truth may lie from a time of the device.");
    for (device, at, clock) in clocks() {
        bound.sample(&[("device", device), ("clock", &at)], clock.bound_ms / 1e3);
    }
    let mut drift =
        to.gauge("sonoweave_clock_drift_ratio", "How much faster this machine's clock runs than the device's says.");
    for (device, at, clock) in clocks() {
        drift.sample(&[("device", device), ("clock", &at)], clock.drift_ppm / 1e6);
    }
}

fn times(to: &mut Exposition, account: &Account) {
    to.histogram(
        "sonoweave_capture_to_volume_seconds",
        "From a frame's capture until it is in the volume.",
        &account.capture_to_volume,
    );
    to.histogram(
        "sonoweave_pose_to_volume_seconds",
        "From the reading that made a frame's pose known until it is in the volume.",
        &account.pose_to_volume,
    );
    to.histogram(
        "sonoweave_capture_to_picture_seconds",
        "From the newest frame's capture until its picture is drawn.",
        &account.capture_to_picture,
    );
    to.histogram("sonoweave_draw_seconds", "From taking the volume to its picture.", &account.draw);
    to.counter("sonoweave_pictures_total", "Pictures drawn.").sample(&[], account.pictures as f64);
    to.counter(
        "sonoweave_pictures_skipped_slices_total",
        "Slices that came while another picture was drawn, and were drawn with the next.",
    )
    .sample(&[], account.pictures_skipped as f64);
}

fn recording(to: &mut Exposition, written: &Written) {
    to.counter("sonoweave_recording_written_bytes_total", "Bytes of the session's file.")
        .sample(&[], written.bytes as f64);
    to.counter("sonoweave_recording_stored_messages_total", "Messages that the disk has taken.")
        .sample(&[], written.stored as f64);
    to.counter(
        "sonoweave_recording_lost_messages_total",
        "Messages that are not in the session's file, by what had no room for them.",
    )
    .sample(&[("queue", "writer"), ("kind", "any")], (written.lost - written.lost_before_writer.total()) as f64)
    .sample(&[("queue", "before_writer"), ("kind", "frame")], written.lost_before_writer.frames as f64)
    .sample(&[("queue", "before_writer"), ("kind", "other")], written.lost_before_writer.others as f64);
    to.gauge("sonoweave_recording_in_trouble", "1 while nothing can be written.")
        .sample(&[], f64::from(u8::from(!written.trouble.is_empty())));
    if let Some(minutes) = written.minutes_left {
        to.gauge("sonoweave_recording_disk_left_seconds", "Time until the disk is full, at the present rate.")
            .sample(&[], minutes * 60.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_and_help_are_escaped_and_counts_are_whole() {
        let mut to = Exposition::default();
        to.gauge("x", "a \\ b\nc").sample(&[("device", "say \"x\\y\"\nz"), ("k", "")], 1e15).sample(&[], f64::NAN);
        let wanted = "# HELP x a \\\\ b\\nc\n# TYPE x gauge\nx{device=\"say \\\"x\\\\y\\\"\\nz\",k=\"\"} 1000000000000000\nx NaN\n";
        assert_eq!(to.0, wanted);
    }

    #[test]
    fn a_histogram_adds_up() {
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
