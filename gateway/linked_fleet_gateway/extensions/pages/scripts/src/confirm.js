// Asks before something is done, in a dialog.

import { say } from "./say.js";

/**
 * Ask, and return the reader's answer: undefined if it is no, else the text of the field, empty without one.
 *
 * @param {string} question
 * @param {{yes: string, no?: string, field?: string, danger?: boolean, most?: number, more?: HTMLElement[]}} options `field`: what the reader has to write; `more`: further fields, which the caller reads
 * @returns {Promise<string | undefined>}
 */
export function confirmed(question, { yes, no = say("Cancel"), field, danger = false, most = 200, more = [] }) {
  const back = document.activeElement;
  const dialog = document.createElement("dialog");
  const said = Object.assign(document.createElement("p"), { id: "question", textContent: question });
  const form = Object.assign(document.createElement("form"), { method: "dialog" });
  const input = field ? Object.assign(document.createElement("input"), { type: "text", id: "answer", required: true, maxLength: most }) : undefined;
  if (input) {
    const label = Object.assign(document.createElement("label"), { htmlFor: "answer", textContent: field });
    const place = Object.assign(document.createElement("div"), { className: "field" });
    place.append(label, input);
    form.append(place);
  }
  form.append(...more);
  const buttons = Object.assign(document.createElement("p"), { className: "buttons" });
  const refusal = Object.assign(document.createElement("button"), { value: "no", textContent: no, className: "quiet", formNoValidate: true });
  const consent = Object.assign(document.createElement("button"), { value: "yes", textContent: yes, className: danger ? "danger" : "" });
  buttons.append(refusal, consent);
  form.append(buttons);
  dialog.setAttribute("aria-labelledby", said.id);
  dialog.append(said, form);
  document.body.append(dialog);
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      dialog.remove();
      if (back instanceof HTMLElement) back.focus();
      resolve(dialog.returnValue === "yes" ? (input?.value.trim() ?? "") : undefined);
    });
    dialog.showModal();
    if (input) input.focus();
  });
}
