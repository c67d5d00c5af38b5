//! Every section and key of a bedside's file: what it takes, what it means, and when a change of it takes effect.
//!
//! This list is what unknown keys are held against, what `live --keys` prints, and what says which changes wait for a restart.

/// A section of the file.
#[derive(Debug)]
pub struct Section {
    /// Its heading, dotted.
    pub name: &'static str,
    /// What it is about.
    pub about: &'static str,
    /// What may stand in it.
    pub keys: &'static [Key],
}

impl Section {
    /// The names of its keys, and of the sections within it.
    pub fn known(&self) -> Vec<&'static str> {
        let inner = SECTIONS.iter().filter_map(|section| section.name.strip_prefix(self.name)?.strip_prefix('.'));
        self.keys.iter().map(|key| key.name).chain(inner).collect()
    }
}

/// A key of a section.
#[derive(Debug)]
pub struct Key {
    /// Its name, its unit last.
    pub name: &'static str,
    /// What may stand behind it.
    pub takes: &'static str,
    /// What it means, and what holds without it.
    pub about: &'static str,
    /// When a change of it takes effect.
    pub applies: Applies,
}

/// When a change of a key takes effect in a session that runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Applies {
    /// When the file is read again.
    AtOnce,
    /// In the next session.
    NextSession,
}

const fn next(name: &'static str, takes: &'static str, about: &'static str) -> Key {
    Key { name, takes, about, applies: Applies::NextSession }
}

const fn once(name: &'static str, takes: &'static str, about: &'static str) -> Key {
    Key { name, takes, about, applies: Applies::AtOnce }
}

const LATENCY: &str = "what its times lie behind its measurements beyond what the driver knows of wire and sampling; the calibration file's without it, else 0";

