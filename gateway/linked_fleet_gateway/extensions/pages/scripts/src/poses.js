// Named poses as buttons: each sets the targets of all its joints, and the button of the sliders moves them.

import { notice } from "./notice.js";
import { key } from "./ntriples.js";
import { send } from "./request.js";
import { aim } from "./sliders.js";
import { NUMERICAL_VALUE, lf } from "./vocabulary.js";

export function start() {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button[data-pose]");
    if (button?.dataset.pose) fetchTargets(button.dataset.pose);
    else if (button) aim(new Map(Object.entries(JSON.parse(button.dataset.targets))));
  });
}

/** Aim at a pose that is a resource of its own, whose positions are in rad or m. */
async function fetchTargets(iri) {
  const { graph, problem } = await send("GET", iri);
  if (!graph) return notice(`${problem.title}. ${problem.detail}`);
  const said = graph.values(iri, lf("target")).map(key);
  aim(new Map(said.map((each) => [graph.value(each, lf("ofJoint"))?.value, Number(graph.value(each, NUMERICAL_VALUE)?.value)])));
}
