// Forms generated from shapes: validated, and read into triples.

import { say } from "./say.js";
import { write } from "./ntriples.js";
import { adopt } from "./region.js";
import { DECIMAL, DOUBLE, RDF_TYPE, lf, localName } from "./vocabulary.js";
import { applyLimits, outside } from "./limits.js";

const FORM = "form.invoke";
const LEAF = "input[data-path], select[data-path], textarea[data-path]";
const NODE = "fieldset[data-path]";

export function start() {
  adopt(prepare);
  document.addEventListener("input", ({ target }) => touched(target));
  document.addEventListener("change", ({ target }) => touched(target));
  document.addEventListener("click", repeat);
}

function prepare(root) {
  for (const form of root.querySelectorAll(FORM)) ready(form);
}

/** @param {HTMLFormElement} form that has just come to the page */
export function ready(form) {
  // The browser's own validation would demand fields in optional parts that stay empty.
  form.noValidate = true;
  fit(form);
  applyLimits(form);
}

/** Show the fields for the chosen type of their node, and no others. */
function fit(form) {
  for (const part of form.querySelectorAll("[data-when]")) {
    const type = part.parentElement.closest(`${NODE}, ${FORM}`).querySelector(`select[data-path="${RDF_TYPE}"]`);
    const unfit = Boolean(type) && !part.dataset.when.split(" ").includes(type.value);
    part.hidden = unfit;
    for (const control of part.matches("fieldset") ? [part] : part.querySelectorAll(LEAF)) control.disabled = unfit;
  }
}

function touched(control) {
  const form = control.closest?.(FORM);
  if (!form) return;
  form.dataset.touched = "";
  complain(control, "");
  fit(form);
  applyLimits(form);
}

/** Buttons that add and remove repeatable parts. */
function repeat({ target }) {
  const button = target.closest?.("button[data-add], button[data-remove]");
  const form = button?.closest(FORM);
  if (!form) return;
  form.dataset.touched = "";
  if (button.dataset.remove !== undefined) {
    const gone = button.closest("[data-repeat]") ?? button.closest(NODE);
    const near = gone.parentElement.querySelector("button[data-add]") ?? gone.parentElement.closest("fieldset, form");
    gone.remove();
    near?.focus();
    return;
  }
  const template = templateOf(button);
  if (!template || full(template.parentElement)) return;
  const fresh = own(document.importNode(template.content, true));
  const first = fresh.firstElementChild;
  template.before(fresh);
  applyLimits(form);
  first?.querySelector("input:not([type=hidden]), select, textarea")?.focus();
}

/** Return whether a repeatable part has its maximum number of copies. */
function full(place) {
  const most = Number(place.dataset.max ?? Infinity);
  return [...place.children].filter((each) => each.matches(`${NODE}, .field, [data-repeat]`)).length >= most;
}

function templateOf(button) {
  const named = button.dataset.add && document.getElementById(button.dataset.add);
  return named || button.parentElement.querySelector(":scope > template") || button.closest("fieldset, form")?.querySelector("template");
}

let copies = 0;

/** Rename ids in a copied part, so that each label still has exactly one field. */
export function own(fragment) {
  const mark = `-${++copies}`;
  const names = new Set([...fragment.querySelectorAll("[id]")].map((each) => each.id));
  for (const attribute of ["id", "for", "list", "aria-describedby", "aria-labelledby", "aria-controls", "data-add"]) {
    for (const each of fragment.querySelectorAll(`[${attribute}]`)) {
      const renamed = each.getAttribute(attribute).split(" ").map((name) => (names.has(name) ? name + mark : name));
      each.setAttribute(attribute, renamed.join(" "));
    }
  }
  return fragment;
}

/**
 * Return the form as N-Triples about a blank node, or null if something is invalid, which is then shown at its field.
 *
 * @param {HTMLFormElement} form
 * @returns {string|null}
 */
export function read(form) {
  for (const leaf of form.querySelectorAll(LEAF)) complain(leaf, "");
  for (const node of form.querySelectorAll(NODE)) complain(node, "");
  const said = new Body(complain, "form");
  said.node(form, form.dataset.classes);
  for (const { parentElement } of said.wrong) open(parentElement);
  said.wrong[0]?.focus();
  return said.wrong.length ? null : said.text();
}

/**
 * Return the present contents as N-Triples about `_:n0`; invalid fields are left out.
 *
 * @param {HTMLFormElement} form
 * @returns {string}
 */
export function draft(form) {
  const said = new Body(() => {});
  said.node(form, form.dataset.classes);
  return said.lines.join("");
}

/** Unfold what contains a field, which otherwise could not be seen or focused. */
function open(element) {
  for (let details = element.closest("details"); details; details = details.parentElement.closest("details")) {
    details.open = true;
  }
}

class Body {
  /** @param {string} prefix of the labels of blank nodes: what people write in Turtle has others */
  constructor(complaint = complain, prefix = "n") {
    this.complaint = complaint;
    this.prefix = prefix;
    this.lines = [];
    this.texts = [];
    this.wrong = [];
    this.nodes = 0;
  }

  node(container, classes) {
    const name = this.blank();
    for (const type of (classes ?? "").split(/\s+/).filter(Boolean)) this.say(name, RDF_TYPE, { kind: "iri", value: type });
    for (const part of partsOf(container)) {
      if (part instanceof HTMLFieldSetElement) this.part(name, part);
      else this.leaf(name, part);
    }
    return name;
  }

