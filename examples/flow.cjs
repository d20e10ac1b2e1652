// A flow between two robots by the Web of Things: whenever a joint of one passes an angle, a joint of another turns.
// Usage: node flow.cjs [URL [ANGLE]]     after: npm install @node-wot/core@0.9.2 @node-wot/binding-http@0.9.2
const { Servient } = require("@node-wot/core");
const { HttpClientFactory } = require("@node-wot/binding-http");

const [url = "http://127.0.0.1:8000/", given = "0"] = process.argv.slice(2);
const angle = Number(given);
const FROM = ["UR5", "shoulder_pan_joint"];
const TO = ["Panda", "panda_joint1"];
const TURN = 0.3; // rad

/** The thing below `description` whose title, and those of the things above it, begin with the names of `path`. */
async function find(WoT, description, [name, ...rest]) {
  for (const link of description.links.filter((each) => each.rel === "item")) {
    const part = await WoT.requestThingDescription(link.href);
    if (part.title.startsWith(name)) return rest.length ? find(WoT, part, rest) : WoT.consume(part);
  }
  throw new Error(`nothing in ${description.title} is called ${name}`);
}

async function main() {
  const servient = new Servient();
  servient.addClientFactory(new HttpClientFactory());
  const WoT = await servient.start();
  const fleet = await WoT.requestThingDescription(new URL("/.well-known/wot", url).href);
  const [from, to] = [await find(WoT, fleet, FROM), await find(WoT, fleet, TO)];
  console.log(`when ${FROM.join(" ")} passes ${angle} rad, ${TO.join(" ")} turns`);

  let before;
  let side = 1;
  await from.observeProperty("rotation", async (output) => {
    const { value, unit } = await output.value();
    const passed = before !== undefined && value !== null && (before < angle) !== (value < angle);
    before = value ?? before;
    if (!passed) return;
    side = -side;
    try {
      const begun = await to.invokeAction("rotate", { value: side * TURN, unit, speedScale: 0.5 });
      console.log(`passed at ${value}: ${(await begun.value()).id}`);
    } catch (error) {
      console.error(`passed at ${value}, but refused: ${error.message}`);
    }
  });
}

main().catch((error) => {
  console.error(error.message);
  process.exit(1);
});
