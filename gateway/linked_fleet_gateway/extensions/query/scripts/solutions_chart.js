// A chart of the numbers in a table of solutions, above its rows.

import { say } from "../../pages/scripts/src/say.js";
import uPlot from "uplot";

import { number } from "../../pages/scripts/src/format.js";
import { axes, COLOURS, room } from "../../pages/scripts/src/plot_options.js";

const MOST_LABELS = 12;
const LONGEST_LABEL = 14;
const POINTS_UNTIL = 200;

/**
 * @param {HTMLTableElement} table
 * @param {(figure: HTMLElement) => void} place
 */
export function draw(table, place) {
  const rows = [...table.tBodies[0].rows];
  const names = [...table.tHead.rows[0].cells].map((each) => each.textContent);
  const columns = names.map((name, index) => ({ name, values: rows.map((row) => valueOf(row.cells[index])) }));
  const series = columns.filter(({ values }) => values.some((each) => each !== null));
  const label = names.findIndex((_, index) => rows.every((row) => !row.cells[index].querySelector("data")));
  const labels = rows.map((row) => row.cells[label]?.textContent ?? "");
  const figure = document.createElement("figure");
  figure.className = "chart";
  const canvas = figure.appendChild(Object.assign(document.createElement("div"), { className: "canvas" }));
  canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", say("{value} over {length} rows", { value: series.map(({ name }) => name).join(", "), length: rows.length }));
  figure.append(legend(series));
  place(figure);
  const { clientWidth: width, clientHeight: height } = canvas;
  const [x, y] = axes();
  const short = labels.map((each) => (each.length > LONGEST_LABEL ? `${each.slice(0, LONGEST_LABEL - 1)}…` : each));
  const fits = label >= 0 && rows.length <= Math.min(MOST_LABELS, width / 80);
  const values = (_, splits) => splits.map((each) => (Number.isInteger(each) ? (fits ? short[each - 1] : number(each)) : ""));
  const splits = fits ? () => rows.map((_, index) => index + 1) : undefined;
  /** @type {import("uplot").Options} */
  const layout = {
    width: Math.max(width, 40),
    height: Math.max(height, 40),
    legend: { show: false },
    cursor: { show: false },
    padding: [8, 24, 0, 0],
    scales: { x: { time: false, range: [0.5, rows.length + 0.5] }, y: { range: (_, low, high) => room(low, high) } },
    series: [{}, ...series.map((_, index) => ({ stroke: COLOURS[index % COLOURS.length], width: 1.5, points: { show: rows.length <= POINTS_UNTIL, size: 6 } }))],
    axes: [{ ...x, values, splits }, y],
  };
  const chart = new uPlot(layout, [rows.map((_, index) => index + 1), ...series.map((each) => each.values)], canvas);
  new ResizeObserver(() => canvas.clientWidth > 40 && chart.setSize({ width: canvas.clientWidth, height: canvas.clientHeight })).observe(canvas);
  figure.querySelectorAll("input").forEach((box, index) => box.addEventListener("change", () => chart.setSeries(index + 1, { show: box.checked })));
  figure.dataset.points = String(rows.length);
}

function valueOf(cell) {
  const data = cell.querySelector("data");
  return data ? Number(data.value) : null;
}

function legend(series) {
  const fieldset = document.createElement("fieldset");
  fieldset.setAttribute("aria-label", say("Columns"));
  for (const [index, { name }] of series.entries()) {
    const label = fieldset.appendChild(document.createElement("label"));
    const swatch = document.createElement("i");
    swatch.style.setProperty("--colour", COLOURS[index % COLOURS.length]);
    label.append(Object.assign(document.createElement("input"), { type: "checkbox", checked: true }), " ", swatch, ` ${name}`);
  }
  return fieldset;
}
