// The HTML around the drawing: progress, marks, the choice of colours and its legend.

import { say } from "./say.js";
import { MODES, ramp } from "./scene_parts.js";

const HELP = say("Drag to turn, pinch or scroll to zoom after a click. Keys: arrows, + and −, 0 shows the whole robot. ") +
  say("A click on a part opens its joint, with Shift its link.");
const ENDS = {
  "limit proximity": [say("midway between the limits"), say("at a limit"), say("no limits, or position unknown")],
  effort: [say("no effort"), say("all that is allowed"), say("no limit, or effort unknown")],
};

let panels = 0;

/** The elements of the section; `onMode` is called with the colour mode, `onFit` to show everything. */
export class Panel {
  constructor(section, { onMode, onFit }) {
    this.section = section;
    this.number = panels++ || "";
    // The former content says what to do without a picture.
    this.fallback = [...section.children].filter((each) => !/^H[1-6]$/.test(each.tagName));
    this.canvas = make("canvas", { role: "img", tabIndex: 0 });
    this.bar = make("progress", { max: 1, value: 0 });
    this.bar.setAttribute("aria-label", say("meshes loaded"));
    this.count = make("span", {}, "loading");
    this.loading = make("p", { className: "scene-loading" }, this.bar, this.count);
    this.badge = make("p", { className: "scene-badge", hidden: true }, say("offline: as it was last seen"));
    this.unknown = make("p", { className: "scene-unknown", hidden: true });
    this.label = make("div", { className: "scene-label", hidden: true });
    const help = make("p", { className: "scene-help", id: `scene-help${this.number}` }, HELP);
    this.canvas.setAttribute("aria-describedby", help.id);
    this.view = make("div", { className: "scene-view" }, this.canvas, this.badge, this.loading, this.unknown, this.label);
    const fit = make("button", { type: "button", onclick: onFit }, say("Show all"));
    this.controls = make("div", { className: "scene-bar" }, this.choice(onMode), fit, this.legend());
    this.note = make("p", { className: "scene-note", hidden: true });
    this.note.setAttribute("role", "status");
    this.made = [this.view, this.controls, help, this.note];
  }

  /** Replace the former content. */
  enter() {
    for (const each of this.fallback) each.hidden = true;
    this.section.append(...this.made);
  }

  choice(onMode) {
    const choices = MODES.map((mode) => {
      const input = make("input", { type: "radio", name: `scene-colour${this.number}`, value: mode, checked: mode === MODES[0] });
      input.onchange = () => onMode(mode);
      return make("label", {}, input, ` ${say(mode)}`);
    });
    return make("fieldset", {}, make("legend", {}, say("Colour by")), ...choices);
  }

  legend() {
    this.low = make("span");
    this.high = make("span");
    this.none = make("span");
    this.most = make("strong");
    this.ramp = make("i", { className: "scene-ramp" });
    const stops = Array.from({ length: 9 }, (_, i) => `#${ramp(i / 8).getHexString()}`);
    this.ramp.style.background = `linear-gradient(90deg, ${stops.join(", ")})`;
    const swatch = make("i", { className: "scene-swatch" });
    this.key = make("div", { className: "scene-legend", hidden: true }, this.low, this.ramp, this.high, swatch, this.none, this.most);
    return this.key;
  }

  /** The legend of a mode; `most` names the highest value. */
  explain(mode, most) {
    this.key.hidden = !(mode in ENDS);
    if (this.key.hidden) return;
    for (const [i, element] of [this.low, this.high, this.none].entries()) set(element, ENDS[mode][i]);
    set(this.most, most);
  }

  progress(done, of) {
    this.bar.value = of ? done / of : 1;
    set(this.count, say("{done} of {of} meshes", { done, of }));
    this.loading.hidden = done === of;
  }

  mark({ offline, unknown }) {
    this.section.toggleAttribute("data-offline", offline);
    this.badge.hidden = !offline;
    this.unknown.hidden = !unknown.length;
    set(this.unknown, unknown.length ? say("Position unknown: {names}", { names: shortened(unknown) }) : "");
  }

  name(text) {
    if (this.canvas.getAttribute("aria-label") !== text) this.canvas.setAttribute("aria-label", text);
  }

  /** Show why there is no picture. */
  fail(reason) {
    for (const each of this.made) if (each !== this.note) each.remove();
    for (const each of this.fallback) each.hidden = false;
    this.section.append(this.note);
    this.note.hidden = false;
    set(this.note, reason);
  }

  leave() {
    for (const each of this.made) each.remove();
    for (const each of this.fallback) each.hidden = false;
  }
}

function shortened(names) {
  const [first, rest] = [names.slice(0, 4).join(", "), names.length - 4];
  return rest > 0 ? say("{first} and {rest} more", { first, rest }) : first;
}

function set(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

function make(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}
