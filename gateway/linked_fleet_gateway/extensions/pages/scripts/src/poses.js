// Named poses as buttons: each sets the targets of all its joints, and the button of the sliders moves them.

import { aim } from "./sliders.js";

export function start() {
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.("button[data-pose]");
    if (button) aim(new Map(Object.entries(JSON.parse(button.dataset.targets))));
  });
}
