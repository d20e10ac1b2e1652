// What the scene of this page shows besides the robot: where it would be.

/** @type {{joints: Map<string, number>, refused: boolean}|undefined} */
let wanted;

/**
 * Show where the robot would be with some of its joints elsewhere; without any, no longer.
 *
 * @param {Map<string, number>} [joints] positions in rad or m by the joint's IRI
 * @param {boolean} [refused] whether it has been refused
 */
export function ghost(joints, refused = false) {
  wanted = joints?.size ? { joints, refused } : undefined;
  drawing()?.ghost(wanted);
}

/**
 * Mark the place at which something would be met; without one, no longer.
 *
 * @param {number[]} [point] in the world, in metre
 */
export function contact(point) {
  drawing()?.contact?.(point);
}

/** What is to be shown, for a scene that comes later. */
export function wantedGhost() {
  return wanted;
}

/** The drawing of this page, once it is there. */
export function drawing() {
  return document.getElementById("scene")?.scene;
}
