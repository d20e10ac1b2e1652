// The fields of a form for a position and an orientation, as numbers in metre and a unit quaternion.

import { lf } from "./vocabulary.js";

const MATHS = "http://vocab.arvida.de/2015/06/maths/vocab#";
const METRE = "http://qudt.org/vocab/unit/M";
const UNIT_PATH = "http://vocab.arvida.de/2015/06/vom/vocab#unit";
const AXES = ["x", "y", "z"].map((axis) => MATHS + axis);
const QUATERNION = [...AXES, lf("w")];
const DECIMALS = 4;

/** @typedef {import("./scene_target.js").Pose} Pose */

export class PoseFields {
  /** @param {HTMLFormElement} form with a field set for `lf:position`, and maybe one for `lf:orientation` */
  constructor(form) {
    this.position = form.querySelector(`fieldset[data-path="${lf("position")}"]`);
    this.orientation = form.querySelector(`fieldset[data-path="${lf("orientation")}"]`);
  }

  /** @returns {number[]|undefined} the position, if all of it is filled in */
  readPosition() {
    const scale = field(this.position, UNIT_PATH)?.value === METRE ? 1 : 0.001;
    return numbers(this.position, AXES)?.map((value) => value * scale);
  }

  /** @returns {number[]|undefined} the orientation, if all of it is filled in */
  readOrientation() {
    return numbers(this.orientation, QUATERNION);
  }

  writePosition(position) {
    set(this.position, UNIT_PATH, METRE);
    AXES.forEach((axis, index) => set(this.position, axis, position[index].toFixed(DECIMALS)));
  }

  writeOrientation(orientation) {
    QUATERNION.forEach((axis, index) => set(this.orientation, axis, orientation[index].toFixed(DECIMALS)));
  }

  clearOrientation() {
    for (const axis of QUATERNION) set(this.orientation, axis, "");
  }
}

function numbers(fieldset, paths) {
  const found = paths.map((path) => field(fieldset, path)?.value.trim());
  return found.every((text) => text && Number.isFinite(Number(text))) ? found.map(Number) : undefined;
}

function field(fieldset, path) {
  return fieldset?.querySelector(`[data-path="${path}"]`);
}

function set(fieldset, path, value) {
  const control = field(fieldset, path);
  if (control && control.value !== value) control.value = value;
}
