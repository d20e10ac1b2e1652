// A step in a few words.

import { say } from "../../pages/scripts/src/say.js";
import { localName, segments, unitSymbol, words } from "../../pages/scripts/src/vocabulary.js";

const MOST = 80;

/** @returns {string} */
export function summary(/** @type {import("./mission_tree.js").Node} */ { type, said }) {
  const own = said.title || said.name;
  const about = { invoke: invocation, repeat, wait, confirm: textOf, notify: textOf, parallel: several }[type]?.(said) ?? "";
  return [own, about].filter(Boolean).join(": ").slice(0, 160);
}

function invocation({ action = "", kind = "", of, body }) {
  if (!action && !kind) return say("no action chosen");
  const told = Object.entries(body ?? {}).filter(([, value]) => typeof value !== "object" || value?.variable).slice(0, 3).map(([name, value]) => valueIn(name, value));
  const at = typeof of === "object" ? of.variable : localName(of ?? "");
  return [action ? nameOf(action) : say("{words} of {at}", { words: words(localName(kind)), at }), told.join(" ")].filter(Boolean).join(", ");
}

/** `…/ur5/elbow_joint/actions/rotate` is "rotate elbow_joint of ur5". */
export function nameOf(/** @type {string} */ action) {
  const found = segments(action);
  const at = found.indexOf("actions");
  const [robot, ...part] = found.slice(0, Math.max(at, 0));
  const name = words(found.at(-1) ?? "");
  if (robot === "missions") return say("run another mission");
  return part.length ? say("{name} {part} of {robot}", { name, part: part.join(" "), robot }) : robot ? `${name}, ${robot}` : name;
}

function valueIn(name, value) {
  if (typeof value === "object") return `${name} = ${value.variable}`;
  const text = String(value);
  if (name === "unit") return unitSymbol(text);
  return `${name} ${/^https?:/.test(text) ? localName(text) : text}`;
}

function repeat({ times }) {
  return say("{times} times", { times });
}

function several({ anySuffices }) {
  return anySuffices ? say("one is enough") : "";
}

function wait({ seconds, until, condition }) {
  if (until) return say("until {until}", { until });
  return condition ? say("until {value}", { value: condition.replace(/\s+/g, " ").slice(0, MOST) }) : `${seconds ?? ""} s`;
}

function textOf({ text = "" }) {
  return text.slice(0, MOST);
}
