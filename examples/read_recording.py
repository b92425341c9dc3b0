"""Prints the velocities of a recording. Needs: pip install mcap mcap-protobuf-support"""

import sys

from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, decoder_factories=[DecoderFactory()])
    for _, _, _, row in reader.iter_decoded_messages(topics=["/velocity"]):
        if row.HasField("vn_m_s"):
            print(row.frame, row.vn_m_s, row.vt_m_s, row.omega_rad_s)