/// All sections, in the order in which a slice passes them.
pub const SECTIONS: &[Section] = &[
    Section {
        name: "calibration",
        about: "Where the picture lies against the probe, and what of it is data. Without it a virtual bedside has its own",
        keys: &[
            next(
                "file",
                "a path, from this file's folder",
                "our calibration file, or a PLUS XML; an arm's joints stand in it too",
            ),
            next("preset", "a text", "which of the calibration file's presets, by its name; without it the only one"),
            next("warn_after_days", "1 to 36500", "a preset that is older is warned of; 180 without it"),
            next("image_to_probe", "16 numbers, row major", "pixels to mm at the probe's sensor, instead of a file"),
            next(
                "clip_px",
                "[x, y, width, height], \"auto\" or \"none\"",
                "the rectangle that is data; without it the calibration file's, else found in the first frames",
            ),
            next(
                "fan",
                "{ origin_px, radii_px, angles_deg }",
                "the sector that is data, degrees from straight down, positive to the right; without it the calibration file's",
            ),
        ],
    },
    Section {
        name: "tracker",
        about: "The Polhemus tracker, where one carries the probe",
        keys: &[
            next("model", "isotrak, fastrak, liberty, patriot or viper", "which it is"),
            next(
                "port",
                "a serial line's path, \"usb\", \"usb:SERIAL\" or \"virtual\"",
                "where it is; `sonoweave devices` lists what there is",
            ),
            next("baud", "bits a second", "rate of a serial line; without it all that the model has are tried"),
            next("probe_station", "1 to 16", "station of the sensor on the transducer; 1 without it"),
            next(
                "reference_station",
                "1 to 16",
                "station of the sensor on the patient, in whose frame the volume then lives; none without it",
            ),
            next("stylus_station", "1 to 16", "station of the stylus, whose button counts; none without it"),
            next(
                "hemisphere",
                "[x, y, z] or \"follow\"",
                "zenith of the half space that all sensors stay in, in the transmitter's frame; [1, 0, 0], in front of it, without it",
            ),
            next("rate_hz", "1 to 10000", "readings a second of each station, at most; 240 without it"),
            next("binary", "true or false", "numbers as singles, shorter and more exact, or as text; true without it"),
            next(
                "may_reset",
                "true or false",
                "whether a unit that does not answer may be started anew, which takes 10 to 20 s; true without it",
            ),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "arm",
        about: "The encoder arm, where one carries the probe",
        keys: &[
            next(
                "kind",
                "ea1, lines, qsb, microscribe or immersion",
                "which it is: EA1 (docs/ea1.md), lines of three bare numbers, three QSBs, a MicroScribe or an Immersion box",
            ),
            next(
                "port",
                "a serial line's path, a list of three for qsb, or \"virtual\"",
                "where it is, the base joint's line first",
            ),
            next("baud", "bits a second", "rate of its lines; what is usual for the kind without it"),
            next("blocks", "true or false", "of ea1: samples as blocks instead of lines; false without it"),
            next(
                "encoders",
                "5 or 6 of microscribe, 2, 4 or 6 of immersion",
                "encoders to ask for; 5 and 4 without it",
            ),
            next("rate_hz", "1 to 10000", "readings a second; 100 without it"),
            next(
                "fastest_counts_per_s",
                "100 or more",
                "what no joint ever reaches: what moved farther was reset or lost steps; 400000 without it, 20000 of encoders of 14 bits",
            ),
            next(
                "counts_per_turn",
                "[n, n, n]",
                "counts a revolution, or a metre, that the arm has to say of itself, base first; 0 for not known",
            ),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "remote",
        about: "The OpenIGTLink server that knows where the probe is, such as PLUS's, in the place of a tracker",
        keys: &[
            next("address", "\"HOST:PORT\"", "where the server is; 18944 is the usual port"),
            next("probe", "a transform's name", "the one from the probe to the tracker; ProbeToTracker without it"),
            next(
                "reference",
                "a transform's name",
                "the one from the sensor on the patient, in whose frame the volume then lives; none without it",
            ),
            next("stylus", "a transform's name", "the one from the stylus; none without it"),
            next("interval_ms", "0 to 1000", "the least time between two messages that are asked for; 5 without it"),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "grabber",
        about: "The frame grabber at the scanner's video output",
        keys: &[
            next(
                "device",
                "a video node, a grabber's name or place as listed, \"openigtlink:HOST:PORT\", or \"virtual\"",
                "which it is; names stay the same when it is plugged in again. Of an OpenIGTLink server its IMAGEs are taken, and of what is below input, orientation and latency_ms count",
            ),
            next(
                "input",
                "a name or a number",
                "the input, of grabbers with several, the one in force without it; of a server its image by name, the first slice that comes without it",
            ),
            next("standard", "ntsc, pal or secam", "the analogue standard; what the grabber sees without it"),
            next("format", "a V4L2 name such as YUYV", "format of the video; what costs least without it"),
            next(
                "size",
                "\"WxH\" or [width, height]",
                "pixels of the video; the largest that comes fluently without it, 640x480 of a virtual one",
            ),
            next("rate_hz", "0.1 to 1000", "frames a second; the most there is without it, 30 of a virtual one"),
            next("colour", "grey or rgb", "what pictures are made; grey without it, which is what can be woven"),
            next("range", "limited or full", "what stands for black and white, where the driver is wrong about it"),
            next("matrix", "bt601 or bt709", "how luma was made, where the driver is wrong about it"),
            next(
                "interlace",
                "one-field, both-fields or whole",
                "what becomes of interlaced video; one-field without it",
            ),
            next(
                "orientation",
                "MF, MN, UF, UN, FM, NM, FU or NU",
                "which way the video's first and second axis grow: to the marked or unmarked side, away from the probe or towards it; MF without it",
            ),
            next("buffers", "2 to 32", "frames that the kernel keeps while nobody asks; 6 without it"),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "pairing",
        about: "How a frame finds its pose",
        keys: &[
            next("wait_ms", "0 to 10000", "for how long a frame waits for poses around its time; 500 without it"),
            next(
                "longest_gap_ms",
                "1 to 10000",
                "the longest time between two poses that a pose is made between; 100 without it",
            ),
        ],
    },
    Section {
        name: "scanner",
        about: "The ultrasound scanner",
        keys: &[
            once(
                "frozen_s",
                "0.05 to 60",
                "after how long a time of equal pictures at changing poses it counts as frozen; 0.5 without it",
            ),
            next(
                "ruler",
                "{ px, mm }",
                "a length along the ruler beside the picture, as it is set now: a preset of another depth is refused by it; not compared without it",
            ),
        ],
    },
    Section {
        name: "volume",
        about: "What slices are woven into, by the names of `reconstruct`'s flags",
        keys: &[
            next(
                "world",
                "a frame's name",
                "where the volume lives; Reference if a reference_station is given, else Tracker, without it",
            ),
            next(
                "spacing_mm",
                "a number or [x, y, z]",
                "distance between voxels; the calibration file's, else 0.5, without it",
            ),
            next(
                "origin_mm",
                "[x, y, z]",
                "world position of voxel (0, 0, 0); the lattice passes through the world's origin without it",
            ),
            next("path", "auto, general or planar", "which path slices go; auto without it"),
            next(
                "departure",
                "upgrade or refuse",
                "what becomes of a frame that leaves a planar scan's plane; upgrade without it",
            ),
            next(
                "planar_tolerance_voxels",
                "0 or more",
                "how far the picture's corners may lie off the plane; 0.25 without it",
            ),
            next(
                "method",
                "gaussian, gaussian-truncated, bspline3, linear or nearest",
                "the kernel; gaussian-truncated without it",
            ),
            next(
                "sigma_mm",
                "[u, v, normal]",
                "σ of the kernel; 0.75 × the larger of spacing and pixel in the plane, 1.0 across, without it",
            ),
            next("hwhm_mm", "[u, v, normal]", "the same as half widths at half maximum"),
            next(
                "support",
                "\"CRITERION=E\" or two of them",
                "where a Gaussian ends, in the plane and across it; energy=0.001,energy=0.01 without it",
            ),
            next("max_weight", "1 to 1000000", "largest weight of a voxel, in slices at their peak; 256 without it"),
            next(
                "compound",
                "mean, maximum, latest or decay",
                "what becomes of slices that reach the same voxel; mean without it",
            ),
            next(
                "decay",
                "none, exp, dead-time or paper-literal",
                "how the past fades under compound = \"decay\"; dead-time without it",
            ),
            next("decay_per_s", "0.000001 to 1000000", "how fast it fades; 1 without it"),
            next("decay_wait_s", "0 to 1000000", "for how long it does not fade; 2 without it"),
            next("threads", "1 to 1024", "threads that weave; any number gives the same volume, one a core without it"),
            next("max_memory_gib", "above 0", "memory that the volume may take; 8 without it"),
        ],
    },
    Section {
        name: "picture",
        about: "The picture that follows the volume, by the names of `render`'s flags",
        keys: &[
            once("most_hz", "0.1 to 1000", "pictures a second at most; 30 without it"),
            once("image_size", "\"WxH\" or [width, height]", "pixels; 512x512 without it"),
            once(
                "view_deg",
                "[azimuth, elevation] or [azimuth, elevation, roll]",
                "from where; from the deep side, aslant, with the probe on top, without it",
            ),
            once("perspective_deg", "above 0, up to 170", "angle that the smaller side sees; parallel rays without it"),
            once("mode", "shaded, mip, average, iso or opacity", "what of the volume is drawn; shaded without it"),
            once(
                "isovalue",
                "a grey level",
                "where mode = \"iso\" draws the surface; halfway between black and white without it",
            ),
            once("shading", "voxel or sample", "what the transfer function classifies; voxel without it"),
            once(
                "transfer",
                "a preset or a path ending in .toml",
                "opacity and colour of grey levels; tissue without it, xray for mip and average",
            ),
            once("window", "[black, white]", "the grey levels that are black and white; [0, 255] without it"),
            once("step_voxels", "above 0", "distance of samples along a ray; 1 without it"),
            once(
                "arity",
                "1 or more",
                "samples that are folded together; next to the root of a ray's samples without it",
            ),
            once("stop", "0 to 1", "a ray ends where less of what lies behind would be seen; 1/1024 without it"),
            once("adaptive", "0 to 1", "rays are left out where the picture differs by less; 0, none, without it"),
            once("background", "[red, green, blue]", "colour behind the volume, each 0 to 1; black without it"),
            once(
                "light",
                "\"headlight\" or [x, y, z]",
                "where the light is, or the direction towards it in the world; headlight without it",
            ),
            once("ambient", "0 to 1", "part of the light that comes from all sides; 0.3 without it"),
            once("diffuse", "0 to 1", "part that a surface scatters evenly; 0.7 without it"),
            once("specular", "0 to 1", "part that it reflects as a highlight; 0.2 without it"),
            once("shininess", "1 or more", "exponent of the highlight; 16 without it"),
            once("two_sided", "true or false", "whether light falls on the backs of surfaces too; true without it"),
            once("depth_cue", "[near, far]", "brightness of what is nearest and farthest; does not fade without it"),
            once(
                "cache",
                "two-level, linear, one-level or none",
                "what is kept of rays; all give the same picture, two-level without it",
            ),
            once("cache_mib", "0 to 1048576", "memory that it may take; 256 without it"),
            once(
                "draw",
                "a list of slice, probe, scale and cube",
                "what is drawn over the picture; slice and probe without it",
            ),
            once("threads", "1 to 1024", "threads that draw; any number gives the same picture, one a core without it"),
        ],
    },
    Section {
        name: "record",
        about: "The recording of a session, which --record begins too",
        keys: &[
            next(
                "folder",
                "a path, from this file's folder",
                "where sessions are recorded; without it none is, unless --record says so",
            ),
            next(
                "full_frame",
                "true or false",
                "keep the whole video frame; false without it: pixels outside the scanner's picture may name the patient",
            ),
            once("keep_free_mb", "0 or more", "the recording ends before less is left on the disk; 1024 without it"),
        ],
    },
    Section {
        name: "status",
        about: "What the session tells of itself, and to whom",
        keys: &[
            next(
                "listen",
                "\"ADDRESS:PORT\", such as \"127.0.0.1:9110\"",
                "where the page, status and metrics are to be had; nowhere without it. An address that other machines reach wants certificate, key and token_file",
            ),
            next(
                "certificate",
                "a path, from this file's folder",
                "the server's certificate, PEM, those between it and a known one behind it: it is then HTTPS; plain HTTP without it",
            ),
            next(
                "key",
                "a path, from this file's folder",
                "the certificate's private key, PEM; only its owner and group may read it",
            ),
            next(
                "token_file",
                "a path, from this file's folder",
                "a file of one line, 32 characters or more, which only its owner may read: whoever looks or asks must have it; nobody is asked for one without it",
            ),
            next(
                "names",
                "a list of names or addresses",
                "what this machine is called beside the certificate's names and the addresses that it has itself; none without it",
            ),
        ],
    },
    Section {
        name: "process",
        about: "The session among the machine's other programs",
        keys: &[next(
            "realtime",
            "if-permitted, never or required",
            "threads that take in data run before all others, and memory is not paged out; if-permitted without it, which a virtual bedside never asks for; required refuses to begin without",
        )],
    },
    Section {
        name: "virtual",
        about: "The virtual bedside, for devices that are \"virtual\": a hand that sweeps to and fro over a body",
        keys: &[
            next("scene", "a scene of `phantom`, such as doll", "what is scanned; doll without it"),
            next(
                "trajectory",
                "a trajectory of `phantom`, such as freehand",
                "how the probe moves; freehand without it",
            ),
            next("frames", "2 to 100000", "frames of the video's rate that a sweep takes one way; 300 without it"),
            next(
                "gap_mm",
                "above 0",
                "mean distance between them; 1 round a point, what sees all of a body, else 0.35, without it",
            ),
            next("pixel_mm", "above 0", "size of a pixel; what shows the scanner's whole field, else 0.1, without it"),
            next("noise_sd", "0 or more", "noise of the pictures, grey levels; what is usual for the scene without it"),
            next("tracker_noise_mm", "0 to 10", "noise of each sensor of a tracker along each axis; 0 without it"),
            next("tracker_noise_deg", "0 to 10", "noise of each sensor of a tracker about each axis; 0 without it"),
            next("seed", "0 to 4294967295", "of all that is drawn at random; 1 without it"),
            next(
                "painted",
                "true or false",
                "pictures are painted before the session begins, one a frame of the sweep, to measure what becomes of them; false without it",
            ),
        ],
    },
    Section {
        name: "virtual.line",
        about: "What goes wrong between a virtual tracker or arm and the host; nothing without it",
        keys: &[
            LATE,
            JITTER,
            next(
                "packet_ms",
                "0 to 1000",
                "bytes come in packets this far apart, as by an adapter that collects them; at once without it",
            ),
            DRIFT,
            next("drop", "0 to 1", "share of bytes that are lost on the wire"),
            next("noise", "0 to 1", "share of bytes that arrive as another"),
            DROPOUT,
        ],
    },
    Section {
        name: "virtual.grabber",
        about: "What goes wrong at a virtual grabber; nothing without it",
        keys: &[LATE, JITTER, DRIFT, DROPOUT],
    },
];

const LATE: Key = next("latency_ms", "0 to 10000", "what is delivered is held back for so long");
const JITTER: Key = next("jitter_ms", "0 to 10000", "and for up to so much longer, each time anew");
const DRIFT: Key = next("drift_ppm", "-10000 to 10000", "how much faster its clock runs");
const DROPOUT: Key = next("dropout", "0 to 1", "share of readings or frames that are never sent");

/// The section of a heading.
pub fn section(name: &str) -> Option<&'static Section> {
    SECTIONS.iter().find(|section| section.name == name)
}

/// The key of a dotted name.
pub fn key(dotted: &str) -> Option<&'static Key> {
    let (heading, name) = dotted.rsplit_once('.')?;
    section(heading)?.keys.iter().find(|key| key.name == name)
}
