// Parts of every page. The stop button comes first: nothing else may prevent it from working.

import * as stop from "./stop.js";
import * as notice from "./notice.js";
import * as region from "./region.js";
import * as age from "./age.js";
import * as live from "./live.js";
import * as presence from "./presence.js";
import * as connection from "./connection.js";
import * as form from "./form.js";
import * as act from "./act.js";
import * as tasks from "./tasks.js";
import * as include from "./include.js";
import * as remove from "./remove.js";
import * as copy from "./copy.js";
import * as camera from "./camera.js";
import * as fleet from "./fleet.js";
import * as rows from "./rows.js";
import * as robotState from "./robot_state.js";
import * as sliders from "./sliders.js";
import * as poses from "./poses.js";
import * as arrange from "./arrange.js";
import * as refused from "./refused.js";
import * as reach from "./reach.js";
import * as lease from "./lease.js";
import { whenWanted } from "./lazy_scene.js";
import * as thumbnails from "./thumbnails.js";
import * as query from "./query.js";
import * as rules from "./rules.js";

const ROBOT = [robotState, sliders, poses, reach, lease, thumbnails];
const FLEET = [fleet, rows, arrange, refused];
const PAGE = [stop, notice, region, presence, live, age, connection, form, act, tasks, include, remove, copy, camera];
for (const part of [...PAGE, ...ROBOT, ...FLEET, query, rules]) {
  try {
    part.start();
  } catch (error) {
    notice.notice(`Something on this page does not work: ${error.message}`);
  }
}

const chart = document.querySelector("figure.chart[data-history]");
if (chart) import("./chart.js").then(({ start }) => start(chart), failed);

const areas = document.querySelectorAll("textarea[data-editor]");
if (areas.length) import("./editor.js").then(({ edit }) => areas.forEach(edit), failed);

let plotting;
region.adopt((root) => {
  if (root.querySelector("figure.plot")) plots();
});

const scene = document.getElementById("scene");
if (scene) whenWanted(scene, () => drawing(scene).then(({ show }) => show(scene), failed));

function drawing({ dataset }) {
  return "world" in dataset ? import("./scene_world.js") : import("./scene.js");
}

/** Plots and the 3D scene are large: only pages that have them fetch them. */
function plots() {
  plotting ??= import("./plot.js").then(({ start }) => start(), failed);
}

function failed(error) {
  notice.notice(`A part of this page could not be fetched: ${error.message}`);
}
