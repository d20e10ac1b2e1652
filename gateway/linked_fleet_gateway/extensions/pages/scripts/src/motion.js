// Motions requested outside `form.invoke`: tried, begun and followed, with the outcome in the form.

import { outcome } from "./act.js";
import { ghost } from "./ghost.js";
import { forgetPlan, keepPlan, withPlan } from "./kept_plan.js";
import { fresh, send } from "./request.js";
import { positionsIn } from "./targets.js";
import { follow } from "./tasks.js";
import { DECIMAL, NUMERICAL_VALUE, RDF_TYPE, lf } from "./vocabulary.js";
import { write } from "./ntriples.js";

const UNIT_TERM = "http://vocab.arvida.de/2015/06/vom/vocab#unit";
const UNITS = "http://qudt.org/vocab/unit/";
const DECIMALS = 6;

/** @typedef {{joint: string, position: number, unit: string}} JointTarget in rad or m; the unit is a local name */

/**
 * Return a body that moves joints together.
 *
 * @param {JointTarget[]} targets
 * @param {number} [speedScale]
 */
export function jointTargets(targets, speedScale = 1) {
  const lines = [["_:m", iri(RDF_TYPE), iri(lf("JointTargets"))]];
  if (speedScale !== 1) lines.push(["_:m", iri(lf("speedScale")), decimal(speedScale)]);
  targets.forEach(({ joint, position, unit }, index) => {
    const node = `_:t${index}`;
    lines.push(["_:m", iri(lf("target")), node]);
    lines.push([node, iri(lf("ofJoint")), iri(joint)]);
    lines.push([node, iri(NUMERICAL_VALUE), decimal(position)]);
    lines.push([node, iri(UNIT_TERM), iri(UNITS + unit)]);
  });
  return lines.map((line) => `${line.join(" ")} .\n`).join("");
}

const iri = (value) => write({ kind: "iri", value });
const decimal = (value) => write({ kind: "literal", value: value.toFixed(DECIMALS), datatype: DECIMAL });

/** The requests of a form: only the response to the latest one counts. */
export class Motion {
  /** @param {HTMLFormElement} form with an `output.answer` */
  constructor(form) {
    this.form = form;
    this.latest = 0;
  }

  /** Show where joints would be before the gateway has checked it. */
  preview(joints) {
    this.latest++;
    ghost(joints);
  }

  /**
   * Do a dry run.
   *
   * @param {string} action
   * @param {string} body
   * @param {Map<string, number>} [joints] the joints in the body
   */
  async rehearse(action, body, joints) {
    const mine = ++this.latest;
    if (joints) ghost(joints);
    const got = await send("POST", action, { body, headers: { Prefer: "dry-run" } });
    if (mine !== this.latest) return;
    keepPlan(action, body, got.graph);
    outcome.rehearsed(this.form, got);
    ghost(targetsIn(got.graph) ?? joints, Boolean(got.problem));
  }

  /** Begin the motion. @returns {Promise<boolean>} whether it was accepted */
  async begin(action, body) {
    this.latest++;
    this.form.setAttribute("aria-busy", "true");
    outcome.waiting(this.form);
    const headers = { Prefer: "return=representation", "Idempotency-Key": fresh() };
    const got = await send("POST", action, { body: withPlan(action, body), headers });
    if (got.status) forgetPlan();
    this.form.removeAttribute("aria-busy");
    outcome.begun(this.form, got);
    if (got.problem) return false;
    if (got.location) follow(got.location, got.graph, this.form, () => ghost());
    return true;
  }

  /** Ignore the responses to former requests. */
  forget() {
    this.latest++;
    outcome.none(this.form);
    ghost();
  }
}

/** @returns {Map<string, number>|undefined} the resulting positions according to a dry run */
export function targetsIn(graph) {
  for (const [root, facts] of graph?.subjects ?? []) {
    if (!facts.get(RDF_TYPE)?.some(({ value }) => value === lf("Rehearsal"))) continue;
    const found = positionsIn(graph, root);
    if (found.size) return found;
  }
  return undefined;
}
