// Sends what a form contains, and shows the gateway's response.

import { say } from "./say.js";
import { complain, fieldNamed, fieldsFor, read } from "./form.js";
import { converted, number } from "./format.js";
import { contact } from "./ghost.js";
import { forgetPlan, keepPlan, withPlan } from "./kept_plan.js";
import { pathControls } from "./planned_path.js";
import { MATHS } from "./pose_of.js";
import { refresh } from "./region.js";
import { fresh, send } from "./request.js";
import { follow } from "./tasks.js";
import { NUMERICAL_VALUE, RDF_TYPE, TITLE, UNIT, UNKNOWN, lf, localName, unitSymbol } from "./vocabulary.js";

export function start() {
  document.addEventListener("submit", (event) => {
    if (!event.target.matches("form.invoke")) return;
    event.preventDefault();
    submit(event.target, event.submitter);
  });
}

async function submit(form, button) {
  if (form.getAttribute("aria-busy") === "true") return;
  const asks = form.querySelector("[data-path]") || form.dataset.classes;
  const said = asks ? read(form) : "";
  if (said === null) {
    answer(form, "error", say("Nothing was sent: see the fields that are marked."));
    return;
  }
  const asked = said || undefined; // who may leave all out sends no body: an empty one is a mistake
  const rehearsal = button?.dataset.prefer === "dry-run";
  const body = rehearsal ? asked : withPlan(form.dataset.action, asked);
  const method = form.dataset.methods?.split(/\s+/)[0] || "POST";
  const headers = { Prefer: rehearsal ? "dry-run" : "return=representation" };
  // What can be rehearsed is a motion; others do not recognise a repeated request, and refuse the field.
  if (!rehearsal && form.querySelector("[data-prefer=dry-run]")) headers["Idempotency-Key"] = key(form, body);
  if (form.dataset.match) headers["If-Match"] = form.dataset.match;
  form.setAttribute("aria-busy", "true");
  answer(form, "waiting", rehearsal ? say("Trying…") : say("Asking…"));
  const got = await send(method, form.dataset.action, { body, headers });
  form.removeAttribute("aria-busy");
  // A request without a response may have been executed: sent again unchanged, it has the same idempotency key.
  if (got.status) delete form.dataset.key;
  if (got.status && !rehearsal) forgetPlan();
  if (rehearsal) keepPlan(form.dataset.action, asked, got.graph);
  if (got.problem) refused(form, got);
  else if (rehearsal) rehearsed(form, got.graph);
  else done(form, got);
}

function key(form, body) {
  const [known, said] = JSON.parse(form.dataset.key ?? "[]");
  const now = said === (body ?? "") ? known : fresh();
  form.dataset.key = JSON.stringify([now, body ?? ""]);
  return now;
}

/** @param {HTMLFormElement} form @param {import("./request.js").Answer} got */
function done(form, got) {
  const { graph, location } = got;
  delete form.dataset.touched;
  const made = location && graph;
  if (made && graph.values(location, RDF_TYPE).some(({ value }) => value === lf("Invocation"))) {
    answer(form, "done", "");
    follow(location, graph, form, () => form.dispatchEvent(new Event("over")));
  } else if (location) {
    answer(form, "done", "Done: ", link(location, graph?.value(location, TITLE)?.value ?? (titleIn(form) || location)));
  } else {
    const unchecked = uncheckedLinks(graph);
    answer(form, "done", say("Done."), ...(unchecked.length ? [list(unchecked)] : []));
  }
  form.dispatchEvent(new CustomEvent("saved", { bubbles: true, detail: location }));
  refresh();
}

/** The name of what a form creates. */
function titleIn(form) {
  return form.querySelector(`input[data-path="${TITLE}"]`)?.value.trim();
}

