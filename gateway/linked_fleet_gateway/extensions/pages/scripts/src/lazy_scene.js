// Decides when the scene of a page is fetched and drawn: at once, or on demand.

const PHONE = matchMedia("(max-width: 40rem)");

/**
 * Draw now; in a section with `data-lazily` when the page is usable and the section is seen, on a phone when it is asked for.
 *
 * @param {HTMLElement} section
 * @param {() => void} draw
 */
export function whenWanted(section, draw) {
  if (!("lazily" in section.dataset)) return draw();
  const button = section.querySelector("button");
  if (PHONE.matches && button) {
    button.hidden = false;
    button.onclick = () => {
      button.remove();
      draw();
    };
  } else if (document.readyState === "complete") whenSeen(section, draw);
  else addEventListener("load", () => whenSeen(section, draw), { once: true });
}

function whenSeen(section, draw) {
  new IntersectionObserver((entries, observer) => {
    if (!entries.at(-1).isIntersecting) return;
    observer.disconnect();
    requestIdleCallback(draw, { timeout: 2000 });
  }).observe(section);
}
