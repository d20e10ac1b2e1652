// Fetches forms of actions when they are opened: a robot has many.

import { say } from "./say.js";
import { own, ready } from "./form.js";
import { apply } from "./presence.js";

export function start() {
  // This event does not bubble.
  document.addEventListener("toggle", ({ target }) => target.matches?.("details[data-include]") && target.open && load(target), true);
  document.querySelectorAll("details[data-include][open]").forEach(load);
}

/** Fetch the form of a section again. */
export async function renew(details) {
  details.querySelector(":scope > form")?.remove();
  delete details.dataset.included;
  await load(details);
}

async function load(details) {
  if (details.dataset.included) return;
  details.dataset.included = "waiting";
  const { include } = details.dataset;
  try {
    // The entity tag is at most as new as the form: nobody can replace a state that they have not seen.
    const tag = "place" in details.dataset ? await tagOf(include) : null;
    const { form: inserted, page } = await fetchForm(include);
    if (tag && inserted.dataset.methods === "PUT") inserted.dataset.match = tag;
    // Rights and control are those of the robot of the form, which this page may not be about.
    for (const name of ["may", "control"]) if (name in page.body.dataset) inserted.dataset[name] = page.body.dataset[name];
    details.append(inserted);
    ready(inserted);
    apply();
    details.dataset.included = "done";
    inserted.dispatchEvent(new Event("included", { bubbles: true }));
  } catch (error) {
    delete details.dataset.included; // opening it again retries
    fail(details, say("The form cannot be loaded: {message}", { message: error.message }));
  }
}

/**
 * Fetch the form of an action from its page. Raises an error with a sentence.
 *
 * @param {string} action
 * @returns {Promise<{form: HTMLFormElement, page: Document}>}
 */
export async function fetchForm(action) {
  const response = await fetch(action, { headers: { Accept: "text/html" }, cache: "no-cache" });
  const page = new DOMParser().parseFromString(await response.text(), "text/html");
  const found = page.querySelector("form.invoke");
  if (!response.ok || !found) throw new Error(page.querySelector("main")?.textContent.trim().replace(/\s+/g, " ").slice(0, 300) || response.statusText);
  const fragment = document.createDocumentFragment();
  fragment.append(document.importNode(found, true));
  return { form: /** @type {HTMLFormElement} */ (own(fragment).firstElementChild), page };
}

/** Return the entity tag of the description, which a page with additional content does not have. */
async function tagOf(iri) {
  const response = await fetch(iri, { method: "HEAD", headers: { Accept: "application/n-triples" }, cache: "no-store" });
  return response.headers.get("etag");
}

function fail(details, text) {
  const message = details.querySelector(":scope > p.error") ?? details.appendChild(document.createElement("p"));
  message.className = "error";
  message.setAttribute("role", "alert");
  message.textContent = text;
}
