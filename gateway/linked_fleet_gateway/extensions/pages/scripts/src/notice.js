// Shows errors on the page, since nobody reads the console.

import { say } from "./say.js";

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
  addEventListener("error", ({ message }) => notice(say("Something on this page does not work: {message}", { message })));
  addEventListener("unhandledrejection", ({ reason }) => notice(say("Something on this page does not work: {value}", { value: reason?.message ?? reason })));
}
