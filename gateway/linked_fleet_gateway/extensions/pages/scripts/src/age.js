// Times as ages, which are updated regularly.

import { localized, say } from "./say.js";
import { AGREED_MS, now } from "./gateway_clock.js";
import { adopt } from "./region.js";

const PERIOD_MS = 500;
const STILL_MS = 10000;
const MEASURED = "sosa/resultTime";
const LAST_FRAME = "#lastFrame";
const FRAME_MS = 1000;
/** @type {[number, number, string][]} below which age, its unit in seconds, and the name of that */
const SCALES = [
  [60, 1, "s"],
  [3600, 60, "min"],
  [86400, 3600, "h"],
  [Infinity, 86400, "d"],
];

/** @param {number} seconds */
export function age(seconds) {
  return say("{time} ago", { time: span(seconds) });
}

/** @param {number} seconds */
function span(seconds) {
  const past = Math.max(0, seconds);
  const [, size, unit] = SCALES.find(([limit]) => past < limit);
  return `${past < 10 ? localized(past.toFixed(1)) : Math.floor(past / size)} ${unit}`;
}

/** A value without news has not changed, as long as the connection is alive: frames come that say the same. */
function past(time, agoMs) {
  const { connection, presence } = document.body.dataset;
  const { path = "" } = time.dataset;
  const heard = connection === "live" && presence !== "offline";
  const text = age(agoMs / 1000);
  if (heard && presence !== "faulty" && path.endsWith(LAST_FRAME) && agoMs > FRAME_MS) return say("live");
  return heard && path.endsWith(MEASURED) && agoMs > STILL_MS ? say("unchanged for {time} · live", { time: span(agoMs / 1000) }) : text;
}

/** @param {HTMLTimeElement} time */
export function refresh(time) {
  const stamp = Date.parse(time.dateTime);
  if (Number.isNaN(stamp)) return;
  const ahead = stamp - now();
  const text = ahead > AGREED_MS ? say("in {time}", { time: span(ahead / 1000) }) : past(time, -ahead);
  if (time.title !== time.dateTime) time.title = time.dateTime;
  if (time.textContent !== text) time.textContent = text;
}

export function start() {
  const all = () => document.hidden || document.querySelectorAll("time[datetime]").forEach(refresh);
  adopt(all); // at once, so that new sections are not painted with longer texts first
  setInterval(all, PERIOD_MS);
}
