// The audit: new entries come by themselves while nothing is chosen; else their number is told, and a button shows them.

import { say } from "../../pages/scripts/src/say.js";
import { adopt, refresh } from "../../pages/scripts/src/region.js";

const ASK_MS = 3000;
const MOST = 100;

export function start() {
  const { kind } = document.body.dataset;
  const news = document.getElementById("audit-news");
  if (kind !== "audit" || !news) return;
  // What is empty need not be in the address.
  document.querySelector("form.audit-filter")?.addEventListener("formdata", (event) => {
    const { formData } = /** @type {FormDataEvent} */ (event);
    for (const [name, value] of [...formData]) if (!value) formData.delete(name);
  });
  const older = document.querySelector("#entries[data-older]");
  if (older) return;
  adopt(() => tell(news, 0));
  setInterval(() => document.hidden || look(news), ASK_MS);
}

/** Ask for the entries that came after those shown, by the same choice. */
async function look(news) {
  /** @type {HTMLElement | null} */
  const shown = document.querySelector("#entries[data-newest]");
  if (!shown) return;
  const address = new URL(location.href);
  address.hash = "";
  address.searchParams.set("as", "json");
  address.searchParams.set("limit", String(MOST));
  if (shown.dataset.newest) address.searchParams.set("after", shown.dataset.newest);
  let count;
  try {
    const response = await fetch(address, { cache: "no-store" });
    if (!response.ok) return;
    count = (await response.json()).entries.length;
  } catch {
    return; // the lost connection is shown elsewhere
  }
  const follows = !location.search && scrollY < 200 && !shown.contains(document.activeElement) && !shown.matches(":hover");
  if (count && follows) refresh();
  else tell(news, count);
}

/** Say how many entries have come, with a button that shows them. */
function tell(news, count) {
  if (news.dataset.count === String(count)) return;
  news.dataset.count = String(count);
  if (!count) {
    news.replaceChildren();
    return;
  }
  const button = document.createElement("button");
  button.type = "button";
  button.className = "quiet";
  button.textContent = count === 1 ? say("1 new entry: show it") : say("{value} new entries: show them", { value: count === MOST ? `${MOST} or more` : count });
  button.addEventListener("click", () => {
    button.blur(); // otherwise the section would wait for it to lose the focus
    refresh();
  });
  news.replaceChildren(button);
}
