// What Foxglove's own client library makes of the bridge while a job runs.
import assert from "node:assert/strict";
import { createFileRegistry, fromBinary } from "@bufbuild/protobuf";
import { FileDescriptorSetSchema } from "@bufbuild/protobuf/wkt";
import protocol from "@foxglove/ws-protocol";
import WebSocket from "ws";

const { FoxgloveClient } = protocol;
const [bridge, daemon] = process.argv.slice(2);
const PATIENCE_MS = 120_000;
const WANTED = [
  "/camera/picture",
  "/camera/annotations",
  "/bench/transform",
  "/bench/pose",
  "/job/measurement",
  "/job/decision",
  "/log",
  "/meter/reading",
];

const call = async (path, body, headers = {}) => {
  const answer = await fetch(`${daemon}${path}`, {
    method: "POST",
    headers: {
      authorization: `Bearer ${process.env.PLENALIGN_TOKEN}`,
      "content-type": "application/json",
      ...headers,
    },
    body: JSON.stringify(body),
  });
  assert.ok(answer.ok, `${path}: ${answer.status} ${await answer.clone().text()}`);
  return answer.json();
};

const late = setTimeout(() => {
  console.error(`after ${PATIENCE_MS} ms nothing came on ${WANTED.filter((topic) => !seen.has(topic))}`);
  process.exit(1);
}, PATIENCE_MS);

const seen = new Map();
const types = new Map();
const subscriptions = new Map();
let server = null;
const client = new FoxgloveClient({ ws: new WebSocket(bridge, [FoxgloveClient.SUPPORTED_SUBPROTOCOL]) });
client.on("error", (error) => {
  console.error(error);
  process.exit(1);
});
client.on("serverInfo", (info) => (server = info));
client.on("advertise", (channels) => {
  assert.deepEqual(channels.map((channel) => channel.topic).sort(), [...WANTED].sort());
  for (const channel of channels) {
    assert.equal(channel.encoding, "protobuf");
    const set = fromBinary(FileDescriptorSetSchema, Buffer.from(channel.schema, "base64"));
    const type = createFileRegistry(set).getMessage(channel.schemaName);
    assert.ok(type, `${channel.schemaName} is not in its own schema`);
    types.set(channel.topic, type);
    subscriptions.set(client.subscribe(channel.id), channel.topic);
  }
  void start();
});
client.on("message", ({ subscriptionId, timestamp, data }) => {
  const topic = subscriptions.get(subscriptionId);
  assert.ok(topic && timestamp > 1_700_000_000_000_000_000n);
  const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength);
  const message = fromBinary(types.get(topic), bytes);
  assert.equal(message.$unknown, undefined, `${topic} has fields that its schema does not name`);
  seen.set(topic, [...(seen.get(topic) ?? []), message]);
  const read = (seen.get("/meter/reading") ?? []).some(({ state }) => state === "measured");
  if (read && WANTED.every((wanted) => seen.has(wanted))) finish();
});

async function start() {
  const { key } = await call("/api/v1/lease", { owner: "a viewer's test" });
  await call("/api/v1/jobs", { kind: "joint_alignment" }, { "plenalign-lease": key });
}

function finish() {
  clearTimeout(late);
  assert.match(server.name, /SIMULATED/);
  assert.deepEqual(server.capabilities, []);
  const picture = seen.get("/camera/picture")[0];
  assert.deepEqual([...picture.data.slice(0, 2)], [0xff, 0xd8]);
  assert.equal(picture.format, "jpeg");
  const measured = seen.get("/job/measurement").at(-1);
  assert.ok(measured.spacing.spacingPx > 5 && measured.spacing.spacingPx < 60);
  const read = seen.get("/meter/reading").find(({ state }) => state === "measured");
  assert.ok(read.spacing.spacingPx > 5 && read.spacing.spacingPx < 60 && read.timestamp.seconds > 1_700_000_000n);
  assert.ok(seen.get("/log").some((line) => line.message.length > 0 && line.level === 2));
  assert.ok(seen.get("/job/decision")[0].decision.length > 0);
  const counts = WANTED.map((topic) => `${topic} ${seen.get(topic).length}`);
  console.log(`foxglove: ${counts.join(", ")}`);
  client.close();
  process.exit(0);
}
