// The stop button. It depends on nothing else of the page, and works whatever else fails.

const AGAIN_MS = 2000;
const ANSWER_MS = 3000;
const SHOWN_MS = 8000;
const CONFIRMED = "<https://w3id.org/linked-fleet#state> <https://w3id.org/linked-fleet#succeeded>";
const MOST_NAMED = 5;
const NO_ANSWER = "No answer — use the hardware stop.";
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
  if (button && !button.title) button.title = "or press Escape twice";
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
      say(output, "announced", `Press Escape again to stop ${form.querySelector("bdi")?.textContent ?? ""}`.trim() + ".");
      withdraw = setTimeout(() => output.dataset.state === "announced" && say(output, "", ""), AGAIN_MS);
    }
  });
}

async function stop(form, output) {
  const mine = (latest = Symbol("stop"));
  const tell = (state, text) => mine === latest && say(output, state, text);
  tell("waiting", "Stopping…");
  // The request continues: a late response is shown as well.
  const late = setTimeout(() => tell("error", NO_ANSWER), ANSWER_MS);
  try {
    const response = await fetch(form.dataset.action, {
      method: "POST",
      headers: { Accept: "application/problem+json" },
      keepalive: true,
      priority: "high",
      cache: "no-store",
    });
    const tellDone = (text) => {
      tell("done", `${text} at ${new Date().toLocaleTimeString("en-GB")}.`);
      setTimeout(() => output.dataset.state === "done" && tell("", ""), SHOWN_MS);
    };
    if (response.ok) tellDone("Stop accepted");
    else {
      tell("error", await reason(response));
      const invocation = response.status === 504 && response.headers.get("location");
      if (invocation) confirmed(invocation, () => mine === latest).then((yes) => yes && tellDone("Stop confirmed"));
    }
  } catch {
    tell("error", NO_ANSWER);
  } finally {
    clearTimeout(late);
  }
}

/** Wait until the invocation of a stop has succeeded, as long as its text is shown. @returns {Promise<boolean>} */
async function confirmed(invocation, shown) {
  while (shown()) {
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    try {
      const response = await fetch(invocation, { headers: { Accept: "application/n-triples" }, cache: "no-store" });
      if (response.ok && (await response.text()).includes(CONFIRMED)) return true;
      if (response.status === 404 || response.status === 410) return false;
    } catch {
      // The gateway is away: the stop is still owed.
    }
  }
  return false;
}

/** A proxy's error page has no problem details. Robots that have not answered are stopped as soon as they do. */
async function reason(response) {
  try {
    const { title, detail, unanswered } = await response.json();
    if (!unanswered) return `Not stopped: ${title}. ${detail} Use the hardware stop.`;
    return `Not confirmed by ${named(unanswered)}: the stop is repeated until confirmed. Use the hardware stop.`;
  } catch {
    return `Not stopped: status ${response.status}. Use the hardware stop.`;
  }
}

function named(robots) {
  if (!robots.length) return "some robots";
  const shown = robots.slice(0, MOST_NAMED).join(", ");
  return robots.length > MOST_NAMED ? `${shown} and ${robots.length - MOST_NAMED} others` : shown;
}

function say(output, state, text) {
  output.dataset.state = state;
  output.textContent = text;
}
