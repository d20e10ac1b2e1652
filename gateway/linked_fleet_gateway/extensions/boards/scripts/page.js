// Boards: charts of numbers of several robots, and the form that chooses them. The code that draws is fetched when it is needed.

import { fetchRobots } from "../../pages/scripts/src/fleet_offer.js";
import { fetchValues } from "../../pages/scripts/src/measured.js";
import { notice } from "../../pages/scripts/src/notice.js";
import { write } from "../../pages/scripts/src/ntriples.js";
import { refresh } from "../../pages/scripts/src/region.js";
import { send } from "../../pages/scripts/src/request.js";
import { say } from "../../pages/scripts/src/say.js";
import { TITLE, lf } from "../../pages/scripts/src/vocabulary.js";

const LINE = lf("boardLine");

export function start() {
  /** @type {HTMLFormElement | null} */
  const form = document.querySelector("form[data-board-form]");
  const may = document.body.dataset.may?.split(" ");
  if (form && (!may || may.includes("act") || may.includes("admin"))) choose(form);
  /** @type {HTMLElement | null} */
  const board = document.querySelector("section[data-board]");
  if (!board) return;
  document.addEventListener("click", ({ target }) => {
    const button = /** @type {Element} */ (target).closest?.("button[data-remove-line]");
    if (button) remove(/** @type {string} */ (board.dataset.board), button);
  });
  import("./board.js").then(
    ({ start }) => start(board),
    (error) => notice(say("The chart could not be fetched: {message}", { message: error.message })),
  );
}

/** Offer robots and their values, and save what is chosen. */
function choose(/** @type {HTMLFormElement} */ form) {
  const failed = (error) => tell(form, say("This cannot be loaded: {message}", { message: error.message }));
  const { root = "/" } = document.body.dataset;
  const robot = /** @type {HTMLSelectElement} */ (form.elements.namedItem("robot"));
  const value = /** @type {HTMLSelectElement} */ (form.elements.namedItem("value"));
  const offer = async () => {
    const chosen = robot.value;
    const before = value.selectedOptions[0]?.text;
    value.replaceChildren(); // those of another robot must not be saved
    const found = chosen ? (await fetchValues(`${root}query`, chosen)).filter(({ text }) => !text) : [];
    if (chosen !== robot.value) return; // another one was chosen meanwhile
    value.replaceChildren(...found.map(({ name, resource }) => new Option(name, resource)));
    const same = [...value.options].find(({ text }) => text === before); // the same of another robot
    if (same) same.selected = true;
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    save(form, value.value);
  });
  robot.addEventListener("change", () => offer().catch(failed));
  const begin = async () => {
    robot.replaceChildren(...(await fetchRobots(root)).map(({ iri, title }) => new Option(title, iri)));
    await offer();
  };
  begin().catch(failed);
}

async function save(/** @type {HTMLFormElement} */ form, /** @type {string} */ line) {
  if (!line) return tell(form, say("This robot measures no number. Choose another one."));
  const { boardForm = "", method } = form.dataset;
  const title = /** @type {HTMLInputElement | null} */ (form.elements.namedItem("title"));
  const { problem, location: made } = method === "POST" ? await send("POST", boardForm, { body: said(title?.value ?? "", [line]) }) : await change(boardForm, (lines) => [...lines, line]);
  tell(form, problem ? `${problem.title}. ${problem.detail}` : "");
  if (made && !problem) location.assign(made);
  else if (!problem) refresh();
}

async function remove(/** @type {string} */ board, button) {
  const { line } = button.closest("[data-line]").dataset;
  if (document.querySelectorAll("[data-line]").length === 1) return notice(say("A board has at least one line. Delete the board instead."));
  button.blur(); // otherwise the list would wait for it to lose the focus
  const { problem } = await change(board, (lines) => lines.filter((each) => each !== line));
  if (problem) notice(`${problem.title}. ${problem.detail}`);
  else refresh();
}

/** Replace the lines of a board, unless somebody has changed it meanwhile. */
async function change(/** @type {string} */ board, /** @type {(lines: string[]) => string[]} */ changed) {
  const before = await send("GET", board);
  if (before.problem || !before.graph) return before;
  const { graph, tag } = before;
  const lines = changed(graph.values(board, LINE).map(({ value }) => value));
  return send("PUT", board, { body: said(graph.value(board, TITLE)?.value ?? "", lines), headers: tag ? { "If-Match": tag } : {} });
}

/** Return a board in Turtle. */
function said(/** @type {string} */ title, /** @type {string[]} */ lines) {
  const about = lines.map((each) => ` ; <${LINE}> <${each}>`).join("");
  return `<> <${TITLE}> ${write({ kind: "literal", value: title })}${about} .`;
}

function tell(/** @type {HTMLFormElement} */ form, /** @type {string} */ text) {
  const answer = /** @type {HTMLElement} */ (form.querySelector("output.answer"));
  answer.textContent = text;
  if (text) answer.dataset.state = "error";
}
