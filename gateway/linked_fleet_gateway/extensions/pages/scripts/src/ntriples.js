// RDF as sent by the gateway over WebSockets: N-Triples, parsed into a graph and written from terms.

/**
 * @typedef {{kind: "iri"|"blank"|"literal", value: string, datatype?: string, language?: string}} Term
 */

const XSD_STRING = "http://www.w3.org/2001/XMLSchema#string";
const LANG_STRING = "http://www.w3.org/1999/02/22-rdf-syntax-ns#langString";
const LINE =
  /^[ \t]*(?:<([^>]*)>|_:([^\s<>"]+))[ \t]*<([^>]*)>[ \t]*(?:<([^>]*)>|_:([^\s<>"]+?)|"((?:[^"\\]|\\.)*)"(?:\^\^<([^>]*)>|@([A-Za-z0-9-]+))?)[ \t]*\.[ \t]*(?:#.*)?$/;
const ESCAPE = /\\(?:u([0-9A-Fa-f]{4})|U([0-9A-Fa-f]{8})|(.))/g;
const CHARACTERS = { t: "\t", b: "\b", n: "\n", r: "\r", f: "\f", '"': '"', "'": "'", "\\": "\\" };

/** Triples by subject and predicate. A subject is its IRI, or `_:` and the label of a blank node. */
export class Graph {
  constructor() {
    /** @type {Map<string, Map<string, Term[]>>} */
    this.subjects = new Map();
    this.inverse = new Map();
    /** @type {number|undefined} when its values were measured, in seconds since 1970 by the agent's clock, if it is a frame */
    this.timeS = undefined;
  }

  add(subject, predicate, object) {
    let facts = this.subjects.get(subject);
    if (!facts) this.subjects.set(subject, (facts = new Map()));
    const objects = facts.get(predicate);
    if (objects) objects.push(object);
    else facts.set(predicate, [object]);
  }

  /** @returns {Term[]} */
  values(subject, predicate) {
    return this.subjects.get(subject)?.get(predicate) ?? [];
  }

  /** @returns {Term|undefined} the first value */
  value(subject, predicate) {
    return this.values(subject, predicate)[0];
  }

  /** @returns {Term|undefined} the term reached from a subject by following predicates */
  follow(subject, predicates) {
    /** @type {Term|undefined} */
    let term = { kind: "iri", value: subject };
    for (const predicate of predicates) {
      if (!term || term.kind === "literal") return undefined;
      term = this.value(key(term), predicate);
    }
    return term;
  }

  /** Return the keys of all subjects that have this node as a value. */
  having(predicate, node) {
    let found = this.inverse.get(predicate);
    if (!found) this.inverse.set(predicate, (found = this.inverted(predicate)));
    return found.get(node) ?? [];
  }

  inverted(predicate) {
    const found = new Map();
    for (const [subject, facts] of this.subjects) {
      for (const term of facts.get(predicate) ?? []) {
        const there = found.get(key(term));
        if (there) there.push(subject);
        else found.set(key(term), [subject]);
      }
    }
    return found;
  }
}

/** Return the key of a node in a graph. */
export function key(term) {
  return term.kind === "blank" ? `_:${term.value}` : term.value;
}

/**
 * @param {string} text
 * @returns {Graph}
 * @throws {SyntaxError} if a line is not a triple
 */
export function parse(text) {
  const graph = new Graph();
  for (const line of text.split(/[\r\n]+/)) {
    const found = LINE.exec(line);
    if (found) graph.add(found[1] === undefined ? `_:${found[2]}` : plain(found[1]), plain(found[3]), object(found));
    else if (!/^[ \t]*(#|$)/.test(line)) throw new SyntaxError(`no N-Triples: ${line.slice(0, 200)}`);
  }
  return graph;
}

/** @param {string[]} found @returns {Term} */
function object([, , , , iri, blank, literal, datatype, language]) {
  if (iri !== undefined) return { kind: "iri", value: plain(iri) };
  if (blank !== undefined) return { kind: "blank", value: blank };
  const type = language ? LANG_STRING : datatype === undefined ? XSD_STRING : plain(datatype);
  return { kind: "literal", value: plain(literal), datatype: type, language };
}

function plain(text) {
  if (!text.includes("\\")) return text;
  return text.replace(ESCAPE, (whole, short, long, letter) => {
    if (letter === undefined) return String.fromCodePoint(parseInt(short ?? long, 16));
    return CHARACTERS[letter] ?? whole;
  });
}

/** @param {Term} term as N-Triples */
export function write(term) {
  if (term.kind === "blank") return `_:${term.value}`;
  if (term.kind === "iri") return `<${term.value.replace(/[\0-\x20<>"{}|^`\\]/g, escaped)}>`;
  const text = `"${term.value.replace(/["\\\n\r\0-\x1f\x7f]/g, escaped)}"`;
  if (term.language) return `${text}@${term.language}`;
  return term.datatype && term.datatype !== XSD_STRING ? `${text}^^<${term.datatype}>` : text;
}

/**
 * Write the body of a request about one thing.
 *
 * @param {[predicate: string, object: Term][]} says
 */
export function statements(says) {
  return says.map(([predicate, object]) => `_:it ${write({ kind: "iri", value: predicate })} ${write(object)} .\n`).join("");
}

function escaped(character) {
  return `\\u${character.charCodeAt(0).toString(16).padStart(4, "0")}`;
}
