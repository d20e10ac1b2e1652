// Requests that change something, and the gateway's responses in its own words.

import { say } from "./say.js";
import { parse } from "./ntriples.js";
import { proof, remember } from "./control.js";

const ACCEPT = "application/n-triples, application/problem+json";

/**
 * @typedef {{type?: string, title: string, detail: string, status: number, report?: Record<string, string>[], things?: string[], names?: string[], point?: number[], retryWith?: Record<string, string>[]}} Problem
 * `things` would collide at `point`, in metre in the world; with members of `retryWith` the same request may succeed
 * @typedef {{problem?: Problem, graph?: import("./ntriples.js").Graph, location: string|null, status: number, tag?: string|null}} Answer `tag`: the entity tag
 */

/**
 * @param {string} method
 * @param {string} iri
 * @param {{body?: string | Blob, headers?: Record<string, string>}} options `body`: Turtle, unless there is a Content-Type
 * @returns {Promise<Answer>} `status` is 0 without a response
 */
export async function send(method, iri, { body, headers = {} } = {}) {
  const fields = { Accept: ACCEPT, ...proof(iri), ...headers };
  if (body !== undefined) fields["Content-Type"] ??= "text/turtle";
  let response;
  let text;
  try {
    response = await fetch(iri, { method, headers: fields, body, cache: "no-store", redirect: "error", keepalive: !body });
    text = await response.text();
  } catch {
    return { problem: { title: say("No answer"), detail: say("The gateway did not answer. Is the connection lost?"), status: 0 }, location: null, status: 0 };
  }
  remember(method, iri, response);
  const location = response.headers.get("location");
  const type = response.headers.get("content-type") ?? "";
  if (!response.ok) return { problem: problemIn(response, type, text), location, status: response.status };
  return { graph: type.startsWith("application/n-triples") ? parse(text) : undefined, location, status: response.status, tag: response.headers.get("etag") };
}

function problemIn({ status, statusText }, type, text) {
  const plain = { title: statusText || say("Status {status}", { status }), detail: text.slice(0, 500), status };
  if (!type.includes("json")) return plain;
  try {
    return { ...plain, ...JSON.parse(text) };
  } catch {
    return plain;
  }
}

/** Return a unique text of visible characters; `crypto.randomUUID` requires https. */
export function fresh() {
  return Array.from(crypto.getRandomValues(new Uint8Array(16)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}
