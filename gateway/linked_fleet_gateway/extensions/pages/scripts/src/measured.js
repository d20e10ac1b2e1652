// What robots measure, and what their components say: numbers and texts by name.

import { select } from "./fleet_offer.js";
import { HAS_PART, HYBRIT, NUMERICAL_VALUE, UNIT, lf, localName, unitSymbol, words } from "./vocabulary.js";

const OBSERVABLE = "http://www.w3.org/ns/sosa/ObservableProperty";

/** @typedef {{thing: string, resource: string, path: string[], unit: string, name: string, text: boolean}} Measured `resource` is the property, `path` leads from `thing` to the value */

/** Return the measured numbers, and the texts, of a robot and its parts. */
export async function fetchValues(query, robot) {
  const asked = `PREFIX hybrit: <${HYBRIT}>
SELECT DISTINCT ?thing ?property ?resource ?part ?unit ?text WHERE {
  <${robot}> <${HAS_PART}>* ?thing . ?thing hybrit:property ?resource ; ?property ?resource .
  FILTER(?property != hybrit:property)
  { ?resource a <${OBSERVABLE}> ; ?part ?scalar . ?scalar <${NUMERICAL_VALUE}> ?number . OPTIONAL { ?scalar <${UNIT}> ?unit } }
  UNION { ?resource a <${lf("ComponentProperty")}> ; <${lf("value")}> ?text . BIND(<${lf("value")}> AS ?part) FILTER(isLiteral(?text)) }
}`;
  const found = (await select(query, asked)).map((row) => measuredOf(robot, row));
  return found.sort((one, other) => one.thing.localeCompare(other.thing) || one.name.localeCompare(other.name));
}

/** @returns {Measured} */
function measuredOf(robot, { thing, property, resource, part, unit, text }) {
  const inside = thing.value.slice(robot.length) ? `${decodeURIComponent(thing.value.slice(robot.length))} ` : "";
  const detail = ["value", "rotationAngle", "displacement"].includes(localName(part.value)) ? "" : ` ${words(localName(part.value))}`;
  // Properties of one make are named after their component: "simulation-property-time".
  const name = `${inside}${words(localName(property.value).replace(/^.*-property-/, ""))}${detail}`;
  const path = [property.value, part.value, ...(text ? [] : [NUMERICAL_VALUE])];
  const symbol = unit ? unitSymbol(unit.value) : "";
  return { thing: thing.value, resource: resource.value, path, unit: symbol, name, text: Boolean(text) };
}
