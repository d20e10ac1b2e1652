// A client of Foxglove: lists the channels, decodes messages of six schemas, one of them in JSON, and calls a service. Prints a line of JSON
// for each. Usage: node foxglove.cjs URL TOKEN ROBOT SUBPROTOCOL MESSAGES
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const protobuf = require("protobufjs");
const descriptor = require("protobufjs/ext/descriptor");
const WebSocket = require("ws");

const [url, token, robot, subprotocol, most] = process.argv.slice(2);
const say = (what, value) => console.log(JSON.stringify({ [what]: value }));
const TOPICS = ["joint_states", "tf", "pose", "log", "invocations", "mode"].map((each) => `/${robot}/${each}`);

function decoder(channel) {
  if (channel.encoding === "json") return (data) => JSON.parse(new TextDecoder().decode(data));
  const set = descriptor.FileDescriptorSet.decode(Buffer.from(channel.schema, "base64"));
  const type = protobuf.Root.fromDescriptor(set).lookupType(channel.schemaName);
  return (data) => type.toObject(type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength)), { longs: Number });
}

const ws = new WebSocket(url, [subprotocol], { headers: { authorization: `Bearer ${token}` } });
const client = new FoxgloveClient({ ws });
const channels = new Map();
const subscribed = new Map();
const decoded = {};
let count = 0;
let called = false;
let answered = false;

function finish() {
  if (count < Number(most) || !answered || Object.keys(decoded).length < TOPICS.length) return;
  say("decoded", decoded);
  say("count", count);
  ws.close();
}

client.on("error", (error) => {
  console.error(error);
  process.exit(1);
});
client.on("serverInfo", (info) => say("serverInfo", { name: info.name, capabilities: info.capabilities }));
client.on("status", (status) => say("status", status.message));
client.on("advertise", (found) => {
  for (const channel of found) channels.set(channel.topic, channel);
  if (subscribed.size || !TOPICS.every((topic) => channels.has(topic))) return;
  say("channels", [...channels.keys()].sort());
  for (const topic of TOPICS) {
    const channel = channels.get(topic);
    subscribed.set(client.subscribe(channel.id), { name: channel.encoding === "json" ? topic : channel.schemaName, decode: decoder(channel) });
  }
});
client.on("advertiseServices", (services) => {
  const stop = services.find((each) => each.name === `/${robot}/stop`);
  if (!stop || called) return;
  called = true;
  const data = new TextEncoder().encode("{}");
  setTimeout(() => client.sendServiceCallRequest({ serviceId: stop.id, callId: 1, encoding: "json", data }), 200);
});
client.on("message", ({ subscriptionId, data }) => {
  const { name, decode } = subscribed.get(subscriptionId);
  decoded[name] = decode(data);
  count += 1;
  finish();
});
client.on("serviceCallResponse", ({ data }) => {
  answered = true;
  say("response", JSON.parse(new TextDecoder().decode(data)));
  finish();
});
client.on("serviceCallFailure", ({ message }) => {
  say("failure", message);
  ws.close();
});
client.on("close", () => process.exit(0));
