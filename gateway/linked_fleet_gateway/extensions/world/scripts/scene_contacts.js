// Where refused motions would have met something: a mark at each place, seen through everything.

import { Group, Mesh, MeshBasicMaterial, SphereGeometry } from "three";

import { key } from "../../pages/scripts/src/ntriples.js";
import { poseOf } from "../../pages/scripts/src/pose_of.js";
import { lf } from "../../pages/scripts/src/vocabulary.js";

const RADIUS_M = 0.04;

export class Contacts extends Group {
  /** @param {import("../../pages/scripts/src/ntriples.js").Graph} graph of the refused motions at `iri` @param {import("three").Color} colour */
  show(graph, iri, colour) {
    for (const mark of [...this.children]) discard(mark);
    for (const node of graph.values(iri, lf("collision"))) {
      const place = poseOf(graph, key(node));
      if (place) this.add(markAt(place.position, colour));
    }
  }
}

function markAt(position, color) {
  const material = new MeshBasicMaterial({ color, depthTest: false, transparent: true, opacity: 0.85 });
  const mark = new Mesh(new SphereGeometry(RADIUS_M, 24, 12), material);
  mark.position.fromArray(position);
  mark.renderOrder = 1;
  return mark;
}

function discard(/** @type {any} */ mark) {
  mark.removeFromParent();
  mark.geometry.dispose();
  mark.material.dispose();
}
