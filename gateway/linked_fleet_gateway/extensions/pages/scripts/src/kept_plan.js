// The plan of the latest dry run: the same request with it takes the very path that was shown, or is refused.

import { write } from "./ntriples.js";
import { lf } from "./vocabulary.js";

/** @type {{action: string, body: string, plan: import("./ntriples.js").Term}|undefined} */
let kept;

/**
 * Keep the plan that a dry run has offered, in place of the one before.
 *
 * @param {string} action
 * @param {string|undefined} body of the dry run
 * @param {import("./ntriples.js").Graph|undefined} graph its answer
 */
export function keepPlan(action, body, graph) {
  const [plan] = [...(graph?.subjects.values() ?? [])].flatMap((facts) => facts.get(lf("plan")) ?? []);
  kept = plan && body ? { action, body, plan } : undefined;
}

/** Return the body with the plan of the latest dry run, if that was of the same request. */
export function withPlan(action, body) {
  if (!kept || kept.action !== action || kept.body !== body) return body;
  const root = body.slice(0, body.indexOf(" "));
  return `${root} ${write({ kind: "iri", value: lf("plan") })} ${write(kept.plan)} .\n${body}`;
}

/** Forget the plan once it was answered: without an answer, the same request is sent again with the same key. */
export function forgetPlan() {
  kept = undefined;
}
