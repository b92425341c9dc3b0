// Prints a recording as read by the packages of the Foxglove viewers: images, velocities, attachments, metadata.
"use strict";
const fs = require("fs");
const { McapIndexedReader } = require("@mcap/core");
const { loadDecompressHandlers, protobufFromBinaryDescriptor } = require("@mcap/support");
const { foxgloveMessageSchemas } = require("@foxglove/schemas/internal");

async function main(path) {
  const file = fs.openSync(path, "r");
  const readable = {
    size: async () => BigInt(fs.fstatSync(file).size),
    read: async (offset, length) => {
      const bytes = new Uint8Array(Number(length));
      fs.readSync(file, bytes, 0, Number(length), Number(offset));
      return bytes;
    },
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });
  for await (const attachment of reader.readAttachments()) {
    console.log("attachment", attachment.name, Buffer.from(attachment.data).length);
  }
  for await (const metadata of reader.readMetadata()) {
    console.log("metadata", metadata.name, metadata.metadata.get("camera"));
  }
  const types = new Map();
  for (const channel of reader.channelsById.values()) {
    const schema = reader.schemasById.get(channel.schemaId);
    const type = protobufFromBinaryDescriptor(schema.data).lookupType(schema.name);
    types.set(channel.id, { topic: channel.topic, type, name: schema.name });
  }
  const raw = [...types.values()].find(({ name }) => name === "foxglove.RawImage").type;
  const known = foxgloveMessageSchemas.RawImage.fields.map((field) => field.name).sort();
  console.log("fields", known.join() === Object.keys(raw.fields).sort().join());
  for await (const message of reader.readMessages({ topics: ["/camera/image", "/velocity"] })) {
    const { topic, type } = types.get(message.channelId);
    const value = type.toObject(type.decode(message.data), { longs: String });
    if (topic === "/camera/image") {
      const size = `${value.width}x${value.height} ${value.encoding} step ${value.step}`;
      console.log("image", String(message.logTime), size, value.data.length, "bytes", crc32(value.data));
    } else {
      const speed = value.vx_m_s ?? value.vxMS;
      const bits = Buffer.alloc(8);
      bits.writeDoubleBE(speed ?? 0);
      const shown = speed === undefined ? "none" : bits.toString("hex");
      console.log("velocity", value.frame ?? 0, String(message.logTime), shown, value.status);
    }
  }
}

function crc32(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) {
      crc = (crc >>> 1) ^ (crc & 1 ? 0xedb88320 : 0);
    }
  }
  return ((crc ^ 0xffffffff) >>> 0).toString(16).padStart(8, "0");
}

main(process.argv[1]).catch((error) => {
  console.error(error);
  process.exit(1);
});
