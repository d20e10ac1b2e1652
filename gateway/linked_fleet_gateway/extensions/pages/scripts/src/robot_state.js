// The joints of the robot of this page, from its frames, for the table, the sliders, the chart and other listeners.

import { give } from "./live.js";
import { graphOfState } from "./frames.js";
import { fetchState } from "./scene_state.js";
import { watch } from "./socket.js";

const INTERVAL_S = 0.033; // 30 Hz
const AGAIN_MS = 2000;

/** @typedef {import("./scene_state.js").JointState} JointState */
/** @typedef {import("./scene_state.js").Values} Values */

/** @type {Set<(state: JointState, values: Values) => void>} */
const listeners = new Set();
/** @type {JointState|undefined} */
let state;
/** @type {Values|undefined} */
let latest;
let incarnation;
let fetching = false;

/** Call a function with the joints: at once if they are known, and with every frame, until the returned function is called. */
export function onJoints(listener) {
  listeners.add(listener);
  if (state && latest) listener(state, latest);
  return () => listeners.delete(listener);
}

export function start() {
  const { state: drawn, jointState: charted } = document.querySelector("[data-state][data-model], [data-joint-state]")?.dataset ?? {};
  const iri = drawn ?? charted;
  if (!iri) return;
  describe(iri).then(() => watch(iri, { protocol: "lf.frame", interval: INTERVAL_S }, (frame) => take(iri, frame)));
}

/** Another run of the agent may have other joints. */
async function describe(iri) {
  if (fetching) return;
  fetching = true;
  try {
    state = await fetchState(iri);
    incarnation = undefined;
    tell(iri, state.present);
  } catch (error) {
    console.debug("the joint state cannot be had at present:", error);
    setTimeout(() => describe(iri), AGAIN_MS);
  } finally {
    fetching = false;
  }
}

function take(iri, frame) {
  const values = state?.decode(frame);
  if (!values || (incarnation !== undefined && values.incarnation !== incarnation)) {
    describe(iri);
    return;
  }
  ({ incarnation } = values);
  tell(iri, values);
}

function tell(iri, values) {
  latest = values;
  // The page already shows the velocities of the first description.
  if (values.velocities) give(iri, graphOfState(iri, state, values));
  for (const listener of listeners) listener(state, values);
}
