// A client of the Web of Things that knows the address of a fleet and nothing else: it finds a joint that rotates, reads
// where it is, observes it while it turns, and prints a line of JSON for each. Usage: node consume.cjs URL [VALUE]
const { Servient } = require("@node-wot/core");
const { HttpClientFactory } = require("@node-wot/binding-http");

const [url, by = "0.2"] = process.argv.slice(2);
const say = (what, value) => console.log(JSON.stringify({ [what]: value }));
const parts = (thing) => thing.links.filter((link) => link.rel === "item").map((link) => link.href);

async function joint(WoT, place) {
  const description = await WoT.requestThingDescription(place);
  if (description.actions.rotate) return description;
  for (const part of parts(description)) {
    const found = await joint(WoT, part);
    if (found) return found;
  }
}

async function main() {
  const servient = new Servient();
  servient.addClientFactory(new HttpClientFactory());
  const WoT = await servient.start();
  const thing = await WoT.consume(await joint(WoT, new URL("/.well-known/wot", url).href));
  say("thing", thing.getThingDescription().title);

  const start = await (await thing.readProperty("rotation")).value();
  say("read", start);
  const goal = start.value + Number(by);
  let arrived;
  const there = new Promise((resolve) => (arrived = resolve));
  const observed = [];
  const subscription = await thing.observeProperty("rotation", async (output) => {
    const seen = await output.value();
    observed.push(seen.value);
    if (Math.abs(seen.value - goal) < 0.01) arrived();
  });
  const output = await thing.invokeAction("rotate", { value: goal, unit: start.unit, speedScale: 0.5 });
  const invocation = await output.value();
  say("invoked", invocation);
  await there;
  await subscription.stop();
  say("observed", observed);
  say("end", await (await thing.readProperty("rotation")).value());
  await servient.shutdown();
}

main().catch((error) => {
  console.error(error);
  process.exit(1);
});
