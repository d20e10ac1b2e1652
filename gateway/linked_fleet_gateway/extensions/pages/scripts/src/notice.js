// Shows errors on the page, since nobody reads the console.

/** @param {string} text */
export function notice(text) {
  let box = document.getElementById("notice");
  if (!box) {
    box = document.createElement("p");
    box.id = "notice";
    box.setAttribute("role", "alert");
    document.querySelector("main")?.prepend(box);
  }
  box.textContent = text;
}

export function start() {
  addEventListener("error", ({ message }) => notice(`Something on this page does not work: ${message}`));
  addEventListener("unhandledrejection", ({ reason }) => notice(`Something on this page does not work: ${reason?.message ?? reason}`));
}
