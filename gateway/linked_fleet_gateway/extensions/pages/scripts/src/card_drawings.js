// Drawings of robots on their cards: fetched while the card is seen, and shown when the pose is another. Browsers fetch
// lazy images of cards that are not laid out, of a thousand robots hundreds.

const BUSY_MS = 1000;
const IDLE_MS = 10_000; // a robot may be moved by others than this gateway
const PLACE = "[data-thumbnail]";

/** @typedef {{seen: boolean, busy: boolean, moved?: string, tag?: string, timer?: ReturnType<typeof setTimeout>, url?: string}} Drawing */

/** @type {WeakMap<Element, Drawing>} by card */
const drawings = new WeakMap();

const sight = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    const drawing = drawings.get(target);
    drawing.seen = isIntersecting;
    if (isIntersecting) image(target);
    plan(target, drawing);
  }
});
document.addEventListener("visibilitychange", () => document.querySelectorAll("#robots li[data-robot]").forEach(replan));

/** Follow the cards in this part of the page. */
export function watch(root) {
  for (const card of root.querySelectorAll("li[data-robot]")) {
    if (drawings.has(card) || !card.querySelector(PLACE)) continue;
    drawings.set(card, { seen: false, busy: false });
    sight.observe(card);
  }
}

/** The robot of a card is at a task, or its last motion ended at this time. */
export function moves(card, busy, moved) {
  const drawing = drawings.get(card);
  if (!drawing || (drawing.busy === busy && drawing.moved === moved)) return;
  Object.assign(drawing, { busy, moved });
  plan(card, drawing, 0);
}

function replan(card) {
  const drawing = drawings.get(card);
  if (drawing) plan(card, drawing);
}

/** @param {Element} card @param {Drawing} drawing */
function plan(card, drawing, wait = drawing.busy ? BUSY_MS : IDLE_MS) {
  clearTimeout(drawing.timer);
  if (!card.isConnected) return sight.unobserve(card);
  if (!drawing.seen || document.hidden) return;
  drawing.timer = setTimeout(() => draw(card, drawing).finally(() => plan(card, drawing)), wait);
}

/** @returns {HTMLImageElement} of the card, made when it is seen first */
function image(card) {
  const place = card.querySelector(PLACE);
  const found = place.querySelector("img");
  if (found) return found;
  const made = Object.assign(document.createElement("img"), { src: place.dataset.thumbnail, alt: "", width: 160, height: 120 });
  place.append(made);
  return made;
}

/** @param {Element} card @param {Drawing} drawing */
async function draw(card, drawing) {
  const shown = image(card);
  try {
    const headers = { Accept: "image/svg+xml", ...(drawing.tag ? { "If-None-Match": drawing.tag } : {}) };
    const response = await fetch(shown.parentElement.dataset.thumbnail, { headers, cache: "no-store" });
    if (!response.ok) return; // the same pose, or a robot that has gone
    drawing.tag = response.headers.get("etag") ?? undefined;
    const url = URL.createObjectURL(await response.blob());
    shown.src = url;
    if (drawing.url) URL.revokeObjectURL(drawing.url);
    drawing.url = url;
  } catch (error) {
    console.debug("a thumbnail cannot be had at present:", error);
  }
}
