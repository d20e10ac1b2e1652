// The stop button. It depends on nothing else of the page: whatever fails there, this works.

const AGAIN_MS = 600;
const ANSWER_MS = 3000;
const HARDWARE = "Use the emergency stop at the robot itself.";
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
  let last = -Infinity;
  addEventListener("keydown", ({ key, repeat, timeStamp }) => {
    if (key !== "Escape" || repeat) return;
    if (timeStamp - last < AGAIN_MS) stop(form, output);
    last = timeStamp;
  });
}

async function stop(form, output) {
  const mine = (latest = Symbol("stop"));
  const tell = (state, text) => mine === latest && say(output, state, text);
  tell("waiting", "Stopping…");
  // The request goes on: a late answer is told as well.
  const late = setTimeout(() => tell("error", `Nobody has answered the stop for 3 s. ${HARDWARE}`), ANSWER_MS);
  try {
    const response = await fetch(form.dataset.action, {
      method: "POST",
      headers: { Accept: "application/problem+json" },
      keepalive: true,
      priority: "high",
      cache: "no-store",
    });
    if (response.ok) tell("done", `Stop accepted at ${new Date().toLocaleTimeString("en-GB")}.`);
    else tell("error", `Not stopped: ${await reason(response)} ${HARDWARE}`);
  } catch {
    tell("error", `Not stopped: the gateway did not answer. ${HARDWARE}`);
  } finally {
    clearTimeout(late);
  }
}

/** A front's error page has no problem details. */
async function reason(response) {
  try {
    const { title, detail } = await response.json();
    return `${title}. ${detail}`;
  } catch {
    return `status ${response.status}.`;
  }
}

function say(output, state, text) {
  output.dataset.state = state;
  output.textContent = text;
}
