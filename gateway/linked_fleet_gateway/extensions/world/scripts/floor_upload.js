// The form that uploads a map of the floor: both files in one PUT, as `curl -F` sends them.

import { say } from "../../pages/scripts/src/say.js";
import { refresh } from "../../pages/scripts/src/region.js";

export function enable() {
  /** @type {HTMLFormElement | null} */
  const form = document.querySelector("form[data-upload]");
  form?.addEventListener("submit", (event) => {
    event.preventDefault();
    upload(form);
  });
}

async function upload(form) {
  const said = form.querySelector("output");
  const button = form.querySelector("button");
  const data = new FormData(form);
  for (const name of ["height", "title"]) if (!data.get(name)) data.delete(name);
  button.disabled = true;
  Object.assign(said, { textContent: say("Sending …") }).dataset.state = "";
  const problem = await sent(form.dataset.upload, data);
  said.dataset.state = problem ? "error" : "done";
  said.textContent = problem || say("The map is in use.");
  button.disabled = false;
  refresh();
}

/** @returns {Promise<string>} why the gateway refuses it; empty if it does not */
async function sent(address, body) {
  try {
    const answer = await fetch(address, { method: "PUT", body, headers: { Accept: "application/problem+json" } });
    if (answer.ok) return "";
    const { title, detail } = await answer.json();
    return `${title}. ${detail}`;
  } catch {
    return say("The gateway did not answer. Is the connection lost?");
  }
}
