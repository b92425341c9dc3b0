"""Prints the content of a recording, read with the Python mcap library alone."""

import json
import struct
import sys
import zlib

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    for attachment in reader.iter_attachments():
        if attachment.name == "config.toml":
            print("config.toml", json.dumps(attachment.data.decode()))
    for record in reader.iter_metadata():
        if record.name == "ricochet":
            print("metadata", record.metadata["camera"], record.metadata["body.0"])
    for _, _, message, image in reader.iter_decoded_messages(topics=["/camera/image"]):
        assert image.timestamp.ToNanoseconds() == message.log_time
        size = f"{image.width}x{image.height} {image.encoding} step {image.step}"
        print("image", message.log_time, size, len(image.data), "bytes", f"{zlib.crc32(image.data):08x}")
    for _, _, message, row in reader.iter_decoded_messages(topics=["/velocity"]):
        bits = struct.pack(">d", row.vx_m_s).hex() if row.HasField("vx_m_s") else "none"
        assert row.stamp_ns == message.log_time
        print("velocity", row.frame, row.stamp_ns, bits, row.status)
    for _, _, _, row in reader.iter_decoded_messages(topics=["/field"]):
        if row.frame == 0:
            print("field", len(row.x_px), "points", sum(u == u for u in row.u_px), "measured")
    for _, _, _, row in reader.iter_decoded_messages(topics=["/impact"]):
        deepest_s = row.deepest_s if row.HasField("deepest_s") else None
        print("impact", row.start_s, row.sigma_start_s, deepest_s)
