// Rules: switches, an editor that tries a condition before it is saved, and what firings did.

import { fresh, send } from "./request.js";
import { notice } from "./notice.js";
import { write } from "./ntriples.js";
import { adopt, refresh } from "./region.js";
import { solutions } from "./query.js";
import { DECIMAL, RDF_TYPE, TITLE, lf } from "./vocabulary.js";

const FIELDS = { "rule-title": "title", "rule-condition": "condition", "rule-invokes": "invokes", "rule-body": "body", "rule-told-apart": "toldApart" };
const pages = new DOMParser();

export function start() {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button.switch[data-rule]");
    if (button) toggle(button);
  });
  /** @type {HTMLFormElement | null} */
  const form = document.querySelector("form.rule");
  if (form) edit(form);
  adopt(showFirings);
}

/** @param {HTMLFormElement} form */
function edit(form) {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    attempt(form);
  });
  const save = form.querySelector("button[data-save]");
  const change = form.querySelector("button[data-change]");
  save?.addEventListener("click", () => create(form));
  change?.addEventListener("click", () => replaceCondition(form, change.dataset.change));
  for (const button of [save, change]) button?.removeAttribute("hidden");
  const examples = document.getElementById("rule-examples");
  examples?.removeAttribute("hidden");
  examples?.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button[data-example]");
    if (button) fill(button.dataset);
  });
}

function fill(example) {
  for (const [id, name] of Object.entries(FIELDS)) {
    const field = /** @type {HTMLInputElement} */ (document.getElementById(id));
    field.value = example[name] ?? "";
    field.dispatchEvent(new Event("replaced"));
  }
}

/** Ask the condition as a query, and show its rows or what is wrong with it. */
async function attempt(form) {
  const place = form.querySelector("#results");
  const found = await solutions(form.querySelector("textarea[name=query]"), form.action);
  if (!found) return;
  place.hidden = false;
  place.replaceChildren(...found.childNodes);
  place.querySelector("h2")?.remove();
}

async function create(form) {
  const field = (id) => /** @type {HTMLInputElement} */ (document.getElementById(id)).value.trim();
  const rule = { kind: /** @type {const} */ ("blank"), value: "rule" };
  const lines = [];
  const say = (predicate, object) => lines.push(`${write(rule)} ${write({ kind: "iri", value: predicate })} ${write(object)} .`);
  const text = (value) => ({ kind: "literal", value });
  const invokes = field("rule-invokes");
  say(RDF_TYPE, { kind: "iri", value: lf("Rule") });
  say(TITLE, text(field("rule-title")));
  say(lf("condition"), text(field("rule-condition")));
  if (invokes.startsWith("?")) {
    say(lf("invokes"), { kind: "blank", value: "invoked" });
    lines.push(`_:invoked ${write({ kind: "iri", value: lf("variable") })} ${write({ kind: "literal", value: invokes.slice(1) })} .`);
  } else if (URL.canParse(invokes, document.baseURI)) {
    say(lf("invokes"), { kind: "iri", value: new URL(invokes, document.baseURI).href });
  }
  for (const name of field("rule-told-apart").split(/[\s,?]+/).filter(Boolean)) say(lf("toldApartBy"), text(name));
  const interval = field("rule-interval");
  if (interval) say(lf("minimumInterval"), { kind: "literal", value: interval, datatype: DECIMAL });
  const body = field("rule-body");
  if (body) say(lf("body"), { kind: "blank", value: "body" });
  // The author's Turtle comes last: its prefixes and its lines are counted from there.
  const answer = await saving(form, send("POST", form.dataset.container, { body: `${lines.join("\n")}\n${body}\n`, headers: { "Idempotency-Key": fresh() } }));
  if (!answer) return;
  tell(form, "done", "Saved: ", Object.assign(document.createElement("a"), { href: answer.location, textContent: field("rule-title") }));
  refresh();
}

async function replaceCondition(form, iri) {
  const condition = { kind: /** @type {const} */ ("literal"), value: form.querySelector("textarea[name=query]").value };
  const answer = await saving(form, put(iri, lf("condition"), condition));
  if (answer) tell(form, "done", "Saved.");
}

async function saving(form, sent) {
  tell(form, "waiting", "Saving…");
  const answer = await sent;
  if (!answer.problem) return answer;
  const { title, detail, report = [] } = answer.problem;
  const messages = report.map(({ message }) => message).filter((each) => each && !detail.includes(each));
  tell(form, "error", [`${title}. ${detail}`, ...messages].join(" "));
  return undefined;
}

async function toggle(button) {
  button.disabled = true;
  const enable = button.getAttribute("aria-checked") !== "true";
  const { problem } = await put(button.dataset.rule, lf("enabled"), { kind: "literal", value: String(enable), datatype: "http://www.w3.org/2001/XMLSchema#boolean" });
  button.disabled = false;
  button.blur(); // or its section would wait for it
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  else button.setAttribute("aria-checked", String(enable));
  refresh();
}

/** Put a rule back as it is but for one statement; not if somebody has written it meanwhile. */
async function put(iri, predicate, object) {
  const response = await fetch(iri, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
  if (!response.ok) return send("PUT", iri, { body: "" });
  const start = `<${iri}> <${predicate}> `;
  const lines = (await response.text()).split("\n").filter((line) => !line.startsWith(start));
  const body = [...lines, `${start}${write(object)} .`, ""].join("\n");
  const tag = response.headers.get("etag");
  return send("PUT", iri, { body, headers: tag ? { "If-Match": tag } : {} });
}

/** The table of firings is that of their own page. */
async function showFirings() {
  const place = document.querySelector("[data-firings]");
  if (!place) return;
  const response = await fetch(place.dataset.firings, { headers: { Accept: "text/html" }, cache: "no-cache" });
  const page = pages.parseFromString(await response.text(), "text/html");
  const found = page.querySelector("#fired .scroll, #fired .empty");
  if (found) place.replaceChildren(document.importNode(found, true));
}

function tell(form, state, ...parts) {
  const output = form.querySelector("output.answer");
  output.dataset.state = state;
  output.replaceChildren(...parts);
}
