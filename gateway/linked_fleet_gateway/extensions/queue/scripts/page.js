// The queue: orders are put elsewhere by dragging their rows, or by the buttons of a row, which keys can press.

import { send } from "../../pages/scripts/src/request.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { adopt, hold, refresh, release } from "../../pages/scripts/src/region.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

const ROW = "#waiting-orders tr[data-order]";

/** @type {HTMLElement | null} */
let dragged = null;
/** @type {{order: string, beside: string, before: string} | null} */
let followed = null;

export function start() {
  prefill();
  document.addEventListener("click", ({ target }) => {
    const button = target.closest?.(`${ROW} button[data-beside]`);
    if (button) step(button);
  });
  document.addEventListener("dragstart", ({ target, dataTransfer }) => {
    dragged = target.closest?.(ROW) ?? null;
    if (!dragged) return;
    hold(); // the rows stay where they are until it is dropped
    dataTransfer.effectAllowed = "move";
    dataTransfer.setData("text/uri-list", dragged.dataset.order);
    dragged.dataset.dragged = "";
  });
  document.addEventListener("dragover", (event) => {
    const row = over(event);
    if (!row) return;
    event.preventDefault(); // it may be dropped here
    mark(row, isBefore(row, event) ? "before" : "after");
  });
  document.addEventListener("drop", (event) => {
    const row = over(event);
    if (!row) return;
    event.preventDefault();
    move(dragged.dataset.order, row.dataset.order, isBefore(row, event));
  });
  document.addEventListener("dragend", () => {
    if (!dragged) return;
    delete dragged.dataset.dragged;
    dragged = null;
    mark(null);
    const focused = document.activeElement;
    if (focused instanceof HTMLElement) focused.blur(); // pressing a row focuses its table, whose section would wait
    release();
  });
  adopt((part) => {
    for (const each of part.querySelectorAll(`${ROW} button[hidden]`)) each.removeAttribute("hidden");
    for (const each of part.querySelectorAll(ROW)) each.setAttribute("draggable", "true");
    follow(part);
  });
}

/** Fill in the mission that the address names, for links from elsewhere. */
function prefill() {
  const mission = new URLSearchParams(location.search).get("mission") ?? "";
  const field = /** @type {HTMLInputElement | null} */ (document.querySelector(`#new-order input[data-path="${lf("mission")}"]`));
  if (!field || !mission.startsWith(`${document.body.dataset.root}missions/`)) return;
  field.value = mission;
  field.closest("details").open = true;
  field.scrollIntoView({ block: "center" });
}

/** Return the row over which another one of the same priority is dragged. */
function over({ target }) {
  const row = dragged && target.closest?.(ROW);
  return row && row !== dragged && row.dataset.priority === dragged.dataset.priority ? row : null;
}

function isBefore(row, { clientY }) {
  const { top, height } = row.getBoundingClientRect();
  return clientY < top + height / 2;
}

function mark(row, where) {
  for (const each of document.querySelectorAll(`${ROW}[data-drop]`)) delete each.dataset.drop;
  if (row) row.dataset.drop = where;
}

/** Move an order by one place. The focus follows it, once it is shown there. */
async function step(button) {
  const { order } = button.closest("tr").dataset;
  const { beside, before } = button.dataset;
  button.blur(); // otherwise its section would wait for it to lose the focus
  followed = { order, beside, before };
  await move(order, beside, before === "true");
}

/** Focus the button that was pressed, if its order is where it was to be put. */
function follow(part) {
  if (!followed) return;
  const { order, beside, before } = followed;
  const row = [...part.querySelectorAll(ROW)].find((each) => each.dataset.order === order);
  const next = before === "true" ? row?.nextElementSibling : row?.previousElementSibling;
  if (next?.dataset.order !== beside) return;
  followed = null;
  (row.querySelector(`button[data-before="${before}"]`) ?? row.querySelector("button[data-beside]"))?.focus();
}

async function move(order, other, before) {
  const body = `<> <${lf(before ? "beforeOrder" : "afterOrder")}> <${other}> .`;
  const { problem } = await send("POST", `${order}/actions/move`, { body });
  if (problem) {
    followed = null;
    notice(`${problem.title}. ${problem.detail}`);
  }
  release();
  refresh();
}
