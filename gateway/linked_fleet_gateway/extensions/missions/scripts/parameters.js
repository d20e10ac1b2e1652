// The parameters of a mission as a table.

import { say } from "../../pages/scripts/src/say.js";
import { button, choice, element } from "../../pages/scripts/src/elements.js";

const TYPES = { number: "number", integer: say("whole number"), boolean: say("yes or no"), text: "text", iri: "thing" };
const NUMERIC = ["number", "integer"];
const HEADS = [say("Name"), say("Type"), say("Least"), say("Greatest"), say("Options"), say("Default"), say("Delete")];

/**
 * @param {import("./builder.js").Builder} builder
 * @param {Map<string, string>} errors by the name of a parameter
 */
export function parameterTable(builder, errors) {
  const { parameters } = builder.mission;
  const rows = parameters.map((each, index) => row(builder, each, index, errors.get(each.name)));
  const head = element("tr", {}, ...HEADS.map((text) => element("th", { scope: "col" }, text)));
  const table = element("table", { className: "log" }, element("thead", {}, head), element("tbody", {}, ...rows));
  const scroll = element("div", { className: "scroll", tabIndex: 0, "role": "group", "aria-label": say("Parameters") }, table);
  const add = button(say("Add a parameter"), () => builder.changed(() => parameters.push({ name: freshName(parameters), type: "number" }), say("Add a parameter")));
  return element("div", { className: "parameters" }, parameters.length ? scroll : element("p", { className: "empty" }, say("None. Who runs the mission gives their values, and fields of steps may have them.")), add);
}

function freshName(parameters) {
  for (let count = 1; ; count++) if (!parameters.some(({ name }) => name === `value${count}`)) return `value${count}`;
}

function row(builder, parameter, index, error) {
  const cell = (...inner) => element("td", {}, ...inner);
  const named = (text) => say("{text} of {value}", { text, value: parameter.name || `parameter ${index + 1}` });
  const input = (member, type, label, read, given = {}) => {
    const made = element("input", { type, value: String(parameter[member] ?? ""), "aria-label": named(label), autocomplete: "off", ...given });
    if (type === "number") made.step = "any";
    made.addEventListener("change", () => builder.setParameter(parameter, member, read(made.value)));
    return made;
  };
  const type = choice(Object.entries(TYPES), parameter.type, { "aria-label": named(say("Type")) });
  type.addEventListener("change", () => builder.setParameter(parameter, "type", type.value));
  const numeric = NUMERIC.includes(parameter.type);
  const numberOf = (text) => (text === "" ? undefined : Number(text));
  const options = input("options", "text", say("Options"), (text) => text.split(",").map((each) => each.trim()).filter(Boolean), { placeholder: "one, another", disabled: !["text", "iri"].includes(parameter.type) });
  options.value = (parameter.options ?? []).join(", ");
  return element(
    "tr",
    {},
    cell(input("name", "text", say("Name"), (text) => text.trim()), error && element("small", { className: "error" }, error)),
    cell(type),
    cell(input("minimum", "number", say("Least"), numberOf, { disabled: !numeric })),
    cell(input("maximum", "number", say("Greatest"), numberOf, { disabled: !numeric })),
    cell(options),
    cell(initial(builder, parameter, named(say("Default")), input, numberOf)),
    cell(button(say("Delete"), () => builder.changed(() => builder.mission.parameters.splice(index, 1), say("Delete {name}", { name: parameter.name })), { className: "danger", "aria-label": say("Delete {name}", { name: parameter.name }) })),
  );
}

function initial(builder, parameter, label, input, numberOf) {
  if (parameter.type !== "boolean") return input("default", NUMERIC.includes(parameter.type) ? "number" : "text", say("Default"), NUMERIC.includes(parameter.type) ? numberOf : (text) => text || undefined);
  const made = choice([["", "–"], ["true", "yes"], ["false", "no"]], String(parameter.default ?? ""), { "aria-label": label });
  made.addEventListener("change", () => builder.setParameter(parameter, "default", made.value === "" ? undefined : made.value === "true"));
  return made;
}
