// The gateway's clock, by which ages are counted.

// Below this difference the clocks are considered equal: a Date field has whole seconds.
export const AGREED_MS = 2500;
const HALF_SECOND_MS = 500;
const KEPT = 10;
/** @type {{tookMs: number, skewMs: number}[]} the latest round trips */
const trips = [];
let skewMs = 0;

/** The time by the gateway's clock, in milliseconds since 1970. */
export function now() {
  return Date.now() - skewMs;
}

/**
 * Learn the gateway's clock from the Date fields of responses. Of the last ten the fastest is used, whose Date
 * is most certainly in the middle between request and response.
 *
 * @param {Response} response
 * @param {number} sentMs time of the request
 */
export function agree(response, sentMs) {
  const theirs = Date.parse(response.headers.get("date") ?? "");
  if (Number.isNaN(theirs)) return;
  const hereMs = Date.now();
  trips.push({ tookMs: hereMs - sentMs, skewMs: (sentMs + hereMs) / 2 - (theirs + HALF_SECOND_MS) });
  if (trips.length > KEPT) trips.shift();
  const best = trips.reduce((least, each) => (each.tookMs < least.tookMs ? each : least));
  // A slower response is less exact: its Date may be of any moment in between.
  const certainMs = AGREED_MS + best.tookMs / 2;
  skewMs = Math.abs(best.skewMs) > certainMs ? best.skewMs : 0;
}
