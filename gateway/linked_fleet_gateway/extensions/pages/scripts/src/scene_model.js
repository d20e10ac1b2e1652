// The robot as an object of three.js: its URDF without external references, with its meshes or substitutes.

import { say } from "./say.js";
import { Color, Group, LoadingManager, Mesh, Texture } from "three";
import { ColladaComposer } from "three/examples/jsm/loaders/collada/ColladaComposer.js";
import { ColladaParser } from "three/examples/jsm/loaders/collada/ColladaParser.js";
import { OBJLoader } from "three/examples/jsm/loaders/OBJLoader.js";
import { toCreasedNormals } from "three/examples/jsm/utils/BufferGeometryUtils.js";
import URDFLoader from "urdf-loader";

import { Budget, checkCollada, checkObj, checkSize, stl } from "./scene_files.js";
import { weld } from "./scene_geometry.js";
import { glb } from "./scene_glb.js";
import { skeleton } from "./scene_skeleton.js";

const AT_ONCE = 4;
const BUSY = 503;
const AGAIN_MS = 2000;
const CREASE_RAD = 0.7;
const CREASED = 6e5; // corners; finding creases in more of them takes seconds
const MOST_SHAPES = 4096;
const PRIMITIVES = "box, cylinder, sphere";

/**
 * @param {string} address of the model
 * @param {boolean} [simplified] whether its meshes are to have few triangles
 * @returns {Promise<string>} the URDF
 */
export async function fetchModel(address, signal, simplified = false) {
  if (simplified) address += "/simplified";
  const answer = await fetch(address, { headers: { Accept: "application/xml" }, signal });
  if (!answer.ok) throw new Error(`${address}: ${answer.status} ${answer.statusText}`);
  return answer.text();
}

/**
 * Return the robot without its meshes, and the tasks that load them.
 *
 * @param {string} urdf
 * @param {string} address of the URDF, to which mesh addresses are relative
 * @returns {{robot: import("urdf-loader").URDFRobot, meshes: {url: string, place: (mesh: object) => void}[]}}
 * @throws {Error} if it is not a URDF
 */
export function build(urdf, address) {
  const xml = new DOMParser().parseFromString(urdf, "application/xml");
  const root = xml.querySelector(":root");
  if (root?.nodeName !== "robot") throw new Error(say("the model is not a URDF"));
  const declared = new Set([...root.querySelectorAll(":scope > link:has(> visual)")].map((link) => link.getAttribute("name")));
  harmless(root, address);
  const meshes = [];
  const colour = displayed();
  const loader = new URDFLoader(new LoadingManager());
  loader.parseCollision = true;
  loader.loadMeshCb = (url, _manager, material, done) =>
    meshes.push({ url, place: (mesh) => done(painted(mesh, colour(material))) });
  const robot = loader.parse(xml);
  robot.traverse((/** @type {any} */ each) => each.isMesh && colour(each.material));
  robot.userData.declared = declared;
  for (const joint of Object.values(robot.joints)) joint.ignoreLimits = true; // measurements are shown
  for (const collider of collidersOf(robot)) collider.visible = false;
  return { robot, meshes };
}

/** Colours of a URDF are in sRGB, which urdf-loader does not know. Each material is converted once. */
function displayed() {
  const known = new Set();
  return (material) => {
    if (!known.has(material)) material.color.convertSRGBToLinear();
    known.add(material);
    return material;
  };
}

/** Remove everything from the URDF that would be fetched from another host. */
function harmless(root, address) {
  if (root.querySelectorAll("geometry").length > MOST_SHAPES) throw new Error(say("the model has more than {MOST_SHAPES} shapes", { MOST_SHAPES }));
  for (const texture of root.querySelectorAll("texture")) texture.remove();
  for (const mesh of root.querySelectorAll("collision mesh")) mesh.remove();
  for (const mesh of root.querySelectorAll("visual mesh")) {
    const url = ownUrl(mesh.getAttribute("filename"), address);
    if (url) mesh.setAttribute("filename", url);
    else mesh.remove();
  }
  for (const geometry of root.querySelectorAll("geometry")) if (!geometry.children.length) geometry.remove();
  for (const collision of root.querySelectorAll("collision")) if (!collision.querySelector(PRIMITIVES)) collision.remove();
}

function ownUrl(filename, address) {
  const base = new URL(address, document.baseURI);
  if (!filename || !URL.canParse(filename, base)) return undefined;
  const url = new URL(filename, base);
  return url.origin === location.origin && /\.(stl|dae|obj|glb)$/.test(url.pathname) ? url.pathname : undefined;
}

