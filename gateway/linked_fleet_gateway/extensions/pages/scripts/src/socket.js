// Subscriptions over WebSocket (gateway/linked_fleet_gateway/subscriptions/PROTOCOL.md): one connection per resource and options.

import * as heartbeat from "./heartbeat.js";
import { parse } from "./ntriples.js";

const FIRST_PAUSE_MS = 300;
const LONGEST_PAUSE_MS = 8000;
// A hidden tab closes its connections after this time.
const HIDDEN_MS = 60000;
const CANCELLED = 1000; // somebody deleted the subscription: reconnecting would override that
const UNAUTHENTICATED = 401; // the session is over: reloading the page leads to the login
const FORBIDDEN = 403; // a reader without the right to subscribe keeps the served page
const NOT_FOUND = 404;
const EVENT_ID = "https://w3id.org/linked-fleet#eventId";

/** @type {Map<string, Channel>} */
const channels = new Map();
const listeners = new Set();
/** @type {State} */
let told = "live";

/**
 * @typedef {{protocol?: "lf.ntriples"|"lf.frame"|"lf.jpeg", interval?: number, depth?: "this"|"properties"|"subtree", onGone?: () => void, isAside?: boolean}} Options
 * `interval`: the minimum time between two messages in seconds; `onGone` is called if the resource does not exist.
 * What is `isAside` says nothing about the page: another robot may be gone
 * @typedef {"live"|"lost"|"gone"|"cancelled"|"forbidden"|"silent"} State
 */

/**
 * Subscribe to a resource of this origin. The present state comes first, then every change, conflated: each message is
 * complete, so the last one suffices. It resumes by itself after an interruption.
 *
 * @param {string} iri of the resource, absolute or path-absolute
 * @param {Options} options
 * @param {(message: any) => void} onMessage gets a graph of `lf.ntriples`, parsed
 * once for all listeners, or the bytes of an `lf.frame` or `lf.jpeg`
 * @returns {() => void} ends the subscription; the last one to end closes the connection
 */
export function watch(iri, { protocol = "lf.ntriples", interval = 0.1, depth = "properties", onGone, isAside = false } = {}, onMessage) {
  const address = new URL(iri, document.baseURI);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  address.searchParams.set("interval", String(interval));
  address.searchParams.set("depth", depth);
  const key = `${protocol} ${address}${isAside ? " aside" : ""}`;
  let channel = channels.get(key);
  if (!channel) channels.set(key, (channel = new Channel(key, address, protocol, isAside)));
  return channel.join(onMessage, onGone);
}

/**
 * Call a listener with the state of the connections: `live`, `lost` (and retried), `gone` if there is no such resource
 * (and retried, since robots come back), `cancelled` by somebody else, `forbidden`, or `silent` while they are open and
 * the gateway does not respond. At once and when that changes.
 *
 * @param {(state: State) => void} listener
 */
export function onConnection(listener) {
  listeners.add(listener);
  listener(told);
}

function tell() {
  const states = new Set([...channels.values()].map(({ state, isAside }) => (isAside && state === "gone" ? "live" : state)));
  const open = heartbeat.isSilent() ? "silent" : "live";
  /** @type {State[]} */
  const worst = ["lost", "gone", "cancelled", "forbidden"];
  const now = worst.find((state) => states.has(state)) ?? open;
  if (now === told) return;
  told = now;
  for (const listener of listeners) listener(now);
}

class Channel {
  constructor(key, address, protocol, isAside) {
    this.key = key;
    this.isAside = isAside;
    this.address = address;
    this.protocol = protocol;
    this.members = new Map();
    this.last = undefined;
    this.lastEventId = undefined;
    this.failures = 0;
    this.state = "live";
    this.open();
  }

  join(onMessage, onGone) {
    this.members.set(onMessage, onGone);
    // Like the first message of a new connection: later, and only if nothing newer has come.
    const { last } = this;
    if (last !== undefined) {
      queueMicrotask(() => last === this.last && this.members.has(onMessage) && onMessage(last));
    }
    return () => {
      this.members.delete(onMessage);
      if (!this.members.size) this.end();
    };
  }

  open() {
    this.rest();
    const address = new URL(this.address);
    if (this.lastEventId) address.searchParams.set("last-event-id", this.lastEventId);
    const socket = new WebSocket(address, this.protocol);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.failures = 0;
      heartbeat.heard();
      this.become("live");
    };
    socket.onmessage = ({ data }) => this.take(data);
    socket.onclose = ({ code }) => {
      this.socket = undefined;
      if (code === CANCELLED) this.become("cancelled");
      else this.retry();
    };
    this.socket = socket;
  }

  take(data) {
    heartbeat.heard();
    const message = typeof data === "string" ? parse(data) : data;
    if (typeof data === "string") this.lastEventId = message.value(new URL(this.address.pathname, document.baseURI).href, EVENT_ID)?.value;
    this.last = message;
    for (const member of [...this.members.keys()]) member(message);
  }

  retry() {
    if (this.state !== "gone") this.become("lost");
    const longest = Math.min(LONGEST_PAUSE_MS, FIRST_PAUSE_MS * 2 ** this.failures++);
    const timer = setTimeout(() => this.again(timer), longest * (0.5 + Math.random() / 2));
    this.timer = timer;
  }

  /** Find the reason of a refused handshake by an ordinary request; scripts do not learn it otherwise. */
  async again(timer) {
    const status = await statusOf(this.address.pathname);
    if (this.timer !== timer) return; // it was handled meanwhile
    if (status === UNAUTHENTICATED) location.reload();
    else if (status === FORBIDDEN) this.become("forbidden");
    else if (status !== NOT_FOUND) this.open();
    else {
      this.become("gone");
      for (const onGone of [...this.members.values()]) onGone?.();
      if (this.members.size) this.retry();
    }
  }

  become(state) {
    this.state = state;
    tell();
  }

  rest() {
    clearTimeout(this.timer);
    this.timer = undefined;
  }

  /** Close the connection for the time being; `open` opens it again. */
  pause() {
    this.rest();
    if (this.socket) {
      this.socket.onclose = this.socket.onmessage = null;
      this.socket.close();
      this.socket = undefined;
    }
  }

  resume() {
    if (!this.socket && this.state !== "cancelled" && this.state !== "forbidden") this.open();
  }

  end() {
    channels.delete(this.key);
    this.pause();
    tell();
  }
}

/** Return the status, 0 without a response. Requests an event stream, which needs the same rights; HEAD opens none. */
async function statusOf(path) {
  try {
    return (await fetch(path, { method: "HEAD", cache: "no-store", headers: { accept: "text/event-stream" } })).status;
  } catch {
    return 0;
  }
}

function all(what) {
  for (const channel of [...channels.values()]) channel[what]();
}

/** Close all connections until `resumeAll`. */
export const pauseAll = () => all("pause");
export const resumeAll = () => all("resume");

heartbeat.start(() => channels.size > 0, tell);

let hiding;
document.addEventListener("visibilitychange", () => {
  clearTimeout(hiding);
  if (document.hidden) hiding = setTimeout(pauseAll, HIDDEN_MS);
  else resumeAll();
});
// A page with open sockets cannot be kept for the Back button.
addEventListener("pagehide", pauseAll);
addEventListener("pageshow", ({ persisted }) => persisted && resumeAll());
addEventListener("online", resumeAll);
