// Shapes from files, in which triangles do not share corners. Drawing is several times faster if they do.

import { BufferAttribute } from "three";

const FREE = -1;

/** Merge equal corners of a geometry, keeping only position and normal. */
export function weld(geometry) {
  for (const name of Object.keys(geometry.attributes)) {
    if (name !== "position" && name !== "normal") geometry.deleteAttribute(name);
  }
  if (!geometry.attributes.normal) geometry.computeVertexNormals();
  const { position, normal } = geometry.attributes;
  const plain = [position, normal].every(({ array, itemSize }) => array instanceof Float32Array && itemSize === 3);
  if (geometry.index || !plain) return;
  const { first, index } = corners(bits(position), bits(normal), position.count);
  geometry.setAttribute("position", chosen(position, first));
  geometry.setAttribute("normal", chosen(normal, first));
  geometry.setIndex(new BufferAttribute(index, 1)); // in the same order, so that material groups stay valid
}

function bits({ array }) {
  return new Int32Array(array.buffer, array.byteOffset, array.length);
}

/** Return `first`, the distinct vertices, and `index`, which maps every vertex to one of them. */
function corners(p, n, count) {
  const mask = 2 ** Math.ceil(Math.log2(2 * count + 2)) - 1;
  const table = new Int32Array(mask + 1).fill(FREE);
  const index = new Uint32Array(count);
  const first = new Uint32Array(count);
  const same = (a, b) =>
    p[a] === p[b] && p[a + 1] === p[b + 1] && p[a + 2] === p[b + 2] && n[a] === n[b] && n[a + 1] === n[b + 1] && n[a + 2] === n[b + 2];
  let kept = 0;
  for (let i = 0; i < count; i++) {
    const at = 3 * i;
    let hash = 0;
    for (let k = at; k < at + 3; k++) hash = Math.imul(hash ^ p[k], 0x9e3779b1) ^ (hash >>> 15) ^ Math.imul(n[k], 0x85ebca6b);
    let slot = (hash ^ (hash >>> 16)) & mask;
    while (table[slot] !== FREE && !same(3 * first[table[slot]], at)) slot = (slot + 1) & mask;
    if (table[slot] === FREE) {
      first[kept] = i;
      table[slot] = kept++;
    }
    index[i] = table[slot];
  }
  return { first: first.subarray(0, kept), index };
}

function chosen({ array }, first) {
  const values = new Float32Array(3 * first.length);
  first.forEach((vertex, i) => values.set(array.subarray(3 * vertex, 3 * vertex + 3), 3 * i));
  return new BufferAttribute(values, 3);
}

/**
 * Draw a merged geometry with all of its triangles, or fewer: corners closer than `cell` are merged, triangles
 * without area are left out, and normals stay those of the original shape.
 *
 * @param {number} cell in the geometry's own unit; 0 is all
 */
export function detail(geometry, cell) {
  const { userData: known } = geometry;
  if (!geometry.index) return;
  known.fine ??= { index: geometry.index, groups: geometry.groups };
  if (cell > 0) known.coarse ??= coarse(geometry, known.fine, cell);
  const { index, groups } = cell > 0 ? known.coarse : known.fine;
  geometry.setIndex(index);
  geometry.groups = groups;
}

function coarse(geometry, fine, cell) {
  const nearest = representatives(geometry.attributes.position.array, geometry.attributes.normal.array, cell);
  const old = fine.index.array;
  const index = new Uint32Array(old.length);
  let kept = 0;
  const whole = [{ start: 0, count: old.length }];
  const groups = (fine.groups.length ? fine.groups : whole).map(({ start, count, materialIndex }) => {
    const from = kept;
    for (let i = start; i + 2 < Math.min(start + count, old.length); i += 3) {
      const corners = [nearest[old[i]], nearest[old[i + 1]], nearest[old[i + 2]]];
      if (corners[0] === corners[1] || corners[1] === corners[2] || corners[0] === corners[2]) continue;
      index.set(corners, kept);
      kept += 3;
    }
    return { start: from, count: kept - from, materialIndex };
  });
  return { index: new BufferAttribute(index.slice(0, kept), 1), groups: fine.groups.length ? groups : [] };
}

/** Return for each vertex a representative of its cell and direction. */
function representatives(places, normals, cell) {
  const found = new Map();
  const nearest = new Uint32Array(places.length / 3);
  const step = (at) => Math.round(places[at] / cell);
  for (let i = 0; i < nearest.length; i++) {
    const at = 3 * i;
    const facing = (normals[at] > 0 ? 1 : 0) + (normals[at + 1] > 0 ? 2 : 0) + (normals[at + 2] > 0 ? 4 : 0);
    // Cells within a million of the origin have distinct numbers; beyond, some share one.
    const key = ((step(at) & 0xffff) * 0x10000 + (step(at + 1) & 0xffff)) * 0x80000 + (step(at + 2) & 0xffff) * 8 + facing;
    if (!found.has(key)) found.set(key, i);
    nearest[i] = found.get(key);
  }
  return nearest;
}
