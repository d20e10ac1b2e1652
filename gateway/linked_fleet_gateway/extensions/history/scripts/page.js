// The history of measured values in charts and plots, and robots as they were. The code that reads and draws it is fetched when it is needed.

import { say } from "../../pages/scripts/src/say.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { provide } from "../../pages/scripts/src/past.js";

export function start() {
  provide(async (iri, spanS, untilS) => (await import("./past.js")).recorded(iri, spanS, untilS));
  /** @type {NodeListOf<HTMLElement>} */
  const replays = document.querySelectorAll("section[data-replay]");
  if (replays.length) {
    import("./replay.js").then(
      ({ start }) => replays.forEach(start),
      (error) => notice(`What shows the past could not be fetched: ${error.message}`),
    );
  }
  /** @type {HTMLElement | null} */
  const figure = document.querySelector("figure.chart[data-history]");
  if (!figure) return;
  import("./chart.js").then(
    ({ start }) => start(figure),
    (error) => notice(say("The chart could not be fetched: {message}", { message: error.message })),
  );
}
