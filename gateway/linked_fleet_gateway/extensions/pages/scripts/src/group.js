// Robots that are chosen in the table of the fleet, and what is done with all of them: with a result for each.

import { say } from "./say.js";
import { confirmed } from "./confirm.js";
import { robotCount } from "./format.js";
import { adopt, refresh } from "./region.js";
import { send } from "./request.js";
import { lf } from "./vocabulary.js";

const AT_ONCE = 8;
const SPARQL = { "Content-Type": "application/sparql-update" };
const TAG_CHARACTERS = 40;
/** @type {Set<string>} the IRIs of the chosen robots */
const chosen = new Set();
/** @type {HTMLElement | null} */
let bar;

export function start() {
  bar = document.getElementById("group");
  if (!bar) return;
  document.addEventListener("change", ({ target }) => target instanceof HTMLInputElement && choose(target));
  bar.addEventListener("click", ({ target }) => {
    const button = target instanceof Element ? /** @type {HTMLElement | null} */ (target.closest("button[data-group]")) : null;
    if (button) act(button.dataset.group);
  });
  adopt(mark);
}

function rows() {
  return /** @type {HTMLElement[]} */ ([...document.querySelectorAll("#robots tr[data-robot]")]);
}

/** @param {HTMLInputElement} box */
function choose(box) {
  if (!box.closest("#robots")) return;
  const meant = box.id === "choose-all" ? rows().filter(({ hidden }) => !hidden) : [box.closest("tr")];
  for (const row of meant) {
    if (box.checked) chosen.add(row.dataset.robot);
    else chosen.delete(row.dataset.robot);
  }
  mark();
}

/** Show what is chosen: rows may be new. Robots that have gone are chosen no more. */
function mark() {
  const present = new Set(rows().map((row) => row.dataset.robot));
  for (const each of chosen) if (!present.has(each)) chosen.delete(each);
  for (const row of rows()) row.querySelector("input").checked = chosen.has(row.dataset.robot);
  const all = /** @type {HTMLInputElement | null} */ (document.getElementById("choose-all"));
  if (all) {
    all.checked = chosen.size > 0 && chosen.size === present.size;
    all.indeterminate = chosen.size > 0 && !all.checked;
  }
  const count = chosen.size;
  const may = document.body.dataset.may?.split(" ");
  document.getElementById("chosen").textContent = count ? say("{count} chosen", { count }) : say("No robot is chosen.");
  for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (bar.querySelectorAll("button[data-group]"))) {
    button.disabled = !count || (may && !may.includes(button.dataset.needs));
  }
}

/** @type {Record<string, (robots: number) => Promise<((robot: string) => Promise<import("./request.js").Answer>) | undefined>>} */
const ACTIONS = {
  // A question would delay it; the bar says how many are chosen.
  stop: async () => (robot) => send("POST", `${robot}actions/stop`),
  async out(count) {
    const reason = await confirmed(say("Take {robots} out of service?", { robots: robotCount(count) }), { yes: say("Take out of service"), field: say("Why"), danger: true });
    if (!reason) return undefined;
    const body = `<> <${lf("inService")}> false ; <${lf("reason")}> ${JSON.stringify(reason)} .`;
    return (robot) => send("PUT", `${robot}availability`, { body });
  },
  async return(count) {
    const sure = await confirmed(say("Return {robots} to service?", { robots: robotCount(count) }), { yes: say("Return to service") });
    const body = `<> <${lf("inService")}> true .`;
    return sure === undefined ? undefined : (robot) => send("PUT", `${robot}availability`, { body });
  },
  async tag(count) {
    const tag = await confirmed(say("Which tag do {robots} get?", { robots: robotCount(count) }), { yes: say("Add the tag"), field: say("Tag"), most: TAG_CHARACTERS });
    return tag ? (robot) => patchTags(robot, "INSERT", tag) : undefined;
  },
  async untag(count) {
    const tag = await confirmed(say("Which tag do {robots} lose?", { robots: robotCount(count) }), { yes: say("Remove the tag"), field: say("Tag"), most: TAG_CHARACTERS });
    return tag ? (robot) => patchTags(robot, "DELETE", tag) : undefined;
  },
};

/** Add what extensions do with the chosen robots, by the name of its button. It returns the request for one robot. */
export function offer(/** @type {string} */ name, /** @type {(robots: number) => Promise<((robot: string) => Promise<import("./request.js").Answer>) | undefined>} */ ask) {
  ACTIONS[name] = ask;
}

function patchTags(robot, way, tag) {
  const body = `${way} DATA { <${robot}tags> <${lf("tag")}> ${JSON.stringify(tag)} }`;
  return send("PATCH", `${robot}tags`, { body, headers: SPARQL });
}

async function act(name) {
  const names = new Map(rows().map((row) => [row.dataset.robot, row.dataset.name]));
  const meant = [...chosen];
  const request = await ACTIONS[name](meant.length);
  if (!request) return;
  const list = document.getElementById("group-results");
  list.replaceChildren();
  const lines = new Map(meant.map((robot) => [robot, line(list, say("{names}: asked…", { names: names.get(robot) }))]));
  const waiting = [...meant];
  const work = async () => {
    for (let robot = waiting.shift(); robot; robot = waiting.shift()) {
      const { problem, location } = await request(robot);
      const element = lines.get(robot);
      element.textContent = `${names.get(robot)}: ${problem ? `${problem.title}. ${problem.detail}` : location ? "" : "done"}`;
      if (location && !problem) element.append(Object.assign(document.createElement("a"), { href: location, textContent: "done" }));
      element.dataset.state = problem ? "error" : "done";
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, work));
  refresh();
}

function line(list, textContent) {
  const element = Object.assign(document.createElement("li"), { textContent });
  list.append(element);
  return element;
}
