// Runs of missions: people answer and decide by buttons at the steps that wait, and who runs a mission sees its run.

import { send } from "../../pages/scripts/src/request.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { adopt, refresh } from "../../pages/scripts/src/region.js";
import { statements } from "../../pages/scripts/src/ntriples.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

const BOOLEAN = "http://www.w3.org/2001/XMLSchema#boolean";
const RUN = /^\/missions\/[^/]+\/actions\/run$/;

export function start() {
  adopt((part) => {
    for (const each of part.querySelectorAll("button[data-run-action]")) each.removeAttribute("hidden");
  });
  document.addEventListener("click", ({ target }) => {
    const button = /** @type {Element} */ (target).closest?.("button[data-run-action]");
    if (button instanceof HTMLButtonElement) decide(button);
  });
  document.addEventListener("saved", (/** @type {CustomEvent} */ { target, detail }) => {
    const { action = "" } = /** @type {HTMLElement} */ (target).dataset;
    if (!detail || !action.startsWith(document.body.dataset.root) || !RUN.test(new URL(action).pathname)) return;
    location.assign(`${document.body.dataset.root}mission-runs/${detail.split("/").at(-1)}`);
  });
}

/** Send what a button says. The buttons of the run wait for the answer. */
async function decide(button) {
  const { runAction, step, confirmed } = button.dataset;
  /** @type {[string, import("../../pages/scripts/src/ntriples.js").Term][]} */
  const said = step === undefined ? [] : [[lf("stepPath"), { kind: "literal", value: step }]];
  if (confirmed !== undefined) said.push([lf("confirmed"), { kind: "literal", value: confirmed, datatype: BOOLEAN }]);
  const all = /** @type {NodeListOf<HTMLButtonElement>} */ (document.querySelectorAll("button[data-run-action]"));
  for (const each of all) each.disabled = true;
  const { problem } = await send("POST", runAction, said.length ? { body: statements(said) } : {});
  for (const each of all) each.disabled = false;
  button.blur(); // otherwise its section would wait for it to lose the focus
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  refresh();
}
