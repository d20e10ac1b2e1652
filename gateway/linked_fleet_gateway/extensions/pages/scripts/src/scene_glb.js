// Binary glTF 2.0 of robots: its triangles in its own axes, in metre. Nothing is loaded from elsewhere.

import { say } from "./say.js";
import { BufferAttribute, BufferGeometry, Color, DoubleSide, Group, Matrix4, Mesh, MeshStandardMaterial, Quaternion, Vector3 } from "three";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";

import { limit, MOST_CORNERS } from "./scene_files.js";

const GLTF = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const TRIANGLES = 4;
const COMPONENTS = { 5121: Uint8Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const MOST_MATERIALS = 256;
const CREASE_RAD = 0.7;
const CREASED = 6e5; // corners of a file; finding creases in more of them takes seconds
const SIZES = { SCALAR: 1, VEC3: 3 };

/**
 * Return its shapes. Those with a material of the file have its base colour and `userData.coloured`.
 *
 * @param {ArrayBuffer} file
 * @returns {Group}
 * @throws {Error} if it is no binary glTF, refers to other files or needs an extension
 */
export function glb(file) {
  const { document, binary } = chunks(file);
  if (document.extensionsRequired?.length) throw new Error(say("it needs {extensionsRequired}", { extensionsRequired: document.extensionsRequired }));
  if (document.buffers?.some(({ uri }) => uri)) throw new Error(say("its buffers are not in it"));
  const whole = new Group();
  const scene = document.scenes?.[document.scene ?? 0];
  const pending = (scene?.nodes ?? []).map((node) => ({ node, parent: whole }));
  const colours = (document.materials ?? []).slice(0, MOST_MATERIALS).map(coloured);
  let objects = 0;
  let corners = 0;
  for (let next = pending.pop(); next; next = pending.pop()) {
    limit(++objects);
    const node = document.nodes[next.node];
    const group = placed(node);
    next.parent.add(group);
    for (const primitive of document.meshes?.[node.mesh]?.primitives ?? []) {
      limit(++objects);
      if ((primitive.mode ?? TRIANGLES) !== TRIANGLES) continue;
      corners += document.accessors[primitive.indices ?? primitive.attributes.POSITION].count;
      if (!(corners <= MOST_CORNERS)) throw new Error(say("it has more than {MOST_CORNERS} corners", { MOST_CORNERS }));
      const mesh = new Mesh(geometry(document, binary, primitive, corners <= CREASED), colours[primitive.material]);
      mesh.userData.coloured = Boolean(colours[primitive.material]);
      group.add(mesh);
    }
    for (const child of node.children ?? []) pending.push({ node: child, parent: group });
  }
  return whole;
}

function chunks(file) {
  const view = new DataView(file);
  if (file.byteLength < 20 || view.getUint32(0, true) !== GLTF || view.getUint32(4, true) !== 2) throw new Error(say("it is no binary glTF 2.0"));
  const length = view.getUint32(12, true);
  if (view.getUint32(16, true) !== JSON_CHUNK || 20 + length > file.byteLength) throw new Error(say("it is no binary glTF 2.0"));
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(file, 20, length)));
  const start = 20 + length;
  const size = start + 8 <= file.byteLength ? view.getUint32(start, true) : 0;
  return { document, binary: file.slice(start + 8, start + 8 + size) };
}

/** Return the base colour of a material, which is linear in glTF; textures are not drawn. */
function coloured({ pbrMetallicRoughness: { baseColorFactor = [1, 1, 1, 1], baseColorTexture = undefined } = {}, doubleSided = false }) {
  const [red, green, blue, opacity] = baseColorFactor;
  if (baseColorTexture) return undefined;
  const side = doubleSided ? { side: DoubleSide } : {};
  return new MeshStandardMaterial({ color: new Color(red, green, blue), opacity, transparent: opacity < 1, roughness: 0.6, ...side });
}

function placed({ matrix, translation = [0, 0, 0], rotation = [0, 0, 0, 1], scale = [1, 1, 1] }) {
  const own = matrix ? new Matrix4().fromArray(matrix) : new Matrix4().compose(new Vector3(...translation), new Quaternion(...rotation), new Vector3(...scale));
  const group = new Group();
  group.applyMatrix4(own);
  return group;
}

function geometry(document, binary, { attributes, indices }, creased) {
  const found = new BufferGeometry().setAttribute("position", new BufferAttribute(numbers(document, binary, attributes.POSITION), 3));
  if (indices !== undefined) found.setIndex(new BufferAttribute(numbers(document, binary, indices), 1));
  const flat = found.index ? found.toNonIndexed() : found;
  if (creased) return toCreasedNormals(flat, CREASE_RAD);
  flat.computeVertexNormals();
  return flat;
}

/** Return the numbers of an accessor, without the bytes between its elements. */
function numbers(document, binary, index) {
  const { bufferView, byteOffset = 0, componentType, count, type, sparse } = document.accessors[index];
  const kind = COMPONENTS[componentType];
  const size = SIZES[type];
  const view = document.bufferViews[bufferView];
  if (!kind || !size || !view || view.buffer || sparse) throw new Error(say("it has numbers of an unknown form"));
  const width = size * kind.BYTES_PER_ELEMENT;
  const stride = view.byteStride ?? width;
  const start = (view.byteOffset ?? 0) + byteOffset;
  if (count && start + (count - 1) * stride + width > binary.byteLength) throw new Error(say("the file is shorter than it says"));
  if (stride === width) return new kind(binary.slice(start, start + count * width));
  const found = new kind(count * size);
  for (let i = 0; i < count; i++) found.set(new kind(binary.slice(start + i * stride, start + i * stride + width)), i * size);
  return found;
}
