// What a camera sees, live: each message is a whole picture.

import { watch } from "./socket.js";

export function start() {
  const image = document.querySelector("#seen > img");
  if (!image) return;
  let shown = "";
  watch(image.getAttribute("src"), { protocol: "lf.jpeg", interval: 0.1 }, (picture) => {
    const next = URL.createObjectURL(new Blob([picture], { type: "image/jpeg" }));
    image.src = next;
    // One that is let go before it is decoded is never seen, but the one that follows is.
    if (shown) URL.revokeObjectURL(shown);
    shown = next;
  });
}
