// Control from hand to hand: who lacks it asks for it on the page of the robot, and who has it hands it over or refuses.

import { say } from "../../pages/scripts/src/say.js";
import { giveUp, keep, proof } from "../../pages/scripts/src/control.js";
import { statements } from "../../pages/scripts/src/ntriples.js";
import { apply } from "../../pages/scripts/src/presence.js";
import { send } from "../../pages/scripts/src/request.js";
import { RDF_TYPE, lf, localName } from "../../pages/scripts/src/vocabulary.js";

const ASKED = "linked-fleet asked for ";

/** @typedef {{lease: string, state: string, holder: string, mine: boolean, look: () => void}} Control */

export function start() {
  document.addEventListener("control", (event) => {
    if (event instanceof CustomEvent && event.target instanceof HTMLElement) look(event.target, event.detail);
  });
}

/** Show what is to be asked and answered, beside who has control. */
async function look(/** @type {HTMLElement} */ place, /** @type {Control} */ control) {
  const robot = new URL("./", control.lease).href;
  const requests = new URL("/control-requests", document.baseURI).href;
  const { graph, problem } = await send("GET", requests);
  if (!graph) return problem?.status ? show(place, "", []) : undefined; // the extension is off; else the connection is lost
  const all = graph.having(RDF_TYPE, lf("ControlRequest")).filter((each) => graph.value(each, lf("ofRobot"))?.value === robot);
  const of = (iri, name) => graph.value(iri, lf(name))?.value ?? "";
  const waiting = all.filter((each) => localName(of(each, "state")) === "controlAsked");
  const mine = JSON.parse(localStorage.getItem(ASKED + control.lease) ?? "null");
  if (mine && all.includes(mine.request)) {
    const state = localName(of(mine.request, "state"));
    if (state === "controlGranted") {
      localStorage.removeItem(ASKED + control.lease);
      keep(control.lease, mine.token);
      show(place, say("{of} has handed control over to you.", { of: of(mine.request, "answeredBy") }), []);
      control.look();
    } else if (state === "controlRefused") {
      localStorage.removeItem(ASKED + control.lease);
      show(place, say("{of} keeps control.", { of: of(mine.request, "answeredBy") }), []);
    } else if (control.state !== "held") withdraw(place, control, mine);
    else show(place, say("You have asked {holder} for control.", { holder: control.holder }), [[say("Withdraw"), () => withdraw(place, control, mine)]]);
    return;
  }
  if (mine) {
    localStorage.removeItem(ASKED + control.lease);
    show(place, say("Nobody has answered. You may ask again."), []);
    return;
  }
  if (control.mine && waiting.length) {
    const [first] = waiting;
    show(place, say("{of} asks for control.", { of: of(first, "asker") }), [
      [say("Hand over"), () => answer(place, control, first, "handOver")],
      [say("Refuse"), () => answer(place, control, first, "refuse")],
    ]);
  } else if (control.state === "held" && !control.mine) {
    show(place, place.querySelector(".asking p")?.textContent ?? "", [[say("Ask for control"), () => ask(place, control, robot, requests)]]);
  } else show(place, "", []);
}

async function ask(place, control, robot, requests) {
  const token = `urn:uuid:${uuid()}`;
  const body = statements([
    [lf("ofRobot"), { kind: "iri", value: robot }],
    [lf("controlToken"), { kind: "literal", value: token }],
  ]);
  const { problem, location } = await send("POST", requests, { body });
  if (location) localStorage.setItem(ASKED + control.lease, JSON.stringify({ request: location, token: `<${token}>` }));
  else show(place, `${problem.title}. ${problem.detail}`, []);
  look(place, control);
}

async function withdraw(place, control, mine) {
  localStorage.removeItem(ASKED + control.lease);
  await send("DELETE", mine.request);
  show(place, "", []);
  control.look();
}

async function answer(place, control, request, action) {
  const { problem } = await send("POST", `${request}/actions/${action}`, { headers: proof(control.lease) });
  if (!problem && action === "handOver") giveUp(control.lease);
  show(place, problem ? `${problem.title}. ${problem.detail}` : "", []);
  control.look();
}

/**
 * @param {HTMLElement} place
 * @param {string} text
 * @param {[string, () => void][]} buttons
 */
function show(place, text, buttons) {
  let box = place.querySelector(".asking");
  const shown = JSON.stringify([text, buttons.map(([name]) => name)]);
  if (!box) {
    box = Object.assign(document.createElement("div"), { className: "asking" });
    box.setAttribute("role", "status");
    place.append(box);
  }
  if (!(box instanceof HTMLElement) || box.dataset.shown === shown) return;
  box.dataset.shown = shown;
  const said = Object.assign(document.createElement("p"), { textContent: text });
  const bar = Object.assign(document.createElement("p"), { className: "buttons" });
  for (const [name, press] of buttons) {
    const button = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: name });
    button.dataset.needs = "act";
    button.addEventListener("click", () => {
      button.disabled = true;
      delete (/** @type {HTMLElement} */ (box).dataset.shown);
      press();
    });
    bar.append(button);
  }
  box.replaceChildren(...(text ? [said] : []), ...(buttons.length ? [bar] : []));
  apply();
}

/** Return a random UUID; `crypto.randomUUID` requires https. */
function uuid() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = (bytes[6] & 0x0f) | 0x40;
  bytes[8] = (bytes[8] & 0x3f) | 0x80;
  const hex = Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  return hex.replace(/^(.{8})(.{4})(.{4})(.{4})(.{12})$/, "$1-$2-$3-$4-$5");
}