/** @param {HTMLFormElement} form @param {import("./request.js").Answer} got */
function refused(form, got) {
  const { problem, location } = got;
  const { title, detail, report = [], things = [], names = [], point, retryWith = [] } = problem;
  const left = report.filter((result) => !mark(form, result));
  if (!report.length) markTerm(form, detail ?? "");
  const parts = [strong(title), detail ? ` ${detail}` : ""];
  const messages = [...new Set(left.map(({ message }) => message).filter(Boolean))].filter((each) => !detail?.includes(each));
  if (messages.length) parts.push(list(messages));
  if (names.length) parts.push(list(things.map((iri, index) => link(iri, names[index] ?? localName(iri)))));
  const other = retryWith.map((add) => wayRound(form, add)).filter(Boolean);
  if (other.length) {
    const bar = Object.assign(document.createElement("p"), { className: "buttons" });
    bar.append(...other);
    parts.push(bar);
  }
  answer(form, "error", ...parts);
  contact(point);
  // Without an answer from the robot this is no refusal: the invocation shows the outcome.
  if (location) follow(location, undefined, form);
}

/** Return a button that tries the request with a further member, if the form has its field. */
function wayRound(form, { path = "" }) {
  const choice = form.querySelector(`select[data-path="${lf("path")}"]`);
  const dry = form.querySelector("button[data-prefer=dry-run]");
  if (!path || !choice || !dry) return undefined;
  const button = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: say("Look for a way round it") });
  button.addEventListener("click", () => {
    choice.value = path;
    dry.click();
  });
  return button;
}

/** Show a result of the validation report at its field; return whether it has one. */
function mark(form, { path = "", message = "", value = undefined }) {
  if (!path || !message) return false;
  const fields = fieldsFor(form, path);
  const meant = fields.find((each) => value !== undefined && each.value === value) ?? (fields.length === 1 ? fields[0] : undefined);
  if (meant) complain(meant, message);
  return Boolean(meant);
}

/** Show a refusal without a report at the field of the term that it begins with, such as "lf:condition: …". */
function markTerm(form, detail) {
  const field = fieldNamed(form, detail);
  if (field) complain(field, detail);
}

/** How forms of other modules show a response. */
export const outcome = {
  waiting: (form) => answer(form, "waiting", say("Asking…")),
  none: (form) => answer(form, "", ""),
  begun: (form, got) => (got.problem ? refused(form, got) : answer(form, "done", "")),
  rehearsed: (form, got) => (got.problem ? refused(form, got) : rehearsed(form, got.graph, false)),
};

/** @param {boolean} full whether to list where each joint would be, which a scene shows as well */
function rehearsed(form, graph, full = true) {
  const [root, facts] = [...(graph?.subjects ?? [])].find(([, each]) => each.get(RDF_TYPE)?.some(({ value }) => value === lf("Rehearsal"))) ?? [];
  if (!root) {
    answer(form, "done", say("The action is possible; nothing has moved."));
    return;
  }
  const lines = [];
  for (const [predicate, name] of [["duration", say("it would take")], ["pathDeviation", say("off the line by at most")], ["leastManipulability", say("manipulability of at least")], ["positionResidual", say("off the position by")], ["orientationResidual", say("off the orientation by")]]) {
    const node = graph.value(root, lf(predicate));
    if (node) lines.push(`${name} ${quantity(graph, `_:${node.value}`)}`);
  }
  if (full) for (const target of graph.values(root, lf("target"))) lines.push(targetOf(graph, `_:${target.value}`));
  for (const { value } of facts.get(lf("plannedBecause")) ?? []) lines.push(say("on a planned path: {value}", { value }));
  if (facts.has(lf("plan"))) lines.push(say("this very motion is kept, to be carried out next"));
  const near = closestIn(graph, root);
  if (near) lines.push(near.text);
  for (const { value } of facts.get(lf("preempts")) ?? []) lines.push(say("it would end {localName}", { localName: localName(value) }));
  for (const { value } of facts.get(lf("unchecked")) ?? []) lines.push(uncheckedLink(graph, `_:${value}`));
  lines.push(...stepsOf(graph, facts.get(lf("stepRehearsal")) ?? []));
  const path = pathControls(graph);
  answer(form, "rehearsed", strong(say("It would work; nothing has moved.")), list(lines), ...(path ? [path] : []));
  contact(near?.point, false);
  form.dispatchEvent(new CustomEvent("rehearsed", { bubbles: true, detail: graph }));
}

