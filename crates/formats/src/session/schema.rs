//! The messages of a session: names and numbers of their fields, and the descriptors in the
//! file by which any MCAP reader can decode them.
//!
//! Frames and poses are Foxglove's messages. Their fields have numbers below 100; Foxglove has
//! begun to use 100 and 101 itself. Exact values are added from `OWN` on; other programs
//! ignore them. The other messages belong to a package whose name has the version. A field
//! number never changes its meaning. prost-reflect would replace only the last 60 lines; its
//! descriptors come from files that a build script has to compile.

use crate::session::proto::Fields;

/// First number of the project's own fields.
pub(super) const OWN: u32 = 1000;
/// Version of the messages, stored in the first own field of each.
pub(super) const VERSION: u64 = 1;

/// Type of a field.
#[derive(Clone, Copy)]
enum Kind {
    Double,
    Int64,
    Uint64,
    Int32,
    Text,
    Bytes,
    Uint32,
    Fixed64,
    Sint32,
    Sint64,
    Message(&'static str),
}

/// Presence of a field.
#[derive(Clone, Copy, PartialEq)]
enum Times {
    /// Once; omitted if it is 0 or empty.
    Once,
    /// Once or absent; absent differs from 0.
    Perhaps,
    Many,
}

struct Field {
    name: &'static str,
    number: u32,
    kind: Kind,
    times: Times,
}

const fn one(name: &'static str, number: u32, kind: Kind) -> Field {
    Field { name, number, kind, times: Times::Once }
}

const fn perhaps(name: &'static str, number: u32, kind: Kind) -> Field {
    Field { name, number, kind, times: Times::Perhaps }
}

const fn many(name: &'static str, number: u32, kind: Kind) -> Field {
    Field { name, number, kind, times: Times::Many }
}

struct Message {
    name: &'static str,
    fields: &'static [Field],
}

struct File {
    name: &'static str,
    package: &'static str,
    needs: &'static [&'static File],
    messages: &'static [Message],
}

/// A message type.
pub struct Schema {
    /// Name with the package.
    pub name: &'static str,
    file: &'static File,
}

impl std::fmt::Debug for Schema {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name)
    }
}

const VERSION_FIELD: Field = one("version", OWN, Kind::Uint32);
const STAMP_FIELD: Field = one("stamp", OWN + 1, Kind::Message(".sonoweave.v1.Stamp"));
const STATUS_FIELD: Field = perhaps("status", OWN + 2, Kind::Text);

static TIMESTAMP: File = File {
    name: "google/protobuf/timestamp.proto",
    package: "google.protobuf",
    needs: &[],
    messages: &[Message { name: "Timestamp", fields: &[one("seconds", 1, Kind::Int64), one("nanos", 2, Kind::Int32)] }],
};

static COMMON: File = File {
    name: "sonoweave/v1/common.proto",
    package: "sonoweave.v1",
    needs: &[],
    messages: &[
        Message {
            name: "Stamp",
            fields: &[
                one("item", 1, Kind::Uint64),
                perhaps("host_ns", 2, Kind::Fixed64),
                perhaps("ticks", 3, Kind::Uint64),
                perhaps("source_s", 4, Kind::Double),
                perhaps("unfiltered_s", 5, Kind::Double),
            ],
        },
        Message { name: "NamedText", fields: &[one("name", 1, Kind::Text), one("text", 2, Kind::Text)] },
    ],
};

static IMAGE: File = File {
    name: "foxglove/CompressedImage.proto",
    package: "foxglove",
    needs: &[&TIMESTAMP, &COMMON],
    messages: &[Message {
        name: "CompressedImage",
        fields: &[
            one("timestamp", 1, Kind::Message(".google.protobuf.Timestamp")),
            one("data", 2, Kind::Bytes),
            one("format", 3, Kind::Text),
            one("frame_id", 4, Kind::Text),
            VERSION_FIELD,
            STAMP_FIELD,
            STATUS_FIELD,
            perhaps("frame_number", 1003, Kind::Uint64),
            one("full_width", 1004, Kind::Uint32),
            one("full_height", 1005, Kind::Uint32),
            one("left", 1006, Kind::Uint32),
            one("top", 1007, Kind::Uint32),
            one("width", 1008, Kind::Uint32),
            one("height", 1009, Kind::Uint32),
            one("channels", 1010, Kind::Uint32),
            one("pixel", 1011, Kind::Text),
            one("orientation", 1012, Kind::Text),
            one("image_type", 1013, Kind::Text),
            many("fields", 1014, Kind::Message(".sonoweave.v1.NamedText")),
        ],
    }],
};

