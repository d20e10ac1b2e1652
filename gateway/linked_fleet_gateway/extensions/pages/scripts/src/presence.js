// Disables actions of a robot that is offline, silent or under the control of another, and says why.

import { adopt } from "./region.js";
import { onConnection } from "./socket.js";

const ACTIONS = "details.action form.invoke, [data-kind=action] form.invoke, form.motion";
const OFFLINE = "The robot is offline: nothing can be sent to it.";
const NO_RIGHT = "You have no right to move this robot.";
const UNHEARD = {
  silent: "The gateway does not answer: what this form shows may be wrong.",
  lost: "The connection is lost: what this form shows may be wrong.",
};
let connection = "live";

export function start() {
  const head = document.querySelector(".head");
  if (!head) return;
  adopt(apply);
  const changes = { subtree: true, childList: true, attributes: true, attributeFilter: ["data-state"] };
  new MutationObserver(apply).observe(head, changes);
  onConnection((state) => {
    connection = state;
    apply();
  });
}

/** Mark the page, and enable or disable its action forms by the presence of the robot and the connection. */
export function apply() {
  const state = document.querySelector("#presence .state")?.dataset.state;
  document.body.dataset.presence = state ?? "online";
  const { controller } = document.body.dataset;
  const held = controller ? `${controller} has control of the robot: its motions are refused.` : "";
  const reason = UNHEARD[connection] ?? (state === "offline" ? OFFLINE : held);
  for (const form of document.querySelectorAll(ACTIONS)) close(form, reason || forbidden(form));
}

/** Return why the reader may not move the robot by this form; empty if it moves nothing. */
function forbidden(form) {
  const { may } = document.body.dataset;
  const moves = form.matches("form.motion") || form.querySelector("[data-prefer=dry-run]");
  return moves && may !== undefined && !may.split(" ").includes("act") ? NO_RIGHT : "";
}

function close(form, reason) {
  for (const button of form.querySelectorAll("button[type=submit], button[data-send]")) {
    button.disabled = Boolean(reason);
    button.title = reason;
  }
  const said = form.querySelector(":scope > p.closed");
  if (!reason) said?.remove();
  else if (!said) form.append(Object.assign(document.createElement("p"), { className: "closed", textContent: reason }));
  else if (said.textContent !== reason) said.textContent = reason;
}
