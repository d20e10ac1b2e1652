// The stop button. It depends on nothing else of the page: whatever fails there, this works.

const AGAIN_MS = 600;

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
  say(output, "waiting", "Stopping…");
  try {
    const response = await fetch(form.dataset.action, {
      method: "POST",
      headers: { Accept: "application/problem+json" },
      keepalive: true,
      priority: "high",
      cache: "no-store",
    });
    if (response.ok) {
      say(output, "done", `Stop accepted at ${new Date().toLocaleTimeString("en-GB")}.`);
      return;
    }
    const { title, detail } = await response.json();
    say(output, "error", `Not stopped: ${title}. ${detail}`);
  } catch {
    say(output, "error", "Not stopped: the gateway did not answer.");
  }
}

function say(output, state, text) {
  output.dataset.state = state;
  output.textContent = text;
}
