// Gives the robots that are chosen in the table of the fleet a mission that takes a robot as its parameter.

import { confirmed } from "../../pages/scripts/src/confirm.js";
import { choice, field } from "../../pages/scripts/src/elements.js";
import { fetchGraph } from "../../pages/scripts/src/fleet_offer.js";
import { robotCount } from "../../pages/scripts/src/format.js";
import { offer } from "../../pages/scripts/src/group.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { key } from "../../pages/scripts/src/ntriples.js";
import { fresh, send } from "../../pages/scripts/src/request.js";
import { say } from "../../pages/scripts/src/say.js";
import { RDF_TYPE, TITLE, lf, localName } from "../../pages/scripts/src/vocabulary.js";

const IDENTIFIER = "http://purl.org/dc/terms/identifier";
const JSON_BODY = { "Content-Type": "application/json" };

/** @typedef {{iri: string, title: string, parameter: string}} ForRobot a mission, and the name of its parameter */

export function start() {
  offer("mission", async (count) => {
    const { root } = document.body.dataset;
    const [missions, queue] = ["missions", "queue"].map((each) => new URL(each, root).href);
    const found = await missionsForRobots(missions).catch((error) => {
      notice(say("The missions cannot be had: {message}", { message: error.message }));
    });
    if (!found) return undefined;
    if (!found.length) {
      notice(say("No mission takes a robot: give one a parameter of the type iri without options, and let its steps act on that."));
      return undefined;
    }
    const which = choice(found.map(({ iri, title }) => /** @type {[string, string]} */ ([iri, title])), found[0].iri);
    const waits = document.querySelector(`nav a[href="${queue}"]`);
    /** @type {[string, string][]} */
    const begins = [["now", say("now")]];
    if (waits) begins.unshift(["queue", say("in the queue, each in its turn")]);
    const when = choice(begins, begins[0][0]);
    const robots = robotCount(count);
    const more = [field(say("Mission"), which), field(say("Begin"), when)];
    const sure = await confirmed(say("Which mission do {robots} get?", { robots }), { yes: say("Give the mission"), more });
    if (sure === undefined) return undefined;
    const { iri, parameter } = found.find((each) => each.iri === which.value);
    if (when.value === "queue") return (robot) => send("POST", queue, { body: JSON.stringify({ mission: iri, input: { [parameter]: robot } }), headers: JSON_BODY });
    return (robot) => send("POST", `${iri}/actions/run`, { body: JSON.stringify({ [parameter]: robot }), headers: { ...JSON_BODY, "Idempotency-Key": fresh() } });
  });
}

/** @returns {Promise<ForRobot[]>} the missions that need no value but that of one thing, which may be a robot */
async function missionsForRobots(/** @type {string} */ missions) {
  const graph = await fetchGraph(missions);
  const found = [];
  for (const iri of graph.having(RDF_TYPE, lf("Mission"))) {
    const nodes = graph.values(iri, lf("parameter")).map(key);
    const needed = nodes.filter((each) => !graph.value(each, lf("default")));
    const things = needed.filter((each) => localName(graph.value(each, lf("parameterType"))?.value ?? "") === "thing" && !graph.value(each, lf("option")));
    if (needed.length !== 1 || things.length !== 1) continue;
    found.push({ iri, title: graph.value(iri, TITLE)?.value ?? iri, parameter: graph.value(things[0], IDENTIFIER).value });
  }
  return found.sort((one, other) => one.title.localeCompare(other.title));
}
