// Pointing at things of the world: a click chooses one, a double click makes the camera follow it.

import { Raycaster, Vector2 } from "three";

const DRAG_PX = 5;
const DOUBLE_MS = 300;

export class Chooser {
  /**
   * @param {import("../../pages/scripts/src/scene_view.js").View} view
   * @param {{meshes: () => any[], chosen: (iri: string) => void, followed: (iri: string) => void}} hooks
   */
  constructor(view, { meshes, chosen, followed }) {
    this.view = view;
    this.meshes = meshes;
    this.chosen = chosen;
    this.followed = followed;
    /** Return whether the thing under the pointer cannot be chosen. */
    this.quiet = () => false;
    this.caster = new Raycaster();
    const { canvas, ending } = view;
    const { signal } = ending;
    canvas.addEventListener("pointerdown", (event) => (this.down = this.quiet() ? undefined : event), { signal });
    canvas.addEventListener("pointerup", (event) => this.up(event), { signal });
    canvas.addEventListener("dblclick", (event) => this.twice(event), { signal });
    signal.addEventListener("abort", () => clearTimeout(this.waiting));
  }

  /** @returns {string|undefined} the IRI of the thing drawn at a place of the window, in CSS pixels */
  at({ clientX, clientY }) {
    const { canvas, camera } = this.view;
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const place = new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
    this.caster.setFromCamera(place, camera);
    const [hit] = this.caster.intersectObjects(this.meshes(), true).filter(({ object }) => object.visible);
    for (let each = hit?.object; each; each = each.parent) if (each.userData.iri) return each.userData.iri;
    return undefined;
  }

  /** A click counts once no second click has come in time. */
  up(event) {
    const { down } = this;
    this.down = undefined;
    if (event.button !== 0 || !down || Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) > DRAG_PX) return;
    const iri = this.at(event);
    clearTimeout(this.waiting);
    if (iri) this.waiting = setTimeout(() => this.chosen(iri), DOUBLE_MS);
  }

  twice(event) {
    clearTimeout(this.waiting);
    const iri = this.at(event);
    if (iri) this.followed(iri);
  }
}
