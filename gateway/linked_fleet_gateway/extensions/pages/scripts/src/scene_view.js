// The stage: camera, light, floor and controls. It is drawn when something has changed and it is visible.

import {
  ACESFilmicToneMapping,
  Box3,
  Color,
  DirectionalLight,
  GridHelper,
  HemisphereLight,
  Mesh,
  PCFShadowMap,
  PerspectiveCamera,
  PlaneGeometry,
  Scene,
  ShadowMaterial,
  Sphere,
  Vector3,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";

import { detail } from "./scene_geometry.js";
import { Pacing } from "./scene_pacing.js";

const SHARPEST = 2; // device pixel ratio; more costs much and is not visible
// On a machine that draws more slowly than this, movement is simplified: first without shadows, then with coarser
// shapes, then with fewer pixels. As soon as it ends, the scene is drawn in full quality.
const SLOW_MS = 55;
const PATIENCE_MS = 300;
const STILL_MS = 400;
const SKETCHIEST = 3;
const FEWER = 0.7; // pixels along each side
const CELL = 1 / 110; // of the robot's size
const TURN_RAD = Math.PI / 24;
const NEARER = 1.15;
const FROM = new Vector3(1, -0.75, 0.5).normalize();

const calm = matchMedia("(prefers-reduced-motion: reduce)");

export class View {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {WebGL2RenderingContext} context of the canvas
   * @param {(now: number) => boolean} animate moves the contents and returns whether more movement follows
   */
  constructor(canvas, context, animate) {
    this.canvas = canvas;
    this.animate = animate;
    this.seen = true;
    this.slow = 0;
    this.level = 0; // level of simplification for movement on this machine
    this.sketch = 0; // present level of simplification
    this.ending = new AbortController();
    this.pacing = new Pacing(context, (now) => this.draw(now));
    this.renderer = new WebGLRenderer({ canvas, context, antialias: true, alpha: true });
    this.renderer.toneMapping = ACESFilmicToneMapping;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.shadowMap.autoUpdate = false;
    this.scene = new Scene();
    this.camera = new PerspectiveCamera(35, 1, 0.01, 200);
    this.camera.up.set(0, 0, 1);
    this.light();
    this.control();
    this.sizes = new ResizeObserver(() => this.resize());
    this.sizes.observe(canvas.parentElement);
    this.themed();
  }

  light() {
    // Environment light would cost seconds without a graphics card; these three lights are similar.
    this.sun = new DirectionalLight(0xfff6ea, 2.1);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.set(1024, 1024);
    this.sun.shadow.radius = 4;
    const [side, back] = [new DirectionalLight(0xdfeaff, 0.8), new DirectionalLight(0xffffff, 1.5)];
    side.position.set(0.4, -1, 0.35);
    back.position.set(-1, 0.6, 0.9);
    this.scene.add(new HemisphereLight(0xffffff, 0x9aa4b2, 1.25), this.sun, this.sun.target, side, back);
    this.grid = new GridHelper();
    this.grid.rotation.x = Math.PI / 2;
    Object.assign(this.grid.material, { transparent: true, opacity: 0.7, depthWrite: false });
    this.floor = new Mesh(new PlaneGeometry(), new ShadowMaterial({ opacity: 0.28, depthWrite: false }));
    this.floor.receiveShadow = true;
    this.scene.add(this.floor, this.grid);
  }

  control() {
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.enableDamping = !calm.matches;
    this.controls.addEventListener("start", () => (this.untouched = false));
    this.controls.addEventListener("change", () => this.invalidate());
    this.canvas.style.touchAction = "pan-y"; // a vertical drag with a finger scrolls the page
    const { signal } = this.ending;
    this.canvas.addEventListener("keydown", (event) => this.key(event), { signal });
    // The wheel scrolls the page until the view has been clicked.
    const wheel = (event) => (this.controls.enableZoom = event.ctrlKey || document.activeElement === this.canvas);
    this.canvas.addEventListener("wheel", wheel, { capture: true, passive: true, signal });
    document.addEventListener("visibilitychange", () => this.invalidate(), { signal });
    this.canvas.addEventListener("webglcontextrestored", () => this.invalidate(true), { signal });
    calm.addEventListener("change", () => (this.controls.enableDamping = !calm.matches), { signal });
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const turns = { ArrowLeft: [-TURN_RAD, 0], ArrowRight: [TURN_RAD, 0], ArrowUp: [0, -TURN_RAD], ArrowDown: [0, TURN_RAD] };
    const steps = { "+": 1 / NEARER, "=": 1 / NEARER, "-": NEARER };
    if (event.key in turns) this.turn(...turns[event.key]);
    else if (event.key in steps) this.zoom(steps[event.key]);
    else if (event.key === "0" || event.key === "Home") this.fit();
    else return;
    this.untouched = event.key === "0" || event.key === "Home";
    event.preventDefault();
  }

  turn(around, down) {
    const { target } = this.controls;
    const arm = this.camera.position.clone().sub(target);
    const side = new Vector3().crossVectors(this.camera.up, arm).normalize();
    const polar = arm.angleTo(this.camera.up) + down;
    if (polar > 0.05 && polar < Math.PI - 0.05) arm.applyAxisAngle(side, down);
    this.camera.position.copy(target).add(arm.applyAxisAngle(this.camera.up, around));
    this.invalidate();
  }

  zoom(factor) {
    const { target, minDistance, maxDistance } = this.controls;
    const arm = this.camera.position.clone().sub(target);
    this.camera.position.copy(target).add(arm.setLength(Math.min(maxDistance, Math.max(minDistance, arm.length() * factor))));
    this.invalidate();
  }

  /** Show a robot, in place of any other, on the floor: at z = 0, or below the lowest part of one that stands on none. */
  stage(robot) {
    if (this.robot) this.scene.remove(this.robot);
    this.robot = robot;
    this.scene.add(robot);
    this.fit();
  }

  /** Look at the whole robot, and adapt floor and light to it. */
  fit() {
    if (!this.robot) return;
    this.untouched = true;
    this.robot.updateMatrixWorld(true);
    const box = new Box3().setFromObject(this.robot);
    if (box.isEmpty()) box.set(new Vector3(-0.1, -0.1, 0), new Vector3(0.1, 0.1, 0.2));
    const ball = box.getBoundingSphere(new Sphere());
    this.size = ball.radius;
    const distance = this.distance(ball.center);
    Object.assign(this.controls, { minDistance: ball.radius / 10, maxDistance: distance * 6 });
    this.controls.target.copy(ball.center);
    this.camera.position.copy(ball.center).addScaledVector(FROM, distance);
    Object.assign(this.camera, { near: distance / 100, far: distance * 20 }).updateProjectionMatrix();
    this.floorAt(Math.abs(box.min.z) < 0.1 * ball.radius ? 0 : Math.min(0, box.min.z), ball);
    // Picking uses the camera, possibly before the next drawing.
    this.controls.update();
    this.camera.updateMatrixWorld();
    this.invalidate(true);
  }

  /** Look at one thing, from the camera's present direction. */
  approach(thing) {
    const ball = new Box3().setFromObject(thing).getBoundingSphere(new Sphere());
    if (ball.isEmpty()) return;
    const arm = this.camera.position.clone().sub(this.controls.target);
    arm.setLength((ball.radius * 1.3) / Math.sin((this.camera.fov / 2) * (Math.PI / 180)));
    this.controls.target.copy(ball.center);
    this.camera.position.copy(ball.center).add(arm);
    this.controls.update();
    this.invalidate();
  }

  /** Move the camera and its target. */
  shift(way) {
    if (way.lengthSq() < 1e-12) return;
    this.controls.target.add(way);
    this.camera.position.add(way);
  }

  /** Return the distance from which the camera sees all of the robot, with a margin. */
  distance(middle) {
    const up = Math.tan((this.camera.fov / 2) * (Math.PI / 180)) * 0.9;
    const across = up * this.camera.aspect;
    const right = new Vector3().crossVectors(this.camera.up, FROM).normalize();
    const above = new Vector3().crossVectors(FROM, right);
    let most = 0.1;
    for (const arm of cornersOf(this.robot)) {
      arm.sub(middle);
      most = Math.max(most, arm.dot(FROM) + Math.max(Math.abs(arm.dot(right)) / across, Math.abs(arm.dot(above)) / up));
    }
    return most;
  }

  floorAt(height, { center, radius }) {
    this.sun.position.copy(center).add(new Vector3(0.5, -0.6, 1.4).multiplyScalar(radius * 2));
    this.sun.target.position.copy(center);
    const reach = radius * 1.5;
    Object.assign(this.sun.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.01, far: radius * 6 });
    this.sun.shadow.camera.updateProjectionMatrix();
    this.sun.shadow.normalBias = radius * 0.012;
    this.grid.geometry.dispose();
    this.floor.geometry.dispose();
    const metres = 2 * Math.max(1, Math.ceil(radius * 2));
    this.grid.geometry = new GridHelper(metres, radius < 0.7 ? metres * 10 : metres * 2, this.colours.axis, this.colours.grid).geometry;
    this.floor.geometry = new PlaneGeometry(metres, metres);
    this.grid.position.set(Math.round(center.x), Math.round(center.y), height);
    this.floor.position.copy(this.grid.position);
  }

  /** Apply the colours of the page's style, dark or light, now and when that changes. */
  themed() {
    const apply = () => {
      const style = getComputedStyle(this.canvas);
      const of = (name) => new Color(style.getPropertyValue(`--scene-${name}`).trim() || "#808890");
      this.colours = Object.fromEntries(["grid", "axis", "highlight", "none", "bone", "refused"].map((name) => [name, of(name)]));
      if (this.robot) this.regrid();
    };
    apply();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", apply, { signal: this.ending.signal });
    this.root = new MutationObserver(apply);
    this.root.observe(document.documentElement, { attributes: true });
  }

  regrid() {
    const { center, radius } = new Box3().setFromObject(this.robot).getBoundingSphere(new Sphere());
    this.floorAt(this.grid.position.z, { center, radius });
    this.canvas.dispatchEvent(new Event("themechange"));
    this.invalidate(true);
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas.parentElement;
    if (!width || !height) return;
    const first = !this.fitted;
    this.fitted = true;
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, SHARPEST) * (this.sketch === SKETCHIEST ? FEWER : 1));
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    if (first) this.fit();
    this.draw(performance.now()); // at once: resizing clears a canvas
  }

  /** Draw soon; `moved` says that shadows have changed, too. */
  invalidate(moved = false) {
    this.renderer.shadowMap.needsUpdate ||= moved;
    if (this.seen && !document.hidden && !this.ending.signal.aborted) this.pacing.request();
  }

  draw(now) {
    const more = this.animate(now);
    this.controls.update(); // emits "change", which requests the next drawing, while it is still gliding
    this.renderer.render(this.scene, this.camera);
    if (more) this.invalidate();
  }

  /** Note that the contents moved at this time. */
  moved(now) {
    clearTimeout(this.still);
    this.still = setTimeout(() => this.apply(0), STILL_MS);
    this.apply(this.level);
    requestAnimationFrame((then) => this.pace(then - now)); // called after this has been drawn
  }

  pace(took) {
    this.slow = took > SLOW_MS ? this.slow + took : 0;
    if (this.slow < PATIENCE_MS || this.level === SKETCHIEST) return;
    this.slow = 0;
    this.level = Math.min(SKETCHIEST, this.level + (took > PATIENCE_MS ? 2 : 1));
  }

  apply(sketch) {
    this.renderer.shadowMap.needsUpdate ||= sketch === 0;
    if (sketch === this.sketch || this.ending.signal.aborted) return;
    const before = this.sketch;
    this.sketch = sketch;
    this.sun.shadow.intensity = sketch ? 0 : 1;
    if (sketch > 1 !== before > 1) this.detail();
    if ((sketch === SKETCHIEST) !== (before === SKETCHIEST)) this.resize();
    else this.invalidate();
  }

  detail() {
    const cell = this.sketch > 1 ? CELL * this.size : 0;
    this.robot?.traverse((each) => each.isMesh && detail(each.geometry, cell / each.matrixWorld.getMaxScaleOnAxis()));
  }

  /** Return whether it is visible. */
  show(seen) {
    this.seen = seen;
    this.invalidate();
  }

  dispose() {
    this.ending.abort();
    clearTimeout(this.still);
    this.pacing.cancel();
    this.sizes.disconnect();
    this.root.disconnect();
    this.controls.dispose();
    this.scene.traverse((/** @type {any} */ each) => {
      each.geometry?.dispose();
      for (const material of [each.material ?? []].flat()) material.dispose();
    });
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }
}

/** Yield the corners of the boxes around the meshes of a robot, in the world. */
function* cornersOf(robot) {
  const meshes = [];
  robot.traverseVisible((each) => each.isMesh && meshes.push(each));
  for (const { geometry, matrixWorld } of meshes) {
    if (!geometry.boundingBox) geometry.computeBoundingBox();
    const { min, max } = geometry.boundingBox;
    for (const x of [min.x, max.x])
      for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) yield new Vector3(x, y, z).applyMatrix4(matrixWorld);
  }
}

/** Return whether the user accepts decorative motion. */
export function smooth() {
  return !calm.matches;
}
