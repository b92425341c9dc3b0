"""Prints a recording as loaded by Rerun: images as its Image, rows as their messages."""

import struct
import sys
import zlib

from rerun.chunk import McapReader

GREY, BYTE = 1, 6

for chunk in McapReader(sys.argv[1], include_topic_regex=["^/camera/image$", "^/velocity$"]).stream().to_chunks():
    if chunk.is_static:
        continue
    batch = chunk.to_record_batch()
    stamps = [stamp.value for stamp in batch.column("message_log_time")]
    if chunk.entity_path == "/camera/image":
        for stamp, pixels, shape in zip(stamps, batch.column("Image:buffer"), batch.column("Image:format")):
            shape, pixels = shape.as_py()[0], bytes(pixels[0].as_py())
            assert (shape["color_model"], shape["channel_datatype"]) == (GREY, BYTE), shape
            size = f"{shape['width']}x{shape['height']}"
            print("image", stamp, size, len(pixels), "bytes", f"{zlib.crc32(pixels):08x}")
    if chunk.entity_path == "/velocity":
        for stamp, rows in zip(stamps, batch.column("ricochet.Velocity:message")):
            row = rows.as_py()[0]
            bits = "none" if row["vx_m_s"] is None else struct.pack(">d", row["vx_m_s"]).hex()
            assert row["stamp_ns"] == stamp
            print("velocity", row["frame"], stamp, bits, row["status"])
