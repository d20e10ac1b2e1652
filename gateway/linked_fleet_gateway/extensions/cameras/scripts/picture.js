// The live pictures of a camera: each message is a whole picture.

import { watch } from "../../pages/scripts/src/socket.js";

export function start() {
  const image = document.querySelector("#seen > img");
  if (!image) return;
  let shown = "";
  watch(image.getAttribute("src"), { protocol: "lf.jpeg", interval: 0.1 }, (picture) => {
    const next = URL.createObjectURL(new Blob([picture], { type: "image/jpeg" }));
    image.src = next;
    // A picture may be dropped before it is decoded; the following one is shown.
    if (shown) URL.revokeObjectURL(shown);
    shown = next;
  });
}
