"""Writes foxglove.RawImage messages and nothing else with the Python mcap library."""

import sys

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from mcap.writer import Writer

path = sys.argv[1]
with open(path + ".schema", "rb") as file:
    schema = file.read()
pool = descriptor_pool.DescriptorPool()
for definition in descriptor_pb2.FileDescriptorSet.FromString(schema).file:
    pool.Add(definition)
RawImage = message_factory.GetMessageClass(pool.FindMessageTypeByName("foxglove.RawImage"))

with open(path, "wb") as file:
    writer = Writer(file)
    writer.start()
    schema_id = writer.register_schema("foxglove.RawImage", "protobuf", schema)
    channel_id = writer.register_channel("/image", "protobuf", schema_id)
    for index in range(5):
        pixels = bytes((k * 7 + index * 13) % 256 for k in range(24))
        image = RawImage(width=6, height=4, encoding="mono8", step=6, data=pixels)
        stamp = 2_000_000_000 + index * 1_000_000
        writer.add_message(channel_id, stamp, image.SerializeToString(), stamp, index)
    writer.finish()
