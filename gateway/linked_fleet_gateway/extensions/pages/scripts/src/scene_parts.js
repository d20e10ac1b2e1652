// The links of a drawn robot: their materials, colours and marks.

import { Color, DoubleSide, MeshStandardMaterial } from "three";

// Viridis without its darkest end: brightness grows with the value, so that red and green need not be distinguished.
const RAMP = ["#46327e", "#365c8d", "#277f8e", "#1fa187", "#4ac16d", "#a0da39", "#fde725"].map((hex) => new Color(hex));
const FAINT = 0.35;

export const MODES = ["appearance", "limit proximity", "effort"];

/** @returns {Color} for a share from 0 to 1 */
export function ramp(share) {
  const at = Math.min(1, Math.max(0, share)) * (RAMP.length - 1);
  const low = Math.min(RAMP.length - 2, Math.floor(at));
  return RAMP[low].clone().lerp(RAMP[low + 1], at - low);
}

/** Return how near a joint is to a limit: 0 midway between them, 1 at one; NaN without limits or position. */
export function proximity(joint, position) {
  const { lower, upper } = joint.limit;
  if (joint.jointType !== "revolute" && joint.jointType !== "prismatic") return NaN;
  return upper > lower ? Math.abs(2 * position - upper - lower) / (upper - lower) : NaN;
}

/** Return the effort of a joint as a share of its URDF limit; NaN if either is unknown. */
export function load(joint, effort) {
  return joint.limit.effort > 0 ? Math.abs(effort) / joint.limit.effort : NaN;
}

/** Return the joint that moves a link, through fixed ones; else the one that holds it; undefined for the root. */
export function jointOf(link) {
  for (let each = link.parent; each; each = each.parent) if (each.isURDFJoint && each.jointType !== "fixed") return each;
  return link.parent?.isURDFJoint ? link.parent : undefined;
}

/** A drawn link. */
export class Part {
  /** @param {import("three").Mesh[]} meshes of the link */
  constructor(link, meshes) {
    this.link = link;
    this.joint = jointOf(link);
    this.meshes = meshes;
    this.tint = new MeshStandardMaterial({ roughness: 0.6, side: DoubleSide });
    const own = new Map();
    const replaced = (material) => {
      if (!own.has(material)) own.set(material, standard(material));
      return own.get(material);
    };
    for (const mesh of meshes) mesh.userData.material ??= mesh.material; // as loaded
    const originals = meshes.map((mesh) => mesh.userData.material);
    this.own = originals.map((each) => (Array.isArray(each) ? each.map(replaced) : replaced(each)));
    this.materials = [this.tint, ...own.values()];
    for (const mesh of this.meshes) prepare(mesh, this);
    this.colour(undefined);
  }

  /** @param {Color|undefined} colour all in this one, or as it looks */
  colour(colour) {
    if (colour) this.tint.color.copy(colour);
    this.meshes.forEach((mesh, i) => (mesh.material = colour ? this.tint : this.own[i]));
  }

  /** @param {Color|undefined} colour of the highlight, or none */
  highlight(colour) {
    for (const { emissive } of this.materials) {
      if (colour) emissive.copy(colour).multiplyScalar(0.55);
      else emissive.set(0);
    }
  }

  /** Show that the position is unknown. */
  faint(faint) {
    for (const material of this.materials) {
      material.opacity = faint ? FAINT : material.userData.opacity ?? 1;
      material.transparent = material.opacity < 1;
      material.needsUpdate = true;
    }
  }

  dispose() {
    for (const material of this.materials) material.dispose();
  }
}

function prepare(mesh, part) {
  mesh.userData.part = part;
  mesh.castShadow = mesh.receiveShadow = true;
}

/** Convert the materials of files to the one for which the light is made. */
function standard(material) {
  const color = material.color?.clone() ?? new Color("#c8ccd2");
  // Exporters write 0 where they mean opaque.
  const opacity = material.opacity > 0.05 && material.opacity < 1 ? material.opacity : 1;
  const { roughness = 0.5 } = material;
  const made = new MeshStandardMaterial({ color, opacity, transparent: opacity < 1, roughness, metalness: 0.05, side: DoubleSide });
  made.userData.opacity = opacity;
  return made;
}
