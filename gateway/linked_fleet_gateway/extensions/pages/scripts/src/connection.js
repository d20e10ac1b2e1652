// Shows a lost connection at once, until it is back.

import { say } from "./say.js";
import { refresh } from "./region.js";
import { onConnection } from "./socket.js";

const WORDS = {
  silent: say("The gateway has not answered for 5 s: what you see is old. Trying again…"),
  lost: say("Connection lost: what you see may be old. Trying again…"),
  gone: say("There is no such resource at present: what you see may be old. Trying again…"),
  cancelled: say("Somebody cancelled the subscription of this page: what you see is old. Reload to watch again."),
  forbidden: say("You have no right to watch this page change: what you see is as old as the page. Reload to see it anew."),
};

export function start() {
  const line = document.getElementById("connection");
  if (!line) return;
  let before = "live";
  new ResizeObserver(() => measure(line)).observe(line);
  onConnection((state) => {
    document.body.dataset.connection = state;
    line.hidden = state === "live";
    line.textContent = WORDS[state] ?? "";
    measure(line);
    // More than values may have changed meanwhile.
    if (state === "live" && before !== "live") refresh();
    before = state;
  });
}

/** The text of a stop is shown below this line, which may take several rows. */
function measure(line) {
  const [bar, stop] = [document.querySelector(".bar"), document.querySelector(".stop")].map((each) => each?.getBoundingClientRect());
  if (!bar || !stop) return;
  const distance = bar.bottom - stop.bottom + line.offsetHeight;
  document.body.style.setProperty("--to-the-end-of-connection", `${distance}px`);
}
