// What cannot be done with a robot that is offline is closed, and says why.

import { adopt } from "./region.js";

const ACTIONS = "details.action form.invoke, [data-kind=action] form.invoke";
const REASON = "The robot is offline: nothing can be sent to it.";

export function start() {
  const head = document.querySelector(".head");
  if (!head) return;
  adopt(apply);
  const changes = { subtree: true, childList: true, attributes: true, attributeFilter: ["data-state"] };
  new MutationObserver(apply).observe(head, changes);
}

/** Mark the page, and open or close its forms of actions, as the robot is present. */
export function apply() {
  const state = document.querySelector("#presence .state")?.dataset.state;
  const offline = state === "offline";
  document.body.dataset.presence = state ?? "online";
  for (const form of document.querySelectorAll(ACTIONS)) close(form, offline);
}

function close(form, closed) {
  for (const button of form.querySelectorAll("button[type=submit]")) button.disabled = closed;
  const said = form.querySelector(":scope > p.closed");
  if (!closed) said?.remove();
  else if (!said) form.append(Object.assign(document.createElement("p"), { className: "closed", textContent: REASON }));
}
