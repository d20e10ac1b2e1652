// The stop button. It depends on nothing else of the page, and works whatever else fails. It is the event `stopping` of the
// document when a stop is requested, and `stopped` when that was answered, with its action and its invocation.

import { say } from "./say.js";

const AGAIN_MS = 2000;
const ANSWER_MS = 3000;
const SHOWN_MS = 8000;
const ANSWERS_AGAIN = say("The gateway answers again, and may not have got the stop: press Stop again if anything moves.");
const CONFIRMED = "<https://w3id.org/linked-fleet#state> <https://w3id.org/linked-fleet#succeeded>";
const MOST_NAMED = 5;
const NO_ANSWER = say("No answer — use the hardware stop.");
let latest;

export function start() {
  const form = document.querySelector("form.stop");
  if (!form) return;
  const output = form.querySelector("output") ?? form.appendChild(document.createElement("output"));
  output.setAttribute("role", "alert");
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    stop(form, output);
  });
  const button = form.querySelector("button");
  if (button?.disabled) return; // without the right to stop
  if (button && !button.title) button.title = say("or press Escape twice");
  listen(form, output);
}

/** The first Escape, which dialogs and menus use as well, only announces that a second one stops. */
function listen(form, output) {
  let last = -Infinity;
  let withdraw;
  addEventListener("keydown", ({ key, repeat, timeStamp }) => {
    if (key !== "Escape" || repeat) return;
    clearTimeout(withdraw);
    const again = timeStamp - last < AGAIN_MS;
    last = again ? -Infinity : timeStamp;
    if (again) stop(form, output);
    else if (output.dataset.state !== "waiting") {
      tellIn(output, "announced", say("Press Escape again to stop {value}", { value: form.querySelector("bdi")?.textContent ?? "" }).trim() + ".");
      withdraw = setTimeout(() => output.dataset.state === "announced" && tellIn(output, "", ""), AGAIN_MS);
    }
  });
}

async function stop(form, output) {
  const mine = (latest = Symbol("stop"));
  const shown = () => mine === latest;
  const tell = (state, text) => shown() && tellIn(output, state, text);
  const tellLast = (state, text) => {
    tell(state, text);
    setTimeout(() => tell("", ""), SHOWN_MS);
  };
  tell("waiting", say("Stopping…"));
  // The request continues: a late response is shown as well.
  const late = setTimeout(() => tell("error", NO_ANSWER), ANSWER_MS);
  try {
    const asked = fetch(form.dataset.action, {
      method: "POST",
      headers: { Accept: "application/problem+json" },
      keepalive: true,
      priority: "high",
      cache: "no-store",
    });
    announce("stopping", form);
    const response = await asked;
    clearTimeout(late);
    announce("stopped", form, { invocation: response.headers.get("location"), isConfirmed: response.ok });
    if (response.ok) return tellLast("done", at(say("Stop accepted")));
    tell("error", await reason(response));
    const invocation = response.status === 504 && response.headers.get("location");
    if (invocation && (await until(shown, invocation, isConfirmed))) tellLast("done", at(say("Stop confirmed")));
  } catch {
    clearTimeout(late);
    tell("error", NO_ANSWER);
    if (await until(shown, form.dataset.action, ({ status }) => status < 500)) tellLast("error", ANSWERS_AGAIN);
  }
}

/** Tell other scripts of the page, which cannot hinder the stop. */
function announce(type, form, more = {}) {
  document.dispatchEvent(new CustomEvent(type, { detail: { action: form.dataset.action, ...more } }));
}

function at(text) {
  return say("{text} at {value}.", { text, value: new Date().toLocaleTimeString(document.documentElement.lang === "de" ? "de" : "en-GB") });
}

async function isConfirmed(response) {
  return response.ok && (await response.text()).includes(CONFIRMED);
}

/**
 * Ask for a resource until its response is as expected, while the text of the stop is shown.
 *
 * @param {() => boolean} shown
 * @param {string} iri
 * @param {(response: Response) => boolean|Promise<boolean>} isIt
 * @returns {Promise<boolean>} false if the text is no longer shown
 */
async function until(shown, iri, isIt) {
  while (shown()) {
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    try {
      const response = await fetch(iri, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
      if (await isIt(response)) return shown();
    } catch {
      // The gateway is away.
    }
  }
  return false;
}

/** A proxy's error page has no problem details. Robots that have not answered are stopped as soon as they do. */
async function reason(response) {
  try {
    const { title, detail, unanswered } = await response.json();
    if (!unanswered) return say("Not stopped: {title}. {detail} Use the hardware stop.", { title, detail });
    return say("Not confirmed by {named}: the stop is repeated until confirmed. Use the hardware stop.", { named: named(unanswered) });
  } catch {
    return say("Not stopped: status {status}. Use the hardware stop.", { status: response.status });
  }
}

function named(robots) {
  if (!robots.length) return say("some robots");
  const shown = robots.slice(0, MOST_NAMED).join(", ");
  return robots.length > MOST_NAMED ? say("{shown} and {value} others", { shown, value: robots.length - MOST_NAMED }) : shown;
}

function tellIn(output, state, text) {
  output.dataset.state = state;
  output.textContent = text;
}
