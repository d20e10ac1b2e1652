// Rules: switches, an editor that tries a condition before it is saved, and the outcomes of firings.

import { compose } from "./composer.js";
import { send } from "../../pages/scripts/src/request.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { write } from "../../pages/scripts/src/ntriples.js";
import { adopt, refresh } from "../../pages/scripts/src/region.js";
import { solutions } from "../../query/scripts/page.js";
import { watch } from "../../pages/scripts/src/socket.js";
import { TITLE, lf } from "../../pages/scripts/src/vocabulary.js";

const FIELDS = { title: TITLE, condition: lf("condition"), invokes: lf("invokes"), body: lf("body"), toldApart: lf("toldApartBy") };
// What becomes of a rule, and not what it says.
const OUTCOMES = ["state", "reason", "firings", "suppressions"].map(lf);
const pages = new DOMParser();

export function start() {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button.switch[data-rule]");
    if (button) toggle(button);
  });
  /** @type {HTMLFormElement | null} */
  const form = document.querySelector("form.rule");
  if (form) edit(form);
  /** @type {HTMLElement | null} */
  const place = document.querySelector("[data-composer]");
  if (form && place) compose(form, place, (names) => several(form.querySelector(".repeat:has(template)"), names)).catch((error) => console.debug("rules cannot be composed at present:", error));
  adopt(showFirings);
  const fired = document.querySelector("[data-firings]");
  if (fired) watch(fired.dataset.firings, {}, () => showFirings());
}

/** @param {HTMLFormElement} form */
function edit(form) {
  form.addEventListener("submit", (event) => {
    if (!(event.submitter && "save" in event.submitter.dataset)) {
      event.preventDefault();
      event.stopPropagation(); // it is a query, and nothing that is to be sent as a rule
      attempt(form);
    }
  });
  form.querySelector("button[data-save]").removeAttribute("hidden");
  if (form.dataset.methods === "PUT") tie(form);
  const examples = document.getElementById("rule-examples");
  examples?.removeAttribute("hidden");
  examples?.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button[data-example]");
    if (button) fill(form, button.dataset);
  });
}

/** @param {HTMLFormElement} form */
function fill(form, example) {
  for (const [name, path] of Object.entries(FIELDS)) {
    const value = example[name] ?? "";
    const repeat = form.querySelector(`.repeat:has(template)`);
    if (path === FIELDS.toldApart) several(repeat, value.split(" ").filter(Boolean));
    else set(form.querySelector(`[data-path="${path}"]`), value);
  }
}

function set(field, value) {
  field.value = value;
  field.dispatchEvent(new Event("replaced"));
}

/** Have a field that may be there several times be there once for each value. */
function several(repeat, values) {
  for (const button of repeat.querySelectorAll("button[data-remove]")) button.click();
  for (const value of values) {
    repeat.querySelector("button[data-add]").click();
    set([...repeat.querySelectorAll("input[data-path]")].at(-1), value);
  }
}

/** Send the condition as a query, and show its rows or its error. */
async function attempt(form) {
  const place = form.querySelector("#results");
  const found = await solutions(form.querySelector("textarea[name=query]"), form.action);
  if (!found) return;
  place.hidden = false;
  place.replaceChildren(...found.childNodes);
  place.querySelector("h2")?.remove();
}

/** Replace a rule only if nobody else has changed it since its page was loaded. Firings change its entity tag too. */
function tie(form) {
  const iri = form.dataset.action;
  let before = described(iri);
  form.addEventListener("submit", async (event) => {
    if (form.dataset.match || !event.submitter || !("save" in event.submitter.dataset)) return;
    event.preventDefault();
    event.stopPropagation();
    const [{ said }, now] = await Promise.all([before, described(iri)]);
    // The gateway refuses to overwrite a change by somebody else, with the reason.
    form.dataset.match = now.said === said ? now.tag : '"another"';
    form.requestSubmit(event.submitter);
    delete form.dataset.match;
  });
  form.addEventListener("saved", () => (before = described(iri)));
}

/** Return the statements of a rule, without those about its firings, and its entity tag. */
async function described(iri) {
  const response = await fetch(iri, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
  const lines = (await response.text()).split("\n").filter((line) => !OUTCOMES.some((each) => line.includes(`> <${each}> `)));
  const said = lines.map((line) => line.replaceAll(/_:\w+/g, "_:")).sort().join("\n");
  return { said, tag: response.headers.get("etag") ?? '"none"' };
}

async function toggle(button) {
  button.disabled = true;
  const enable = button.getAttribute("aria-checked") !== "true";
  const { problem } = await put(button.dataset.rule, lf("enabled"), { kind: "literal", value: String(enable), datatype: "http://www.w3.org/2001/XMLSchema#boolean" });
  button.disabled = false;
  button.blur(); // otherwise its section would wait for it to lose the focus
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  else button.setAttribute("aria-checked", String(enable));
  refresh();
}

/** Put a rule back with one statement changed, unless somebody has changed it meanwhile. */
async function put(iri, predicate, object) {
  const response = await fetch(iri, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
  if (!response.ok) return send("PUT", iri, { body: "" });
  const start = `<${iri}> <${predicate}> `;
  const lines = (await response.text()).split("\n").filter((line) => !line.startsWith(start));
  const body = [...lines, `${start}${write(object)} .`, ""].join("\n");
  const tag = response.headers.get("etag");
  return send("PUT", iri, { body, headers: tag ? { "If-Match": tag } : {} });
}

/** Show the table from the page of firings. */
async function showFirings() {
  const place = document.querySelector("[data-firings]");
  if (!place) return;
  const response = await fetch(place.dataset.firings, { headers: { Accept: "text/html" }, cache: "no-cache" });
  const page = pages.parseFromString(await response.text(), "text/html");
  const found = page.querySelector("#fired .scroll, #fired .empty");
  if (found) place.replaceChildren(document.importNode(found, true));
}
