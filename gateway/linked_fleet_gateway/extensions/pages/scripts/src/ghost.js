// What the scene of this page shows besides the robot: where it would be.

/** @type {{joints: Map<string, number>, refused: boolean}|undefined} */
let wanted;

/**
 * Show the robot with some of its joints elsewhere; without arguments, hide that.
 *
 * @param {Map<string, number>} [joints] positions in rad or m by the joint's IRI
 * @param {boolean} [refused] whether it has been refused
 */
export function ghost(joints, refused = false) {
  wanted = joints?.size ? { joints, refused } : undefined;
  drawing()?.ghost(wanted);
}

/**
 * Mark the place of a collision, or where the robot comes close to something; without an argument, remove the mark.
 *
 * @param {number[]} [point] in the world, in metre
 * @param {boolean} [refused] whether it is a collision
 */
export function contact(point, refused = true) {
  drawing()?.contact?.(point, refused);
}

/** Return what is to be shown, for a scene that is created later. */
export function wantedGhost() {
  return wanted;
}

/** The scene of this page, once it exists. */
export function drawing() {
  return document.getElementById("scene")?.scene;
}
