// Disables controls whose requests would be refused, and says why: without the right, of a robot that is offline or under
// the control of another, and while the gateway is silent.

import { say } from "./say.js";
import { holds } from "./control.js";
import { describe } from "./form.js";
import { adopt } from "./region.js";
import { onConnection } from "./socket.js";

const ACTIONS = "details.action form.invoke, [data-kind=action] form.invoke, form.motion";
const OFFLINE = say("The robot is offline: nothing can be sent to it.");
const FORBIDDEN = {
  act: say("You have no right to move this robot."),
  stop: say("You have no right to stop this robot."),
  reset: say("You have no right to let this robot move again."),
  admin: say("You have no right to change this."),
  subscribe: say("You have no right to have messages sent or rules followed."),
};
const UNHEARD = {
  silent: say("The gateway does not answer: what this form shows may be wrong."),
  lost: say("The connection is lost: what this form shows may be wrong."),
};
// What the holder of a control lease alone may do: motions and settings.
const HELD = ["act", "reset", "admin"];
/** @type {Map<string, string>} by the lease, who else has control */
const holders = new Map();
let connection = "live";

export function start() {
  adopt(apply);
  const head = document.querySelector(".head");
  const changes = { subtree: true, childList: true, attributes: true, attributeFilter: ["data-state"] };
  if (head) new MutationObserver(apply).observe(head, changes);
  onConnection((state) => {
    connection = state;
    apply();
  });
}

/** Note that somebody else has control by this lease, or nobody else for an empty name. */
export function held(/** @type {string} */ lease, /** @type {string} */ holder) {
  if (holders.get(lease) === holder) return;
  holders.set(lease, holder);
  apply();
}

/** @returns {string|undefined} the control lease on which the request of a form depends */
export function leaseOf(/** @type {HTMLElement} */ form) {
  return HELD.includes(form.dataset.needs) ? form.dataset.control ?? document.body.dataset.control : undefined;
}

/** Mark the page, and enable or disable its controls by the rights, the presence, the control and the connection. */
export function apply() {
  const state = document.querySelector("#presence .state")?.dataset.state;
  document.body.dataset.presence = state ?? "online";
  for (const form of document.querySelectorAll("form[data-needs]")) close(form, forbidden(form) || refused(form, state));
  for (const button of document.querySelectorAll("button[data-needs]")) {
    const reason = forbidden(button);
    if (!reason) continue;
    Object.assign(button, { disabled: true, title: reason });
    button.setAttribute("aria-description", reason);
  }
}

/** Return why the reader has no right to use a form or a button, else an empty text. */
function forbidden(element) {
  const may = (element.dataset.may ?? document.body.dataset.may)?.split(" ");
  const needs = element.dataset.needs.split(" ");
  return !may || needs.some((each) => may.includes(each)) ? "" : FORBIDDEN[needs[0]];
}

function refused(form, state) {
  if (form.matches(ACTIONS)) {
    if (UNHEARD[connection]) return UNHEARD[connection];
    if (state === "offline") return OFFLINE;
  }
  const holder = holderOf(leaseOf(form) ?? "");
  return holder ? say("{holder} has control of the robot: this would be refused.", { holder }) : "";
}

/** Return who else has control, as the served page knows it until it is asked for. */
function holderOf(lease) {
  if (holders.has(lease)) return holders.get(lease);
  const { control, holder } = document.body.dataset;
  return control === lease && holder && !holds(lease) ? holder : "";
}

let reasons = 0;

function close(form, reason) {
  form.toggleAttribute("data-closed", Boolean(reason));
  let said = form.querySelector(":scope > p.closed");
  if (reason && !said) {
    said = Object.assign(document.createElement("p"), { className: "closed", id: `closed-${++reasons}` });
    form.append(said);
  }
  if (reason && said.textContent !== reason) said.textContent = reason;
  for (const button of form.querySelectorAll("button[type=submit]:not([data-try]), button[data-send]")) {
    button.disabled = Boolean(reason);
    button.title = reason;
    if (said) describe(button, said.id, Boolean(reason));
  }
  if (!reason) said?.remove();
}
