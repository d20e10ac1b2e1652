// Queries whose results come beside the editor: the page of results is fetched, and its section shown here.

import { notice } from "./notice.js";

const LONGEST_URL = 6000;
const NUMBERS = "table.solutions td > data";
const pages = new DOMParser();

export function start() {
  /** @type {HTMLFormElement | null} */
  const form = document.querySelector(".asking form");
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
      document.querySelector(".asking").scrollIntoView({ block: "start" });
      ask(form);
    });
  }
  offerChart();
}

let latest;

async function ask(form) {
  const mine = (latest = Symbol("query"));
  const area = form.querySelector("textarea");
  const query = area.value;
  const old = document.getElementById("results");
  old.setAttribute("aria-busy", "true");
  let fresh;
  try {
    const response = await fetch(form.action, {
      method: "POST",
      headers: { Accept: "text/html" },
      body: new URLSearchParams({ query }),
      cache: "no-store",
    });
    const page = pages.parseFromString(await response.text(), "text/html");
    fresh = page.getElementById("results");
    if (!fresh) throw new Error(page.querySelector("main")?.textContent.trim() || response.statusText);
    if (mine !== latest) return;
    point(area, page.querySelector("textarea[name=query]"), fresh);
  } catch (error) {
    if (mine === latest) notice(`The query was not answered: ${error.message}`);
    return;
  } finally {
    if (mine === latest) old.removeAttribute("aria-busy");
  }
  old.replaceWith(document.importNode(fresh, true));
  const address = `${form.action}?${new URLSearchParams({ query })}`;
  if (address.length < LONGEST_URL) history.replaceState(null, "", address);
  offerChart();
  // Where the results stand below the editor, they come into sight.
  document.getElementById("results").scrollIntoView({ block: "nearest" });
}

/** Mark where a query could not be read. */
function point(area, said, results) {
  for (const name of ["line", "column", "message"]) delete area.dataset[name];
  if (said?.dataset.line) Object.assign(area.dataset, { line: said.dataset.line, column: said.dataset.column, message: results.querySelector(".error bdi")?.textContent });
  area.dispatchEvent(new Event("marked"));
}

/** Where there are numbers in more than one row, they can be drawn. */
function offerChart() {
  const results = document.getElementById("results");
  /** @type {HTMLTableElement | null} */
  const table = results.querySelector("table.solutions");
  if (!table || table.tBodies[0].rows.length < 2 || !results.querySelector(NUMBERS)) return;
  const button = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: "Chart" });
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
