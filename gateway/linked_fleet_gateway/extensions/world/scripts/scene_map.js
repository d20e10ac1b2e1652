// The map of the floor, drawn flat below the robots.

import { Group, Mesh, MeshBasicMaterial, NearestFilter, PlaneGeometry, SRGBColorSpace, TextureLoader } from "three";

import { put } from "../../pages/scripts/src/scene_objects.js";
import { mapOf } from "./floor_map.js";

const BELOW_M = 0.004; // the floor, so that shadows and grid are drawn upon it

/** Not part of what is fitted into the view or clicked: a hall is much larger than the robots in it. */
export class FloorMap extends Group {
  /** @param {() => void} changed is called when the scene must be drawn again */
  constructor(changed) {
    super();
    this.changed = changed;
  }

  /** @param {import("../../pages/scripts/src/ntriples.js").Graph} graph of the map at `iri` */
  async show(graph, iri) {
    const map = mapOf(graph, iri);
    if (map?.picture === this.picture) return;
    this.picture = map?.picture;
    this.discard();
    this.changed();
    if (!map) return;
    try {
      const texture = await new TextureLoader().loadAsync(map.picture);
      if (this.picture === map.picture) this.draw(map, texture);
    } catch (error) {
      console.warn("the map of the floor is not drawn:", error);
    }
  }

  draw(map, texture) {
    Object.assign(texture, { colorSpace: SRGBColorSpace, magFilter: NearestFilter });
    const material = new MeshBasicMaterial({ map: texture, transparent: true, opacity: 0.55, depthWrite: false, toneMapped: false });
    const plane = new Mesh(new PlaneGeometry(map.width, map.height).translate(map.width / 2, map.height / 2, -BELOW_M), material);
    plane.renderOrder = -1;
    put(this, map.pose);
    this.add(plane);
    this.changed();
  }

  discard() {
    for (const plane of /** @type {any[]} */ ([...this.children])) {
      plane.removeFromParent();
      plane.geometry.dispose();
      plane.material.map.dispose();
      plane.material.dispose();
    }
  }
}
