//! The messages of a session: names and numbers of their fields, and the descriptors in the
//! file by which any MCAP reader can decode them. `schemas/` declares them, as for protoc.
//!
//! Frames and poses are Foxglove's messages. Their fields have numbers below 100; Foxglove has
//! begun to use 100 and 101 itself. Exact values are added from `OWN` on; other programs
//! ignore them. The other messages belong to a package whose name has the version. A field
//! number never changes its meaning. prost-reflect would need a build script that compiles the
//! declarations; here, a line is a field.

use crate::session::proto::Fields;

/// First number of the project's own fields.
pub(super) const OWN: u32 = 1000;
/// Version of the messages, stored in the first own field of each.
pub(super) const VERSION: u64 = 1;

/// A message type.
#[derive(Debug)]
pub struct Schema {
    /// Name with the package.
    pub name: &'static str,
    /// Name of the file that declares it.
    file: &'static str,
}

macro_rules! files {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("schemas/", $name)))),*] };
}

/// Names and texts of the declarations.
static FILES: [(&str, &str); 8] = files![
    "google/protobuf/timestamp.proto",
    "sonoweave/v1/common.proto",
    "sonoweave/v1/session.proto",
    "foxglove/CompressedImage.proto",
    "foxglove/Vector3.proto",
    "foxglove/Quaternion.proto",
    "foxglove/Pose.proto",
    "foxglove/PoseInFrame.proto",
];

macro_rules! schemas {
    ($($id:ident = $name:literal in $file:literal;)*) => {
        $(#[doc = concat!("Schema of `", $name, "` messages.")]
        pub static $id: Schema = Schema { name: $name, file: $file };)*
        /// All schemas.
        pub(super) static ALL: &[&Schema] = &[$(&$id),*];
    };
}

schemas! {
    SESSION = "sonoweave.v1.Session" in "sonoweave/v1/session.proto";
    DEVICE = "sonoweave.v1.Device" in "sonoweave/v1/session.proto";
    RAW = "sonoweave.v1.Raw" in "sonoweave/v1/session.proto";
    COUNTS = "sonoweave.v1.Counts" in "sonoweave/v1/session.proto";
    TRANSFORM = "sonoweave.v1.Transform" in "sonoweave/v1/session.proto";
    NOTE = "sonoweave.v1.Note" in "sonoweave/v1/session.proto";
    LOSS = "sonoweave.v1.Loss" in "sonoweave/v1/session.proto";
    FRAME = "foxglove.CompressedImage" in "foxglove/CompressedImage.proto";
    POSE_OF_STATION = "foxglove.PoseInFrame" in "foxglove/PoseInFrame.proto";
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

/// Returns what stands between two words, for each line that begins and ends with them.
fn between<'a>(text: &'a str, begin: &'a str, end: &'a str) -> impl Iterator<Item = &'a str> {
    text.lines().filter_map(move |line| line.strip_prefix(begin)?.strip_suffix(end))
}

/// Adds a file, after those that it depends on, unless it is present.
fn add(name: &'static str, set: &mut Vec<u8>, done: &mut Vec<&'static str>) {
    let Some((_, text)) = FILES.iter().find(|(file, _)| *file == name && !done.contains(file)) else { return };
    let needed = || between(text, "import \"", "\";");
    needed().for_each(|needed| add(needed, set, done));
    done.push(name);
    Fields::to(set).message(1, |out| {
        out.text(1, name);
        between(text, "package ", ";").for_each(|package| out.text(2, package));
        needed().for_each(|needed| out.text(3, needed));
        for message in text.split("\nmessage ").skip(1) {
            out.message(4, |out| describe(message, out));
        }
        out.text(12, "proto3");
    });
}

/// Writes a `DescriptorProto`.
fn describe(message: &str, out: &mut Fields<'_>) {
    let (name, body) = message.split_once(" {\n").unwrap_or_default();
    out.text(1, name);
    let mut optional = Vec::new();
    for (label, kind, field, number) in between(body, "  ", ";").filter_map(declared) {
        out.message(2, |out| {
            out.text(1, field);
            out.uint(3, number);
            out.uint(4, if label == "repeated" { 3 } else { 1 });
            out.uint(5, number_of(kind));
            if kind.starts_with('.') {
                out.text(6, kind);
            }
            if label == "optional" {
                // In proto3, presence is expressed as a choice of one.
                out.uint(9, optional.len() as u64);
                out.uint(17, 1);
                optional.push(field);
            }
        });
    }
    optional.iter().for_each(|field| out.message(8, |out| out.text(1, &format!("_{field}"))));
}

/// Returns label, type, name and number of a field.
fn declared(line: &str) -> Option<(&str, &str, &str, u64)> {
    let (field, number) = line.split_once(" = ")?;
    let (kind, name) = field.rsplit_once(' ')?;
    let (label, kind) = kind.split_once(' ').unwrap_or(("", kind));
    Some((label, kind, name, number.parse().ok()?))
}

/// Returns the number in `FieldDescriptorProto.Type`.
fn number_of(kind: &str) -> u64 {
    match kind {
        "double" => 1,
        "int64" => 3,
        "uint64" => 4,
        "int32" => 5,
        "string" => 9,
        "bytes" => 12,
        "uint32" => 13,
        "sfixed64" => 16,
        "sint32" => 17,
        "sint64" => 18,
        // A message.
        _ => 11,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schemas_name_messages_and_use_numbers_once() {
        for schema in ALL {
            let (package, name) = schema.name.rsplit_once('.').unwrap();
            let (_, text) = FILES.iter().find(|(file, _)| *file == schema.file).unwrap();
            assert!(between(text, "package ", ";").eq([package]));
            assert!(text.contains(&format!("\nmessage {name} {{\n")), "{name}");
            assert!(std::ptr::eq(Schema::of(schema.name).unwrap(), *schema));
        }
        for message in FILES.iter().flat_map(|(_, text)| text.split("\nmessage ").skip(1)) {
            let (_, body) = message.split_once(" {\n").unwrap();
            let fields: Vec<_> = between(body, "  ", ";").map(|line| declared(line).unwrap()).collect();
            // Each line is a field, up to the brace.
            assert_eq!(body.trim_end().lines().count(), fields.len() + 1, "{message}");
            let mut numbers: Vec<u64> = fields.iter().map(|(_, _, _, number)| *number).collect();
            numbers.sort_unstable();
            numbers.dedup();
            assert_eq!(numbers.len(), fields.len(), "{message}");
            // These numbers are reserved by Protocol Buffers.
            assert!(numbers.iter().all(|n| !(19_000..20_000).contains(n)));
            for (label, kind, ..) in fields {
                assert!(["", "optional", "repeated"].contains(&label), "{label}");
                assert_eq!(number_of(kind) == 11, kind.starts_with('.'), "{kind}");
            }
        }
        assert!(Schema::of("foxglove.Log").is_none());
    }

    #[test]
    fn descriptors_of_written_sessions_stay_the_same() {
        let sums = [&SESSION, &FRAME, &POSE_OF_STATION].map(|schema| crc32fast::hash(&schema.descriptors()));
        assert_eq!(sums, [0xdc8e_3cde, 0x023d_3e3f, 0x3ada_1a34]);
    }
}
