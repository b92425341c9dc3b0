"""Prints every frame and every velocity of a recording, read by the Python mcap library alone."""

import json
import struct
import sys
import zlib

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

COLUMNS = """center_x_px center_y_px radius_px dx_px dy_px dtheta_deg sigma_dx_px sigma_dy_px sigma_dtheta_deg
    vx_m_s vy_m_s vn_m_s vt_m_s omega_rad_s sigma_v_m_s sigma_omega_rad_s visible_fraction""".split()


def bits(row, column):
    return struct.pack(">d", getattr(row, column)).hex() if row.HasField(column) else None


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
    attached = [record.data.decode() for record in reader.iter_attachments() if record.name == "config.toml"]
    images = []
    for _, _, message, image in reader.iter_decoded_messages(topics=["/camera/image"]):
        assert image.timestamp.ToNanoseconds() == message.log_time
        images.append([message.log_time, image.width, image.height, image.step, zlib.crc32(image.data)])
    rows = []
    for _, _, _, row in reader.iter_decoded_messages(topics=["/velocity"]):
        numbers = {column: bits(row, column) for column in COLUMNS}
        rows.append({"stamp_ns": row.stamp_ns, "phase": row.phase, "status": row.status, "numbers": numbers})
print(json.dumps({"config": attached, "images": images, "rows": rows}))
