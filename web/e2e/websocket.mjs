// The WebSocket as Node's ws has it, with pictures read by the page's own generated code.
//
//   PLENALIGN_TOKEN=… node e2e/websocket.mjs http://127.0.0.1:8080

import assert from "node:assert/strict";
import { fromBinary } from "@bufbuild/protobuf";
import { runnerImport } from "vite";
import WebSocket from "ws";
import { until } from "./until.mjs";

const address = process.argv[2];
assert(address, "the daemon's address is missing");
const authorization = `Bearer ${process.env.PLENALIGN_TOKEN}`;
const { ViewedSchema } = (await runnerImport("./src/gen/plenalign/v1/frame_pb.ts")).module;

async function ask(method, path, body) {
  const headers = { authorization, ...(body && { "content-type": "application/json" }) };
  const answer = await fetch(address + path, {
    method,
    headers,
    ...(body && { body: JSON.stringify(body) }),
  });
  assert(answer.ok, `${method} ${path}: ${answer.status}`);
  return answer.json();
}

// A socket with everything that comes through it, in order.
function open({ path = "/api/v1/ws", headers = { authorization }, origin } = {}) {
  const socket = new WebSocket(address.replace("http", "ws") + path, { headers, origin });
  const heard = { text: [], binary: [], pings: 0 };
  socket.on("message", (data, isBinary) => {
    if (isBinary) heard.binary.push(data);
    else heard.text.push(JSON.parse(data.toString()));
  });
  socket.on("ping", () => (heard.pings += 1));
  socket.on("error", () => {});
  const opened = new Promise((resolve, reject) => {
    socket.once("open", resolve);
    socket.once("unexpected-response", (request, response) => {
      // Its connection would else stay open, and this program with it.
      request.destroy();
      reject(new Error(`${response.statusCode}`));
    });
  });
  const closed = new Promise((resolve) => {
    socket.once("close", (code, reason) => resolve({ code, reason: reason.toString() }));
  });
  opened.catch(() => {});
  return { socket, heard, opened, closed };
}

const problem = (heard) => heard.text.find((message) => message.type === "problem")?.problem;

async function check(what, run) {
  await run();
  console.log(`- ws: ${what}`);
}

await check("strangers, pages of another origin and used tickets get no socket", async () => {
  await assert.rejects(open({ headers: {} }).opened, /401/);
  await assert.rejects(open({ origin: "http://evil.example" }).opened, /403/);
  const { href } = await ask("POST", "/api/v1/tickets", { path: "/api/v1/ws" });
  const first = open({ path: href, headers: {} });
  await first.opened;
  await assert.rejects(open({ path: href, headers: {} }).opened, /401/);
  first.socket.close();
  assert.equal((await first.closed).code, 1005);
});

await check("changes follow the snapshot without a gap, and signs of life come", async () => {
  const { socket, heard, opened, closed } = open();
  await opened;
  assert.equal(socket.extensions, "");
  await until(() => heard.text.length, "there is no snapshot");
  assert.equal(heard.text[0].type, "snapshot");
  for (let turn = 0; turn < 3; turn += 1) {
    await ask("POST", "/api/v1/stop");
    await ask("DELETE", "/api/v1/stop", { why: "a test" });
  }
  const changes = () => heard.text.filter((message) => !["snapshot", "tick"].includes(message.type));
  await until(() => changes().length >= 6, "there is no sixth change");
  const first = heard.text[0].seq;
  changes().forEach((change, index) => assert.equal(change.seq, first + 1 + index));
  await until(() => heard.text.some((message) => message.type === "tick"), "there is no tick");
  await until(() => heard.pings, "there is no ping");
  let answered = false;
  socket.once("pong", (data) => (answered = data.toString() === "here"));
  socket.ping("here");
  await until(() => answered, "there is no pong");
  socket.close(1000, "done");
  assert.deepEqual(await closed, { code: 1000, reason: "done" });
});

await check("pictures are what the page's own code reads", async () => {
  const { socket, heard, opened, closed } = open();
  await opened;
  socket.send(JSON.stringify({ type: "pictures", on: true, max_rate_hz: 20 }));
  await until(() => heard.binary.length >= 3, "there is no third picture");
  const frames = heard.binary.map((data) => fromBinary(ViewedSchema, data).what);
  for (const { case: kind, value } of frames) {
    assert.equal(kind, "frame");
    assert.deepEqual([...value.jpeg.slice(0, 2)], [0xff, 0xd8]);
    assert(value.simulated && value.widthPx > 0 && value.ageMs >= 0);
  }
  assert(frames[0].value.seq < frames[1].value.seq && frames[1].value.seq < frames[2].value.seq);
  socket.close();
  await closed;
});

await check("fragments are put together, and what cannot be used is told", async () => {
  const { socket, heard, opened, closed } = open();
  await opened;
  socket.send('{"type":"dan', { fin: false });
  socket.ping();
  socket.send("ce", { fin: false });
  socket.send('"}', { fin: true });
  assert.equal((await until(() => problem(heard), "there is no answer")).status, 422);
  socket.close();
  await closed;
});

await check("what breaks the rules is closed with the code for it", async () => {
  for (const [code, data, options] of [
    [1009, "x".repeat(5000), {}],
    [1003, Buffer.from([0]), {}],
    [1007, Buffer.from([0xff, 0xfe]), { binary: false }],
    [1002, "{}", { mask: false }],
    [1002, "{}", { rsv1: true }],
  ]) {
    const { socket, heard, opened, closed } = open();
    await opened;
    await until(() => heard.text.length, "there is no snapshot");
    if (options.rsv1) {
      socket._socket.write(Buffer.from([0xc1, 0x80, 0, 0, 0, 0]));
    } else {
      socket.send(data, options);
    }
    const end = await closed;
    assert.equal(end.code, code, JSON.stringify(end));
    assert(end.reason.length > 0);
  }
});
