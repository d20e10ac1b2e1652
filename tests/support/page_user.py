"""Somebody at a page of the gateway, with a mouse or a finger, whose clicks or taps and drags are counted."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, Locator, Page, ViewportSize

from chromium import DESK, PHONE
from running import PATIENCE_S

SIZES: dict[str, ViewportSize] = {"desk": DESK, "phone": PHONE}


class PageUser:
    """``made`` counts clicks or taps, and drags. Of the first task ``needed`` is their number, ``took_s`` its time."""

    def __init__(self, page: Page, size: str) -> None:
        self.page, self.touch, self.made = page, size == "phone", 0
        self._begun_s, self._done = time.monotonic(), False
        self.needed, self.took_s = 0, 0.0
        self.said: list[str] = []
        """Warnings and errors on the console."""
        page.on("console", lambda message: message.type in ("error", "warning") and self.said.append(message.text))

    def press(self, place: Locator, at: tuple[float, float] | None = None) -> None:
        """Press in the middle, or ``at`` some pixels from the upper left corner."""
        self.made += 1
        (place.tap if self.touch else place.click)(position=None if at is None else {"x": at[0], "y": at[1]})

    def finish(self) -> None:
        """Note that the task is done; what follows is not part of it."""
        if not self._done:
            self._done, self.needed, self.took_s = True, self.made, time.monotonic() - self._begun_s

    def drag(self, x: float, y: float, right: float, down: float = 0) -> None:
        self.made += 1
        if not self.touch:
            self.page.mouse.move(x, y)
            self.page.mouse.down()
            self.page.mouse.move(x + right, y + down, steps=4)
            self.page.mouse.up()
            return
        session = self.page.context.new_cdp_session(self.page)
        for step, kind in enumerate(("touchStart", *["touchMove"] * 4)):
            point = {"x": x + right * step / 4, "y": y + down * step / 4}
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [point]})
        session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})

    def forgive(self, *texts: str) -> None:
        """Accept console messages of the browser about failed requests that the test caused."""
        self.said = [each for each in self.said if not any(text in each for text in texts)]

    def fits(self) -> bool:
        """Return True unless the page scrolls sideways."""
        width = self.page.viewport_size["width"] if self.page.viewport_size else 0
        return bool(self.page.evaluate("document.documentElement.scrollWidth") == width)


def log_in(page: Page, token: str) -> None:
    """Log in on the page that asks for it."""
    page.get_by_label("Token", exact=True).fill(token)
    page.get_by_role("button", name="Log in").click()


@contextmanager
def using_page(chromium: Browser, size: str, script: str = "") -> Iterator[PageUser]:
    """Open a page of this size, with few pixels. It must say nothing on the console and not scroll sideways.

    ``script`` runs before those of each page.
    """
    touch = size == "phone"
    context = chromium.new_context(
        viewport=SIZES[size], has_touch=touch, is_mobile=touch, reduced_motion="reduce", device_scale_factor=0.5
    )
    context.set_default_timeout(PATIENCE_S * 1000)
    if script:
        context.add_init_script(script)
    operator = PageUser(context.new_page(), size)
    yield operator
    assert operator.fits()
    operator.forgive("closed before the connection is established")
    assert operator.said == []
    context.close()
