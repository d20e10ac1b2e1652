// Buttons that copy the text beside them.

import { say } from "./say.js";

const SHOWN_MS = 2000;

export function start() {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button[data-copy]");
    if (button) copy(button);
  });
}

async function copy(button) {
  const source = document.getElementById(button.dataset.copy) ?? button.parentElement.querySelector("code");
  const text = source?.textContent ?? button.dataset.copy;
  const copied = await write(text, source);
  const name = (button.dataset.name ??= button.textContent);
  button.textContent = copied ? say("Copied") : say("Press Ctrl+C");
  setTimeout(() => (button.textContent = name), SHOWN_MS);
}

/** Browsers offer a clipboard only for https and this machine; elsewhere the text is selected. */
async function write(text, source) {
  try {
    await navigator.clipboard.writeText(text);
    return true;
  } catch {
    if (source) getSelection().selectAllChildren(source);
    return false;
  }
}
