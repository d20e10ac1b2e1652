// Moves something by hand over a stream of its action, as long as what a person sees is fresh (docs/DRIVING.md).

import { say } from "../../pages/scripts/src/say.js";
import { proof } from "../../pages/scripts/src/control.js";
import { send } from "../../pages/scripts/src/request.js";
import { camera } from "./drive_camera.js";

const PERIOD_MS = 33;
const OLD_MS = 500; // of what is shown; the stick locks, until it was released
const NORMAL = 1000;
const UUID = /[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}/i;

/**
 * What is moved: its control, the address of its action, whether a person wants it to move, the input for that at a share
 * of the speed, and figures in words. ``told`` is what the stream has told.
 * @typedef {{control: {enable: () => void, disable: () => void}, action: () => URL, moves: () => boolean,
 *   input: (share: number, told: any) => object, figures: (told: any) => string}} Moved
 */

export class ByHand {
  /**
   * @param {HTMLElement} section @param {{control: string, begin: string, doing: string, idle: string}} words
   * @param {Moved} moved
   */
  constructor(section, words, moved) {
    this.moved = moved;
    this.section = section;
    this.words = words;
    this.button = /** @type {HTMLButtonElement} */ (section.querySelector("button.begin"));
    this.speed = /** @type {HTMLInputElement} */ (section.querySelector("input[type=range]"));
    this.state = section.querySelector("output");
    this.said = section.querySelector(".figures");
    this.button.onclick = () => (this.socket ? this.close() : this.open());
    addEventListener("pagehide", () => this.close());
    section.hidden = false;
  }

  close() {
    this.socket?.close(NORMAL);
  }

  open() {
    const action = this.moved.action();
    const token = UUID.exec(proof(action.href)["Lock-Token"] ?? "")?.[0];
    const address = new URL(action);
    address.protocol = address.protocol.replace("http", "ws");
    this.told = { values: {} };
    this.shown = this.heard = this.pictured = undefined;
    this.locked = false;
    this.reason = "";
    this.socket = new WebSocket(address, ["lf.drive", ...(token ? [`lf.lease.${token}`] : [])]);
    this.socket.onmessage = ({ data }) => this.hear(JSON.parse(data));
    this.socket.onclose = () => this.closed();
    this.endPictures = camera(this.section, () => (this.pictured = performance.now()));
    this.timer = setInterval(() => this.send(), PERIOD_MS);
    this.say("waiting", say("Asking…"));
    this.button.textContent = say("Let go");
    this.moved.control.enable();
    this.drawn = requestAnimationFrame(() => this.draw());
  }

  hear(told) {
    if (told.time !== this.told.time) this.heard = performance.now();
    this.told = { ...this.told, ...told, values: { ...this.told.values, ...told.values } };
    if (told.ended) this.reason = told.reason;
  }

  /** What a person has seen is what was drawn, so that nothing moves behind a page that hangs or is hidden. */
  draw() {
    if (!this.socket) return;
    this.shown = this.told.time;
    this.drawn = requestAnimationFrame(() => this.draw());
    if (this.heard === undefined) return;
    const { applied = 0, dropped = {} } = this.told;
    const lost = Object.values(dropped).reduce((sum, each) => sum + each, 0);
    this.said.textContent = say("{value} · seen {age} ms ago · {applied} samples applied, {lost} dropped", { value: this.moved.figures(this.told), age: Math.round(this.age()), applied, lost });
    this.tell();
  }

  tell() {
    const { driver, priority, speedScale = 1, limitedBecause, silent, values } = this.told;
    const because = limitedBecause || values.limitedBecause;
    const share = speedScale < 1 ? say("{percent} % of the speed", { percent: Math.round(100 * speedScale) }) : say("Slower");
    if (this.locked) this.say("error", say("The {control} is locked: what you see is older than {OLD_MS} ms. Release it to go on.", { control: this.words.control, OLD_MS }));
    else if (because) this.say("waiting", `${share}: ${because}.`);
    else if (silent) this.say("waiting", say("The robot has braked: no sample reaches it in time."));
    else this.say("done", `${this.words.doing}${driver ? say(" as {driver}{value}", { driver, value: priority ? `, a ${priority}` : "" }) : ""}.`);
  }

  /** @returns {number} milliseconds since the older of the robot's state and its picture came, or since neither has */
  age() {
    const now = performance.now();
    return Math.max(now - (this.heard ?? 0), this.pictured === undefined ? 0 : now - this.pictured);
  }

  send() {
    if (this.socket?.readyState !== WebSocket.OPEN || typeof this.shown !== "number") return;
    const old = this.age() > OLD_MS;
    const moves = this.moved.moves();
    this.locked = old ? moves || this.locked : this.locked && moves;
    const share = this.locked || old ? 0 : Number(this.speed.value) / 100;
    this.socket.send(JSON.stringify({ seen: this.shown, input: this.moved.input(share, this.told) }));
  }

  closed() {
    const began = this.heard !== undefined;
    this.socket = undefined;
    clearInterval(this.timer);
    cancelAnimationFrame(this.drawn);
    this.endPictures?.();
    this.moved.control.disable();
    this.said.textContent = "";
    this.button.textContent = this.words.begin;
    if (began) this.say("", this.reason ? say("The stream has ended: {reason}.", { reason: this.reason }) : this.words.idle);
    else this.explain();
  }

  /** Browsers do not say why a WebSocket was refused; the same POST does. */
  async explain() {
    const { problem } = await send("POST", this.moved.action().href, { headers: { Prefer: "dry-run" } });
    this.say("error", problem ? `${problem.title}. ${problem.detail ?? ""}` : say("The stream could not be opened."));
  }

  say(state, text) {
    if (this.state.textContent === text) return;
    this.state.dataset.state = state;
    this.state.textContent = text;
  }
}