  blank() {
    return { kind: "blank", value: `${this.prefix}${this.nodes++}` };
  }

  /** Turtle: what people have written comes last, since their prefixes hold from there. */
  text() {
    return [this.lines.join(""), ...this.texts].join("\n");
  }

  part(name, fieldset) {
    if (!filled(fieldset) && !(Number(fieldset.dataset.min) > 0)) return;
    this.say(name, fieldset.dataset.path, this.node(fieldset, fieldset.dataset.classes));
  }

  leaf(name, control) {
    const problem = wrongWith(control);
    if (problem) {
      this.complaint(control, problem);
      this.wrong.push(control);
    } else if (control.type === "checkbox" ? control.checked || control.required : control.value !== "") {
      this.say(name, control.dataset.path, this.term(control));
    }
  }

  term(control) {
    const { kind } = control.dataset;
    const value = control.value.trim();
    if (kind === "turtle") {
      this.texts.push(`${control.value}\n`);
      return { kind: "blank", value: "body" };
    }
    if (kind !== "variable" || !value.startsWith("?")) return term(control);
    const node = this.blank();
    this.say(node, lf("variable"), { kind: "literal", value: value.slice(1) });
    return node;
  }

  say(subject, predicate, object) {
    this.lines.push(`${write(subject)} ${write({ kind: "iri", value: predicate })} ${write(object)} .\n`);
  }
}

/** Return the fields and nested nodes of this node, without those inside nested nodes. */
export function partsOf(container) {
  const owner = (each) => each.parentElement.closest(`${NODE}, ${FORM}`);
  return [...container.querySelectorAll(`${LEAF}, ${NODE}`)].filter((each) => owner(each) === container && !each.disabled);
}

/** Return whether somebody has filled in anything; preselected options do not count. */
export function filled(fieldset) {
  return [...fieldset.querySelectorAll(LEAF)].some((each) => {
    if (each.type === "hidden") return false;
    if (each.type === "checkbox") return each.checked;
    if (each instanceof HTMLSelectElement) return each.value !== initial(each);
    return each.value.trim() !== each.defaultValue || each.validity.badInput;
  });
}

function initial(select) {
  return ([...select.options].find((option) => option.defaultSelected) ?? select.options[0])?.value;
}

export function wrongWith(control) {
  const { validity } = control;
  if (control.type === "hidden") return "";
  if (validity.badInput) return say("This is no number.");
  if (control.dataset.kind === "variable" && !control.value.startsWith("?") && !URL.canParse(control.value, document.baseURI)) return say("This is no address.");
  if (control.value === "") return control.required && control.type !== "checkbox" ? say("This is needed.") : "";
  const range = outside(control);
  if (range) return range;
  if (validity.patternMismatch) return control.title || say("This does not have the right form.");
  // Steps are for the arrow keys; any number within the limits is valid.
  return validity.typeMismatch || validity.tooLong ? control.validationMessage : "";
}

function term(control) {
  const { kind, datatype } = control.dataset;
  const value = control.type === "checkbox" ? String(control.checked) : control.value.trim();
  if (kind === "iri" || kind === "variable") return { kind: "iri", value: new URL(value, document.baseURI).href };
  if (datatype) return { kind: "literal", value: control.type === "datetime-local" ? new Date(value).toISOString() : value, datatype };
  const numeric = control.type === "number" || control.inputMode === "decimal";
  return { kind: "literal", value, datatype: numeric ? (/e/i.test(value) ? DOUBLE : DECIMAL) : undefined };
}

let complaints = 0;

/** Show an error beside a field; an empty text removes it. */
export function complain(control, text) {
  control.setCustomValidity?.(text);
  const there = document.getElementById(control.dataset.complaint ?? "");
  if (!text) {
    there?.remove();
    if (!control.dataset.complaint) return;
    describe(control, control.dataset.complaint, false);
    delete control.dataset.complaint;
    control.removeAttribute("aria-invalid");
    return;
  }
  const message = there ?? document.createElement("small");
  message.id ||= `complaint-${++complaints}`;
  message.className = "error";
  message.textContent = text;
  if (!there) (control.closest("label") ?? control)[control instanceof HTMLFieldSetElement ? "append" : "after"](message);
  control.dataset.complaint = message.id;
  control.setAttribute("aria-invalid", "true");
  describe(control, message.id, true);
}

/** Add or remove a description of a field, besides its other ones. */
export function describe(control, id, on) {
  const ids = new Set((control.getAttribute("aria-describedby") ?? "").split(/\s+/).filter(Boolean));
  ids[on ? "add" : "delete"](id);
  if (ids.size) control.setAttribute("aria-describedby", [...ids].join(" "));
  else control.removeAttribute("aria-describedby");
}

/** Return the controls and nodes to which a path of a validation report may refer. */
export function fieldsFor(form, path) {
  return [...form.querySelectorAll(`${LEAF}, ${NODE}`)].filter((each) => each.dataset.path === path && each.type !== "hidden");
}

/** Return the only field of the term with which a sentence begins, such as "lf:condition: …". */
export function fieldNamed(form, sentence) {
  const term = /^[\w-]+:([\w-]+)/.exec(sentence)?.[1];
  const fields = [...form.querySelectorAll(`${LEAF}, ${NODE}`)].filter((each) => each.type !== "hidden" && localName(each.dataset.path) === term);
  return fields.length === 1 ? fields[0] : undefined;
}