/**
 * Fetch the meshes of a robot, each file once, and add them as they arrive.
 *
 * @param {(done: number, of: number) => void} onProgress
 * @returns {Promise<string[]>} addresses of those that could not be loaded
 */
export async function loadMeshes(meshes, onProgress, signal) {
  const places = Map.groupBy(meshes, ({ url }) => url);
  const waiting = [...places];
  const failed = [];
  const budget = new Budget();
  let done = 0;
  onProgress(0, places.size);
  const work = async () => {
    for (let next = waiting.shift(); next && !signal.aborted; next = waiting.shift()) {
      const [url, users] = next;
      try {
        const mesh = await fetchMesh(url, signal);
        budget.spend(mesh, users.length);
        mesh.traverse((each) => each.isMesh && weld(each.geometry));
        for (const { place } of users) place(mesh.clone());
      } catch (error) {
        if (signal.aborted) return;
        console.warn(`${url} is not drawn:`, error);
        failed.push(url);
      }
      onProgress(++done, places.size);
    }
  };
  await Promise.all(Array.from({ length: AT_ONCE }, work));
  return failed;
}

async function fetchMesh(url, signal) {
  let answer = await fetch(url, { signal });
  if (answer.status === BUSY) {
    await new Promise((resolve) => setTimeout(resolve, AGAIN_MS));
    answer = await fetch(url, { signal });
  }
  if (!answer.ok) throw new Error(`${answer.status} ${answer.statusText}`);
  checkSize(answer);
  const served = answer.url; // that of the mesh itself if it cannot be simplified
  if (served.endsWith(".dae")) return collada(await answer.text());
  if (served.endsWith(".obj")) return object(await answer.text());
  if (served.endsWith(".glb")) return glb(await answer.arrayBuffer());
  const geometry = stl(await answer.arrayBuffer());
  if (geometry.attributes.position.count <= CREASED) return new Mesh(toCreasedNormals(geometry, CREASE_RAD));
  geometry.computeVertexNormals();
  return new Mesh(geometry);
}

function object(text) {
  checkObj(text);
  return drawable(new OBJLoader().parse(text));
}

// Loads nothing: textures of meshes are not served.
const BLANK = { load: () => new Texture() };

/** Return the shapes of a Collada file in its own axes, as usual in robotics, in metre. */
function collada(text) {
  const parsed = new ColladaParser().parse(text);
  if (!parsed) throw new Error("no Collada");
  checkCollada(parsed.library);
  const { scene } = new ColladaComposer(parsed.library, parsed.collada, BLANK, BLANK).compose();
  const sized = new Group();
  sized.scale.setScalar(parsed.asset.unit);
  sized.add(drawable(scene));
  sized.traverse((/** @type {any} */ each) => each.isMesh && (each.userData.coloured = true));
  return sized;
}

/** Remove the lights, cameras, lines and skeletons in some files. */
function drawable(object) {
  const others = [];
  object.traverse((each) => each !== object && !each.isMesh && !each.isGroup && each.type !== "Object3D" && others.push(each));
  for (const other of others) if (!other.getObjectByProperty("isMesh", true)) other.removeFromParent();
  return object;
}

/** Give what has no colour of its own that of the URDF. */
function painted(object, material) {
  object.traverse((each) => each.isMesh && !each.userData.coloured && (each.material = material));
  return object;
}

/** Return the meshes of a link, without those of links below. */
export function meshesOf(link) {
  const found = [];
  for (const child of link.children) {
    if (child.isURDFJoint || !child.visible) continue;
    child.traverse((each) => each.isMesh && found.push(each));
  }
  return found;
}

function collidersOf(robot) {
  const found = [];
  robot.traverse((/** @type {any} */ each) => each.isURDFCollider && found.push(each));
  return found;
}

/**
 * After loading, give links without meshes the primitives of their collision geometry, or else their frames.
 *
 * @param {Color} colour of the substitutes
 * @returns {number} how many links are drawn as frames
 */
export function complete(robot, colour) {
  const links = Object.values(robot.links);
  const nothing = links.every((link) => !meshesOf(link).length);
  const lost = links.filter((link) => (nothing || robot.userData.declared.has(link.urdfName)) && !meshesOf(link).length);
  for (const link of lost) for (const child of link.children) if (child.isURDFCollider) child.visible = true;
  for (const collider of collidersOf(robot)) if (!collider.visible) collider.removeFromParent();
  const bare = lost.filter((link) => !meshesOf(link).length);
  skeleton(robot, bare, new Color(colour));
  return bare.length;
}