static VECTOR: File = File {
    name: "foxglove/Vector3.proto",
    package: "foxglove",
    needs: &[],
    messages: &[Message {
        name: "Vector3",
        fields: &[one("x", 1, Kind::Double), one("y", 2, Kind::Double), one("z", 3, Kind::Double)],
    }],
};

static QUATERNION: File = File {
    name: "foxglove/Quaternion.proto",
    package: "foxglove",
    needs: &[],
    messages: &[Message {
        name: "Quaternion",
        fields: &[
            one("x", 1, Kind::Double),
            one("y", 2, Kind::Double),
            one("z", 3, Kind::Double),
            one("w", 4, Kind::Double),
        ],
    }],
};

static POSE: File = File {
    name: "foxglove/Pose.proto",
    package: "foxglove",
    needs: &[&VECTOR, &QUATERNION],
    messages: &[Message {
        name: "Pose",
        fields: &[
            one("position", 1, Kind::Message(".foxglove.Vector3")),
            one("orientation", 2, Kind::Message(".foxglove.Quaternion")),
        ],
    }],
};

static POSE_IN_FRAME: File = File {
    name: "foxglove/PoseInFrame.proto",
    package: "foxglove",
    needs: &[&TIMESTAMP, &POSE, &COMMON],
    messages: &[Message {
        name: "PoseInFrame",
        fields: &[
            one("timestamp", 1, Kind::Message(".google.protobuf.Timestamp")),
            one("frame_id", 2, Kind::Text),
            one("pose", 3, Kind::Message(".foxglove.Pose")),
            VERSION_FIELD,
            STAMP_FIELD,
            STATUS_FIELD,
            one("station", 1003, Kind::Uint32),
            many("position_cm", 1004, Kind::Double),
            many("quaternion_wxyz", 1005, Kind::Double),
            one("buttons", 1006, Kind::Uint32),
            perhaps("distortion", 1007, Kind::Sint32),
            perhaps("code", 1008, Kind::Uint32),
        ],
    }],
};

static OWN_MESSAGES: File = File {
    name: "sonoweave/v1/session.proto",
    package: "sonoweave.v1",
    needs: &[&COMMON],
    messages: &[
        Message {
            name: "Session",
            fields: &[
                one("monotonic_ns", 1, Kind::Fixed64),
                one("realtime_ns", 2, Kind::Fixed64),
                one("program", 3, Kind::Text),
                VERSION_FIELD,
            ],
        },
        Message {
            name: "Device",
            fields: &[
                one("name", 1, Kind::Text),
                one("protocol", 2, Kind::Text),
                many("settings", 3, Kind::Message(".sonoweave.v1.NamedText")),
                one("source", 4, Kind::Text),
                perhaps("items", 5, Kind::Uint64),
                many("image_size", 6, Kind::Uint32),
                one("pixel", 7, Kind::Text),
                one("channels", 8, Kind::Uint32),
                many("fields", 9, Kind::Message(".sonoweave.v1.NamedText")),
                one("ticks", 10, Kind::Text),
                perhaps("tick_hz", 11, Kind::Double),
                perhaps("wraps_at", 12, Kind::Uint64),
                perhaps("rate_hz", 13, Kind::Double),
                one("sampling_ns", 14, Kind::Sint64),
                one("wire_ns", 15, Kind::Sint64),
                VERSION_FIELD,
            ],
        },
        Message {
            name: "Raw",
            fields: &[one("line", 1, Kind::Uint32), one("bytes", 2, Kind::Bytes), VERSION_FIELD, STAMP_FIELD],
        },
        Message {
            name: "Counts",
            fields: &[
                one("first", 1, Kind::Uint32),
                one("axes", 2, Kind::Uint32),
                many("counts", 3, Kind::Sint64),
                one("homed", 4, Kind::Uint32),
                one("buttons", 5, Kind::Uint32),
                VERSION_FIELD,
                STAMP_FIELD,
                STATUS_FIELD,
            ],
        },
        Message {
            name: "Transform",
            fields: &[
                one("from", 1, Kind::Text),
                one("to", 2, Kind::Text),
                many("matrix", 3, Kind::Double),
                VERSION_FIELD,
                STAMP_FIELD,
                STATUS_FIELD,
            ],
        },
        Message {
            name: "Note",
            fields: &[one("kind", 1, Kind::Text), one("text", 2, Kind::Text), VERSION_FIELD, STAMP_FIELD],
        },
        Message {
            name: "Loss",
            fields: &[
                one("from_ns", 1, Kind::Fixed64),
                one("until_ns", 2, Kind::Fixed64),
                one("why", 3, Kind::Text),
                many("lost", 4, Kind::Message(".sonoweave.v1.Lost")),
                VERSION_FIELD,
            ],
        },
        Message {
            name: "Lost",
            fields: &[one("topic", 1, Kind::Text), one("messages", 2, Kind::Uint64), one("bytes", 3, Kind::Uint64)],
        },
    ],
};

