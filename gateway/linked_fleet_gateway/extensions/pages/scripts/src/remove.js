// Buttons that delete a resource after a confirmation.

import { say } from "./say.js";
import { confirmed } from "./confirm.js";
import { hold, refresh, release } from "./region.js";
import { notice } from "./notice.js";
import { send } from "./request.js";
import { pauseAll, resumeAll } from "./socket.js";

export function start() {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button[data-delete]");
    if (button) ask(button);
  });
}

async function ask(button) {
  const { delete: iri, title } = button.dataset;
  const what = button.ariaLabel ?? `${button.textContent.trim()} ${title ?? iri}`;
  const answer = await confirmed(`${what}?`, { yes: button.textContent.trim(), no: say("Keep it"), danger: true });
  if (answer !== undefined) remove(button, iri);
}

async function remove(button, iri) {
  const own = iri === document.body.dataset.resource && document.body.dataset.kind !== "lease";
  button.disabled = true;
  if (own) rest();
  const { problem } = await send("DELETE", iri);
  if (own && !problem) return leave();
  if (own) wake();
  button.disabled = false;
  button.blur(); // otherwise its section would wait for it to lose the focus
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  else {
    document.dispatchEvent(new CustomEvent("deleted", { detail: iri }));
    refresh();
  }
}

/** Ask for nothing of this page's own resource while it is deleted: its connections end before the response comes. */
function rest() {
  hold();
  pauseAll();
}

function wake() {
  release();
  resumeAll();
}

function leave() {
  const up = document.querySelector("a[rel~=up], link[rel~=up]")?.href ?? document.body.dataset.root;
  location.assign(up);
}
