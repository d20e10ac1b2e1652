// What the compiler cannot know: pages are written by the gateway, so that scripts know what elements they look for are.

interface EventTarget {
  closest?(selector: string): HTMLElement | null;
  matches?(selector: string): boolean;
  open?: boolean;
}

interface Element {
  dataset: DOMStringMap;
  href: string;
  src: string;
}

interface HTMLElement {
  /** The drawing in a section for one. */
  scene?: any;
}

/** The `scripts/page.js` of each extension. */
declare module "extensions" {
  export const parts: { start(): void }[];
}
