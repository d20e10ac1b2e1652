// Notes on the pages of robots and faults: the list and the form of the robot's own page of notes.

import { own, ready } from "../../pages/scripts/src/form.js";
import { apply } from "../../pages/scripts/src/presence.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

export function start() {
  const place = /** @type {HTMLElement | null} */ (document.querySelector("section[data-notes]"));
  if (!place) return;
  const show = () => fill(place).catch((error) => console.debug("the notes cannot be had:", error));
  new IntersectionObserver((entries, observer) => {
    if (!entries.at(-1).isIntersecting) return;
    observer.disconnect();
    show();
  }).observe(place);
  document.addEventListener("saved", ({ target }) => {
    if (target instanceof HTMLFormElement && target.matches("form.note")) show();
  });
  document.addEventListener("deleted", show);
}

/** Show the form, once, and the notes: of a robot all, of a fault those about it. */
async function fill(/** @type {HTMLElement} */ place) {
  const { notes, about } = place.dataset;
  const response = await fetch(notes, { headers: { Accept: "text/html" }, cache: "no-cache" });
  if (!response.ok) return;
  const page = new DOMParser().parseFromString(await response.text(), "text/html");
  const list = document.importNode(page.querySelector("ul.notes"), true);
  if (about) for (const each of list.querySelectorAll("li")) if (each.dataset.about !== about) each.remove();
  const kept = place.querySelector("form.note");
  if (!kept) {
    const fragment = document.createDocumentFragment();
    fragment.append(document.importNode(page.querySelector("form.note"), true));
    const form = /** @type {HTMLFormElement} */ (own(fragment).firstElementChild);
    if (about) /** @type {HTMLInputElement} */ (form.querySelector(`[data-path="${lf("noteAbout")}"]`)).value = about;
    place.append(form);
    ready(form);
  } else kept.querySelector("textarea").value = "";
  place.querySelector("ul.notes")?.remove();
  place.append(list);
  apply();
}
