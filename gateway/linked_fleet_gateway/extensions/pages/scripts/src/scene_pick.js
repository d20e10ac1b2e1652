// Pointing at a part: it is highlighted, a label names it, a click opens its page.

import { Raycaster, Vector2 } from "three";

const DRAG_PX = 5;

/** Finds parts under the pointer. `page` returns the address of a part's page by its kind and name. */
export class Picker {
  constructor(view, label, { page, describe }) {
    this.view = view;
    this.label = label;
    this.page = page;
    this.describe = describe;
    this.parts = [];
    this.over = undefined;
    /** Return whether there is no part under the pointer. */
    this.quiet = () => false;
    this.caster = new Raycaster();
    const { canvas, ending } = view;
    const on = (target, type, listener) => target.addEventListener(type, listener, { signal: ending.signal });
    on(canvas, "pointermove", (event) => event.pointerType !== "touch" && !event.buttons && this.soon(event));
    on(canvas, "pointerdown", (event) => (this.down = event));
    on(canvas, "pointerup", (event) => this.up(event));
    on(canvas, "auxclick", (event) => event.button === 1 && this.go(event, true));
    on(canvas, "pointerleave", (event) => event.pointerType !== "touch" && !label.contains(event.relatedTarget) && this.leave());
    on(label, "pointerleave", (event) => event.pointerType !== "touch" && event.relatedTarget !== canvas && this.leave());
    on(canvas, "keydown", (event) => event.key === "Escape" && this.point(undefined));
  }

  /** Set the present parts, one of which may be under a resting pointer. */
  set(parts) {
    this.point(undefined);
    this.parts = parts;
    this.meshes = parts.flatMap((part) => part.meshes);
    if (this.latest) this.soon(this.latest);
  }

  leave() {
    this.latest = undefined;
    this.point(undefined);
  }

  soon(event) {
    this.latest = event;
    this.asked ||= requestAnimationFrame(() => {
      this.asked = undefined;
      if (this.latest) this.point(this.at(this.latest), this.latest);
    });
  }

  /** @returns {import("./scene_parts.js").Part|undefined} the part at a place of the window, in CSS pixels */
  at({ clientX, clientY }) {
    const { canvas, camera } = this.view;
    const { left, top, width, height } = canvas.getBoundingClientRect();
    const place = new Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
    this.caster.setFromCamera(place, camera);
    return this.caster.intersectObjects(this.meshes ?? [], false)[0]?.object.userData.part;
  }

  point(part, event) {
    const { canvas, colours } = this.view;
    if (part !== this.over) {
      this.over?.highlight(undefined);
      part?.highlight(colours.highlight);
      this.over = part;
      canvas.classList.toggle("over-part", Boolean(part));
      this.label.hidden = !part;
      if (part) this.tell(part, event);
      this.view.invalidate();
    }
  }

  tell(part, { clientX, clientY }) {
    const { joint, link } = part;
    this.label.replaceChildren(this.link("link", link.urdfName));
    this.value = undefined;
    if (joint) {
      this.value = document.createElement("data");
      this.label.append(this.link("joint", joint.urdfName), this.value);
      this.refresh();
    }
    // Within the view, and beside the pointer rather than below it.
    const { left, top, width, height } = this.view.canvas.getBoundingClientRect();
    const { offsetWidth, offsetHeight } = this.label;
    const x = clientX - left + 14 + offsetWidth > width ? clientX - left - 14 - offsetWidth : clientX - left + 14;
    const y = Math.min(clientY - top + 14, height - offsetHeight - 4);
    this.label.style.translate = `${Math.max(4, x)}px ${Math.max(4, y)}px`;
  }

  link(kind, name) {
    const href = this.page(kind, name);
    const made = document.createElement(href ? "a" : "span");
    if (href) made.href = href;
    made.textContent = `${kind} ${name}`;
    made.dataset.kind = kind;
    return made;
  }

  /** Update the position in the label. */
  refresh() {
    if (!this.value || !this.over?.joint) return;
    const { value, text } = this.describe(this.over.joint);
    this.value.value = value;
    this.value.textContent = text;
  }

  up(event) {
    const { down } = this;
    this.down = undefined;
    if (this.quiet() || event.button !== 0 || !down || Math.hypot(event.clientX - down.clientX, event.clientY - down.clientY) > DRAG_PX) return;
    const part = this.at(event);
    // A finger cannot hover: its first tap shows the label, which has the links.
    if (event.pointerType === "touch" && part !== this.over) this.point(part, event);
    else if (part) this.go(event, event.ctrlKey || event.metaKey);
  }

  go(event, apart) {
    const part = this.at(event);
    if (!part) return;
    const toLink = event.shiftKey || event.altKey || !part.joint;
    const href = (!toLink && this.page("joint", part.joint.urdfName)) || this.page("link", part.link.urdfName);
    if (!href) return;
    if (apart) open(href, "_blank", "noopener");
    else location.assign(href);
  }
}
