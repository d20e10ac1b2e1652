// The present by the clock of a robot's agent, by which its values are measured, and until when a value is known.

import { lastHeardMs } from "./heartbeat.js";

/** A value without news for this long rests; that of a moving robot comes more often. */
export const STILL_S = 0.3;

/** Return whether values that come would be shown: the gateway is heard, and the robot is online. */
export function isCurrent() {
  const { connection = "live", presence } = document.body.dataset;
  return connection === "live" && presence !== "offline";
}

/** Call a function when `isCurrent` may have changed. */
export function onCurrency(/** @type {() => void} */ listener) {
  new MutationObserver(listener).observe(document.body, { attributeFilter: ["data-connection", "data-presence"] });
}

export class AgentClock {
  /** The agent's clock less that of this page in seconds; undefined while nothing has told it. */
  constructor() {
    /** @type {number|undefined} */
    this.ahead = undefined;
  }

  /** Note when something was measured. Nothing comes before it is measured, so the latest of all is the best measure. */
  note(/** @type {number} */ timeS) {
    this.ahead = Math.max(this.ahead ?? -Infinity, timeS - performance.now() / 1000);
  }

  /** @returns {number|undefined} the present */
  get now() {
    return this.ahead === undefined ? undefined : performance.now() / 1000 + this.ahead;
  }

  /** @returns {number|undefined} when the gateway was heard last: until then a value without news has not changed */
  get heard() {
    return this.ahead === undefined ? undefined : lastHeardMs() / 1000 + this.ahead;
  }

  /** Return until when a value is known that was stated last at this time. */
  knownUntil(/** @type {number} */ stated) {
    const { heard } = this;
    return heard !== undefined && heard - stated > STILL_S && isCurrent() ? heard : stated;
  }
}
