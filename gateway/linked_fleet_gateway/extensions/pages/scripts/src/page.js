// Parts of every page. The stop button comes first: nothing else may prevent it from working.

import { say } from "./say.js";
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
import * as fleet from "./fleet.js";
import * as group from "./group.js";
import * as rows from "./rows.js";
import * as robotState from "./robot_state.js";
import * as sliders from "./sliders.js";
import * as poses from "./poses.js";
import * as lease from "./lease.js";
import * as annotations from "./annotations.js";
import { whenWanted } from "./lazy_scene.js";
import { parts } from "extensions";

const ROBOT = [robotState, sliders, poses, lease, annotations];
const FLEET = [fleet, group, rows];
const PAGE = [stop, notice, region, presence, live, age, connection, form, act, tasks, include, remove, copy];
for (const part of [...PAGE, ...ROBOT, ...FLEET, ...parts]) {
  try {
    part.start();
  } catch (error) {
    notice.notice(say("Something on this page does not work: {message}", { message: error.message }));
  }
}

const areas = document.querySelectorAll("textarea[data-editor]");
if (areas.length) import("./editor.js").then(({ edit }) => areas.forEach(edit), failed);

let plotting;
region.adopt((root) => {
  if (root.querySelector("figure.plot")) plots();
});

/** @type {HTMLElement | null} */
const scene = document.querySelector("#scene[data-model]");
if (scene) whenWanted(scene, () => import("./scene.js").then(({ show }) => show(scene), failed));

/** Plots and the 3D scene are large: only pages that have them fetch them. */
function plots() {
  plotting ??= import("./plot.js").then(({ start }) => start(), failed);
}

function failed(error) {
  notice.notice(say("A part of this page could not be fetched: {message}", { message: error.message }));
}
