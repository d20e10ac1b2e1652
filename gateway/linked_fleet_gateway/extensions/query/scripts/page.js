// Queries with their results beside the editor: the page of results is fetched, and its section shown here.

import { say } from "../../pages/scripts/src/say.js";
import { notice } from "../../pages/scripts/src/notice.js";

const LONGEST_URL = 6000;
const NUMBERS = "table.solutions td > data";
const pages = new DOMParser();

export function start() {
  /** @type {HTMLFormElement | null} */
  const form = document.querySelector(".query-desk form");
  if (!form || !document.getElementById("results")) return;
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    ask(form);
  });
  /** @type {NodeListOf<HTMLFormElement>} */
  const examples = document.querySelectorAll(".example form");
  for (const example of examples) {
    example.addEventListener("submit", (event) => {
      event.preventDefault();
      const area = form.querySelector("textarea");
      area.value = example.querySelector("input").value;
      area.dispatchEvent(new Event("replaced"));
      document.querySelector(".query-desk").scrollIntoView({ block: "start" });
      ask(form);
    });
  }
  offerChart();
}

async function ask(form) {
  const area = form.querySelector("textarea");
  const query = area.value;
  const old = document.getElementById("results");
  old.setAttribute("aria-busy", "true");
  const fresh = await solutions(area, form.action);
  if (!fresh) return;
  old.replaceWith(fresh);
  const address = `${form.action}?${new URLSearchParams({ query })}`;
  if (address.length < LONGEST_URL) history.replaceState(null, "", address);
  offerChart();
  // Scroll to results below the editor.
  fresh.scrollIntoView({ block: "nearest" });
}

let latest;

/**
 * Send the query in a text area, and mark an error in it.
 *
 * @param {HTMLTextAreaElement} area
 * @param {string} endpoint
 * @returns {Promise<HTMLElement|undefined>} the section of results; undefined if another query was sent meanwhile
 */
export async function solutions(area, endpoint) {
  const mine = (latest = Symbol("query"));
  try {
    const response = await fetch(endpoint, {
      method: "POST",
      headers: { Accept: "text/html" },
      body: new URLSearchParams({ query: area.value }),
      cache: "no-store",
    });
    const page = pages.parseFromString(await response.text(), "text/html");
    const fresh = page.getElementById("results");
    if (!fresh) throw new Error(page.querySelector("main")?.textContent.trim() || response.statusText);
    if (mine !== latest) return undefined;
    point(area, page.querySelector("textarea[name=query]"), fresh);
    return document.importNode(fresh, true);
  } catch (error) {
    if (mine === latest) {
      notice(say("The query was not answered: {message}", { message: error.message }));
      document.getElementById("results")?.removeAttribute("aria-busy");
    }
    return undefined;
  }
}

/** Mark the error of a query. */
function point(area, said, results) {
  for (const name of ["line", "column", "message"]) delete area.dataset[name];
  if (said?.dataset.line) Object.assign(area.dataset, { line: said.dataset.line, column: said.dataset.column, message: results.querySelector(".error bdi")?.textContent });
  area.dispatchEvent(new Event("marked"));
}

/** Offer a chart if several rows contain numbers. */
function offerChart() {
  const results = document.getElementById("results");
  /** @type {HTMLTableElement | null} */
  const table = results.querySelector("table.solutions");
  if (!table || table.tBodies[0].rows.length < 2 || !results.querySelector(NUMBERS)) return;
  const button = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: say("Chart") });
  button.setAttribute("aria-pressed", "false");
  button.addEventListener("click", async () => {
    const drawn = results.querySelector("figure.chart");
    button.setAttribute("aria-pressed", String(!drawn));
    if (drawn) return drawn.remove();
    const { draw } = await import("./solutions_chart.js");
    draw(table, (figure) => table.parentElement.before(figure));
  });
  results.querySelector("h2").after(button);
}
