// The map of the floor, as read from its description. Metre.

import { length, MATHS, poseOf } from "../../pages/scripts/src/pose_of.js";
import { lf, TITLE } from "../../pages/scripts/src/vocabulary.js";

const VERSION_LENGTH = 16;

/**
 * @param {import("../../pages/scripts/src/ntriples.js").Graph} graph
 * @param {string} iri of the map
 * @returns {{title: string, pose: {position: number[], orientation: number[]}, width: number, height: number, picture: string}|undefined}
 * `pose` is that of the lower left corner; `picture` is another address for another image; undefined without a map
 */
export function mapOf(graph, iri) {
  const pose = poseOf(graph, iri);
  const picture = graph.value(iri, lf("mapPicture"))?.value;
  const size = graph.value(iri, lf("size"));
  const [width, height] = ["x", "y"].map((axis) => length(graph, size, MATHS + axis));
  if (!pose || !picture || !(width > 0 && height > 0)) return undefined;
  const version = graph.value(iri, lf("sha256"))?.value.slice(0, VERSION_LENGTH);
  return { title: graph.value(iri, TITLE)?.value ?? "map", pose, width, height, picture: `${picture}?v=${version}` };
}
