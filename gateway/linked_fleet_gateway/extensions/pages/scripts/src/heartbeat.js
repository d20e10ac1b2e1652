// Detects a gateway that hangs: its connections stay open, and scripts cannot see WebSocket pings.

import { agree } from "./gateway_clock.js";

const PERIOD_MS = 500;
const ASK_AFTER_MS = 2000;
export const SILENT_MS = 5000;

let heardMs = 0;
let tickedMs = 0;
let asking = false;
let silent = false;
let report = () => {};

/** Note a message from the gateway. */
export function heard() {
  heardMs = performance.now();
  if (silent) become(false);
}

/**
 * Send a request whenever the gateway has been silent for two seconds while the page is visible.
 *
 * @param {() => boolean} needed whether the page follows anything at present
 * @param {() => void} changed is called when `isSilent` changes
 */
export function start(needed, changed) {
  report = changed;
  heardMs = tickedMs = performance.now();
  setInterval(() => tick(needed()), PERIOD_MS);
}

/** Return when anything was last received, in milliseconds of `performance.now`. */
export function lastHeardMs() {
  return heardMs;
}

/** Return whether nothing was received for five seconds. */
export function isSilent() {
  return silent;
}

function tick(needed) {
  const now = performance.now();
  // A page that did not run, as in a hidden tab or on a sleeping machine, has not received anything for that reason.
  if (now - tickedMs > ASK_AFTER_MS || document.hidden || !needed) heardMs = Math.max(heardMs, now - ASK_AFTER_MS);
  tickedMs = now;
  if (document.hidden || !needed) {
    if (silent) become(false);
    return;
  }
  if (now - heardMs >= ASK_AFTER_MS) ask();
  if (!silent && now - heardMs >= SILENT_MS) become(true);
}

/** Send one request at a time, so that a hanging gateway does not use up the connections that Stop needs. */
async function ask() {
  if (asking) return;
  asking = true;
  try {
    const { pathname } = new URL(document.body.dataset.root, document.baseURI);
    /** @type {RequestInit} */
    const fields = { method: "HEAD", cache: "no-store", headers: { accept: "text/event-stream" } };
    const sentMs = Date.now();
    const response = await fetch(pathname, { ...fields, signal: AbortSignal.timeout(SILENT_MS) });
    // A proxy responds in place of a gateway that does not.
    if (response.status >= 500) return;
    agree(response, sentMs);
    heard();
  } catch {
    // A missing response is handled by `tick`.
  } finally {
    asking = false;
  }
}

function become(state) {
  silent = state;
  report();
}
