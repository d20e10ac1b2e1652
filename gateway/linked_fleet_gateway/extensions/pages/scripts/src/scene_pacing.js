// Schedules drawing: with the screen, or less often if the processor draws, so that the page stays usable.

const SOFTWARE = /swiftshader|llvmpipe|softpipe|software|basic render/i;
const SLOWEST_MS = 1000 / 15;
const SHARE = 0.3; // maximum share of time for drawing
const EARLY_MS = 4; // a timer of the browser is as exact as that

export class Pacing {
  /**
   * @param {WebGL2RenderingContext} context
   * @param {(now: number) => void} draw
   */
  constructor(context, draw) {
    this.draw = draw;
    this.software = isSoftware(context);
    this.next = -Infinity;
  }

  /** Draw once, soon. */
  request() {
    if (this.frame || this.timer) return;
    const wait = this.software ? this.next - performance.now() : 0;
    if (wait > EARLY_MS) this.timer = setTimeout(() => this.soon(), wait);
    else this.soon();
  }

  soon() {
    this.timer = undefined;
    this.frame = requestAnimationFrame((now) => {
      this.frame = undefined;
      // The time of a frame is that of its begin, which may be before the timer.
      if (this.software && this.next - now > EARLY_MS) return this.request();
      this.next = now + SLOWEST_MS;
      this.draw(now);
      // Which comes when this has been drawn.
      if (this.software) requestAnimationFrame((then) => (this.next = Math.max(this.next, then + (then - now) * (1 / SHARE - 1))));
    });
  }

  cancel() {
    clearTimeout(this.timer);
    cancelAnimationFrame(this.frame);
    this.timer = this.frame = undefined;
  }
}

/** Return whether the processor draws, as far as the browser tells. */
function isSoftware(context) {
  const known = context.getExtension("WEBGL_debug_renderer_info");
  return SOFTWARE.test(String(context.getParameter(known ? known.UNMASKED_RENDERER_WEBGL : context.RENDERER)));
}
