// What a message says that no live element shows: if that changes, the page has to be fetched again.

import { key } from "./ntriples.js";
import { RESULT_TIME, lf } from "./vocabulary.js";

// These change with every message and say nothing new.
const PASSING = new Set([lf("version"), lf("previousVersion"), lf("lastFrame"), RESULT_TIME]);

/**
 * A text that is the same for two graphs that differ only in what is shown live, or in the names of blank nodes.
 *
 * @param {import("./ntriples.js").Graph} graph
 * @param {Set<string>} live pairs of subject and predicate, as `shownBy` gives them
 */
export function rest(graph, live) {
  const parts = [];
  const node = (subject, depth) => {
    for (const [predicate, objects] of graph.subjects.get(subject) ?? []) {
      if (PASSING.has(predicate) || live.has(`${subject} ${predicate}`)) continue;
      parts.push(predicate);
      for (const term of objects) {
        if (term.kind !== "blank") parts.push(term.value);
        else if (depth < 32) node(key(term), depth + 1);
      }
    }
    parts.push(";");
  };
  for (const subject of graph.subjects.keys()) {
    if (subject.startsWith("_:")) continue;
    parts.push(subject);
    node(subject, 0);
  }
  return parts.join("\n");
}
