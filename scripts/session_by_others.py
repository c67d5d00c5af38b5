#!/usr/bin/env python3
"""Reads a session with the tools of others, in the environment of `make interop`:

    out/interop/bin/python scripts/session_by_others.py out/session-bench.mcap

The independent reader `mcap` compares every chunk's checksum. Every message is decoded by the
descriptors in the file. Messages of Foxglove's schemas are compared field by field with Foxglove's
own, and decoded by Foxglove's own classes, which must find the same picture and pose.
"""
import io
import sys
from collections import Counter

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from PIL import Image

OWN = 1000
THEIRS = {"foxglove.CompressedImage": CompressedImage, "foxglove.PoseInFrame": PoseInFrame}


def fields(message):
    """Returns name, type, label and message type of each field by number."""
    return {f.number: (f.name, f.type, f.label, f.type_name) for f in message.field}


def compare(schema):
    """Compares Foxglove's fields with the file's descriptors; returns their number."""
    described = {}
    for file in FileDescriptorSet.FromString(schema.data).file:
        for message in file.message_type:
            described[f"{file.package}.{message.name}"] = fields(message)
    compared, to_do, done = 0, [THEIRS[schema.name].DESCRIPTOR], set()
    while to_do:
        theirs = to_do.pop()
        if theirs.full_name in done:
            continue
        done.add(theirs.full_name)
        ours = described[theirs.full_name]
        for field in theirs.fields:
            name, kind, label, type_name = ours[field.number]
            many = field.is_repeated if hasattr(field, "is_repeated") else field.label == 3
            assert (name, kind, label == 3) == (field.name, field.type, many), (schema.name, field.name)
            if field.message_type is not None:
                assert type_name == "." + field.message_type.full_name
                to_do.append(field.message_type)
            compared += 1
        extra = set(ours) - {f.number for f in theirs.fields}
        assert all(number >= OWN for number in extra), (theirs.full_name, extra)
    return compared


def main(path):
    topics, compared, last = Counter(), {}, 0
    with open(path, "rb") as stream:
        reader = make_reader(stream, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        for schema in summary.schemas.values():
            if schema.name in THEIRS:
                compared[schema.name] = compare(schema)
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            topics[f"{channel.topic} ({schema.name})"] += 1
            assert message.log_time >= last, "times go back"
            last = message.log_time
            if schema.name not in THEIRS:
                continue
            theirs = THEIRS[schema.name].FromString(message.data)
            stamp = theirs.timestamp.seconds * 10**9 + theirs.timestamp.nanos
            assert stamp == message.publish_time == decoded.stamp.host_ns, "a stamp that is another"
            if schema.name == "foxglove.CompressedImage":
                assert (theirs.format, theirs.frame_id) == ("png", "Image")
                if topics[f"{channel.topic} ({schema.name})"] % 50 == 1:
                    picture = Image.open(io.BytesIO(theirs.data))
                    picture.load()
                    assert picture.mode == "L" and picture.size == (decoded.width, decoded.height)
            else:
                place = theirs.pose.position
                for metres, centimetres in zip((place.x, place.y, place.z), decoded.position_cm):
                    assert abs(metres * 100 - centimetres) < 1e-9
                turn = theirs.pose.orientation
                assert [turn.w, turn.x, turn.y, turn.z] == list(decoded.quaternion_wxyz)
                assert theirs.frame_id == "Tracker"
        metadata = [m.metadata for m in reader.iter_metadata()]
    for topic, count in sorted(topics.items()):
        print(f"{count:7} {topic}")
    assert summary.statistics.message_count == sum(topics.values())
    for name, count in compared.items():
        print(f"{name}: {count} fields as Foxglove has them")
    print(f"{summary.statistics.chunk_count} chunks, checksums compared; metadata {metadata}")


if __name__ == "__main__":
    main(sys.argv[1])
