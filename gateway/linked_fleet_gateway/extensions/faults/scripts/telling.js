// A sound and a notification of the browser for new faults, if the reader has chosen so on the page of faults.

import { say } from "../../pages/scripts/src/say.js";

const CHOICE = "lf-tell-of-faults";
/** @type {Set<string> | undefined} the faults that were waiting before; undefined until the first news */
let known;

/** Let the reader choose, where the page has a place for it. */
export function offerTelling() {
  const place = document.getElementById("telling");
  if (!place) return;
  const box = place.querySelector("input");
  box.checked = localStorage.getItem(CHOICE) === "on";
  box.addEventListener("change", async () => {
    localStorage.setItem(CHOICE, box.checked ? "on" : "off");
    if (box.checked && "Notification" in window && Notification.permission === "default") await Notification.requestPermission();
    if (box.checked) beep();
  });
}

/** Tell of faults that were not waiting before. Those that are there when a page is opened are no news. */
export function tell(waiting) {
  const fresh = known ? waiting.filter(({ iri }) => !known.has(iri)) : [];
  known = new Set(waiting.map(({ iri }) => iri));
  if (!fresh.length || localStorage.getItem(CHOICE) !== "on") return;
  beep();
  if (!("Notification" in window) || Notification.permission !== "granted") return;
  const text = fresh.length > 1 ? say("{title} (and {value} more)", { title: fresh[0].title, value: fresh.length - 1 }) : fresh[0].title;
  new Notification(say("Linked Fleet"), { body: text, tag: "lf-faults" });
}

/** Sound for a quarter of a second; browsers allow it once the reader has used the page. */
function beep() {
  const context = new AudioContext();
  const tone = new OscillatorNode(context, { frequency: 660 });
  tone.connect(new GainNode(context, { gain: 0.1 })).connect(context.destination);
  tone.start();
  tone.stop(context.currentTime + 0.25);
  tone.addEventListener("ended", () => context.close());
}
