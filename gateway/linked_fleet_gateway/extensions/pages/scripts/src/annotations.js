// Annotations of a robot: statements are added by a form and deleted one by one, with a SPARQL update each.

import { say } from "./say.js";
import { confirmed } from "./confirm.js";
import { notice } from "./notice.js";
import { refresh } from "./region.js";
import { send } from "./request.js";

const UNPROCESSABLE = 422;
const SPARQL = { "Content-Type": "application/sparql-update" };

export function start() {
  const form = /** @type {HTMLFormElement | null} */ (document.querySelector("form.annotate"));
  if (!form) return;
  const { predicate, other, value } = /** @type {Record<string, any>} */ (form.elements);
  predicate.addEventListener("change", () => {
    other.closest(".field").hidden = Boolean(predicate.value);
    other.required = !predicate.value;
  });
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    add(form, predicate.value || other.value, value);
  });
  document.addEventListener("click", ({ target }) => {
    const button = target instanceof Element ? /** @type {HTMLButtonElement | null} */ (target.closest("button[data-statement]")) : null;
    if (button) remove(button);
  });
}

async function add(/** @type {HTMLFormElement} */ form, /** @type {string} */ predicate, /** @type {HTMLInputElement} */ value) {
  const said = form.querySelector("output");
  const problem = await update(`INSERT DATA { <${new URL(form.dataset.about).href}> <${new URL(predicate).href}> ${JSON.stringify(value.value)} }`);
  said.dataset.state = problem ? "error" : "done";
  said.textContent = problem ? `${problem.title}. ${problem.detail}` : say("Said.");
  if (!problem) value.value = "";
  refresh();
}

async function remove(/** @type {HTMLButtonElement} */ button) {
  if ((await confirmed(`${button.ariaLabel}?`, { yes: say("Delete"), no: say("Keep it"), danger: true })) === undefined) return;
  const problem = await update(`DELETE DATA { ${button.dataset.statement} }`);
  if (problem?.status === UNPROCESSABLE) notice(say("The robot itself says this, so that only its agent can take it back."));
  else if (problem) notice(`${problem.title}. ${problem.detail}`);
  button.blur(); // otherwise its section would wait for it to lose the focus
  refresh();
}

/** @returns {Promise<import("./request.js").Problem|undefined>} */
async function update(/** @type {string} */ body) {
  return (await send("PATCH", document.body.dataset.resource, { body, headers: SPARQL })).problem;
}
