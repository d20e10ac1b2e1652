// What a message says that no live element shows: if that changes, the page has to be fetched again.

import { key } from "./ntriples.js";
import { RESULT_TIME, lf } from "./vocabulary.js";

// These change with every message and say nothing new.
const PASSING = new Set([lf("version"), lf("previousVersion"), lf("lastFrame"), lf("lastMoved"), lf("batteryCharge"), RESULT_TIME]);

/**
 * A text that is the same for two graphs that differ only in what is shown live, or in the names of blank nodes.
 *
 * @param {import("./ntriples.js").Graph} graph
 * @param {Set<string>} live pairs of subject and predicate, as `shownBy` gives them
 */
export function rest(graph, live) {
  const parts = [];
  // Each node is read once: of nodes that share nodes there are more paths than anybody has time for.
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
