"""Copies the images of a recording, and nothing else, into a file of the Python mcap library."""

import sys

from mcap.reader import make_reader
from mcap.writer import Writer
from mcap_protobuf.decoder import DecoderFactory

with open(sys.argv[1], "rb") as source, open(sys.argv[2], "wb") as target:
    writer = Writer(target)
    writer.start()
    channel = None
    reader = make_reader(source, decoder_factories=[DecoderFactory()])
    for schema, _, message, image in reader.iter_decoded_messages(topics=["/camera/image"]):
        if channel is None:
            copy = writer.register_schema(schema.name, "protobuf", schema.data)
            channel = writer.register_channel("/film", "protobuf", copy)
        fields = {name: getattr(image, name) for name in ("width", "height", "encoding", "step", "data")}
        data = type(image)(timestamp=image.timestamp, **fields).SerializeToString()
        writer.add_message(channel, message.log_time, data, message.publish_time)
    writer.finish()
