//! Every section and key of a session configuration.

use super::key::{Key, Section, next, once};

const LATENCY: &str = "latency of its times, beyond the delay of wire and sampling that the driver knows; default: the \
    calibration file's, else 0";

/// All sections, in the order in which a slice passes them.
pub const SECTIONS: &[Section] = &[
    Section {
        name: "calibration",
        about: "Position of the image relative to the probe, and the part of the image that is data. A virtual bedside \
            needs no such section",
        keys: &[
            next(
                "file",
                "a path, from this file's folder",
                "calibration file of sonoweave, or a PLUS XML; for an arm it also contains the joints",
            ),
            next("preset", "a text", "name of a preset of the calibration file; default: the only one"),
            next("warn_after_days", "1 to 36500", "age of a preset above which a warning is given; default: 180"),
            next(
                "image_to_probe",
                "16 numbers, row major",
                "transform from pixels to mm at the probe's sensor, instead of a file",
            ),
            next(
                "clip_px",
                "[x, y, width, height], \"auto\" or \"none\"",
                "rectangle of the image that is data; default: the calibration file's, else detected in the first \
                frames",
            ),
            next(
                "fan",
                "{ origin_px, radii_px, angles_deg }",
                "sector of the image that is data, in degrees from straight down, positive to the right; default: the \
                calibration file's",
            ),
        ],
    },
    Section {
        name: "tracker",
        about: "The Polhemus tracker, if one locates the probe",
        keys: &[
            next("model", "isotrak, fastrak, liberty, patriot or viper", "model of the tracker"),
            next(
                "port",
                "a serial line's path, \"usb\", \"usb:SERIAL\" or \"virtual\"",
                "port of the tracker; `sonoweave devices` lists the connected ones",
            ),
            next("baud", "bits a second", "rate of a serial line; default: all rates of the model are tried"),
            next("probe_station", "1 to 16", "station of the sensor on the transducer; default: 1"),
            next(
                "reference_station",
                "1 to 16",
                "station of the sensor on the patient; the volume is then in this sensor's coordinate frame; default: \
                none",
            ),
            next("stylus_station", "1 to 16", "station of the stylus, whose button is read; default: none"),
            next(
                "hemisphere",
                "[x, y, z] or \"follow\"",
                "zenith of the half space that contains all sensors, in the transmitter's frame; default: [1, 0, 0], \
                in front of the transmitter",
            ),
            next("rate_hz", "1 to 10000", "largest rate of each station, in readings a second; default: 240"),
            next(
                "binary",
                "true or false",
                "true for numbers in binary, which are shorter and more exact; false for \
                numbers as text; default: true",
            ),
            next(
                "may_reset",
                "true or false",
                "permission to restart a unit that does not answer, which takes 10 to 20 s; default: true",
            ),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "arm",
        about: "The encoder arm, if one carries the probe",
        keys: &[
            next(
                "kind",
                "ea1, lines, qsb, microscribe or immersion",
                "kind of the arm: EA1 (docs/ea1.md), lines of three bare numbers, three QSBs, a MicroScribe or an \
                Immersion box",
            ),
            next(
                "port",
                "a serial line's path, a list of three for qsb, or \"virtual\"",
                "port of the arm; with three lines, the base joint's comes first",
            ),
            next("baud", "bits a second", "rate of its lines; default: the usual rate of the kind"),
            next(
                "blocks",
                "true or false",
                "for ea1 only: true for samples as blocks instead of lines; default: false",
            ),
            next(
                "encoders",
                "5 or 6 of microscribe, 2, 4 or 6 of immersion",
                "number of encoders to read; default: 5 for microscribe, 4 for immersion",
            ),
            next("rate_hz", "1 to 10000", "readings a second; default: 100"),
            next(
                "fastest_counts_per_s",
                "100 or more",
                "speed that no joint reaches: a faster count means a reset or lost steps; default: 400000, for \
                encoders of 14 bits 20000",
            ),
            next(
                "counts_per_turn",
                "[n, n, n]",
                "counts a revolution, or a metre, that the arm must report, base joint first; 0 if unknown",
            ),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "remote",
        about: "The OpenIGTLink server that sends the probe's poses, such as PLUS's, instead of a tracker",
        keys: &[
            next("address", "\"HOST:PORT\"", "address of the server; the usual port is 18944"),
            next("probe", "a transform's name", "transform from the probe to the tracker; default: ProbeToTracker"),
            next(
                "reference",
                "a transform's name",
                "transform from the sensor on the patient; the volume is then in this sensor's coordinate frame; \
                default: none",
            ),
            next("stylus", "a transform's name", "transform from the stylus; default: none"),
            next(
                "interval_ms",
                "0 to 1000",
                "shortest time between two messages, as requested from the server; default: 5",
            ),
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
                "the grabber; its name stays the same when it is plugged in again. An OpenIGTLink server supplies \
                IMAGE messages; of the keys below, only input, orientation and latency_ms then apply",
            ),
            next(
                "input",
                "a name or a number",
                "input of a grabber with several; default: the selected one. For a server: the name of its image; \
                default: the first slice that arrives",
            ),
            next("standard", "ntsc, pal or secam", "analogue standard; default: the one that the grabber detects"),
            next("format", "a V4L2 name such as YUYV", "format of the video; default: the one with the lowest cost"),
            next(
                "size",
                "\"WxH\" or [width, height]",
                "size of the video in pixels; default: the largest at full rate, for a virtual grabber 640x480",
            ),
            next("rate_hz", "0.1 to 1000", "frames a second; default: the highest rate, for a virtual grabber 30"),
            next(
                "colour",
                "grey or rgb",
                "colour of the frames; only grey frames can be inserted into a volume; default: grey",
            ),
            next(
                "range",
                "limited or full",
                "range of luma values from black to white, if the driver reports it wrongly",
            ),
            next("matrix", "bt601 or bt709", "matrix that luma was made with, if the driver reports it wrongly"),
            next("interlace", "one-field, both-fields or whole", "treatment of interlaced video; default: one-field"),
            next(
                "orientation",
                "MF, MN, UF, UN, FM, NM, FU or NU",
                "directions of the video's first and second axis: M marked side, U unmarked side, F far from the \
                probe, N near to it; default: MF",
            ),
            next("buffers", "2 to 32", "number of frames that the kernel buffers; default: 6"),
            once("latency_ms", "-1000 to 1000", LATENCY),
        ],
    },
    Section {
        name: "pairing",
        about: "The assignment of poses to frames",
        keys: &[
            next("wait_ms", "0 to 10000", "longest time that a frame waits for poses around its time; default: 500"),
            next("longest_gap_ms", "1 to 10000", "longest time between two poses for interpolation; default: 100"),
        ],
    },
    Section {
        name: "scanner",
        about: "The ultrasound scanner",
        keys: &[
            once(
                "frozen_s",
                "0.05 to 60",
                "time of equal frames at changing poses after which the scanner counts as frozen; default: 0.5",
            ),
            next(
                "ruler",
                "{ px, mm }",
                "length along the scanner's depth ruler, at its present setting; presets of another depth are refused; \
                default: no comparison",
            ),
        ],
    },
    Section {
        name: "volume",
        about: "The volume that slices are inserted into; keys have the names of `reconstruct`'s flags",
        keys: &[
            next(
                "world",
                "a frame's name",
                "coordinate frame of the volume; default: Reference if a reference_station is given, else Tracker",
            ),
            next(
                "spacing_mm",
                "a number or [x, y, z]",
                "distance between voxels; default: the calibration file's, else 0.5",
            ),
            next(
                "origin_mm",
                "[x, y, z]",
                "world position of voxel (0, 0, 0); default: the lattice passes through the world's origin",
            ),
            next("path", "auto, general or planar", "insertion path of slices; default: auto"),
            next(
                "departure",
                "upgrade or refuse",
                "treatment of a frame that leaves a planar scan's plane; default: upgrade",
            ),
            next(
                "planar_tolerance_voxels",
                "0 or more",
                "largest distance of the image's corners from the plane; default: 0.25",
            ),
            next(
                "method",
                "gaussian, gaussian-truncated, bspline3, linear or nearest",
                "kernel; default: gaussian-truncated",
            ),
            next(
                "sigma_mm",
                "[u, v, normal]",
                "σ of the kernel; default: 0.75 × the larger of spacing and pixel in the plane, 1.0 across it",
            ),
            next(
                "hwhm_mm",
                "[u, v, normal]",
                "width of the kernel as half widths at half maximum, instead of sigma_mm",
            ),
            next(
                "support",
                "\"CRITERION=E\" or two of them",
                "end of a Gaussian kernel, in the plane and across it; default: energy=0.001,energy=0.01",
            ),
            next("max_weight", "1 to 1000000", "largest weight of a voxel, in slices at their peak; default: 256"),
            next(
                "compound",
                "mean, maximum, latest or decay",
                "compounding of slices that reach the same voxel; default: mean",
            ),
            next(
                "decay",
                "none, exp, dead-time or paper-literal",
                "fading of earlier slices with compound = \"decay\"; default: dead-time",
            ),
            next("decay_per_s", "0.000001 to 1000000", "rate of the fading; default: 1"),
            next("decay_wait_s", "0 to 1000000", "time before the fading begins; default: 2"),
            next(
                "threads",
                "1 to 1024",
                "number of threads that insert slices; any number gives the same volume; default: one a core",
            ),
            next("max_memory_gib", "above 0", "largest memory of the volume; default: 8"),
        ],
    },
    Section {
        name: "picture",
        about: "The picture that is rendered while the volume grows; keys have the names of `render`'s flags",
        keys: &[
            once("most_hz", "0.1 to 1000", "largest number of pictures a second; default: 30"),
            once("image_size", "\"WxH\" or [width, height]", "size in pixels; default: 512x512"),
            once(
                "view_deg",
                "[azimuth, elevation] or [azimuth, elevation, roll]",
                "direction of the view; default: obliquely from the deep side, with the probe on top",
            ),
            once(
                "perspective_deg",
                "above 0, up to 170",
                "angle of view along the shorter side; default: parallel rays",
            ),
            once("mode", "shaded, mip, average, iso or opacity", "rendering mode; default: shaded"),
            once(
                "isovalue",
                "a grey level",
                "grey level of the surface with mode = \"iso\"; default: halfway between black and white",
            ),
            once("shading", "voxel or sample", "values that the transfer function classifies; default: voxel"),
            once(
                "transfer",
                "a preset or a path ending in .toml",
                "opacity and colour of grey levels; default: tissue, for mip and average xray",
            ),
            once("window", "[black, white]", "grey levels that are drawn black and white; default: [0, 255]"),
            once("step_voxels", "above 0", "distance of samples along a ray; default: 1"),
            once(
                "arity",
                "1 or more",
                "number of samples that are combined at a time; default: near the square root of a ray's samples",
            ),
            once("stop", "0 to 1", "transparency below which a ray ends; default: 1/1024"),
            once(
                "adaptive",
                "0 to 1",
                "difference of the picture below which rays are left out; default: 0, no ray is left out",
            ),
            once("background", "[red, green, blue]", "colour behind the volume, each component 0 to 1; default: black"),
            once(
                "light",
                "\"headlight\" or [x, y, z]",
                "light at the observer, or the direction towards the light in the world; default: headlight",
            ),
            once("ambient", "0 to 1", "part of the light that comes from all sides; default: 0.3"),
            once("diffuse", "0 to 1", "part of the light that a surface scatters evenly; default: 0.7"),
            once("specular", "0 to 1", "part of the light that a surface reflects as a highlight; default: 0.2"),
            once("shininess", "1 or more", "exponent of the highlight; default: 16"),
            once("two_sided", "true or false", "true to light the backs of surfaces too; default: true"),
            once(
                "depth_cue",
                "[near, far]",
                "brightness of the nearest and the farthest sample; default: the same brightness at all depths",
            ),
            once(
                "cache",
                "two-level, linear, one-level or none",
                "kind of the ray cache; all give the same picture; default: two-level",
            ),
            once("cache_mib", "0 to 1048576", "largest memory of the ray cache; default: 256"),
            once(
                "draw",
                "a list of slice, probe, scale and cube",
                "annotations drawn over the picture; default: slice and probe",
            ),
            once(
                "threads",
                "1 to 1024",
                "number of threads that render; any number gives the same picture; default: one a core",
            ),
        ],
    },
    Section {
        name: "record",
        about: "The recording of a session; --record begins one too",
        keys: &[
            next(
                "folder",
                "a path, from this file's folder",
                "folder of recordings; default: no recording, except with --record",
            ),
            next(
                "full_frame",
                "true or false",
                "true to record whole video frames; pixels outside the scanner's image may show the patient's name; \
                default: false",
            ),
            once("keep_free_mb", "0 or more", "free space on the disk at which the recording ends; default: 1024"),
        ],
    },
    Section {
        name: "status",
        about: "The session's page, status and metrics, and access to them",
        keys: &[
            next(
                "listen",
                "\"ADDRESS:PORT\", such as \"127.0.0.1:9110\"",
                "address of the page, status and metrics; default: none. An address that other machines can reach \
                needs certificate, key and token_file",
            ),
            next(
                "certificate",
                "a path, from this file's folder",
                "the server's certificate as PEM, followed by intermediate certificates; the server then uses HTTPS; \
                default: plain HTTP",
            ),
            next(
                "key",
                "a path, from this file's folder",
                "the certificate's private key as PEM; only its owner and group may have permission to read it",
            ),
            next(
                "token_file",
                "a path, from this file's folder",
                "file with the access token: one line of 32 characters or more, readable by its owner only. Every \
                viewer and client must present the token; default: no token",
            ),
            next(
                "names",
                "a list of names or addresses",
                "further names of this machine, besides its own addresses and the certificate's names; default: none",
            ),
        ],
    },
    Section {
        name: "process",
        about: "The session's priority among the machine's programs",
        keys: &[next(
            "realtime",
            "if-permitted, never or required",
            "real-time priority for threads that receive data, and memory that is not paged out; default: \
            if-permitted. A virtual bedside does not use if-permitted; with required, the session does not begin \
            without permission",
        )],
    },
    Section {
        name: "virtual",
        about: "The virtual bedside, for devices that are \"virtual\": a simulated hand sweeps to and fro over a body",
        keys: &[
            next("scene", "a scene of `phantom`, such as doll", "scanned object; default: doll"),
            next("trajectory", "a trajectory of `phantom`, such as freehand", "motion of the probe; default: freehand"),
            next("frames", "2 to 100000", "number of video frames of a sweep in one direction; default: 300"),
            next(
                "gap_mm",
                "above 0",
                "mean distance between frames; default: 1 for a sweep round a point, the distance that covers a whole \
                body, else 0.35",
            ),
            next(
                "pixel_mm",
                "above 0",
                "size of a pixel; default: the size that shows the scanner's whole field, else 0.1",
            ),
            next("noise_sd", "0 or more", "noise of the frames, in grey levels; default: the usual noise of the scene"),
            next("tracker_noise_mm", "0 to 10", "noise of each tracker sensor along each axis; default: 0"),
            next("tracker_noise_deg", "0 to 10", "noise of each tracker sensor about each axis; default: 0"),
            next("seed", "0 to 4294967295", "seed of all random numbers; default: 1"),
            next(
                "painted",
                "true or false",
                "true to paint all frames of the sweep before the session begins, for measurements of their \
                processing; default: false",
            ),
        ],
    },
    Section {
        name: "virtual.line",
        about: "Faults between a virtual tracker or arm and the host; default: none",
        keys: &[
            LATE,
            JITTER,
            next(
                "packet_ms",
                "0 to 1000",
                "time between packets of bytes, as from an adapter that collects bytes; default: bytes arrive at once",
            ),
            DRIFT,
            next("drop", "0 to 1", "share of bytes that are lost on the line"),
            next("noise", "0 to 1", "share of bytes that arrive with another value"),
            DROPOUT,
        ],
    },
    Section {
        name: "virtual.grabber",
        about: "Faults of a virtual grabber; default: none",
        keys: &[LATE, JITTER, DRIFT, DROPOUT],
    },
];

const LATE: Key = next("latency_ms", "0 to 10000", "delay of all delivered data");
const JITTER: Key = next("jitter_ms", "0 to 10000", "largest additional delay, random for each delivery");
const DRIFT: Key = next("drift_ppm", "-10000 to 10000", "deviation of its clock's rate; positive for a faster clock");
const DROPOUT: Key = next("dropout", "0 to 1", "share of readings or frames that are never sent");
