// Compares messages without live values: if the rest changes, the page has to be fetched again.

import { key } from "./ntriples.js";
import { RESULT_TIME, lf } from "./vocabulary.js";

// These change with every message without being news.
const PASSING = new Set([lf("version"), lf("previousVersion"), lf("eventId"), lf("lastFrame"), lf("lastMoved"), lf("batteryCharge"), RESULT_TIME]);

/**
 * Return a text that is equal for graphs that differ only in live values or in the labels of blank nodes.
 *
 * @param {import("./ntriples.js").Graph} graph
 * @param {Set<string>} live pairs of subject and predicate, as `shownBy` gives them
 */
export function rest(graph, live) {
  const parts = [];
  // Each node is read once: through shared nodes there may be an exponential number of paths.
  const pending = [...graph.subjects.keys()].filter((subject) => !subject.startsWith("_:"));
  const numbers = new Map();
  const numbered = (blank) => {
    if (!numbers.has(blank)) {
      numbers.set(blank, `_:${numbers.size}`);
      pending.push(blank);
    }
    return numbers.get(blank);
  };
  for (const subject of pending) {
    parts.push(numbers.get(subject) ?? subject);
    for (const [predicate, objects] of graph.subjects.get(subject) ?? []) {
      if (PASSING.has(predicate) || live.has(`${subject} ${predicate}`)) continue;
      parts.push(predicate, ...objects.map((term) => (term.kind === "blank" ? numbered(key(term)) : term.value)));
    }
    parts.push(";");
  }
  return parts.join("\n");
}