macro_rules! schemas {
    ($($id:ident = $name:literal in $file:ident;)*) => {
        $(#[doc = concat!("Schema of `", $name, "` messages.")]
        pub static $id: Schema = Schema { name: $name, file: &$file };)*
        /// All schemas.
        pub(super) static ALL: &[&Schema] = &[$(&$id),*];
    };
}

schemas! {
    SESSION = "sonoweave.v1.Session" in OWN_MESSAGES;
    DEVICE = "sonoweave.v1.Device" in OWN_MESSAGES;
    RAW = "sonoweave.v1.Raw" in OWN_MESSAGES;
    COUNTS = "sonoweave.v1.Counts" in OWN_MESSAGES;
    TRANSFORM = "sonoweave.v1.Transform" in OWN_MESSAGES;
    NOTE = "sonoweave.v1.Note" in OWN_MESSAGES;
    LOSS = "sonoweave.v1.Loss" in OWN_MESSAGES;
    FRAME = "foxglove.CompressedImage" in IMAGE;
    POSE_OF_STATION = "foxglove.PoseInFrame" in POSE_IN_FRAME;
}

impl Schema {
    /// Returns the schema of that name, if there is one.
    pub(super) fn of(name: &str) -> Option<&'static Self> {
        ALL.iter().find(|schema| schema.name == name).copied()
    }

    /// Returns a `FileDescriptorSet`: the file with the message, after the files that it
    /// depends on.
    pub(super) fn descriptors(&self) -> Vec<u8> {
        let (mut set, mut done) = (Vec::new(), Vec::new());
        add(self.file, &mut set, &mut done);
        set
    }
}

/// Adds a file, after those that it depends on, unless it is present.
fn add(file: &File, set: &mut Vec<u8>, done: &mut Vec<&'static str>) {
    if done.contains(&file.name) {
        return;
    }
    file.needs.iter().for_each(|needed| add(needed, set, done));
    done.push(file.name);
    Fields::to(set).message(1, |out| {
        out.text(1, file.name);
        out.text(2, file.package);
        file.needs.iter().for_each(|needed| out.text(3, needed.name));
        for message in file.messages {
            out.message(4, |out| describe(message, out));
        }
        out.text(12, "proto3");
    });
}

/// Writes a `DescriptorProto`.
fn describe(message: &Message, out: &mut Fields<'_>) {
    out.text(1, message.name);
    let mut choices = 0;
    for field in message.fields {
        out.message(2, |out| {
            out.text(1, field.name);
            out.uint(3, field.number.into());
            out.uint(4, if field.times == Times::Many { 3 } else { 1 });
            out.uint(5, number_of(field.kind));
            if let Kind::Message(name) = field.kind {
                out.text(6, name);
            }
            if field.times == Times::Perhaps {
                // In proto3, presence is expressed as a choice of one.
                out.uint(9, choices);
                out.uint(17, 1);
                choices += 1;
            }
        });
    }
    for field in message.fields.iter().filter(|field| field.times == Times::Perhaps) {
        out.message(8, |out| out.text(1, &format!("_{}", field.name)));
    }
}

/// Returns the number in `FieldDescriptorProto.Type`.
const fn number_of(kind: Kind) -> u64 {
    match kind {
        Kind::Double => 1,
        Kind::Int64 => 3,
        Kind::Uint64 => 4,
        Kind::Int32 => 5,
        Kind::Text => 9,
        Kind::Message(_) => 11,
        Kind::Bytes => 12,
        Kind::Uint32 => 13,
        // sfixed64
        Kind::Fixed64 => 16,
        Kind::Sint32 => 17,
        Kind::Sint64 => 18,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schemas_name_messages_and_use_numbers_once() {
        for schema in ALL {
            let (package, name) = schema.name.rsplit_once('.').unwrap();
            assert_eq!(schema.file.package, package);
            assert!(schema.file.messages.iter().any(|message| message.name == name), "{name}");
            assert!(std::ptr::eq(Schema::of(schema.name).unwrap(), *schema));
            for message in schema.file.messages {
                let mut numbers: Vec<u32> = message.fields.iter().map(|field| field.number).collect();
                numbers.sort_unstable();
                numbers.dedup();
                assert_eq!(numbers.len(), message.fields.len(), "{}", message.name);
                // These numbers are reserved by Protocol Buffers.
                assert!(numbers.iter().all(|n| !(19_000..20_000).contains(n)));
            }
        }
        assert!(Schema::of("foxglove.Log").is_none());
    }
}
