// Elements that scripts make: fields, buttons and choices.

let count = 0;

/**
 * @param {string} tag
 * @param {Record<string, any>} [given] properties, and attributes with a hyphen
 * @param {...(Node | string | undefined | false)} inner
 * @returns {any}
 */
export function element(tag, given = {}, ...inner) {
  const made = document.createElement(tag);
  for (const [name, value] of Object.entries(given)) {
    if (name.includes("-")) made.setAttribute(name, value);
    else if (value !== undefined) made[name] = value;
  }
  made.append(.../** @type {(Node | string)[]} */ (inner.filter(Boolean)));
  return made;
}

/** A label, its control, and a hint. */
export function field(/** @type {string} */ label, /** @type {HTMLElement} */ control, hint = "") {
  control.id ||= `built-${++count}`;
  const note = hint && element("small", { className: "hint", id: `${control.id}-hint` }, hint);
  if (note) control.setAttribute("aria-describedby", note.id);
  return element("div", { className: "field" }, element("label", { htmlFor: control.id }, label), control, note);
}

/** A button; quiet ones are not the main thing to do. */
export function button(/** @type {string} */ text, /** @type {(event: Event) => void} */ press, given = {}) {
  const made = element("button", { type: "button", className: "quiet", ...given }, text);
  made.addEventListener("click", press);
  return made;
}

/** @param {[value: string, text: string][]} options */
export function choice(options, value = "", given = {}) {
  const made = element("select", given);
  made.append(...options.map(([each, text]) => new Option(text, each)));
  made.value = value;
  return made;
}
