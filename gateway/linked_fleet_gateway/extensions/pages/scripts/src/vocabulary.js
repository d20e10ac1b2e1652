// The few terms that scripts know; everything else is read from pages.

import { say } from "./say.js";

export const RDF_TYPE = "http://www.w3.org/1999/02/22-rdf-syntax-ns#type";
export const TITLE = "http://purl.org/dc/terms/title";
export const LABEL = "http://www.w3.org/2000/01/rdf-schema#label";
export const RESULT_TIME = "http://www.w3.org/ns/sosa/resultTime";
export const NUMERICAL_VALUE = "http://vocab.arvida.de/2015/06/vom/vocab#numericalValue";
export const PROV = "http://www.w3.org/ns/prov#";
export const UNIT = "http://qudt.org/schema/qudt/unit";
export const HYBRIT = "https://hybr-it-projekt.de/ns/hybr-it#";
export const ACTION = `${HYBRIT}action`;
export const HAS_PART = "http://purl.org/dc/terms/hasPart";

const XSD = "http://www.w3.org/2001/XMLSchema#";
export const DECIMAL = `${XSD}decimal`;
export const DOUBLE = `${XSD}double`;

/** @param {string} name of this project's vocabulary */
export function lf(name) {
  return `https://w3id.org/linked-fleet#${name}`;
}

/** Represents an unknown value. */
export const UNKNOWN = lf("unknown");

/** Return the local name of an IRI: the part after its last `#` or `/`. */
export function localName(iri) {
  const end = iri.replace(/[#/]+$/, "");
  return decodeURIComponent(end.slice(Math.max(end.lastIndexOf("#"), end.lastIndexOf("/")) + 1).replace(/%(?![0-9A-Fa-f]{2})/g, "%25"));
}

const SYMBOLS = {
  RAD: "rad", Radian: "rad", DEG: "°", Degree: "°", "RAD-PER-SEC": "rad/s", M: "m", MilliM: "mm", "M-PER-SEC": "m/s",
  "N-M": "N m", N: "N", PERCENT: "%", SEC: "s", HZ: "Hz", V: "V", A: "A", DEG_C: "°C", UNITLESS: "",
};

/** Return the symbol of a unit, or its local name. */
export function unitSymbol(iri) {
  const name = localName(iri);
  return SYMBOLS[name] ?? name;
}

/** Return the segments of an IRI's path, decoded. */
export function segments(iri) {
  return new URL(iri, location.href).pathname.split("/").filter(Boolean).map(decodeURIComponent);
}

/** Return a name in camel case as words: `rotateBy` is "rotate by". */
export function words(name) {
  return name.replace(/([a-z0-9])([A-Z])/g, "$1 $2").toLowerCase();
}

/** `…/arm/elbow/actions/rotateBy/invocations/1` is "rotate by elbow", as texts.py has it. */
export function taskName(iri) {
  const found = segments(iri);
  const at = found.indexOf("actions");
  if (at < 0 || at + 1 >= found.length) return found.at(-1) ?? "";
  return [say(words(found[at + 1])), ...(at === 2 ? [found[1]] : [])].join(" ");
}