/** Return how many steps of a mission are rehearsed, and why others are not. */
function stepsOf(graph, nodes) {
  const of = ({ value }, term) => graph.value(`_:${value}`, term)?.value;
  const left = nodes.filter((each) => of(each, lf("reason")) !== undefined);
  const said = left.map((each) => `${of(each, TITLE) ?? of(each, lf("stepPath"))}: ${of(each, lf("reason"))}`);
  return nodes.length ? [say("{value} of {length} steps are rehearsed", { value: nodes.length - left.length, length: nodes.length }), ...said] : [];
}

/** Return where a motion comes closest to something, in words and as a point in the world. */
function closestIn(graph, root) {
  const found = graph.value(root, lf("closest"));
  if (!found) return undefined;
  const node = `_:${found.value}`;
  const apart = quantity(graph, `_:${graph.value(node, lf("clearance"))?.value}`);
  const [share, time] = ["share", "atTime"].map((each) => graph.value(node, lf(each))?.value);
  const when = time === undefined ? say("after {percent} % of the way", { percent: Math.round(100 * Number(share)) }) : say("after {value} s", { value: Number(time).toFixed(1) });
  const place = graph.value(node, lf("position"));
  const point = place && ["x", "y", "z"].map((axis) => Number(graph.value(`_:${place.value}`, MATHS + axis)?.value));
  return { text: say("closest {when}: {apart} between {value}", { when, apart, value: graph.value(node, TITLE)?.value }), point };
}

/** @returns {string[]} the links that no check of motions covers, after the change of a placement */
function uncheckedLinks(graph) {
  const nodes = [...(graph?.subjects ?? [])].flatMap(([, facts]) => facts.get(lf("unchecked")) ?? []);
  return nodes.map(({ value }) => uncheckedLink(graph, `_:${value}`));
}

function uncheckedLink(graph, node) {
  const [link, mesh, reason] = ["ofLink", "meshUri", "reason"].map((each) => graph.value(node, lf(each))?.value ?? "");
  return say("not checked for collisions: {localName} ({value}{reason})", { localName: localName(link), value: mesh ? `${mesh}: ` : "", reason });
}

function targetOf(graph, node) {
  const joint = graph.value(node, lf("ofJoint"))?.value ?? "";
  const value = graph.value(node, lf("value"));
  return say("{localName} would be at {value}", { localName: localName(joint), value: value ? quantity(graph, `_:${value.value}`) : "an unknown place" });
}

function quantity(graph, node) {
  const value = graph.value(node, NUMERICAL_VALUE)?.value;
  const symbol = unitSymbol(graph.value(node, UNIT)?.value ?? "");
  if (value === undefined || value === UNKNOWN) return "unknown";
  const also = converted(Number(value), symbol);
  return `${number(Number(value))} ${symbol}${also ? ` (${also})` : ""}`.trim();
}

function answer(form, state, ...parts) {
  let output = form.querySelector("output.answer");
  if (!output) {
    output = document.createElement("output");
    output.className = "answer";
    output.setAttribute("role", "status");
    form.append(output);
  }
  contact();
  output.dataset.state = state;
  output.replaceChildren(...parts);
}

function strong(text) {
  const element = document.createElement("strong");
  element.textContent = text;
  return element;
}

/** @param {(string|Node)[]} items */
function list(items) {
  const element = document.createElement("ul");
  for (const item of items) element.appendChild(document.createElement("li")).append(item);
  return element;
}

function link(href, text) {
  return Object.assign(document.createElement("a"), { href, textContent: text });
}
