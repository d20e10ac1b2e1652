// Times as ages, which are kept fresh.

const PERIOD_MS = 500;
const SCALES = [
  [60, 1, "s"],
  [3600, 60, "min"],
  [86400, 3600, "h"],
  [Infinity, 86400, "d"],
];
// Below this the clocks are taken to agree: a Date field has whole seconds.
const AGREED_MS = 2500;
const SECOND_MS = 1000;
let skewMs = 0;

/**
 * Count ages from the clock of the gateway, which its answer tells.
 *
 * @param {Response} response
 * @param {number} sentMs when it was asked for: the answer was dated between then and now, and may have been slow
 */
export function agree(response, sentMs) {
  const theirs = Date.parse(response.headers.get("date") ?? "");
  const [least, most] = [sentMs - theirs - SECOND_MS, Date.now() - theirs];
  const off = least > 0 ? least : Math.min(most, 0);
  skewMs = Math.abs(off) > AGREED_MS ? off : 0;
}

/** @param {number} seconds */
export function age(seconds) {
  const past = Math.max(0, seconds);
  const [, size, unit] = SCALES.find(([limit]) => past < limit);
  const text = past < 10 ? past.toFixed(1) : String(Math.floor(past / size));
  return `${text} ${unit} ago`;
}

/** @param {HTMLTimeElement} time */
export function refresh(time) {
  const stamp = Date.parse(time.dateTime);
  if (Number.isNaN(stamp)) return;
  const ahead = stamp - (Date.now() - skewMs);
  const text = ahead > AGREED_MS ? `in ${age(-0 + ahead / 1000).replace(" ago", "")}` : age(-ahead / 1000);
  if (time.title !== time.dateTime) time.title = time.dateTime;
  if (time.textContent !== text) time.textContent = text;
}

export function start() {
  const all = () => document.hidden || document.querySelectorAll("time[datetime]").forEach(refresh);
  all();
  setInterval(all, PERIOD_MS);
}
