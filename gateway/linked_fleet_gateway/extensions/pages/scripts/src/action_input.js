// The form of an action as the input of a step: filled from plain JSON, and read into it. Nothing here invokes the action.

import { say } from "./say.js";
import { complain, fieldNamed, fieldsFor, filled, own, partsOf, ready, wrongWith } from "./form.js";
import { fetchForm } from "./include.js";
import { unitSymbol } from "./vocabulary.js";

const BOOLEAN = "http://www.w3.org/2001/XMLSchema#boolean";
const NODE = "fieldset[data-path]";
const LEAF = "input[data-path], select[data-path], textarea[data-path]";

/**
 * Fetch the form of an action as one that sends nothing. Raises an error with a sentence.
 *
 * @param {string} action
 * @returns {Promise<HTMLFormElement>}
 */
export async function fetchInput(action) {
  const { form } = await fetchForm(action);
  harmless(form);
  return form;
}

/** Make of the form of an action one that sends nothing. */
function harmless(/** @type {HTMLFormElement} */ form) {
  for (const name of ["action", "methods", "needs"]) delete form.dataset[name];
  form.querySelectorAll(":scope > .buttons, :scope > output").forEach((each) => each.remove());
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    event.stopPropagation();
  });
  // Fields without a name in JSON cannot be part of a mission.
  for (const each of form.querySelectorAll(LEAF)) if (!each.dataset.member) (each.closest(".field") ?? each).remove();
  const options = form.querySelector(":scope > details.options");
  if (options && !options.querySelector("[data-path], template")) options.remove();
}

/** Whether a form has any field. */
export function hasFields(/** @type {HTMLFormElement} */ form) {
  return Boolean(form.querySelector("[data-path], template"));
}

/** Fill a form with an input in JSON. Types of nodes decide which other fields there are, so it is done twice. */
export function fill(/** @type {HTMLFormElement} */ form, /** @type {Record<string, any>} */ said) {
  fillNode(form, said);
  ready(form);
  fillNode(form, said);
  for (const details of form.querySelectorAll("details")) {
    details.open ||= /** @type {HTMLInputElement[]} */ ([...details.querySelectorAll(LEAF)]).some((each) => each.dataset.variable || (each.type !== "hidden" && each.value !== "" && !("selectedIndex" in each && each.selectedIndex === 0)));
  }
  ready(form);
}

function fillNode(container, said) {
  for (const place of container.querySelectorAll(".repeat")) if (nodeAbove(place) === container) grow(place, said);
  const seen = {};
  for (const part of partsOf(container)) {
    const { member } = part.dataset;
    if (!member) {
      fillNode(part, said);
      continue;
    }
    const value = Array.isArray(said[member]) ? said[member][(seen[member] = (seen[member] ?? -1) + 1)] : said[member];
    if (value === undefined || value === null) continue;
    if (part instanceof HTMLFieldSetElement) fillNode(part, typeof value === "object" ? value : {});
    else fillLeaf(part, value);
  }
}

function nodeAbove(part) {
  return part.parentElement.closest(`${NODE}, form`);
}

/** Add copies of a repeatable part until there is one for each value. */
function grow(place, said) {
  const template = place.querySelector(":scope > template");
  const member = template?.content.querySelector("[data-member]")?.dataset.member;
  const wanted = Array.isArray(said[member]) ? said[member].length : 0;
  const have = [...place.querySelectorAll(`[data-member="${CSS.escape(member ?? "")}"]`)].filter((each) => nodeAbove(each) === nodeAbove(place)).length;
  for (let index = have; index < wanted; index++) template.before(own(document.importNode(template.content, true)));
}

function fillLeaf(control, value) {
  if (typeof value === "object") {
    if (value.variable) control.dataset.variable = value.variable;
    return;
  }
  const text = String(value);
  if (control instanceof HTMLSelectElement && ![...control.options].some((each) => each.value === text)) {
    control.add(new Option(unitSymbol(text), text));
  }
  if (control.type !== "hidden") control.value = text;
}

/**
 * Return the input in JSON; fields that are wrong are left out, and marked if `mark` is true.
 *
 * @param {HTMLFormElement} form
 * @param {boolean} [mark]
 */
export function read(form, mark = false) {
  const wrong = [];
  const said = readNode(form, (control, problem) => {
    wrong.push(control);
    if (mark) complain(control, problem);
  });
  return { said, wrong };
}

function readNode(container, complaint) {
  const said = {};
  for (const part of partsOf(container)) {
    const isNode = part instanceof HTMLFieldSetElement;
    if (isNode && !filled(part) && !part.querySelector("[data-variable]") && !(Number(part.dataset.min) > 0)) continue;
    const value = isNode ? readNode(part, complaint) : valueOf(part, complaint);
    const { member } = part.dataset;
    if (value === undefined || (!member && !isNode)) continue;
    if (!member) Object.assign(said, value);
    else if (part.parentElement.closest(`.repeat, ${NODE}, form`).matches(".repeat")) (said[member] ??= []).push(value);
    else said[member] = value;
  }
  return said;
}

function valueOf(control, complaint) {
  const { variable, kind, datatype } = control.dataset;
  if (variable) return { variable };
  const problem = wrongWith(control);
  if (problem) complaint(control, problem);
  const text = control.value.trim();
  if (problem || text === "") return undefined;
  if (kind === "iri" || kind === "variable") return text.startsWith("?") ? undefined : new URL(text, document.baseURI).href;
  if (datatype === BOOLEAN) return text === "true";
  return control.type === "number" || control.inputMode === "decimal" ? Number(text) : control.value;
}

/** Let each field have a variable in place of a value. */
export function offerVariables(/** @type {HTMLFormElement} */ form, /** @type {string[]} */ names, /** @type {() => void} */ changed) {
  for (const field of /** @type {NodeListOf<HTMLElement>} */ (form.querySelectorAll(".field"))) {
    const control = /** @type {HTMLInputElement} */ (field.querySelector("[data-path]"));
    if (!control) continue;
    field.querySelector(":scope > .source")?.remove();
    const { variable } = control.dataset;
    const all = variable && !names.includes(variable) ? [...names, variable] : names;
    control.hidden = Boolean(variable);
    if (!all.length) continue;
    const label = field.querySelector("label")?.firstChild?.textContent.trim() ?? "value";
    const source = document.createElement("select");
    source.className = "source";
    source.setAttribute("aria-label", say("Where {label} comes from", { label }));
    source.append(new Option(say("this value"), ""), ...all.map((name) => new Option(name.includes(".") ? say("result {name}", { name }) : say("parameter {name}", { name }), name)));
    source.value = variable ?? "";
    source.addEventListener("change", (event) => {
      event.stopPropagation();
      if (source.value) control.dataset.variable = source.value;
      else delete control.dataset.variable;
      complain(control, "");
      control.hidden = Boolean(source.value);
      changed();
    });
    control.after(source);
  }
}

/** Show an error of the gateway at the field that it is about; return whether there is one. */
export function markField(/** @type {HTMLFormElement} */ form, { path = "", message = "" }) {
  const fields = path ? fieldsFor(form, path) : [fieldNamed(form, message)].filter(Boolean);
  if (fields.length !== 1) return false;
  complain(fields[0], message);
  for (let details = fields[0].closest("details"); details; details = details.parentElement.closest("details")) details.open = true;
  return true;
}
