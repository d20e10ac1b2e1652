// Drives a base by hand over a stream of its action drive (docs/DRIVING.md).

import { proof } from "../../pages/scripts/src/control.js";
import { send } from "../../pages/scripts/src/request.js";
import { camera } from "./drive_camera.js";
import { Stick } from "./stick.js";

const PERIOD_MS = 33;
const OLD_MS = 500; // of what is shown; the stick locks, until it was released
const NORMAL = 1000;
const UUID = /[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}/i;

export function show(/** @type {HTMLElement} */ section) {
  new Drive(section);
}

class Drive {
  constructor(section) {
    this.section = section;
    this.action = new URL(section.dataset.drive, document.baseURI);
    this.button = section.querySelector("button");
    this.speed = section.querySelector("input[type=range]");
    this.state = section.querySelector("output");
    this.figures = section.querySelector(".figures");
    this.stick = new Stick(section.querySelector(".stick"), section);
    this.button.onclick = () => (this.socket ? this.socket.close(NORMAL) : this.open());
    addEventListener("pagehide", () => this.socket?.close(NORMAL));
    section.hidden = false;
  }

  open() {
    const token = UUID.exec(proof(this.action.href)["Lock-Token"] ?? "")?.[0];
    const address = new URL(this.action);
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
    this.say("waiting", "Asking…");
    this.button.textContent = "Let go";
    this.stick.enable();
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
    const { linear = 0, angular = 0 } = this.told.values.twist ?? {};
    const { applied = 0, dropped = {} } = this.told;
    const lost = Object.values(dropped).reduce((sum, each) => sum + each, 0);
    this.figures.textContent = `${linear.toFixed(2)} m/s, ${angular.toFixed(2)} rad/s · seen ${Math.round(this.age())} ms ago · ${applied} samples applied, ${lost} dropped`;
    this.tell();
  }

  tell() {
    const { driver, priority, speedScale = 1, limitedBecause, silent } = this.told;
    if (this.locked) this.say("error", `The stick is locked: what you see is older than ${OLD_MS} ms. Release it to drive on.`);
    else if (limitedBecause) this.say("waiting", `${Math.round(100 * speedScale)} % of the speed: ${limitedBecause}.`);
    else if (silent) this.say("waiting", "The robot has braked: no sample reaches it in time.");
    else this.say("done", `You drive${driver ? ` as ${driver}${priority ? `, a ${priority}` : ""}` : ""}.`);
  }

  /** @returns {number} milliseconds since the older of the robot's state and its picture came, or since neither has */
  age() {
    const now = performance.now();
    return Math.max(now - (this.heard ?? 0), this.pictured === undefined ? 0 : now - this.pictured);
  }

  send() {
    if (this.socket?.readyState !== WebSocket.OPEN || typeof this.shown !== "number") return;
    const wanted = this.stick.value();
    const moves = Object.values(wanted).some(Boolean);
    const old = this.age() > OLD_MS;
    this.locked = old ? moves || this.locked : this.locked && moves;
    const share = this.locked || old ? 0 : Number(this.speed.value) / 100;
    const most = this.told.values.driveLimits ?? {};
    const input = { linear: share * wanted.linear * (most.linear ?? 0), angular: share * wanted.angular * (most.angular ?? 0) };
    if (most.lateral) input.lateral = share * wanted.lateral * most.lateral;
    this.socket.send(JSON.stringify({ seen: this.shown, input }));
  }

  closed() {
    const began = this.heard !== undefined;
    this.socket = undefined;
    clearInterval(this.timer);
    cancelAnimationFrame(this.drawn);
    this.endPictures?.();
    this.stick.disable();
    this.figures.textContent = "";
    this.button.textContent = "Drive";
    if (began) this.say("", this.reason ? `The stream has ended: ${this.reason}.` : "You do not drive.");
    else this.explain();
  }

  /** Browsers do not say why a WebSocket was refused; the same POST does. */
  async explain() {
    const { problem } = await send("POST", this.action.href, { headers: { Prefer: "dry-run" } });
    this.say("error", problem ? `${problem.title}. ${problem.detail ?? ""}` : "The stream could not be opened.");
  }

  say(state, text) {
    if (this.state.textContent === text) return;
    this.state.dataset.state = state;
    this.state.textContent = text;
  }
}
