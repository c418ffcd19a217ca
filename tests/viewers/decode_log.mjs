// Reads a log with @mcap/core's indexed reader and protobufjs, and prints what it saw as JSON:
// topic -> {messages, log_times: [first, last], fields: {name: [every value]}}.
//
//     node decode_log.mjs FOLDER_WITH_NODE_MODULES LOG.mcap

import { open } from "node:fs/promises";
import { createRequire } from "node:module";
import path from "node:path";

const [folder, log] = process.argv.slice(2);
const require = createRequire(path.resolve(folder, "package.json"));
const { McapIndexedReader } = require("@mcap/core");
const { decompress } = require("fzstd");
const protobuf = require("protobufjs");
require("protobufjs/ext/descriptor");

const file = await open(log);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, size) => {
    const buffer = new Uint8Array(Number(size));
    await file.read(buffer, 0, Number(size), Number(offset));
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (data) => decompress(data) },
});

const types = new Map();
for (const channel of reader.channelsById.values()) {
  const schema = reader.schemasById.get(channel.schemaId);
  const root = protobuf.Root.fromDescriptor(
    require("protobufjs/ext/descriptor").FileDescriptorSet.decode(schema.data),
  );
  types.set(channel.id, root.lookupType(schema.name));
}

const seen = {};
for await (const message of reader.readMessages()) {
  const { topic } = reader.channelsById.get(message.channelId);
  const type = types.get(message.channelId);
  const body = type.toObject(type.decode(message.data), { defaults: true });
  const entry = (seen[topic] ??= { messages: 0, log_times: [], fields: {} });
  entry.messages += 1;
  entry.log_times[entry.messages === 1 ? 0 : 1] = String(message.logTime);
  for (const [name, value] of Object.entries(body)) {
    (entry.fields[name] ??= []).push(value);
  }
}
const metadata = {};
for await (const record of reader.readMetadata()) {
  Object.assign((metadata[record.name] ??= {}), Object.fromEntries(record.metadata));
}
const attachments = {};
for await (const record of reader.readAttachments()) {
  attachments[record.name] = record.data.length;
}
process.stdout.write(JSON.stringify({ topics: seen, metadata, attachments }));
